"""The rim as part of an assembly: bodies (nodes) on the strip of the rim, and joints between these and with arms.

There is one node per arm at the border. A node is a rigid body like a hub, and has three arms. One is the neck, which
is straight and leads from the strip's inner edge to the tip of the arm at the border. The other two are halves of the
strip: from the node to the middle between it and the next node, and to the middle between it and the previous node. So
the strip is a chain of ordinary joints, each of two arms in series. An arm is a beam whose 6 x 6 compliance is the
integral along its centre line (Castigliano, with Timoshenko's shear), without the material of the holes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Columns, Complex, Float, Int
from ..spirals.rim import Rim
from .vectors import skew, to_space

# indices of a node's arms, counter-clockwise: half strip towards the next node, neck, half strip towards the previous
FORWARDS, NECK, BACKWARDS = 0, 1, 2
# number of pieces of half a strip between two nodes, so that every hole covers several; more are slower and more exact
# (relative error of the compliance 1e-4)
STRIP_PIECES = 200
NECK_PIECES = 24  # number of pieces of a neck; more are slower and more exact (relative error of the compliance 3e-4)
# Step, as a share of a neck's width, of the fourth-order finite differences that differentiate its compliance by the
# width; smaller: more rounding errors
NECK_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class RimBeams(Columns):
    """N arms of rim nodes, each divided into S straight pieces, in the flat frame.

    lever : vectors from the pieces' middles to the arm's tip, metres
    tangent : unit vectors along the pieces, towards the tip
    length, width : length and width of the pieces as if there were no holes, metres
    bore : part of the width that a hole takes away at the piece's middle, metres
    """

    lever: Float[np.ndarray, "n pieces 3"]
    tangent: Float[np.ndarray, "n pieces 3"]
    length: Float[np.ndarray, "n pieces"]
    width: Float[np.ndarray, "n pieces"]
    bore: Float[np.ndarray, "n pieces"]

    @classmethod
    def from_points(
        cls,
        place: np.ndarray,
        tangent: np.ndarray,
        tip: np.ndarray,
        length: np.ndarray,
        width: np.ndarray,
        bore: np.ndarray,
    ) -> RimBeams:
        """Build arms from complex positions in the flat plane.

        Parameters
        ----------
        place, tangent : (N, S) middles of the pieces (metres) and unit tangents towards the tip, complex
        tip : (N,) tips of the arms, complex, metres
        length, width, bore : as in ``RimBeams``
        """
        return cls(
            to_space(tip[:, None] - place), to_space(tangent), length, np.broadcast_to(width, length.shape), bore
        )


@dataclass(frozen=True, eq=False)
class RimJoints:
    """B nodes of a rim, their joints with the arms at the border (ties), and S joints between two nodes (strips).

    hub, side : (B,) quad and side of the arm at the border to which a node's neck leads
    lever, axes : (B, 2, 3) and (B, 2, 3, 3) of the ties, as in ``Assembly``; axis 1: hub, node
    pairs : (S, 2) indices of the two nodes that every strip joins
    strip_lever, strip_axes : (S, 2, 3) and (S, 2, 3, 3) of the strips, as in ``Assembly``; axis 1: the two nodes
    necks : the B necks, with the width 1 metre; their true width is that of the arm to which they lead
    strips : 2 S arms: first and second half of strip 0, first and second half of strip 1, and so on
    width : width of the strip beside a hole, metres
    """

    hub: Int[np.ndarray, " nodes"]
    side: Int[np.ndarray, " nodes"]
    lever: Float[np.ndarray, "nodes 2 3"]
    axes: Float[np.ndarray, "nodes 2 3 3"]
    pairs: Int[np.ndarray, "strips 2"]
    strip_lever: Float[np.ndarray, "strips 2 3"]
    strip_axes: Float[np.ndarray, "strips 2 3 3"]
    necks: RimBeams
    strips: RimBeams
    width: float

    @classmethod
    def from_rim(cls, rim: Rim, centre: Float[np.ndarray, "quads 2"]) -> RimJoints:
        """Build the joints of a rim.

        Parameters
        ----------
        rim : strip, necks and holes
        centre : (F, 2) centres of all flat quads, metres
        """
        hub = centre[rim.quad] @ np.array([1.0, 1j])
        lever = np.stack([rim.middle - hub, rim.middle - rim.centre], axis=1)
        first = np.flatnonzero(rim.next_node >= 0)
        then = rim.next_node[first]
        middle, across = rim.points_at(first, rim.reach[first, 0])
        ends = np.stack([middle - rim.centre[first], middle - rim.centre[then]], axis=1)
        return cls(
            rim.quad, rim.side, to_space(lever), _axes(rim.outwards), np.stack([first, then], axis=1), to_space(ends),
            _axes(across), _necks(rim), _strips(rim, first, middle), rim.width - rim.hole_diameter,
        )  # fmt: skip

    @property
    def offset(self) -> Float[np.ndarray, "nodes 3"]:
        """Vectors (B, 3) from the hubs to their nodes at rest, in the flat frame, metres."""
        return self.lever[:, 0] - self.lever[:, 1]

    def with_hubs_moved(self, shift: Float[np.ndarray, "quads 2"]) -> RimJoints:
        """Return the joints after all hubs were moved in the flat sheets, while the rim stays where it is.

        shift : (F, 2) by which the hubs were moved, metres
        """
        lever = self.lever.copy()
        lever[:, 0, :2] -= shift[self.hub]
        return replace(self, lever=lever)

    @property
    def without_strips(self) -> RimJoints:
        """A copy without the strips."""
        none = {name: getattr(self, name)[:0] for name in ("pairs", "strip_lever", "strip_axes")}
        return replace(self, **none, strips=self.strips.subset(np.arange(0)))

    def part(self, hubs: Int[np.ndarray, " some"]) -> RimJoints:
        """Return the nodes whose necks lead to some hubs, with their ties, and the strips between these nodes.

        hubs : indices of the hubs; in the result they have the indices 0, 1, ... in this order
        """
        number = np.full(max(int(self.hub.max(initial=-1)), int(np.max(hubs, initial=-1))) + 1, -1)
        number[hubs] = np.arange(len(hubs))
        kept, strips = self.indices_of_hubs(hubs)
        node = np.full(len(self.hub), -1)
        node[kept] = np.arange(len(kept))
        both = np.stack([2 * strips, 2 * strips + 1], axis=1).ravel()
        return replace(
            self, hub=number[self.hub[kept]], side=self.side[kept], lever=self.lever[kept], axes=self.axes[kept],
            pairs=node[self.pairs[strips]], strip_lever=self.strip_lever[strips], strip_axes=self.strip_axes[strips],
            necks=self.necks.subset(kept), strips=self.strips.subset(both),
        )  # fmt: skip

    def indices_of_hubs(self, hubs: np.ndarray) -> tuple[Int[np.ndarray, " nodes"], Int[np.ndarray, " strips"]]:
        """Return the indices of the nodes whose necks lead to some hubs, and of the strips between these nodes."""
        there = np.isin(self.hub, hubs)
        return np.flatnonzero(there), np.flatnonzero(there[self.pairs].all(axis=1))


def _necks(rim: Rim) -> RimBeams:
    """Return the necks of a rim, with the width 1 metre, in ``NECK_PIECES`` pieces each."""
    share = (np.arange(NECK_PIECES) + 0.5) / NECK_PIECES
    place = (rim.middle + rim.depth * rim.outwards)[:, None] - rim.depth * share * rim.outwards[:, None]
    way = np.broadcast_to(-rim.outwards[:, None], place.shape)
    length = np.full(place.shape, rim.depth / NECK_PIECES)
    return RimBeams.from_points(place, way, rim.middle, length, np.ones(1), np.zeros(place.shape))


def _strips(rim: Rim, first: np.ndarray, middle: Complex[np.ndarray, " strips"]) -> RimBeams:
    """Return both halves of every strip, each from its node to the strip's middle, in ``STRIP_PIECES`` pieces.

    first : (S,) index of the first node of every strip; middle : (S,) positions of the strips' middles, complex, metres
    """
    share, whole = (np.arange(STRIP_PIECES) + 0.5) / STRIP_PIECES, rim.length[first]
    half = rim.reach[first, 0]
    at = np.stack([half[:, None] * share, whole[:, None] - (whole - half)[:, None] * share], axis=1)
    place, way = rim.points_at(np.repeat(first, 2 * STRIP_PIECES), at.ravel())
    way = way.reshape(at.shape) * np.array([1.0, -1.0])[:, None]
    length = np.broadcast_to((np.stack([half, whole - half], axis=1) / STRIP_PIECES)[..., None], at.shape)
    count = np.maximum(rim.hole_count[first], 1)
    between = (whole / count)[:, None, None]
    # distance along the strip from the centre of the nearest hole
    apart = np.abs((at % between) - 0.5 * between)
    bore = (
        2.0
        * np.sqrt(np.maximum(0.25 * rim.hole_diameter**2 - apart**2, 0.0))
        * (rim.hole_count[first] > 0)[:, None, None]
    )
    flat = (-1, STRIP_PIECES)
    parts = place.reshape(flat), way.reshape(flat), np.repeat(middle, 2), length.reshape(flat)
    return RimBeams.from_points(*parts, np.full(1, rim.width), bore.reshape(flat))


def _axes(across: Complex[np.ndarray, " n"]) -> Float[np.ndarray, "n 2 3 3"]:
    """Return ``axes`` of ``Assembly`` for joints within one flat patch, where they are the same on both sides.

    across : (n,) unit vectors across the joints, complex
    """
    normal = np.broadcast_to([0.0, 0.0, 1.0], (len(across), 3))
    one = np.stack([to_space(across), to_space(1j * across), normal], axis=2)
    return np.stack([one, one], axis=1)


def rim_tip_compliance(bend: np.ndarray, slide: np.ndarray, lever: np.ndarray) -> Float[np.ndarray, "n 6 6"]:
    """Return the tip compliances (N, 6, 6) of arms: shift (3) and turn (3) of the tip per wrench at the tip.

    Parameters
    ----------
    bend, slide : (N, S, 3, 6) rotation vectors and elongations of the pieces per wrench at the tip
    lever : (N, S, 3) vectors from the pieces' middles to the tip, metres
    """
    shift = (slide - skew(lever) @ bend).sum(axis=1)
    return np.concatenate([shift, bend.sum(axis=1)], axis=1)
