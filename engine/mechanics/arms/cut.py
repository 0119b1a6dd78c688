"""Difference in compliance between a cut arm and the stiffness table's arm, with exact derivatives.

The table holds arms that are pure spirals, from hubs of four equal arms with fillets of a standard size. A cut arm
differs in two ways. Its outer end is blended with its mate, the arm beyond its joint (see ``spirals.curves.blends``).
And its root, where it begins to bend, depends on its neighbours' widths and on the fillet radius of the settings. So
the compliance of a cut arm minus the table's compliance is a sum of beam compliances (see ``beams``):

    + of the blended arm over its blended part,
    - of the pure spiral over the same part,
    - of the pure spiral between the root of the table's arm and the true root.

All are compliances of the tip of the pure spiral.
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
from .beams import gauss
from .grain import SectionFlexibility, line_compliance
from .isotropic_lines import isotropic_line_compliance
from .stacked import BATCH
from .stations import product, spiral_stations
from .stiffness import ENTRIES, IN_PLANE, OUT_OF_PLANE, SHORTEST

# Design parameters on which the compliance of an arm depends: its own width and twist, the mean width of its two
# neighbours in the spiral, and width and twist of its mate, the arm beyond the joint.
WIDTH, TWIST, BESIDE, MATE_WIDTH, MATE_TWIST = range(5)
N_CUT_PARAMETERS = 5  # number of the design parameters ``WIDTH`` to ``MATE_TWIST``
# A value and its derivatives by the five design parameters are stacked: row 0 is the value, row 1 + p the derivative by
# parameter p. These rows are not zero for the blended end of an arm
_BLEND_ROWS = [0, 1 + WIDTH, 1 + TWIST, 1 + MATE_WIDTH, 1 + MATE_TWIST]
# rows 0 (value) and 1 + p (derivative by design parameter p) that are not zero for the root of an arm
_ROOT_ROWS = [0, 1 + WIDTH, 1 + TWIST, 1 + BESIDE]
# The columns of ``CutArms.slope_by`` are derivatives by these parameters of ``blend_joints``
_END_COLUMNS = [OWN_WIDTH, OWN_WIND, BY_MATE_WIDTH, MATE_WIND, RADIUS, OWN_LEAN, MATE_LEAN]
# slices of the columns of ``CutArms.slope_by`` that belong to the design and to the rest shape
_BY_DESIGN, _BY_SHAPE = slice(4), slice(4, 7)
SHAPE_RADIUS, SHAPE_LEAN, SHAPE_MATE_LEAN, SHAPE_GRAIN = range(4)  # columns of ``rest_shapes``

# rows and columns of the nonzero entries in the lower triangle of a compliance
_NONZERO = [(rows[i], rows[j]) for rows in (IN_PLANE, OUT_OF_PLANE) for i, j in ENTRIES]

# Distance from the hub's centre to an arm's root, where the arm begins to bend, over the mean width of its neighbours.
# Larger makes arms slightly stiffer
ROOT_DISTANCE = 0.55
# Largest distance of a root from the hub's centre, as a share of the radius. Larger would let roots overlap blends,
# which cover up to 0.7 of an arm. Only arms that cannot be cut reach this limit
MAX_ROOT_SHARE = 0.3
# At most this share of the table's compliance is subtracted from an arm; this is checked where the scale over the width
# is below STUB_RATIO. A larger share may leave very stiff arms, a larger ratio is slower. Arms that can be cut do not
# reach the share
MAX_REDUCTION, STUB_RATIO = 0.9, 10.0
TABLE_FILLET = 0.04  # fillet radius of the stiffness table's spirals, in arm widths
# length by which a fillet shortens an arm, in fillet radii; larger makes arms stiffer. Finite elements of solid,
# straight arms show 0.57
FILLET_REACH = 0.55
POINTS = 8  # number of Gauss points over the blend; more are slower and more exact (error 4e-6)
ROOT_POINTS = 3  # number of Gauss points between the two roots; more are slower and more exact (error 4e-6)


@dataclass(frozen=True, eq=False)
class CutArms(Columns):
    """N arms as they are cut, in their own axes: along the radius to the tip, and to the side to which they wind in.

    radius, width : metres; twist : radians
    beside : mean width of both neighbours in the spiral, metres
    fillet : radius of the fillets minus that of the table's fillets, metres
    fillet_by : derivative of ``fillet`` with respect to the width
    slope, joint, share : the blend: ``slope``, ``width`` and ``share`` of ``spirals.curves.blends.Blends``
    slope_by, joint_by, share_by : (N, 7) derivatives of the blend with respect to own width and twist, mate's width and
        twist, radius, own lean and mate's lean
    grain : angle from the radius to the grain, radians, 0 for sheets without a grain
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
        """Collect the arms of all joints, in the order 2 * joint + (0 or 1).

        shape : (2 m, 3 or 4) rest shapes of the arms, by default ``rest_shapes(assembly)``
        """
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
            # an arm at the rim is blended with its own mirror image, so that it leads straight into the neck
            twist[ties, 1] = -twist[ties, 0]
        widths, twists = (_with_mates(v) for v in (width, twist))
        end = blend_joints(widths, twists, leans, radius, np.zeros_like(radius), cut.blend)
        slope_by, joint_by, share_by = (by[:, _END_COLUMNS] for by in (end.slope_by, end.width_by, end.share_by))
        fillet = cut.fillet - TABLE_FILLET * known[1], np.full(len(radius), -TABLE_FILLET)
        return cls(*known, *fillet, end.slope, end.width, end.share, slope_by, joint_by, share_by, grain)

    @property
    def roots(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Distances from the hub's centre to the roots over the radius: of the table's arms, and of these arms."""
        own = ROOT_DISTANCE * self.width / self.radius
        moved = ROOT_DISTANCE * self.beside + FILLET_REACH * self.fillet
        return np.minimum(own, MAX_ROOT_SHARE), np.minimum(moved / self.radius, MAX_ROOT_SHARE)


def rest_shapes(assembly: Assembly, material: Material | None = None) -> Float[np.ndarray, "n _"]:
    """Return the rest shapes (2 m, 3 or 4) of all arms, in the order 2 * joint + (0 or 1).

    Columns: radius, metres; the arm's lean and its mate's lean, radians; if ``material`` has a grain, also the angle
    from the radius to the grain, radians. A lean is the angle from the quad's outward normal at the joint to the arm's
    radius, positive in the sense in which the arms wind. The mate is the arm beyond the joint.
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
    """Return an array (2 m, 2) with one row per arm: the arm's value and the value of its mate across the joint."""
    return np.stack([values, values[:, ::-1]], axis=-1).reshape(-1, 2)


def added_compliance_by_shape(
    assembly: Assembly, table: Float[np.ndarray, "n 6 6"], material: Material
) -> Float[np.ndarray, "n _ 6 6"]:
    """Return derivatives (2 m, k, 6, 6) of ``added_compliance`` with respect to the k columns of ``rest_shapes``.

    The factor from ``reduction_factors`` is not differentiated.

    Parameters
    ----------
    assembly, material : m joints, and the material of the sheet
    table : (2 m, 6, 6) compliances of the arms in the stiffness table
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
    """Return the compliance of N cut arms minus the table's compliance, and its derivatives by the design parameters.

    The difference is multiplied by a factor that fades to zero for arms hardly longer than wide.

    Parameters
    ----------
    arms : the N arms
    thickness, material : of the sheet; thickness in metres
    slopes : compute the derivatives; otherwise they are zero

    Returns
    -------
    (N, 6, 6) : compliances, SI units, with rows and columns as in ``ArmCompliance``
    (N, 5, 6, 6) : derivatives by ``WIDTH`` to ``MATE_TWIST`` (axis 1), per metre and per radian
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
    """Return whether any arm has a blended outer end that differs from a pure spiral."""
    return bool(arms.slope.any() or (arms.joint != arms.width).any())


def _sum_lines(
    arms: CutArms, lines: list[tuple[float, list[int], _Line]], count: int, thickness: float, material: Material
) -> Float[np.ndarray, "12 count n"]:
    """Add up the tip compliances of lines on N arms.

    lines : of every line its sign, the rows of the result to which its value and derivatives are added, and the line
    count : number of rows of the result: 1 and the number of derivatives

    Returns an array (12, count, N): entries in the order of ``_NONZERO``; value and derivatives; arms.
    """
    out = np.zeros((len(_NONZERO), count, len(arms.radius)))
    for sign, rows, line in lines:
        place, pace, width, weight = (part[: len(rows)] for part in line)
        if material.orthotropy is None:
            out[:, rows] += sign * isotropic_line_compliance(place, pace, width, weight, thickness, material)
            continue
        turned = {k - 1: 1.0 for k, row in enumerate(rows) if row == 1 + SHAPE_GRAIN and count == 2 + SHAPE_GRAIN}
        grain = _dual(arms.grain[None], turned, len(place) - 1)
        of = partial(SectionFlexibility.evaluate, material.orthotropy)
        out[:, rows] += sign * line_compliance(place, pace, width, weight, grain, thickness, of)
    return out


def reduction_factors(
    arms: CutArms, table: Float[np.ndarray, "n 6 6"], added: Float[np.ndarray, "n 6 6"]
) -> Float[np.ndarray, " n"]:
    """Return factors (N,) such that ``table`` + factor * ``added`` is positive definite; 1 for arms that can be cut.

    At most ``MAX_REDUCTION`` of the table's compliance is subtracted. The compliance of tightly wound stubs in the
    table is far smaller than a beam's, so the added compliance, a difference of beams, may exceed it.

    Parameters
    ----------
    arms : N arms
    table : (N, 6, 6) compliances of the arms in the stiffness table
    added : (N, 6, 6) compliances of ``added_compliance``
    """
    out = np.ones(len(table))
    short = np.flatnonzero(2.0 * arms.radius < STUB_RATIO * arms.width)
    root = np.linalg.inv(np.linalg.cholesky(table[short]))
    least = np.linalg.eigvalsh(root @ added[short] @ np.swapaxes(root, 1, 2))[:, 0]
    out[short] = np.minimum(1.0, MAX_REDUCTION / np.maximum(-least, MAX_REDUCTION))
    return out


# A line: S stations on each of N arms. Four arrays: positions relative to the tip (complex), their derivatives by t
# (complex), widths, and quadrature weights in t. Each is (1 + P, S, N): row 0 is the value, the other rows its
# derivatives by P parameters. Widths that are constant along the line may be (1 + P, 1, N).
_Line = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _dual(value: np.ndarray, by: Mapping[int, np.ndarray | float], count: int) -> np.ndarray:
    """Stack a value and its derivatives by ``count`` parameters.

    by : maps the index of a parameter to the derivative; derivatives by other parameters are 0
    """
    out = np.zeros((1 + count, *value.shape), dtype=value.dtype)
    out[0] = value
    for k, change in by.items():
        out[1 + k] = change
    return out


def _blend_lines(arms: CutArms, by: slice = _BY_DESIGN) -> tuple[_Line, _Line]:
    """Return two lines over the blended ends of the arms: along the blended arms, and along pure spirals instead.

    by : parameters of the derivatives, ``_BY_DESIGN`` or ``_BY_SHAPE``
    """
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
    """Return lines on pure spirals from the roots of the table's arms to the true roots.

    of_design : differentiate by width, twist and the width of the neighbours; else by radius and grain
    """
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
    """Return the positions, their derivatives by t and the widths of a ``_Line`` on spirals without blends.

    t : (1 + P, S, N) of the stations, with derivatives by the P parameters of the line
    """
    place, pace = spiral_stations(
        arms.radius, arms.twist, t, **({"by_twist": 1 + TWIST} if of_design else {"by_radius": 1})
    )
    return place, pace, _dual(arms.width[None], {WIDTH: 1.0} if of_design else {}, len(t) - 1)


def _fade_factor(arms: CutArms) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the factor (N,) of the added compliance, and its derivatives by width and by radius.

    It is 1 for scales over width in the table's range; below, it falls smoothly to 0 at ``SHORTEST``.
    """
    ratio, span = 2.0 * arms.radius / arms.width, SCALE_RANGE[0] - SHORTEST
    s = np.clip((ratio - SHORTEST) / span, 0.0, 1.0)
    slope = 6.0 * s * (1.0 - s) / span * ratio
    return s * s * (3.0 - 2.0 * s), -slope / arms.width, slope / arms.radius
