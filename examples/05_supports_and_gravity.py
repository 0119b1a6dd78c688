"""How far a standing piece sags under its own weight: the same vault with and without gravity, on its lowest quads.

Run it: blender -b --python examples/05_supports_and_gravity.py
"""

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

piece = api.layout(api.load("shape:vault", edge=20))
highest = {}
for gravity in (False, True):
    made = api.simulate(api.change(piece, {"simulate.gravity": gravity}), supports="lowest")
    highest[gravity] = made.result.simulation.vertices[:, 2].max()
print(f"It sags by {1e3 * (highest[False] - highest[True]):.3f} mm")
