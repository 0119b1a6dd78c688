"""What of a base can be refused before anything is simulated: its supports, seen on the surface that the piece is to take."""

from __future__ import annotations

import numpy as np

from ...errors import FlexMapsError
from ...params import BaseParams, SimulateParams, SpiralParams
from ...surface.mesh import QuadMesh
from .base import refuse_rim
from .feet import FLATTEST, SIDEWAYS, footed, refuse_flat, refuse_inside, refuse_sideways

# Radians by which a simulated piece may stand otherwise than its surface: what is nearer to a limit is judged once it is simulated.
# By eye, several times what optimised pieces are off
SLACK = np.radians(10.0)


def check_hold(base: BaseParams, simulate: SimulateParams) -> None:
    """Raise ``FlexMapsError`` where supports are simulated otherwise than the base holds them."""
    if base.stands and not simulate.clamped:
        raise FlexMapsError(
            "A base clamps the feet that stand in it, but the supports are simulated as hinges; clamp the supports, or "
            "choose no base"
        )
    if base.base == "eyelets" and simulate.clamped:
        raise FlexMapsError(
            "A piece may turn about the eyelets that it hangs by, but the supports are simulated as clamped; hinge the supports "
            "(simulate.clamped off), or choose another base"
        )


def check_early(
    mesh: QuadMesh, supports: np.ndarray | None, base: BaseParams, simulate: SimulateParams, spiral: SpiralParams
) -> None:
    """Raise ``FlexMapsError`` where no shape near to the mesh, metres, could stand or hang by these supports."""
    if base.base == "none":
        return
    if base.stands:
        refuse_rim(spiral)
    check_hold(base, simulate)
    if supports is None or not len(supports):
        hangs = base.base == "eyelets"
        raise FlexMapsError(
            f"A base holds what is supported, and nothing is; name supports, such as the {'highest' if hangs else 'lowest'} "
            "spirals, or choose no base"
        )
    if base.stands:
        _check_feet(mesh, supports)


def _check_feet(mesh: QuadMesh, supports: np.ndarray) -> None:
    """As ``feet`` checks a simulated pose, with some slack."""
    refuse_inside(np.setdiff1d(supports, footed(mesh, supports)))
    corners = mesh.vertices[mesh.quads[supports]]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    slope = np.linalg.norm(normal[:, :2], axis=1)
    refuse_flat(supports[slope < np.sin(FLATTEST - SLACK)])
    # down the slope, and to the middles of the sides, both in the plane of the quad
    down = normal[:, 2:] * normal - np.array([0.0, 0.0, 1.0])
    down /= np.linalg.norm(down, axis=1)[:, None]
    sides = 0.5 * (corners + np.roll(corners, -1, axis=1)) - corners.mean(axis=1)[:, None]
    sides -= np.einsum("nki,ni->nk", sides, normal)[..., None] * normal[:, None]
    away = np.einsum("nki,ni->nk", sides, down) / np.maximum(np.linalg.norm(sides, axis=2), 1e-300)
    away[~mesh.border[mesh.quad_edges[supports]]] = -1.0
    refuse_sideways(supports[away.max(axis=1) < np.cos(SIDEWAYS + SLACK)])
