"""Measure how tolerances of real sheets change a piece: one equilibrium for each end of each tolerance.

A tolerance changes the whole sheet evenly.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..mechanics.arms.model import ArmModel
from ..mechanics.assembly import Assembly, target_pose
from ..mechanics.elastic import ElasticModel
from ..mechanics.equilibrium import solve
from ..mechanics.loads import GRAVITY, Loads
from ..params import SimulateParams
from ..progress import SILENT, Progress
from .band import Tolerance, ToleranceBand
from .simulate import Simulation, build_model

# tolerance of the sheet's thickness, as a share of the nominal thickness: of plywood, of all other materials
PLYWOOD_THICKNESS, THICKNESS = 0.10, 0.05
WIDTH = 5e-5  # tolerance of the arms' width, metres: the kerf changes this much
STIFFNESS = 0.03  # uncertainty of the elastic model's ratio of bending to stretching stiffness, as a share
MOST = 3000  # most spirals for which the band is computed unasked; with more, six equilibria take too long


def tolerance_band(simulation: Simulation, params: SimulateParams, progress: Progress = SILENT) -> ToleranceBand:
    """Solve for the equilibrium at both ends of every tolerance.

    Parameters
    ----------
    simulation : a converged simulation with nominal sheets
    params : settings of the equilibria
    progress : called with the fraction done; may cancel
    """
    wood = simulation.material.orthotropy is not None
    share = PLYWOOD_THICKNESS if wood else THICKNESS
    ends = [
        ("thickness", share, f"with a sheet {100.0 * share:.0f} % thicker or thinner"),
        ("width", WIDTH, f"with arms {1e3 * WIDTH:g} mm wider or narrower"),
    ]
    if isinstance(simulation.model, ArmModel):
        ends.append(("stiffness", STIFFNESS, f"with {100.0 * STIFFNESS:.0f} % more or less stiffness in bending"))
    tolerances = []
    for k, (name, step, words) in enumerate(ends):
        part = progress.part(k / len(ends), (k + 1) / len(ends))
        less, more = (
            _rms_distance(simulation, name, sign * step, params, part.part(0.5 * i, 0.5 * (i + 1)))
            for i, sign in enumerate((-1.0, 1.0))
        )
        tolerances.append(Tolerance(name, less, more, words))
    return ToleranceBand(1e-3 * simulation.match["rms_mm"], tuple(tolerances))


def _rms_distance(
    simulation: Simulation, name: str, step: float, params: SimulateParams, progress: Progress
) -> float | None:
    """Return the RMS distance from the target, in metres, after changing one quantity; None if no equilibrium is found."""
    progress(0.0, "Real sheets")
    assembly, loads = simulation.assembly, simulation.loads
    if name == "thickness":
        if params.gravity:
            heavier = step * simulation.design.area * assembly.thickness * simulation.material.density
            loads = Loads(loads.fixed, loads.force - GRAVITY * np.outer(heavier, [0.0, 0.0, 1.0]))
        model = _rebuild_model(simulation, replace(assembly, thickness=(1.0 + step) * assembly.thickness))
    elif name == "width":
        model = _rebuild_model(simulation, assembly.redesigned(assembly.width + step, assembly.twist))
    else:
        assert isinstance(simulation.model, ArmModel)
        model = simulation.model.with_bending(1.0 + step)
    equilibrium = solve(model, simulation.equilibrium.pose, loads, params, replace(progress, shown=None))
    if not equilibrium.converged:
        return None
    aim = target_pose(simulation.target, simulation.design.flat.corners)
    apart = loads.laid(equilibrium.pose, assembly.pairs, aim).centres - simulation.target.centroids
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _rebuild_model(simulation: Simulation, assembly: Assembly) -> ElasticModel:
    """Build the model of a slightly changed assembly, but keep the second order of the strains, which takes longest."""
    old = simulation.model
    model = build_model(assembly, simulation.material, old.name, quick=True, slopes=False)
    if isinstance(model, ArmModel) and isinstance(old, ArmModel):
        return model.with_curving(old.curving_at_joint)
    return model
