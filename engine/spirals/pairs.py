"""Which arms could ever come near each other, whatever the design. Arm 4 f + k is arm k of quad f."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..arrays import Bool, Complex, Float, Int
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from .blends import leans
from .lines import Lines
from .spiral import mirrored, opposite_sides, spokes

# Kinds of pairs: of one quad; an arm and those beside it across its joint; others of quads that share an edge or a vertex
BESIDE, ACROSS, ROUND = range(3)
# The largest t that counts on the first and on the second arm of each kind: the slot beside an arm needs to be open over the
# outer third, see ``slots.DEPTH``; further in than 0.4, 0.9 and 0.8, arms of other quads were never nearest.
DEPTHS = np.array([[1.0 / 3.0, 1.0], [0.4, 0.9], [0.8, 0.8]])
# At which twists, as shares of the largest, arms are drawn to see how far they reach, on their own and on their mates' side. Those
# of smaller twists lie within what the most wound ones go round, but for their blends.
_OWN, _MATES = (0.0, 0.5, 1.0), (0.0, 1.0)
_REACHED = np.linspace(0.0, 0.9, 25)  # at which t
_WAYS = 32  # in how many directions
# radians from the way between two quads' centres at which lines between their arms are looked for
_TURNED = np.array([-0.7, -0.35, 0.0, 0.35, 0.7])
_SPARE = 0.1  # of an arm's radius, between what was drawn and what may be reached between it, or when flat points move


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
    """All arms of every quad with all of the quads that share an edge or a vertex with it, as far as nothing is cut, once each."""
    layout = flat.layout
    mate, side = opposite_sides(layout.mesh)
    joined, count = ~layout.outline_sides, len(mate)
    quad, corner = np.repeat(np.arange(count), 4), np.tile(np.arange(4), count)
    whole, at, to = np.ones(len(quad), dtype=bool), quad, corner
    found: list[np.ndarray] = []
    for _ in range(3):  # round the vertex
        whole = whole & joined[at, to]
        at, to = np.where(whole, mate[at, to], at), np.where(whole, (side[at, to] + 1) % 4, to)
        far = whole & (at != quad)
        found.append(np.stack([np.minimum(quad[far], at[far]), np.maximum(quad[far], at[far])], axis=1))
    quads = np.unique(np.concatenate(found), axis=0)
    k = np.stack(np.divmod(np.arange(16), 4), axis=1)
    both = (4 * quads[:, None] + k).reshape(-1, 2)
    # the two arms of a joint run into each other, and those beside it are pairs across a joint
    known = np.zeros(len(both), dtype=bool)
    for one, two in (both.T, both[:, ::-1].T):
        there = 4 * mate[one // 4, one % 4] + side[one // 4, one % 4]
        known |= (there // 4 == two // 4) & ((two - there) % 4 != 2)
    return both[~known, 0], both[~known, 1]


def _reach(flat: FlatPatches, params: SpiralParams, pairs: Pairs, near: float) -> Bool[np.ndarray, " n"]:
    """Whether two arms of a pair may come near: no line across the way between their quads lies between all that they may be."""
    centre, radius, _ = spokes(flat.corners)
    extents, c = _extents(flat, params), np.repeat(centre @ np.array([1.0, 1j]), 4)
    between = pairs.turn * c[pairs.two] + pairs.shift - c[pairs.one]
    spare = _SPARE * (radius.ravel()[pairs.one] + radius.ravel()[pairs.two]) + near + params.width_max
    out = np.ones(len(between), dtype=bool)
    for turned in np.exp(1j * _TURNED):
        way = turned * between / np.maximum(np.abs(between), 1e-12)
        far = (between * np.conj(way)).real
        for arm, there in ((pairs.one, way), (pairs.two, -way * np.conj(pairs.turn))):
            place = np.angle(there) / (2.0 * np.pi / _WAYS)
            before, after = (np.asarray(np.floor(place) + k, dtype=np.int64) % _WAYS for k in (0, 1))
            far -= np.maximum(extents[arm, before], extents[arm, after]) / np.cos(np.pi / _WAYS)
        out &= far < spare
    return out


def _extents(flat: FlatPatches, params: SpiralParams) -> Float[np.ndarray, "arms ways"]:
    """Metres: how far the centre lines of an arm reach from its quad's centre, whatever the design, along evenly spaced ways."""
    _, radius, angle = spokes(flat.corners)
    mate, side = opposite_sides(flat.layout.mesh)
    lean, sign = leans(flat.corners, angle), mirrored(flat.layout.mesh, params)
    width = np.full((radius.size, 2), params.width_max)
    both = np.stack([lean, sign * lean[mate, side]], axis=-1).reshape(-1, 2)
    t = np.broadcast_to(_REACHED, (radius.size, len(_REACHED)))
    i = np.broadcast_to(np.arange(radius.size)[:, None], t.shape)
    ways = np.exp(2j * np.pi / _WAYS * np.arange(_WAYS))
    out = np.full((radius.size, _WAYS), -np.inf)
    zero, wound = np.zeros(radius.size, dtype=complex), -1.0 if params.clockwise else 1.0
    for own, other in product(_OWN, _MATES):
        twist = wound * params.twist_max * np.stack([np.full(radius.size, own), other * sign.ravel()], axis=1)
        lines = Lines.of(zero, radius.ravel(), angle.ravel(), (width, twist, both), params.blend)
        points = lines.points(i, t)
        for k, way in enumerate(ways):
            out[:, k] = np.maximum(out[:, k], (points.real * way.real + points.imag * way.imag).max(axis=1))
    return out
