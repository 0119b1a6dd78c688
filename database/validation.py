"""The coarse models against full solids of whole designs: reference results, and how far the models are from them.

Every case has one small file under ``database/validation``: what the solid said, and the shape of the arms it was made of, so
that a design which would be cut differently today is solved again. Solving takes seconds to minutes a case; comparing a second.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..engine.arrays import Bool, Float, Int
from ..engine.errors import FlexMapsError
from ..engine.materials import Material
from ..engine.mechanics.assembly import Pose, assembly_from_design, target_pose
from ..engine.mechanics.elastic import ElasticModel
from ..engine.mechanics.equilibrium import Equilibrium, solve
from ..engine.mechanics.loads import GRAVITY, Loads
from ..engine.params import SimulateParams
from ..engine.progress import SILENT, Progress
from ..engine.simulation.simulate import build_model
from . import chunks
from .design_mesh import UNIT
from .design_solid import Balance, DesignSolid
from .elastic import orthotropic
from .validation_cases import Case, Loading
from .validation_rim import every_case

FOLDER = Path(__file__).resolve().parent / "validation"
VERSION = 4  # of the stored solids
MODELS = ("arm", "quick", "rod")
PARAMS = SimulateParams(iterations=400)  # of the coarse models' searches, else the program's own
SAME_SHAPE = 1e-5  # metres and radians by which the arms of a design may differ from those that were solved
ARRAYS = ("fixed", "force", "centres", "turns", "energy", "strain", "iterations")


@dataclass(frozen=True, eq=False)
class Reference:
    """What full solids say about one case, SI.

    states : their names; fixed : the prescribed shifts and turns; force : N, the sheet's weight included
    centres, turns : hubs, as positions of their quads' centres and rotation vectors
    energy : J, elastic; strain : 99 % of the volume of every spiral stays below it
    """

    case: Case
    states: tuple[str, ...]
    fixed: Bool[np.ndarray, "states spirals 6"]
    force: Float[np.ndarray, "states spirals 3"]
    centres: Float[np.ndarray, "states spirals 3"]
    turns: Float[np.ndarray, "states spirals 3"]
    energy: Float[np.ndarray, " states"]
    strain: Float[np.ndarray, "states spirals"]
    iterations: Int[np.ndarray, " states"]
    unknowns: int

    def pose(self, state: int) -> Pose:
        return Pose(self.centres[state], Rotation.from_rotvec(self.turns[state]).as_matrix())

    def size(self, state: int) -> float:
        """Metres, the diagonal of the box around the hubs."""
        return float(np.linalg.norm(np.ptp(self.centres[state], axis=0)))


def loads(case: Case, loading: Loading) -> tuple[Loads, Pose]:
    """Supports and forces of a state, the weight gathered at the hubs, and the pose at rest with held hubs where they go."""
    design = case.design
    pose, count = target_pose(case.mesh, design.flat.corners), len(case.mesh.quads)
    centres, rotations = pose.centres.copy(), pose.rotations.copy()
    fixed, force = np.zeros((count, 6), dtype=bool), np.zeros((count, 3))
    for held in loading.held:
        fixed[held.spiral, 3:] = held.turn is not None
        fixed[held.spiral, :3] = held.shift is not None
        centres[held.spiral] += held.shift or (0.0, 0.0, 0.0)
        turn = Rotation.from_rotvec(held.turn or (0.0, 0.0, 0.0)).as_matrix()
        rotations[held.spiral] = turn @ rotations[held.spiral]
    for spiral, pull in loading.forces:
        force[spiral] += pull
    if loading.weight:
        force[:, 2] -= GRAVITY * case.material.density * design.params.thickness * design.area
    return Loads(fixed, force), Pose(centres, rotations)


def model(case: Case, name: str) -> ElasticModel:
    """A coarse model of a case's design: "arm", "quick" (without the strains' second order) or "rod"."""
    kind = "rod" if name == "rod" else "arm"
    return build_model(assembly_from_design(case.design), case.material, kind, quick=name == "quick", slopes=False)


def solved(case: Case, progress: Progress = SILENT) -> dict[str, np.ndarray]:
    """The arrays of a case's file, by full solids. Raises FlexMapsError where a state finds no equilibrium."""
    rows, unknowns = [], 0
    for supports, solid, found in balances(case, progress):
        rows.append(_row(found, supports, case.material))
        unknowns = solid.unknowns
    arrays = {name: np.array([row[name] for row in rows]) for name in ARRAYS}
    header = {"version": VERSION, "case": case.identity(), "unknowns": unknowns}
    return {**arrays, "shape": shape(case), "header": np.array(json.dumps(header, sort_keys=True))}


def balances(case: Case, progress: Progress = SILENT) -> Iterator[tuple[Loads, DesignSolid, Balance]]:
    """Yield supports, solid and equilibrium of every state of a case. Raises FlexMapsError where a state finds no equilibrium."""
    coarse, material = model(case, "arm"), case.material
    solid: DesignSolid | None = None
    for number, loading in enumerate(case.loadings):
        part = progress.part(number / len(case.loadings), (number + 1) / len(case.loadings))
        supports, rest = loads(case, loading)
        guess = solve(coarse, rest, supports, PARAMS).pose
        fixed = supports.held_increments(coarse.pairs, rest.centres)
        held = np.flatnonzero(fixed.any(axis=1))
        if solid is None or solid.held != held.tolist():
            solid = solid_of(case, held.tolist())
        unit = material.youngs * UNIT**2
        pulls = np.zeros_like(supports.force)
        for spiral, pull in loading.forces:
            pulls[spiral] += pull
        load = solid.pulled(pulls / unit)
        if loading.weight:
            load += solid.weight(np.array([0.0, 0.0, -GRAVITY * material.density * UNIT**3 / unit]))
        # the last hub of a free body is held where the coarse model left it
        found = solid.solve(solid.guess(guess), guess, load, fixed[held], part)
        if not found.converged:
            raise FlexMapsError(f"The solid of case {case.name}, state {loading.name}, finds no equilibrium")
        yield supports, solid, found


def solid_of(case: Case, held: list[int]) -> DesignSolid:
    """The solid of a case's design, per its material's Young's modulus."""
    known = case.material.orthotropy
    stiffness = None if known is None else orthotropic(known, case.material.youngs, case.design.params.grain)
    return DesignSolid(case.design, case.material.poisson, held, case.resolution, stiffness=stiffness)


def _row(found: Balance, supports: Loads, material: Material) -> dict[str, Any]:
    count = len(supports.fixed)  # the nodes of a rim are left out
    return {
        "fixed": supports.fixed,
        "force": supports.force,
        "centres": found.centres[:count] * UNIT,
        "turns": Rotation.from_matrix(found.rotations[:count]).as_rotvec(),
        "energy": found.energy * material.youngs * UNIT**3,
        "strain": found.strain[:count],
        "iterations": found.iterations,
    }


def shape(case: Case) -> Float[np.ndarray, "spirals 4 numbers"]:
    """What the solid of a case is made from: the numbers of every arm of its design."""
    arms = case.design.arms
    each = np.broadcast_to
    parts = [arms.radius, arms.angle, each(arms.wind[:, None], arms.radius.shape), arms.width]
    return np.dstack([*parts, arms.joint_width, arms.blend_slope, arms.share])


def run(folder: Path, only: str | None = None, progress: Progress = SILENT) -> list[str]:
    """Solve the cases whose file is missing or of another design; the names of those solved. Goes on where it stopped."""
    folder.mkdir(parents=True, exist_ok=True)
    todo = [c for c in named(only) if not is_done(folder, c)]
    for number, case in enumerate(todo):
        part = progress.part(number / len(todo), (number + 1) / len(todo))
        chunks.write(folder / f"{case.name}.npz", chunks.archive(solved(case, part.at(0.0, case.name))))
    return [c.name for c in todo]


def named(only: str | None) -> list[Case]:
    """The cases with this text in their name. Raises FlexMapsError where there is none."""
    found = [case for case in every_case() if only is None or only in case.name]
    if not found:
        raise FlexMapsError(f"No case has '{only}' in its name; there are {', '.join(c.name for c in every_case())}")
    return found


def is_done(folder: Path, case: Case) -> bool:
    """Whether the file of a case holds the solid of its design as it is cut today, under its loads."""
    path = folder / f"{case.name}.npz"
    if not path.is_file():
        return False
    with np.load(path) as stored:
        header = json.loads(str(stored["header"]))
        if header.get("version") != VERSION or header["case"] != json.loads(json.dumps(case.identity())):
            return False
        return same_shape(stored["shape"], shape(case))


def same_shape(one: Float[np.ndarray, "spirals 4 numbers"], other: Float[np.ndarray, "spirals 4 numbers"]) -> bool:
    """Whether arms with these numbers (``shape``) are alike; an angle may be a whole turn more."""
    if one.shape != other.shape:
        return False
    apart = one - other
    apart[..., 1] = (apart[..., 1] + np.pi) % (2.0 * np.pi) - np.pi
    return bool(np.abs(apart).max() < SAME_SHAPE)


def load(folder: Path = FOLDER, only: str | None = None) -> list[Reference]:
    """All reference results of a folder whose case is still the same."""
    out = []
    for case in named(only):
        if not is_done(folder, case):
            continue
        with np.load(folder / f"{case.name}.npz") as stored:
            header, arrays = json.loads(str(stored["header"])), {n: stored[n] for n in ARRAYS}
        for k, loading in enumerate(case.loadings):
            if arrays["force"][k].any() and not arrays["fixed"][k].any():
                # forces of fixed direction turn a free body: the hub that the solid was held by belongs to the state
                supports, rest = loads(case, loading)
                arrays["fixed"][k] = supports.held_increments(assembly_from_design(case.design).pairs, rest.centres)
        states = tuple(one.name for one in case.loadings)
        out.append(Reference(case, states, unknowns=header["unknowns"], **arrays))
    return out


def compare(
    model_names: tuple[str, ...] = MODELS, folder: Path = FOLDER, only: str | None = None
) -> list[dict[str, Any]]:
    """How far the coarse models are from the reference results; one row per case, state and model.

    Every model searches from the solid's own pose, so that the nearest of several equilibria is compared. Free bodies are
    laid over each other (Procrustes). Distances of hub centres in percent of the diagonal of the box around them.
    """
    rows = []
    for reference in load(folder, only):
        for name in model_names:
            if name == "rod" and reference.case.design.rim is not None:
                continue
            coarse = model(reference.case, name)
            for k, state in enumerate(reference.states):
                named_row = {"case": reference.case.name, "state": state, "model": name}
                rows.append({**named_row, **_distance(reference, k, coarse)})
    return rows


def _distance(reference: Reference, k: int, coarse: ElasticModel) -> dict[str, Any]:
    supports, true = Loads(reference.fixed[k], reference.force[k]), reference.pose(k)
    found: Equilibrium = solve(coarse, true, supports, PARAMS)
    pose = found.pose if reference.fixed[k].any() else found.pose.aligned_to(true.centres)
    apart, size = np.linalg.norm(pose.centres - true.centres, axis=1), reference.size(k)
    return {
        "spirals": len(reference.case.mesh.quads),
        "unknowns": reference.unknowns,
        "size_mm": 1e3 * size,
        "strain_percent": 100.0 * float(reference.strain[k].max()),
        "rms_percent": 100.0 * float(np.sqrt((apart**2).mean())) / size,
        "max_percent": 100.0 * float(apart.max()) / size,
        "energy_ratio": float(found.per_joint.sum()) / float(reference.energy[k]),
        "converged": found.converged,
        "iterations": found.iterations,
    }


def line(row: dict[str, Any]) -> str:
    """One row of ``compare`` for people."""
    return (
        f"{row['case']:18s} {row['state']:10s} {row['model']:5s} {row['spirals']:3d} spirals, strain "
        f"{row['strain_percent']:.2f} %: rms {row['rms_percent']:6.3f} %, max {row['max_percent']:6.3f} %, energy "
        f"{100.0 * (row['energy_ratio'] - 1.0):+6.2f} %{'' if row['converged'] else ', not converged'}"
    )
