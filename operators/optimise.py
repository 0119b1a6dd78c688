"""Optimise the spirals so that the assembled piece comes closest to the target."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import stored_report
from ..bridge.store.i18n import translate
from ..engine.errors import Cancelled
from ..engine.extras import registry
from ..engine.figures import format_figure
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..bridge.view.flat_panels import PanelDrawing
    from ..engine.runs.result import Result

    # panels to draw, result, report blocks "optimise", "spirals" and "layout" (None if the layout is unchanged)
    SearchedSpirals = tuple[PanelDrawing, Result, dict[str, Any], dict[str, Any], dict[str, Any] | None]


# share of the progress bar before the search starts; about its share of the time (7 to 9 %)
SEARCH_START = 0.07
SEARCH_END, OUTLINES_END = (
    0.8,
    0.85,
)  # progress at the end of the search, and with outlines drawn; then remedies are tried


class SearchStage(ContinuedStage["SearchedSpirals"]):
    """Base of operators that optimise the spirals, starting from the result of ``initial_result``."""

    on_stop = "the best so far is kept"
    required_output = "flat"
    reads_loads = True

    def initial_result(self, result: Result, snapshot: Snapshot, progress: Progress) -> Result:
        """Return the result with initial spirals; runs outside Blender's main thread."""
        return snapshot.with_start(result)

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[SearchedSpirals]:
        from ..bridge.view import optimisation_shape
        from ..bridge.view.flat_panels import PanelDrawing

        once = replace(snapshot.settings, simulate=replace(snapshot.settings.simulate, restarts=0))
        search = optimisation_shape.make_optimiser(snapshot.settings)

        def go_on(result: Result, progress: Progress) -> SearchedSpirals:
            from ..engine.patches.flattening.flattening_report import layout_report
            from ..engine.runs import job
            from ..engine.runs.outputs import DesignVersion, OptimisationRecord
            from ..engine.spirals.design_report import design_report

            begun = self.initial_result(result, snapshot, progress.part(0.0, SEARCH_START))
            made = search(begun, progress.part(SEARCH_START, SEARCH_END))
            better = made.need(DesignVersion).design
            try:
                progress(SEARCH_END, "Drawing outlines")
                panels = PanelDrawing.from_design(better, snapshot.settings, progress.part(SEARCH_END, OUTLINES_END))
                spirals = design_report(better, progress.part(OUTLINES_END, OUTLINES_END))
                made = job.run_stages(made, once, ("simulate",), progress.part(OUTLINES_END, OUTLINES_END))
            except Cancelled:  # after a cancel keep the spirals, but skip the slower figures
                panels, spirals = PanelDrawing.without_connectors(better), design_report(better, with_slot=False)
            made = _with_remedy_effects(made, snapshot.settings, progress.part(OUTLINES_END, 1.0))
            layout = None if better.flat is result.flat else layout_report(better.flat)
            return panels, made, made.need(OptimisationRecord).optimisation.report(), spirals, layout

        return go_on

    def after_write(self, context: bpy.types.Context, obj: bpy.types.Object, result: SearchedSpirals) -> Iterator[None]:
        return result[0].show(obj, context.scene)

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: SearchedSpirals
    ) -> str:
        from ..bridge.store import equilibrium
        from ..engine.runs.outputs import OptimisationRecord

        panels, made, report, block, layout = result
        simulation = made.need(OptimisationRecord).optimisation.after
        panels.write(obj, surface, block, layout)
        equilibrium.write(obj, surface, simulation, made.limits)
        shape = simulation.report()
        limits = {} if made.limits is None else {"reach": made.limits.report()}  # None after a cancel
        stored_report.write_all(obj.data, {"equilibrium": shape, **limits, "optimise": report})
        text, warning = equilibrium.describe_result(shape)
        self.level = "WARNING" if warning else "INFO"
        away = [format_figure(report[name]) for name in ("rms_percent_before", "rms_percent")]
        steps = report["iterations"]
        lines = [
            *([] if report["finished"] else [translate("Stopped; the best so far is kept")]),
            translate(
                "Distance (RMS) {} to {} % in {} step" if steps == 1 else "Distance (RMS) {} to {} % in {} steps",
                *away,
                steps,
            ),
            *([text] if warning else []),
        ]
        return ". ".join(lines)


def _with_remedy_effects(result: Result, settings: ObjectSettings, progress: Progress) -> Result:
    """Return the result with the predicted effect of remedies; unchanged after a cancel or with drag targets."""
    if not registry.has("choosing"):
        return result
    from ..engine.extras.choosing.prospects import find_prospects
    from ..engine.runs.outputs import SimulatedShape

    shape = result.get(SimulatedShape)
    if shape is None or shape.limits is None or result.wishes is not None:
        return result
    unseen = replace(progress, shown=None)  # do not show the trial pieces in the 3D view
    try:
        tried = find_prospects(
            shape.simulation, shape.limits, settings, supports=result.supports, force=result.force, progress=unseen
        )
    except Cancelled:
        return result
    return result.with_outputs(replace(shape, limits=replace(shape.limits, prospects=tried)))


class Optimise(SearchStage, bpy.types.Operator):
    """Change width and twist of every spiral until the assembled panels take the target's shape as well as they can. Begins with the spirals that are there; press again to go on"""

    bl_idname = "flexmaps.optimise"
    bl_label = "Optimise"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        from ..bridge.store import attributes

        start = None if attributes.has(obj, "flexmaps_last_width") else stored_report.missing_result(obj.data, "design")
        return stored_report.missing_result(obj.data, "flat") or start


CLASSES = (Optimise,)
