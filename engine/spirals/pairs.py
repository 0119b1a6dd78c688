"""Which arms could ever come near each other, whatever the design. Arm 4 f + k is arm k of quad f."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bool, Complex, Int
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from .blends import leans
from .lines import Lines
from .spiral import opposite_sides, spokes

# Kinds of pairs: of one quad; across a joint; of quads that share no more than a vertex
BESIDE, ACROSS, ROUND = range(3)
# The largest t that counts on the first and on the second arm of each kind: the slot beside an arm needs to be open over the
# outer third, see ``slots.DEPTH``; further in than 0.4, 0.9 and 0.6, arms of other quads were never nearest.
DEPTHS = np.array([[1.0 / 3.0, 1.0], [0.4, 0.9], [0.6, 0.6]])
# at which twists, as shares of the largest, arms are drawn to see how far they reach, on their own and on their mates' side
_OWN, _MATES = np.linspace(0.0, 1.0, 9), np.array([0.0, 1.0])
_REACHED = np.linspace(0.0, 0.9, 13)  # at which t
_SPARE = 0.1  # of an arm's radius, between what was drawn and what may be reached between it


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of arms ``one`` and ``two``, of a kind each.

    turn, shift : where a point q (metres, complex) of the second arm lies in the frame of the first, turn q + shift
    laid : laid beside each other at a cut, so that turn and shift hang on the flat corners
    """

    one: Int[np.ndarray, " n"]
    two: Int[np.ndarray, " n"]
    kind: Int[np.ndarray, " n"]
    turn: Complex[np.ndarray, " n"]
    shift: Complex[np.ndarray, " n"]
    laid: Bool[np.ndarray, " n"]

    def of(self, some: np.ndarray) -> Pairs:
        """Some of the pairs."""
        return Pairs(*(getattr(self, name)[some] for name in self.__dataclass_fields__))

    def moved(self, flat: FlatPatches) -> Pairs:
        """The same pairs where the flat points have moved."""
        mate, side = opposite_sides(flat.layout.mesh)
        turn, shift = _laid(flat, self.one, (4 * mate + side).ravel()[self.one])
        return replace(self, turn=np.where(self.laid, turn, 1.0), shift=np.where(self.laid, shift, 0.0))


def pairs_of(flat: FlatPatches, params: SpiralParams, near: float) -> Pairs:
    """All pairs of arms that some design may bring nearer than ``near`` metres."""
    layout = flat.layout
    mate, side = opposite_sides(layout.mesh)
    count = len(mate)
    arm = np.arange(4 * count).reshape(count, 4)
    beyond = 4 * mate + side
    facing = arm[:, (np.arange(4) + (1 if params.clockwise else -1)) % 4]
    # across joints, and across cuts as if the quads lay side by side
    inner = beyond != arm
    own = np.repeat(arm[inner], 2)
    there = np.repeat(beyond[inner], 2)
    other = 4 * (there // 4) + (there + np.tile([1, 3], len(own) // 2)) % 4
    cut = np.repeat(layout.outline_sides[inner], 2)
    turn, shift = _laid(flat, own, there)
    turn, shift = np.where(cut, turn, 1.0), np.where(cut, shift, 0.0)
    # and as they lie at cuts inside a patch
    inside = cut & (layout.patch_of[own // 4] == layout.patch_of[other // 4])
    first, second = _round(flat)
    whole = np.ones(4 * count, dtype=complex), np.zeros(4 * count, dtype=complex), np.zeros(4 * count, dtype=bool)
    found = [
        (arm.ravel(), facing.ravel(), BESIDE, *whole),
        (own, other, ACROSS, turn, shift, cut),
        (own[inside], other[inside], ACROSS, 1.0, 0.0, False),
        (first, second, ROUND, 1.0, 0.0, False),
    ]
    types = np.int64, np.int64, np.int64, complex, complex, bool
    columns = [
        np.concatenate([np.broadcast_to(np.asarray(row[c], dtype=types[c]), len(row[0])) for row in found])
        for c in range(6)
    ]
    pairs = Pairs(*columns)
    return pairs.of((pairs.kind == BESIDE) | _reach(flat, params, pairs, near))


def _laid(flat: FlatPatches, own: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn and shift that lay the sides ``there`` upon the sides ``own``, the other way round."""
    z = flat.corners @ [1.0, 1j]
    ends = [(z[a // 4, a % 4], z[a // 4, (a + 1) % 4]) for a in (own, there)]
    (a, b), (c, d) = ends
    turn = -(b - a) / (d - c)
    turn /= np.abs(turn)
    return turn, 0.5 * (a + b) - turn * 0.5 * (c + d)


def _round(flat: FlatPatches) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """The two arms at every corner of every quad with the two at that vertex of the quads opposite, once each."""
    layout = flat.layout
    mate, side = opposite_sides(layout.mesh)
    joined, count = ~layout.outline_sides, len(mate)
    quad, corner = np.repeat(np.arange(count), 4), np.tile(np.arange(4), count)
    whole, at, to = np.ones(len(quad), dtype=bool), quad, corner
    found: list[np.ndarray] = []
    for step in range(1, 4):  # round the vertex, as far as nothing is cut
        whole = whole & joined[at, to]
        at, to = np.where(whole, mate[at, to], at), np.where(whole, (side[at, to] + 1) % 4, to)
        # the next quad is no concern of this, nor is the last one before the circle closes
        far = np.flatnonzero(whole & (step > 1) & (mate[at, to] != quad) & (at != quad))
        for k in (-1, 0):
            for j in (-1, 0):
                one, two = 4 * quad[far] + (corner[far] + k) % 4, 4 * at[far] + (to[far] + j) % 4
                found.append(np.stack([np.minimum(one, two), np.maximum(one, two)], axis=1))
    both = np.unique(np.concatenate(found), axis=0)
    return both[:, 0], both[:, 1]


def _reach(flat: FlatPatches, params: SpiralParams, pairs: Pairs, near: float) -> Bool[np.ndarray, " n"]:
    """Whether two arms of a pair may come near: no line at right angles to that between their quads lies between all that they
    may be."""
    centre, radius, angle = spokes(flat.corners)
    mate, side = opposite_sides(flat.layout.mesh)
    lean = leans(flat.corners, angle)
    sign = -1.0 if params.clockwise else 1.0
    width = np.full((radius.size, 2), params.width_max)
    both = np.stack([lean, lean[mate, side]], axis=-1).reshape(-1, 2)
    c = np.repeat(centre @ [1.0, 1j], 4)
    i = np.broadcast_to(np.arange(radius.size)[:, None], (radius.size, len(_REACHED)))
    t = np.broadcast_to(_REACHED, i.shape)
    turn = np.stack([np.ones(len(pairs.one)), pairs.turn])
    place = np.stack([c[pairs.one], pairs.turn * c[pairs.two] + pairs.shift])
    # for arms round a joint the way across its edge tells more than that between the centres
    way = place[1] - place[0]
    way /= np.maximum(np.abs(way), 1e-12)
    across = np.exp(1j * (angle - lean)).ravel()[pairs.one]
    ways = np.stack([way, np.where(pairs.kind == ACROSS, across, way)])
    reach = np.full((2, 2, len(way)), -np.inf)
    within = [t[0] <= DEPTHS[pairs.kind, k][:, None] + 1e-9 for k in range(2)]
    for own in _OWN:
        for other in _MATES:
            twist = sign * params.twist_max * np.broadcast_to([own, other], width.shape)
            lines = Lines.of(c, radius.ravel(), angle.ravel(), (width, twist, both), params.blend)
            points = lines.at(i, t)[0]
            for k, arm in enumerate((pairs.one, pairs.two)):
                seen = turn[k][:, None] * (points[arm] - c[arm][:, None]) + place[k][:, None]
                for w in range(2):
                    far = (seen * np.conj((1 - 2 * k) * ways[w])[:, None]).real
                    reach[w, k] = np.maximum(reach[w, k], np.where(within[k], far, -np.inf).max(axis=1))
    spare = _SPARE * (radius.ravel()[pairs.one] + radius.ravel()[pairs.two]) + near + params.width_max
    # what lies between the farthest that either arm reaches towards the other
    return (-reach.sum(axis=1) < spare).all(axis=0)
