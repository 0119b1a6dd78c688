"""Check the mesh, and select the faces that a finding names."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.hosts import preload
from ..bridge.store import notes
from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import OnObject, StageOperator, Work, reveal


class Check(StageOperator, bpy.types.Operator):
    """Look for everything that would stop the job or spoil the piece"""

    bl_idname = "flexmaps.check"
    bl_label = "Check"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        def work(progress: Progress) -> Any:
            from ..engine.surface.checking import check

            progress(0.0, "Looking at every face")
            return check.everything(surface.polygons)

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        notes.write_checks(obj.data, result)
        errors = [finding for finding in result if finding.is_error]
        if errors:
            raise FlexMapsError(errors[0].message, faces=errors[0].faces, edges=errors[0].edges)
        count = len(surface.polygons.sizes)
        return (
            translate("{} quads, {} warnings", count, len(result))
            if result
            else translate("{} quads, nothing to complain about", count)
        )


class ShowFinding(OnObject, bpy.types.Operator):
    """Select the faces that this is about"""

    bl_idname = "flexmaps.show_finding"
    bl_label = "Show faces"
    bl_options = {"REGISTER", "UNDO"}

    index: bpy.props.IntProperty(min=0, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        problem = super().problem(context)
        if problem is None and not notes.read(context.object.data).get("checks"):
            return "There is nothing to show; press Check first"
        return problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.store import mesh

        obj = context.object
        findings = notes.read(obj.data)["checks"]
        if self.index >= len(findings):
            return {"CANCELLED"}
        finding = findings[self.index]
        try:
            surface = mesh.read_surface(obj, context.scene)
            if any(f >= len(surface.polygons.sizes) for f in finding["faces"]):
                raise FlexMapsError("The mesh was changed since; press Check again")
            reveal(context, obj, surface, finding["faces"], finding["edges"])
        except FlexMapsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, finding["message"])
        return {"FINISHED"}


CLASSES = (Check, ShowFinding)
