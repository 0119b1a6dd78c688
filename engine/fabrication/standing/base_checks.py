"""Refuse an impossible base before the simulation, by checking its supports on the target surface."""

from __future__ import annotations

import numpy as np

from ...errors import FlexMapsError
from ...params import BaseParams, SimulateParams, SpiralParams
from ...surface.mesh import QuadMesh
from .base import refuse_rim
from .feet import MAX_SIDEWAYS_ANGLE, MIN_SLOPE, quads_for_feet, refuse_flat, refuse_inside, refuse_sideways

# Angle in radians by which supports may violate a limit on the target without being refused here, because the simulated
# shape deviates from the target; chosen by eye as several times the deviation of optimised pieces
ANGLE_TOLERANCE = np.radians(10.0)


def check_clamping(base: BaseParams, simulate: SimulateParams) -> None:
    """Raise ``FlexMapsError`` if the base clamps the supports but the simulation hinges them, or the reverse.

    Parameters
    ----------
    base : kind of base
    simulate : whether supports are clamped
    """
    if base.stands and not simulate.clamped:
        raise FlexMapsError(
            "A base clamps the feet that stand in it, but the supports are simulated as hinges; clamp the supports, or "
            "choose no base"
        )
    if base.base == "eyelets" and simulate.clamped:
        raise FlexMapsError(
            "A piece may turn about the eyelets that it hangs by, but the supports are simulated as clamped; hinge the supports "
            "(switch Clamp supports off), or choose another base"
        )


def check_base_on_target(
    mesh: QuadMesh, supports: np.ndarray | None, base: BaseParams, simulate: SimulateParams, spiral: SpiralParams
) -> None:
    """Raise ``FlexMapsError`` if no shape close to the target could stand on or hang by these supports.

    Parameters
    ----------
    mesh : target, metres
    supports : supported quads
    base, simulate, spiral : settings of the base, of the supports and of the border
    """
    if base.base == "none":
        return
    if base.stands:
        refuse_rim(spiral)
    check_clamping(base, simulate)
    if supports is None or not len(supports):
        hangs = base.base == "eyelets"
        raise FlexMapsError(
            f"The base has no supports to hold; choose supports, such as the {'highest' if hangs else 'lowest'} "
            "spirals, or choose no base"
        )
    if base.stands:
        _check_feet(mesh, supports)


def _check_feet(mesh: QuadMesh, supports: np.ndarray) -> None:
    """Apply the checks of module ``feet`` to the target surface, with tolerance ``ANGLE_TOLERANCE`` on the angles."""
    refuse_inside(np.setdiff1d(supports, quads_for_feet(mesh, supports)))
    corners = mesh.vertices[mesh.quads[supports]]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    slope = np.linalg.norm(normal[:, :2], axis=1)
    refuse_flat(supports[slope < np.sin(MIN_SLOPE - ANGLE_TOLERANCE)])
    # in the plane of every quad: direction of steepest descent, and directions to the middles of its sides
    down = normal[:, 2:] * normal - np.array([0.0, 0.0, 1.0])
    down /= np.linalg.norm(down, axis=1)[:, None]
    sides = 0.5 * (corners + np.roll(corners, -1, axis=1)) - corners.mean(axis=1)[:, None]
    sides -= np.einsum("nki,ni->nk", sides, normal)[..., None] * normal[:, None]
    away = np.einsum("nki,ni->nk", sides, down) / np.maximum(np.linalg.norm(sides, axis=2), 1e-300)
    away[~mesh.border[mesh.quad_edges[supports]]] = -1.0
    refuse_sideways(supports[away.max(axis=1) < np.cos(MAX_SIDEWAYS_ANGLE + ANGLE_TOLERANCE)])
