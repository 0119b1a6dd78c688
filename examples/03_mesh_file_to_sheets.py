"""From a mesh file to sheets for a laser: quads of 20 mm, kerf of your machine, SVG, DXF and PDF in a folder.

Run it: blender -b --python examples/03_mesh_file_to_sheets.py -- surface.obj
"""

import sys

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

source = sys.argv[-1] if "--" in sys.argv else "shape:dome"
kerf = 0.15  # millimetres that your laser takes away; cut a square of 20 mm and measure it
piece = api.load(source, edge=20, settings={"cut.kerf_outline": kerf, "cut.kerf_holes": kerf})
for finding in api.check(piece):
    print(f"{finding.severity}: {finding.message}")
piece = api.sheets(piece)
api.export(piece, "sheets")
made = api.report(piece)["sheets"]
print(f"{made['panels']} panels on {made['sheets']} sheets, {made['cut_length_m']:.1f} m of cuts")
