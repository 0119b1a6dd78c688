"""Compute how tolerances of real sheets change the shape of a piece: one equilibrium for each end of each tolerance.

The change of thickness, width or stiffness is the same everywhere in the piece.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..mechanics.assembly import target_pose
from ..mechanics.elastic import ElasticModel
from ..mechanics.equilibrium import solve
from ..mechanics.loads import GRAVITY, Loads
from ..params import SimulateParams
from ..progress import SILENT, Progress
from .band import ToleranceBand, ToleranceEffect
from .simulate import Simulation

# Half width of the tolerance of a sheet's thickness, as a share of the nominal thickness: of plywood, of all other
# materials
PLYWOOD_THICKNESS_TOLERANCE, THICKNESS_TOLERANCE = 0.10, 0.05
WIDTH_TOLERANCE = 5e-5  # half width of the tolerance of the arms' width, metres, from the variation of the kerf
# relative error, up or down, of the elastic model's ratio of bending to in-plane stiffness
STIFFNESS_TOLERANCE = 0.03
# For pieces with more spirals, the effect of tolerances is not computed by default; larger: users wait longer
MAX_SPIRALS = 3000


def tolerance_band(simulation: Simulation, params: SimulateParams, progress: Progress = SILENT) -> ToleranceBand:
    """Compute the distances from the target at both ends of every tolerance.

    Parameters
    ----------
    simulation : a converged simulation with nominal values
    params : settings of the solver
    progress : is updated and can cancel
    """
    wood = simulation.material.orthotropy is not None
    share = PLYWOOD_THICKNESS_TOLERANCE if wood else THICKNESS_TOLERANCE
    ends = [
        ("thickness", share, f"with a sheet {100.0 * share:.0f} % thicker or thinner"),
        ("width", WIDTH_TOLERANCE, f"with arms {1e3 * WIDTH_TOLERANCE:g} mm wider or narrower"),
    ]
    if simulation.model.with_bending(1.0) is not None:
        ends.append(
            (
                "stiffness",
                STIFFNESS_TOLERANCE,
                f"with {100.0 * STIFFNESS_TOLERANCE:.0f} % more or less stiffness in bending",
            )
        )
    tolerances = []
    for k, (name, step, words) in enumerate(ends):
        part = progress.part(k / len(ends), (k + 1) / len(ends))
        less, more = (
            _rms_distance(simulation, name, sign * step, params, part.part(0.5 * i, 0.5 * (i + 1)))
            for i, sign in enumerate((-1.0, 1.0))
        )
        tolerances.append(ToleranceEffect(name, less, more, words))
    return ToleranceBand(tuple(tolerances))


def _rms_distance(
    simulation: Simulation, name: str, step: float, params: SimulateParams, progress: Progress
) -> float | None:
    """Return the RMS distance from the target after a change of one quantity, metres; None if there is no equilibrium.

    Parameters
    ----------
    simulation : with nominal values, where the search for the equilibrium starts
    name : the quantity: "thickness", "width" or "stiffness"
    step : change of the width in metres, or relative change of the thickness or stiffness
    params : settings of the solver
    progress : is updated and can cancel
    """
    progress(0.0, "Simulating real sheets")
    assembly, loads, model, material = simulation.assembly, simulation.loads, simulation.model, simulation.material
    changed: ElasticModel | None
    if name == "thickness":
        if params.gravity:
            heavier = step * simulation.design.area * assembly.thickness * material.density
            loads = Loads(loads.fixed, loads.force - GRAVITY * np.outer(heavier, [0.0, 0.0, 1.0]))
        changed = model.rebuilt(replace(assembly, thickness=(1.0 + step) * assembly.thickness), material)
    elif name == "width":
        changed = model.rebuilt(assembly.with_spirals(assembly.width + step, assembly.twist), material)
    else:
        changed = model.with_bending(1.0 + step)
    if changed is None:
        return None
    equilibrium = solve(changed, simulation.equilibrium.pose, loads, params, replace(progress, shown=None))
    if not equilibrium.converged:
        return None
    aim = target_pose(simulation.target, simulation.design.flat.corners)
    apart = loads.align(equilibrium.pose, assembly.pairs, aim).centres - simulation.target.centroids
    return float(np.sqrt((apart**2).sum(axis=1).mean()))
