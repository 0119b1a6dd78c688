"""The linear limit of a spiral: the compliance of one arm's tip against the hub, and the strain it costs.

The plane of the sheet is a mirror, so of the symmetric 6 x 6 compliance twelve numbers are left: one symmetric 3 x 3
block for motions in the plane, and one for motions out of it.
"""

from __future__ import annotations

import numpy as np

from ..engine.arrays import Float
from .statics import Model

IN_PLANE = (0, 1, 5)  # places of (Fx, Fy, Mz) in a wrench
OUT_OF_PLANE = (2, 3, 4)  # places of (Fz, Mx, My)
TIP = 1  # the tip whose compliance is asked for


def transport(offset: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "6 6"]:
    """Motion of a point at ``offset`` from the one whose motion (shift, turn) is multiplied."""
    x, y, z = offset
    out = np.eye(6)
    out[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return out


def turned(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "6 6"]:
    """Components of motions or wrenches along the in-plane unit ``axis``, its left, and the normal."""
    c, s = axis[:2]
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.kron(np.eye(2), turn)


def unit_motions(model: Model) -> Float[np.ndarray, "nodes 3 6"]:
    """Displacements under the six unit wrenches at tip 1, balanced by the hub.

    The wrenches act along the radius to the tip, to the left of it in the plane, and along the normal.
    """
    tip, hub = model.tips[TIP], model.hub
    offset = tip.centre - hub.centre
    wrenches = turned(offset / np.linalg.norm(offset)).T
    nodal = np.zeros((len(model.solid.nodes), 3, 6))
    nodal[tip.nodes] += tip.spread @ wrenches
    nodal[hub.nodes] -= hub.spread @ (transport(offset).T @ wrenches)
    model.cholesky.factor(model.rest_stiffness())
    return model.expand(model.cholesky.solve(model.reduce(nodal)))


def tip_compliance(model: Model, motions: Float[np.ndarray, "nodes 3 6"]) -> Float[np.ndarray, "6 6"]:
    """Motion of the tip relative to the hub per unit wrench, axes as in ``unit_motions``.

    Dimensionless: lengths in arm widths, forces in Young's modulus times squared arm width.
    """
    tip, hub = model.tips[TIP], model.hub
    offset = tip.centre - hub.centre
    of_tip = np.einsum("gij,gik->jk", tip.spread, motions[tip.nodes])
    of_hub = np.einsum("gij,gik->jk", hub.spread, motions[hub.nodes])
    found = turned(offset / np.linalg.norm(offset)) @ (of_tip - transport(offset) @ of_hub)
    return 0.5 * (found + found.T)
