"""Search for other stable shapes of a piece, from poses in which a user may begin to assemble it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..mechanics.assembly import Pose, target_pose
from ..mechanics.equilibrium import Equilibrium, poses_differ, solve
from ..mechanics.loads import joints_between_hubs
from ..params import SimulateParams
from ..progress import SILENT, Progress
from .simulate import Simulation

# Standard deviation of the random shifts (as a share of the mean distance between neighbouring hubs) and rotations (in
# radians) by which one starting pose differs from the target's pose; larger finds more other shapes
PERTURBATION = 0.1


def find_other_rests(simulation: Simulation, params: SimulateParams, progress: Progress = SILENT) -> Simulation:
    """Search for other stable shapes of a simulated piece.

    There are two searches: from the target's pose and from a random pose near it.

    Parameters
    ----------
    simulation : of the piece; returned unchanged if it did not converge
    params : settings of the solver
    progress : is updated and can cancel

    Returns
    -------
    Simulation : a copy with the other shapes in ``others``, in order of energy; if the search from the target's pose
        ended in another shape, this is ``rest_from_target``
    """
    equilibrium, loads, model = simulation.equilibrium, simulation.loads, simulation.model
    if not equilibrium.converged:
        return simulation
    aim = target_pose(simulation.target, simulation.design.flat.corners)
    others = list[Equilibrium]()
    rest_from_target: Equilibrium | None = None
    for k, start in enumerate((aim, _perturb(aim, simulation))):
        other = solve(model, start, loads, params, progress.part(0.5 * k, 0.5 * (k + 1)))
        if other.converged and all(
            poses_differ(other.pose, one.pose, model.pairs, loads) for one in (equilibrium, *others)
        ):
            others.append(other.with_pose(loads.align(other.pose, simulation.assembly.pairs, aim)))
            rest_from_target = others[-1] if start is aim else rest_from_target
    found = replace(simulation, others=sorted(others, key=lambda one: one.energy), rest_from_target=rest_from_target)
    # the caches are still valid, because the simulated shape is the same
    found.slots_cache.extend(simulation.slots_cache)
    found.softest_cache.extend(simulation.softest_cache)
    return found


def _perturb(pose: Pose, simulation: Simulation) -> Pose:
    """Return the pose after random shifts and rotations of its hubs, except for those that supports hold."""
    pairs = joints_between_hubs(simulation.model.pairs, len(pose.centres))
    length = float(np.linalg.norm(np.diff(pose.centres[pairs], axis=1), axis=2).mean())
    step = PERTURBATION * np.random.default_rng(0).normal(size=(len(pose.centres), 6)) * np.repeat([length, 1.0], 3)
    return pose.moved(np.where(simulation.loads.fixed, 0.0, step))
