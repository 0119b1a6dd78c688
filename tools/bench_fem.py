"""Benchmark of the solid model: accuracy and speed, beside required values."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from flexmaps.database.design_mesh import Resolution
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.threads import one_thread
from harness import Bench, Options, PolygonMesh, Rows, at_most, fewest_seconds, run_job

most = partial(at_most, "spirals")
OPTIMISED = ("cap-pole6", "lattice-dome", "hall-waves", "lattice-saddle", "vault-plain")
# largest differences of the distances of program and solid, % of the size: of pieces whose softest eigenvalue is above FIRM, and of others
FIRM, NEAR, SOFT_NEAR = 0.1, 0.1, 0.25
COARSE = Resolution(root=1.0, length=3.5, turn=1.0)  # finer pieces fold in more spirals of optimised designs
# shares of the differences between a folded spiral's arms, and of its twist, that a round takes away
ALIKE, UNWOUND = 0.1, 0.02


def scikit_fem(_: Options) -> Rows:
    """Compare the motion of a pair of spirals under a small force with that of another program."""
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
    error = np.linalg.norm(moved - pair_motion(pair, rest.centres / UNIT, force, 0.3)) / np.linalg.norm(moved)
    return [most("motion of a blended pair of spirals against scikit-fem, %", 0.5, 100.0 * float(error))]


def speed(_: Options) -> Rows:
    """Time solves with a given strain: the mean, the slowest kind, and all of the table's."""
    from flexmaps.database.sampling import Sampler, subjects

    usual, chosen = [], subjects()
    for s in chosen[::6]:
        sampler = Sampler(s, "strain")
        loads = [sampler.model.loads(sampler.wrenches(k)) for k in range(3)]
        usual += [fewest_seconds(partial(sampler.model.solve, load)) for load in loads[1:]]
    soft = Sampler(next(s for s in chosen if s.scale == 0.03 and s.width == 0.001 and s.twist > 6.2), "strain")
    loads = [soft.model.loads(soft.wrenches(k)) for k in range(4)]
    slow = [fewest_seconds(partial(soft.model.solve, load)) for load in loads][1:]
    mean = float(np.mean(usual))
    return [
        most("strain-targeted solve, mean processor seconds", 0.10, mean),
        most("(30 mm, 1 mm, 360 degrees), processor seconds", 0.35, float(np.mean(slow))),
        most("125 x 1000 solves, core-hours", 5.0, mean * 125e3 / 3600),
    ]


def interpolation(_: Options) -> Rows:
    """Time the table's values and derivatives."""
    from flexmaps.engine.mechanics.arms import stiffness

    rng, n = np.random.default_rng(0), 2400
    s, w = rng.uniform(0.01, 0.03, n), rng.uniform(0.001, 0.002, n)
    twist = rng.uniform(0, 1, n) * np.minimum(stiffness.table_twist_limit(s / w), 2 * np.pi)
    kind: dict[str, Any] = {"thickness": 0.002, "youngs": 2.6e9, "poisson": 0.33}
    stiffness.table_tip_compliance(s, w, twist, **kind)
    ms = 1e3 * fewest_seconds(lambda: stiffness.table_tip_compliance(s, w, twist, **kind), 10)
    return [
        most("values and derivatives of 2400 spirals, ms", 10.0, ms),
        most("table file, MB", 2.0, stiffness.TABLE.stat().st_size / 1e6),
    ]


def optimised(_: Options) -> Rows:
    """Compare distances from the target of optimised pieces with those of their solids, a minute each."""
    return [row for name in OPTIMISED for row in _distances(name)]


def _distances(name: str) -> Rows:
    """Return the difference of both distances, which is limited for a piece that is stable enough."""
    from flexmaps.database.design_mesh import UNIT
    from flexmaps.database.design_solid import DesignSolid
    from flexmaps.engine.mechanics.assembly import Pose
    from flexmaps.engine.params import Settings
    from flexmaps.engine.simulation.simulate import simulate
    from zoo import SURFACES, hard

    settings = Settings()
    polygons = SURFACES[name].polygons() if name in SURFACES else PolygonMesh.from_quads(hard.SURFACES[name]())
    piece = run_job(polygons, "simulate", optimised=True)
    design, changed = _without_folds(piece.design)
    start = piece.simulation.equilibrium.pose  # a piece may rest in other shapes too
    found = simulate(design, piece.mesh, settings.material.chosen, settings.simulate, start=start)
    solid, pose = DesignSolid(design, settings.material.chosen.poisson, [0], COARSE), found.equilibrium.pose
    rest = solid.solve(solid.guess(pose), pose, solid.pulled(np.zeros((len(design.width), 3))))
    target = piece.mesh.centroids
    off = Pose(rest.centres * UNIT, rest.rotations).aligned_to(target).centres - target
    said = found.target_distances["rms_percent"]
    true = 100.0 * float(np.sqrt((off**2).sum(axis=1).mean())) / piece.mesh.diagonal
    peer = {
        "program %": f"{said:.3f}",
        "solid %": f"{true:.3f}",
        "softest": f"{found.softest()[1]:.3f}",
        "changed spirals": changed,
    }
    limit = NEAR if found.softest()[1] > FIRM else SOFT_NEAR
    return [at_most(name, "distance of program and solid, % of the size", limit, abs(said - true), peer)]


def _without_folds(design: Any) -> tuple[Any, int]:
    """Return a design whose solids do not fold, and how many of its spirals were given more alike arms for it."""
    from flexmaps.database.design_mesh import make_mesh

    changed: set[int] = set()
    while True:
        try:
            make_mesh(design, COARSE)
        except FlexMapsError as error:
            if error.faces is None or not len(error.faces):
                raise
            bad, width, twist = np.asarray(error.faces), design.width.copy(), design.twist.copy()
            changed |= set(bad.tolist())
            width[bad] += ALIKE * (width[bad].mean(axis=1, keepdims=True) - width[bad])
            twist[bad] *= 1.0 - UNWOUND
            design = replace(design, width=width, twist=twist)
        else:
            return design, len(changed)


PARTS = {part.__name__: one_thread(part) for part in (scikit_fem, speed, interpolation, optimised)}
main = Bench("fem", PARTS, patterns=None)
