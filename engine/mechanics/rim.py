"""The rim as a part of an assembly: one body more for every arm at the border, and joints to it and between those bodies.

A node of the strip is a rigid body like a hub. One of its arms is the neck, straight from the strip's inner edge to the arm's tip at
the border; the two beside it are the halves of the strip to the following node and to the one before, from the node's centre to
the middle between both. So the strip is a chain of joints like all others: two arms in series, each of which is a beam
whose 6 x 6 compliance is the integral along its middle line (Castigliano, with Timoshenko's shear), its holes taken away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Complex, Float, Int
from ..spirals.rim import Rim
from .vectors import skew

FORWARDS, NECK, BACKWARDS = 0, 1, 2  # arms of a node, counter-clockwise
# pieces of a half of the strip, so that every hole is some pieces long: the compliance is within 1e-4 of that of 2000
PIECES = 200
NECK_PIECES = 24  # of a neck: within 3e-4 of its closed form
STEP = 1e-3  # of the differences of fourth order by a neck's width, as a share of it: within 1e-11 of the closed form


@dataclass(frozen=True, eq=False)
class Beams:
    """Arms of N nodes as lines of S pieces, in the flat frame.

    lever : metres, from every piece to the arm's tip; tangent : unit, outwards; length : metres, of every piece
    width : metres, of the strip; bore : metres, what a hole takes away from it
    """

    lever: Float[np.ndarray, "n pieces 3"]
    tangent: Float[np.ndarray, "n pieces 3"]
    length: Float[np.ndarray, "n pieces"]
    width: Float[np.ndarray, "n pieces"]
    bore: Float[np.ndarray, "n pieces"]

    @classmethod
    def of(
        cls,
        place: np.ndarray,
        way: np.ndarray,
        tip: np.ndarray,
        length: np.ndarray,
        width: np.ndarray,
        bore: np.ndarray,
    ) -> Beams:
        """From complex places and directions (N, S) of the pieces and tips (N,)."""
        return cls(_flat(tip[:, None] - place), _flat(way), length, np.broadcast_to(width, length.shape), bore)

    def part(self, some: np.ndarray) -> Beams:
        return Beams(*(getattr(self, name)[some] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class RimJoints:
    """B nodes, their joints to the arms at the border (ties) and the S joints between them (strips).

    hub, side : (B,) int, the arm of every node
    lever : (B, 2, 3) metres, from the hub and from the node to the tip; axes : (B, 2, 3, 3), as in ``Assembly``
    pairs : (S, 2) int, nodes; strip_lever : (S, 2, 3); strip_axes : (S, 2, 3, 3)
    necks : (B,), for arms as wide as 1; strips : (2 S,), both halves of every strip in turn
    width : metres, of the strip beside its holes
    """

    hub: Int[np.ndarray, " nodes"]
    side: Int[np.ndarray, " nodes"]
    lever: Float[np.ndarray, "nodes 2 3"]
    axes: Float[np.ndarray, "nodes 2 3 3"]
    pairs: Int[np.ndarray, "strips 2"]
    strip_lever: Float[np.ndarray, "strips 2 3"]
    strip_axes: Float[np.ndarray, "strips 2 3 3"]
    necks: Beams
    strips: Beams
    width: float

    @classmethod
    def of(cls, rim: Rim, centre: Float[np.ndarray, "quads 2"]) -> RimJoints:
        """Of a rim; centre : metres, of all quads."""
        hub = centre[rim.quad] @ np.array([1.0, 1j])
        lever = np.stack([rim.middle - hub, rim.middle - rim.centre], axis=1)
        first = np.flatnonzero(rim.following >= 0)
        then = rim.following[first]
        middle, across = rim.place(first, rim.reach[first, 0])
        ends = np.stack([middle - rim.centre[first], middle - rim.centre[then]], axis=1)
        return cls(
            rim.quad, rim.side, _flat(lever), _axes(rim.out), np.stack([first, then], axis=1), _flat(ends), _axes(across),
            _necks(rim), _strips(rim, first, middle), rim.width - rim.hole,
        )  # fmt: skip

    @property
    def offset(self) -> Float[np.ndarray, "nodes 3"]:
        """Metres, from the hubs to their nodes at rest, in the flat frame."""
        return self.lever[:, 0] - self.lever[:, 1]

    def recentred(self, shift: Float[np.ndarray, "quads 2"]) -> RimJoints:
        """Return the joints of hubs that lie elsewhere in the flat sheets by ``shift`` (metres), while the rim stays."""
        lever = self.lever.copy()
        lever[:, 0, :2] -= shift[self.hub]
        return replace(self, lever=lever)

    @property
    def without_strips(self) -> RimJoints:
        """The ties alone."""
        none = {name: getattr(self, name)[:0] for name in ("pairs", "strip_lever", "strip_axes")}
        return replace(self, **none, strips=self.strips.part(np.arange(0)))

    def part(self, hubs: Int[np.ndarray, " some"]) -> RimJoints:
        """The nodes of some hubs, numbered anew in this order, and the strips between them."""
        number = np.full(max(int(self.hub.max(initial=-1)), int(np.max(hubs, initial=-1))) + 1, -1)
        number[hubs] = np.arange(len(hubs))
        kept, strips = self.kept(hubs)
        node = np.full(len(self.hub), -1)
        node[kept] = np.arange(len(kept))
        both = np.stack([2 * strips, 2 * strips + 1], axis=1).ravel()
        return replace(
            self, hub=number[self.hub[kept]], side=self.side[kept], lever=self.lever[kept], axes=self.axes[kept],
            pairs=node[self.pairs[strips]], strip_lever=self.strip_lever[strips], strip_axes=self.strip_axes[strips],
            necks=self.necks.part(kept), strips=self.strips.part(both),
        )  # fmt: skip

    def kept(self, hubs: np.ndarray) -> tuple[Int[np.ndarray, " nodes"], Int[np.ndarray, " strips"]]:
        """The nodes, and the strips, that some hubs have."""
        there = np.isin(self.hub, hubs)
        return np.flatnonzero(there), np.flatnonzero(there[self.pairs].all(axis=1))


def _necks(rim: Rim) -> Beams:
    share = (np.arange(NECK_PIECES) + 0.5) / NECK_PIECES
    place = (rim.middle + rim.depth * rim.out)[:, None] - rim.depth * share * rim.out[:, None]
    way = np.broadcast_to(-rim.out[:, None], place.shape)
    length = np.full(place.shape, rim.depth / NECK_PIECES)
    return Beams.of(place, way, rim.middle, length, np.ones(1), np.zeros(place.shape))


def _strips(rim: Rim, first: np.ndarray, middle: Complex[np.ndarray, " strips"]) -> Beams:
    """Both halves of every strip, from its nodes to its middle."""
    share, whole = (np.arange(PIECES) + 0.5) / PIECES, rim.length[first]
    half = rim.reach[first, 0]
    at = np.stack([half[:, None] * share, whole[:, None] - (whole - half)[:, None] * share], axis=1)
    place, way = rim.place(np.repeat(first, 2 * PIECES), at.ravel())
    way = way.reshape(at.shape) * np.array([1.0, -1.0])[:, None]
    length = np.broadcast_to((np.stack([half, whole - half], axis=1) / PIECES)[..., None], at.shape)
    count = np.maximum(rim.holes[first], 1)
    between = (whole / count)[:, None, None]
    # from the nearest hole, along the strip
    apart = np.abs((at % between) - 0.5 * between)
    bore = 2.0 * np.sqrt(np.maximum(0.25 * rim.hole**2 - apart**2, 0.0)) * (rim.holes[first] > 0)[:, None, None]
    flat = (-1, PIECES)
    parts = place.reshape(flat), way.reshape(flat), np.repeat(middle, 2), length.reshape(flat)
    return Beams.of(*parts, np.full(1, rim.width), bore.reshape(flat))


def _flat(numbers: np.ndarray) -> Float[np.ndarray, "*n 3"]:
    return np.stack([numbers.real, numbers.imag, np.zeros(numbers.shape)], axis=-1)


def _axes(across: Complex[np.ndarray, " n"]) -> Float[np.ndarray, "n 2 3 3"]:
    """As in ``Assembly``: across, along and normal, the same for both sides, which lie in one patch."""
    normal = np.broadcast_to([0.0, 0.0, 1.0], (len(across), 3))
    one = np.stack([_flat(across), _flat(1j * across), normal], axis=2)
    return np.stack([one, one], axis=1)


def tip_compliance(bend: np.ndarray, slide: np.ndarray, lever: np.ndarray) -> Float[np.ndarray, "n 6 6"]:
    """What the tip of N arms moves and turns per wrench there, from the bends and stretches (N, S, 3, 6) of their pieces."""
    shift = (slide - skew(lever) @ bend).sum(axis=1)
    return np.concatenate([shift, bend.sum(axis=1)], axis=1)
