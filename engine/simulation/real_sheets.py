"""What real sheets do to a piece: one equilibrium for each end of each tolerance, alike on the whole sheet."""

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
from .band import Band, Tolerance
from .simulate import Simulation, build_model

# Shares by which the thickness of sheets differs from its nominal value, of plywood and of all others
WOOD, THICKNESS = 0.10, 0.05
WIDTH = 5e-5  # metres by which arms are wider or narrower than drawn, as the kerf changes
STIFFNESS = 0.03  # share between bending and stretching, of which the elastic model is not surer
MOST = 3000  # spirals up to which the band is found without being asked for: with more, six equilibria take long


def real_sheets(simulation: Simulation, params: SimulateParams, progress: Progress = SILENT) -> Band:
    """Return the band of a piece at rest."""
    wood = simulation.material.orthotropy is not None
    share = WOOD if wood else THICKNESS
    ends = [
        ("thickness", share, f"with a sheet {100.0 * share:.0f} % thicker or thinner"),
        ("width", WIDTH, f"with arms {1e3 * WIDTH:g} mm wider or narrower"),
    ]
    if isinstance(simulation.model, ArmModel):
        ends.append(("stiffness", STIFFNESS, f"with {100.0 * STIFFNESS:.0f} % more or less stiffness in bending"))
    found = []
    for k, (name, step, words) in enumerate(ends):
        part = progress.part(k / len(ends), (k + 1) / len(ends))
        less, more = (
            _distance(simulation, name, sign * step, params, part.part(0.5 * i, 0.5 * (i + 1)))
            for i, sign in enumerate((-1.0, 1.0))
        )
        found.append(Tolerance(name, less, more, words))
    return Band(1e-3 * simulation.match["rms_mm"], tuple(found))


def _distance(
    simulation: Simulation, name: str, step: float, params: SimulateParams, progress: Progress
) -> float | None:
    """Return the RMS distance from the target in metres where one quantity differs; None where no equilibrium is found."""
    progress(0.0, "Real sheets")
    assembly, loads = simulation.assembly, simulation.loads
    if name == "thickness":
        if params.gravity:
            heavier = step * simulation.design.area * assembly.thickness * simulation.material.density
            loads = Loads(loads.fixed, loads.force - GRAVITY * np.outer(heavier, [0.0, 0.0, 1.0]))
        model = _rebuilt(simulation, replace(assembly, thickness=(1.0 + step) * assembly.thickness))
    elif name == "width":
        model = _rebuilt(simulation, assembly.redesigned(assembly.width + step, assembly.twist))
    else:
        assert isinstance(simulation.model, ArmModel)
        model = simulation.model.with_bending(1.0 + step)
    found = solve(model, simulation.equilibrium.pose, loads, params, replace(progress, shown=None))
    if not found.converged:
        return None
    aim = target_pose(simulation.target, simulation.design.flat.corners)
    apart = loads.laid(found.pose, assembly.pairs, aim).centres - simulation.target.centroids
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _rebuilt(simulation: Simulation, assembly: Assembly) -> ElasticModel:
    """Return the model of an assembly that differs a little; the strains' second order stays."""
    old = simulation.model
    model = build_model(assembly, simulation.material, old.name, quick=True, slopes=False)
    if isinstance(model, ArmModel) and isinstance(old, ArmModel):
        return model.with_curving(old.curving_at_joint)
    return model
