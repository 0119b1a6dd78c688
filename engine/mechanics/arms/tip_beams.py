"""Arms as curved beams (Castigliano) that are bent by motions of their tips, to first order, with exact derivatives.

A flat arm is plane, so its beam problem splits into two. A force in the plane and a moment about the normal bend it in
its plane; a moment about an axis in the plane and a force along the normal bend it out of its plane. Vectors are
therefore pairs of a complex number, the part in the plane, and a real number, the part along the normal.

The tip compliance of either problem is inverted in closed form about its elastic centre, where shifts and turns do not
couple. The inverse is symmetric. So the derivatives of a scalar by the tip motion are the wrench that a virtual tip
motion would need (adjoint method), and its derivatives by the arm's parameters follow from the real and the virtual
wrench.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...arrays import Complex, Float, Int
from ...spirals.curves.arm_curves import ArmCurves
from ...spirals.curves.blends import N_BLEND_PARAMETERS, OWN_WIDTH, OWN_WIND, RADIUS, smooth_positive
from .beams import SHEAR_FACTOR, torsion_constant
from .pieces import POISSON
from .split_vector import SplitVector

# t where an arm leaves its hub, over t at the first fillet beside it; larger makes arms longer and softer
HUB_SHARE = 0.985
# Largest radius of a hub, as a share of the arms' radius. Larger makes tightly wound arms stiffer. Spirals whose slots
# are open over at least the outer third of the radius have smaller hubs, so the limit does not affect them
_MAX_HUB_SHARE = 0.6


@dataclass(frozen=True, eq=False)
class PointGradient:
    """Derivatives of K scalars, each a function of the state of one arm at one place on it.

    The place lies in a piece of the arm; "station" is the end of this piece that is nearer to the hub.

    shift, turn : derivatives by the station's shift and rotation
    bend, stretch : by the piece's bend and stretch
    station : by the station's position on the flat arm
    hub : by t where the arm leaves its hub
    point, velocity, half : by the flat arm's position at the place, the position's derivative by t, and half its width
    """

    shift: SplitVector
    turn: SplitVector
    bend: SplitVector
    stretch: SplitVector
    station: Complex[np.ndarray, " k"]
    hub: Float[np.ndarray, " k"]
    point: Complex[np.ndarray, " k"]
    velocity: Complex[np.ndarray, " k"]
    half: Float[np.ndarray, " k"]

    def interleaved_with(self, other: PointGradient) -> PointGradient:
        """Return these derivatives alternating with those of ``other``, which are of equally many scalars."""
        return PointGradient(*(_interleave(getattr(self, k.name), getattr(other, k.name)) for k in fields(self)))


@dataclass(frozen=True, eq=False)
class Wrenches:
    """Force and moment at the tips of N arms, for a Young's modulus of 1 Pa."""

    force: SplitVector
    moment: SplitVector

    def at(self, lever: Complex[np.ndarray, "n pieces"]) -> SplitVector:
        """Return the moments (n, pieces) about the pieces; lever : i times the vector from a piece to the tip."""
        return SplitVector(
            self.moment.flat[:, None] - self.force.off[:, None] * lever,
            self.moment.off[:, None] + _dot(lever, self.force.flat[:, None]),
        )


@dataclass(frozen=True, eq=False)
class TipBeams:
    """N flat arms, each divided into pieces of equal length in t. Stations are the ends of pieces, from hub to tip.

    lines : centre lines of the arms
    thickness, fillet : thickness of the sheet and radius of the fillets, metres
    hub : t where the arms leave their hub (t is 0 at the tip, 1 at the hub's centre)
    flat : positions of the stations relative to the hub's centre, metres
    velocity, width, curving : at the middles of the pieces: the position's derivative by t (metres), the arm's width
        (metres) and its curvature (1 / metres)
    lever : i times the vector from the middle of a piece to the tip, metres
    """

    lines: ArmCurves
    thickness: float
    fillet: float
    hub: Float[np.ndarray, " n"]
    flat: Complex[np.ndarray, "n stations"]
    velocity: Complex[np.ndarray, "n pieces"]
    width: Float[np.ndarray, "n pieces"]
    lever: Complex[np.ndarray, "n pieces"]
    curving: Float[np.ndarray, "n pieces"]

    @classmethod
    def from_lines(cls, lines: ArmCurves, fillet: float, thickness: float, pieces: int) -> TipBeams:
        """Divide arms into pieces between hub and tip.

        Parameters
        ----------
        lines : centre lines of the arms
        fillet, thickness : radius of the fillets at the hub and thickness of the sheet, metres
        pieces : number of pieces per arm
        """
        hub = hub_ends(lines.radius, lines.wind, 0.5 * lines.width + fillet)[0]
        t = hub[:, None] * np.linspace(1.0, 0.0, 2 * pieces + 1)
        points, velocity, change, half = lines.evaluate(np.arange(len(hub))[:, None], t)[:4]
        flat = points - lines.centre[:, None]
        lever = 1j * (flat[:, -1:] - flat[:, 1::2])
        velocity, change = velocity[:, 1::2], change[:, 1::2]
        curving = _cross(velocity, change) / np.abs(velocity) ** 3
        return cls(lines, thickness, fillet, hub, flat[:, ::2], velocity, 2.0 * half[:, 1::2], lever, curving)

    @property
    def middle(self) -> Complex[np.ndarray, "n pieces"]:
        """Positions of the pieces' middles, relative to the hub's centre, metres."""
        return self.flat[:, -1:] + 1j * self.lever

    @property
    def hub_slopes(self) -> Float[np.ndarray, "n numbers"]:
        """Derivatives of ``hub`` by the arms' parameters, in the columns of ``blends``."""
        lines = self.lines
        slopes = hub_ends(lines.radius, lines.wind, 0.5 * lines.width + self.fillet)[1]
        out = np.zeros((len(slopes), N_BLEND_PARAMETERS))
        out[:, RADIUS], out[:, OWN_WIND], out[:, OWN_WIDTH] = slopes[:, 0], slopes[:, 1], 0.5 * slopes[:, 2]
        return out

    @cached_property
    def _direction_squared(self) -> Complex[np.ndarray, "n pieces"]:
        """Square a^2 of the unit tangent a of every piece, as a complex number.

        For a vector x in the plane and real p and r, p x + r a^2 conj(x) is x with its part along the arm multiplied by
        p + r and its part across the arm multiplied by p - r.
        """
        return self.velocity**2 / np.abs(self.velocity) ** 2

    @cached_property
    def _flexibilities(self) -> tuple[np.ndarray, ...]:
        """Flexibilities of every piece for a Young's modulus of 1 Pa: eight arrays (n, pieces).

        0, 1: p and r (see ``_direction_squared``) of the bend per moment about axes in the plane; 2: bend per moment
        about the normal; 3, 4: p and r of stretch and shear per force in the plane; 5: shear per force along the
        normal; 6, 7: derivatives by the width of torsion and of out-of-plane bending per moment.
        """
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
            0.5 * (twist + level), 0.5 * (twist - level), upright, 0.5 * (stretch + slide), 0.5 * (stretch - slide),
            slide, twist * change, -level / width,
        )  # fmt: skip

    def _turn_pieces(self, moment: SplitVector) -> SplitVector:
        """Return the bends (rotation vectors) of the pieces under moments (n, pieces)."""
        p, r, off = self._flexibilities[:3]
        return SplitVector(p * moment.flat + r * self._direction_squared * np.conj(moment.flat), off * moment.off)

    def _stretch_pieces(self, force: SplitVector) -> SplitVector:
        """Return the stretch and shear (as one vector) of the pieces under forces (n, pieces) or (n, 1)."""
        p, r, off = self._flexibilities[3:6]
        return SplitVector(p * force.flat + r * self._direction_squared * np.conj(force.flat), off * force.off)

    @cached_property
    def _elastic_centres(self) -> tuple[Any, ...]:
        """Elastic centres of both beam problems, and the tip compliances about them, where shifts and turns decouple.

        A centre is given as i times the vector from it to the tip. p and r stand for the map x -> p x + r conj(x) of
        vectors in the plane.

        Returns
        -------
        in the plane : turn per moment; elastic centre; p and r of the shift per force
        out of the plane : p and r of the turn per moment; elastic centre; shift per force
        """
        (p, r, off, gradient, aside, slide), lever = self._flexibilities[:6], self.lever
        turn = off.sum(1)
        centre = (off * lever).sum(1) / turn
        way = lever - centre[:, None]
        plane = (
            (gradient + 0.5 * off * np.abs(way) ** 2).sum(1),
            (aside * self._direction_squared + 0.5 * off * way**2).sum(1),
        )
        roll = p.sum(1), (r * self._direction_squared).sum(1)
        other = _solve(roll, (p * lever + r * self._direction_squared * np.conj(lever)).sum(1))
        way = lever - other[:, None]
        lift = (_dot(way, p * way + r * self._direction_squared * np.conj(way)) + slide).sum(1)
        return turn, centre, plane, roll, other, lift

    def wrenches(self, shift: SplitVector, turn: SplitVector) -> Wrenches:
        """Return the wrenches at the tips that cause given motions of the tips.

        Parameters
        ----------
        shift, turn : motions of the tips, metres and radians. As the map is linear and symmetric, a scalar's derivatives
            by force and moment may be passed instead; then its derivatives by shift and turn are returned
        """
        stiff, centre, plane, roll, other, lift = self._elastic_centres
        force = _solve(plane, shift.flat - turn.off * centre)
        up = (shift.off + _dot(other, turn.flat)) / lift
        moment = SplitVector(_solve(roll, turn.flat) + up * other, turn.off / stiff - _dot(centre, force))
        return Wrenches(SplitVector(force, up), moment)

    def bend(self, motion: Float[np.ndarray, "n 6"]) -> BentBeams:
        """Bend the arms by the tip motions ``motion`` (n, 6): shifts (3) in metres, then turns (3) in radians."""
        load = self.wrenches(SplitVector.from_vectors(motion[:, :3]), SplitVector.from_vectors(motion[:, 3:]))
        bend, stretch = self._turn_pieces(load.at(self.lever)), self._stretch_pieces(load.force[:, None])
        turn = bend.sums()
        middle = SplitVector(turn.flat[:, :-1] + 0.5 * bend.flat, turn.off[:, :-1] + 0.5 * bend.off)
        chord = np.diff(self.flat, axis=1)
        steps = SplitVector(stretch.flat + 1j * middle.off * chord, stretch.off + _cross(middle.flat, chord))
        return BentBeams(self, load, bend, stretch, turn, steps.sums(), middle)


@dataclass(frozen=True, eq=False)
class BentBeams:
    """Arms of ``TipBeams`` that are bent by motions of their tips.

    load : wrenches at the tips
    bend, stretch : rotation vector (radians), and stretch and shear (metres), of every piece
    turn, shift : rotation vector (radians) and shift (metres) of every station
    middle : rotation vectors at the middles of the pieces, radians
    """

    beams: TipBeams
    load: Wrenches
    bend: SplitVector
    stretch: SplitVector
    turn: SplitVector
    shift: SplitVector
    middle: SplitVector

    def subset(self, index: Int[np.ndarray, " k"]) -> BentBeams:
        """Return the arms with the indices ``index``, which may repeat; cached properties are copied with them."""
        return _select_rows(self, index)

    def vjp(
        self, t: Float[np.ndarray, " n"], piece: Int[np.ndarray, " n"], gradient: PointGradient
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n numbers"]]:
        """Return the derivatives of one scalar per arm by the tip motions and by the parameters of ``blends``.

        Parameters
        ----------
        t, piece : (n,) position of one place on every arm, and index of the piece that contains it
        gradient : the scalar's derivatives by the state of the arm at this place
        """
        beams = self.beams
        count, rows = beams.velocity.shape[1], np.arange(len(t))
        before, chord = np.arange(count) < piece[:, None], np.diff(beams.flat, axis=1)
        stretch = SplitVector(before * gradient.shift.flat[:, None], before * gradient.shift.off[:, None])
        half = SplitVector(-1j * stretch.off * chord, _cross(chord, stretch.flat))
        turn = gradient.turn[:, None]
        bend = SplitVector(sum_beyond(half.flat) + before * turn.flat, sum_beyond(half.off) + before * turn.off)
        by_chord = 1j * (stretch.off * self.middle.flat - self.middle.off * stretch.flat)
        by_flat = np.zeros(beams.flat.shape, dtype=complex)
        by_flat[:, 1:] += by_chord
        by_flat[:, :-1] -= by_chord
        by_flat[rows, piece] += gradient.station
        for own, other in ((bend, gradient.bend), (stretch, gradient.stretch)):
            own.flat[rows, piece] += other.flat
            own.off[rows, piece] += other.off
        virtual, by_hub, by_velocity, by_width, by_lever = self._vjp_of_pieces(bend, stretch)
        by_flat[:, -1] += by_lever.sum(1)
        step = np.linspace(1.0, 0.0, 2 * count + 1)
        # columns: station 0, middle of piece 0, station 1, middle of piece 1, ..., and last the place ``t``
        points, velocity, width = (np.zeros((len(t), 2 * count + 2), dtype=kind) for kind in (complex, complex, float))
        points[:, :-1:2], points[:, 1:-1:2], points[:, -1] = by_flat, -by_lever, gradient.point
        velocity[:, 1:-1:2], velocity[:, -1] = by_velocity, gradient.velocity
        width[:, 1:-1:2], width[:, -1] = 2.0 * by_width, gradient.half
        at = np.concatenate([beams.hub[:, None] * step, t[:, None]], axis=1)
        numbers, by_t = beams.lines.vjp(at, points, velocity, width)
        by_hub = by_hub + gradient.hub + by_t[:, :-1] @ step
        numbers += by_hub[:, None] * beams.hub_slopes
        force, moment = virtual.force.space, virtual.moment.space
        return np.concatenate([force, moment], axis=1), numbers

    def _vjp_of_pieces(
        self, bend: SplitVector, stretch: SplitVector
    ) -> tuple[Wrenches, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Convert a scalar's derivatives by bend and stretch of the pieces.

        Returns its derivatives by the tip motion (the virtual wrench), by ``hub`` as far as this changes the pieces'
        lengths, by ``velocity``, by ``width`` and by the vectors from the pieces' middles to the tip.
        """
        beams, load = self.beams, self.load
        lever, along = beams.lever, beams._direction_squared
        _, r, off, _, aside, _, twist_by, level_by = beams._flexibilities
        turned, stretched = beams._turn_pieces(bend), beams._stretch_pieces(stretch)
        virtual = beams.wrenches(
            SplitVector(
                (off * bend.off * lever + stretched.flat).sum(1), (stretched.off - _dot(lever, turned.flat)).sum(1)
            ),
            SplitVector(turned.flat.sum(1), turned.off.sum(1)),
        )
        moment, force, other = load.at(lever), load.force[:, None], virtual.at(lever)
        # Where a flexibility changes, the wrench must change too, so that the tip motion is the same. This is accounted
        # for by subtracting the virtual wrench's moments and forces from the derivatives by bend and stretch
        bend = SplitVector(bend.flat - other.flat, bend.off - other.off)
        stretch = SplitVector(stretch.flat - virtual.force.flat[:, None], stretch.off - virtual.force.off[:, None])
        turned = beams._turn_pieces(bend)
        plane, upright = _dot(turned.flat, moment.flat), turned.off * moment.off
        gone = beams._stretch_pieces(stretch)
        going = _dot(gone.flat, force.flat) + gone.off * force.off
        whole = plane + upright + going
        both, turns = _dot(bend.flat, moment.flat), _dot(bend.flat, along * np.conj(moment.flat))
        by_width = -(3.0 * upright + going) / beams.width + 0.5 * (
            twist_by * (both + turns) + level_by * (both - turns)
        )
        by_angle = 2.0 * (
            r * _dot(bend.flat, 1j * along * np.conj(moment.flat))
            + aside * _dot(stretch.flat, 1j * along * np.conj(force.flat))
        )
        by_velocity = beams.velocity / np.abs(beams.velocity) ** 2 * (whole + 1j * by_angle)
        own = SplitVector(load.force.flat[:, None], load.force.off[:, None])
        by_lever = (
            virtual.force.off[:, None] * self.bend.flat
            - own.off * turned.flat
            + off * (bend.off * own.flat - moment.off * virtual.force.flat[:, None])
        )
        return virtual, whole.sum(1) / beams.hub, by_velocity, by_width, -1j * by_lever


def _select_rows(known: Any, index: Int[np.ndarray, " k"]) -> Any:
    """Copy arrays, or tuples and data classes of arrays at any depth, with only the rows ``index`` of every array."""
    if isinstance(known, np.ndarray):
        return known[index]
    if isinstance(known, tuple):
        return tuple(_select_rows(one, index) for one in known)
    if not is_dataclass(known):
        return known
    out: Any = copy(known)
    out.__dict__.update({name: _select_rows(value, index) for name, value in known.__dict__.items()})
    return out


def hub_ends(
    radius: Float[np.ndarray, " n"], wind: Float[np.ndarray, " n"], away: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Return t where arms of spirals with four equal arms leave their hub, and its derivatives (n, 3).

    The slots beside an arm end where they are as wide as a fillet. The derivatives are by radius, wind and away.

    Parameters
    ----------
    radius : of the arms, metres
    wind : twist of the arms, radians
    away : distance from an arm's centre line to the centre of a fillet beside it, metres
    """
    room = (0.25 * math.pi * radius / away) ** 2
    least = 1.0 / _MAX_HUB_SHARE**2
    over, slope = smooth_positive(room - wind**2 - least, 1.0)
    whole = least + over
    by = 0.5 * HUB_SHARE * whole**-1.5 * slope
    slopes = by[:, None] * np.stack([2.0 * room / radius, -2.0 * wind, -2.0 * room / away], axis=1)
    return HUB_SHARE * (1.0 - 1.0 / np.sqrt(whole)), slopes


def _interleave(first: Any, second: Any) -> Any:
    """Return first[0], second[0], first[1], second[1] and so on, for arrays or split vectors."""
    if isinstance(first, SplitVector):
        return SplitVector(_interleave(first.flat, second.flat), _interleave(first.off, second.off))
    return np.stack([first, second], axis=1).ravel()


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the dot products of vectors in the plane, given as complex numbers."""
    return a.real * b.real + a.imag * b.imag


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products a x b of vectors in the plane, given as complex numbers; they are real numbers."""
    return a.real * b.imag - a.imag * b.real


def _solve(both: tuple[np.ndarray, np.ndarray], x: np.ndarray) -> np.ndarray:
    """Return the complex y for which p y + r conj(y) = x.

    both : the real p and the complex r
    """
    p, r = both
    return (p * x - r * np.conj(x)) / (p * p - np.abs(r) ** 2)


def sum_beyond(x: np.ndarray) -> np.ndarray:
    """Return for every column of x (n, pieces) the sum of all later columns plus half of the column itself."""
    return np.cumsum(x[:, ::-1], axis=1)[:, ::-1] - 0.5 * x
