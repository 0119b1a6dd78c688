"""Arms as curved beams (Castigliano) that motions of their tips bend, to first order, with exact derivatives.

The flat arm is plane, so a beam falls into two: force in the plane and moment off it bend it in its plane, moment in the
plane and force off it bend it out of it. Vectors are pairs: their part in the plane, a complex number, and that off it.

Seen from the elastic centres of the two beams, where shifts and turns do not mix, the yielding of the tips is inverted in
closed form. The inverse is symmetric, so the derivatives of anything that the arms' shape decides by the motions are the
wrench that a virtual motion asks for (adjoint), and those by the arms' own numbers follow from both wrenches.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...arrays import Complex, Float, Int
from ...spirals.blends import NUMBERS, OWN_WIDTH, OWN_WIND, RADIUS, ramp
from ...spirals.lines import Lines
from .beams import SHEAR_FACTOR, torsion_constant
from .pieces import POISSON

HUB_SHARE = 0.985  # of the way to the first fillet at which an arm leaves its hub
_FARTHEST = 0.6  # radius of the hub at most, as a share of the arm's; no spiral that leaves a slot over its outer third has more


@dataclass(frozen=True, eq=False)
class Pair:
    """Vectors: their parts in the plane of the flat arms and off it."""

    flat: Complex[np.ndarray, "*n"]
    off: Float[np.ndarray, "*n"]

    @classmethod
    def of(cls, vector: Float[np.ndarray, "*n 3"]) -> Pair:
        return cls(vector[..., 0] + 1j * vector[..., 1], vector[..., 2])

    @property
    def space(self) -> Float[np.ndarray, "*n 3"]:
        return np.stack([self.flat.real, self.flat.imag, self.off], axis=-1)

    def __getitem__(self, index: Any) -> Pair:
        return Pair(self.flat[index], self.off[index])

    def sums(self) -> Pair:
        """Over the pieces from the hub to every station."""
        return Pair(_sums(self.flat), _sums(self.off))


@dataclass(frozen=True, eq=False)
class Pull:
    """How K numbers, each of a place on an arm, change with what is there.

    shift, turn : of the station before the place; bend, stretch : of its piece; station : the flat station; hub : t where
    the arm leaves it; point, velocity, half : of the flat arm at the place
    """

    shift: Pair
    turn: Pair
    bend: Pair
    stretch: Pair
    station: Complex[np.ndarray, " k"]
    hub: Float[np.ndarray, " k"]
    point: Complex[np.ndarray, " k"]
    velocity: Complex[np.ndarray, " k"]
    half: Float[np.ndarray, " k"]

    @classmethod
    def of(cls, first: Pull, second: Pull) -> Pull:
        """Of two in turn."""
        return cls(*(_mixed(getattr(first, part.name), getattr(second, part.name)) for part in fields(cls)))


@dataclass(frozen=True, eq=False)
class Wrenches:
    """At the tips of N arms, for a Young's modulus of 1 Pa: force and moment."""

    force: Pair
    moment: Pair

    def at(self, lever: Complex[np.ndarray, "n pieces"]) -> Pair:
        """The moments (n, pieces) about pieces, i times whose way to the tip is given."""
        return Pair(
            self.moment.flat[:, None] - self.force.off[:, None] * lever,
            self.moment.off[:, None] + _seen(lever, self.force.flat[:, None]),
        )


@dataclass(frozen=True, eq=False)
class TipBeams:
    """N arms in pieces that are equally long in t.

    hub : t where they leave it; flat : metres, their stations from there to the tip
    velocity, width : in the middle of the pieces; lever : i times the way from there to the tip; curving : 1 / metres there
    """

    lines: Lines
    thickness: float
    fillet: float
    hub: Float[np.ndarray, " n"]
    flat: Complex[np.ndarray, "n stations"]
    velocity: Complex[np.ndarray, "n pieces"]
    width: Float[np.ndarray, "n pieces"]
    lever: Complex[np.ndarray, "n pieces"]
    curving: Float[np.ndarray, "n pieces"]

    @classmethod
    def of(cls, lines: Lines, fillet: float, thickness: float, pieces: int) -> TipBeams:
        hub = hub_ends(lines.radius, lines.wind, 0.5 * lines.width + fillet)[0]
        t = hub[:, None] * np.linspace(1.0, 0.0, 2 * pieces + 1)
        points, velocity, change, half = lines.at(np.arange(len(hub))[:, None], t)[:4]
        flat = points - lines.centre[:, None]
        lever = 1j * (flat[:, -1:] - flat[:, 1::2])
        velocity, change = velocity[:, 1::2], change[:, 1::2]
        curving = _crossed(velocity, change) / np.abs(velocity) ** 3
        return cls(lines, thickness, fillet, hub, flat[:, ::2], velocity, 2.0 * half[:, 1::2], lever, curving)

    @property
    def middle(self) -> Complex[np.ndarray, "n pieces"]:
        """Metres, of the pieces."""
        return self.flat[:, -1:] + 1j * self.lever

    @property
    def hub_slopes(self) -> Float[np.ndarray, "n numbers"]:
        """Derivatives of where the arms leave their hubs by their numbers."""
        lines = self.lines
        slopes = hub_ends(lines.radius, lines.wind, 0.5 * lines.width + self.fillet)[1]
        out = np.zeros((len(slopes), NUMBERS))
        out[:, RADIUS], out[:, OWN_WIND], out[:, OWN_WIDTH] = slopes[:, 0], slopes[:, 1], 0.5 * slopes[:, 2]
        return out

    @cached_property
    def _along(self) -> Complex[np.ndarray, "n pieces"]:
        """The square of the direction along the arm: C x = p x + r (along conj(x)) yields p + r along it and p - r across it."""
        return self.velocity**2 / np.abs(self.velocity) ** 2

    @cached_property
    def _yielding(self) -> tuple[np.ndarray, ...]:
        """Of every piece for a Young's modulus of 1 Pa: p and r of its turn, its turn off the plane; p and r of its stretch, the
        same off the plane. And the shares by which twisting changes with the width."""
        height, width = self.thickness, self.width
        length = np.abs(self.velocity) * (self.hub[:, None] / self.velocity.shape[1])
        shear = 0.5 / (1.0 + POISSON)
        torsion, slope = torsion_constant(height / width, terms=2)
        twist = length / (shear * torsion * width**4)
        level, upright = 12.0 * length / (width * height**3), 12.0 * length / (height * width**3)
        stretch = length / (width * height)
        slide = stretch * SHEAR_FACTOR / shear
        change = (slope * height / (width * torsion) - 4.0) / width
        return (
            0.5 * (twist + level), 0.5 * (twist - level), upright, 0.5 * (stretch + slide), 0.5 * (stretch - slide), slide,
            twist * change, -level / width,
        )  # fmt: skip

    def _turned(self, moment: Pair) -> Pair:
        """How pieces turn under moments (n, pieces)."""
        p, r, off = self._yielding[:3]
        return Pair(p * moment.flat + r * self._along * np.conj(moment.flat), off * moment.off)

    def _stretched(self, force: Pair) -> Pair:
        """How pieces stretch and shear under forces (n, pieces) or (n, 1)."""
        p, r, off = self._yielding[3:6]
        return Pair(p * force.flat + r * self._along * np.conj(force.flat), off * force.off)

    @cached_property
    def _centred(self) -> tuple[Any, ...]:
        """Both beams as seen from their elastic centres."""
        (p, r, off, pull, aside, slide), lever = self._yielding[:6], self.lever
        turn = off.sum(1)
        centre = (off * lever).sum(1) / turn
        way = lever - centre[:, None]
        plane = (pull + 0.5 * off * np.abs(way) ** 2).sum(1), (aside * self._along + 0.5 * off * way**2).sum(1)
        roll = p.sum(1), (r * self._along).sum(1)
        other = _inverse(roll, (p * lever + r * self._along * np.conj(lever)).sum(1))
        way = lever - other[:, None]
        lift = (_seen(way, p * way + r * self._along * np.conj(way)) + slide).sum(1)
        return turn, centre, plane, roll, other, lift

    def wrenches(self, shift: Pair, turn: Pair) -> Wrenches:
        """That move the tips like this; or, how numbers that the wrenches change like this change with the tips' motion."""
        stiff, centre, plane, roll, other, lift = self._centred
        force = _inverse(plane, shift.flat - turn.off * centre)
        up = (shift.off + _seen(other, turn.flat)) / lift
        moment = Pair(_inverse(roll, turn.flat) + up * other, turn.off / stiff - _seen(centre, force))
        return Wrenches(Pair(force, up), moment)

    def bent(self, motion: Float[np.ndarray, "n 6"]) -> BentByTips:
        """When their tips move by shifts in metres and turns in radians."""
        load = self.wrenches(Pair.of(motion[:, :3]), Pair.of(motion[:, 3:]))
        bend, stretch = self._turned(load.at(self.lever)), self._stretched(load.force[:, None])
        turn = bend.sums()
        middle = Pair(turn.flat[:, :-1] + 0.5 * bend.flat, turn.off[:, :-1] + 0.5 * bend.off)
        chord = np.diff(self.flat, axis=1)
        steps = Pair(stretch.flat + 1j * middle.off * chord, stretch.off + _crossed(middle.flat, chord))
        return BentByTips(self, load, bend, stretch, turn, steps.sums(), middle)


@dataclass(frozen=True, eq=False)
class BentByTips:
    """Arms whose tips have moved under wrenches.

    bend, stretch : of every piece, radians and metres; turn, shift : of every station; middle : turn of the pieces' middles
    """

    beams: TipBeams
    load: Wrenches
    bend: Pair
    stretch: Pair
    turn: Pair
    shift: Pair
    middle: Pair

    def rows(self, index: Int[np.ndarray, " k"]) -> BentByTips:
        """Return the arms at these indices, which may repeat, with all that was computed of them."""
        return _rows(self, index)

    def pulled(
        self, t: Float[np.ndarray, " n"], piece: Int[np.ndarray, " n"], pull: Pull
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n numbers"]]:
        """How n numbers, each of a place of its own arm, change with the motion of its tip and with its numbers (``blends``).

        t : where the places are; piece : the one that they lie on
        """
        beams = self.beams
        count, rows = beams.velocity.shape[1], np.arange(len(t))
        before, chord = np.arange(count) < piece[:, None], np.diff(beams.flat, axis=1)
        stretch = Pair(before * pull.shift.flat[:, None], before * pull.shift.off[:, None])
        half = Pair(-1j * stretch.off * chord, _crossed(chord, stretch.flat))
        turn = pull.turn[:, None]
        bend = Pair(_after(half.flat) + before * turn.flat, _after(half.off) + before * turn.off)
        by_chord = 1j * (stretch.off * self.middle.flat - self.middle.off * stretch.flat)
        by_flat = np.zeros(beams.flat.shape, dtype=complex)
        by_flat[:, 1:] += by_chord
        by_flat[:, :-1] -= by_chord
        by_flat[rows, piece] += pull.station
        for own, other in ((bend, pull.bend), (stretch, pull.stretch)):
            own.flat[rows, piece] += other.flat
            own.off[rows, piece] += other.off
        virtual, by_hub, by_velocity, by_width, by_lever = self._by_pieces(bend, stretch)
        by_flat[:, -1] += by_lever.sum(1)
        step = np.linspace(1.0, 0.0, 2 * count + 1)
        # stations and middles of pieces, and the place itself
        points, velocity, width = (np.zeros((len(t), 2 * count + 2), dtype=kind) for kind in (complex, complex, float))
        points[:, :-1:2], points[:, 1:-1:2], points[:, -1] = by_flat, -by_lever, pull.point
        velocity[:, 1:-1:2], velocity[:, -1] = by_velocity, pull.velocity
        width[:, 1:-1:2], width[:, -1] = 2.0 * by_width, pull.half
        at = np.concatenate([beams.hub[:, None] * step, t[:, None]], axis=1)
        numbers, by_t = beams.lines.pulled(at, points, velocity, width)
        by_hub = by_hub + pull.hub + by_t[:, :-1] @ step
        numbers += by_hub[:, None] * beams.hub_slopes
        force, moment = virtual.force.space, virtual.moment.space
        return np.concatenate([force, moment], axis=1), numbers

    def _by_pieces(self, bend: Pair, stretch: Pair) -> tuple[Wrenches, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """From what changes with bend and stretch of the pieces: the virtual wrench, and the derivatives by the hubs' ends
        (as far as they decide how long the pieces are), by velocities, widths and ways to the tip."""
        beams, load = self.beams, self.load
        lever, along = beams.lever, beams._along
        _, r, off, _, aside, _, twist_by, level_by = beams._yielding
        turned, stretched = beams._turned(bend), beams._stretched(stretch)
        virtual = beams.wrenches(
            Pair((off * bend.off * lever + stretched.flat).sum(1), (stretched.off - _seen(lever, turned.flat)).sum(1)),
            Pair(turned.flat.sum(1), turned.off.sum(1)),
        )
        moment, force, other = load.at(lever), load.force[:, None], virtual.at(lever)
        # what is left where the tips stay
        bend = Pair(bend.flat - other.flat, bend.off - other.off)
        stretch = Pair(stretch.flat - virtual.force.flat[:, None], stretch.off - virtual.force.off[:, None])
        turned = beams._turned(bend)
        plane, upright = _seen(turned.flat, moment.flat), turned.off * moment.off
        gone = beams._stretched(stretch)
        going = _seen(gone.flat, force.flat) + gone.off * force.off
        whole = plane + upright + going
        both, turns = _seen(bend.flat, moment.flat), _seen(bend.flat, along * np.conj(moment.flat))
        by_width = -(3.0 * upright + going) / beams.width + 0.5 * (
            twist_by * (both + turns) + level_by * (both - turns)
        )
        by_angle = 2.0 * (
            r * _seen(bend.flat, 1j * along * np.conj(moment.flat))
            + aside * _seen(stretch.flat, 1j * along * np.conj(force.flat))
        )
        by_velocity = beams.velocity / np.abs(beams.velocity) ** 2 * (whole + 1j * by_angle)
        own = Pair(load.force.flat[:, None], load.force.off[:, None])
        by_lever = (
            virtual.force.off[:, None] * self.bend.flat
            - own.off * turned.flat
            + off * (bend.off * own.flat - moment.off * virtual.force.flat[:, None])
        )
        return virtual, whole.sum(1) / beams.hub, by_velocity, by_width, -1j * by_lever


def _rows(known: Any, index: Int[np.ndarray, " k"]) -> Any:
    """Return a copy of nested tuples and data classes that keeps these rows of every array in them."""
    if isinstance(known, np.ndarray):
        return known[index]
    if isinstance(known, tuple):
        return tuple(_rows(one, index) for one in known)
    if not is_dataclass(known):
        return known
    out: Any = copy(known)
    out.__dict__.update({name: _rows(value, index) for name, value in known.__dict__.items()})
    return out


def hub_ends(
    radius: Float[np.ndarray, " n"], wind: Float[np.ndarray, " n"], away: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """t where arms leave their hub: of regular spirals, where their slots are as wide as the fillet; and its derivatives.

    away : metres from the middle of an arm to that of a fillet beside it
    """
    room = (0.25 * math.pi * radius / away) ** 2
    least = 1.0 / _FARTHEST**2
    over, slope = ramp(room - wind**2 - least, 1.0)
    whole = least + over
    by = 0.5 * HUB_SHARE * whole**-1.5 * slope
    slopes = by[:, None] * np.stack([2.0 * room / radius, -2.0 * wind, -2.0 * room / away], axis=1)
    return HUB_SHARE * (1.0 - 1.0 / np.sqrt(whole)), slopes


def _mixed(first: Any, second: Any) -> Any:
    """One of the first, one of the second, and so on."""
    if isinstance(first, Pair):
        return Pair(_mixed(first.flat, second.flat), _mixed(first.off, second.off))
    return np.stack([first, second], axis=1).ravel()


def _seen(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of vectors in the plane."""
    return a.real * b.real + a.imag * b.imag


def _crossed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a.real * b.imag - a.imag * b.real


def _inverse(both: tuple[np.ndarray, np.ndarray], x: np.ndarray) -> np.ndarray:
    """y with p y + r conj(y) = x."""
    p, r = both
    return (p * x - r * np.conj(x)) / (p * p - np.abs(r) ** 2)


def _sums(steps: np.ndarray) -> np.ndarray:
    out = np.zeros((len(steps), steps.shape[1] + 1), dtype=steps.dtype)
    np.cumsum(steps, axis=1, out=out[:, 1:])
    return out


def _after(x: np.ndarray) -> np.ndarray:
    """What acts on every piece through the turn of all that come after it, and half of its own."""
    return np.cumsum(x[:, ::-1], axis=1)[:, ::-1] - 0.5 * x
