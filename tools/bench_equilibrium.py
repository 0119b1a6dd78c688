"""Benchmark of the equilibrium solver: convergence and speed, beside the required values.

python3 tools/dev.py bench equilibrium [--meshes DIR] [--only PATTERNS] [--json FILE]

Pieces have the arm model, the program's default; ``database validate`` compares both models with solids. Seconds are processor
seconds with one BLAS thread, from a pose to the equilibrium, the symbolic factorisation included.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from flexmaps.engine.materials import material
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.equilibrium import Equilibrium, solve
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.params import LayoutParams, Settings, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.runs import job
from flexmaps.engine.runs.report import peak_memory
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.curvature import rms_curvature
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from harness import EDGE, Bench, surfaces
from rows import Row, at_least, at_most, note, row

BENIGN = {"cubesphere", "quad_dome", "dome", "torus", "vault", "saddle", "strip"}
SECONDS = {"bunny": 1.5, "three_holes": 1.5, "spot": 1.5}  # required processor seconds, by mesh
SEEDS = 5  # perturbed starts per surface
NOISE = 0.05  # standard deviation of perturbations, as a share of an edge, and in radians
LARGEST = 20_000  # spirals of the largest dome
SIZES = {150: None, 600: None, 2400: 0.5, 10_000: 6.0, LARGEST: None}  # required seconds by number of spirals
GROWTH = 1.4  # largest exponent of the seconds by the number of spirals
MEGABYTES = 4000.0  # largest memory for so many spirals


@dataclass(frozen=True, eq=False)
class Subject:
    """Spirals and joints with their elastic model, and their pose in the target."""

    model: ArmModel
    pose: Pose

    @classmethod
    def from_design(cls, design: SpiralDesign, mesh: QuadMesh) -> Subject:
        model = ArmModel.from_assembly(assembly_from_design(design), material("vero"))
        return cls(model, target_pose(mesh, design.flat.corners))

    @classmethod
    def from_shape(cls, mesh: QuadMesh) -> Subject:
        """Equal spirals in the traced patches of a smooth surface, as it is: quick for any number of quads."""
        mesh = mesh.moved(mesh.vertices * (EDGE / mesh.median_edge))
        flat = flatten.flatten(trace.trace(mesh, LayoutParams()), LayoutParams())
        return cls.from_design(fabricable.uniform_design(flat, SpiralParams(), twist=1.5), mesh)

    @property
    def size(self) -> int:
        """Number of spirals."""
        return len(self.pose.centres)

    def solve(self, start: Pose | None = None) -> Equilibrium:
        """Find the equilibrium without loads and supports, from the target or another pose."""
        return solve(self.model, start or self.pose, Loads.for_spirals(self.size), SimulateParams())

    def shaken(self, seed: int) -> Pose:
        """Return the pose with every hub shifted and turned at random."""
        noise = np.random.default_rng(seed).normal(size=(self.size, 6))
        return self.pose.moved(noise * np.repeat([NOISE * EDGE, NOISE], 3))


def main(arguments: list[str]) -> int:
    """Measure everything, print the table and write the rows; return 0 whatever the figures."""
    peak = (0, "print the memory that so many spirals need")
    bench = Bench("equilibrium", arguments, 44, only="*", meshes=True, peak=peak)
    if bench.options.peak:
        dome(bench.options.peak).solve()
        print(round((peak_memory() or np.nan) / 1e6))
        return 0
    bench.each(rows_of_mesh, surfaces(bench.options.meshes))
    if bench.asked("scaling"):
        bench.measure(rows_of_sizes, "scaling")
    return bench.finish()


def rows_of_mesh(name: str, polygons: PolygonMesh) -> Iterator[Row]:
    """Start from the target and from perturbed targets: iterations, residual forces, seconds, and convergence."""
    result = job.run(polygons, Settings(), edge=EDGE, stop_after="merge")
    assert result.flat is not None
    design = fabricable.design_from_curvature(result.flat, SpiralParams(), rms_curvature(result.mesh))
    piece, kind = Subject.from_design(design, result.mesh), name.removeprefix("made:")
    start = time.process_time()
    rest = piece.solve()
    spent = time.process_time() - start
    calm = sum(piece.solve(piece.shaken(seed)).converged for seed in range(SEEDS))
    apart = rest.pose.aligned(piece.pose.centres).centres - piece.pose.centres
    size = np.linalg.norm(np.ptp(piece.pose.centres, axis=0))
    yield note(name, "spirals", piece.size)
    yield row(name, "converged from the target", "yes", "yes" if rest.converged else rest.status, rest.converged)
    yield at_most(name, "iterations", 20 if kind in BENIGN else 50, rest.iterations)
    yield at_most(name, "relative gradient", 1e-8, rest.residual)
    yield at_least(name, "seeds of noise that converge", SEEDS, calm)
    yield at_most(name, "seconds", SECONDS.get(kind), spent)
    yield note(name, "largest torsion of a joint, rad", round(rest.torsion_max, 3))
    yield note(name, "RMS distance to the target, %", round(100.0 * float(np.sqrt((apart**2).sum(1).mean()) / size), 3))


def dome(count: int) -> Subject:
    """Half a sphere of about ``count`` spirals."""
    return Subject.from_shape(shapes.dome(2 * round(0.5 * np.sqrt(count / 3.0))))


def torus(count: int) -> Subject:
    """A torus of about ``count`` spirals. Its long strips are flattened with strains at the limit, so that it buckles."""
    across = round(np.sqrt(count / 2.5))
    return Subject.from_shape(shapes.torus(round(2.5 * across), across))


def rows_of_sizes(_: str) -> Iterator[Row]:
    """Time the equilibrium of smooth objects of 150 to 20,000 equal spirals, and measure the memory for the largest."""
    others = {"vault 2400": 0.5, "torus 2400": 1.5, "vault 10000": 6.0, "torus 10000": 6.0}
    spent = []
    for name, limit in ({f"dome {count}": limit for count, limit in SIZES.items()} | others).items():
        kind, count = name.split()
        make = {"dome": dome, "torus": torus, "vault": lambda n: Subject.from_shape(shapes.vault(round(n**0.5)))}[kind]
        piece = make(int(count))
        start = time.process_time()
        rest = piece.solve()
        spent.append(time.process_time() - start)
        yield at_most(name, "seconds", limit, spent[-1], {"iterations": rest.iterations, "converged": rest.converged})
    exponent = float(np.polyfit(np.log(list(SIZES)), np.log(spent[: len(SIZES)]), 1)[0])
    yield at_most("domes", "cost exponent, equilibrium", GROWTH, exponent)
    tool = Path(__file__).with_name("dev.py")
    child = [sys.executable, str(tool), "bench", "equilibrium", "--peak", str(LARGEST)]
    used = float(subprocess.run(child, check=True, capture_output=True, text=True).stdout.split()[-1])
    yield at_most(f"dome {LARGEST}", "memory of a process of its own, MB", MEGABYTES, used)
