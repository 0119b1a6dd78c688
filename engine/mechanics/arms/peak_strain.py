"""Largest principal strain on the surface of arms under wrenches at their tips, without fillets, with exact
derivatives.

An arm is a curved bar of rectangular section that carries the wrench from its tip to its hub. It is divided into
``PIECES`` pieces from the tip to a little before its first fillet. In the middle of each piece, the section's forces
and moments cause

- axial strain from the normal force, and from bending in the sheet as in a curved bar (Winkler and Bach);
- axial strain from bending out of the sheet, larger on the inner side of a curved bar;
- axial strain in the corners from warping, where torsion changes along the arm (St. Venant's warping times the change
of the twist rate; Vlasov);
- shear from torsion in the middles of sides and faces, larger on the inner side and smaller on the outer side.

Strains are added with their signs, so that loads can cancel. Axial strain e and shear g, with no other stress, have the
largest principal strain (1 - nu)/2 |e| + sqrt(((1 + nu) e/2)^2 + (g/2)^2). The maximum over all sections is a power
mean of high degree divided by ``SHARE``.

Compared with 18 solids of whole pieces (1,978 arms, cubic elements), it is within 15 % on 88 of 100 arms. The larger
strain of the two arms of a joint is within 15 % more often.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...arrays import Complex, Float
from ...materials import Material
from ...spirals.blends import (
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
from ...spirals.blends import NUMBERS as BLEND_NUMBERS
from ...spirals.lines import ArmCurves
from .bar_sections import Curvature, Torsion
from .grain import direction_share
from .tip_beams import HUB_SHARE, hub_ends

GRAIN = BLEND_NUMBERS  # parameter after those of ``blends``: radians from the radius to the grain
NUMBERS = BLEND_NUMBERS + 1  # number of parameters of an arm
# Pieces from the tip to the end of the bar; more are slower. 9 miss the kinks of short blends; 32 change strains by
# less than 2 %.
PIECES = 16
# Distance before the first fillet, in arm widths, at which the last piece ends, because the hub supports the inner edge
# there; smaller overestimates strains, by 10 to 30 % at zero.
BEFORE_FILLET = 0.35
LEAST_END, END_SOFT = 0.3, 0.1  # share of t that is always evaluated, and the width in t of the smooth transition to it
INNER_SHEAR = 0.25  # relative rise of the torsional shear on the inner side, per curvature times width
# Pieces on either side over which the change of the twist rate is taken, about one sheet thickness; the derivative at
# the section itself is too large in short kinks.
LAG = 2
POWER = 32  # degree of the power mean, a power of two; larger is closer to the maximum and less smooth
SHARE = 0.881  # power mean over maximum: the median of 1,978 arms, 90 of 100 of which lie at 0.86 to 0.91
ROUNDING = 1e-5  # strain below which absolute values are rounded off
BATCH = 256  # arms at a time, few enough to stay in the processor's cache
_SIDES = np.array([-1.0, 1.0])[:, None, None]  # right and left edge of a section, in half widths


@dataclass(frozen=True, eq=False)
class PeakStrain:
    """Largest strains of n arms and their derivatives.

    by_wrench : (n, 6) per N and N m, in the arms' own axes; by_numbers : (n, NUMBERS) at constant wrenches
    """

    values: Float[np.ndarray, " arms"]
    by_wrench: Float[np.ndarray, "arms 6"]
    by_numbers: Float[np.ndarray, "arms 9"]


@dataclass(frozen=True, eq=False)
class StrainedArms:
    """N arms in their own axes: along the radius to the tip, and to the side to which they wind inwards.

    numbers : (N, NUMBERS) parameters of ``blends`` and the grain
    shortest : share of t over which an arm that hardly turns is blended; fillet, thickness : metres
    """

    numbers: Float[np.ndarray, "arms 9"]
    shortest: float
    fillet: float
    thickness: float
    material: Material

    def values(self, wrench: Float[np.ndarray, "arms 6"]) -> Float[np.ndarray, " arms"]:
        """(N,) largest strains under wrenches in N and N m.

        With a grain, a strain is scaled to one of a sheet without a grain that is equally close to its limit.
        """
        out = np.empty(len(wrench))
        for start in range(0, len(out), BATCH):
            some = slice(start, start + BATCH)
            out[some] = _SectionStrains(_Bars.from_arms(self, self.numbers[some]), wrench[some]).values
        return out

    def slopes(self, wrench: Float[np.ndarray, "arms 6"], arms: np.ndarray) -> PeakStrain:
        """Largest strains of the arms with indices ``arms`` (k,) under their wrenches (k, 6), with derivatives."""
        out = PeakStrain(np.empty(len(arms)), np.empty((len(arms), 6)), np.empty((len(arms), NUMBERS)))
        for start in range(0, len(arms), BATCH):
            some = slice(start, start + BATCH)
            places = _SectionStrains(_Bars.from_arms(self, self.numbers[arms[some]]), wrench[some])
            out.values[some] = places.values
            out.by_wrench[some], out.by_numbers[some] = places.slopes()
        return out


@dataclass(frozen=True, eq=False)
class _Bars:
    """n arms in pieces, from their tips inwards: piece ends at even stations, middles at odd ones.

    end : (n,) t at the end of the last piece; end_by : its derivatives by the parameters of ``blends``
    t, point, velocity : at all stations, velocity per t; width : metres, at the middles
    """

    arms: StrainedArms
    lines: ArmCurves
    grain: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]
    end_by: Float[np.ndarray, "n numbers"]
    t: Float[np.ndarray, "n places"]
    point: Complex[np.ndarray, "n places"]
    velocity: Complex[np.ndarray, "n places"]
    width: Float[np.ndarray, "n pieces"]

    @classmethod
    def from_arms(cls, arms: StrainedArms, numbers: Float[np.ndarray, "n 9"]) -> _Bars:
        pairs = ((OWN_WIDTH, MATE_WIDTH), (OWN_WIND, MATE_WIND), (OWN_LEAN, MATE_LEAN))
        width, wind, lean = (numbers[:, list(both)] for both in pairs)
        lines = ArmCurves.from_arms(
            np.zeros(len(numbers), dtype=complex),
            numbers[:, RADIUS],
            numbers[:, ANGLE],
            (width, wind, lean),
            arms.shortest,
        )
        end, end_by = _ends(lines, arms.fillet)
        t = end[:, None] * np.linspace(0.0, 1.0, 2 * PIECES + 1)
        point, velocity, _, half = lines.at(np.arange(len(end))[:, None], t)[:4]
        return cls(arms, lines, numbers[:, GRAIN], end, end_by, t, point, velocity, 2.0 * half[:, 1::2])

    @cached_property
    def pace(self) -> Float[np.ndarray, "n pieces"]:
        """Length of the velocity at the middles, metres per t."""
        return np.abs(self.velocity[:, 1::2])

    @cached_property
    def length(self) -> Float[np.ndarray, "n pieces"]:
        """Lengths of the pieces, metres."""
        return self.pace * (self.end[:, None] / PIECES)

    @cached_property
    def tangent(self) -> Complex[np.ndarray, "n pieces"]:
        """Unit tangents at the middles, outwards."""
        return -self.velocity[:, 1::2] / self.pace

    @cached_property
    def lever(self) -> Complex[np.ndarray, "n pieces"]:
        """Vectors from the middles to the tip, metres."""
        return self.point[:, :1] - self.point[:, 1::2]

    @cached_property
    def bend(self) -> Float[np.ndarray, "n pieces"]:
        """Curvature of the pieces times their width, positive to the left of the outward tangent."""
        ends = self.velocity[:, ::2]
        return -np.angle(ends[:, 1:] * np.conj(ends[:, :-1])) / self.length * self.width

    def pulled(self, pull: _Pull) -> Float[np.ndarray, "n numbers"]:
        """Vector-Jacobian product: turn derivatives by the bars (``pull``) into derivatives by the parameters of ``blends``."""
        ends, middles = self.velocity[:, ::2], self.velocity[:, 1::2]
        by_turn = -pull.bend * self.width / self.length
        by_length = pull.length - pull.bend * self.bend / self.length
        by_width = pull.width + pull.bend * self.bend / self.width
        points, velocity, half = np.zeros_like(self.point), np.zeros_like(self.velocity), np.zeros_like(self.t)
        points[:, 0], points[:, 1::2] = pull.lever.sum(1), -pull.lever
        velocity[:, 1::2] = middles / self.pace * (1j * pull.angle / self.pace + self.end[:, None] / PIECES * by_length)
        spin = 1j * ends / np.abs(ends) ** 2
        velocity[:, 2::2] += spin[:, 1:] * by_turn
        velocity[:, :-1:2] -= spin[:, :-1] * by_turn
        half[:, 1::2] = 2.0 * by_width
        numbers, by_t = self.lines.pulled(self.t, points, velocity, half)
        by_end = by_t @ np.linspace(0.0, 1.0, 2 * PIECES + 1) + (by_length * self.pace).sum(1) / PIECES
        return numbers + by_end[:, None] * self.end_by


@dataclass(frozen=True, eq=False)
class _Pull:
    """Derivatives of one number per arm by its bar: by lever, length, width, bend and tangent angle, (n, pieces) each."""

    lever: Complex[np.ndarray, "n pieces"]
    length: Float[np.ndarray, "n pieces"]
    width: Float[np.ndarray, "n pieces"]
    bend: Float[np.ndarray, "n pieces"]
    angle: Float[np.ndarray, "n pieces"]


def _ends(lines: ArmCurves, fillet: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n numbers"]]:
    """t a little before the first fillets of regular spirals, and its derivatives by the parameters of ``blends``."""
    radius, wind, width = lines.radius, lines.wind, lines.width
    hub, slopes = hub_ends(radius, wind, 0.5 * width + fillet)
    root, root_by = hub / HUB_SHARE, np.zeros((len(hub), BLEND_NUMBERS))
    root_by[:, [RADIUS, OWN_WIND, OWN_WIDTH]] = slopes * np.array([1.0, 1.0, 0.5]) / HUB_SHARE
    left = 1.0 - root
    # speed of the spiral there, in radii per t
    pace = np.sqrt(1.0 + (wind * left) ** 2)
    back = BEFORE_FILLET * width / (radius * pace)
    back_by = (back / pace**2 * wind**2 * left)[:, None] * root_by
    back_by[:, OWN_WIND] -= back / pace**2 * wind * left**2
    back_by[:, RADIUS] -= back / radius
    back_by[:, OWN_WIDTH] += back / width
    over, slope = smooth_positive(root - back - LEAST_END, END_SOFT)
    return LEAST_END + over, slope[:, None] * (root_by - back_by)


class _SectionStrains:
    """Strains at eight points of every section: its corners and the middles of its sides and faces."""

    def __init__(self, bars: _Bars, wrench: Float[np.ndarray, "n 6"]) -> None:
        self.bars, self.wrench = bars, wrench
        self.force, self.up = (wrench[:, 0] + 1j * wrench[:, 1])[:, None], wrench[:, 2, None]
        # section loads: moment in the plane; normal force, torque, bending moments out of the sheet and in it
        self.moment = (wrench[:, 3] + 1j * wrench[:, 4])[:, None] - 1j * bars.lever * self.up
        back = np.conj(bars.tangent)
        self.normal, turned = (back * self.force).real, back * self.moment
        self.torque, self.lift = turned.real, turned.imag
        self.turn = wrench[:, 5, None] + (np.conj(bars.lever) * self.force).imag
        self._strain_parts()
        self._principal_strains()

    def _strain_parts(self) -> None:
        """Compute the strains of each cause: normal force, bending in the sheet and out of it, torsion and warping."""
        bars, arms = self.bars, self.bars.arms
        height, width, youngs = arms.thickness, bars.width, arms.material.youngs
        self.softness = 2.0 * (1.0 + arms.material.poisson) / youngs  # 1 / G
        self.curvature = c = Curvature.evaluate(bars.bend)
        self.torsion = t = Torsion.evaluate(width, height)
        self.inner = 1.0 - 0.5 * _SIDES * c.bend
        self.stretch = self.normal / (youngs * width * height)
        self.in_plane = self.turn / (youngs * width**2 * height)
        # strain of the edges per in-plane bending
        self.shape = -(0.5 * _SIDES - c.off * c.bend) / (c.off * self.inner)
        self.raised = 6.0 / (youngs * height**2) / width * self.lift / c.log
        self.rate = t.values[0] * self.softness
        self.way = bars.length @ _LAG_LENGTH
        self.change = (self.rate * self.torque) @ _LAG_DIFFERENCE / self.way
        self.warped = t.values[3] * self.change

    def _principal_strains(self) -> None:
        """Combine axial strains and shear at the eight points into the largest principal strains."""
        t, share = self.torsion.values, 1.0 + INNER_SHEAR * _SIDES * self.curvature.bend
        self.share = share
        self.flat = self.stretch + self.in_plane * self.shape
        self.tilt = (self.raised + _SIDES * self.warped) / self.inner
        middle = self.stretch + self.in_plane * self.curvature.bend
        self.axial = np.concatenate(
            [self.flat + self.tilt, self.flat - self.tilt, self.flat, [middle + self.raised, middle - self.raised]]
        )
        self.twisting = self.softness * self.torque
        self.shear = np.stack([*(self.twisting * t[1] * share), self.twisting * t[2]])
        self.principal = np.abs(self.axial)
        nu = self.bars.arms.material.poisson
        own, self.sheared = self.axial[4:], self.shear[[0, 1, 2, 2]]
        self.size = np.sqrt(own * own + ROUNDING**2)
        self.root = np.sqrt((0.5 * (1.0 + nu) * own) ** 2 + 0.25 * self.sheared**2 + ROUNDING**2)
        self.principal[4:] = 0.5 * (1.0 - nu) * (self.size - ROUNDING) + self.root - ROUNDING  # zero without load
        self.weak, self.weak_by = self._weakness()
        self.weighted = self.principal * self.weak
        self.top = self.weighted.max(axis=(0, 2))
        self.top = np.where(self.top > 0.0, self.top, 1.0)
        self.high = self._power(POWER)
        self.total = self.high.sum(axis=(0, 2))
        self.values = self.top / SHARE * (self.total / (len(self.weighted) * PIECES)) ** (1.0 / POWER)

    def _power(self, power: int) -> Float[np.ndarray, "8 n pieces"]:
        """Strains, divided by the maximum of their arm, to a power of two, by repeated squaring."""
        out = self.weighted / self.top[:, None]
        while power > 1:
            out, power = out * out, power // 2
        return out

    def _weakness(self) -> tuple[np.ndarray | float, np.ndarray | float]:
        """Factor on a strain where the sheet is weaker in the section's direction, and its derivative by the angle to
        the grain."""
        known = self.bars.arms.material
        if known.orthotropy is None or known.orthotropy.strength is None:
            return 1.0, 0.0
        # stresses in arms hardly depend on the moduli, their strength depends on the grain
        angle = self.bars.grain[:, None] - np.angle(self.bars.tangent)
        return direction_share(known.orthotropy.strength, known.strength, angle)

    def slopes(self) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 9"]]:
        """Derivatives of the values by the wrenches and by the arms' parameters."""
        bars = self.bars
        by_axial, by_shear, by_weak = self._by_points()
        normal, torque, lift, turn, pull = self._by_sections(by_axial, by_shear)
        # the tangent splits moments in the plane into torque and lift
        moment = (torque + 1j * lift) * bars.tangent
        by_tangent = normal * self.force + torque * self.moment - 1j * lift * self.moment
        angle = (np.conj(1j * bars.tangent) * by_tangent).real - by_weak
        lever = 1j * self.up * moment - 1j * self.force * turn
        force = (normal * bars.tangent + 1j * turn * bars.lever).sum(1)
        whole = moment.sum(1)
        up = (np.conj(-1j * bars.lever) * moment).real.sum(1)
        by_wrench = np.stack([force.real, force.imag, up, whole.real, whole.imag, turn.sum(1)], axis=1)
        numbers = bars.pulled(replace(pull, lever=lever, angle=angle))
        return by_wrench, np.concatenate([numbers, by_weak.sum(1)[:, None]], axis=1)

    def _by_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of the values by the axial strains (8, n, pieces), by the shear of both sides and the faces (3,
        n, pieces), and by the angle to the grain (n, pieces)."""
        by = (self.values / np.maximum(self.total, 1e-300))[:, None] * self.high
        by_weak = (by / self.weak).sum(0) * self.weak_by
        by = by / np.maximum(self.principal, 1e-300)
        nu, own = self.bars.arms.material.poisson, self.axial[4:]
        by_axial = by * np.sign(self.axial)
        by_axial[4:] = by[4:] * own * (0.5 * (1.0 - nu) / self.size + (0.5 * (1.0 + nu)) ** 2 / self.root)
        sheared = by[4:] * 0.25 * self.sheared / self.root
        return by_axial, np.stack([sheared[0], sheared[1], sheared[2] + sheared[3]]), by_weak

    def _by_sections(
        self, by_axial: np.ndarray, by_shear: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, _Pull]:
        """Derivatives by normal force, torque, and bending moments out of the sheet and in it, and those by the bars."""
        arms, c, t = self.bars.arms, self.curvature, self.torsion
        youngs, height, width = arms.material.youngs, arms.thickness, self.bars.width
        flat, tilt = by_axial[0:2] + by_axial[2:4] + by_axial[4:6], by_axial[0:2] - by_axial[2:4]
        middle, over = by_axial[6] + by_axial[7], tilt / self.inner
        raised, warped = over.sum(0) + by_axial[6] - by_axial[7], over[1] - over[0]
        stretch = flat.sum(0) + middle
        in_plane = (flat * self.shape).sum(0) + middle * c.bend
        # derivative by the curvature times the width
        edge = _SIDES * 0.5 / self.inner
        shape_by = (1.0 / self.inner + self.shape * edge) * c.bend_by + edge / c.off**2 * c.off_by
        bend = self.in_plane * ((flat * shape_by).sum(0) + middle * c.bend_by)
        bend += (tilt * self.tilt * edge).sum(0) * c.bend_by - raised * self.raised / c.log * c.log_by
        aside = INNER_SHEAR * (by_shear[1] - by_shear[0])
        bend += aside * self.twisting * t.values[1] * c.bend_by
        # derivatives through shear and warping
        side = (by_shear[:2] * self.share).sum(0)
        change = warped * t.values[3] / self.way
        back = change @ _LAG_DIFFERENCE.T
        torque = self.softness * (side * t.values[1] + by_shear[2] * t.values[2]) + back * self.rate
        by_width = -(stretch * self.stretch + 2.0 * in_plane * self.in_plane + raised * self.raised) / width
        by_width += (
            self.twisting * (side * t.slopes[1] + by_shear[2] * t.slopes[2]) + warped * self.change * t.slopes[3]
        )
        by_width += back * self.torque * self.softness * t.slopes[0]
        area = youngs * width * height
        lift = raised * 6.0 / (area * height * c.log)
        none = np.zeros_like(bend)
        pull = _Pull(none.astype(complex), -(change * self.change) @ _LAG_LENGTH.T, by_width, bend, none)
        return stretch / area, torque, lift, in_plane / (area * width), pull


def _lag_matrices() -> tuple[Float[np.ndarray, "pieces pieces"], Float[np.ndarray, "pieces pieces"]]:
    """Matrices (pieces, pieces) that give, for values in rows, differences along the arm and the lengths they span.

    A difference is the value ``LAG`` pieces further out minus the value ``LAG`` pieces further in, fewer at the ends.
    """
    ahead, far = np.zeros((PIECES, PIECES)), np.zeros((PIECES, PIECES))
    for i in range(PIECES):
        out, inn = max(i - LAG, 0), min(i + LAG, PIECES - 1)
        ahead[[out, inn], i] += 1.0, -1.0
        far[out : inn + 1, i] = 1.0
        far[[out, inn], i] = 0.5
    return ahead, far


_LAG_DIFFERENCE, _LAG_LENGTH = _lag_matrices()
