"""The stiffness table: Chebyshev nodes over the region that can be cut, one linear factorisation each."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from ..engine.arrays import Float
from ..engine.mechanics.arms import stiffness
from ..engine.progress import SILENT, Progress
from ..engine.spirals.clearance.table_range import SCALE_RANGE, table_twist_limit
from . import linear
from .geometry import Spiral
from .solid import Fineness
from .statics import Model

# nodes in ln(s/w), ln(w/h), twist / limit and Poisson's ratio: the last coefficients are 4e-3 at the very stoutest arms, else 6e-4,
# 3e-4 and 2e-3
COUNTS = (13, 6, 17, 3)
# of the solids: twice as fine across as ``COARSE``
FINENESS = Fineness(length=2.5, turn=0.7, across=2, through=1, root=0.4)
NARROW = replace(FINENESS, across=4)  # for stout spirals with narrow slots, whose hubs bulge far out
CHANNELS = 12  # of a node: the entries of the compliance


def roots(count: int) -> Float[np.ndarray, " count"]:
    """Chebyshev points in (-1, 1)."""
    return np.cos(np.pi * (np.arange(count) + 0.5) / count)


def _axes(counts: tuple[int, int, int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """s/w, w/h, twist share and Poisson's ratio at the nodes."""

    def spread(x: np.ndarray, low: float, high: float) -> np.ndarray:
        return low + 0.5 * (x + 1.0) * (high - low)

    ratio = np.exp(spread(roots(counts[0]), *np.log(SCALE_RANGE)))
    flatness = np.exp(spread(roots(counts[1]), *np.log(stiffness.WIDTH_RANGE)))
    return ratio, flatness, spread(roots(counts[2]), 0.0, 1.0), spread(roots(counts[3]), *stiffness.POISSON_RANGE)


def fineness_of(spiral: Spiral) -> Fineness:
    """The mesh for the linear limit of a spiral."""
    return NARROW if spiral.scale < 9.0 and spiral.tip_gap < 0.4 else FINENESS


def relative_factor(
    compliance: np.ndarray, scale: float, height: float, twist: float, poisson: float
) -> Float[np.ndarray, " 12"]:
    """(12,) table entries of a dimensionless compliance (6, 6): its Cholesky factor relative to the beam's, logarithms
    on the diagonal."""
    base = stiffness.beams.beam_tip_compliance(
        np.array([scale]), np.array([height]), np.array([twist]), poisson
    ).values[..., 0]
    out = []
    for block, rows in zip(base, (stiffness.IN_PLANE, stiffness.OUT_OF_PLANE)):
        beam = np.zeros((3, 3))
        for value, (i, j) in zip(block, stiffness.ENTRIES):
            beam[i, j] = beam[j, i] = value
        factor = np.linalg.solve(np.linalg.cholesky(beam), np.linalg.cholesky(compliance[np.ix_(rows, rows)]))
        out += [math.log(factor[i, j]) if i == j else float(factor[i, j]) for i, j in stiffness.ENTRIES]
    return np.array(out)


def arm(spiral: Spiral, poisson: float, like: Model | None = None) -> tuple[Float[np.ndarray, " 12"], Model]:
    """Return what the table stores of one spiral: the relative factor (12)."""
    model = Model(spiral, poisson, fineness_of(spiral), like=like, whole=linear.TIP)
    motions = linear.unit_motions(model)
    compliance = linear.tip_compliance(model, motions)
    factor = relative_factor(compliance, spiral.scale, spiral.height, spiral.twist, poisson)
    return factor, model


def nodes(folder: Path, counts: tuple[int, int, int, int] = COUNTS, progress: Progress = SILENT) -> np.ndarray:
    """(Nx, Ny, Nz, Np, 12) the values at all nodes; one file a plan under ``folder``, those that exist are not made again."""
    ratios, flatnesses, shares, poissons = _axes(counts)
    folder.mkdir(parents=True, exist_ok=True)
    out = np.empty((*counts, CHANNELS))
    plans = [(i, k) for i in range(counts[0]) for k in range(counts[2])]
    for done, (i, k) in enumerate(plans):
        out[i, :, k] = plan(folder, ratios[i], shares[k] * float(table_twist_limit(ratios[i])), flatnesses, poissons)
        progress((done + 1) / len(plans), f"stiffness table: plan {done + 1} of {len(plans)}")
    return out


def plan(
    folder: Path, ratio: float, twist: float, flatnesses: np.ndarray, poissons: np.ndarray
) -> Float[np.ndarray, "flatnesses poissons 12"]:
    """Return the values of one plan's spirals, from its file under ``folder`` if that exists."""
    mesh = digest(fineness_of(Spiral(ratio, 1.0, twist)))
    name = folder / f"plan-{NODE_VERSION}-{ratio:.9f}-{twist:.9f}-{len(flatnesses)}-{len(poissons)}-{mesh}.npy"
    if name.is_file():
        return np.load(name)
    like, values = None, np.empty((len(flatnesses), len(poissons), CHANNELS))
    for j, flatness in enumerate(flatnesses):
        for p, poisson in enumerate(poissons):
            values[j, p], model = arm(Spiral(ratio, 1.0 / flatness, twist), float(poisson), like=like)
            like = like or model
    part = name.with_suffix(".part.npy")
    np.save(part, values)
    part.replace(name)
    return values


NODE_VERSION = 3  # changes whenever what ``arm`` returns does


def digest(fineness: Fineness) -> str:
    """Name of a discretisation."""
    return hashlib.sha256(json.dumps(asdict(fineness), sort_keys=True).encode()).hexdigest()[:10]


def coefficients(values: Float[np.ndarray, "x y z p channels"]) -> Float[np.ndarray, "x y z p channels"]:
    """Chebyshev coefficients of values at the nodes, exactly interpolating."""
    for axis in range(4):
        count = values.shape[axis]
        basis = np.cos(np.outer(np.arange(count), np.pi * (np.arange(count) + 0.5) / count))
        transform = 2.0 / count * basis
        transform[0] *= 0.5
        values = np.moveaxis(np.tensordot(transform, values, axes=(1, axis)), 0, axis)
    return values


def write(values: Float[np.ndarray, "x y z p channels"], path: Path, provenance: dict) -> None:
    """Write the table as the engine reads it: float32 coefficients, tiny pairs of degrees dropped."""
    c = coefficients(values)
    nx, ny, nz, npo, channels = c.shape
    pairs = np.array([(j, k) for j in range(ny) for k in range(nz)])
    arranged = c.transpose(1, 2, 4, 0, 3).reshape(ny * nz, channels, nx, npo)
    keep = np.abs(arranged).max(axis=(1, 2, 3)) > DROP
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part.npz")
    np.savez_compressed(
        part,
        coefficients=arranged[keep].astype(np.float32),
        pairs=pairs[keep].astype(np.int16),
        provenance=json.dumps(
            {"format": stiffness.FORMAT, "fineness": [asdict(FINENESS), asdict(NARROW)], **provenance}
        ),
    )
    part.replace(path)
    stiffness.load_table.cache_clear()


# Pairs of degrees whose Chebyshev coefficients are all below this are left out: of 3000 random arms, compliances out of the sheet change
# by .16 % at most in 95 of 100, by .35 % at worst (5e-4: .36 and 1.1 %). Smaller ones make the file larger and the look-up slower
DROP = 2e-4


HELD_OUT_SEED = 20180801  # of the spirals that judge the table


def held_out(count: int = 48, seed: int = HELD_OUT_SEED) -> list[tuple[Spiral, float]]:
    """Random spirals and Poisson's ratios of the region, for judging the table."""
    rng = np.random.Generator(np.random.Philox(seed))
    out = []
    for _ in range(count):
        x, y, z, p = rng.random(4)
        ratio = math.exp(math.log(5.0) + x * math.log(10.0))
        flatness = math.exp(math.log(0.3) + y * math.log(10.0))
        out.append((Spiral(ratio, 1.0 / flatness, z * float(table_twist_limit(ratio))), 0.25 + 0.17 * p))
    return out


def slender() -> list[tuple[Spiral, float]]:
    """Spirals beyond the nodes' s/w, for judging how the corrections fade there."""
    return [
        (Spiral(ratio, 1.0 / flatness, math.radians(twist)), 0.35)
        for ratio in (80.0, 120.0, 200.0)
        for twist in (0.0, 150.0, 350.0)
        for flatness in (0.3, 1.0, 3.0)
    ]


def block_errors(values: np.ndarray, spiral: Spiral, poisson: float, table: stiffness.StiffnessTable) -> np.ndarray:
    """(6,) relative errors of the table: eigenvalues of the interpolated against the true compliance, minus 1."""
    made = stiffness.blocks(
        np.array([spiral.scale]), np.array([1.0 / spiral.height]), np.array([spiral.twist]), table, poisson
    ).values[..., 0]
    out = []
    for b, entries in enumerate(made):
        true = true_block(values, spiral, poisson, b)
        found = np.zeros((3, 3))
        for value, (i, j) in zip(entries, stiffness.ENTRIES):
            found[i, j] = found[j, i] = value
        out.append(np.linalg.eigvals(np.linalg.solve(true, found)).real - 1.0)
    return np.concatenate(out)


def true_block(values: np.ndarray, spiral: Spiral, poisson: float, block: int) -> Float[np.ndarray, "3 3"]:
    """Dimensionless compliance block from what ``arm`` returned."""
    from ..engine.mechanics.arms import beams

    base = beams.beam_tip_compliance(
        np.array([spiral.scale]), np.array([spiral.height]), np.array([spiral.twist]), poisson
    ).values[block, :, 0]
    beam, factor = np.zeros((3, 3)), np.zeros((3, 3))
    for value, stored, (i, j) in zip(base, values[6 * block : 6 * block + 6], stiffness.ENTRIES):
        beam[i, j] = beam[j, i] = value
        factor[i, j] = math.exp(stored) if i == j else stored
    whole = np.linalg.cholesky(beam) @ factor
    return whole @ whole.T
