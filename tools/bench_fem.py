"""``python3 tools/dev.py bench fem``: accuracy and speed of the solid model, measured beside required values."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from harness import Bench, seconds
from rows import Row, at_most

most = partial(at_most, "spirals")


def against_finer_meshes() -> list[Row]:
    """Compare energies with those of a mesh about four times as fine, at the corners of the sampled parameters, for given strains."""
    from flexmaps.database.sampling import Sampler, subjects
    from flexmaps.database.solid import Fineness
    from flexmaps.database.statics import Model

    corners = [s for s in subjects() if s.scale in (0.01, 0.03) and s.width in (0.001, 0.002)]
    found = []
    for s in (corners[k] for k in (0, 4, 5, 9, 10, 14, 15, 19)):
        sampler = Sampler(s, "strain")
        fine = Model(s.spiral, s.poisson, Fineness(length=1.5, turn=0.4, across=3, root=0.35))
        for number in (1, 2):
            wrenches = sampler.wrenches(number)
            ours, reference = (m.solve(m.loads(wrenches)) for m in (sampler.model, fine))
            if ours.converged and reference.converged:
                found.append(abs(ours.energy / reference.energy - 1.0))
    return [
        most("energy against a refined mesh, median %", 1.0, 100 * float(np.median(found))),
        most("energy against a refined mesh, worst %", 2.0, 100 * max(found)),
    ]


def against_scikit_fem() -> list[Row]:
    from flexmaps.database.design_mesh import UNIT
    from flexmaps.database.design_solid import DesignSolid
    from flexmaps.database.validation_cases import sheet
    from flexmaps.engine.mechanics.assembly import target_pose
    from peer_scikit import pair_motion

    # different widths and twists, so that the joint is blended
    pair = DesignSolid(sheet(2, 1, np.array([1.0, 2.0]), np.array([120.0, 0.0])), 0.3, [0])
    rest = target_pose(pair.design.flat.layout.mesh, pair.design.flat.corners)
    force = np.array([1.0, 2.0, 3.0]) * 1e-7  # so small that both sides are linear
    found = pair.solve(pair.guess(rest), rest, pair.pulled(np.array([np.zeros(3), force])))
    moved = found.centres[1] - rest.centres[1] / UNIT
    judged = pair_motion(pair, rest.centres / UNIT, force, 0.3)
    error = 100 * float(np.linalg.norm(moved - judged) / np.linalg.norm(moved))
    return [most("motion of a blended pair of spirals against scikit-fem, %", 0.5, error)]


def speed() -> list[Row]:
    from flexmaps.database.sampling import Sampler, subjects
    from flexmaps.engine.linalg import SparseCholesky

    usual, superlu, chosen = [], [], subjects()
    for s in chosen[::6]:
        sampler = Sampler(s, "strain")
        tangent = sampler.model.rest_stiffness()
        peer = SparseCholesky(sampler.model.pattern, "superlu")
        superlu.append(seconds(partial(peer.factor, tangent)))
        loads = [sampler.model.loads(sampler.wrenches(k)) for k in range(3)]
        usual += [seconds(partial(sampler.model.solve, load)) for load in loads[1:]]
    soft = Sampler(next(s for s in chosen if s.scale == 0.03 and s.width == 0.001 and s.twist > 6.2), "strain")
    loads = [soft.model.loads(soft.wrenches(k)) for k in range(4)]
    slow = [seconds(partial(soft.model.solve, load)) for load in loads][1:]
    mean = float(np.mean(usual))
    ratio = seconds(lambda: Sampler(chosen[62], "strain").samples(range(6))) / 6 / max(mean, 1e-9)
    factor = {"one factor by SciPy's SuperLU": round(float(np.mean(superlu)), 3)}
    recorded = {"with what is recorded, about": round(mean * ratio * 125e3 / 3600, 1)}
    return [
        most("strain-targeted solve, mean processor seconds", 0.10, mean, peer=factor),
        most("(30 mm, 1 mm, 360 degrees), processor seconds", 0.35, float(np.mean(slow))),
        most("125 x 1000 solves, core-hours", 5.0, mean * 125e3 / 3600, peer=recorded),
    ]


def interpolation() -> list[Row]:
    from flexmaps.database import table_file
    from flexmaps.engine.mechanics.arms import stiffness

    with tempfile.TemporaryDirectory() as folder:
        e = table_file.judge(Path(folder))
        beyond = table_file.judge_slender(Path(folder))
    rng = np.random.default_rng(0)
    n = 2400
    s, w = rng.uniform(0.01, 0.03, n), rng.uniform(0.001, 0.002, n)
    twist = rng.uniform(0, 1, n) * np.minimum(stiffness.table_twist_limit(s / w), 2 * np.pi)
    kind: dict[str, Any] = {"thickness": 0.002, "youngs": 2.6e9, "poisson": 0.33}
    stiffness.table_tip_compliance(s, w, twist, **kind)
    ms = 1e3 * seconds(lambda: stiffness.table_tip_compliance(s, w, twist, **kind), 10)
    return [
        most("table at 48 held-out spirals, median %", 1.5, 100 * e["compliance_median"]),
        most("table at 48 held-out spirals, 95 %, %", 5.0, 100 * e["compliance_95"]),
        most("table at s/w 80, 120 and 200, worst %", 3.0, 100 * beyond["compliance_worst"]),
        most("values and derivatives of 2400 spirals, ms", 10.0, ms),
        most("table file, MB", 2.0, stiffness.TABLE.stat().st_size / 1e6),
    ]


PARTS = (against_scikit_fem, against_finer_meshes, speed, interpolation)


def main(arguments: list[str]) -> int:
    """Run all parts; return 0 whatever the figures."""
    from threadpoolctl import threadpool_limits

    bench = Bench("fem", arguments, 66)
    with threadpool_limits(1):
        for part in PARTS:
            bench.table.add(*part())
    return bench.finish()
