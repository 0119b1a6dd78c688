"""Room for the cutter as smooth functions of the design: how far every gap is open, with exact derivatives.

Gaps are those between neighbouring arms of a quad over their outer part, between an arm and those beside its joint in the next
quad, and between arms of quads that meet at no more than a vertex. To them comes the inner edge of every blended end, which must not
fold. All are counted as rooms: 0 where there is just as much as needed, 1 where there is twice as much. Where an arm is wound nearly as
far as the stiffness table goes, so is what it has left, in radians: so the model knows every design that has room.

    room = Room.of(flat, params)                      # once per flat patches; ``moved`` where their points move
    terms = room.terms(width, twist)                  # rooms below SUPPORT with their Jacobian by widths and twists
    value, by_width, by_twist, hessian = room.barrier(width, twist)
    room.closed(trial_width, trial_twist, quads)      # whose steps must be shorter
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Bool, Float, Int
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from .blends import MATE_WIDTH, MATE_WIND, OWN_WIDTH, OWN_WIND, RADIUS
from .gaps import gap_slopes, narrow, sharp, sharp_slopes
from .known import spare_twist
from .lines import COUNT, Lines
from .pairs import BESIDE, ROUND, Pairs, pairs_of
from .shapes import Shapes
from .slots import slot_needed, width_range
from .spiral import alike

# Rooms from which on the barrier is felt, unless said otherwise
SUPPORT = 0.5
# How many times the smallest slot is asked for, since gaps are measured at some points of the arms only
_MORE = 1.015
_THIN = 0.95  # share of the room of the thinnest straight arms that is needed where it is less than it should be
# Arms whose radius is smaller than so many slots at seams count as short. Of 2,586 joints in optimised, random and soft designs
# of twelve surfaces, 106 of the 231 with less than 6 mm had no room for a dovetail, and 18 of all others; with slots of 1.2 mm
# across these joints, 24 in all, and beside the arms in their own quads too, none of 166 in four optimised designs that had 35.
# Asked for at every seam, it cost a third of the match of a surface with three holes, in vain.
_SHORT = 6.0
# Share of the room of the thinnest straight arms that the slot at seams may take at most, so that small quads can still be
# wound: at 12 mm, for which the usual connectors are too large, twists are 4 % smaller with it
_AT_SEAMS = 0.5
_SHARPEST = 0.25  # least share of its radius of curvature that an arm's inner edge keeps in a blend


@dataclass(frozen=True, eq=False)
class Terms:
    """The rooms of a design that are less than was asked for.

    value : (K,) rooms
    by_design : (K, 5 F) derivatives by the widths (metres, four a quad in a row) and then by the twists (radians)
    by_flat : (K, 2 V) derivatives by the flat points (metres, x and y of each in turn), if asked for
    arms : (K, 4) the arms on whose widths and twists a room hangs: both, and their mates
    """

    value: Float[np.ndarray, " k"]
    by_design: csr_array
    by_flat: csr_array | None
    arms: Int[np.ndarray, "k 4"]


@dataclass(frozen=True, eq=False)
class Barrier:
    """What the rooms of a design weigh: sum of -(v - D)^2 ln(v / D) over all rooms v < D (incremental potential contact).

    value : infinite where a room is closed
    by_design : (5 F,) its gradient, ordered as in ``Terms``; by_flat : (2 V,) likewise
    root : (K, 5 F) with root^T root the Gauss-Newton part of its Hessian; root_by_flat : (K, 2 V) likewise
    """

    value: float
    by_design: Float[np.ndarray, " designs"]
    by_flat: Float[np.ndarray, " coordinates"] | None
    root: csr_array
    root_by_flat: csr_array | None


@dataclass(frozen=True, eq=False)
class Room:
    """The gaps of all designs in the same flat patches with the same settings.

    pairs : arms that some design brings near each other
    need : metres, the least gap of each pair
    sharpest : of every arm, the least share of its radius of curvature that its inner edge keeps in its blend
    joined : whether every arm meets another one, so that the elastic model has to know it; nowhere to bound by room alone
    """

    params: SpiralParams
    pairs: Pairs
    shapes: Shapes
    need: Float[np.ndarray, " pairs"]
    sharpest: Float[np.ndarray, " arms"]
    joined: Bool[np.ndarray, " arms"]

    @classmethod
    @lru_cache(maxsize=2)  # the starts of a search, and its stages, ask for those of the same patches again and again
    def of(cls, flat: FlatPatches, params: SpiralParams) -> Room:
        """Looks once which arms could come near each other, whatever the design.

        Where the thinnest straight arms have less room than needed, in quads that are too small or too thin, that is what
        other designs need there; where even those touch, nothing is asked for. Beside short arms that meet across a cut, the
        slot at seams is asked for, but no more than half of what those straight arms leave.
        Raises ``FlexMapsError`` with the faces that are far too small for the smallest width.
        """
        slot, shapes = _MORE * slot_needed(params), Shapes.of(flat, params)
        wide = max(slot, _MORE * params.slot_seam)
        pairs = pairs_of(flat, params, wide + SUPPORT * slot)
        arms = len(shapes.mate)
        short = np.minimum(shapes.radius, shapes.radius[shapes.mate]) < _SHORT * params.slot_seam
        seam = (pairs.kind != ROUND) & (short & flat.layout.cut[flat.layout.mesh.quad_edges].ravel())[pairs.one]
        mesh = flat.layout.mesh
        joined = ~mesh.border[mesh.quad_edges].ravel()
        room = cls(params, pairs, shapes, np.where(seam, wide, slot), np.full(arms, _SHARPEST), joined)
        lines, need = room._lines(alike(width_range(flat, params)[0]), np.zeros(arms // 4)), room.need.copy()
        thin = narrow(lines, pairs, np.where(seam, need / _AT_SEAMS, need), params.clockwise)
        least = _THIN * thin.gap
        least = np.where(seam[thin.pair], np.maximum(_AT_SEAMS * thin.gap, np.minimum(least, slot)), least)
        np.minimum.at(need, thin.pair, least)
        arm, _, left = sharp(lines, np.arange(arms), room.sharpest)
        np.minimum.at(room.sharpest, arm, left - (1.0 - _THIN) * np.abs(left))
        some = need > 0.0
        return replace(room, pairs=pairs.of(some), need=need[some])

    def moved(self, flat: FlatPatches) -> Room:
        """The same where the flat points have moved a little; which arms could come near is not looked for again."""
        return replace(self, pairs=self.pairs.moved(flat), shapes=Shapes.of(flat, self.params))

    @property
    def by_gaps(self) -> Room:
        """The same without what the elastic model asks for."""
        return replace(self, joined=np.zeros_like(self.joined))

    @property
    def slot(self) -> float:
        """Metres that a room of 1 is wider than one of 0: the smallest slot, or a tenth of the thinnest arm if there is none."""
        return max(slot_needed(self.params), 0.1 * self.params.width_min)

    def terms(
        self,
        width: Float[np.ndarray, "quads 4"],
        twist: Float[np.ndarray, " quads"],
        *,
        below: float = SUPPORT,
        flat: bool = False,
        quads: Bool[np.ndarray, " quads"] | None = None,
        least: bool = False,
    ) -> Terms:
        """All rooms less than ``below`` at widths in metres and twists in radians; by the flat points too if asked for.

        quads : only those in which some of these have a part; least : of a gap only its narrowest place, as ``gaps.narrow``
        """
        lines = self._lines(width, twist)
        pairs, need, arms = self._about(quads)
        gaps = narrow(lines, pairs, need + below * self.slot, self.params.clockwise, least=least)
        i, u, left = sharp(lines, arms, self.sharpest[arms] + below * _SHARPEST)
        first, second, way, place = gap_slopes(lines, pairs, gaps)
        ends = np.zeros((len(i), first.shape[1]))
        slopes = sharp_slopes(lines, i, u)
        ends[:, : slopes.shape[1]] = slopes / _SHARPEST
        wound, spare, by_wound = self._wound(width, twist, arms, below)
        value = np.concatenate([(gaps.gap - need[gaps.pair]) / self.slot, (left - self.sharpest[i]) / _SHARPEST, spare])
        one, two = (np.concatenate([a, i, wound]) for a in (pairs.one[gaps.pair], pairs.two[gaps.pair]))
        by_one = np.concatenate([first / self.slot, ends, by_wound])
        by_two = np.concatenate([second / self.slot, np.zeros_like(ends), np.zeros_like(by_wound)])
        by_flat = None
        if flat:
            by_flat = self.shapes.by_points(one, by_one) + self.shapes.by_points(two, by_two)
            laid = np.flatnonzero(pairs.laid[gaps.pair])
            own = one[laid]
            rows = self.shapes.by_sides(laid, len(value), own, self.shapes.mate[own], way[laid], place[laid])
            by_flat = by_flat + rows / self.slot
        mate = self.shapes.mate
        hang = np.stack([one, mate[one], two, mate[two]], axis=1)
        hang[len(hang) - len(wound) :] = wound[:, None]
        return Terms(value, self._by_design(hang, by_one, by_two), by_flat, hang)

    def barrier(
        self,
        width: Float[np.ndarray, "quads 4"],
        twist: Float[np.ndarray, " quads"],
        *,
        support: float = SUPPORT,
        flat: bool = False,
    ) -> Barrier:
        """What the rooms weigh, smooth to the second derivative; nothing where all are at least ``support``."""
        terms = self.terms(width, twist, below=support, flat=flat)
        v = np.maximum(terms.value, 1e-12) / support
        log, rest = np.log(v), v - 1.0
        slope = -(2.0 * rest * log + rest**2 / v) / support
        # convex below the support
        bend = (-2.0 * log - 4.0 * rest / v + (rest / v) ** 2) / support**2
        value = float("inf") if (terms.value <= 0.0).any() else float(-(rest**2 * log).sum())
        scale = np.sqrt(np.maximum(bend, 0.0))[:, None]
        return Barrier(
            value,
            slope @ terms.by_design,
            None if terms.by_flat is None else slope @ terms.by_flat,
            csr_array(terms.by_design.multiply(scale)),
            None if terms.by_flat is None else csr_array(terms.by_flat.multiply(scale)),
        )

    def closed(
        self,
        width: Float[np.ndarray, "quads 4"],
        twist: Float[np.ndarray, " quads"],
        quads: Bool[np.ndarray, " quads"] | None = None,
    ) -> Bool[np.ndarray, " quads"]:
        """The quads that have a part in a room that is closed; of rooms in which some of ``quads`` have a part, if given."""
        lines, mate = self._lines(width, twist), self.shapes.mate
        pairs, need, arms = self._about(quads)
        which = narrow(lines, pairs, need, self.params.clockwise, least=True).pair
        i = sharp(lines, arms, self.sharpest[arms])[0]
        out = np.zeros(len(twist), dtype=bool)
        for a in (pairs.one[which], pairs.two[which], i):
            out[a // 4] = out[mate[a] // 4] = True
        out[self._wound(width, twist, arms, 0.0)[0] // 4] = True
        return out

    @classmethod
    def gaps(
        cls,
        flat: FlatPatches,
        params: SpiralParams,
        width: Float[np.ndarray, "quads 4"],
        twist: Float[np.ndarray, " quads"],
        below: float,
    ) -> tuple[Int[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
        """The gaps less than ``below`` metres between arms of different quads of a panel: both arms, and metres.

        Negative where arms run through each other.
        """
        pairs, shapes = pairs_of(flat, params, below), Shapes.of(flat, params)
        pairs = pairs.of((pairs.kind != BESIDE) & ~pairs.laid)
        every = np.zeros(len(shapes.mate))
        room = cls(params, pairs, shapes, np.full(len(pairs.one), below), every, every > 0.0)
        found = narrow(room._lines(width, twist), pairs, room.need, params.clockwise)
        return np.stack([pairs.one[found.pair], pairs.two[found.pair]], axis=1), found.gap

    def _wound(
        self, width: np.ndarray, twist: np.ndarray, arms: Int[np.ndarray, " n"], below: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Those of some arms that are wound less than ``below`` radians under what the stiffness table holds: which, by how much,
        and (K, numbers) its derivatives."""
        arms = arms[self.joined[arms]]
        spare, by_radius, by_width = spare_twist(self.shapes.radius[arms], width.ravel()[arms], twist[arms // 4])
        some = spare < below
        by = np.zeros((int(some.sum()), COUNT))
        by[:, RADIUS], by[:, OWN_WIDTH] = by_radius[some], by_width[some]
        by[:, OWN_WIND] = 1.0 if self.params.clockwise else -1.0
        return arms[some], spare[some], by

    def _about(self, quads: np.ndarray | None) -> tuple[Pairs, np.ndarray, np.ndarray]:
        """The pairs, what they need, and the arms in which some of the quads have a part."""
        arms = np.arange(len(self.shapes.mate))
        if quads is None:
            return self.pairs, self.need, arms
        some = quads[arms // 4] | quads[self.shapes.mate // 4]
        near = some[self.pairs.one] | some[self.pairs.two]
        return self.pairs.of(near), self.need[near], arms[some]

    def _lines(self, width: np.ndarray, twist: np.ndarray) -> Lines:
        wind, s = np.repeat((-1.0 if self.params.clockwise else 1.0) * twist, 4), self.shapes
        widths = np.stack([width.ravel(), width.ravel()[s.mate]], axis=1)
        winds, leans = (np.stack([x, s.sign * x[s.mate]], axis=1) for x in (wind, s.lean))
        return Lines.of(s.centre, s.radius, s.angle, (widths, winds, leans), self.params.blend)

    def _by_design(self, hang: np.ndarray, one: np.ndarray, two: np.ndarray) -> csr_array:
        """(K, 5 F) of derivatives by the numbers of both arms."""
        sign, arms = -1.0 if self.params.clockwise else 1.0, len(self.shapes.mate)
        columns = np.concatenate([hang, arms + hang // 4], axis=1)
        widths = [by[:, k] for by in (one, two) for k in (OWN_WIDTH, MATE_WIDTH)]
        mates = self.shapes.sign[hang[:, [0, 2]].T]
        twists = [
            sign * by[:, k] * s
            for by, m in ((one, mates[0]), (two, mates[1]))
            for k, s in ((OWN_WIND, 1.0), (MATE_WIND, m))
        ]
        data = np.stack(widths + twists, axis=1)
        start = np.arange(0, data.size + 1, data.shape[1])
        out = csr_array((data.ravel(), columns.ravel(), start), shape=(len(data), arms + arms // 4))
        out.sum_duplicates()
        return out
