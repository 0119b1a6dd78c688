"""Predict the largest strain of a piece that is scaled up or cut from a thinner sheet, without optimising it again."""

from __future__ import annotations

from dataclasses import replace

from ..mechanics.arms.arm_access import as_arm_model
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.strain_changes import max_strain_per_spiral
from ..mechanics.equilibrium import solve
from ..params import SimulateParams
from ..simulation.simulate import Simulation
from .remedies import StrainForecast


def forecast_strain(simulation: Simulation) -> StrainForecast | None:
    """Return a function from a factor on the size, and a thickness in metres, to the largest strain over its limit.

    Widths, twists and loads are kept. The equilibrium is sought from the present rotations at scaled distances: in a
    larger piece arms bend by nearly equal angles over greater lengths. The scaled pose would not do: the second-order
    terms of a joint's two unequal arms cancel only at an equilibrium. Return None for the rod model, and for pieces
    with a rim, whose nodes would need an equilibrium first.
    """
    old = as_arm_model(simulation.model)
    if old is None or simulation.assembly.rim is not None:
        return None
    given, pose, material = simulation.assembly, simulation.equilibrium.pose, simulation.material

    def strain(times: float, thickness: float) -> float:
        changed = replace(given, lever=times * given.lever, thickness=thickness)
        model = ArmModel.from_assembly(changed, material, curving=old.curving_at_joint is not None, slopes=False)
        there = replace(pose, centres=times * pose.centres)
        if times != 1.0 or thickness != given.thickness:
            rest = solve(model, there, simulation.loads, SimulateParams(restarts=0))
            there = rest.pose if rest.converged else there
        state = model.start(there)
        return (
            float(max_strain_per_spiral(model.assembly, model.strains(state, material)).max()) / material.strain_limit
        )

    return strain
