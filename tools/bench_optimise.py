"""Measures inverse design: one press of *Optimise*, and the publication's problem beside L-BFGS-B and the published table.

python3 tools/dev.py bench optimise [--meshes DIR] [--only PATTERNS] [--runs N] [--press] [--json FILE]

Seconds are processor seconds on one thread. Every mesh is scaled to quads of 20 mm and cut from a 2 mm sheet of 2600 MPa. Open surfaces
stand on their lowest spirals, as the published shell does.

"One press" is one press of *Optimise* at the usual settings: strains within the material's short-term limit, slots that stay open, and flat
shapes that move. Rows hold the median of several presses, and all of their values: starting widths differ by rounding, because a search
that rounds otherwise ends elsewhere. "Published problem" is the spirals alone, however strained; "within limit" keeps the material's
limit. With --press only the presses are measured.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.assembly import Assembly, assembly_from_design, target_pose
from flexmaps.engine.mechanics.elastic import ElasticModel
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.optimisation import optimise, task
from flexmaps.engine.optimisation.design_space import DesignSpace
from flexmaps.engine.optimisation.inverse import DesignPoint, InverseProblem
from flexmaps.engine.optimisation.objective import Target
from flexmaps.engine.optimisation.optimisers import SearchRecord, gauss_newton
from flexmaps.engine.params import LayoutParams, OptimiseParams, Settings, SimulateParams
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.simulation.simulate import build_model
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.threads import one_thread
from harness import EDGE, Bench, from_folder, surfaces
from lbfgs import lbfgs
from rows import Row, at_most, note, row

RUNS = 5  # presses of *Optimise* on every mesh
ROUNDING = 1e-12  # relative difference of the starting widths of two presses
FIRST_PICTURE = 0.5  # seconds after a press within which the piece should begin to move
MATERIAL = MATERIALS["vero"]  # 2600 MPa
BASELINE_STEPS = 150  # of L-BFGS
LOW = 0.05  # share of the height below which open surfaces are supported


@dataclass(frozen=True)
class Published:
    """A row of the publication's table 1 (a 3.1 GHz quad-core of 2013), and how much faster we want to be."""

    name: str
    spirals: int
    patches: int
    seconds: float
    rmse: float
    faster: float | None = None


# by our name of the surface
PUBLISHED = {
    "cubesphere": Published("Sphere", 137, 1, 1.41, 0.259, 10.0),
    "three_holes": Published("3Holes", 937, 17, 21.23, 0.185, 15.0),
    "bunny": Published("Bunny", 2412, 52, 179.0, 0.610, 60.0),
    "vault": Published("Shell", 1296, 4, 28.79, 0.107),
    "flower_cmc1": Published("Shell", 1296, 4, 28.79, 0.107),
}
MEASURED = (*PUBLISHED, "spot")


@dataclass(frozen=True)
class Wanted:
    """What one press should reach; seconds : at best, and at least; rmse : mm; rms : RMS distance in %."""

    seconds: tuple[float, float]
    rmse: float
    rms: float


# what one press should reach, by our name of the surface
WANTED = {
    "cubesphere": Wanted((3.0, 4.0), 0.210, 0.6),
    "three_holes": Wanted((8.0, 11.0), 0.180, 0.6),
    "vault": Wanted((9.0, 12.0), 0.022, 0.6),
    "flower_cmc1": Wanted((14.0, 18.0), 1.10, 0.6),
    "bunny": Wanted((20.0, 27.0), 0.90, 1.0),
    "spot": Wanted((30.0, 40.0), 0.72, 1.0),
}
STANDING = Settings(layout=LayoutParams(seamless=True))  # what stands on supports may be one panel
LARGE_SIDE = 100  # quads along either side of the largest vault


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    runs, only_press = (RUNS, "presses of every mesh"), (False, "only the presses, not the published problem")
    bench = Bench("optimise", arguments, 46, only="*", meshes=True, runs=runs, press=only_press)
    options = bench.options
    if options.meshes is None:
        measured = {name.removeprefix("made:"): make for name, make in surfaces(None).items()}
        names = {*MEASURED, "dome", "torus"}
    else:
        measured, names = from_folder(options.meshes), {*MEASURED}
    wanted = {name: make for name, make in measured.items() if name in names}
    bench.each(_rows, wanted, options.runs, options.press)
    return bench.finish(*(large() if bench.asked("large") and not options.press else ()))


def _rows(name: str, polygons: PolygonMesh, runs: int, only_press: bool) -> list[Row]:
    found = job.run(polygons, STANDING, edge=EDGE, stop_after="spirals")
    return [*press(name, found, runs), *([] if only_press else published_problem(name, found))]


def supports(mesh: QuadMesh) -> np.ndarray | None:
    """Return the spirals that support an open surface; None for a closed one."""
    if not mesh.border.any():
        return None
    low = mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + LOW * np.ptp(mesh.vertices[:, 2])
    return np.flatnonzero(low[mesh.quads].sum(axis=1) >= 2)


@one_thread
def press(name: str, found: Result, runs: int) -> list[Row]:
    """Return the rows of some presses of *Optimise* at the usual settings, from widths that differ by rounding."""
    design, held, wanted = found.design, supports(found.mesh), WANTED.get(name)
    assert design is not None
    values: dict[str, list[float]] = {}
    for k in range(runs):
        pictures: list[float] = []
        started = time.process_time()
        progress = Progress(shown=lambda _: pictures.append(time.process_time() - started))  # noqa: B023
        given = replace(design, width=design.width * (1.0 + k * ROUNDING))
        result = optimise.optimise(
            given, found.mesh, MATERIAL, OptimiseParams(), SimulateParams(), supports=held, progress=progress
        )
        seconds, report, slots = time.process_time() - started, result.report(), result.after.slots()
        assert slots is not None
        figures = {
            "seconds": seconds,
            "seconds to the first picture": pictures[0],
            "rmse mm": report["laplacian_rmse_mm"],
            "rms %": report["rms_percent"],
            "strain / limit": report["strain_share_max"],
            "closed slots": len(slots.closed),
            "smallest slot mm": 1e3 * float(slots.width.min()),
            "evaluations": report["evaluations"],
        }
        for key, value in figures.items():
            values.setdefault(key, []).append(float(f"{value:.4g}"))
    limits = {"seconds to the first picture": FIRST_PICTURE, "strain / limit": 1.0, "closed slots": 0.0}
    if wanted is not None:
        limits |= {"seconds": wanted.seconds[0], "rmse mm": wanted.rmse, "rms %": wanted.rms}
    rows = []
    for key, each in values.items():
        peers = {"presses": each} | ({"at least wanted": wanted.seconds[1]} if wanted and key == "seconds" else {})
        rows.append(at_most(name, f"one press: {key}", limits.get(key), float(np.median(each)), peers))
    return rows


@one_thread
def published_problem(name: str, found: Result) -> list[Row]:
    """Return the rows of the publication's problem: the spirals alone, however strained, and within the limit."""
    design, mesh, published = found.design, found.mesh, PUBLISHED.get(name)
    assert design is not None
    held = supports(mesh)
    free = OptimiseParams(strain_share=0.0, codesign=False, open_slots=False)
    result = optimise.optimise(design, mesh, MATERIAL, free, SimulateParams(), supports=held)
    block = result.report()
    borne = optimise.optimise(design, mesh, MATERIAL, OptimiseParams(codesign=False), SimulateParams(), supports=held)
    ours, theirs = _optimisers(design, mesh, held)
    rows = [
        note(name, "spirals", len(design.width), {"published": published.spirals} if published else None),
        _faster(name, ours[1], published),
        at_most(name, "value / L-BFGS-B", 1.01, round(ours[0].value / theirs[0].value, 4)),
        at_most(name, "time / L-BFGS-B", 0.2, round(ours[1] / theirs[1], 3)),
        note(name, "steps, evaluations", f"{len(ours[2].rows)}, {ours[2].evaluations}", {
            "L-BFGS-B": f"{len(theirs[2].rows)}, {theirs[2].evaluations}"}),
        at_most(name, "rmse mm", published.rmse if published else None, round(block["laplacian_rmse_mm"], 4)),
        at_most(name, "rms %", 1.0, round(block["rms_percent"], 3)),
        note(name, "strain / limit", round(result.after.report()["strain_share_max"], 2)),
        note(name, "rmse mm, within limit", round(borne.report()["laplacian_rmse_mm"], 4)),
        note(name, "rms %, within limit", round(borne.report()["rms_percent"], 3)),
        note(name, "strain, within limit", round(borne.after.report()["strain_share_max"], 2)),
    ]  # fmt: skip
    return [one | {"row": f"published problem: {one['row']}"} for one in rows]


def _faster(name: str, seconds: float, published: Published | None) -> Row:
    if published is None or published.faster is None:
        return note(name, "seconds", round(seconds, 2))
    ratio = published.seconds / seconds
    peer = {"published": published.seconds, "times faster": round(ratio, 1)}
    return row(name, "seconds", f">= {published.faster:g}x", round(seconds, 2), ratio >= published.faster, peer)


Run = tuple[DesignPoint, float, SearchRecord]


def _optimisers(design: SpiralDesign, mesh: QuadMesh, held: np.ndarray | None) -> tuple[Run, Run]:
    """Run our optimiser and the baseline on one problem from one start: best point, processor seconds, trace."""
    assembly = assembly_from_design(design)
    loads = Loads.for_spirals(assembly.size, supports=held)
    aim = Target(assembly.pairs, mesh.centroids, supports=held)
    space = DesignSpace.from_design(design, assembly)
    x, pose = space.coordinates(design.width, design.twist), target_pose(mesh, design.flat.corners)
    runs = []
    # the line search of L-BFGS-B needs exact equilibria: with ours it ends at once
    for method, params, tolerance in (
        (gauss_newton, OptimiseParams(), task.COARSE_TOLERANCE),
        (lbfgs, OptimiseParams(iterations=BASELINE_STEPS), SimulateParams().tolerance),
    ):
        trace, started = SearchRecord(), time.process_time()
        whole = InverseProblem(assembly, space, aim, loads, _quick, SimulateParams(tolerance=tolerance))
        best = method(whole, whole.at(x, pose), params, trace, lambda point: None)
        runs.append((best, time.process_time() - started, trace))
    return runs[0], runs[1]


def _quick(assembly: Assembly, progress: Progress) -> ElasticModel:
    return build_model(assembly, MATERIAL, "arm", quick=True, progress=progress)


@one_thread
def large() -> list[Row]:
    """A vault of 10,000 spirals that stands on its feet."""
    from flexmaps.engine.surface import shapes

    vault = shapes.vault(LARGE_SIDE)
    found = job.run(PolygonMesh.from_quads(vault), STANDING, edge=EDGE, stop_after="spirals")
    assert found.design is not None
    started, alone = time.process_time(), OptimiseParams(codesign=False)
    result = optimise.optimise(
        found.design, found.mesh, MATERIAL, alone, SimulateParams(), supports=supports(found.mesh)
    )
    seconds, block, name = time.process_time() - started, result.report(), f"vault {len(vault.quads)}"
    before, after = block["laplacian_rmse_mm_before"], block["laplacian_rmse_mm"]
    return [
        at_most(name, "seconds whole", 60.0, round(seconds, 1)),
        note(name, "steps, evaluations", f"{block['iterations']}, {block['evaluations']}"),
        note(name, "rmse mm", f"{before:.3f} to {after:.3f}"),
    ]
