"""Functions of the stages in ``stages.TABLE``: each takes a result and returns it with the products of its stage.

A step may assume that all inputs of its stage exist.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..assembling import check as assembly_check
from ..choosing import choose, tighten
from ..choosing.judge import LayoutProblem
from ..errors import Cancelled, FlexMapsError
from ..fabrication import estimates, sheets
from ..fabrication.connectors.connect import Connections, connect
from ..fabrication.standing.base import Base, make_base, refuse_rim
from ..fabrication.standing.early import check_hold
from ..fabrication.standing.eyelets import make_eyelets, overloaded
from ..fabrication.standing.feet import footed
from ..mechanics.assembly import Pose
from ..optimisation import optimise, reach
from ..params import Settings
from ..patches.layout import PatchLayout
from ..patches.merging import merge
from ..patches.splitting import split
from ..patches.tracing import trace
from ..progress import Progress
from ..scanning import compare
from ..simulation import simulate
from ..simulation.real_sheets import MOST, tolerance_band
from ..simulation.simulate import Simulation
from ..spirals import design
from ..spirals.constraints import Constraints
from ..spirals.design import SpiralDesign
from ..structure import cases, structure
from ..surface import curvature
from ..surface.mesh import QuadMesh
from ..surface.remeshing import regularise
from ..surface.symmetry import symmetries
from ..workers import Workers
from .result import Result
from .stages import made_from, without

MERGED = 0.4  # share of the stage's progress for merging; tightening then takes as long again or no time (by eye)


def _regularise(result: Result, settings: Settings, progress: Progress) -> Result:
    mesh = regularise.regularise(result.mesh, settings.regularise, progress)
    return replace(result, mesh=_resized(mesh, result.edge, result.height))


def _resized(mesh: QuadMesh, edge: float | None, height: float | None) -> QuadMesh:
    """Restore the requested size, about the origin: regularising shrinks the mesh a little."""
    if edge is not None:
        return mesh.moved(mesh.vertices * (edge / mesh.median_edge))
    if height is not None:
        return mesh.moved(mesh.vertices * (height / np.ptp(mesh.vertices[:, 2])))
    return mesh


def _trace(result: Result, settings: Settings, progress: Progress) -> Result:
    layout = trace.trace(result.mesh, settings.layout, progress)
    if result.seams is not None and result.seams.any():
        chosen = trace.make_disks(PatchLayout(result.mesh, result.seams))
        if not np.array_equal(chosen.cut, layout.cut):  # the user's seams differ from the traced cuts
            layout = chosen
    return replace(result, layout=layout)


def _merge(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.layout is not None
    piece = LayoutProblem(result.mesh, settings, result.supports, result.force)
    few = merge.merge(result.layout, settings.layout, progress.part(0.0, MERGED), held=piece.held)
    nearer = tighten.tightened(piece, result.layout, few, settings.choose, progress.part(MERGED, 1.0))
    return replace(result, flat=nearer)


def _split(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.flat is not None
    return replace(result, flat=split.split(result.flat, settings.layout, settings.sheet, progress))


def _choose(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.flat is not None
    found = symmetries(result.mesh, progress=progress.part(0.0, 0.02)) if settings.layout.symmetric else []
    # layouts near the present one start from its spirals; all others start from those of a long search
    start = _chosen(result) if settings.choose.near else None
    piece = LayoutProblem(result.mesh, settings, result.supports, result.force, tuple(found), start)
    reached = result.reached if result.optimisation is None else result.simulation
    if reached is not None and (reached.design.flat is not result.flat or not reached.equilibrium.converged):
        reached = None
    with Workers() as together:
        made = choose.choose(piece, result.flat, settings.choose, progress.part(0.02, 1.0), together, reached)
    if made.best.flat is not result.flat:
        result = without(result, made_from({"flat"}, "choose"))
    return replace(result, flat=made.best.flat, choice=made)


def _spirals(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.flat is not None
    spirals = _chosen(result)
    if spirals is None:
        progress(0.0, "Measuring curvature")
        spirals = design.curvature_adjusted(settings.spiral, curvature.rms_curvature(result.mesh))
    asked = _constraints(result, settings)
    made = design.from_spirals(result.flat, settings.spiral, *spirals, progress, constraints=asked)
    return replace(result, flat=made.flat, design=made)


def _chosen(result: Result) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the widths and twists that the search for a layout found for the present one; None if there are none."""
    best = None if result.choice is None else result.choice.best
    if best is not None and best.flat is result.flat:
        return best.judged.spirals
    return None if result.start is None or result.start[0] is not result.flat else result.start[1:]


def _constraints(result: Result, settings: Settings) -> Constraints:
    """Return the constraints on spirals: straight under feet, wide at eyelets, unchanged where protected."""
    asked: dict[str, np.ndarray] = {}
    if settings.base.stands and result.supports is not None:
        refuse_rim(settings.spiral)
        asked["straight"] = footed(result.mesh, result.supports)
    if settings.base.base == "eyelets" and result.supports is not None:
        asked["wide"] = result.supports
    if result.protected is not None:
        asked["kept"] = result.protected
    return Constraints(**asked)


def _optimise(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.design is not None
    found = optimise.optimise(
        result.design,
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
    return replace(result, flat=found.design.flat, design=found.design, optimisation=found)


def _simulate(result: Result, settings: Settings, progress: Progress) -> Result:
    better, start = result.optimisation, None
    if better is not None:
        if not settings.simulate.restarts:
            limits = reach.find_limits(better, progress.part(0.0, 0.3))
            return replace(
                result, simulation=_with_band(better.after, settings, progress.part(0.3, 1.0)), limits=limits
            )
        start = better.after.equilibrium.pose
    found = at_rest(result, settings, start, progress.part(0.0, 0.6))
    limits = reach.find_limits(found if better is None else better, progress.part(0.6, 0.65))
    return replace(result, simulation=_with_band(found, settings, progress.part(0.65, 1.0)), limits=limits)


def at_rest(result: Result, settings: Settings, start: Pose | None, progress: Progress) -> Simulation:
    """Simulate a result's design.

    Parameters
    ----------
    result : a piece with spirals
    settings : its material and the solver's
    start : pose to start from; None for the default start
    progress : reports and cancels
    """
    assert result.design is not None
    return simulate.simulate(
        result.design,
        result.mesh,
        settings.material.chosen,
        settings.simulate,
        supports=result.supports,
        force=result.force,
        start=start,
        progress=progress,
    )


def _with_band(simulation: Simulation, settings: Settings, progress: Progress) -> Simulation:
    """Add the range of outcomes with real sheets; leave it out for large pieces and if the user cancels."""
    if not simulation.equilibrium.converged or simulation.assembly.size > MOST:
        return simulation
    try:
        return replace(simulation, band=tolerance_band(simulation, settings.simulate, progress))
    except Cancelled:
        return simulation


def _compare(result: Result, settings: Settings, progress: Progress) -> Result:
    if result.scanned is None:
        raise FlexMapsError("There is no scan to compare with; give its file to 'compare'")
    mesh, simulated = (
        result.mesh,
        result.simulation is not None or (result.rest is not None and result.design is not None),
    )
    if result.simulation is not None:
        mesh = mesh.moved(result.simulation.vertices)
    elif result.rest is not None and result.design is not None:
        mesh = mesh.moved(simulate.move_vertices(result.design, result.rest, mesh))
    return replace(result, scan=compare.compare(mesh, result.scanned, simulated, progress))


def _structure(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.simulation is not None
    assert result.design is not None
    wanted = settings.structure
    plan = cases.plan(wanted.cases, wanted.combinations)
    found = structure.analyse(
        result.simulation,
        plan,
        wanted,
        settings.simulate,
        connections=_connected(result.design, settings, progress.part(0.0, 0.2)),
        groups=result.groups,
        progress=progress.part(0.2, 1.0),
    )
    return replace(result, structure=found)


def _connected(made: design.SpiralDesign, settings: Settings, progress: Progress) -> Connections | None:
    """Return the connectors of a design; None if they cannot be cut."""
    try:
        return connect(made, settings.connect, settings.sheet.tolerance, progress, settings.cut.mill)
    except FlexMapsError:
        return None


def _sheets(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.design is not None
    split.check_size(result.design.flat, settings.layout, settings.sheet)
    base = None if settings.base.base == "none" else _base(result, settings)
    made = sheets.make_sheets(result.design, settings.sheet, progress, settings.connect, settings.cut, base)
    if base is not None:
        more = overloaded(base.eyelets, base.thickness, settings.material.chosen)
        made = replace(made, warnings=(*made.warnings, *more))
    return replace(result, sheets=made)


def _base(result: Result, settings: Settings) -> Base:
    """Make the base of the simulated piece. Raises ``FlexMapsError`` if there is no simulated shape."""
    assert result.design is not None
    simulation = result.simulation
    if simulation is None or not simulation.equilibrium.converged:
        failed = result.undone.get("simulate")
        why = "" if failed is None else f" ({failed.message})"
        raise FlexMapsError(
            f"A base is made for the simulated shape, and there is none; press Simulate first, or choose no base{why}"
        )
    return standing(result.design, simulation.equilibrium.pose, result.supports, settings, simulation.reactions)


def standing(
    design: SpiralDesign, pose: Pose, supports: np.ndarray | None, settings: Settings, pull: np.ndarray | None = None
) -> Base:
    """Make the base that a piece stands on, or the eyelets that it hangs by.

    Parameters
    ----------
    design : the spirals
    pose : of their hubs at equilibrium
    supports : quads that are held
    settings : kind and sizes of the base
    pull : (F, 3) newtons, forces of the supports on the quads

    Raises
    ------
    FlexMapsError : as in ``make_base``
    """
    check_hold(settings.base, settings.simulate)
    mesh = design.flat.layout.mesh
    lowest = float(simulate.move_vertices(design, pose, mesh)[np.unique(mesh.quads), 2].min())
    if not settings.base.stands:
        eyelets = make_eyelets(design, pose, supports, settings.base.eyelet, settings.cut, pull)
        return Base(design, (), (), lowest, design.params.thickness, eyelets)
    clearance = settings.connect.clearance
    return make_base(design, pose, supports, settings.base, settings.sheet, lowest=lowest, clearance=clearance)


def _estimate(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.sheets is not None
    assert result.design is not None
    progress(0.0, "How long making takes, and how hard the seams are to join")
    figures = estimates.estimate(result.sheets, result.design, settings.material.chosen, settings.cost)
    joins = assembly_check.check_assembly(result.design, result.sheets.connections, result.simulation)
    return replace(result, estimates=figures, assembly=joins)


STEPS: dict[str, Callable[[Result, Settings, Progress], Result]] = {
    "regularise": _regularise,
    "trace": _trace,
    "merge": _merge,
    "split": _split,
    "choose": _choose,
    "spirals": _spirals,
    "optimise": _optimise,
    "simulate": _simulate,
    "compare": _compare,
    "structure": _structure,
    "sheets": _sheets,
    "estimate": _estimate,
}
