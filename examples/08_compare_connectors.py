"""Which connector suits a piece: how many joints each kind solves, and how long it takes to put the piece together.

Run it: blender -b --python examples/08_compare_connectors.py
"""

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

piece = api.spirals(api.load("shape:dome", edge=20, settings={"sheet.nesting": "FAST"}))
for kind in ("dovetail", "key", "tab"):
    made = api.report(api.sheets(api.change(piece, {"connect.connector": kind})))["sheets"]
    solved = made["connector_kinds"].get(kind, 0)
    print(f"{kind:9} {solved} of {made['joints']} joints, {made['assembly_minutes']:.0f} minutes to assemble")
