"""Benchmark of the equilibrium solver: convergence and speed, beside the required values.

Pieces have the arm model, the program's default; ``database validate`` compares both models with solids. Seconds are processor
seconds with one BLAS thread, from a pose to the equilibrium, the symbolic factorisation included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flexmaps.engine.materials import find_material
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.equilibrium import Equilibrium, solve
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.params import LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.runs.report import peak_memory
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.curvature import rms_curvature
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from harness import EDGE, Bench, Cases, Options, Rows, at_least, at_most, for_each, measure_time, run_job, surfaces

BENIGN = {"cubesphere", "quad_dome", "dome", "torus", "vault", "saddle", "strip"}
SECONDS = {"bunny": 1.5, "three_holes": 1.5, "spot": 1.5}  # required processor seconds, by mesh
SEEDS = 5  # perturbed starts per surface
NOISE = 0.05  # standard deviation of perturbations, as a share of an edge, and in radians
LARGEST = 20_000  # spirals of the largest dome
GROWTH = 1.4  # largest exponent of the seconds by the number of spirals
MEGABYTES = 4000.0  # largest memory of this process after the largest dome


@dataclass(frozen=True, eq=False)
class Subject:
    """Spirals and joints with their elastic model, and their pose in the target."""

    model: ArmModel
    pose: Pose

    @classmethod
    def from_design(cls, design: SpiralDesign, mesh: QuadMesh) -> Subject:
        model = ArmModel.from_assembly(assembly_from_design(design), find_material("vero"))
        return cls(model, target_pose(mesh, design.flat.corners))

    @classmethod
    def from_shape(cls, mesh: QuadMesh) -> Subject:
        """Equal spirals in the traced patches of a smooth surface, as it is: quick for any number of quads."""
        mesh = mesh.with_vertices(mesh.vertices * (EDGE / mesh.median_edge))
        flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
        return cls.from_design(fabricable.uniform_design(flat, SpiralParams(), twist=1.5), mesh)

    def solve(self, seed: int | None = None) -> Equilibrium:
        """Find the equilibrium without loads and supports, from the target or with every hub shifted and turned at random."""
        start, size = self.pose, len(self.pose.centres)
        if seed is not None:
            noise = np.random.default_rng(seed).normal(size=(size, 6))
            start = start.moved(noise * np.repeat([NOISE * EDGE, NOISE], 3))
        return solve(self.model, start, Loads.for_spirals(size), SimulateParams())


def rows_of_mesh(name: str, polygons: PolygonMesh, _: Options) -> Rows:
    """Start from the target and from perturbed targets: iterations, residual forces, seconds, and convergence."""
    result = run_job(polygons, "merge")
    design = fabricable.design_from_curvature(result.flat, SpiralParams(), rms_curvature(result.mesh))
    piece, kind = Subject.from_design(design, result.mesh), name.removeprefix("made:")
    spent, rest = measure_time(piece.solve)
    calm = sum(piece.solve(seed).converged for seed in range(SEEDS))
    yield at_least(name, "converged from the target", 1, rest.converged, {"spirals": len(design.width)})
    yield at_most(name, "iterations", 20 if kind in BENIGN else 50, rest.iterations)
    yield at_most(name, "relative gradient", 1e-8, rest.residual)
    yield at_least(name, "seeds of noise that converge", SEEDS, calm)
    yield at_most(name, "seconds", SECONDS.get(kind), spent)


def dome(count: int) -> Subject:
    """Half a sphere of about ``count`` spirals."""
    return Subject.from_shape(shapes.dome(2 * round(0.5 * np.sqrt(count / 3.0))))


def torus(count: int) -> Subject:
    """A torus of about ``count`` spirals. Its long strips are flattened with strains at the limit, so that it buckles."""
    across = round(np.sqrt(count / 2.5))
    return Subject.from_shape(shapes.torus(round(2.5 * across), across))


def vault(count: int) -> Subject:
    """A vault of about ``count`` spirals."""
    return Subject.from_shape(shapes.vault(round(count**0.5)))


# makers, numbers of spirals, required seconds
SIZES = ((dome, 150, None), (dome, 600, None), (dome, 2400, 0.5), (dome, 10_000, 6.0), (dome, LARGEST, None))
OTHERS = ((vault, 2400, 0.5), (torus, 2400, 1.5), (vault, 10_000, 6.0), (torus, 10_000, 6.0))  # as above


def rows_of_sizes(_: Options) -> Rows:
    """Time the equilibrium of smooth objects of 150 to 20,000 equal spirals, and measure the memory after the largest dome."""
    spent = []
    for make, count, limit in (*SIZES, *OTHERS):
        seconds, rest = measure_time(make(count).solve)
        spent.append(seconds)
        how = {"iterations": rest.iterations, "converged": rest.converged}
        yield at_most(f"{make.__name__} {count}", "seconds", limit, seconds, how)
        if count == LARGEST:
            yield at_most(f"dome {count}", "memory of the process, MB", MEGABYTES, 1e-6 * (peak_memory() or np.nan))
    counts = [count for _, count, _ in SIZES]
    exponent = float(np.polyfit(np.log(counts), np.log(spent[: len(SIZES)]), 1)[0])
    yield at_most("domes", "cost exponent, equilibrium", GROWTH, exponent)


def cases(options: Options) -> Cases:
    return for_each(rows_of_mesh, surfaces(options)) | {"scaling": rows_of_sizes}


main = Bench("equilibrium", cases, meshes=True)
