"""How arms end that are not cut in full length: left out at an open border, down to a round end on their hub.

The hub keeps the corners that its other arms have for a root, so that they are as stiff as beside a whole arm: an arm
at the border carries nothing, for it has no joint. The round end lies within the arm that would be there, so that it is nowhere
nearer to another arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Bool, Float
from ..params import SpiralParams
from ..surface.mesh import QuadMesh
from .arcs import Curve
from .contours import Hubs
from .spiral import LEFT, RIGHT, Arms, edge

# Share of the way from an arm's middle of the side to its hub at which a left out arm ends: a fifth of a millimetre of 10 remains,
# so that there is an edge on both of its sides
STUMP = 0.98
DRAWN = 2e-6  # metres: how far a cap's polygon may stray from its arcs


@dataclass(frozen=True, eq=False)
class Cap:
    """What an arm ends in that has no joint and is not cut plainly.

    arm : 4 quad + side; patch : its patch; over : t where the arm begins
    across : the curve from the right to the left edge there, in the patch's frame, metres
    """

    arm: int
    patch: int
    over: float
    across: Curve

    @cached_property
    def polygon(self) -> Any:
        """Shapely's, in the patch's frame."""
        import shapely

        return shapely.Polygon(self.across.sampled(DRAWN))


def left_out(mesh: QuadMesh, params: SpiralParams) -> Bool[np.ndarray, "quads 4"]:
    """Which arms are not cut: those at an open border, if the settings say so."""
    return mesh.border[mesh.quad_edges] & (params.border == "left_out")


def stumps(root: Hubs) -> Float[np.ndarray, "quads 4"]:
    """The t where arms begin if they are left out."""
    return STUMP * np.minimum(root.left, np.roll(root.right, 1, axis=1))


def caps(
    arms: Arms, begin: Float[np.ndarray, "quads 4"], absent: Bool[np.ndarray, "quads 4"], patch_of: np.ndarray
) -> tuple[Cap, ...]:
    """Half a circle over the end of every arm that is left out."""
    quad, side = np.nonzero(absent)
    some, t = arms.one_by_one(quad, side), begin[quad, side][:, None, None]
    right, left = (edge(some, t, way)[0][:, 0, 0] for way in (RIGHT, LEFT))
    return tuple(
        Cap(4 * f + k, int(patch_of[f]), float(begin[f, k]), Curve(np.stack(both), np.array([1.0, 0.0]), closed=False))
        for f, k, *both in zip(quad.tolist(), side.tolist(), right, left, strict=True)
    )
