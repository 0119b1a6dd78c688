"""Forces and moments in the sections of arms that bend under their loads, with exact derivatives.

Let the joint's turn be the rotation of its other hub relative to this arm's hub. The arm carries the wrench W at its
tip, in the frame half way between both hubs. Relative to this frame the arm's hub is rotated by -turn / 2. The arm is
divided into short pieces, so a section between hub and tip is rotated by

    rotation vector = -turn / 2 + sum of the bends (rotation vectors) of all pieces from the hub to the section.

A piece bends like a beam (Castigliano) under the first-order wrench at the tip: the joint's stiffness times its motion.
With this wrench the bends of both arms add up to the joint's turn. W itself may include a second-order term. Positions
are integrated from the tip with the rotated sections, and the moments of W are computed on this bent arm. Rotations
are Cayley transforms, which are orthogonal for any rotation vector; for a vector of 0.6 rad they rotate by 0.02 rad
less than Rodrigues' formula.

Vectors are ``SplitVector``: the part in the plane of the flat arm as a complex number, and the part along its normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from .bars import BarGradient, Bars
from .split_vector import SplitVector
from .tip_beams import sum_beyond

# Columns of an array of arm loads, in the arm's own axes. WRENCH: force and moment at the tip, N and N m. FIRST_ORDER:
# the first-order wrench that bends the arm, N and N m. TURN: rotation vector of the joint's other hub relative to the
# arm's hub, radians. The loads of a joint's two arms have opposite signs.
WRENCH, FIRST_ORDER, TURN = slice(0, 6), slice(6, 12), slice(12, 15)
LOADS = 15  # number of columns of an array of arm loads
# The pieces of an arm end before its hub. The rest of the arm, this many arm widths long, bends at the same rate as the
# last piece. It ends about at the arm's root (see ``cut``). Larger turns all sections farther, but from 0.6 to 1.3 that
# has little effect
BEYOND = 1.0


@dataclass(frozen=True, eq=False)
class BarLoads:
    """Loads in the sections of n bent bars (arms); a section lies at the middle of each of the bar's pieces.

    bars : the n bars
    loads : their wrenches and turns in the columns ``WRENCH``, ``FIRST_ORDER`` and ``TURN``
    compliance : bend of a piece per length and moment, rad/(N m^2). Axis 0: about the arm's tangent (torsion), about
        the direction across the arm in the sheet, about the sheet's normal
    flat : torque and bending moments that the first-order wrench causes in the flat arm
    bends : rotation vectors by which the pieces bend, radians
    beyond : bend between the last piece and the hub, divided by the bend of the last piece
    half_turns : half of the sections' rotation vectors relative to the half-way frame, radians
    tangent : unit tangents of the bent arm, in the half-way frame
    lever : vectors from the sections to the tip of the bent arm, in the half-way frame, metres
    moment : moments of the wrench about the sections, in the half-way frame, N m
    normal, torque : force along the tangent, N, and moment about it, N m, in the sections
    lift, turn : bending moments in the sections out of the sheet and in the sheet, N m
    """

    bars: Bars
    loads: Float[np.ndarray, "n 15"]
    compliance: Float[np.ndarray, "3 n pieces"]
    flat: _FlatLoads
    bends: SplitVector
    beyond: Float[np.ndarray, "n 1"]
    half_turns: SplitVector
    tangent: SplitVector
    lever: SplitVector
    moment: SplitVector
    normal: Float[np.ndarray, "n pieces"]
    torque: Float[np.ndarray, "n pieces"]
    lift: Float[np.ndarray, "n pieces"]
    turn: Float[np.ndarray, "n pieces"]

    @classmethod
    def from_bars(
        cls, bars: Bars, loads: Float[np.ndarray, "n 15"], compliance: Float[np.ndarray, "3 n pieces"]
    ) -> BarLoads:
        """Bend the bars and compute the loads in their sections.

        bars, loads, compliance : as the attributes of ``BarLoads``
        """
        flat = _FlatLoads.from_wrench(bars, loads[:, FIRST_ORDER])
        twist, lift, turn = compliance * bars.length * flat.moments
        bends, hub = SplitVector((twist + 1j * lift) * bars.tangent, turn), _split(loads[:, TURN])
        beyond = BEYOND * bars.width[:, -1:] / bars.length[:, -1:]
        half = SplitVector(
            0.5 * (sum_beyond(bends.flat) + beyond * bends.flat[:, -1:]) - 0.25 * hub.flat,
            0.5 * (sum_beyond(bends.off) + beyond * bends.off[:, -1:]) - 0.25 * hub.off,
        )
        along = SplitVector(bars.tangent, np.zeros_like(bars.length))
        change = _rotation_change(half, along)
        lever = SplitVector(
            bars.lever + _sum_from_tip(change.flat * bars.length), _sum_from_tip(change.off * bars.length)
        )
        force, at_tip = _split(loads[:, 0:3]), _split(loads[:, 3:6])
        moment = _sum(_cross(lever, force), at_tip)
        own = _sum(moment, _rotation_change(_negative(half), moment))
        tangent = _sum(along, change)
        normal = (np.conj(tangent.flat) * force.flat).real + tangent.off * force.off
        bent = np.conj(bars.tangent) * own.flat
        known = (bars, loads, compliance, flat, bends, beyond, half, tangent, lever, moment)
        return cls(*known, normal, bent.real, bent.imag, own.off)

    def vjp(
        self, normal: np.ndarray, torque: np.ndarray, lift: np.ndarray, turn: np.ndarray
    ) -> tuple[Float[np.ndarray, "n 15"], BarGradient, Float[np.ndarray, "3 n pieces"]]:
        """Return the derivatives of one scalar per arm with respect to ``loads``, ``bars`` and ``compliance``.

        Parameters
        ----------
        normal, torque, lift, turn : (n, pieces) the scalar's derivatives with respect to the attributes of these names
        """
        bars, along = self.bars, SplitVector(self.bars.tangent, np.zeros_like(self.normal))
        force = _split(self.loads[:, 0:3])
        by_own = SplitVector((torque + 1j * lift) * bars.tangent, turn)
        by_along = (torque - 1j * lift) * (self.torque + 1j * self.lift) * bars.tangent
        by_moment, by_back = _rotation_change_vjp(_negative(self.half_turns), self.moment, by_own)
        by_moment = _sum(by_moment, by_own)
        by_lever = _cross(force, by_moment)
        by_force = _sum(
            _cross(by_moment, self.lever), SplitVector(normal * self.tangent.flat, normal * self.tangent.off)
        )
        steps = SplitVector(sum_beyond(by_lever.flat), sum_beyond(by_lever.off))
        change = SplitVector(self.tangent.flat - along.flat, self.tangent.off)
        by_length = _dot(steps, change)
        by_tangent = SplitVector(normal * force.flat, normal * force.off)
        by_change = _sum(by_tangent, SplitVector(bars.length * steps.flat, bars.length * steps.off))
        back, by_half = _rotation_change_vjp(self.half_turns, along, by_change)
        by_half = SplitVector(by_half.flat - by_back.flat, by_half.off - by_back.off)
        by_along = by_along + by_tangent.flat + back.flat
        by_first, by_compliance, bent = self._bends_vjp(by_half)
        angle = (np.conj(1j * bars.tangent) * by_along).real
        gradient = BarGradient(
            by_lever.flat + bent.lever, by_length + bent.length, bent.width, bent.bend, angle + bent.angle
        )
        wrench, hub = [_sum_pieces(by_force), _sum_pieces(by_moment)], -0.25 * _sum_pieces(by_half)
        return np.concatenate([*wrench, by_first, hub], axis=1), gradient, by_compliance

    def _bends_vjp(
        self, by_half: SplitVector
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "3 n pieces"], BarGradient]:
        """Convert derivatives ``by_half`` with respect to ``half_turns``, through the pieces' bends.

        Returns the derivatives with respect to the first-order wrenches, the compliances and the bars.
        """
        bars, moments, all_turned = self.bars, self.flat.moments, 0.5 * _sum_pieces(by_half)
        by_bends = SplitVector(0.5 * _sum_from_tip(by_half.flat), 0.5 * _sum_from_tip(by_half.off))
        by_bends.flat[:, -1:] += self.beyond * (all_turned[:, :1] + 1j * all_turned[:, 1:2])
        by_bends.off[:, -1:] += self.beyond * all_turned[:, 2:]
        last = SplitVector(self.bends.flat[:, -1:], self.bends.off[:, -1:]).space[:, 0]
        by_beyond = (all_turned * last).sum(1) * self.beyond[:, 0]
        local = np.conj(bars.tangent) * by_bends.flat
        by_parts = np.stack([local.real, local.imag, by_bends.off])
        rates = self.compliance * moments
        length, width = (by_parts * rates).sum(0), np.zeros_like(bars.width)
        length[:, -1] -= by_beyond / bars.length[:, -1]
        width[:, -1] = by_beyond / bars.width[:, -1]
        by_first, lever, by_along = self.flat.vjp(by_parts * self.compliance * bars.length)
        by_along = by_along + bars.length * by_bends.flat * (rates[0] - 1j * rates[1])
        angle = (np.conj(1j * bars.tangent) * by_along).real
        return (
            by_first,
            by_parts * bars.length * moments,
            BarGradient(lever, length, width, np.zeros_like(width), angle),
        )


@dataclass(frozen=True, eq=False)
class _FlatLoads:
    """Loads in the sections of flat, undeformed bars under wrenches at their tips.

    force : forces at the tips, N
    moment : (n, pieces) moments in the sections, without their components along the normal, complex, N m
    moments : moments in the sections, N m. Axis 0: torque, bending moment out of the sheet, bending moment in the sheet
    """

    bars: Bars
    force: SplitVector
    moment: np.ndarray
    moments: Float[np.ndarray, "3 n pieces"]

    @classmethod
    def from_wrench(cls, bars: Bars, wrench: Float[np.ndarray, "n 6"]) -> _FlatLoads:
        force, moment = _split(wrench[:, :3]), _split(wrench[:, 3:])
        plane = moment.flat - 1j * bars.lever * force.off
        turned = np.conj(bars.tangent) * plane
        turn = moment.off + (np.conj(bars.lever) * force.flat).imag
        return cls(bars, force, plane, np.stack([turned.real, turned.imag, turn]))

    def vjp(self, by: Float[np.ndarray, "3 n pieces"]) -> tuple[Float[np.ndarray, "n 6"], np.ndarray, np.ndarray]:
        """Return a scalar's derivatives with respect to the wrenches, ``bars.lever`` and ``bars.tangent``.

        by : the scalar's derivatives with respect to ``moments``
        """
        bars, turn = self.bars, by[2]
        moment = (by[0] + 1j * by[1]) * bars.tangent
        by_tangent = (by[0] - 1j * by[1]) * self.moment
        lever = 1j * (self.force.off * moment - self.force.flat * turn)
        force = SplitVector(1j * turn * bars.lever, (np.conj(-1j * bars.lever) * moment).real)
        return np.concatenate([_sum_pieces(force), _sum_pieces(SplitVector(moment, turn))], axis=1), lever, by_tangent


def _split(vectors: Float[np.ndarray, "n 3"]) -> SplitVector:
    """Split one vector per arm into in-plane and normal parts of shape (n, 1), to broadcast over the pieces."""
    return SplitVector.from_vectors(vectors[:, None])


def _sum_pieces(vectors: SplitVector) -> Float[np.ndarray, "n 3"]:
    """Sum vectors (n, pieces) over the pieces, and return the sums as an array (n, 3)."""
    flat = vectors.flat.sum(1)
    return np.stack([flat.real, flat.imag, vectors.off.sum(1)], axis=1)


def _sum(a: SplitVector, b: SplitVector) -> SplitVector:
    return SplitVector(a.flat + b.flat, a.off + b.off)


def _negative(a: SplitVector) -> SplitVector:
    return SplitVector(-a.flat, -a.off)


def _dot(a: SplitVector, b: SplitVector) -> np.ndarray:
    return (np.conj(a.flat) * b.flat).real + a.off * b.off


def _cross(a: SplitVector, b: SplitVector) -> SplitVector:
    return SplitVector(1j * (a.off * b.flat - a.flat * b.off), (np.conj(a.flat) * b.flat).imag)


def _cayley_factor(half: SplitVector) -> np.ndarray:
    """Return the factor f of the Cayley transform v -> v + f (q x v + q x (q x v)).

    half : q, half of the rotation vector
    """
    return 2.0 / (1.0 + _dot(half, half))


def _rotation_change(half: SplitVector, vector: SplitVector) -> SplitVector:
    """Return rotated minus original vectors, for Cayley transforms by the rotation vectors 2 * ``half``."""
    once, size = _cross(half, vector), _cayley_factor(half)
    twice = _cross(half, once)
    return SplitVector(size * (once.flat + twice.flat), size * (once.off + twice.off))


def _rotation_change_vjp(half: SplitVector, vector: SplitVector, by: SplitVector) -> tuple[SplitVector, SplitVector]:
    """Convert derivatives ``by`` the result of ``_rotation_change`` to derivatives by ``vector`` and by ``half``."""
    once, size = _cross(half, vector), _cayley_factor(half)
    both = _sum(once, _cross(half, once))
    scaled = SplitVector(size * by.flat, size * by.off)
    inner = _sum(scaled, _cross(scaled, half))
    less = size * _dot(scaled, both)
    direct = _sum(_cross(vector, inner), _cross(once, scaled))
    return _cross(inner, half), SplitVector(direct.flat - less * half.flat, direct.off - less * half.off)


def _sum_from_tip(x: np.ndarray) -> np.ndarray:
    """Return for every piece the sum of ``x`` (n, pieces) from the tip to its middle, with half of its own value."""
    return np.cumsum(x, axis=1) - 0.5 * x
