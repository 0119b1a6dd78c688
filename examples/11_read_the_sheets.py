"""The sheets as polygons in Python: how much of each sheet is panels, by shapely, for your own nesting or checking.

Run it: blender -b --python examples/11_read_the_sheets.py
"""

import shapely

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

TOLERANCE = 2e-5  # metres: arcs become lines that stray no farther

made = api.sheets(api.load("shape:dome", edge=20, settings={"sheet.nesting": "FAST"})).result.sheets
for panel in made.panels:
    holes = [hole.sample(TOLERANCE) for hole in panel.holes]
    shape = shapely.Polygon(panel.outline.sample(TOLERANCE), holes)
    print(f"panel {panel.number}: {1e4 * shape.area:.1f} cm2 in {len(holes)} holes and one outline")
