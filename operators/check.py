"""Check the mesh for faults, and select the faces that a finding names."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..bridge.store import stored_report
from ..bridge.store.i18n import quads, translate
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import ImmediateOperator, ObjectOperator, StageOperator, Work

if TYPE_CHECKING:
    from ..bridge.store.surface import ObjectSurface
    from ..engine.surface.checking.check import Finding


class Check(StageOperator["list[Finding]"], bpy.types.Operator):
    """Look for everything that would stop the job or spoil the piece"""

    bl_idname = "flexmaps.check"
    bl_label = "Check"

    def prepare(self, surface: ObjectSurface, settings: ObjectSettings) -> Work[list[Finding]]:
        def work(progress: Progress) -> list[Finding]:
            from ..engine.surface.checking import check

            progress(0.0, "Looking at every face")
            return check.all_findings(surface.polygons)

        return work

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: list[Finding]
    ) -> str:
        stored_report.write_checks(obj.data, result)
        errors = [finding for finding in result if finding.is_error]
        if errors:
            raise FlexMapsError(errors[0].message, faces=errors[0].faces, edges=errors[0].edges)
        count = len(surface.polygons.sizes)
        if not result:
            return translate("{}, nothing to complain about", quads(count))
        return translate("{}, {} warning" if len(result) == 1 else "{}, {} warnings", quads(count), len(result))

    def _store_failure(self, context: bpy.types.Context, obj: bpy.types.Object, error: FlexMapsError) -> None:
        """Do not store the failure, because the findings are shown as notices already."""


class ShowFinding(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Select the faces that this is about"""

    bl_idname = "flexmaps.show_finding"
    bl_label = "Show faces"

    index: bpy.props.IntProperty(min=0, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        problem = super().problem(context)
        if problem is None and not stored_report.read(context.object.data).get("checks"):
            return "There is nothing to show; press Check first"
        return problem

    def run(self, context: bpy.types.Context) -> str:
        from ..bridge.view import framing

        findings = stored_report.read(context.object.data)["checks"]
        if self.index >= len(findings):
            raise FlexMapsError("There is nothing to show; press Check first")
        finding = findings[self.index]
        framing.select_and_frame(context, finding["faces"], finding["edges"])
        return str(finding["message"])


CLASSES = (Check, ShowFinding)
