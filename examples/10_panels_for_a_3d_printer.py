"""Panels for a 3D printer: a bed of 220 mm for a sheet, panels no larger than it, one 3MF file a bed.

Run it: blender -b --python examples/10_panels_for_a_3d_printer.py
"""

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

BED = {"sheet.sheet_width": 220, "sheet.sheet_height": 220, "sheet.nesting": "FAST", "connect.clearance": 0.1}

piece = api.load("shape:dome", edge=16, settings=BED | {"material.material": "petg", "spiral.thickness": 2})
for path in api.export(piece, "beds", formats=("3mf",)):
    print(path)
