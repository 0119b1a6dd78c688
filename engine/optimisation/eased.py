"""Largest strains of a piece at rest if it were larger or of a thinner sheet, without another search for its shape."""

from __future__ import annotations

from dataclasses import replace

from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.strain_changes import largest
from ..mechanics.equilibrium import solve
from ..params import SimulateParams
from ..simulation.simulate import Simulation
from .remedies import Eased


def eased(simulation: Simulation) -> Eased | None:
    """Return the largest strain, as a share of what the material bears, by times the size and metres of the sheet.

    Of a larger piece hubs keep their directions and their distances grow with the size, so that arms are bent as they were over other
    lengths; a thinner one is brought to rest anew, from where it rests. Widths and twists stay. None for the rod model, and with a rim, whose nodes would have to come to rest first.
    """
    old = simulation.model
    if not isinstance(old, ArmModel) or simulation.assembly.rim is not None:
        return None
    given, pose, material = simulation.assembly, simulation.equilibrium.pose, simulation.material

    def strain(times: float, thickness: float) -> float:
        changed = replace(given, lever=times * given.lever, thickness=thickness)
        model = ArmModel.of(changed, material, curving=old.curving_at_joint is not None, slopes=False)
        there = replace(pose, centres=times * pose.centres)
        if thickness != given.thickness:
            there = solve(model, there, simulation.loads, SimulateParams(restarts=0)).pose
        state = model.start(there)
        return float(largest(model.assembly, model.strains(state, material)).max()) / material.strain_limit

    return strain
