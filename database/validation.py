"""The coarse models against full solids of whole assemblies: reference results, and how far the models are from them.

Every case is one small file of SI numbers under ``database/validation``, which holds all that is needed to build the
coarse assembly again. Making them takes minutes each; comparing takes a second.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..engine.arrays import Bool, Float, Int
from ..engine.errors import FlexMapsError
from ..engine.materials import Material
from ..engine.mechanics.assembly import Assembly, Pose
from ..engine.mechanics.equilibrium import Equilibrium, solve
from ..engine.mechanics.loads import Loads
from ..engine.params import SimulateParams
from ..engine.progress import SILENT, Progress
from ..engine.simulation.simulate import build_model
from ..engine.spirals.spiral import alike
from . import chunks
from .assembly_cases import POISSON, THICKNESS, YOUNGS, Case, Loading, cases
from .assembly_solid import Balance, Welded
from .statics import Model

FOLDER = Path(__file__).resolve().parent / "validation"
VERSION = 1  # of the stored solids
MODELS = ("arm", "rod")
MATERIAL = Material(
    "Reference", YOUNGS, POISSON, 1185.0, 0.02, True, "FlexMaps section 6.2"
)  # its density and strain limit play no part


@dataclass(frozen=True, eq=False)
class Reference:
    """What full solids say about one case, SI.

    name, states : of the case and its states; fixed : the prescribed shifts and turns; force : N
    centres, turns : hubs, as mean positions and rotation vectors
    energy : J; strain : 99 % of the volume stays below it
    """

    name: str
    states: tuple[str, ...]
    assembly: Assembly
    fixed: Bool[np.ndarray, "states spirals 6"]
    force: Float[np.ndarray, "states spirals 3"]
    centres: Float[np.ndarray, "states spirals 3"]
    turns: Float[np.ndarray, "states spirals 3"]
    energy: Float[np.ndarray, " states"]
    strain: Float[np.ndarray, " states"]
    iterations: Int[np.ndarray, " states"]
    unknowns: int

    def pose(self, state: int) -> Pose:
        return Pose(self.centres[state], Rotation.from_rotvec(self.turns[state]).as_matrix())

    def size(self, state: int) -> float:
        """Metres, the diagonal of the box around the hubs."""
        return float(np.linalg.norm(np.ptp(self.centres[state], axis=0)))


def key(case: Case) -> str:
    """Changes whenever a case's geometry, loads or mesh change."""
    what = json.dumps({"version": VERSION, **case.identity()}, sort_keys=True)
    return hashlib.sha256(what.encode()).hexdigest()[:20]


def assembly(case: Case) -> Assembly:
    """The coarse assembly of a case, SI."""
    of = case.of
    width = np.array([d.width for d in case.designs])
    twist = np.radians([d.twist for d in case.designs])
    pairs, lever, axes = case.joints()
    return Assembly(pairs, case.plan.arms, lever, axes, alike(width[of]), twist[of], THICKNESS)


def loads(case: Case, loading: Loading) -> tuple[Loads, Pose]:
    """Supports and forces of a state, and the pose at rest with the held hubs where they are to be held."""
    centres, rotations = (part.copy() for part in case.rest)
    fixed, force = np.zeros((case.plan.count, 6), dtype=bool), np.zeros((case.plan.count, 3))
    for held in loading.held:
        fixed[held.spiral, 3:] = True
        fixed[held.spiral, :3] = held.shift is not None
        centres[held.spiral] += held.shift or (0.0, 0.0, 0.0)
        rotations[held.spiral] = Rotation.from_rotvec(held.turn).as_matrix() @ rotations[held.spiral]
    for spiral, pull in loading.forces:
        force[spiral] += pull
    return Loads(fixed, force), Pose(centres, rotations)


def coarse(parts: Assembly, name: str, start: Pose, supports: Loads, progress: Progress = SILENT) -> Equilibrium:
    """Equilibrium of a coarse model; the same search as the program's own."""
    params = SimulateParams(model=name, iterations=400)
    return solve(build_model(parts, MATERIAL, name), start, supports, params, progress)


def solved(case: Case, progress: Progress = SILENT) -> dict[str, np.ndarray]:
    """The arrays of a case's file, by full solids. Raises FlexMapsError where a state finds no equilibrium."""
    models = [Model(d.spiral, POISSON, case.fineness) for d in case.designs]
    unit = case.designs[0].width
    parts = assembly(case)
    rows: list[dict[str, Any]] = []
    welded: Welded | None = None
    for number, loading in enumerate(case.loadings):
        part = progress.part(number / len(case.loadings), (number + 1) / len(case.loadings))
        supports, rest = loads(case, loading)
        guess = coarse(parts, "arm", rest, supports).pose
        fixed = supports.held(parts.pairs, rest.centres)
        held = np.flatnonzero(fixed.any(axis=1))
        if welded is None or welded.held != held.tolist():
            welded = Welded(case.plan, models, case.of, held.tolist())
        start = welded.guess(guess.centres / unit, guess.rotations)
        found = welded.solve(
            start,
            guess.centres[held] / unit,
            guess.rotations[held],
            supports.force / (YOUNGS * unit**2),
            fixed[held],
            part,
        )
        if not found.converged:
            raise FlexMapsError(f"The solid of case {case.name}, state {loading.name}, finds no equilibrium")
        rows.append(_row(found, unit, supports))
    arrays = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    header = {"key": key(case), "case": case.identity(), "unknowns": welded.size if welded else 0}
    return {**arrays, "header": np.array(json.dumps(header, sort_keys=True))}


def _row(found: Balance, unit: float, supports: Loads) -> dict[str, Any]:
    return {
        "fixed": supports.fixed,
        "force": supports.force,
        "centres": found.centres * unit,
        "turns": Rotation.from_matrix(found.rotations).as_rotvec(),
        "energy": found.energy * YOUNGS * unit**3,
        "strain": found.strain,
        "iterations": found.iterations,
    }


def run(folder: Path, only: str | None = None, progress: Progress = SILENT) -> list[str]:
    """Solve the cases whose file is missing or of another version; the names of those solved. Goes on where it stopped."""
    folder.mkdir(parents=True, exist_ok=True)
    todo = [c for c in cases() if (only is None or only in c.name) and not is_done(folder, c)]
    for number, case in enumerate(todo):
        part = progress.part(number / len(todo), (number + 1) / len(todo))
        chunks.write(folder / f"{case.name}.npz", chunks.archive(solved(case, part)))
    return [c.name for c in todo]


def is_done(folder: Path, case: Case) -> bool:
    path = folder / f"{case.name}.npz"
    if not path.is_file():
        return False
    with np.load(path) as stored:
        return json.loads(str(stored["header"]))["key"] == key(case)


def load(folder: Path = FOLDER) -> list[Reference]:
    """All reference results of a folder whose case is still the same."""
    out = []
    for case in cases():
        if not is_done(folder, case):
            continue
        with np.load(folder / f"{case.name}.npz") as stored:
            header = json.loads(str(stored["header"]))
            names = ("fixed", "force", "centres", "turns", "energy", "strain", "iterations")
            arrays = {n: stored[n] for n in names}
        parts = assembly(case)
        for k, loading in enumerate(case.loadings):
            if arrays["force"][k].any() and not arrays["fixed"][k].any():
                # forces of fixed direction turn a free body: the hub that the solid was held by belongs to the state
                supports, rest = loads(case, loading)
                arrays["fixed"][k] = supports.held(parts.pairs, rest.centres)
        states = tuple(l.name for l in case.loadings)
        out.append(Reference(case.name, states, parts, unknowns=header["unknowns"], **arrays))
    return out


def compare(model_names: tuple[str, ...] = MODELS, folder: Path = FOLDER) -> list[dict[str, Any]]:
    """How far the coarse models are from the reference results; one row per case, state and model.

    Every model searches from the solid's own pose, so that the nearest of several equilibria is compared. Free bodies are
    laid over each other (Procrustes). Distances of hub centres in percent of the diagonal of the box around them.
    """
    rows = []
    for reference in load(folder):
        for k, state in enumerate(reference.states):
            for name in model_names:
                rows.append({"case": reference.name, "state": state, "model": name, **_distance(reference, k, name)})
    return rows


def _distance(reference: Reference, k: int, name: str) -> dict[str, Any]:
    supports, true = Loads(reference.fixed[k], reference.force[k]), reference.pose(k)
    found = coarse(reference.assembly, name, true, supports)
    pose = found.pose if reference.fixed[k].any() else found.pose.aligned(true.centres)
    apart, size = np.linalg.norm(pose.centres - true.centres, axis=1), reference.size(k)
    elastic = float(found.per_joint.sum())
    return {
        "spirals": reference.assembly.size,
        "unknowns": reference.unknowns,
        "size_mm": 1e3 * size,
        "strain_percent": 100.0 * float(reference.strain[k]),
        "rms_percent": 100.0 * float(np.sqrt((apart**2).mean())) / size,
        "max_percent": 100.0 * float(apart.max()) / size,
        "energy_ratio": elastic / float(reference.energy[k]),
        "converged": found.converged,
        "iterations": found.iterations,
    }


def line(row: dict[str, Any]) -> str:
    """One row of ``compare`` for people."""
    return (
        f"{row['case']:13s} {row['state']:10s} {row['model']:4s} {row['spirals']:3d} spirals, strain "
        f"{row['strain_percent']:.2f} %: rms {row['rms_percent']:6.3f} %, max {row['max_percent']:6.3f} %, energy "
        f"{row['energy_ratio']:.3f}{'' if row['converged'] else ', not converged'}"
    )
