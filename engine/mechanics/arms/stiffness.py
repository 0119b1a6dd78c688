"""Tip compliance of a spiral's arm: the fitted stiffness table and its exact derivatives.

The table is fitted to linear finite elements of solids. It stores a correction, the compliance relative to that of a
curved beam (see ``beams``), as Chebyshev polynomials in ln(s/w), ln(w/h), twist / limit(s/w) and Poisson's ratio: s is
the scale of the spiral, w the width of the arm, h the thickness of the sheet, and limit the largest twist that can be
cut. The polynomials are fitted to the entries of the Cholesky factor of the relative compliance, those on the diagonal
as logarithms, so that every compliance is positive definite.

One table serves every thickness and Young's modulus E, because energies are E h^3 times a function of s/h, w/h and the
twist.

The table is extended continuously beyond its range. A slender arm differs from the beam only near its hub, over about
one width, so beyond the largest s/w the corrections decrease like w/s, as finite elements at s/w 50 to 400 confirm.
The compliance of arms with a smaller s/w than the range scales with powers of their length, like a beam's. Where w/h or
the twist is outside the range, the correction for the nearest value inside is applied to the beam with the true value.
``beyond`` lists the arms that no finite elements cover.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...spirals.clearance.table_range import SCALE_RANGE, table_limit_and_slope, table_twist_limit
from ..dimensions import check_dimensions, check_material
from ..out_of_range import OutOfRange
from . import beams

TABLE = Path(__file__).resolve().parents[3] / "data" / "stiffness.npz"
SLENDEREST = 400.0  # largest s/w for which finite elements have confirmed that the corrections decrease like w/s
SHORTEST = 2.0  # s/w at which an arm consists of its hub only; smaller ratios are replaced by this value
WIDTH_RANGE = (0.3, 3.0)  # range of w/h of the table's nodes
POISSON_RANGE = (0.0, 0.45)  # range of Poisson's ratio of the table's nodes
IN_PLANE, OUT_OF_PLANE = (0, 1, 5), (2, 3, 4)  # indices of (Fx, Fy, Mz) and of (Fz, Mx, My) in a wrench
# rows and columns of the lower triangle of a 3 x 3 block, in the order in which the table stores its entries
ENTRIES: tuple[tuple[int, int], ...] = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
_DIAGONAL = (0, 2, 5)  # indices of the diagonal in ``ENTRIES``


@dataclass(frozen=True, eq=False)
class ArmCompliance:
    """Tip compliances of n arms relative to their hubs, and their derivatives by the arms' dimensions.

    values : (n, 6, 6) motion of the tip relative to the hub per wrench at the tip. Rows: shift (3, metres), turn (3,
        radians); columns: force (3, N), moment (3, N m). Axes: along the radius from the hub to the tip, to its left in
        the sheet, normal to the sheet
    by_scale, by_width : (n, 6, 6) derivatives per metre of the spiral's scale and of the arm's width
    by_twist : (n, 6, 6) derivatives per radian of twist
    by_grain : (n, 6, 6) derivatives per radian of the grain's direction; None for sheets without a grain
    """

    values: Float[np.ndarray, "... 6 6"]
    by_scale: Float[np.ndarray, "... 6 6"]
    by_width: Float[np.ndarray, "... 6 6"]
    by_twist: Float[np.ndarray, "... 6 6"]
    by_grain: Float[np.ndarray, "... 6 6"] | None = None


@dataclass(frozen=True, eq=False)
class StiffnessTable:
    """The stiffness table for one Poisson's ratio.

    coefficients : (T, 12, N) Chebyshev coefficients. Axis 0: pair of degrees in w/h and in twist; axis 1: ``ENTRIES``
        of the in-plane block, then of the out-of-plane block; axis 2: degree in s/w
    pairs : (T, 2) the pairs of degrees in w/h and in twist
    provenance : how the table was made, and its errors
    """

    coefficients: Float[np.ndarray, "_ channels nodes"]
    pairs: Int[np.ndarray, "_ 2"]
    provenance: dict


@lru_cache(maxsize=8)
def load_table(poisson: float, path: Path = TABLE) -> StiffnessTable:
    """Load the table for one Poisson's ratio.

    Raises FlexMapsError if the ratio is outside ``POISSON_RANGE``, or the file is missing or has another version.
    """
    if not POISSON_RANGE[0] < poisson < POISSON_RANGE[1]:
        raise FlexMapsError(f"Poisson's ratio is {poisson:g}; it must lie between 0 and 0.45")
    if not path.is_file():
        raise FlexMapsError(f"The stiffness table {path.name} is missing; reinstall the add-on or build the database")
    with np.load(path) as stored:
        provenance = json.loads(str(stored["provenance"]))
        if provenance.get("format") != FORMAT:
            raise FlexMapsError(f"The stiffness table {path.name} has another version; build the database again")
        # older files also have coefficients of strains, after the ``CHANNELS`` of compliances
        full, pairs = stored["coefficients"][:, :CHANNELS].astype(float), stored["pairs"]
    low, high = POISSON_RANGE
    x = 2.0 * (poisson - low) / (high - low) - 1.0
    basis = np.cos(np.arange(full.shape[-1]) * math.acos(x))
    return StiffnessTable(np.ascontiguousarray(full @ basis), pairs, provenance)


FORMAT = 1  # version of the table's file that ``load_table`` can read
CHANNELS = 12  # number of interpolated functions: six entries of each of the two blocks of a compliance


@dataclass(frozen=True, eq=False)
class _TablePoint:
    """Positions of n arms in the table, with derivatives by ln(s/w), ln(w/h) and twist.

    x, y, z : (n,) ln(s/w), ln(w/h) and twist / limit(s/w), mapped from the table's range to [-1, 1]
    x_by_scale, z_by_scale : (n,) derivatives by ln(s/w)
    y_by_width, z_by_twist : (n,) derivatives by ln(w/h) and by the twist
    share : (n,) factor on the corrections to the beam: 1 up to the largest s/w in the table, beyond that inversely
        proportional to s/w
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    x_by_scale: np.ndarray
    y_by_width: np.ndarray
    z_by_scale: np.ndarray
    z_by_twist: np.ndarray
    share: np.ndarray


def locate(ratio: np.ndarray, flatness: np.ndarray, twist: np.ndarray) -> _TablePoint:
    """Return the positions of n arms in the table; coordinates outside its range are clipped, with zero derivatives.

    Parameters
    ----------
    ratio : (n,) s/w
    flatness : (n,) w/h
    twist : (n,) radians
    """
    within = np.clip(ratio, *SCALE_RANGE)
    limit, slope = table_limit_and_slope(within)
    part = twist / limit
    x, x_slope = _to_unit_interval(np.log(within), *np.log(SCALE_RANGE))
    y, y_slope = _to_unit_interval(np.log(flatness), *np.log(WIDTH_RANGE))
    z, z_slope = _to_unit_interval(part, 0.0, 1.0)
    return _TablePoint(
        x,
        y,
        z,
        np.where(ratio == within, x_slope, 0.0),
        y_slope,
        np.where(ratio == within, -z_slope * part * slope / limit, 0.0),
        z_slope / limit,
        np.minimum(SCALE_RANGE[1] / ratio, 1.0),
    )


def _to_unit_interval(value: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Map values from [low, high] to [-1, 1], clip them to this range, and return them with the slope of the map."""
    place = 2.0 * (value - low) / (high - low) - 1.0
    # values at the ends of the range are inside, whatever their rounding error
    inside = np.abs(place) <= 1.0 + 1e-9
    return np.clip(place, -1.0, 1.0), np.where(inside, 2.0 / (high - low), 0.0)


def beyond(
    scale: Float[np.ndarray, " arms"],
    width: Float[np.ndarray, " arms"],
    twist: Float[np.ndarray, " arms"],
    thickness: float,
    spiral: Int[np.ndarray, " arms"],
) -> list[OutOfRange]:
    """Return which quantities of which spirals are outside the range of the finite elements behind the table.

    Parameters
    ----------
    scale, width, twist : (n,) of the arms: their spiral's scale and their width in metres, twist in radians
    thickness : of the sheet, metres
    spiral : (n,) index of every arm's spiral
    """
    ratio = scale / width
    share = twist / table_twist_limit(np.clip(ratio, *SCALE_RANGE))
    return [
        *OutOfRange.outside_range("scale / width", ratio, SHORTEST, SLENDEREST, spiral),
        *OutOfRange.outside_range("width / thickness", width / thickness, *WIDTH_RANGE, spiral),
        *OutOfRange.outside_range("twist / largest twist that can be cut", share, 0.0, 1.0, spiral),
    ]


def _chebyshev(x: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first ``count`` Chebyshev polynomials (count, n) and their derivatives, by recurrence."""
    value, slope = np.empty((count, len(x))), np.zeros((count, len(x)))
    value[0] = 1.0
    if count > 1:
        value[1], slope[1] = x, 1.0
    for k in range(2, count):
        value[k] = 2.0 * x * value[k - 1] - value[k - 2]
        slope[k] = 2.0 * value[k - 1] + 2.0 * x * slope[k - 1] - slope[k - 2]
    return value, slope


def interpolate(table: StiffnessTable, at: _TablePoint) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate the table's polynomials at the n positions ``at``.

    Returns values (12, n), in the order of axis 1 of ``StiffnessTable.coefficients``, and derivatives (3, 12, n) by
    ln(s/w), ln(w/h) and twist.
    """
    c = table.coefficients
    pairs, count, degree = c.shape
    tx, dx = _chebyshev(at.x, degree)
    ty, dy = _chebyshev(at.y, int(table.pairs[:, 0].max()) + 1)
    tz, dz = _chebyshev(at.z, int(table.pairs[:, 1].max()) + 1)
    i, j = table.pairs.T
    flat = c.reshape(pairs, -1).T
    n = len(at.x)
    plain, by_y, by_z = (
        (flat @ product).reshape(count, degree, n) for product in (ty[i] * tz[j], dy[i] * tz[j], ty[i] * dz[j])
    )
    value, by_x = np.einsum("cdn,dn->cn", plain, tx), np.einsum("cdn,dn->cn", plain, dx)
    slope_y, slope_z = np.einsum("cdn,dn->cn", by_y, tx), np.einsum("cdn,dn->cn", by_z, tx)
    by_scale = by_x * at.x_by_scale + slope_z * at.z_by_scale
    return value, np.stack([by_scale, slope_y * at.y_by_width, slope_z * at.z_by_twist])


def _cholesky(a: np.ndarray, da: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Cholesky factors (6, ...) of symmetric 3 x 3 matrices, and the factors' derivatives (k, 6, ...).

    Matrices are stored as the entries of their lower triangles, in the order of ``ENTRIES``.

    a : (6, ...) the matrices; da : (k, 6, ...) their derivatives by k parameters
    """
    l, dl = np.empty_like(a), np.empty_like(da)
    l[0] = np.sqrt(a[0])
    dl[:, 0] = 0.5 * da[:, 0] / l[0]
    for diag in (1, 3):
        l[diag] = a[diag] / l[0]
        dl[:, diag] = (da[:, diag] - l[diag] * dl[:, 0]) / l[0]
    l[2] = np.sqrt(a[2] - l[1] ** 2)
    dl[:, 2] = (0.5 * da[:, 2] - l[1] * dl[:, 1]) / l[2]
    l[4] = (a[4] - l[3] * l[1]) / l[2]
    dl[:, 4] = (da[:, 4] - dl[:, 3] * l[1] - l[3] * dl[:, 1] - l[4] * dl[:, 2]) / l[2]
    l[5] = np.sqrt(a[5] - l[3] ** 2 - l[4] ** 2)
    dl[:, 5] = (0.5 * da[:, 5] - l[3] * dl[:, 3] - l[4] * dl[:, 4]) / l[5]
    return l, dl


def _lower_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products a @ b of lower-triangular 3 x 3 matrices.

    Both are (..., 6, 2, n): axis -3 counts the entries in the order of ``ENTRIES``.
    """
    a0, a1, a2, a3, a4, a5 = np.moveaxis(a, -3, 0)
    b0, b1, b2, b3, b4, b5 = np.moveaxis(b, -3, 0)
    return np.stack(
        [a0 * b0, a1 * b0 + a2 * b1, a2 * b2, a3 * b0 + a4 * b1 + a5 * b3, a4 * b2 + a5 * b4, a5 * b5], axis=-3
    )


def _gram(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the lower triangles of a @ b^T for lower-triangular 3 x 3 matrices, stored as in ``_lower_product``."""
    a0, a1, a2, a3, a4, a5 = np.moveaxis(a, -3, 0)
    b0, b1, b2, b3, b4, b5 = np.moveaxis(b, -3, 0)
    return np.stack(
        [a0 * b0, a1 * b0, a1 * b1 + a2 * b2, a3 * b0, a3 * b1 + a4 * b2, a3 * b3 + a4 * b4 + a5 * b5], axis=-3
    )


# A function of s/w, h/w and twist, each (n,), that returns the tip compliances of the beams that the table corrects. In
# sheets with a grain, their ``slopes`` have a fourth row, the derivative by the grain's direction
Beams = Callable[[np.ndarray, np.ndarray, np.ndarray], beams.Blocks]


def blocks(
    ratio: np.ndarray,
    flatness: np.ndarray,
    twist: Float[np.ndarray, " arms"],
    table: StiffnessTable,
    poisson: float,
    beam: Beams | None = None,
) -> beams.Blocks:
    """Return the dimensionless compliances of n arms: lengths in arm widths, Young's modulus 1.

    Parameters
    ----------
    ratio, flatness : (n,) s/w and w/h
    twist : (n,) radians
    table, poisson : the table, and the Poisson's ratio for which it was loaded
    beam : returns the tip compliances of the beams that the table corrects; default: isotropic beams
    """
    at = locate(ratio, flatness, twist)
    log, dlog = interpolate(table, at)
    log, dlog = log * at.share, dlog * at.share
    dlog[0] -= np.where(at.share < 1.0, log, 0.0)
    log, dlog = log.reshape(2, 6, -1).swapaxes(0, 1), dlog.reshape(3, 2, 6, -1).swapaxes(1, 2)
    factor, dfactor = log.copy(), dlog.copy()
    for k in _DIAGONAL:
        factor[k] = np.exp(log[k])
        dfactor[:, k] *= factor[k]
    # the Chebyshev series of the beam ends at ``LARGEST_TWIST``; no spiral with a larger twist can be cut
    wound = np.clip(twist, 0.0, beams.LARGEST_TWIST)
    if beam is None:
        base = beams.beam_tip_compliance(ratio, 1.0 / flatness, wound, poisson)
    else:
        base = beam(ratio, 1.0 / flatness, wound)
        dfactor = np.concatenate([dfactor, np.zeros((len(base.slopes) - 3, *dfactor.shape[1:]))])
    base.slopes[2] *= wound == twist
    root, droot = _cholesky(base.values.swapaxes(0, 1), base.slopes.swapaxes(1, 2))
    whole = _lower_product(root, factor)
    dwhole = _lower_product(droot, factor[None]) + _lower_product(root[None], dfactor)
    first = _gram(dwhole, whole[None])
    second = _gram(whole[None], dwhole)
    return beams.Blocks(_gram(whole, whole).swapaxes(0, 1), (first + second).swapaxes(1, 2))


def table_tip_compliance(
    scale: np.ndarray,
    width: np.ndarray,
    twist: np.ndarray,
    *,
    thickness: float,
    youngs: float,
    poisson: float,
    beam: Beams | None = None,
) -> ArmCompliance:
    """Return the tip compliances of n arms with exact derivatives, also of arms outside the table (see ``beyond``).

    Arms with s/w below 5, the smallest ratio in the table, are hardly longer than wide. They get the compliance at
    s/w = 5, scaled with powers of the length like a beam's; below s/w = 2 it stays constant.

    Parameters
    ----------
    scale : (n,) twice the distance from the spiral's centre to the arm's tip, metres
    width : (n,) metres
    twist : (n,) radians
    thickness, youngs, poisson : thickness (metres), Young's modulus (Pa) and Poisson's ratio of the sheet
    beam : as in ``blocks``

    Raises
    ------
    FlexMapsError : a value is not a number, or a length is not positive; its ``faces`` are the indices of these arms
    """
    check_material(thickness, youngs)
    scale, width, twist = check_dimensions(scale, width, twist)
    ratio, least = scale / width, SCALE_RANGE[0]
    table = load_table(float(poisson))
    found = blocks(np.maximum(ratio, least), width / thickness, twist, table, float(poisson), beam)
    # The dimensionless compliances are multiplied by w^power / E: a shift per force by 1 / (E w), a shift per moment or
    # turn per force by 1 / (E w^2), a turn per moment by 1 / (E w^3)
    power = np.zeros((2, 6), dtype=int)
    for b, rows in enumerate((IN_PLANE, OUT_OF_PLANE)):
        kind = [0 if r < 3 else 1 for r in rows]
        power[b] = [-1 - kind[i] - kind[j] for i, j in ENTRIES]
    power = power[..., None]
    # a beam's compliance is proportional to length^(4 + power): length^3 for shift per force, length for turn per
    # moment
    short = np.minimum(np.maximum(ratio, SHORTEST) / least, 1.0)
    unit = width**power * short ** (4 + power) / youngs
    values = found.values * unit
    by_ratio, by_flatness, by_twist, *others = found.slopes * unit
    by_ratio = np.where(ratio < least, np.where(ratio > SHORTEST, (4 + power) * values, 0.0), by_ratio)
    by_scale = by_ratio / scale
    by_width = (by_flatness - by_ratio + power * values) / width
    return ArmCompliance(*(_full_matrices(part) for part in (values, by_scale, by_width, by_twist, *others)))


def _full_matrices(entries: np.ndarray) -> Float[np.ndarray, "arms 6 6"]:
    """Build symmetric matrices (n, 6, 6) from the lower triangles ``entries`` of their two blocks.

    entries : (2, 6, n) axis 0: in-plane block, out-of-plane block; axis 1: ``ENTRIES``
    """
    out = np.zeros((6, 6, entries.shape[-1]))
    for b, rows in enumerate((IN_PLANE, OUT_OF_PLANE)):
        for k, (i, j) in enumerate(ENTRIES):
            out[rows[i], rows[j]] = out[rows[j], rows[i]] = entries[b, k]
    return np.ascontiguousarray(np.moveaxis(out, -1, 0))
