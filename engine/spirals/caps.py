"""Caps: the ends of arms that are left out at an open border, and of arms that end in a foot.

An arm at the border has no joint and carries nothing. If it is left out, a stump with a round end remains on the hub.
The hub keeps its corners beside the stump, so that the other arms are as stiff as beside a whole arm. The stump lies
within the outline of the whole arm, so that no clearance becomes smaller.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Bool, Float
from ..params import SpiralParams
from ..surface.mesh import QuadMesh
from .curves.arcs import Curve
from .curves.spiral import LEFT, RIGHT, Arms, edge_points
from .roots import SlotRoots

# Start of a left-out arm's stump, as a share of the arm parameter t at which the slots beside the arm end. Larger
# values shorten the stump: 0.98 leaves 0.2 mm of a 10 mm arm; at 1 the stump has no edges.
STUMP_START = 0.98
POLYGON_TOLERANCE = 2e-6  # largest deviation of a cap's polygon from its arcs, metres; larger is faster and less exact


@dataclass(frozen=True, eq=False)
class Cap:
    """End of an arm without a joint: a round end or a foot.

    arm : number of the arm, 4 quad + side
    patch : index of its patch
    inner_end : arm parameter t (0 at the joint, 1 at the quad's centre) where the cap ends and the plain arm begins
    end_curve : curve of the cap, from the arm's right to its left edge at ``inner_end``, in the patch's frame, metres
    """

    arm: int
    patch: int
    inner_end: float
    end_curve: Curve

    @cached_property
    def polygon(self) -> Any:
        """The cap as a shapely polygon, in the patch's frame, metres."""
        import shapely

        return shapely.Polygon(self.end_curve.sample(POLYGON_TOLERANCE))


def left_out_arms(mesh: QuadMesh, params: SpiralParams) -> Bool[np.ndarray, "quads 4"]:
    """Return a mask of the arms that are left out: arms at an open border, if ``params.border`` is "left_out"."""
    return mesh.border[mesh.quad_edges] & (params.border == "left_out")


def stump_starts(root: SlotRoots) -> Float[np.ndarray, "quads 4"]:
    """Return the arm parameter t at which the stump of each arm would begin if the arm were left out, (F, 4)."""
    return STUMP_START * np.minimum(root.left, np.roll(root.right, 1, axis=1))


def make_caps(
    arms: Arms, begin: Float[np.ndarray, "quads 4"], absent: Bool[np.ndarray, "quads 4"], patch_of: np.ndarray
) -> tuple[Cap, ...]:
    """Return a cap for every arm that is left out: a half circle over the end of its stump.

    Parameters
    ----------
    arms : arms of all quads
    begin : (F, 4) arm parameter t where every arm begins
    absent : (F, 4) mask of the arms that are left out
    patch_of : (F,) patch of every quad
    """
    quad, side = np.nonzero(absent)
    some, t = arms.one_by_one(quad, side), begin[quad, side][:, None, None]
    right, left = (edge_points(some, t, way)[0][:, 0, 0] for way in (RIGHT, LEFT))
    return tuple(
        Cap(4 * f + k, int(patch_of[f]), float(begin[f, k]), Curve(np.stack(both), np.array([1.0, 0.0]), closed=False))
        for f, k, *both in zip(quad.tolist(), side.tolist(), right, left, strict=True)
    )
