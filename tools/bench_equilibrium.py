"""Benchmark of the elastic models and the equilibrium solver: accuracy, convergence and speed, beside the required values.

python3 tools/dev.py bench equilibrium [--meshes DIR] [--only PATTERNS] [--json FILE]

Figures are for the arm model, the program's default, with those of the rod model beside them. Seconds are processor seconds
with one BLAS thread, from a pose to the equilibrium, the symbolic factorisation included.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from equilibrium_cases import EDGE, MATERIAL, Subject, dome, of_mesh, of_shape, shaken, straight_row, torus
from flexmaps.engine.linalg import Pattern
from flexmaps.engine.mechanics.arms.compliances import arm_compliances
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.mechanics.elastic import ElasticModel
from flexmaps.engine.mechanics.equilibrium import solve
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.params import SimulateParams
from flexmaps.engine.runs.report import peak_memory
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.threads import one_thread
from harness import Bench, seconds, surfaces
from rows import Row, Table, at_least, at_most, note, row
from scipy.optimize import brentq
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

BENIGN = {"cubesphere", "quad_dome", "dome", "torus", "vault", "saddle", "strip"}
SECONDS = {"bunny": 1.5, "three_holes": 1.5, "spot": 1.5}  # required processor seconds, by mesh
SEEDS = 5  # perturbed starts per surface
NOISE = 0.05  # standard deviation of perturbations, as a share of an edge, and in radians
SIZES = (150, 600, 2400, 10_000, 20_000)  # approximate numbers of spirals
LARGEST = SIZES[-1]
MODELS = ("arm", "rod")


def main(arguments: list[str]) -> int:
    """Measure everything, print the table and write the rows; return 0 whatever the figures."""
    bench = Bench(
        "equilibrium", arguments, 44, only="*", meshes=True, peak=(0, "print the memory that so many spirals need")
    )
    if bench.options.peak:
        peak(bench.options.peak)
        return 0
    table, parts = (
        bench.table,
        (("closed forms", closed_forms), ("linear algebra", linear_algebra), ("scaling", scaling)),
    )
    bench.each(on_mesh, surfaces(bench.options.meshes))
    for _, part in bench.cases(parts):
        part(table)
    return bench.finish()


def both(found: Subject) -> tuple[tuple[str, ElasticModel], ...]:
    return (("arm", found.arm), ("rod", found.rod))


# -- closed forms ----------------------------------------------------------------------------------------------------

HUBS = 41  # number of hubs in the row that is bent


def closed_forms(table: Table) -> None:
    """Compare a row bent to a half circle, and a cantilever loaded at its tip, with the inextensible elastica.

    Both bend within their plane: out of it a spiral's arms also twist a little, unlike the elastica.
    """
    found = straight_row(HUBS)
    bending = {
        "arm": float(arm_compliances(found.assembly, MATERIAL).values[0].sum(axis=0)[5, 5]),
        "rod": float((1.0 / found.rod.springs[0, :, 0]).sum()),
    }
    length = EDGE * (HUBS - 1)
    arches = {name: _arch(model, EDGE / bending[name], length) for name, model in both(found)}
    for k, name in enumerate(("arch: energy against the circle's", "arch: hubs off the circle, of its length")):
        table.add(at_most("row of 41", name, 1e-3, arches["arm"][k], {"rod": f"{arches['rod'][k]:.1e}"}))
    tips = {name: _cantilever(model, found.pose, EDGE / bending[name], length) for name, model in both(found)}
    name = "cantilever: tip off the elastica, of its length"
    table.add(at_most("row of 41", name, 1e-3, tips["arm"], {"rod": f"{tips['rod']:.1e}"}))


def _arch(model: ElasticModel, stiffness: float, length: float) -> tuple[float, float]:
    """Return errors of energy and position for a row with one end clamped and the other turned by half a turn."""
    angle = np.linspace(0.0, np.pi, HUBS)
    radius = length / np.pi
    circle = radius * np.stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle], axis=1)
    pose = Pose(circle, Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0])).as_matrix())
    loads = Loads.for_spirals(HUBS, supports=np.array([0]))
    loads.fixed[-1, 3:] = True
    start = shaken(pose, NOISE * EDGE, NOISE, 0)
    start.centres[0], start.rotations[[0, -1]] = pose.centres[0], pose.rotations[[0, -1]]
    found = solve(model, start, loads, SimulateParams())
    off = np.linalg.norm(found.pose.centres - circle, axis=1).max() / length
    return abs(found.energy * 2.0 * length / (stiffness * np.pi**2) - 1.0), float(off)


def _cantilever(model: ElasticModel, straight: Pose, stiffness: float, length: float, load: float = 2.0) -> float:
    """Return the distance of the tip from the solution of Bisshopp and Drucker (1945) for a load P L^2 = ``load`` E I."""
    force = np.zeros((HUBS, 3))
    force[-1, 1] = -load * stiffness / length**2
    found = solve(model, straight, Loads.for_spirals(HUBS, supports=np.array([0]), force=force), SimulateParams())
    tip = (found.pose.centres[-1] - straight.centres[0]) / length

    def modulus(slope: float) -> tuple[float, float]:
        m = 0.5 * (1.0 + np.sin(slope))
        return m, float(np.arcsin(np.sqrt(0.5 / m)))

    def excess(slope: float) -> float:
        m, start = modulus(slope)
        return float(ellipk(m) - ellipkinc(start, m) - np.sqrt(load))

    slope = brentq(excess, 1e-6, 0.5 * np.pi - 1e-6)
    m, start = modulus(slope)
    fall = 1.0 - 2.0 / np.sqrt(load) * (ellipe(m) - ellipeinc(start, m))
    return float(np.linalg.norm(tip - [np.sqrt(2.0 * np.sin(slope) / load), -fall, 0.0]))


# -- meshes ----------------------------------------------------------------------------------------------------------


def on_mesh(name: str, polygons: PolygonMesh) -> Iterator[Row]:
    """Start from the target and from perturbed targets: iterations, residual forces, seconds, and convergence."""
    found, kind = of_mesh(name, polygons), name.removeprefix("made:")
    loads, params = Loads.for_spirals(found.assembly.size), SimulateParams()
    rest, spent, calm = {}, {}, {}
    for which, model in both(found):
        start = time.process_time()
        rest[which] = solve(model, found.pose, loads, params)
        spent[which] = time.process_time() - start
        starts = [shaken(found.pose, NOISE * EDGE, NOISE, seed) for seed in range(SEEDS)]
        calm[which] = sum(solve(model, one, loads, params).converged for one in starts)
    arm, rod = rest["arm"], rest["rod"]
    status, peer = ("yes" if one.converged else one.status for one in (arm, rod))
    beyond = {"spirals outside the rod model's range": found.outside} if found.outside else {}
    yield note(name, "spirals", found.assembly.size, beyond)
    yield row(name, "converged from the target", "yes", status, arm.converged, {"rod": peer})
    yield at_most(name, "iterations", 20 if kind in BENIGN else 50, arm.iterations, {"rod": rod.iterations})
    yield at_most(name, "relative gradient", 1e-8, arm.residual, {"rod": f"{rod.residual:.1e}"})
    yield at_least(name, "seeds of noise that converge", SEEDS, calm["arm"], {"rod": calm["rod"]})
    yield at_most(name, "seconds", SECONDS.get(kind), spent["arm"], {"rod": round(spent["rod"], 3)})
    torsion = round(arm.torsion_max, 3), {"rod": round(rod.torsion_max, 3)}
    yield note(name, "largest torsion of a joint, rad", *torsion)
    apart, rod_apart = (_apart(found, one.pose, found.pose) for one in (arm, rod))
    yield note(name, "RMS distance to the target, %", apart, {"rod": rod_apart})
    yield note(name, "RMS distance of both models, %", _apart(found, arm.pose, rod.pose))


def _apart(found: Subject, one: Pose, other: Pose) -> float:
    """Return the RMS distance of the hubs of two poses, in percent of the size."""
    apart = one.aligned(other.centres).centres - other.centres
    return round(100.0 * float(np.sqrt((apart**2).sum(axis=1).mean())) / found.size, 3)


# -- cost ------------------------------------------------------------------------------------------------------------


@one_thread
def linear_algebra(table: Table) -> None:
    """Time one Newton iteration, and a refactorisation of its matrix, for about 2400 spirals."""
    found = torus(2400)
    name, pieces = f"torus {found.assembly.size}", {}
    loads = Loads.for_spirals(found.assembly.size)
    for kind, model in both(found):
        rest = solve(model, found.pose, loads, SimulateParams())
        system = NewtonSystem(model.pairs, loads.held_increments(model.pairs, rest.pose.centres))
        state = model.start(rest.pose)
        here = model.expand(state)
        values = system.values(here.hessian)
        system.factor(values)
        step = system.solve(here.gradient)
        pieces[kind] = {
            "expand": seconds(partial(model.expand, state), 9),
            "values": seconds(partial(system.values, here.hessian), 9),
            "factor": seconds(partial(system.factor, values), 9),
            "solve": seconds(partial(system.solve, here.gradient), 9),
            "move": seconds(partial(model.moved, state, step), 9),
            "energy": seconds(partial(model.energy, state), 9),
        }
        if kind == "arm":
            others = superlu(system.pattern, values)
    ratio = {k: sum(p.values()) / (p["factor"] + p["solve"]) for k, p in pieces.items()}
    spent = {f"{k}, ms": {n: round(1e3 * t, 2) for n, t in p.items()} for k, p in pieces.items()}
    peer = {"rod": round(ratio["rod"], 2), **spent}
    table.add(at_most(name, "one iteration / (factor + solve)", 2.0, ratio["arm"], peer))
    best = min(others.values()) / pieces["arm"]["factor"]
    slow = {"SuperLU, ms": {k: round(1e3 * t) for k, t in others.items()}}
    table.add(at_least(name, "refactorisation, times faster than SuperLU", 5.0, best, slow))


def superlu(pattern: Pattern, values: np.ndarray) -> dict[str, float]:
    """Return the seconds of SuperLU's factorisation with each of its orderings, without pivoting, which is its fastest mode."""
    matrix = pattern.matrix(values)
    options = {"SymmetricMode": True}
    return {
        order: seconds(partial(splu, matrix, permc_spec=order, diag_pivot_thresh=0.0, options=options), 3)
        for order in ("MMD_AT_PLUS_A", "COLAMD", "MMD_ATA")
    }


def scaling(table: Table) -> None:
    """Time the equilibrium of smooth objects of 150 to 20,000 equal spirals, and measure the memory for the largest."""
    timed(table, of_shape("vault 2400", shapes.vault(49)), 0.5)
    timed(table, torus(2400), 1.5)
    limits = {2400: 0.5, 10_000: 6.0}
    spent = {count: timed(table, dome(count), limits.get(count)) for count in SIZES}
    timed(table, of_shape("vault 10000", shapes.vault(100)), 6.0)
    timed(table, torus(10_000), 6.0)
    for k, what in enumerate(("cost exponent, equilibrium", "cost exponent, one iteration")):
        arm, rod = (float(np.polyfit(np.log(SIZES), np.log([spent[n][m][k] for n in SIZES]), 1)[0]) for m in MODELS)
        table.add(at_most(f"dome 150-{LARGEST}", what, None if k else 1.4, arm, {"rod": round(rod, 3)}))
    tool = Path(__file__).with_name("dev.py")
    child = [sys.executable, str(tool), "bench", "equilibrium", "--peak", str(LARGEST)]
    used = float(subprocess.run(child, check=True, capture_output=True, text=True).stdout.split()[-1])
    table.add(at_most(f"dome {LARGEST}", "memory of a process of its own, MB", 4000.0, used))


def timed(table: Table, found: Subject, limit: float | None) -> dict[str, tuple[float, float]]:
    """Return the seconds to equilibrium and the seconds per iteration, for both models."""
    loads, out, rest = Loads.for_spirals(found.assembly.size), {}, {}
    for name, model in both(found):
        start = time.process_time()
        rest[name] = solve(model, found.pose, loads, SimulateParams())
        spent = time.process_time() - start
        out[name] = (spent, spent / max(rest[name].iterations, 1))
    peer: dict[str, dict[str, Any]]
    peer = {name: {"iterations": one.iterations, "converged": one.converged} for name, one in rest.items()}
    peer["rod"] = {"seconds": round(out["rod"][0], 3)} | peer["rod"]
    table.add(at_most(found.name, "seconds", limit, out["arm"][0], peer))
    return out


def peak(count: int) -> None:
    """Compute the equilibrium of one large dome and print the process's peak memory in megabytes."""
    found = dome(count)
    solve(found.arm, found.pose, Loads.for_spirals(found.assembly.size), SimulateParams())
    print(round((peak_memory() or np.nan) / 1e6))
