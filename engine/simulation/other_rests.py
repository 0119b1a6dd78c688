"""Other shapes in which a piece can rest, sought from where somebody who assembles it may begin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..mechanics.assembly import Pose, target_pose
from ..mechanics.equilibrium import Equilibrium, differ, solve
from ..mechanics.loads import between
from ..params import SimulateParams
from ..progress import SILENT, Progress
from .simulate import Simulation

SHAKEN = 0.1  # distances of neighbours and radians, of a shaken start; by eye, not measured
ITERATIONS = 60  # Newton steps for each other rest; more find more of them and take longer; not measured


def other_rests(simulation: Simulation, params: SimulateParams, progress: Progress = SILENT) -> Simulation:
    """Return a simulation with other shapes in which its piece can rest too, sought from the target's pose and from a shaken one.

    Parameters
    ----------
    simulation : Simulation
        Comes back unchanged if it is not at rest.
    params : SimulateParams
        Of the equilibria.
    progress : Progress
        Asked whether to cancel.

    Returns
    -------
    Simulation
        With ``others`` by energy, and with ``assembled`` if the target's pose leads to one of them.
    """
    found, loads, model = simulation.equilibrium, simulation.loads, simulation.model
    if not found.converged:
        return simulation
    aim = target_pose(simulation.target, simulation.design.flat.corners)
    quick, others = replace(params, iterations=min(params.iterations, ITERATIONS)), list[Equilibrium]()
    assembled: Equilibrium | None = None
    for k, start in enumerate((aim, _shaken(aim, simulation))):
        other = solve(model, start, loads, quick, progress.part(0.5 * k, 0.5 * (k + 1)))
        if other.converged and all(differ(other.pose, one.pose, model.pairs, loads) for one in (found, *others)):
            others.append(other.placed(loads.laid(other.pose, simulation.assembly.pairs, aim)))
            assembled = others[-1] if start is aim else assembled
    return replace(simulation, others=sorted(others, key=lambda one: one.energy), assembled=assembled)


def _shaken(pose: Pose, simulation: Simulation) -> Pose:
    """Return a pose whose hubs are moved and turned at random; what supports hold stays."""
    pairs = between(simulation.model.pairs, len(pose.centres))
    length = float(np.linalg.norm(np.diff(pose.centres[pairs], axis=1), axis=2).mean())
    step = SHAKEN * np.random.default_rng(0).normal(size=(len(pose.centres), 6)) * np.repeat([length, 1.0], 3)
    return pose.moved(np.where(simulation.loads.fixed, 0.0, step))
