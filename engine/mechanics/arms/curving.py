"""How joints answer to second order: what the curving of their arms adds to the strains of the arm model.

Two joined arms are one inextensible elastic curve x(s) from hub to hub (Kirchhoff). Its sections turn by a field of
rotation vectors phi(s), seen from the frame half way between the hubs, with phi = -turn/2 and +turn/2 at the ends. With

    curvature = phi' - phi x phi' / 2,     gap = integral of phi x dx + integral of phi x (phi x dx) / 2

to second order, and because the energy's third order needs the fields' first order alone (Wigner's 2n + 1 theorem), the
energy of a joint is e'.K e' / 2 with the corrected strains e' = e + e.D.e,

    shift' = shift - integral of phi x (phi x dx) / 2 - integral of (phi x phi') x l ds / 2
    turn'  = turn - integral of phi x phi' ds / 2

where l is the way from x to the middle between the hubs, and phi' = c (moment + l x force) with the compliance c of the
arm's section and the linear wrench K e.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Complex, Float
from ...materials import Material
from ...progress import SILENT, Progress
from ...spirals.spiral import curve, widths
from ..assembly import Assembly
from ..vectors import outer, skew
from .beams import torsion_constant
from .cut import CutArms
from .grain import Yielding

POINTS = 10  # of the Gauss quadrature: within 2e-8 of 20 points, on a dome, a saddle and a torus
BATCH = 128  # joints at a time, so that they stay in the processor's cache
_EYE = np.eye(3)  # without units
_X, _W = np.polynomial.legendre.leggauss(POINTS)
_NODES, _WEIGHTS = 0.5 * (_X + 1.0), 0.5 * _W  # on [0, 1]


def _running() -> Float[np.ndarray, "points points"]:
    """(POINTS, POINTS): integral from 0 to node i of the polynomial that is 1 at node j and 0 at the others."""
    legendre = np.polynomial.legendre
    series = [legendre.legint(one, lbnd=-1) for one in np.eye(POINTS)]
    integrals = 0.5 * np.stack([legendre.legval(_X, one) for one in series], axis=1)
    return integrals @ np.linalg.inv(legendre.legvander(_X, POINTS - 1))


_RUNNING = _running() / _WEIGHTS


@dataclass(frozen=True, eq=False)
class Arms:
    """What the arms of m joints are, each array (m, 2, ...): radius, width (m); twist (rad); compliance (6, 6) of the tip.

    begin : share of the radius where it begins to bend; slope, joint, share : of its blended end, as in ``CutArms``
    radial : (3, 3) columns along the radius outwards, to its left, normal; centre : (3,) m of the hub, seen from the
    middle between both hubs; all in the joint's axes, as is to_joint (m, 6, 6), from the strains between the centres to
    those at the joint. grain : radians from the radius to the grain, as in ``CutArms``
    thickness (m), material; side : 1, or -1 for clockwise arms
    """

    radius: Float[np.ndarray, "joints 2"]
    width: Float[np.ndarray, "joints 2"]
    twist: Float[np.ndarray, "joints 2"]
    begin: Float[np.ndarray, "joints 2"]
    slope: Complex[np.ndarray, "joints 2"]
    joint: Float[np.ndarray, "joints 2"]
    share: Float[np.ndarray, "joints 2"]
    compliance: Float[np.ndarray, "joints 2 6 6"]
    radial: Float[np.ndarray, "joints 2 3 3"]
    centre: Float[np.ndarray, "joints 2 3"]
    to_joint: Float[np.ndarray, "joints 6 6"]
    grain: Float[np.ndarray, "joints 2"]
    thickness: float
    material: Material
    side: float

    @classmethod
    def of(cls, assembly: Assembly, material: Material, compliance: np.ndarray) -> Arms:
        """``compliance`` in the arms' own axes."""
        lever = np.einsum("ekji,ekj->eki", assembly.axes, assembly.lever)
        middle = 0.5 * (lever[:, 0] + lever[:, 1])
        to_joint = np.broadcast_to(np.eye(6), (len(lever), 6, 6)).copy()
        to_joint[:, :3, 3:] = -skew(middle)
        cut = CutArms.of(assembly)
        begin, slope, joint, share = (v.reshape(-1, 2) for v in (cut.roots[1], cut.slope, cut.joint, cut.share))
        shape = (assembly.radius, assembly.arm_width, assembly.twist[assembly.pairs], begin, slope, joint, share)
        side, axes = -1.0 if assembly.clockwise else 1.0, assembly.arm_axes
        compliance = axes @ compliance @ np.swapaxes(axes, 2, 3)
        radial, centre = assembly.radial, middle[:, None] - lever
        rest = (assembly.to_grain, assembly.thickness, material, side)
        return cls(*shape, compliance, radial, centre, to_joint, *rest)

    def part(self, joints: slice) -> Arms:
        names = (
            "radius",
            "width",
            "twist",
            "begin",
            "slope",
            "joint",
            "share",
            "compliance",
            "radial",
            "centre",
            "to_joint",
            "grain",
        )
        return replace(self, **{name: getattr(self, name)[joints] for name in names})


@dataclass(frozen=True, eq=False)
class Stations:
    """Points along both arms of m joints, the hub's rim first; S = POINTS + 1.

    fields : (m, 2, 2, S, 3, 9) rotation of the section, seen half way, and its change over the station, both per wrench
    about the middle (6) and turn of the joint (3); step : (m, 2, S, 3) m, the way along the arm; arm : (m, 2, S, 3) m from
    the station to the middle. Steps and changes are signed: they go from hub to hub.
    """

    fields: Float[np.ndarray, "joints 2 2 stations 3 9"]
    step: Float[np.ndarray, "joints 2 stations 3"]
    arm: Float[np.ndarray, "joints 2 stations 3"]

    @classmethod
    def of(cls, arms: Arms) -> Stations:
        place, step, length, bend = _along(arms)
        arm = -(arms.centre[:, :, None] + place)
        # bend (moment + arm x force): a row of bend times the skew matrix of the arm is their cross product
        curve = np.empty((*bend.shape[:-1], 6))
        for k in range(3):
            after, last = (k + 1) % 3, (k + 2) % 3
            curve[..., k] = bend[..., after] * arm[..., last, None] - bend[..., last] * arm[..., after, None]
        curve[..., 3:] = bend
        # the solid's tip turns a little more or less than the beam's: what is left is spread along the arm
        back = np.swapaxes(np.linalg.inv(arms.to_joint), 1, 2)[:, None]
        left = arms.compliance[:, :, 3:] @ back - curve.sum(axis=2)
        curve += (length / length.sum(axis=2, keepdims=True))[..., None, None] * left[:, :, None]
        m, sign = len(place), np.array([1.0, -1.0])[:, None, None]
        fields = np.zeros((m, 2, 2, POINTS + 1, 3, 9))
        run = _RUNNING @ curve[:, :, 1:].reshape(m, 2, POINTS, 18)
        fields[:, :, 0, 1:, :, :6] = run.reshape(m, 2, POINTS, 3, 6)
        fields[:, :, 0, ..., 6:] = -0.5 * _EYE
        fields[:, :, 1, ..., :6] = sign[..., None] * curve
        return cls(fields, sign * step, arm)

    def bilinear(self, both: Float[np.ndarray, "joints 9 6"]) -> Float[np.ndarray, "joints 6 6 6"]:
        """(m, 6, 6, 6) D of both arms together, by the strains that make wrench and turn as in ``both``, in its last two places.

        With turns a, their changes k over a station, the station's step d and the lever l from it, D is half of the symmetric part of
        -(a (d.a') - d (a.a') + k (l.a') - a (l.k')), and of -(a x k'), summed over the stations.
        """
        m = len(both)
        turns, changes = (
            (self.fields[:, :, i].reshape(m, -1, 9) @ both).reshape(m, -1, 3, 6) for i in range(2)
        )  # (m, stations of both arms, 3, 6)
        step, lever = (x.reshape(m, -1, 3) for x in (self.step, self.arm))
        by_step, by_lever, changed = (
            (x[:, :, None] @ y)[:, :, 0] for x, y in ((step, turns), (lever, turns), (lever, changes))
        )
        squares = (step[:, :, None, :, None] * turns[:, :, :, None]).reshape(m, -1, 18)
        left = np.concatenate([turns.reshape(m, -1, 18), changes.reshape(m, -1, 18), squares], axis=1)
        right = np.concatenate([by_step - changed, by_lever, -turns.reshape(m, -1, 6)], axis=1)
        half = np.empty((m, 6, 6, 6))
        half[:, :3] = (left.swapaxes(1, 2) @ right).reshape(m, 3, 6, 6)
        products = turns.reshape(m, -1, 18).swapaxes(1, 2) @ changes.reshape(m, -1, 18)
        products = products.reshape(m, 3, 6, 3, 6)
        for i in range(3):
            after, last = (i + 1) % 3, (i + 2) % 3
            half[:, 3 + i] = products[:, after, :, last] - products[:, last, :, after]
        return -0.25 * (half + half.swapaxes(2, 3))


def second_order_strains(
    arms: Arms,
    at_joint: Float[np.ndarray, "joints 6 6"],
    lever: Float[np.ndarray, "joints 2 3"],
    progress: Progress = SILENT,
) -> Float[np.ndarray, "joints 6 6 6"]:
    """(m, 6, 6, 6) D, symmetric in its last two places: the second order, e' = e + e.D.e, of the joints' own motion.

    at_joint : (m, 6, 6) stiffness at the joint; lever : (m, 2, 3) m from the hubs to the points between which the shift is
    measured, in the joint's axes. Strains as in ``ArmModel``.
    """
    out = np.empty((len(at_joint), 6, 6, 6))
    for start in range(0, len(out), BATCH):
        progress(start / len(out), "Second order of the strains")
        part = slice(start, start + BATCH)
        some, apart = arms.part(part), 0.125 * (lever[part, 1] - lever[part, 0])
        found = Stations.of(some).bilinear(_both(some, at_joint[part])).reshape(-1, 6, 36)
        out[part] = (some.to_joint @ found).reshape(-1, 6, 6, 6)
        for k in range(3):
            out[part, :3, 3 + k, 3:] -= _twice(np.broadcast_to(_EYE[k], apart.shape), apart)
    return out


def _both(arms: Arms, at_joint: np.ndarray) -> Float[np.ndarray, "joints 9 6"]:
    """(m, 9, 6): wrench about the middle between the hubs, and turn, of strains at the joint."""
    turn = np.broadcast_to(np.eye(6)[3:], (len(at_joint), 3, 6))
    return np.concatenate([np.swapaxes(arms.to_joint, 1, 2) @ at_joint, turn], axis=1)


def _twice(turn: np.ndarray, way: np.ndarray) -> Float[np.ndarray, "joints 3 3"]:
    """(m, 3, 3): turn x (other x way) / 2 + other x (turn x way) / 2 as a matrix on ``other``."""
    return 0.5 * ((turn * way).sum(axis=-1)[..., None, None] * _EYE + outer(turn, way)) - outer(way, turn)


def _along(arms: Arms) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stations of both arms of every joint, in the joint's axes, the hub's rim first.

    Places (m, 2, S, 3) m seen from the hub's centre, steps (m, 2, S, 3) m outwards, lengths (m, 2, S) m that bend, and the
    turn per moment (m, 2, S, 3, 3) rad/(N m) over them.
    """
    radius, axes, begin = arms.radius[..., None], arms.radial[:, :, None], arms.begin[..., None]
    t = np.concatenate([1.0 - begin, (1.0 - begin) * (1.0 - _NODES)], axis=2)
    weight = np.concatenate([np.zeros_like(begin), (1.0 - begin) * _WEIGHTS], axis=2)
    share = arms.share[..., None]
    ways = curve(radius, np.zeros_like(radius), arms.twist[..., None], arms.slope[..., None], share, t)
    width = widths(arms.width[..., None], arms.joint[..., None], share, t)[0]

    def placed(way: np.ndarray) -> np.ndarray:
        return way.real[..., None] * axes[..., 0] + arms.side * way.imag[..., None] * axes[..., 1]

    speed = np.abs(ways[1])
    place, tangent, length = placed(ways[0]), placed(-ways[1] / speed), weight * speed
    step = length[..., None] * tangent
    step[:, :, 0] = place[:, :, 0]
    normal = np.broadcast_to(axes[..., 2], tangent.shape)
    aside = np.cross(normal, tangent)
    bend = np.zeros((*tangent.shape, 3))
    if arms.material.orthotropy is None:
        turns = _isotropic(arms, width, length)
    else:
        angle = arms.side * (arms.grain[..., None] - np.angle(-ways[1]))
        yields = Yielding.of(arms.material.orthotropy, angle, width, arms.thickness)
        turns = tuple(length * part[0] for part in (yields.twist, yields.lift, yields.bend))
        mixed = length * yields.coupled[0]
        for i in range(3):
            for j in range(i + 1):
                bend[..., i, j] += mixed * (tangent[..., i] * aside[..., j] + aside[..., i] * tangent[..., j])
    for scaled, axis in zip(turns, (tangent, aside, normal), strict=True):
        x = np.moveaxis(axis, -1, 0)
        for i in range(3):
            part = scaled * x[i]
            for j in range(i + 1):
                bend[..., i, j] += part * x[j]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        bend[..., i, j] = bend[..., j, i]
    return place, step, length, bend


def _isotropic(arms: Arms, width: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Turns of the stations' pieces per moment along the arm, out of the sheet and in it, rad/(N m)."""
    height, youngs = arms.thickness, arms.material.youngs
    torsion = torsion_constant(height / width)[0] * width**4 * 0.5 / (1.0 + arms.material.poisson)
    level, upright = width * height**3 / 12.0, height * width**3 / 12.0
    return length / (youngs * torsion), length / (youngs * level), length / (youngs * upright)


def curved(strains: np.ndarray, curving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Strains with their second order (m, 6), and the derivative (m, 6, 6) by the strains without; D is ``curving``."""
    half = (curving.reshape(-1, 36, 6) @ strains[..., None]).reshape(-1, 6, 6)
    return strains + (half @ strains[..., None])[..., 0], np.eye(6) + 2.0 * half


def weighted(wrench: Float[np.ndarray, "joints 6"], curving: np.ndarray) -> Float[np.ndarray, "joints 6 6"]:
    """(m, 6, 6): the sum over the strains of a wrench (m, 6) times D."""
    return (wrench[:, None] @ curving.reshape(-1, 6, 36)).reshape(-1, 6, 6)


def moved_curving(curving: np.ndarray, offset: Float[np.ndarray, "joints 3"]) -> np.ndarray:
    """D (m, 6, 6, 6) of the motion of another point of the same frame, which lies ``offset`` (m, 3) m before the old one."""
    out, across = curving.copy(), skew(offset)[:, None]
    # turns about another point come with shifts, in both places of the motion and in what comes out
    out[..., 3:] -= out[..., :3] @ across
    out[..., 3:, :] += across @ out[..., :3, :]
    out[:, :3] += (across[:, 0] @ out[:, 3:].reshape(-1, 3, 36)).reshape(-1, 3, 6, 6)
    return out
