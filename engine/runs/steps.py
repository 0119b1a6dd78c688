"""Functions of the stages in ``stages.TABLE``: each takes the outputs that it needs, and adds its own to the result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import Cancelled, FlexMapsError
from ..extras import registry
from ..fabrication import assembly_check as assembly_check
from ..fabrication import estimates, sheets
from ..fabrication.standing.base import Base, make_base, refuse_rim
from ..fabrication.standing.base_checks import check_clamping
from ..fabrication.standing.eyelets import make_eyelets, warn_of_overload
from ..fabrication.standing.feet import quads_for_feet
from ..mechanics.assembly import Pose
from ..optimisation import match_limits, optimise
from ..params import Settings
from ..patches.merging import merge
from ..patches.splitting import split
from ..patches.tracing import trace
from ..progress import Progress
from ..simulation import simulate
from ..simulation.real_sheets import MAX_SPIRALS, tolerance_band
from ..simulation.simulate import Simulation
from ..spirals import fabricable
from ..spirals.constraints import Constraints
from ..spirals.design import SpiralDesign
from ..surface import curvature
from ..surface.mesh import QuadMesh
from ..surface.remeshing import regularise
from .outputs import (
    DesignVersion,
    FinalLayout,
    MakingEstimate,
    MergedLayout,
    OptimisationRecord,
    SheetPlan,
    SimulatedShape,
    TracedLayout,
    provenance,
)
from .result import Result
from .stage import Stage
from .stages import CHOSEN, CURVED, OPTIMISED

# Fraction of the progress of the stage "merge" for merging, by eye; tightening to the wanted match takes the rest
MERGING_SHARE = 0.4


def _regularise(result: Result, settings: Settings, progress: Progress) -> Result:
    surface = result.surface
    mesh = regularise.regularise(surface.mesh, settings.regularise, progress)
    return result.with_surface(mesh=_restore_size(mesh, surface.edge, surface.height), regularised=True)


def _restore_size(mesh: QuadMesh, edge: float | None, height: float | None) -> QuadMesh:
    """Return a mesh scaled about the origin to the requested size, because regularising shrinks it a little."""
    if edge is not None:
        return mesh.with_vertices(mesh.vertices * (edge / mesh.median_edge))
    if height is not None:
        return mesh.with_vertices(mesh.vertices * (height / np.ptp(mesh.vertices[:, 2])))
    return mesh


def _trace(result: Result, settings: Settings, progress: Progress) -> Result:
    layout = trace.trace_layout(result.mesh, settings.layout, progress)
    return result.with_outputs(TracedLayout(layout, **provenance("trace", settings, result.inputs("mesh"))))


def _merge(result: Result, traced: TracedLayout, settings: Settings, progress: Progress) -> Result:
    held = result.supports is not None and len(result.supports) > 0
    flat = merge.merge(traced.layout, settings.layout, progress.part(0.0, MERGING_SHARE), has_supports=held)
    if registry.has("choosing"):  # this extra predicts the match
        piece = registry.load("choosing.judge").LayoutProblem(result.mesh, settings, result.supports, result.force)
        refine, rest = registry.load("choosing.refine_merged").refine_merged, progress.part(MERGING_SHARE, 1.0)
        flat = refine(piece, traced.layout, flat, settings.choose, rest)
    return result.with_outputs(MergedLayout(flat, **provenance("merge", settings, result.inputs("mesh", "layout"))))


def _split(result: Result, merged: MergedLayout, settings: Settings, progress: Progress) -> Result:
    flat = split.split_to_sheet(merged.merged, settings.layout, settings.sheet, progress)
    made = provenance("split", settings, result.inputs("mesh", "merged"))
    return result.with_outputs(FinalLayout(flat, merged.origin, **made))


def _spirals(result: Result, layout: FinalLayout, settings: Settings, progress: Progress) -> Result:
    spirals, origin = layout.start, CHOSEN
    if spirals is None:
        progress(0.0, "Measuring curvature")
        spirals, origin = fabricable.curvature_adjusted(settings.spiral, curvature.rms_curvature(result.mesh)), CURVED
    asked = _constraints(result, settings)
    made = fabricable.design_from_spirals(layout.flat, settings.spiral, *spirals, progress, constraints=asked)
    return result.with_outputs(DesignVersion(made, origin, **provenance("spirals", settings, result.inputs("flat"))))


def _constraints(result: Result, settings: Settings) -> Constraints:
    """Return the constraints on spirals: straight under feet, wide at eyelets, unchanged where protected."""
    asked: dict[str, np.ndarray] = {}
    if settings.base.stands and result.supports is not None:
        refuse_rim(settings.spiral)
        asked["straight"] = quads_for_feet(result.mesh, result.supports)
    if settings.base.base == "eyelets" and result.supports is not None:
        asked["wide"] = result.supports
    if result.protected is not None:
        asked["fixed"] = result.protected
    return Constraints(**asked)


def _optimise(result: Result, start: DesignVersion, settings: Settings, progress: Progress) -> Result:
    found = optimise.optimise(
        start.design,
        result.mesh,
        settings.material.chosen,
        settings.optimise,
        settings.simulate,
        supports=result.supports,
        force=result.force,
        constraints=_constraints(result, settings),
        wishes=result.wishes,
        progress=progress,
    )
    version = replace(start, design=found.design, origin=OPTIMISED)
    made = provenance("optimise", settings, {"design": found.design, **result.inputs("supports", "force")})
    return result.with_outputs(version, OptimisationRecord(found, **made))


def _simulate(result: Result, version: DesignVersion, settings: Settings, progress: Progress) -> Result:
    better, start = result.optimisation, None
    if better is not None and not settings.simulate.restarts:
        limits = match_limits.find_limits(better, progress.part(0.0, 0.3))
        found = _with_band(better.after, settings, progress.part(0.3, 1.0))
    else:
        start = None if better is None else better.after.equilibrium.pose
        plain = simulate_design(result, version.design, settings, start, progress.part(0.0, 0.6))
        limits = match_limits.find_limits(plain if better is None else better, progress.part(0.6, 0.65))
        found = _with_band(plain, settings, progress.part(0.65, 1.0))
    return result.with_outputs(simulated_shape(result, found, limits, settings))


def simulated_shape(
    result: Result, simulation: Simulation, limits: match_limits.MatchLimits | None, settings: Settings
) -> SimulatedShape:
    """Return the output of the stage "simulate" for a simulation of the result's spirals.

    Parameters
    ----------
    result : results with the spirals
    simulation : simulation of these spirals
    limits : reasons why the shape misses the target, or None
    settings : settings of the run
    """
    made = provenance("simulate", settings, result.inputs("mesh", "design", "optimisation", "supports", "force"))
    return SimulatedShape(simulation, limits, **made)


def simulate_design(
    result: Result, design: SpiralDesign, settings: Settings, start: Pose | None, progress: Progress
) -> Simulation:
    """Simulate a design under the result's loads.

    Parameters
    ----------
    result : holds mesh, supports and forces
    design : the spirals
    settings : material and simulation are used
    start : pose to start from; None to start from the target's pose
    progress : called with the fraction done; may cancel
    """
    return simulate.simulate(
        design,
        result.mesh,
        settings.material.chosen,
        settings.simulate,
        supports=result.supports,
        force=result.force,
        start=start,
        progress=progress,
    )


def _with_band(simulation: Simulation, settings: Settings, progress: Progress) -> Simulation:
    """Return the simulation with the effect of the sheets' tolerances; unchanged for large pieces or after a cancel."""
    if not simulation.equilibrium.converged or simulation.assembly.size > MAX_SPIRALS:
        return simulation
    try:
        return replace(simulation, band=tolerance_band(simulation, settings.simulate, progress))
    except Cancelled:
        return simulation


def _sheets(result: Result, version: DesignVersion, settings: Settings, progress: Progress) -> Result:
    split.check_fits_sheet(version.design.flat, settings.sheet)
    base = None if settings.base.base == "none" else _make_base(result, version.design, settings)
    found = sheets.make_sheets(version.design, settings.sheet, progress, settings.connect, settings.cut, base)
    inputs = ["design"]
    if base is not None:
        more = warn_of_overload(base.eyelets, base.thickness, settings.material.chosen)
        found = replace(found, warnings=(*found.warnings, *more))
        inputs += ["simulation", "supports"]
    return result.with_outputs(SheetPlan(found, **provenance("sheets", settings, result.inputs(*inputs))))


def _make_base(result: Result, design: SpiralDesign, settings: Settings) -> Base:
    """Make the base of the simulated piece. Raises ``FlexMapsError`` if there is no simulated shape."""
    simulation = result.simulation
    if simulation is None or not simulation.equilibrium.converged:
        failed = result.undone.get("simulate")
        why = "" if failed is None else f" ({failed.message})"
        raise FlexMapsError(
            f"A base is made for the simulated shape, and there is none; press Simulate first, or choose no base{why}"
        )
    return make_base_or_eyelets(design, simulation.equilibrium.pose, result.supports, settings, simulation.reactions)


def make_base_or_eyelets(
    design: SpiralDesign, pose: Pose, supports: np.ndarray | None, settings: Settings, pull: np.ndarray | None = None
) -> Base:
    """Make the base that a piece stands on, or the eyelets that it hangs by.

    Parameters
    ----------
    design : the spirals
    pose : pose of the hubs at equilibrium
    supports : indices of the supported quads
    settings : kind and sizes of the base
    pull : (F, 3) newtons, forces of the supports on the quads; None if unknown

    Raises
    ------
    FlexMapsError : as in ``make_base``
    """
    check_clamping(settings.base, settings.simulate)
    mesh = design.flat.layout.mesh
    lowest = float(simulate.move_vertices(design, pose, mesh)[np.unique(mesh.quads), 2].min())
    if not settings.base.stands:
        eyelets = make_eyelets(design, pose, supports, settings.base.eyelet, settings.cut, pull)
        return Base(design, (), (), lowest, design.params.thickness, eyelets)
    clearance = settings.connect.clearance
    return make_base(design, pose, supports, settings.base, settings.sheet, lowest=lowest, clearance=clearance)


def _estimate(result: Result, plan: SheetPlan, settings: Settings, progress: Progress) -> Result:
    progress(0.0, "Estimating how long making takes, and how hard the seams are to join")
    made, design = plan.sheets, result.need(DesignVersion).design
    figures = estimates.estimate(made, design, settings.material.chosen, settings.cost)
    joins = assembly_check.check_assembly(design, made.connections, result.simulation)
    inputs = result.inputs("design", "sheets", "simulation")
    return result.with_outputs(MakingEstimate(figures, joins, **provenance("estimate", settings, inputs)))


# function of each stage; its arguments: the result, the outputs that the stage needs, the settings that its row lists,
# the progress
STEPS: dict[str, Callable[..., Result]] = {
    "regularise": _regularise,
    "trace": _trace,
    "merge": _merge,
    "split": _split,
    "spirals": _spirals,
    "optimise": _optimise,
    "simulate": _simulate,
    "sheets": _sheets,
    "estimate": _estimate,
}


def function_of(stage: Stage) -> Callable[..., Result]:
    """Return the function that runs a stage, from ``STEPS`` or from the stage's extra."""
    return registry.load(stage.code).run if stage.code else STEPS[stage.name]
