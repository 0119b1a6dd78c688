"""How stiff the arm of a spiral is: the fitted table, its exact derivatives, and the strain that a load costs.

Table values come from the linear limit of volumetric finite elements, stored relative to a curved beam and
interpolated by Chebyshev polynomials over ln(s/w), ln(w/h), twist / limit(s/w) and Poisson's ratio. What is interpolated
is the Cholesky factor of the compliance relative to the beam's, with the logarithm of its diagonal: every value is a
positive definite compliance.

One table serves every thickness and Young's modulus: energies go with E h^3 times a function of s/h, w/h and the twist.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..errors import FlexMapsError
from . import beams

TABLE = Path(__file__).resolve().parents[2] / "data" / "stiffness.npz"
SCALE_RANGE = (5.0, 50.0)
SHORTEST = 2.0
"""s/w at which an arm is all hub."""
WIDTH_RANGE = (0.3, 3.0)
POISSON_RANGE = (0.0, 0.45)
SLOT_SHARE = 0.14
TWIST_CAP = math.radians(600.0)
CAP_POWER = 8
IN_PLANE, OUT_OF_PLANE = (0, 1, 5), (2, 3, 4)
ENTRIES: tuple[tuple[int, int], ...] = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
_DIAGONAL = (0, 2, 5)


@dataclass(frozen=True, eq=False)
class ArmCompliance:
    """Compliance of n arms' tips against their hubs, and its derivatives.

    values : (n, 6, 6) SI: motion (m, rad) of the tip relative to the hub per wrench (N, N m) at the tip; axes: along the
        radius from the hub to the tip, to the left of it in the sheet, normal to the sheet; shifts first, turns last
    by_scale, by_width, by_twist : (n, 6, 6) derivatives, per metre, per metre, per radian
    """

    values: np.ndarray
    by_scale: np.ndarray
    by_width: np.ndarray
    by_twist: np.ndarray


def twist_limit(ratio: np.ndarray | float) -> np.ndarray:
    """Largest twist (radians) that the table holds at s/w = ``ratio``: the slot is 0.14 arm widths there.

    Smoothly capped near 600 degrees. The condition on the slot is (pi/4) s / sqrt(1 + twist^2) - w.
    """
    return _twist_limit(np.asarray(ratio, dtype=float))[0]


def _twist_limit(ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The limit, and its derivative by ln(ratio)."""
    spread = (0.25 * math.pi / (1.0 + SLOT_SHARE) * ratio) ** 2
    cut = np.sqrt(spread - 1.0)
    limit = (cut**-CAP_POWER + TWIST_CAP**-CAP_POWER) ** (-1.0 / CAP_POWER)
    return limit, (limit / cut) ** (CAP_POWER + 1) * spread / cut


@dataclass(frozen=True, eq=False)
class Table:
    """The interpolation table.

    coefficients : (T, channels, N) Chebyshev coefficients: twist and w/h together (T pairs), channels, scale
    pairs : (T, 2) int, degrees in w/h and in twist
    provenance : how the table was made, with what errors
    """

    coefficients: np.ndarray
    pairs: np.ndarray
    provenance: dict


@lru_cache(maxsize=8)
def load_table(poisson: float, path: Path = TABLE) -> Table:
    """The table for one Poisson's ratio; raises FlexMapsError if the file is missing or of another version."""
    if not POISSON_RANGE[0] < poisson < POISSON_RANGE[1]:
        raise FlexMapsError(f"Poisson's ratio is {poisson:g}; it must lie between 0 and 0.45")
    if not path.is_file():
        raise FlexMapsError(f"The stiffness table {path.name} is missing; reinstall the add-on or build the database")
    with np.load(path) as stored:
        provenance = json.loads(str(stored["provenance"]))
        if provenance.get("format") != FORMAT:
            raise FlexMapsError(f"The stiffness table {path.name} has another version; build the database again")
        full, pairs = stored["coefficients"].astype(float), stored["pairs"]
    low, high = POISSON_RANGE
    x = 2.0 * (poisson - low) / (high - low) - 1.0
    basis = np.cos(np.arange(full.shape[-1]) * math.acos(x))
    return Table(np.ascontiguousarray(full @ basis), pairs, provenance)


FORMAT = 1


@dataclass(frozen=True, eq=False)
class _Point:
    """Where n arms lie in the table: coordinates in [-1, 1], and how they depend on ln(s/w), ln(w/h), twist."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    z_by_scale: np.ndarray
    z_by_twist: np.ndarray


def _locate(ratio: np.ndarray, flatness: np.ndarray, twist: np.ndarray) -> _Point:
    limit, slope = _twist_limit(ratio)
    _refuse_outside(ratio, flatness, twist, limit)
    share = twist / limit
    return _Point(
        _unit(np.log(ratio), *np.log(SCALE_RANGE)),
        _unit(np.log(flatness), *np.log(WIDTH_RANGE)),
        2.0 * share - 1.0,
        -2.0 * share * slope / limit,
        2.0 / limit,
    )


def _unit(value: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.clip(2.0 * (value - low) / (high - low) - 1.0, -1.0, 1.0)


def _refuse_outside(ratio: np.ndarray, flatness: np.ndarray, twist: np.ndarray, limit: np.ndarray) -> None:
    slack = 1e-9
    for value, (low, high), name in (
        (ratio, SCALE_RANGE, "scale / width"),
        (flatness, WIDTH_RANGE, "width / thickness"),
        (twist / limit, (0.0, 1.0), "twist / largest twist that can be cut"),
    ):
        outside = ~((value >= low * (1 - slack) - slack) & (value <= high * (1 + slack)))
        if outside.any():
            worst = float(value[outside][0])
            raise FlexMapsError(
                f"{name} is {worst:.3g} for {int(outside.sum())} arms, outside the stiffness table's {low:g} to {high:g}; "
                "change width, twist or quad size there",
                faces=np.flatnonzero(outside),
            )


def _chebyshev(x: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, n) Chebyshev polynomials and their derivatives, by recurrence."""
    value, slope = np.empty((count, len(x))), np.zeros((count, len(x)))
    value[0] = 1.0
    if count > 1:
        value[1], slope[1] = x, 1.0
    for k in range(2, count):
        value[k] = 2.0 * x * value[k - 1] - value[k - 2]
        slope[k] = 2.0 * value[k - 1] + 2.0 * x * slope[k - 1] - slope[k - 2]
    return value, slope


def _interpolate(table: Table, at: _Point, channels: slice) -> tuple[np.ndarray, np.ndarray]:
    """(C, n) values and (3, C, n) derivatives by ln(s/w), ln(w/h) and twist of the chosen channels."""
    c = table.coefficients[:, channels]
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
    x_per, y_per = (2.0 / math.log(high / low) for low, high in (SCALE_RANGE, WIDTH_RANGE))
    return value, np.stack([by_x * x_per + slope_z * at.z_by_scale, slope_y * y_per, slope_z * at.z_by_twist])


def _cholesky(a: np.ndarray, da: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cholesky factors (6, ...) of symmetric 3 x 3 matrices (6, ...), and their derivatives for (k, 6, ...)."""
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
    """Product of lower-triangular 3 x 3 matrices, both (..., 6, 2, n) in the order of ENTRIES."""
    a0, a1, a2, a3, a4, a5 = np.moveaxis(a, -3, 0)
    b0, b1, b2, b3, b4, b5 = np.moveaxis(b, -3, 0)
    return np.stack(
        [a0 * b0, a1 * b0 + a2 * b1, a2 * b2, a3 * b0 + a4 * b1 + a5 * b3, a4 * b2 + a5 * b4, a5 * b5], axis=-3
    )


def _gram(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Entries of A B^T for lower-triangular A and B, both (..., 6, 2, n): the lower triangle."""
    a0, a1, a2, a3, a4, a5 = np.moveaxis(a, -3, 0)
    b0, b1, b2, b3, b4, b5 = np.moveaxis(b, -3, 0)
    return np.stack(
        [a0 * b0, a1 * b0, a1 * b1 + a2 * b2, a3 * b0, a3 * b1 + a4 * b2, a3 * b3 + a4 * b4 + a5 * b5], axis=-3
    )


def relative_factor(compliance: np.ndarray, scale: float, height: float, twist: float, poisson: float) -> np.ndarray:
    """(12,) what the table stores of a dimensionless (6, 6) compliance: logarithms and ratios against the beam."""
    base = beams.tip_compliance(np.array([scale]), np.array([height]), np.array([twist]), poisson).values[..., 0]
    out = []
    for block, rows in zip(base, (IN_PLANE, OUT_OF_PLANE)):
        beam = np.zeros((3, 3))
        for value, (i, j) in zip(block, ENTRIES):
            beam[i, j] = beam[j, i] = value
        factor = np.linalg.solve(np.linalg.cholesky(beam), np.linalg.cholesky(compliance[np.ix_(rows, rows)]))
        out += [math.log(factor[i, j]) if i == j else float(factor[i, j]) for i, j in ENTRIES]
    return np.array(out)


def blocks(ratio: np.ndarray, flatness: np.ndarray, twist: np.ndarray, table: Table, poisson: float) -> beams.Blocks:
    """The dimensionless compliance of arms at s/w = ``ratio``, w/h = ``flatness`` and ``twist``, all (n,)."""
    at = _locate(ratio, flatness, twist)
    log, dlog = _interpolate(table, at, slice(0, 12))
    log, dlog = log.reshape(2, 6, -1).swapaxes(0, 1), dlog.reshape(3, 2, 6, -1).swapaxes(1, 2)
    factor, dfactor = log.copy(), dlog.copy()
    for k in _DIAGONAL:
        factor[k] = np.exp(log[k])
        dfactor[:, k] *= factor[k]
    base = beams.tip_compliance(ratio, 1.0 / flatness, twist, poisson)
    beam, dbeam = _cholesky(base.values.swapaxes(0, 1), base.slopes.swapaxes(1, 2))
    whole = _lower_product(beam, factor)
    dwhole = _lower_product(dbeam, factor[None]) + _lower_product(beam[None], dfactor)
    first = _gram(dwhole, whole[None])
    second = _gram(whole[None], dwhole)
    return beams.Blocks(_gram(whole, whole).swapaxes(0, 1), (first + second).swapaxes(1, 2))


def tip_compliance(
    scale: np.ndarray, width: np.ndarray, twist: np.ndarray, *, thickness: float, youngs: float, poisson: float
) -> ArmCompliance:
    """Compliance of the tips of n arms with exact derivatives.

    scale : (n,) m, diameter of the circumscribed circle: twice the distance from the centre to the tip; width : (n,) m;
    twist : (n,) rad; thickness in m, Young's modulus in Pa. Arms shorter than the table's shortest, s/w = 5, are hardly
    longer than wide: down to s/w = 2 they get its compliance, shortened as that of a beam is. Else raises FlexMapsError
    outside the table; ``faces`` of the error are positions in the given arrays.
    """
    _refuse_material(thickness, youngs)
    scale, width, twist = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (scale, width, twist))
    least = SCALE_RANGE[0]
    stub = (scale < least * width) & (scale > SHORTEST * width)
    if stub.any():
        return _shortened(scale, np.where(stub, least * width, scale), stub, width, twist, thickness, youngs, poisson)
    found = blocks(scale / width, width / thickness, twist, load_table(float(poisson)), float(poisson))
    # a wrench (F, M) is (E w^2, E w^3) and a motion (u, turn) is (w, 1) of the dimensionless one
    power = np.zeros((2, 6), dtype=int)
    for b, rows in enumerate((IN_PLANE, OUT_OF_PLANE)):
        kind = [0 if r < 3 else 1 for r in rows]
        power[b] = [-1 - kind[i] - kind[j] for i, j in ENTRIES]
    unit = width ** power[..., None] / youngs
    values = found.values * unit
    by_ratio, by_flatness, by_twist = found.slopes * unit
    by_scale = by_ratio / scale
    by_width = (by_flatness - by_ratio + power[..., None] * values) / width
    return ArmCompliance(*(_full(part) for part in (values, by_scale, by_width, by_twist)))


def _shortened(
    scale: np.ndarray,
    table_scale: np.ndarray,
    stub: np.ndarray,
    width: np.ndarray,
    twist: np.ndarray,
    thickness: float,
    youngs: float,
    poisson: float,
) -> ArmCompliance:
    """Compliances of arms of which some (``stub``) are shorter than the table's: those go with the powers of a beam's length."""
    at = tip_compliance(table_scale, width, twist, thickness=thickness, youngs=youngs, poisson=poisson)
    turns = np.repeat([0, 1], 3)
    power = 3.0 - turns[:, None] - turns
    factor = (scale / table_scale)[:, None, None] ** power
    values, short = at.values * factor, stub[:, None, None]
    by_scale = np.where(short, values * power / scale[:, None, None], at.by_scale)
    by_width = (at.by_width + np.where(short, SCALE_RANGE[0] * at.by_scale, 0.0)) * factor
    by_width -= np.where(short, values * power / width[:, None, None], 0.0)
    return ArmCompliance(values, by_scale, by_width, at.by_twist * factor)


def _refuse_material(thickness: float, youngs: float) -> None:
    if not (math.isfinite(thickness) and thickness > 0):
        raise FlexMapsError(f"The sheet's thickness is {thickness:g} m; it must be a positive number")
    if not (math.isfinite(youngs) and youngs > 0):
        raise FlexMapsError(f"Young's modulus is {youngs:g} Pa; it must be a positive number")


def _full(entries: np.ndarray) -> np.ndarray:
    """(n, 6, 6) from the lower triangles (2, 6, n) of both blocks."""
    out = np.zeros((6, 6, entries.shape[-1]))
    for b, rows in enumerate((IN_PLANE, OUT_OF_PLANE)):
        for k, (i, j) in enumerate(ENTRIES):
            out[rows[i], rows[j]] = out[rows[j], rows[i]] = entries[b, k]
    return np.ascontiguousarray(np.moveaxis(out, -1, 0))


def peak_strain(
    wrench: np.ndarray,
    scale: np.ndarray,
    width: np.ndarray,
    twist: np.ndarray,
    *,
    thickness: float,
    youngs: float,
    poisson: float,
) -> np.ndarray:
    """(n,) a safe estimate of the strain that 99 % of the volume of an arm stays below under its tip load.

    wrench : (n, 6) N and N m at the tip of one arm, axes as in ``ArmCompliance``. The peak strains of the six components
    are added as if they met in one place: usually 1.2 to 2.5 times the true strain, more where components cancel. Small
    strains; at the fillets, in the hundredth of the volume that is left out, it is higher.
    """
    arrays = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (wrench, scale, width, twist))
    return peak_strain_slopes(*arrays, thickness=thickness, youngs=youngs, poisson=poisson).values


@dataclass(frozen=True, eq=False)
class PeakStrain:
    """Peak strains of n arms and their derivatives.

    values : (n,); by_wrench : (n, 6) per N and N m; by_width : (n,) per metre, by_twist : (n,) per radian
    """

    values: np.ndarray
    by_wrench: np.ndarray
    by_width: np.ndarray
    by_twist: np.ndarray


def peak_strain_slopes(
    wrench: np.ndarray,
    scale: np.ndarray,
    width: np.ndarray,
    twist: np.ndarray,
    *,
    thickness: float,
    youngs: float,
    poisson: float,
) -> PeakStrain:
    """``peak_strain`` with its derivatives; arms shorter than the table's shortest count as that long."""
    _refuse_material(thickness, youngs)
    stub = scale < SCALE_RANGE[0] * width
    ratio = np.where(stub, SCALE_RANGE[0], scale / width)
    table = load_table(float(poisson))
    log, slopes = _interpolate(table, _locate(ratio, width / thickness, twist), slice(12, 18))
    power = np.repeat([2.0, 3.0], 3)[:, None]
    unit = np.exp(log) / (youngs * width**power)
    size = np.abs(wrench).T * unit
    by_width = slopes[1] - np.where(stub, 0.0, slopes[0]) - power
    return PeakStrain(
        size.sum(axis=0),
        np.sign(wrench) * unit.T,
        (size * by_width).sum(axis=0) / width,
        (size * slopes[2]).sum(axis=0),
    )


def log_strains(ratio: np.ndarray, flatness: np.ndarray, twist: np.ndarray, table: Table) -> np.ndarray:
    """(6, n) logarithms of the dimensionless peak strains per unit of the six components of a tip wrench."""
    return _interpolate(table, _locate(ratio, flatness, twist), slice(12, 18))[0]
