"""Widths of the slots between the bent arms of a spiral as smooth functions of the tips' motions and of the flat arms.

The search for a design needs thousands of them with derivatives, many times over. Of ``slots_in_space`` they keep what
matters where slots are narrow: the arm's shape between its hub and its tip is that of the curved beam (Castigliano), to
first order in the motion of its tip; the width of a slot is measured at a few places of its outer arm, at right angles
to the middle of the inner one, from edge to edge. On three optimised pieces 9 of 10 slots narrower than 0.3 mm come out
between 0.19 mm less and 0.02 mm more than what is measured; none by more than 0.07 mm too wide.
"""

from __future__ import annotations

import math
from collections.abc import Callable
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
    ramp,
)
from ...spirals.lines import Lines
from ..vectors import exponential, skew, times
from .bent import POISSON, answers

# t on the outer arm: in four optimised pieces all 98 slots that close do so within the first sixth of its way
PLACES = np.array([0.0, 0.05, 0.1, 0.15, 0.22, 0.3])
STATIONS = 12  # pieces of an arm: not measured against more, 16 gave the same errors against what is measured in space
# of the search for the facing place: with exact slopes, derivatives of a thousand places are within 3e-8 of differences
ROUNDS = 3
_FARTHEST = 0.6  # radius of the hub at most, as a share of the arm's; no spiral that leaves a slot over its outer third has more
# sine of the tilt of two sections against each other below which it counts less and less: 0.02 mm of a sheet of 2 mm
_TILT = 0.02
_EITHER = 5e-5  # metres; over which the better of two ways to part two sections passes from one to the other
PAST = 1e-4  # metres; an arm that ends this much before the place faces nothing there
# of the central differences by the numbers of an arm, in the order of ``blends``, and by the motion of its tip; metres and
# radians: with them the gradient of a search is within 4e-8 of differences
STEPS = (1e-7, 1e-7, 1e-5, 1e-5, 1e-7, 1e-5, 1e-5, 1e-5)
MOTION_STEPS = (1e-7, 1e-7, 1e-7, 1e-5, 1e-5, 1e-5)  # as STEPS


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
        return self.slots.slopes(self.numbers, self.motion, self.t[:, None], self.s[:, None])


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
        values, s = self._widths(self._beams(numbers).bent(motion), pair, np.tile(PLACES, (len(pair), 1)))
        narrow = np.flatnonzero(values.ravel() < width)
        arms, t, s = np.repeat(pair, len(PLACES), axis=0)[narrow], np.tile(PLACES, len(pair))[narrow], s.ravel()[narrow]
        return SlotWidths(self, arms, values.ravel()[narrow], t, s, numbers[arms], motion[arms])

    def slopes(
        self,
        numbers: Float[np.ndarray, "k 2 numbers"],
        motion: Float[np.ndarray, "k 2 6"],
        t: Float[np.ndarray, "k 1"],
        s: Float[np.ndarray, "k 1"],
    ) -> tuple[Float[np.ndarray, "k 2 6"], Float[np.ndarray, "k 2 numbers"]]:
        """Derivatives of the widths at single places by the motions and the numbers of both arms: central differences."""
        given, moved = numbers.reshape(-1, NUMBERS), motion.reshape(-1, 6)
        own = np.arange(len(given)).reshape(-1, 2)
        beams = self._beams(given)

        def width(field: _Field) -> Float[np.ndarray, " k"]:
            return self._widths(field, own, t, s)[0][:, 0]

        def slope(field: Callable[[np.ndarray], _Field], at: np.ndarray, side: int, k: int, step: float) -> np.ndarray:
            ahead, behind = at.copy(), at.copy()
            ahead[side::2, k] += step
            behind[side::2, k] -= step
            return (width(field(ahead)) - width(field(behind))) / (2.0 * step)

        by_motion, by_numbers = np.empty(motion.shape), np.empty(numbers.shape)
        for side in (0, 1):
            for k, step in enumerate(MOTION_STEPS):
                by_motion[:, side, k] = slope(beams.bent, moved, side, k, step)
            for k, step in enumerate(STEPS):
                by_numbers[:, side, k] = slope(lambda z: self._beams(z).bent(moved), given, side, k, step)
        return by_motion, by_numbers

    def _beams(self, numbers: Float[np.ndarray, "arms numbers"]) -> _Beams:
        given = (
            numbers[:, list(both)] for both in ((OWN_WIDTH, MATE_WIDTH), (OWN_WIND, MATE_WIND), (OWN_LEAN, MATE_LEAN))
        )
        width, wind, lean = given
        centre = np.zeros(len(numbers), dtype=complex)
        lines = Lines.of(centre, numbers[:, RADIUS], numbers[:, ANGLE], (width, wind, lean), self.shortest)
        return _Beams.of(lines, 0.5 * width[:, 0] + self.fillet, self.thickness)

    def _widths(
        self,
        field: _Field,
        pair: Int[np.ndarray, "n 2"],
        t: Float[np.ndarray, "n places"],
        s: Float[np.ndarray, "n places"] | None = None,
    ) -> tuple[Float[np.ndarray, "n places"], Float[np.ndarray, "n places"]]:
        """Widths in metres of slots between arms at t on the outer ones, and the facing places, near s if given."""
        (outer, inner), rounds = pair.T, 2
        here = field.section(outer, t)
        if s is None:
            # from the station that is nearest
            stations, rounds = field.beams.flat + field.shift, ROUNDS
            apart = np.linalg.norm(here.middle[:, :, None] - stations[inner][:, None], axis=-1)
            s = field.beams.hub[inner, None] * (1.0 - apart.argmin(axis=2) / STATIONS)
        for _ in range(rounds):
            there = field.section(inner, s)
            way = here.middle - there.middle
            pace = _dot(there.velocity, there.along)
            slope = np.maximum(pace - _dot(way, there.turning), 0.25 * pace)
            s = np.clip(s + np.clip(_dot(way, there.along) / slope, -0.1, 0.1), 0.0, 1.0)
        there = field.section(inner, s)
        way, sign = here.middle - there.middle, -1.0 if self.clockwise else 1.0
        level, height = np.abs(_dot(here.across, there.across)), 0.5 * self.thickness
        by_inner = sign * _dot(way, there.across) - there.half - level * here.half
        by_inner -= height * _soft(_dot(here.off, there.across), _TILT)
        by_outer = sign * _dot(way, here.across) - here.half - level * there.half
        by_outer -= height * _soft(_dot(there.off, here.across), _TILT)
        # the axis that parts them better
        width = 0.5 * (by_inner + by_outer + _soft(by_inner - by_outer, _EITHER))
        return np.where(np.abs(_dot(way, there.along)) < PAST, width, np.inf), s


@dataclass(frozen=True, eq=False)
class _Section:
    """Of arms at places: middles in metres, unit vectors along (inwards), across and off the sheet; half width in metres;
    how the middle (metres) and the vector along it change with t."""

    middle: Float[np.ndarray, "n places 3"]
    along: Float[np.ndarray, "n places 3"]
    across: Float[np.ndarray, "n places 3"]
    off: Float[np.ndarray, "n places 3"]
    half: Float[np.ndarray, "n places"]
    velocity: Float[np.ndarray, "n places 3"]
    turning: Float[np.ndarray, "n places 3"]


@dataclass(frozen=True, eq=False)
class _Beams:
    """N arms in pieces, as they answer to what moves their tips.

    hub : t where they leave it; flat : metres, their stations from there to the tip
    strain : bend and stretch of every piece per motion of the tip
    """

    lines: Lines
    hub: Float[np.ndarray, " n"]
    flat: Float[np.ndarray, "n stations 3"]
    strain: Float[np.ndarray, "n pieces 6 6"]

    @classmethod
    def of(cls, lines: Lines, away: Float[np.ndarray, " n"], thickness: float) -> _Beams:
        hub = hub_ends(lines.radius, lines.wind, away)
        every = np.arange(len(hub))[:, None]
        t = hub[:, None] * np.linspace(1.0, 0.0, 2 * STATIONS + 1)
        points, velocity, _, half, _ = lines.at(np.broadcast_to(every, t.shape), t)[:5]
        flat, velocity, width = _space(points - lines.centre[:, None]), velocity[:, 1::2], 2.0 * half[:, 1::2]
        pace, lever = np.abs(velocity), flat[:, -1:] - flat[:, 1::2]
        length = pace * hub[:, None] / STATIONS
        answer = answers(lever, _space(-velocity / pace), length, width, thickness, POISSON)
        bend, going = answer[:, :, :3], answer[:, :, 3:]
        yielding = np.concatenate([(going - skew(lever) @ bend).sum(axis=1), bend.sum(axis=1)], axis=1)
        # in the tips' own units the solution is exact
        unit = 1.0 / np.sqrt(np.abs(np.einsum("nii->ni", yielding)))
        scaled = np.linalg.inv(unit[:, :, None] * yielding * unit[:, None])
        load = unit[:, :, None] * scaled * unit[:, None]
        return cls(lines, hub, flat[:, ::2], answer @ load[:, None])

    def bent(self, motion: Float[np.ndarray, "n 6"]) -> _Field:
        strain = (self.strain @ motion[:, None, :, None])[..., 0]
        zero = np.zeros((len(motion), 1, 3))
        turn = np.concatenate([zero, np.cumsum(strain[..., :3], axis=1)], axis=1)
        middle = 0.5 * (turn[:, 1:] + turn[:, :-1])
        steps = strain[..., 3:] + np.cross(middle, np.diff(self.flat, axis=1))
        return _Field(self, np.concatenate([zero, np.cumsum(steps, axis=1)], axis=1), turn, strain)


@dataclass(frozen=True, eq=False)
class _Field:
    """Arms whose tips have moved: shift in metres and turn in radians of their stations."""

    beams: _Beams
    shift: Float[np.ndarray, "n stations 3"]
    turn: Float[np.ndarray, "n stations 3"]
    strain: Float[np.ndarray, "n pieces 6"]

    def section(self, arm: Int[np.ndarray, " n"], t: Float[np.ndarray, "n places"]) -> _Section:
        beams, every = self.beams, np.broadcast_to(arm[:, None], t.shape)
        point, velocity, change, half, _ = beams.lines.at(every, t)[:5]
        pace = np.abs(velocity)
        tangent, flat = velocity / pace, _space(point - beams.lines.centre[every])
        way = np.clip(1.0 - t / beams.hub[every], 0.0, 1.0) * STATIONS
        piece = np.minimum(way.astype(int), STATIONS - 1)
        share = (way - piece)[..., None]
        strain, turn = self.strain[every, piece], self.turn[every, piece]
        # a hub's own part stays where it is
        chord = np.where(way[..., None] > 0.0, flat - beams.flat[every, piece], 0.0)
        bend, halfway = strain[..., :3], turn + 0.5 * share * strain[..., :3]
        frame = exponential(turn + share * bend)
        along, across = times(frame, _space(tangent)), times(frame, _space(-1j * tangent))
        # pieces per unit of t, inwards
        rate = np.where(way > 0.0, -STATIONS / beams.hub[every], 0.0)[..., None]
        pulled = _space(velocity) + rate * (strain[..., 3:] + 0.5 * np.cross(bend, chord))
        curving = (np.conj(velocity) * change).imag / pace**2
        return _Section(
            flat + self.shift[every, piece] + share * strain[..., 3:] + np.cross(halfway, chord),
            along,
            across,
            frame[..., 2],
            half,
            pulled + np.cross(halfway, _space(velocity)),
            rate * np.cross(bend, along) - curving[..., None] * across,
        )


def hub_ends(
    radius: Float[np.ndarray, " n"], wind: Float[np.ndarray, " n"], away: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """t where arms leave their hub: of regular spirals, where their slots are as wide as the fillet.

    away : metres from the middle of an arm to that of a fillet beside it
    """
    pitch = (0.25 * math.pi * radius / away) ** 2 - wind**2
    least = 1.0 / _FARTHEST**2
    return 0.985 * (1.0 - 1.0 / np.sqrt(least + ramp(pitch - least, 1.0)[0]))


def _space(flat: np.ndarray) -> np.ndarray:
    """(..., 3) of complex numbers (...)."""
    return np.stack([flat.real, flat.imag, np.zeros_like(flat.real)], axis=-1)


def _soft(x: np.ndarray, over: float) -> np.ndarray:
    """The absolute value, smooth over so much about 0."""
    return np.hypot(x, over) - over


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)
