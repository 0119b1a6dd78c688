"""A test cut for your machine: one small arch with several clearances, to find the one that holds without force.

Run it: blender -b --python examples/09_find_your_clearance.py
"""

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

CLEARANCES = (0.0, 0.05, 0.1)  # millimetres
# so small a sheet that the arch is cut, and has joints
SMALL = {"sheet.sheet_width": 120, "sheet.sheet_height": 120, "sheet.nesting": "FAST"}
KERF = {"cut.kerf_outline": 0.15, "cut.kerf_holes": 0.15}

piece = api.spirals(api.load("shape:strip", edge=20, settings=SMALL | KERF))
for clearance in CLEARANCES:
    made = api.change(piece, {"connect.clearance": clearance})
    api.export(made, f"clearance_{clearance:g}mm", formats=("svg",))
    print(f"{clearance:g} mm: clearance_{clearance:g}mm/sheet-01.svg")
