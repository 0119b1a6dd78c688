"""Widths of the slots between the bent arms of a spiral as smooth functions of the tip motions and the arms' shapes.

This is a fast approximation of ``slots_in_space`` for narrow slots, because the search for a design evaluates thousands
of widths with derivatives at every step. An arm between hub and tip is bent like a curved beam (Castigliano), to first
order in the motion of its tip. Of the two arms beside a slot, the outer arm is the one farther from the spiral's centre
and the inner arm the other. The width is measured from edge to edge at a few points of the outer arm, at right angles
to the inner arm's centre line. Where slots are narrower than 0.3 mm, the estimate is too large by at most 0.07 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Float, Int
from ...spirals.curves.arm_curves import ArmCurves
from ...spirals.curves.blends import (
    ANGLE,
    MATE_LEAN,
    MATE_WIDTH,
    MATE_WIND,
    N_BLEND_PARAMETERS,
    OWN_LEAN,
    OWN_WIDTH,
    OWN_WIND,
    RADIUS,
)
from ..arms.split_vector import SplitVector
from ..arms.tip_beams import BentBeams, TipBeams
from ..vectors import dot
from .sections import Section, SectionGradient

# positions t on the outer arm (0 at its tip) where widths are measured: near the tip, where slots close first; more are
# slower
PLACES = np.array([0.0, 0.05, 0.1, 0.15, 0.22, 0.3])
# number of pieces into which an arm is divided; more are slower and more exact (error 0.06 mm)
STATIONS = 12
# number of Newton iterations for the point of the inner arm that faces a point of the outer arm; more are slower and
# more exact
ROUNDS = 3
# Two facing sections may be tilted against each other about the arm. This is the sine of the tilt below which the kink
# of its absolute value at 0 is rounded off. Larger is smoother and less exact (error 0.02 mm for a sheet of 2 mm)
_TILT_ROUNDING = 0.02
# The larger of two distances is replaced by a smooth maximum, which is rounded off where they differ by less than this,
# metres; larger is smoother and less exact
_AXIS_ROUNDING = 5e-5
END_TOLERANCE = 1e-4  # a point of the outer arm this far beyond the inner arm's end, in metres, still faces it
# A rough estimate first selects the slots that may be too narrow. These are the number of pieces of an arm, the number
# of pieces at its tip whose ends are measured, and the assumed error of the width in metres. Larger values are slower,
# smaller values miss narrow slots
ROUGH_PIECES, ROUGH_STATIONS, ROUGH_MARGIN = 8, 4, 4e-4


@dataclass(frozen=True, eq=False)
class SlotWidths:
    """Widths of slots, each at one of K points.

    slots : settings that are common to all slots
    arms : (K, 2) indices of the outer and the inner arm beside the slot, as in ``Slots``
    values : (K,) widths, metres
    t, s : (K,) positions of the point on the outer arm, and of the facing point on the inner arm; 0 at the tip
    field : bent arms, among them all ``arms``
    rows : (K, 2) indices of the outer and the inner arm in ``field``
    """

    slots: Slots
    arms: Int[np.ndarray, "k 2"]
    values: Float[np.ndarray, " k"]
    t: Float[np.ndarray, " k"]
    s: Float[np.ndarray, " k"]
    field: BentBeams
    rows: Int[np.ndarray, "k 2"]

    @cached_property
    def slopes(self) -> tuple[Float[np.ndarray, "k 2 6"], Float[np.ndarray, "k 2 numbers"]]:
        """Derivatives of the widths by tip motions (K, 2, 6) and by arm parameters (K, 2, 8); see ``Slots.slopes``."""
        return self.slots.slopes(self.field.subset(self.rows.ravel()), self.t, self.s)


@dataclass(frozen=True, eq=False)
class Slots:
    """The slots within spirals that have A arms in all; arm 4 f + k is arm k of quad f.

    shortest : length of the shortest blends, in t
    fillet, thickness : radius of the fillets at the hubs and thickness of the sheet, metres
    clockwise : True if the arms turn clockwise from the tips inwards
    """

    shortest: float
    fillet: float
    thickness: float
    clockwise: bool

    def below(
        self,
        width: Float[np.ndarray, " arms"],
        numbers: Float[np.ndarray, "arms numbers"],
        motion: Float[np.ndarray, "arms 6"],
    ) -> SlotWidths:
        """Return the points of ``PLACES`` at which slots are narrower than a limit.

        Parameters
        ----------
        width : (A,) limit of the width of the slot whose outer arm is this arm, metres
        numbers : (A, 8) parameters of the arms, in the columns of ``blends``
        motion : (A, 6) motions of the arms' tips in the flat frames: shift (3, metres), turn (3, radians)
        """
        first = np.arange(len(numbers))
        second = np.roll(first.reshape(-1, 4), -1, axis=1).ravel()
        pair = np.stack([first, second] if self.clockwise else [second, first], axis=1)
        rough = _rough_widths(self._beams(numbers, ROUGH_PIECES).bend(motion), pair, self._sign)
        pair = pair[rough < width[pair[:, 0]] + ROUGH_MARGIN]
        # bend only the arms beside the slots that may be too narrow
        own, index = np.unique(pair, return_inverse=True)
        t = np.tile(PLACES, (len(pair), 1))
        field, local = self._beams(numbers[own], STATIONS).bend(motion[own]), index.reshape(pair.shape)
        values, s = self._widths(field, local, t)
        narrow = np.flatnonzero(values < width[pair[:, :1]])
        place = narrow // len(PLACES)
        values, t, s = (part.ravel()[narrow] for part in (values, t, s))
        return SlotWidths(self, pair[place], values, t, s, field, local[place])

    def slopes(
        self, field: BentBeams, t: Float[np.ndarray, " k"], s: Float[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "k 2 6"], Float[np.ndarray, "k 2 numbers"]]:
        """Differentiate k slot widths, each between a point of an outer arm and the facing point of the inner arm.

        Parameters
        ----------
        field : 2 k bent arms: outer arm of the first width, its inner arm, outer arm of the second width, and so on
        t, s : (k,) positions of the points along the outer and along the inner arms, 0 at the tip

        Returns
        -------
        (k, 2, 6) : derivatives by the motions of the tips; axis 1: outer arm, inner arm
        (k, 2, 8) : derivatives by the parameters of these arms, in the columns of ``blends``
        """
        both = np.stack([t, s], axis=1).reshape(-1, 1)
        here = Section.from_arms(field, np.arange(0, len(both), 2), both[::2])
        there = Section.from_arms(field, np.arange(1, len(both), 2), both[1::2])
        outer, inner = self._section_distance(here, there)[1]
        # The facing point moves so that the vector ``way`` between both points stays at right angles to the inner arm:
        # way . along = 0. ``move`` is the Lagrange multiplier of this constraint, ``facing`` the constraint's
        # derivatives
        way = here.middle - there.middle
        facing = SectionGradient.zeros(way)
        facing.middle, facing.along = -there.along, way
        pace = there.vjp_by_t(facing)
        move = np.where((both[1::2] > 0.0) & (both[1::2] < 1.0), -there.vjp_by_t(inner) / pace, 0.0)
        facing.middle, facing.along = move[..., None] * facing.middle, move[..., None] * facing.along
        outer.middle -= facing.middle
        inner.middle += facing.middle
        inner.along += facing.along
        gradients, pieces = zip(*(part.vjp(gradient) for part, gradient in ((here, outer), (there, inner))))
        pieces = np.stack(pieces, axis=1).ravel()
        by_motion, by_numbers = field.vjp(both[:, 0], pieces, gradients[0].interleaved_with(gradients[1]))
        return by_motion.reshape(-1, 2, 6), by_numbers.reshape(-1, 2, N_BLEND_PARAMETERS)

    @property
    def _sign(self) -> float:
        """1 if the inner arm's vector ``across`` points to the outer arm, -1 if away from it (in clockwise spirals)."""
        return -1.0 if self.clockwise else 1.0

    def _beams(self, numbers: Float[np.ndarray, "arms numbers"], pieces: int) -> TipBeams:
        """Build the beams of arms with the parameters ``numbers`` (see ``blends``), each with ``pieces`` pieces."""
        given = (
            numbers[:, list(both)] for both in ((OWN_WIDTH, MATE_WIDTH), (OWN_WIND, MATE_WIND), (OWN_LEAN, MATE_LEAN))
        )
        width, wind, lean = given
        centre = np.zeros(len(numbers), dtype=complex)
        lines = ArmCurves.from_arms(centre, numbers[:, RADIUS], numbers[:, ANGLE], (width, wind, lean), self.shortest)
        return TipBeams.from_lines(lines, self.fillet, self.thickness, pieces)

    def _widths(
        self,
        field: BentBeams,
        pair: Int[np.ndarray, "n 2"],
        t: Float[np.ndarray, "n places"],
    ) -> tuple[Float[np.ndarray, "n places"], Float[np.ndarray, "n places"]]:
        """Return the widths of n slots at t on their outer arms, metres, and the facing positions s on the inner arms.

        A width is infinite where no section of the inner arm faces the point.

        field : bent arms; pair : (n, 2) indices of the outer and the inner arm of every slot in ``field``
        """
        outer, inner = pair.T
        here = Section.from_arms(field, outer, t)
        # the search for s starts at the station of the inner arm that is nearest to the point
        stations = SplitVector(field.beams.flat + field.shift.flat, field.shift.off).space
        apart = np.linalg.norm(here.middle[:, :, None] - stations[inner][:, None], axis=-1)
        s = field.beams.hub[inner, None] * (1.0 - apart.argmin(axis=2) / STATIONS)
        for _ in range(ROUNDS):
            there = Section.from_arms(field, inner, s)
            way = here.middle - there.middle
            pace = dot(there.velocity, there.along)
            slope = np.maximum(pace - dot(way, there.along_by_t), 0.25 * pace)
            s = np.clip(s + np.clip(dot(way, there.along) / slope, -0.1, 0.1), 0.0, 1.0)
        there = Section.from_arms(field, inner, s)
        beyond = np.abs(dot(here.middle - there.middle, there.along)) >= END_TOLERANCE
        return np.where(beyond, np.inf, self._section_distance(here, there)[0]), s

    def _section_distance(
        self, here: Section, there: Section
    ) -> tuple[Float[np.ndarray, "n places"], tuple[SectionGradient, SectionGradient]]:
        """Return the distances between facing sections, and their derivatives by the attributes of either section.

        here, there : sections of the outer arms, and the facing sections of the inner arms
        """
        way, sign, height = here.middle - there.middle, self._sign, 0.5 * self.thickness
        tilt = dot(here.across, there.across)
        level, turned = np.abs(tilt), np.sign(tilt)
        rolls = dot(here.off, there.across), dot(there.off, here.across)
        by_inner = (
            sign * dot(way, there.across)
            - there.half
            - level * here.half
            - height * _soft_abs(rolls[0], _TILT_ROUNDING)
        )
        by_outer = (
            sign * dot(way, here.across) - here.half - level * there.half - height * _soft_abs(rolls[1], _TILT_ROUNDING)
        )
        # The axes ``there.across`` and ``here.across`` may separate the sections (separating axis theorem); this is the
        # smooth maximum of the distances along both
        value = 0.5 * (by_inner + by_outer + _soft_abs(by_inner - by_outer, _AXIS_ROUNDING))
        # ``share`` is the derivative of the smooth maximum by ``by_inner``; that by ``by_outer`` is 1 - share
        share = 0.5 * (1.0 + (by_inner - by_outer) / np.hypot(by_inner - by_outer, _AXIS_ROUNDING))
        inner, outer = share[..., None], 1.0 - share[..., None]
        steep = [-height * (roll / np.hypot(roll, _TILT_ROUNDING))[..., None] for roll in rolls]
        halves = -(turned * (share * here.half + (1.0 - share) * there.half))[..., None]
        middle = sign * (inner * there.across + outer * here.across)
        by_here = SectionGradient(
            middle,
            np.zeros_like(way),
            outer * (sign * way + steep[1] * there.off) + halves * there.across,
            inner * steep[0] * there.across,
            -share * level - (1.0 - share),
        )
        by_there = SectionGradient(
            -middle,
            np.zeros_like(way),
            inner * (sign * way + steep[0] * here.off) + halves * here.across,
            outer * steep[1] * here.across,
            -share - (1.0 - share) * level,
        )
        return value, (by_here, by_there)


def _rough_widths(field: BentBeams, pair: Int[np.ndarray, "n 2"], sign: float) -> Float[np.ndarray, " n"]:
    """Return the approximate width (n,) of every slot near the tip of its outer arm, metres.

    It is the smallest distance, seen along the sheet's normal, from the last stations of the outer arm to the pieces
    of the inner arm, which are treated as circular arcs.

    field : bent arms; pair : (n, 2) indices of the outer and the inner arm of every slot; sign : as ``Slots._sign``
    """
    beams, (outer, inner) = field.beams, pair.T
    count = beams.velocity.shape[1]
    some = range(count - ROUGH_STATIONS, count + 1)
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
        # the inner arm's section is tilted against the sheet's normal, so a difference in height changes the distance
        across -= (shift.off[outer, k] - height[nearest]) * (np.conj(axis) * roll).real
        apart = sign * across - half[nearest] - half[outer, min(k, count - 1)]
        apart -= 0.5 * beams.thickness * np.abs((np.conj(axis) * (field.turn.flat[outer, k] - roll)).real)
        least = np.minimum(least, apart)
    return least


def _soft_abs(x: np.ndarray, over: float) -> np.ndarray:
    """Return a smooth approximation of |x| that is 0 at 0 and differs from |x| mostly where |x| is below ``over``."""
    return np.hypot(x, over) - over
