"""The smallest piece there is: one quad, one spiral, one panel, one SVG file.

Run it: blender -b --python examples/01_one_quad_to_svg.py
"""

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

piece = api.load("shape:quad", edge=30)  # millimetres
for path in api.export(piece, "one_quad", formats=("svg",)):
    print(path)
