"""Arms as curved bars in pieces, with exact derivatives of their shape with respect to the arms' parameters.

The slots beside an arm end at its hub in fillets. A bar reaches from the arm's tip to a little before the first of
them, which is at the arm's inner edge (the side to which the arm curves).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Complex, Float
from ...spirals.curves.arm_curves import ArmCurves
from ...spirals.curves.blends import (
    ANGLE,
    MATE_LEAN,
    MATE_WIDTH,
    MATE_WIND,
    OWN_LEAN,
    OWN_WIDTH,
    OWN_WIND,
    RADIUS,
    smooth_positive,
)
from ...spirals.curves.blends import N_BLEND_PARAMETERS as BLEND_NUMBERS
from .tip_beams import HUB_SHARE, hub_ends

# A bar's parameters are those of ``blends`` and, last, the width (metres) of the next arm of the same spiral, across
# the slot at the bar's inner edge. This is the index of that width
BESIDE = BLEND_NUMBERS
NUMBERS = BLEND_NUMBERS + 1  # number of parameters of a bar
# number of pieces from the tip to the end of the bar; more are slower, fewer miss the kinks of short blends
PIECES = 16
# A bar's last piece ends this far before the first fillet, measured towards the tip in arm widths, because from there
# on the hub supports the inner edge; smaller overestimates strains
BEFORE_FILLET = 0.35
# length in t of the last piece over that of the first; larger resolves short kinks near the tip better and the end near
# the hub worse
GROWTH = 1.8
# Lower limit of t at the end of a bar, for tightly wound arms, and width in t of the smooth transition to this limit;
# larger overestimates strains of tightly wound arms
LEAST_END, END_SOFT = 0.3, 0.1


@dataclass(frozen=True, eq=False)
class Bars:
    """n arms in pieces, counted from the tip inwards. Even stations are the ends of pieces, odd stations their middles.

    lines : centre lines and widths of the arms
    end : (n,) t at the end of the last piece; t is 0 at the tip and 1 at the hub's centre
    end_by : derivatives of ``end`` with respect to the bar's parameters
    t, point, velocity : t of all stations, their positions (complex, metres) and derivatives of these with respect to t
    width : widths of the arm at the middles of the pieces, metres
    """

    lines: ArmCurves
    end: Float[np.ndarray, " n"]
    end_by: Float[np.ndarray, "n numbers"]
    t: Float[np.ndarray, "n places"]
    point: Complex[np.ndarray, "n places"]
    velocity: Complex[np.ndarray, "n places"]
    width: Float[np.ndarray, "n pieces"]

    @classmethod
    def from_numbers(cls, numbers: Float[np.ndarray, "n _"], shortest: float, fillet: float) -> Bars:
        """Divide arms into pieces.

        Parameters
        ----------
        numbers : parameters of the bars: those of ``blends``, then ``BESIDE``
        shortest : length of the shortest blends, in t
        fillet : radius of the fillets, metres
        """
        pairs = ((OWN_WIDTH, MATE_WIDTH), (OWN_WIND, MATE_WIND), (OWN_LEAN, MATE_LEAN))
        width, wind, lean = (numbers[:, list(both)] for both in pairs)
        lines = ArmCurves.from_arms(
            np.zeros(len(numbers), dtype=complex),
            numbers[:, RADIUS],
            numbers[:, ANGLE],
            (width, wind, lean),
            shortest,
        )
        end, end_by = _bar_ends(lines, numbers[:, BESIDE], fillet)
        t = end[:, None] * _STATIONS
        point, velocity, _, half = lines.evaluate(np.arange(len(end))[:, None], t)[:4]
        return cls(lines, end, end_by, t, point, velocity, 2.0 * half[:, 1::2])

    @cached_property
    def speed(self) -> Float[np.ndarray, "n pieces"]:
        """Absolute value of ``velocity`` at the pieces' middles, metres per t."""
        return np.abs(self.velocity[:, 1::2])

    @cached_property
    def length(self) -> Float[np.ndarray, "n pieces"]:
        """Lengths of the pieces, metres."""
        return self.speed * (self.end[:, None] * _STEPS)

    @cached_property
    def tangent(self) -> Complex[np.ndarray, "n pieces"]:
        """Unit tangents at the pieces' middles, towards the tip."""
        return -self.velocity[:, 1::2] / self.speed

    @cached_property
    def lever(self) -> Complex[np.ndarray, "n pieces"]:
        """Vectors from the pieces' middles to the arm's tip, metres."""
        return self.point[:, :1] - self.point[:, 1::2]

    @cached_property
    def bend(self) -> Float[np.ndarray, "n pieces"]:
        """Curvature of the pieces times their width, positive to the left of the outward tangent."""
        ends = self.velocity[:, ::2]
        return -np.angle(ends[:, 1:] * np.conj(ends[:, :-1])) / self.length * self.width

    def vjp(self, gradient: BarGradient) -> Float[np.ndarray, "n numbers"]:
        """Convert the derivatives ``gradient`` of one scalar per arm to derivatives with respect to the parameters."""
        ends, middles = self.velocity[:, ::2], self.velocity[:, 1::2]
        by_turn = -gradient.bend * self.width / self.length
        by_length = gradient.length - gradient.bend * self.bend / self.length
        by_width = gradient.width + gradient.bend * self.bend / self.width
        points, velocity, half = np.zeros_like(self.point), np.zeros_like(self.velocity), np.zeros_like(self.t)
        points[:, 0], points[:, 1::2] = gradient.lever.sum(1), -gradient.lever
        velocity[:, 1::2] = (
            middles / self.speed * (1j * gradient.angle / self.speed + self.end[:, None] * _STEPS * by_length)
        )
        spin = 1j * ends / np.abs(ends) ** 2
        velocity[:, 2::2] += spin[:, 1:] * by_turn
        velocity[:, :-1:2] -= spin[:, :-1] * by_turn
        half[:, 1::2] = 2.0 * by_width
        numbers, by_t = self.lines.vjp(self.t, points, velocity, half)
        by_end = by_t @ _STATIONS + (by_length * self.speed) @ _STEPS
        out = by_end[:, None] * self.end_by
        out[:, :BLEND_NUMBERS] += numbers
        return out


def _stations() -> Float[np.ndarray, " places"]:
    """Return t / ``end`` at all stations of a bar, whose pieces' lengths grow linearly from the tip inwards."""
    lengths = np.linspace(1.0, GROWTH, PIECES)
    ends = np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])
    out = np.empty(2 * PIECES + 1)
    out[::2], out[1::2] = ends, 0.5 * (ends[1:] + ends[:-1])
    return out


_STATIONS = _stations()
_STEPS = np.diff(_STATIONS[::2])


@dataclass(frozen=True, eq=False)
class BarGradient:
    """Derivatives of one scalar per arm with respect to lever, length, width, bend and tangent angle of its pieces."""

    lever: Complex[np.ndarray, "n pieces"]
    length: Float[np.ndarray, "n pieces"]
    width: Float[np.ndarray, "n pieces"]
    bend: Float[np.ndarray, "n pieces"]
    angle: Float[np.ndarray, "n pieces"]


def _bar_ends(
    lines: ArmCurves, beside: Float[np.ndarray, " n"], fillet: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n numbers"]]:
    """Return t at the ends of the bars, a little before the first fillets, and its derivatives by the bars' parameters.

    Parameters
    ----------
    lines : centre lines of the arms
    beside : (n,) width of the next arm across the slot at the inner edge, metres
    fillet : radius of the fillets, metres
    """
    radius, wind, width = lines.radius, lines.wind, lines.width
    root, root_by = _first_fillets(lines, beside, fillet)
    from_centre = 1.0 - root
    # speed |dx/dt| of the arm's centre line x(t) at the place beside the fillet, in units of the arm's radius
    speed = np.sqrt(1.0 + (wind * from_centre) ** 2)
    back = BEFORE_FILLET * width / (radius * speed)
    back_by = (back / speed**2 * wind**2 * from_centre)[:, None] * root_by
    back_by[:, OWN_WIND] -= back / speed**2 * wind * from_centre**2
    back_by[:, RADIUS] -= back / radius
    back_by[:, OWN_WIDTH] += back / width
    over, slope = smooth_positive(root - back - LEAST_END, END_SOFT)
    return LEAST_END + over, slope[:, None] * (root_by - back_by)


def _first_fillets(
    lines: ArmCurves, beside: Float[np.ndarray, " n"], fillet: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n numbers"]]:
    """Return t on n arms beside the fillet at their inner edge, and its derivatives by the bars' parameters.

    A fillet lies between two arms of a spiral. The point half way between their centre lines has the t that
    ``hub_ends`` returns. Both centre lines cross the radius through this point at an angle a. So beside the fillet one
    arm is farther from the hub's centre than this point and the other nearer, by half the distance of their centre
    lines times sin a. Parameters as in ``_bar_ends``.
    """
    radius, wind, away = lines.radius, lines.wind, 0.25 * (lines.width + beside) + fillet
    hub, slopes = hub_ends(radius, wind, away)
    root, by_both = hub / HUB_SHARE, slopes / HUB_SHARE
    from_centre, share = 1.0 - root, away / radius
    speed = np.sqrt(1.0 + (wind * from_centre) ** 2)
    sine = wind * from_centre / speed
    by_both *= (1.0 + share * wind / speed**3)[:, None]
    by_both -= np.stack([-share * sine, share * radius * from_centre / speed**3, sine], axis=1) / radius[:, None]
    by = np.zeros((len(root), NUMBERS))
    by[:, [RADIUS, OWN_WIND, OWN_WIDTH, BESIDE]] = by_both[:, [0, 1, 2, 2]] * [1.0, 1.0, 0.25, 0.25]
    return root - share * sine, by
