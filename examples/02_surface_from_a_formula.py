"""A surface from a formula: a grid of points in metres and quads between them become a piece, and the piece a shape.

Run it: blender -b --python examples/02_surface_from_a_formula.py
"""

import numpy as np

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

COLUMNS, ROWS = 12, 8
x, y = np.meshgrid(np.linspace(-0.12, 0.12, COLUMNS + 1), np.linspace(-0.08, 0.08, ROWS + 1), indexing="ij")
points = np.stack([x, y, 2.0 * (x**2 - y**2)], axis=-1).reshape(-1, 3)  # a saddle
number = np.arange(len(points)).reshape(COLUMNS + 1, ROWS + 1)
quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)

piece = api.simulate(api.load(api.QuadMesh(points, quads)))
found = api.report(piece)
print(
    f"{found['layout']['patches']} panels, {found['equilibrium']['rms_percent']:.2f} % from the saddle (RMS of its size)"
)
