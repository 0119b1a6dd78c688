"""Replace the spiral by a curve with corners, from a script: a piece is drawn, simulated and written (docs/microstructures.md).

The stiffness table, the widths of slots and the blends at joints stay those of the spiral: do not cut these sheets.

Run it: blender -b --python examples/19_square_spiral.py
"""

from unittest.mock import patch

import numpy as np

try:
    from bl_ext.user_default.flexmaps import api
    from bl_ext.user_default.flexmaps.engine.mechanics.arms import beams, curving
    from bl_ext.user_default.flexmaps.engine.spirals.curves import arm_curves, spiral
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api
    from flexmaps.engine.mechanics.arms import beams, curving
    from flexmaps.engine.spirals.curves import arm_curves, spiral

CORNERS = 0.15  # the radius is multiplied by 1 + CORNERS (1 - cos 4 theta), theta the angle from the joint
spiral_points = spiral.curve_points


def square_points(radius, angle, wind, slope, share, t):
    """Return points of the centre lines and their first and second derivatives by t: the spiral's, and the corners' offset.

    Arguments as in ``spiral.curve_points``.
    """
    p, d1, d2 = spiral_points(radius, angle, wind, slope, share, t)
    theta, left = wind * np.minimum(t, 1.0), 1.0 - t
    wind = np.where(t > 1.0, 0.0, wind)  # straight beyond the centre
    more = CORNERS * (1.0 - np.cos(4.0 * theta))
    more1, more2 = 4.0 * CORNERS * wind * np.sin(4.0 * theta), 16.0 * CORNERS * wind**2 * np.cos(4.0 * theta)
    f, f1, f2 = left * more, left * more1 - more, left * more2 - 2.0 * more1
    turn = radius * np.exp(1j * (angle + theta))
    return p + turn * f, d1 + turn * (f1 + 1j * wind * f), d2 + turn * (f2 + 2j * wind * f1 - wind**2 * f)


def square_integrals(twist, start=0.0, points=240):
    """Return what ``beams.path_integrals`` returns, for the arm with corners; u = 1 - t is 0 at the hub and 1 at the tip."""
    x, w = beams.gauss(points)
    u, w = start + (1.0 - start) * x, (1.0 - start) * w
    p, d1, _ = square_points(1.0, 0.0, twist, np.zeros(1, dtype=complex), 1.0, 1.0 - u)
    speed = np.abs(d1)
    tangent, r, ds = -d1 / speed, 1.0 - p, w * speed
    tx, ty = tangent.real, tangent.imag
    bend, torque = r.real * tx + r.imag * ty, r.imag * tx - r.real * ty

    def products(*v):
        return [float(ds @ (v[i] * v[j])) for i in range(len(v)) for j in range(i + 1)]

    in_plane = products(-r.imag, r.real, np.ones_like(u)) + products(tx, ty) + products(-ty, tx)
    return np.array(in_plane + products(torque, tx, ty) + products(-bend, -ty, tx))


def main():
    """Make a saddle with arms of either curve, and write the sheets of the one with corners."""
    x, y = np.meshgrid(np.linspace(-0.06, 0.06, 7), np.linspace(-0.06, 0.06, 7), indexing="ij")
    number = np.arange(49).reshape(7, 7)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    saddle = api.QuadMesh(np.stack([x, y, 4.0 * (x**2 - y**2)], axis=-1).reshape(-1, 3), quads)
    print(f"spirals: {energy(api.simulate(api.load(saddle))):.4g} mJ")
    users = [patch.object(module, "curve_points", square_points) for module in (spiral, arm_curves, curving)]
    with users[0], users[1], users[2], patch.object(beams, "path_integrals", square_integrals):
        beams.integral_series.cache_clear()  # computed from the integrals once
        piece = api.simulate(api.load(saddle))
        api.export(piece, "square_spirals")
    beams.integral_series.cache_clear()
    print(f"square spirals: {energy(piece):.4g} mJ")


def energy(piece):
    """Elastic energy at rest, millijoules."""
    return 1e3 * api.report(piece)["equilibrium"]["energy"]


if __name__ == "__main__":
    main()
