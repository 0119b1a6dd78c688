"""Widths of the slots between the bent arms of a spiral as smooth functions of the tips' motions and of the flat arms.

The search for a design needs thousands of them with derivatives, many times over. Of ``slots_in_space`` they keep what
matters where slots are narrow: the arm's shape between its hub and its tip is that of the curved beam (Castigliano), to
first order in the motion of its tip; the width of a slot is measured at a few places of its outer arm, at right angles
to the middle of the inner one, from edge to edge. On three optimised pieces 9 of 10 slots narrower than 0.3 mm come out
between 0.19 mm less and 0.02 mm more than what is measured; none by more than 0.07 mm too wide.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Float, Int
from ...spirals.blends import (
    ANGLE,
    MATE_LEAN,
    MATE_WIDTH,
    MATE_WIND,
    NUMBERS,
    OWN_LEAN,
    OWN_WIDTH,
    OWN_WIND,
    RADIUS,
)
from ...spirals.lines import Lines
from .sections import Section, SectionPull, dot
from .tip_beams import BentByTips, Pair, Pull, TipBeams

# t on the outer arm: in four optimised pieces all 98 slots that close do so within the first sixth of its way
PLACES = np.array([0.0, 0.05, 0.1, 0.15, 0.22, 0.3])
# pieces of an arm: on three optimised surfaces, one of 150 spirals and one of 986 among them, half of the narrow places are within
# 0.004 mm of what 48 pieces give, 99 of 100 within 0.04 mm, all within 0.06 mm
STATIONS = 12
# of the search for the facing place: with them 95 of 100 derivatives are within 1e-6 of differences
ROUNDS = 3
# sine of the tilt of two sections against each other below which it counts less and less: 0.02 mm of a sheet of 2 mm
_TILT = 0.02
_EITHER = 5e-5  # metres; over which the better of two ways to part two sections passes from one to the other
PAST = 1e-4  # metres; an arm that ends this much before the place faces nothing there
# of the rough look for slots that may be too narrow: pieces of an arm, stations at its outer end, and metres by which it may be
# wrong. With 0.3 mm it missed one narrow place of 250, with 6 and 3 up to five of 40; like this none on those surfaces
SCREEN, SCREENED, MARGIN = 8, 4, 4e-4


@dataclass(frozen=True, eq=False)
class SlotWidths:
    """Widths at K places of slots.

    slots : they are of; arms : (K, 2) int, the outer and the inner arm; values : (K,) metres
    t, s : (K,) where the place is on them; numbers, motion : of both arms, as in ``Slots.below``
    """

    slots: Slots
    arms: Int[np.ndarray, "k 2"]
    values: Float[np.ndarray, " k"]
    t: Float[np.ndarray, " k"]
    s: Float[np.ndarray, " k"]
    numbers: Float[np.ndarray, "k 2 numbers"]
    motion: Float[np.ndarray, "k 2 6"]

    @cached_property
    def slopes(self) -> tuple[Float[np.ndarray, "k 2 6"], Float[np.ndarray, "k 2 numbers"]]:
        """Derivatives by the motions and by the numbers of both arms."""
        return self.slots.slopes(self.arms, self.numbers, self.motion, self.t, self.s)


@dataclass(frozen=True, eq=False)
class Slots:
    """The slots within spirals, of A arms; arm 4 f + k is arm k of quad f.

    shortest : share of t over which arms are blended that hardly turn; fillet, thickness : metres
    """

    shortest: float
    fillet: float
    thickness: float
    clockwise: bool

    def below(
        self, width: float, numbers: Float[np.ndarray, "arms numbers"], motion: Float[np.ndarray, "arms 6"]
    ) -> SlotWidths:
        """The places that are narrower than a width in metres.

        numbers : of every arm, in the order of ``blends``; motion : metres and radians, of its tip in the flat frame
        """
        first = np.arange(len(numbers))
        second = np.roll(first.reshape(-1, 4), -1, axis=1).ravel()
        pair = np.stack([first, second] if self.clockwise else [second, first], axis=1)
        rough = _rough(self._beams(numbers, SCREEN).bent(motion), pair, self._sign)
        pair = pair[rough < width + MARGIN]
        # of arms that may be too near each other alone
        own, index = np.unique(pair, return_inverse=True)
        t = np.tile(PLACES, (len(pair), 1))
        field, local = self._beams(numbers[own], STATIONS).bent(motion[own]), index.reshape(pair.shape)
        values, s = self._widths(field, local, t)
        narrow = np.flatnonzero(values.ravel() < width)
        arms, t, s = np.repeat(pair, len(PLACES), axis=0)[narrow], t.ravel()[narrow], s.ravel()[narrow]
        return SlotWidths(self, arms, values.ravel()[narrow], t, s, numbers[arms], motion[arms])

    def slopes(
        self,
        arms: Int[np.ndarray, "k 2"],
        numbers: Float[np.ndarray, "k 2 numbers"],
        motion: Float[np.ndarray, "k 2 6"],
        t: Float[np.ndarray, " k"],
        s: Float[np.ndarray, " k"],
    ) -> tuple[Float[np.ndarray, "k 2 6"], Float[np.ndarray, "k 2 numbers"]]:
        """Derivatives of the widths at single places by the motions and the numbers of both arms; s faces t."""
        # an arm has many places: it is bent once for all of them
        own, index = np.unique(arms, return_index=True, return_inverse=True)[1:]
        bent = self._beams(numbers.reshape(-1, NUMBERS)[own], STATIONS).bent(motion.reshape(-1, 6)[own])
        field = bent.rows(index.ravel())
        both = np.stack([t, s], axis=1).reshape(-1, 1)
        here = Section.of(field, np.arange(0, len(both), 2), both[::2])
        there = Section.of(field, np.arange(1, len(both), 2), both[1::2])
        outer, inner = self._apart(here, there)[1]
        # the facing place moves along: s keeps the way between the arms at right angles to the inner one
        way = here.middle - there.middle
        facing = SectionPull.none(way)
        facing.middle, facing.along = -there.along, way
        pace = there.by_place(facing)
        move = np.where((both[1::2] > 0.0) & (both[1::2] < 1.0), -there.by_place(inner) / pace, 0.0)
        facing.middle, facing.along = move[..., None] * facing.middle, move[..., None] * facing.along
        outer.middle -= facing.middle
        inner.middle += facing.middle
        inner.along += facing.along
        pulls, pieces = zip(*(part.pulled(pull) for part, pull in ((here, outer), (there, inner))))
        pieces = np.stack(pieces, axis=1).ravel()
        by_motion, by_numbers = field.pulled(both[:, 0], pieces, Pull.of(*pulls))
        return by_motion.reshape(motion.shape), by_numbers.reshape(numbers.shape)

    @property
    def _sign(self) -> float:
        return -1.0 if self.clockwise else 1.0

    def _beams(self, numbers: Float[np.ndarray, "arms numbers"], pieces: int) -> TipBeams:
        given = (
            numbers[:, list(both)] for both in ((OWN_WIDTH, MATE_WIDTH), (OWN_WIND, MATE_WIND), (OWN_LEAN, MATE_LEAN))
        )
        width, wind, lean = given
        centre = np.zeros(len(numbers), dtype=complex)
        lines = Lines.of(centre, numbers[:, RADIUS], numbers[:, ANGLE], (width, wind, lean), self.shortest)
        return TipBeams.of(lines, self.fillet, self.thickness, pieces)

    def _widths(
        self,
        field: BentByTips,
        pair: Int[np.ndarray, "n 2"],
        t: Float[np.ndarray, "n places"],
    ) -> tuple[Float[np.ndarray, "n places"], Float[np.ndarray, "n places"]]:
        """Widths in metres of slots between arms at t on the outer ones, and the facing places."""
        outer, inner = pair.T
        here = Section.of(field, outer, t)
        # from the station that is nearest
        stations = Pair(field.beams.flat + field.shift.flat, field.shift.off).space
        apart = np.linalg.norm(here.middle[:, :, None] - stations[inner][:, None], axis=-1)
        s = field.beams.hub[inner, None] * (1.0 - apart.argmin(axis=2) / STATIONS)
        for _ in range(ROUNDS):
            there = Section.of(field, inner, s)
            way = here.middle - there.middle
            pace = dot(there.velocity, there.along)
            slope = np.maximum(pace - dot(way, there.turning), 0.25 * pace)
            s = np.clip(s + np.clip(dot(way, there.along) / slope, -0.1, 0.1), 0.0, 1.0)
        there = Section.of(field, inner, s)
        beyond = np.abs(dot(here.middle - there.middle, there.along)) >= PAST
        return np.where(beyond, np.inf, self._apart(here, there)[0]), s

    def _apart(
        self, here: Section, there: Section
    ) -> tuple[Float[np.ndarray, "n places"], tuple[SectionPull, SectionPull]]:
        """Widths between facing sections of outer and inner arms, and their derivatives by both."""
        way, sign, height = here.middle - there.middle, self._sign, 0.5 * self.thickness
        tilt = dot(here.across, there.across)
        level, turned = np.abs(tilt), np.sign(tilt)
        rolls = dot(here.off, there.across), dot(there.off, here.across)
        by_inner = sign * dot(way, there.across) - there.half - level * here.half - height * _soft(rolls[0], _TILT)
        by_outer = sign * dot(way, here.across) - here.half - level * there.half - height * _soft(rolls[1], _TILT)
        # the axis that parts them better
        value = 0.5 * (by_inner + by_outer + _soft(by_inner - by_outer, _EITHER))
        # its share, and what the axes have to do with it
        share = 0.5 * (1.0 + (by_inner - by_outer) / np.hypot(by_inner - by_outer, _EITHER))
        inner, outer = share[..., None], 1.0 - share[..., None]
        steep = [-height * (roll / np.hypot(roll, _TILT))[..., None] for roll in rolls]
        halves = -(turned * (share * here.half + (1.0 - share) * there.half))[..., None]
        middle = sign * (inner * there.across + outer * here.across)
        here_pull = SectionPull(
            middle,
            np.zeros_like(way),
            outer * (sign * way + steep[1] * there.off) + halves * there.across,
            inner * steep[0] * there.across,
            -share * level - (1.0 - share),
        )
        there_pull = SectionPull(
            -middle,
            np.zeros_like(way),
            inner * (sign * way + steep[0] * here.off) + halves * here.across,
            outer * steep[1] * here.across,
            -share - (1.0 - share) * level,
        )
        return value, (here_pull, there_pull)


def _rough(field: BentByTips, pair: Int[np.ndarray, "n 2"], sign: float) -> Float[np.ndarray, " n"]:
    """About how many metres the slots are wide about the outer thirds of their outer arms, seen in the plane.

    From stations there to the pieces of the inner arms, as if these were arcs.
    """
    beams, (outer, inner) = field.beams, pair.T
    count = beams.velocity.shape[1]
    some = range(count - SCREENED, count + 1)
    shift, turn, half = field.shift, field.middle, 0.5 * beams.width
    middle = beams.middle + 0.5 * (shift.flat[:, 1:] + shift.flat[:, :-1])
    height = 0.5 * (shift.off[:, 1:] + shift.off[:, :-1])
    along = beams.velocity / np.abs(beams.velocity) * np.exp(1j * turn.off)
    least = np.full(len(pair), np.inf)
    for k in some:
        place = (beams.flat[:, k] + shift.flat[:, k])[outer]
        nearest = inner, np.abs(place[:, None] - middle[inner]).argmin(axis=1)
        axis, roll = along[nearest], turn.flat[nearest]
        seen = np.conj(axis) * (place - middle[nearest])
        across = -seen.imag + 0.5 * beams.curving[nearest] * seen.real**2
        # the inner arm's section leans
        across -= (shift.off[outer, k] - height[nearest]) * (np.conj(axis) * roll).real
        apart = sign * across - half[nearest] - half[outer, min(k, count - 1)]
        apart -= 0.5 * beams.thickness * np.abs((np.conj(axis) * (field.turn.flat[outer, k] - roll)).real)
        least = np.minimum(least, apart)
    return least


def _soft(x: np.ndarray, over: float) -> np.ndarray:
    """The absolute value, smooth over so much about 0."""
    return np.hypot(x, over) - over
