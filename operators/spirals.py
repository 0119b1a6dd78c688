"""Compute width and twist of every spiral from the curvature of the surface."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store.i18n import format_range, translate
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..bridge.view.flat_panels import PanelDrawing
    from ..engine.runs.result import Result

    # panels to draw, report blocks "spirals" and "layout" (None if the layout is unchanged)
    DrawnSpirals = tuple[PanelDrawing, dict[str, Any], dict[str, Any] | None]


class Spirals(ContinuedStage["DrawnSpirals"], bpy.types.Operator):
    """Give every quad its spiral: the more the surface bends there, the softer. Draws the true panels beside the model"""

    bl_idname = "flexmaps.spirals"
    bl_label = "Spirals"
    required_output = "flat"

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[DrawnSpirals]:
        from ..bridge.view.flat_panels import PanelDrawing

        settings = snapshot.settings

        def go_on(result: Result, progress: Progress) -> DrawnSpirals:
            from ..engine.patches.flattening.flattening_report import layout_report
            from ..engine.runs import job
            from ..engine.runs.outputs import DesignVersion
            from ..engine.spirals.design_report import design_report

            made = job.run_stages(result, settings, ("spirals",), progress.part(0.0, 0.5)).need(DesignVersion).design
            progress(0.5, "Drawing outlines")
            drawing = PanelDrawing.from_design(made, settings, progress.part(0.5, 0.9))
            layout = None if made.flat is result.flat else layout_report(made.flat)
            return drawing, design_report(made, progress.part(0.9, 1.0)), layout

        return go_on

    def after_write(self, context: bpy.types.Context, obj: bpy.types.Object, result: DrawnSpirals) -> Iterator[None]:
        return result[0].show(obj, context.scene)

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: DrawnSpirals
    ) -> str:
        drawing, block, layout = result
        drawing.write(obj, surface, block, layout)
        low, _, high = block["twist_deg"]
        twist = format_range(f"{low:.0f}", f"{high:.0f}", "\N{DEGREE SIGN}")
        text = translate("{} spirals, twist {}", block["count"], twist)
        findings = drawing.design.findings
        self.level = "WARNING" if findings else "INFO"
        return ". ".join([text, *(finding.message for finding in findings)])


CLASSES = (Spirals,)
