"""The estimate of the largest strains against full solids of whole designs, arm by arm.

Beside the designs of ``database validate`` there are optimised ones, sheets of other thickness, and hubs that turn far. What the solids
say lies in ``database/validation/strain``, one small file a case; solving takes a minute each, comparing a second.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from ..engine.arrays import Float, Int
from ..engine.materials import MATERIALS
from ..engine.mechanics.arms.cut import CutArms
from ..engine.mechanics.arms.model import ArmModel
from ..engine.mechanics.assembly import Assembly, Pose
from ..engine.mechanics.equilibrium import solve
from ..engine.mechanics.loads import Loads
from ..engine.params import Settings
from ..engine.patches.flattening.flatten import with_energies
from ..engine.patches.layout import PatchLayout
from ..engine.runs import job
from ..engine.spirals.design import SpiralDesign
from ..engine.surface import shapes
from ..engine.surface.mesh import PolygonMesh, QuadMesh
from . import chunks, validation
from .design_mesh import UNIT, Resolution
from .surface_strain import surface_strains
from .validation_cases import SIDE, Case, Held, Loading, cantilever, cells, clamped, meshable, sheet
from .validation_rim import every_case

FOLDER = validation.FOLDER / "strain"
VERSION = 1  # of the stored strains
FINE = Resolution(length=1.8, turn=0.5, blend=3)  # of the designs that are solved for their strains alone
ARRAYS = ("centres", "turns", "fixed", "force", "free", "fillet")


@dataclass(frozen=True, eq=False)
class ArmStrains:
    """What a solid says about the arms of one state of a case that meet at joints, and what the estimate says.

    spiral, side : (n,) int; joint : (n,) int; solid : farther than a fillet's reach from fillets; fillet : fillets included
    estimate : of the arm model at its own equilibrium; kink : of the joint, see ``kink_sharpness``
    """

    case: str
    spiral: Int[np.ndarray, " n"]
    side: Int[np.ndarray, " n"]
    joint: Int[np.ndarray, " n"]
    solid: Float[np.ndarray, " n"]
    fillet: Float[np.ndarray, " n"]
    estimate: Float[np.ndarray, " n"]
    kink: Float[np.ndarray, " n"]
    limit: float
    rim: bool


# -- designs -----------------------------------------------------------------------------------------------------------


def _thick(design: SpiralDesign, thickness: float) -> SpiralDesign:
    return replace(design, params=replace(design.params, thickness=thickness))


def _random(columns: int, rows: int, seed: int, thickness: float = 0.002, angle: float = 90.0) -> SpiralDesign:
    rng, n = np.random.default_rng(seed), columns * rows
    made = sheet(columns, rows, rng.uniform(1.0, 2.0, (n, 4)), rng.uniform(40.0, 300.0, n), angle=angle)
    return _thick(made, thickness)


def optimised(name: str, make: Callable[[], QuadMesh]) -> SpiralDesign:
    """A design as the optimiser leaves it under its usual settings, from its file; made where that is missing."""
    path = FOLDER / f"{name}.design.npz"
    if not path.is_file():
        mesh = make()
        found = job.run(PolygonMesh.from_quads(mesh), Settings(), edge=SIDE, stop_after="optimise")
        assert found.design is not None
        made, mesh = found.design, found.design.flat.layout.mesh
        kept = {"vertices": mesh.vertices, "quads": mesh.quads, "cut": made.flat.layout.cut, "points": made.flat.points}
        chunks.write(path, chunks.archive({**kept, "width": made.width, "twist": made.twist}))
    with np.load(path) as stored:
        mesh = QuadMesh(stored["vertices"], stored["quads"])
        flat = with_energies(PatchLayout(mesh, stored["cut"]), stored["points"])
        return meshable(SpiralDesign(flat, Settings().spiral, stored["width"], stored["twist"]))


# small surfaces that are optimised by default, by the name of their case
SURFACES: dict[str, Callable[[], QuadMesh]] = {
    "opt-cubesphere": lambda: shapes.cubesphere(3),
    "opt-torus": lambda: shapes.torus(12, 5),
    "opt-vault": lambda: shapes.vault(6),
    "opt-saddle": lambda: shapes.saddle(6),
    "opt-dome": lambda: shapes.dome(3),
}


def own_cases() -> list[Case]:
    """Those that are solved for their strains alone."""
    c, r = cells(4, 4).T
    chess = (c + r) % 2

    def turned(angle: float) -> Loading:
        far = tuple(Held(one, turn=(0.0, angle, 0.0), shift=None) for one in range(3, 16, 4))
        return Loading("turned", (*clamped(4, 4), *far))

    strips = [
        Case(
            f"strip-{twist:.0f}",
            partial(sheet, 6, 2, width, twist),
            (cantilever("bent", 6, 2, 0.0, 0.0, lift), cantilever("aside", 6, 2, 0.0, 0.3 * lift, 0.0)),
            FINE,
        )
        for twist, width, lift in ((0.0, 1.5, 0.6), (30.0, 1.5, 0.5), (90.0, 1.2, 0.25), (330.0, 1.0, 0.04))
    ]
    found = [
        Case(f"random-{h:g}", partial(_random, 4, 4, 5, 1e-3 * h), (cantilever("bent", 4, 4, 0.1, 0.05, lift),), FINE)
        for h, lift in ((1.0, 0.06), (2.0, 0.25), (4.0, 1.5))
    ]
    found += [
        Case("random-sheared", lambda: _random(5, 3, 8, angle=80.0), (cantilever("bent", 5, 3, 0.0, 0.1, 0.2),), FINE),
        Case("turned-alike", lambda: sheet(4, 4, 1.5, 200.0), (turned(-1.2),), FINE),
        Case("turned-unlike", lambda: sheet(4, 4, 1.0 + chess, 300.0 - 200.0 * chess), (turned(-1.2),), FINE),
    ]
    free, pom = (Loading("free"),), MATERIALS["pom"]
    made = [Case(n, lambda n=n, m=m: optimised(n, m), free, Resolution(), pom) for n, m in SURFACES.items()]  # type: ignore[misc]
    return strips + found + made


def strain_cases() -> list[Case]:
    """All cases whose strains are compared; of sheets with a grain the estimate tells how near arms are to their strength instead."""
    return own_cases() + [case for case in every_case() if case.material.orthotropy is None]


# -- solids ------------------------------------------------------------------------------------------------------------


def _header(case: Case) -> str:
    thickness = case.design.params.thickness
    return json.dumps({"version": VERSION, "case": case.identity() | {"thickness": thickness}}, sort_keys=True)


def run(cases: list[Case]) -> list[str]:
    """Solve the cases whose file is missing or of another design; return the names of those solved. Goes on where it stopped."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    done = []
    for case in cases:
        if is_done(case):
            continue
        chunks.write(FOLDER / f"{case.name}.npz", chunks.archive(_solved(case)))
        done.append(case.name)
    return done


def _solved(case: Case) -> dict[str, np.ndarray]:
    rows = []
    for supports, solid, found in validation.balances(case):
        free, fillet = surface_strains(solid, found.nodes)
        count = len(supports.fixed)
        turns = Rotation.from_matrix(found.rotations[:count]).as_rotvec()
        rows.append((found.centres[:count] * UNIT, turns, supports.fixed, supports.force, free, fillet))
    arrays = {name: np.array([row[k] for row in rows]) for k, name in enumerate(ARRAYS)}
    small = {name: v.astype(np.float32) if name in ("free", "fillet") else v for name, v in arrays.items()}
    return {**small, "shape": validation.shape(case), "header": np.array(_header(case))}


def is_done(case: Case) -> bool:
    """Whether the file of a case holds the solid of its design as it is cut today, under its loads."""
    path = FOLDER / f"{case.name}.npz"
    if not path.is_file():
        return False
    with np.load(path) as stored:
        same = json.loads(str(stored["header"])) == json.loads(_header(case))
        return same and validation.same_shape(stored["shape"], validation.shape(case))


def kink_sharpness(assembly: Assembly) -> Float[np.ndarray, " joints"]:
    """The sharpness (m,) of the kink at every joint.

    It is the angle by which the blend bends the more bent arm (radians), times the sheet's thickness over the width of
    the narrower arm.
    """
    arms = CutArms.from_assembly(assembly)
    bend = np.abs(arms.slope) / arms.radius
    return bend.reshape(-1, 2).max(axis=1) * assembly.thickness / assembly.arm_width.min(axis=1)


def compare(case: Case) -> list[ArmStrains]:
    """The arms of all states of a case that is solved; the model searches its equilibrium from the solid's pose."""
    with np.load(FOLDER / f"{case.name}.npz") as stored:
        arrays = {name: stored[name] for name in ARRAYS}
    coarse, out = validation.model(case, "arm"), []
    assert isinstance(coarse, ArmModel)
    for k, loading in enumerate(case.loadings):
        supports, rest = validation.loads(case, loading)
        if supports.force.any() and not supports.fixed.any():
            supports = Loads(supports.held_increments(coarse.pairs, rest.centres), supports.force)
        true = Pose(arrays["centres"][k], Rotation.from_rotvec(arrays["turns"][k]).as_matrix())
        pose = solve(coarse, true, supports, validation.PARAMS).pose
        known = coarse.assembly
        strains = coarse.strains(coarse.start(pose), case.material)
        e, at = np.nonzero(known.pairs < known.spirals)
        spiral, side = known.pairs[e, at], known.sides[e, at]
        out.append(
            ArmStrains(
                f"{case.name} {loading.name}", spiral, side, e, arrays["free"][k][spiral, side].astype(float),
                arrays["fillet"][k][spiral, side].astype(float), strains[e, at], kink_sharpness(known)[e], case.material.strain_limit,
                case.design.rim is not None,
            )
        )  # fmt: skip
    return out
