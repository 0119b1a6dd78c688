"""Three fits of one spiral's energies, all bounded linear least squares on the sums that the chunks keep.

"chord": the paper's four parameters, eq. 5 on edges from the hub to the free tips; "pair": the same four fitted on
edges from hub to hub, where the assembly uses them, to the linear limit under random joint loads of the same law; "arm": the
twelve numbers of the tip stiffness from the linear limit, which need no fitting.
"""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear

from ..engine.arrays import Float
from ..engine.errors import FlexMapsError
from ..engine.mechanics.rods import rod_stiffness as stiffness_rods
from ..engine.mechanics.rods.rod_stiffness import PARAMETERS
from ..engine.spirals.clearance.table_range import table_limit_and_slope
from . import packs, rods
from .geometry import Spiral
from .packs import Series
from .sampling import SEED, VERSION

# smallest parameter, as a share of the one that would explain all energies alone: stiffnesses stay positive
SMALLEST = 1e-3
# The same for what the networks learn, which are logarithms: smaller ones on chords, where the model is least true,
# hardly change the energies, but scatter over powers of ten with the samples
SMALLEST_MAPPED = {"pair": SMALLEST, "chord": 0.1}
FEWEST = 10  # samples a spiral below which a fit is refused
# samples a spiral below which the chord parameters scatter too much for a smooth map; their network is left out then
FEWEST_CHORD = 400
MODELS = ("chord", "pair", "arm")


def solve(matrix: np.ndarray, side: np.ndarray, count: int, least: float = SMALLEST) -> Float[np.ndarray, " p"]:
    """Positive parameters that minimise the sum of (a . p - 1)^2 over ``count`` samples (FlexMaps 6.2, eq. 5).

    ``least`` is the smallest, as a share of the one that would explain all alone.
    """
    scale = 1.0 / np.sqrt(np.diag(matrix) / count)
    scaled, right = matrix * np.outer(scale, scale), side * scale
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, 1e-12 * values[-1])
    root = np.sqrt(values)[:, None] * vectors.T
    found = lsq_linear(root, (vectors.T @ right) / np.sqrt(values), bounds=(least, np.inf), tol=1e-14)
    return found.x * scale


def parameters(series: Series, model: str, least: float = SMALLEST) -> Float[np.ndarray, " parameters"]:
    """The parameters of one model for one spiral, dimensionless: (4,), or (12,) for "arm". ``least`` as in ``solve``."""
    if model == "arm":
        return rods.stiffness_parameters(series.compliance)
    if model == "pair":
        features, energy = rods.pair_features(
            joint_loads(series.subject.spiral.scale, series.law), series.compliance, series.subject.spiral.scale
        )
        relative = features / energy[:, None]
        return solve(relative.T @ relative, relative.sum(0), len(energy), least)
    return solve(*series.normal[model], series.fitted[model], least)


def joint_loads(scale: float, law: str, count: int = 4000) -> Float[np.ndarray, "count 6"]:
    """Loads at a joint, distributed like those of a law and alike for all spirals: forces, and moments under
    the strain-targeted one."""
    rng = np.random.Generator(np.random.Philox(SEED))

    def directions() -> np.ndarray:
        v = rng.normal(size=(count, 3))
        return v / np.linalg.norm(v, axis=1, keepdims=True)

    force = directions() * rng.uniform(0.1, 1.0, (count, 1))
    moment = directions() * rng.uniform(0.0, 0.3, (count, 1)) * scale
    return np.hstack([force, moment if law == "strain" else np.zeros_like(moment)])


def held_out(series: Series, model: str) -> tuple[Float[np.ndarray, "n parameters"], Float[np.ndarray, " n"]]:
    """Of the held-out samples: energy per unit of the model's parameters, and true energies."""
    s = series.held_out
    if model == "pair":
        loads = rods.joint_wrenches(s.wrenches, s.rotations, series.rest_tips)
        return rods.pair_features(loads, series.compliance, series.subject.spiral.scale)
    if model == "arm":
        return rods.stiffness_features(rods.arm_motions(s.centres, s.rotations, series.rest_tips)), s.energy
    return rods.chord_features(s.centres, s.rotations, series.rest_tips), s.energy


def predicted(series: Series, model: str, fitted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Energies of the held-out samples: by the model with ``fitted`` parameters, and true."""
    features, true = held_out(series, model)
    return features @ fitted, true


def floor(all_series: list[Series], model: str, law: str) -> Float[np.ndarray, " samples"]:
    """Relative errors that remain where every spiral's parameters are fitted to the very samples that judge them.

    Whatever loads one fits to, their mean square is never smaller.
    """
    out = [np.zeros(0)]
    for series in all_series:
        if series.law == law and series.fitted["chord"] >= FEWEST:
            features, true = held_out(series, model)
            relative = features / true[:, None]
            out.append(np.abs(relative @ solve(relative.T @ relative, relative.sum(0), len(true)) - 1.0))
    return np.concatenate(out)


def errors(all_series: list[Series], model: str, law: str) -> Float[np.ndarray, " samples"]:
    """Relative held-out errors of all spirals under one law, each fitted on its own sums."""
    out = [np.zeros(0)]
    for series in all_series:
        if series.law == law and series.fitted["chord"] >= FEWEST:
            made, true = predicted(series, model, parameters(series, model))
            out.append(np.abs(made / true - 1.0))
    return np.concatenate(out)


def _inputs(spiral: Spiral) -> Float[np.ndarray, " 3"]:
    """Return the (3,) inputs of the network for a dimensionless spiral: ln(s/w), ln(w/h), twist / limit(s/w)."""
    limit = table_limit_and_slope(np.array(spiral.scale))[0]
    return np.array([math.log(spiral.scale), -math.log(spiral.height), spiral.twist / float(limit)])


def write_parameters(pack: Path, say: Callable[[str], None], target: Path = PARAMETERS) -> None:
    """Fit the four parameters of every spiral, train the networks, and write what the engine reads."""
    from . import network

    all_series = [s for s in packs.read(pack) if s.law == "strain" and min(s.fitted.values()) >= FEWEST]
    if len(all_series) < FEWEST:
        raise FlexMapsError(f"{len(all_series)} spirals have samples; the networks need {FEWEST} or more: build first")
    points = np.array([_inputs(s.subject.spiral) for s in all_series])
    arrays, notes = {}, {}
    for model in ("pair", "chord"):
        fewest = min(s.fitted["chord"] for s in all_series)
        if model == "chord" and fewest < FEWEST_CHORD:
            say(f"chord: left out, a spiral has {fewest} samples and its network needs {FEWEST_CHORD}")
            continue
        logs = np.log([parameters(s, model, SMALLEST_MAPPED[model]) for s in all_series])
        made, goal, left_out = network.choose(points, logs)
        arrays.update({f"{model}_{n}": v for n, v in made.arrays().items()})
        notes[model] = {
            "spread": made.spread,
            "goal": goal,
            "neurons": len(made.centres),
            "rms": made.rms,
            "leave_one_out_median": float(np.median(left_out)),
            "leave_one_out_95": float(np.quantile(left_out, 0.95)),
        }
        say(
            f"{model}: {notes[model]['neurons']} neurons, spread {made.spread:.3f}, leave one out "
            f"{100 * notes[model]['leave_one_out_median']:.1f} % median, {100 * notes[model]['leave_one_out_95']:.1f} % at 95 %"
        )
    samples = sum(s.fitted["chord"] for s in all_series)
    provenance = {
        "format": stiffness_rods.FORMAT,
        "version": VERSION,
        "spirals": len(all_series),
        "samples": samples,
        "seed": SEED,
        "loads": {
            "pair": "random forces and moments at the joint, alike for all spirals",
            "chord": "strain-targeted law",
        },
        "poisson": all_series[0].subject.poisson,
        "units": "k_s in E w^2, the others in E w^4",
        "networks": notes,
        "versions": {"python": platform.python_version(), "numpy": np.__version__},
    }
    target.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(target, provenance=json.dumps(provenance), **arrays)
    stiffness_rods.load_network.cache_clear()
    say(f"{target.name}: {len(all_series)} spirals, {samples} samples")
