"""Second-order term D of the joints' strains in the arm model, which comes from the curving of the joints' arms.

The strains e of a joint are its six motions, the shift and the turn of the second hub against the first, and K is its
stiffness. Two joined arms form one inextensible elastic curve x(s) from hub to hub (Kirchhoff). Its sections rotate by
vectors phi(s), in the frame half way between the hubs, with phi = -turn/2 and +turn/2 at the ends. To second order, the
change of curvature of the curve and the shift between the hubs are (dphi is the derivative of phi by s)

    curvature = dphi - phi x dphi / 2,     shift = integral of phi x dx + integral of phi x (phi x dx) / 2.

To compute the energy to third order in e, phi is needed only to first order (Wigner's 2n + 1 theorem). So the energy of
a joint is E.K E / 2 with the corrected strains E = e + e.D.e, whose components are

    corrected shift = shift - integral of phi x (phi x dx) / 2 - integral of (phi x dphi) x l ds / 2
    corrected turn  = turn - integral of phi x dphi ds / 2

where l is the vector from x to the midpoint of the hubs, and dphi = c (moment + l x force), with the flexibility c of
the arm's section per length and the force and moment K e.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Columns, Complex, Float
from ...materials import Material
from ...progress import SILENT, Progress
from ...spirals.curves.spiral import arm_widths, curve_points
from ..assembly import Assembly
from ..vectors import outer, skew
from .beams import torsion_constant
from .cut import CutArms
from .grain import SectionFlexibility
from .stacked import BATCH

POINTS = 10  # number of Gauss points along an arm; more are slower and more exact (error 2e-8)
_EYE = np.eye(3)  # the identity
_X, _W = np.polynomial.legendre.leggauss(POINTS)
_NODES, _WEIGHTS = 0.5 * (_X + 1.0), 0.5 * _W  # Gauss quadrature on [0, 1]


def _integration_matrix() -> Float[np.ndarray, "points points"]:
    """Return the matrix that integrates functions on [0, 1] from 0 to every Gauss node, from their values at the nodes.

    Entry (i, j) is the integral from 0 to node i of the polynomial that is 1 at node j and 0 at the other nodes.
    """
    legendre = np.polynomial.legendre
    series = [legendre.legint(one, lbnd=-1) for one in np.eye(POINTS)]
    integrals = 0.5 * np.stack([legendre.legval(_X, one) for one in series], axis=1)
    return integrals @ np.linalg.inv(legendre.legvander(_X, POINTS - 1))


_INTEGRATION = _integration_matrix() / _WEIGHTS


@dataclass(frozen=True, eq=False)
class CurvedArms(Columns):
    """Both arms of m joints. Arrays have the shape (m, 2, ...), except ``to_joint``.

    radius, width : metres; twist : radians
    begin : distance from the hub's centre to where the arm begins to bend, as a share of the radius
    slope, joint, share : blend of the outer end, as in ``CutArms``
    compliance : (m, 2, 6, 6) compliance of the tip, in the joint's axes
    radial : (m, 2, 3, 3) three columns in the joint's axes: unit vectors from the hub to the tip, to the left of that,
        and along the normal
    centre : (m, 2, 3) vector from the midpoint of both hubs to this arm's hub, in the joint's axes, metres
    to_joint : (m, 6, 6) matrices that convert motions (shift, turn) measured at the midpoint of both hubs to motions
        measured at the joint, all in the joint's axes
    grain : (m, 2) angles from the radius to the grain, radians, as in ``CutArms``
    thickness : of the sheet, metres
    side : 1, or -1 for arms that wind clockwise
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
    def from_assembly(cls, assembly: Assembly, material: Material, compliance: np.ndarray) -> CurvedArms:
        """Collect the arms of an assembly.

        compliance : (m, 2, 6, 6) compliances of the arms' tips, in the arms' own axes
        """
        lever = np.einsum("ekji,ekj->eki", assembly.axes, assembly.lever)
        middle = 0.5 * (lever[:, 0] + lever[:, 1])
        to_joint = np.broadcast_to(np.eye(6), (len(lever), 6, 6)).copy()
        to_joint[:, :3, 3:] = -skew(middle)
        cut = CutArms.from_assembly(assembly)
        begin, slope, joint, share = (v.reshape(-1, 2) for v in (cut.roots[1], cut.slope, cut.joint, cut.share))
        shape = (assembly.radius, assembly.arm_width, assembly.twist[assembly.pairs], begin, slope, joint, share)
        side, axes = -1.0 if assembly.clockwise else 1.0, assembly.arm_axes
        compliance = axes @ compliance @ np.swapaxes(axes, 2, 3)
        radial, centre = assembly.radial, middle[:, None] - lever
        rest = (assembly.grain_angles, assembly.thickness, material, side)
        return cls(*shape, compliance, radial, centre, to_joint, *rest)


@dataclass(frozen=True, eq=False)
class Stations:
    """S = POINTS + 1 stations along both arms of m joints, from the edge of the hub outwards.

    Station 0 stands for the rigid hub, the others are Gauss nodes, which each stand for a part of the arm's length.
    "Over a station" means over that part, in the direction from the joint's first hub to its second. Vectors are in the
    frame half way between the hubs.

    fields : (m, 2, 2, S, 3, 9) derivatives of the sections' rotation vectors. Axes of the array: joint; arm; 0 for the
        rotation vector and 1 for its change over the station; station; component; variable: the wrench about the
        midpoint of the hubs (6), then the joint's turn (3)
    step : (m, 2, S, 3) metres, vector along the arm over the station
    arm : (m, 2, S, 3) metres, vector from the station to the midpoint of the hubs
    """

    fields: Float[np.ndarray, "joints 2 2 stations 3 9"]
    step: Float[np.ndarray, "joints 2 stations 3"]
    arm: Float[np.ndarray, "joints 2 stations 3"]

    @classmethod
    def from_arms(cls, arms: CurvedArms) -> Stations:
        """Place the stations on the arms and compute ``fields``."""
        place, step, length, bend = _stations_along(arms)
        arm = -(arms.centre[:, :, None] + place)
        # ``curve`` maps a force and a moment to bend @ (moment + arm x force), the bend over a station. Its first three
        # columns are bend @ skew(arm), written as cross products
        curve = np.empty((*bend.shape[:-1], 6))
        for k in range(3):
            after, last = (k + 1) % 3, (k + 2) % 3
            curve[..., k] = bend[..., after] * arm[..., last, None] - bend[..., last] * arm[..., after, None]
        curve[..., 3:] = bend
        # The arm model's compliances contain hubs and table, so its tip turns a little more or less per wrench than the
        # tip of the beam of these stations. Spread the difference along the arm
        back = np.swapaxes(np.linalg.inv(arms.to_joint), 1, 2)[:, None]
        left = arms.compliance[:, :, 3:] @ back - curve.sum(axis=2)
        curve += (length / length.sum(axis=2, keepdims=True))[..., None, None] * left[:, :, None]
        m, sign = len(place), np.array([1.0, -1.0])[:, None, None]
        fields = np.zeros((m, 2, 2, POINTS + 1, 3, 9))
        run = _INTEGRATION @ curve[:, :, 1:].reshape(m, 2, POINTS, 18)
        fields[:, :, 0, 1:, :, :6] = run.reshape(m, 2, POINTS, 3, 6)
        fields[:, :, 0, ..., 6:] = -0.5 * _EYE
        fields[:, :, 1, ..., :6] = sign[..., None] * curve
        return cls(fields, sign * step, arm)

    def bilinear(self, both: Float[np.ndarray, "joints 9 6"]) -> Float[np.ndarray, "joints 6 6 6"]:
        """Return D (m, 6, 6, 6) of both arms together, symmetric in its last two indices.

        D[m, :, i, j] is the second-order strain per strains i and j. Let a(i) be a station's rotation vector per strain
        i, k(i) its change over the station, d the station's step and l the vector ``arm``. D is the sum over the
        stations of half of the symmetric part, in i and j, of

            -(a(i) (d.a(j)) - d (a(i).a(j)) + k(i) (l.a(j)) - a(i) (l.k(j)))   for the shift
            -(a(i) x k(j))                                                    for the turn

        both : (m, 9, 6) derivatives of the variables of ``fields`` (wrench, then turn) with respect to the six strains
        """
        m = len(both)
        # a and k of the docstring, (m, 2 S, 3, 6); axes: joint, station of either arm, component, strain
        turns, changes = ((self.fields[:, :, i].reshape(m, -1, 9) @ both).reshape(m, -1, 3, 6) for i in range(2))
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
    arms: CurvedArms,
    at_joint: Float[np.ndarray, "joints 6 6"],
    lever: Float[np.ndarray, "joints 2 3"],
    progress: Progress = SILENT,
) -> Float[np.ndarray, "joints 6 6 6"]:
    """Return the second-order term D (m, 6, 6, 6) of the joints' motions, symmetric in its last two indices.

    Parameters
    ----------
    arms : both arms of m joints
    at_joint : (m, 6, 6) stiffness of the joints against their motions, as in ``ArmModel``
    lever : (m, 2, 3) vectors from the two hubs to the two points (one fixed to each hub) between which the shift is
        measured, in the joint's axes, metres
    progress : is updated and can cancel
    """
    out = np.empty((len(at_joint), 6, 6, 6))
    for start in range(0, len(out), BATCH):
        progress(start / len(out), "Computing second-order strains")
        part = slice(start, start + BATCH)
        some, apart = arms.subset(part), 0.125 * (lever[part, 1] - lever[part, 0])
        found = Stations.from_arms(some).bilinear(_wrench_and_turn(some, at_joint[part])).reshape(-1, 6, 36)
        out[part] = (some.to_joint @ found).reshape(-1, 6, 6, 6)
        for k in range(3):
            out[part, :3, 3 + k, 3:] -= _double_cross(np.broadcast_to(_EYE[k], apart.shape), apart)
    return out


def _wrench_and_turn(arms: CurvedArms, at_joint: np.ndarray) -> Float[np.ndarray, "joints 9 6"]:
    """Return the matrices (m, 9, 6) that map the motion of a joint to its wrench about the midpoint of both hubs (6)
    and its turn (3).

    at_joint : (m, 6, 6) stiffness of the joints, as in ``ArmModel``
    """
    turn = np.broadcast_to(np.eye(6)[3:], (len(at_joint), 3, 6))
    return np.concatenate([np.swapaxes(arms.to_joint, 1, 2) @ at_joint, turn], axis=1)


def _double_cross(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, "joints 3 3"]:
    """Return the matrices (m, 3, 3) that map a vector v to a x (v x b) / 2 + v x (a x b) / 2, for a and b (m, 3)."""
    return 0.5 * ((a * b).sum(axis=-1)[..., None, None] * _EYE + outer(a, b)) - outer(b, a)


def _stations_along(arms: CurvedArms) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Place the S stations of both arms of every joint, from the edge of the hub outwards, in the joint's axes.

    Returns
    -------
    (m, 2, S, 3) : positions of the stations relative to the hub's centre, metres
    (m, 2, S, 3) : vectors along the arm over the stations, outwards, metres
    (m, 2, S) : elastic lengths for which the stations stand, metres; 0 for station 0, the rigid hub
    (m, 2, S, 3, 3) : bends (rotation vectors) of these lengths per moment, rad/(N m)
    """
    radius, axes, begin = arms.radius[..., None], arms.radial[:, :, None], arms.begin[..., None]
    t = np.concatenate([1.0 - begin, (1.0 - begin) * (1.0 - _NODES)], axis=2)
    weight = np.concatenate([np.zeros_like(begin), (1.0 - begin) * _WEIGHTS], axis=2)
    share = arms.share[..., None]
    ways = curve_points(radius, np.zeros_like(radius), arms.twist[..., None], arms.slope[..., None], share, t)
    width = arm_widths(arms.width[..., None], arms.joint[..., None], share, t)[0]

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
        turns = _isotropic_turns(arms, width, length)
    else:
        angle = arms.side * (arms.grain[..., None] - np.angle(-ways[1]))
        yields = SectionFlexibility.evaluate(arms.material.orthotropy, angle, width, arms.thickness)
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


def _isotropic_turns(
    arms: CurvedArms, width: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the bends per moment, rad/(N m), of pieces of an isotropic sheet with these widths and lengths in metres.

    Three arrays: in torsion, in bending out of the sheet, in bending in the sheet.
    """
    height, youngs = arms.thickness, arms.material.youngs
    torsion = torsion_constant(height / width)[0] * width**4 * 0.5 / (1.0 + arms.material.poisson)
    level, upright = width * height**3 / 12.0, height * width**3 / 12.0
    return length / (youngs * torsion), length / (youngs * level), length / (youngs * upright)


def add_second_order(strains: np.ndarray, curving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corrected strains e + e.D.e (m, 6), and their derivatives (m, 6, 6) with respect to the strains e.

    curving : (m, 6, 6, 6) D
    """
    half = (curving.reshape(-1, 36, 6) @ strains[..., None]).reshape(-1, 6, 6)
    return strains + (half @ strains[..., None])[..., 0], np.eye(6) + 2.0 * half


def contract_with_wrench(wrench: Float[np.ndarray, "joints 6"], curving: np.ndarray) -> Float[np.ndarray, "joints 6 6"]:
    """Contract D, ``curving`` (m, 6, 6, 6), over its component index with wrenches (m, 6); returns (m, 6, 6)."""
    return (wrench[:, None] @ curving.reshape(-1, 6, 36)).reshape(-1, 6, 6)


def transfer_second_order(curving: np.ndarray, offset: Float[np.ndarray, "joints 3"]) -> np.ndarray:
    """Convert D between strains that are measured about different points.

    Parameters
    ----------
    curving : (m, 6, 6, 6) D for strains whose shift is measured at an old point
    offset : (m, 3) metres, vector from the point of the result to the old point, in the joint's axes
    """
    out, across = curving.copy(), skew(offset)[:, None]
    # A turn about one point shifts the other point. So both the strains with which D is multiplied (last two axes) and
    # the strains that result (axis 1) are converted
    out[..., 3:] -= out[..., :3] @ across
    out[..., 3:, :] += across @ out[..., :3, :]
    out[:, :3] += (across[:, 0] @ out[:, 3:].reshape(-1, 3, 36)).reshape(-1, 3, 6, 6)
    return out
