"""Whether a piece stays in its shape: whether it is about to snap, and in which other shapes it may rest."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Int
from ..mechanics.assembly import Pose, target_pose
from ..mechanics.equilibrium import Equilibrium, differ, solve
from ..mechanics.loads import between
from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..surface.checking.finding import Finding, counted

if TYPE_CHECKING:
    from .simulate import Simulation

SNAPPING = 0.02  # share of its stiffness that the softest motion has left, below which a piece is about to snap
MOVING = 0.5  # of the largest turn in that motion, from which on spirals are named; by eye
LOWER = 1e-3  # share of the elastic energy by which another rest has to be lower to be named: rounding is far below
SHAKEN = 0.1  # distances of neighbours and radians, of a shaken start; by eye, not measured
ITERATIONS = 60  # Newton steps for each other rest; more find more of them and take longer; not measured


def other_rests(simulation: Simulation, params: SimulateParams, progress: Progress = SILENT) -> list[Equilibrium]:
    """Return other shapes in which a piece at rest can rest too, sought from the target's pose and from a shaken one, by energy."""
    found, loads, model = simulation.equilibrium, simulation.loads, simulation.model
    if not found.converged:
        return []
    aim = target_pose(simulation.target, simulation.design.flat.corners)
    quick, known = replace(params, iterations=min(params.iterations, ITERATIONS)), [found]
    for k, start in enumerate((aim, _shaken(aim, simulation))):
        other = solve(model, start, loads, quick, progress.part(0.5 * k, 0.5 * (k + 1)))
        if other.converged and all(differ(other.pose, one.pose, model.pairs, loads) for one in known):
            known.append(other.placed(loads.laid(other.pose, simulation.assembly.pairs, aim)))
    return sorted(known[1:], key=lambda one: one.energy)


def _shaken(pose: Pose, simulation: Simulation) -> Pose:
    """Return a pose whose hubs are moved and turned at random; what supports hold stays."""
    pairs = between(simulation.model.pairs, len(pose.centres))
    length = float(np.linalg.norm(np.diff(pose.centres[pairs], axis=1), axis=2).mean())
    step = SHAKEN * np.random.default_rng(0).normal(size=(len(pose.centres), 6)) * np.repeat([length, 1.0], 3)
    return pose.moved(np.where(simulation.loads.fixed, 0.0, step))


def rest_findings(simulation: Simulation) -> list[Finding]:
    """Return what there is to say about the stability of a piece at rest."""
    found: list[Finding] = []
    if not simulation.equilibrium.converged:
        return found
    moving, share = snapping(simulation)
    if len(moving):
        text = (
            f"The piece is about to snap into another shape: {100.0 * share:.1f} % of its stiffness is left against the motion of "
            f"{counted(len(moving), 'spiral', 'spirals')}. Hold it there with supports, or press Optimise again."
        )
        found.append(Finding("about-to-snap", "warning", text, tuple(moving.tolist())))
    lower = lower_rest(simulation)
    if lower is not None:
        apart = np.linalg.norm(lower.pose.centres - simulation.target.centroids, axis=1)
        rms = 100.0 * float(np.sqrt((apart**2).mean())) / simulation.size
        text = (
            f"The piece can also rest in another shape, {rms:.2g} % of its size from the target, with less energy than in the one that is "
            "shown. Press Optimise again to improve it from there, or hold it with supports."
        )
        far = np.linalg.norm(lower.pose.centres - simulation.equilibrium.pose.centres, axis=1)
        found.append(Finding("other-rest", "warning", text, tuple(np.flatnonzero(far > MOVING * far.max()).tolist())))
    return found


def snapping(simulation: Simulation) -> tuple[Int[np.ndarray, " some"], float]:
    """Return the spirals that move most where a piece is about to snap, and its softest motion's share of stiffness; none elsewhere."""
    none = np.zeros(0, dtype=int)
    if simulation.equilibrium.spare >= SNAPPING:
        return none, simulation.equilibrium.spare
    mode, share = simulation.softest()
    turned = np.linalg.norm(mode[:, 3:], axis=1)
    return (np.flatnonzero(turned > MOVING * turned.max()) if share < SNAPPING else none), share


def lower_rest(simulation: Simulation) -> Equilibrium | None:
    """Return the known rest of least energy if that is lower than the simulated one."""
    found = simulation.equilibrium
    best = min(simulation.others, key=lambda one: one.energy, default=None)
    return best if best is not None and best.energy < found.energy - LOWER * found.per_joint.sum() else None
