"""Difference in compliance between a cut arm and the stiffness table's arm, with exact derivatives.

The table holds pure spirals with fillets of a standard size, in spirals of four equal arms. A cut arm differs in two
ways: its end is blended with the arm beyond its joint (see ``spirals.curves.blends``), and its root lies where its
neighbours' widths and the fillets of the settings put it. Both differences are integrals along beams, as in ``beams``:

    + blended arm - pure spiral, over the blended part of t,
    - pure spiral, from the root that its own width would give to its true root.

Levers reach from every station to the tip. The tip is where the stiffness table has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...arrays import Columns, Complex, Float
from ...materials import Material
from ...spirals.clearance.table_range import SCALE_RANGE
from ...spirals.curves import arm_formulas
from ...spirals.curves.blends import MATE_LEAN, MATE_WIND, OWN_LEAN, OWN_WIDTH, OWN_WIND, RADIUS, blend_joints
from ...spirals.curves.blends import MATE_WIDTH as BY_MATE_WIDTH
from ..assembly import Assembly
from .beams import SHEAR_FACTOR, gauss, torsion_constant
from .grain import SectionFlexibility, line_compliance
from .stacked import BATCH
from .stations import product, spiral_stations, sum_products
from .stiffness import ENTRIES, IN_PLANE, OUT_OF_PLANE, SHORTEST

# Design parameters on which the compliance of an arm depends: its own width and twist, the mean width of its two
# neighbours in the spiral, and width and twist of its mate, the arm beyond the joint.
WIDTH, TWIST, BESIDE, MATE_WIDTH, MATE_TWIST = range(5)
N_CUT_PARAMETERS = 5  # number of these parameters
# rows in derivative arrays: the value, then the parameters on which a blended end depends
_BLEND_ROWS = [0, 1 + WIDTH, 1 + TWIST, 1 + MATE_WIDTH, 1 + MATE_TWIST]
_ROOT_ROWS = [0, 1 + WIDTH, 1 + TWIST, 1 + BESIDE]  # rows of the value, then of the parameters on which a root depends
# parameters of ``blend_joints`` in the columns of ``CutArms.slope_by``: first the design, then the rest shape
_END_COLUMNS = [OWN_WIDTH, OWN_WIND, BY_MATE_WIDTH, MATE_WIND, RADIUS, OWN_LEAN, MATE_LEAN]
_BY_DESIGN, _BY_SHAPE = slice(4), slice(4, 7)  # the columns above of the design, and of the rest shape
SHAPE_RADIUS, SHAPE_LEAN, SHAPE_MATE_LEAN, SHAPE_GRAIN = range(4)  # columns of ``rest_shapes``

# rows and columns of the nonzero entries in the lower triangle of a compliance
_NONZERO = [(rows[i], rows[j]) for rows in (IN_PLANE, OUT_OF_PLANE) for i, j in ENTRIES]

# distance from hub centre to root, where an arm begins to bend, in its neighbours' widths; larger makes arms stiffer,
# with little effect
ROOT_DISTANCE = 0.55
# largest distance of a root from the hub's centre, as a share of the radius; larger would let roots overlap blends,
# which cover up to 0.7 of an arm; only arms that cannot be cut reach it
MAX_ROOT_SHARE = 0.3
# Largest share of the table's compliance that may be subtracted from an arm, and largest scale over width at which this
# is checked. A larger share may leave very stiff arms; a larger ratio is slower. Arms that can be cut stay below both.
MAX_REDUCTION, STUB_RATIO = 0.9, 10.0
TABLE_FILLET = 0.04  # fillet radius of the stiffness table's spirals, in arm widths
# length by which a fillet shortens an arm, in fillet radii; larger makes arms stiffer; solids of straight arms: 0.57
FILLET_REACH = 0.55
POINTS = 8  # Gauss points over the blend; more are slower and more exact (error 4e-6)
ROOT_POINTS = 3  # Gauss points between the two roots; more are slower and more exact (error 4e-6)


@dataclass(frozen=True, eq=False)
class CutArms(Columns):
    """N arms as they are cut, in their own axes: along the radius to the tip, and to the side to which they wind in.

    radius, width, twist : metres and radians; beside : metres, mean width of both neighbours in the spiral
    fillet : metres, fillet radius minus the table's fillet radius; fillet_by : its derivative with respect to the width
    slope, joint, share : ``slope``, ``width`` and ``share`` of ``spirals.curves.blends.Blends``, in these axes
    grain : radians from the radius to the grain, 0 for sheets without a grain
    slope_by, joint_by, share_by : (N, 7) derivatives with respect to own width and twist, mate's width and twist,
        radius, own lean and mate's lean
    """

    radius: Float[np.ndarray, " n"]
    width: Float[np.ndarray, " n"]
    twist: Float[np.ndarray, " n"]
    beside: Float[np.ndarray, " n"]
    fillet: Float[np.ndarray, " n"]
    fillet_by: Float[np.ndarray, " n"]
    slope: Complex[np.ndarray, " n"]
    joint: Float[np.ndarray, " n"]
    share: Float[np.ndarray, " n"]
    slope_by: Complex[np.ndarray, "n 7"]
    joint_by: Float[np.ndarray, "n 7"]
    share_by: Float[np.ndarray, "n 7"]
    grain: Float[np.ndarray, " n"]

    @classmethod
    def from_assembly(cls, assembly: Assembly, shape: Float[np.ndarray, "n _"] | None = None) -> CutArms:
        """Collect the arms of all joints, in the order 2 * joint + (0 or 1); ``shape`` replaces ``rest_shapes``."""
        pairs, sides = assembly.pairs, assembly.sides
        width, twist = assembly.arm_width, assembly.twist[pairs]
        beside = 0.5 * (assembly.width[pairs, (sides + 1) % 4] + assembly.width[pairs, (sides - 1) % 4])
        shape, cut = rest_shapes(assembly) if shape is None else shape, assembly.cut
        radius, leans = shape[:, 0], shape[:, 1:3]
        grain = shape[:, 3] if shape.shape[1] > 3 else np.zeros(len(radius))
        known = (radius, width.ravel(), twist.ravel(), beside.ravel())
        if cut is None:
            n, none = len(radius), np.zeros((len(radius), 7))
            pure = (np.zeros(n, dtype=complex), known[1], np.ones(n), none.astype(complex), none, none)
            return cls(*known, np.zeros(n), np.zeros(n), *pure, grain)
        if assembly.nodes:
            ties, twist = assembly.tie_joints, twist.copy()
            twist[ties, 1] = -twist[ties, 0]  # the mate of an arm at a rim is its mirror image
        widths, twists = (_with_mates(v) for v in (width, twist))
        end = blend_joints(widths, twists, leans, radius, np.zeros_like(radius), cut.blend)
        slope_by, joint_by, share_by = (by[:, _END_COLUMNS] for by in (end.slope_by, end.width_by, end.share_by))
        fillet = cut.fillet - TABLE_FILLET * known[1], np.full(len(radius), -TABLE_FILLET)
        return cls(*known, *fillet, end.slope, end.width, end.share, slope_by, joint_by, share_by, grain)

    @property
    def roots(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Distances from the hub's centre to the root, of the table's arms and of these arms, over the radius."""
        own = ROOT_DISTANCE * self.width / self.radius
        moved = ROOT_DISTANCE * self.beside + FILLET_REACH * self.fillet
        return np.minimum(own, MAX_ROOT_SHARE), np.minimum(moved / self.radius, MAX_ROOT_SHARE)


def rest_shapes(assembly: Assembly, material: Material | None = None) -> Float[np.ndarray, "n _"]:
    """Return the rest shapes (2 m, 3) of all arms: radius (metres), own lean and mate's lean (radians).

    A lean is the angle from the quad's outward normal at the joint to the arm's radius, positive in the sense in which
    the arms wind; the mate is the arm beyond the joint. Sheets with a grain add a column: radians from radius to grain.
    """
    out = assembly.radial[..., 0] * np.array([1.0, -1.0])[:, None]
    lean = np.arctan2(out[..., 1], out[..., 0]) * (-1.0 if assembly.clockwise else 1.0)
    if assembly.nodes:
        ties = assembly.tie_joints
        lean[ties, 1], lean[ties.stop :] = -lean[ties, 0], 0.0
    found = np.column_stack([assembly.radius.ravel(), _with_mates(lean)])
    if material is None or material.orthotropy is None:
        return found
    return np.column_stack([found, assembly.grain_angles.ravel()])


def _with_mates(values: Float[np.ndarray, "joints 2"]) -> Float[np.ndarray, "n 2"]:
    """Return the values (2 m, 2) of both arms of every joint, each followed by the value of its mate."""
    return np.stack([values, values[:, ::-1]], axis=-1).reshape(-1, 2)


def added_compliance_by_shape(
    assembly: Assembly, table: Float[np.ndarray, "n 6 6"], material: Material
) -> Float[np.ndarray, "n _ 6 6"]:
    """Differentiate the compliance that the cut adds to the table's by the ``rest_shapes`` of every arm.

    The factor of ``reduction_factors`` counts as constant.

    Parameters
    ----------
    assembly, material : m joints, and the sheet
    table : (2 m, 6, 6) the table's compliances

    Returns
    -------
    (2 m, k, 6, 6) : by the k columns of ``rest_shapes``
    """
    shape = rest_shapes(assembly, material)
    n, count = len(shape), shape.shape[1]
    value, by = np.zeros((n, 6, 6)), np.zeros((n, count, 6, 6))
    arms = CutArms.from_assembly(assembly, shape)
    rows = list(range(1 + count))
    for start in range(0, n, BATCH):
        part = slice(start, start + BATCH)
        some = arms.subset(part)
        root = [0, 1, *rows[1 + SHAPE_GRAIN :]]
        lines: list[tuple[float, list[int], _Line]] = [(-1.0, root, _root_line(some, False))]
        if _any_blend(some):
            lines += zip((1.0, -1.0), (rows, rows), _blend_lines(some, _BY_SHAPE), strict=True)
        found = _sum_lines(some, lines, 1 + count, assembly.thickness, material)
        fade, _, fade_by = _fade_factor(some)
        found[:, 1] = found[:, 1] * fade + found[:, 0] * fade_by
        found[:, [0, *rows[2:]]] *= fade
        for (i, j), entry in zip(_NONZERO, found, strict=True):
            value[part, i, j] = value[part, j, i] = entry[0]
            by[part, :, i, j] = by[part, :, j, i] = entry[1:].T
    return by * reduction_factors(arms, table, value)[:, None, None, None]


def added_compliance(
    arms: CutArms, thickness: float, material: Material, slopes: bool = True
) -> tuple[Float[np.ndarray, "n 6 6"], Float[np.ndarray, "n numbers 6 6"]]:
    """Return the compliance of N cut arms minus the table's compliance, SI, and derivatives by the design parameters.

    The difference fades to zero for arms hardly longer than wide.

    Parameters
    ----------
    arms, thickness, material : the arms, and their sheet (metres)
    slopes : compute the derivatives; otherwise they are zero

    Returns
    -------
    (N, 6, 6) and (N, 5, 6, 6) : rows and columns as in ``ArmCompliance``; derivatives by the ``N_CUT_PARAMETERS``
        parameters above, per metre and per radian
    """
    n, kept = len(arms.radius), slice(None if slopes else 1)
    value, by = np.zeros((n, 6, 6)), np.zeros((n, N_CUT_PARAMETERS, 6, 6))
    for start in range(0, n, BATCH):
        part = slice(start, start + BATCH)
        some = arms.subset(part)
        lines = [(-1.0, _ROOT_ROWS[kept], _root_line(some))]
        if _any_blend(some):
            lines += zip((1.0, -1.0), (_BLEND_ROWS[kept], _BLEND_ROWS[kept]), _blend_lines(some), strict=True)
        found = _sum_lines(some, lines, N_CUT_PARAMETERS + 1, thickness, material)
        fade, fade_by, _ = _fade_factor(some)
        if slopes:
            found[:, 1 + WIDTH] = found[:, 1 + WIDTH] * fade + found[:, 0] * fade_by
            found[:, 2 + WIDTH :] *= fade
        found[:, 0] *= fade
        for (i, j), entry in zip(_NONZERO, found, strict=True):
            value[part, i, j] = value[part, j, i] = entry[0]
            if slopes:
                by[part, :, i, j] = by[part, :, j, i] = entry[1:].T
    return value, by


def _any_blend(arms: CutArms) -> bool:
    """Return whether the end of any arm is blended with an arm beyond its joint, and so differs from a pure spiral."""
    return bool(arms.slope.any() or (arms.joint != arms.width).any())


def _sum_lines(
    arms: CutArms, lines: list[tuple[float, list[int], _Line]], count: int, thickness: float, material: Material
) -> Float[np.ndarray, "12 count n"]:
    """Add up the tip compliances of lines on N arms.

    lines : sign, rows of the result in which value and derivatives belong, and the line itself; count : number of rows

    Returns an array (12, count, N): entries in the order of ``_NONZERO``, value and derivatives, arms.
    """
    out = np.zeros((len(_NONZERO), count, len(arms.radius)))
    for sign, rows, line in lines:
        place, pace, width, weight = (part[: len(rows)] for part in line)
        if material.orthotropy is None:
            out[:, rows] += sign * _line_compliance(place, pace, width, weight, thickness, material)
            continue
        turned = {k - 1: 1.0 for k, row in enumerate(rows) if row == 1 + SHAPE_GRAIN and count == 2 + SHAPE_GRAIN}
        grain = _dual(arms.grain[None], turned, len(place) - 1)
        of = partial(SectionFlexibility.evaluate, material.orthotropy)
        out[:, rows] += sign * line_compliance(place, pace, width, weight, grain, thickness, of)
    return out


def reduction_factors(
    arms: CutArms, table: Float[np.ndarray, "n 6 6"], more: Float[np.ndarray, "n 6 6"]
) -> Float[np.ndarray, " n"]:
    """Return the factors (N,) on the added compliance ``more`` that keep the sum positive; 1 for arms that can be cut.

    At most ``MAX_REDUCTION`` of the table's compliance is subtracted. The compliance of tightly wound stubs in the
    table is far smaller than a beam's, so a difference of beams may exceed it.

    Parameters
    ----------
    arms : N arms
    table, more : (N, 6, 6) the table's compliances, and the compliances to add
    """
    out = np.ones(len(table))
    short = np.flatnonzero(2.0 * arms.radius < STUB_RATIO * arms.width)
    root = np.linalg.inv(np.linalg.cholesky(table[short]))
    least = np.linalg.eigvalsh(root @ more[short] @ np.swapaxes(root, 1, 2))[:, 0]
    out[short] = np.minimum(1.0, MAX_REDUCTION / np.maximum(-least, MAX_REDUCTION))
    return out


# S stations on N arms: position relative to the tip (complex), its derivative by t (complex), width, quadrature weight
# in t. Each is (1 + P, S, N): a value and its derivatives by P parameters. A constant width may be (1 + P, 1, N).
_Line = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _dual(value: np.ndarray, by: Mapping[int, np.ndarray | float], count: int) -> np.ndarray:
    """Stack a value and its derivatives by ``count`` parameters: the derivatives in ``by``, zero for all others."""
    out = np.zeros((1 + count, *value.shape), dtype=value.dtype)
    out[0] = value
    for k, change in by.items():
        out[1 + k] = change
    return out


def _blend_lines(arms: CutArms, by: slice = _BY_DESIGN) -> tuple[_Line, _Line]:
    """Return lines over the ends of arms, blended and as pure spirals; ``by`` : ``_BY_DESIGN`` or ``_BY_SHAPE``."""
    x, w = gauss(POINTS)
    of_design, n = by == _BY_DESIGN, len(arms.radius)
    behind = np.zeros((0 if of_design else 1, n))  # the shape of a blended end does not depend on the grain
    share, joint, slope = (
        np.concatenate([v[None], change[:, by].T, behind])[:, None]
        for v, change in ((arms.share, arms.share_by), (arms.joint, arms.joint_by), (arms.slope, arms.slope_by))
    )
    x, w = x[:, None], w[:, None]
    t, weight = share * x, share * w
    place, pace, width = _pure_spirals(arms, t, of_design)
    bent, speed = (
        place + product(slope, share) * arm_formulas.blend_quintic(x),
        pace + slope * arm_formulas.blend_quintic_slope(x),
    )
    return (bent, speed, width + (joint - width) * arm_formulas.fade_out(x), weight), (place, pace, width, weight)


def _root_line(arms: CutArms, of_design: bool = True) -> _Line:
    """Return lines on pure spirals from the table's to the true roots, differentiated by design or radius and grain."""
    x, w = gauss(ROOT_POINTS)
    radius = arms.radius
    first, last = arms.roots
    by_first, by_last = {0: -first / radius}, {0: -last / radius}
    if of_design:
        by_first = {WIDTH: ROOT_DISTANCE / radius}
        by_last = {WIDTH: FILLET_REACH * arms.fillet_by / radius, BESIDE: ROOT_DISTANCE / radius}
    count = 3 if of_design else 2
    own, true = (
        _dual(root, {k: np.where(root < MAX_ROOT_SHARE, v, 0.0) for k, v in by.items()}, count)
        for root, by in ((first, by_first), (last, by_last))
    )
    way = (true - own)[:, None]
    t = -(own[:, None] + way * x[:, None])
    t[0] += 1.0
    return *_pure_spirals(arms, t, of_design), way * w[:, None]


def _pure_spirals(arms: CutArms, t: np.ndarray, of_design: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions on spirals without blends, their derivatives by t, and widths, differentiated like ``t``."""
    place, pace = spiral_stations(
        arms.radius, arms.twist, t, **({"by_twist": 1 + TWIST} if of_design else {"by_radius": 1})
    )
    return place, pace, _dual(arms.width[None], {WIDTH: 1.0} if of_design else {}, len(t) - 1)


def _fade_factor(arms: CutArms) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a factor (N,) on the cut's correction, with derivatives by width and radius.

    It is 1 within the table's range of scale over width, and falls to 0 at ``SHORTEST``.
    """
    ratio, span = 2.0 * arms.radius / arms.width, SCALE_RANGE[0] - SHORTEST
    s = np.clip((ratio - SHORTEST) / span, 0.0, 1.0)
    slope = 6.0 * s * (1.0 - s) / span * ratio
    return s * s * (3.0 - 2.0 * s), -slope / arms.width, slope / arms.radius


def _line_compliance(
    place: np.ndarray, pace: np.ndarray, width: np.ndarray, weight: np.ndarray, height: float, material: Material
) -> Float[np.ndarray, "12 numbers n"]:
    """Return the tip compliance of a ``_Line``: entries ``_NONZERO``, with derivatives (``beams.path_integrals``)."""
    x, y = -place.real, -place.imag
    speed = np.abs(pace[0])
    # velocity and its derivatives, split into parts along the velocity (real) and across it (imaginary)
    along = pace * (np.conj(pace[0]) / speed)
    unit = 1j * along.imag * (pace[0] / speed**2)
    unit[0] = pace[0] / speed
    tx, ty = unit.real, unit.imag
    length = product(weight, np.concatenate([speed[None], along.real[1:]]))
    lever, torque = product(x, tx) + product(y, ty), product(y, tx) - product(x, ty)

    stretch, bend, lift, twist = _flexibilities(width, length, height, material)
    shear = 2.0 * SHEAR_FACTOR * (1.0 + material.poisson)

    sx, sy = product(stretch, tx), product(stretch, ty)
    xx, xy, yy = sum_products(sx, tx), sum_products(sx, ty), sum_products(sy, ty)
    bx, by = product(bend, x), product(bend, y)
    inside = (
        sum_products(by, y) + xx + shear * yy,
        (1.0 - shear) * xy - sum_products(by, x),
        sum_products(bx, x) + yy + shear * xx,
        -by.sum(axis=1),
        bx.sum(axis=1),
        bend.sum(axis=1),
    )
    tt, tw_x, tw_y = product(twist, torque), product(twist, tx), product(twist, ty)
    rl, ra_x, ra_y = product(lift, lever), product(lift, tx), product(lift, ty)
    outside = (
        sum_products(tt, torque) + sum_products(rl, lever) + shear * stretch.sum(axis=1),
        sum_products(tt, tx) + sum_products(rl, ty),
        sum_products(tw_x, tx) + sum_products(ra_y, ty),
        sum_products(tt, ty) - sum_products(rl, tx),
        sum_products(tw_x, ty) - sum_products(ra_x, ty),
        sum_products(tw_y, ty) + sum_products(ra_x, tx),
    )
    return np.stack(inside + outside)


def _flexibilities(
    width: np.ndarray, length: np.ndarray, height: float, material: Material
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return flexibilities (1 + P, S, N) of pieces: stretch per force; then turn per moment in the sheet, out of it and
    along the arm."""

    def flex(value: np.ndarray, by_width: np.ndarray) -> np.ndarray:
        out = by_width * width
        out[0] = value
        return product(length, out)

    w = width[0]
    soft = 1.0 / (material.youngs * height * w)
    inertia, slope = torsion_constant(height / w)
    twisting = 2.0 * (1.0 + material.poisson) / (material.youngs * w**4 * inertia)
    bend, lift = 12.0 * soft / w**2, 12.0 * soft / height**2
    by_width = twisting * (slope * height / (inertia * w) - 4.0) / w
    return flex(soft, -soft / w), flex(bend, -3.0 * bend / w), flex(lift, -lift / w), flex(twisting, by_width)
