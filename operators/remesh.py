"""Remesh a surface into quads, and scale an object to the wanted quad edge."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import bpy

from ..bridge.hosts import preload
from ..bridge.store import dimensions, settings, stored_report
from ..bridge.store.i18n import translate
from ..bridge.store.objects import find_by_uid
from ..bridge.view import followed_views, replacing
from ..engine.errors import FlexMapsError
from ..engine.figures import format_length
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import AnyMeshOperator, StageOperator, Work, redraw

if TYPE_CHECKING:
    from ..bridge.store.surface import ObjectSurface
    from ..engine.surface.checking.check import Finding
    from ..engine.surface.remeshing.requad import RemeshResult


class QuadRemesh(AnyMeshOperator, StageOperator["RemeshResult"], bpy.types.Operator):
    """Make a new object of quads in the shape of this one, and hide this one. Modifiers are applied on the way"""

    bl_idname = "flexmaps.quad_remesh"
    bl_label = "Quad remesh"
    on_stop = "the best so far is kept"

    quads: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Quads", description="About how many; 0 for as many as are set", min=0, options={"SKIP_SAVE"}
    )

    size: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Size", description="Millimetres of the longest side of the quads; 0 leaves them as large as the mesh", min=0.0, options={"SKIP_SAVE"}
    )  # fmt: skip

    _source = 0  # Blender's id of the object to remesh

    @property
    def uid(self) -> int:
        return self._source

    def _read(self, context: bpy.types.Context) -> Work[RemeshResult]:
        """Read the mesh with its modifiers applied, and return the work that remeshes it."""
        preload.wait()
        from ..bridge.hosts import remesh

        self._source = context.object.session_uid
        replacing.leave_edit_mode(context)
        wanted = settings.read(context.object.flexmaps, ObjectSettings)
        polygons, count = remesh.read_polygons(context.object, context), self.quads or wanted.remesh.quads
        return lambda progress: remesh.make_quads(polygons, count, wanted, progress)

    def _write(self, context: bpy.types.Context, result: RemeshResult) -> Iterator[None]:
        from ..bridge.hosts import remesh
        from ..bridge.store import mesh, modifiers, remesh_source, states
        from ..engine.surface.checking import check

        obj = find_by_uid(self._source)
        made = remesh.as_object(result.polygons, obj, context.scene)
        source = remesh_source.read_source(obj, context.scene)
        remesh_source.write_source(made, source)
        replacing.replace_object(context, obj, made)
        modifiers.write_note(made.data, modifiers.describe_ignored(source))
        if self.size:
            replacing.resize(context, made, self.size)
        polygons = mesh.read_surface(made, context.scene).polygons
        stored_report.write_checks(made.data, [*check.all_findings(polygons), *result.findings])
        states.stamp(made, context.scene)
        states.stamp_side_result(made, context.scene, "regularise")  # a remesh regularises its quads
        edge = check.median_edge(polygons)
        lines = [translate("'{}': {} quads, spirals of {}", made.name, len(made.data.polygons), format_length(edge))]
        lines += [finding.message for finding in result.findings]
        lines = lines if bpy.app.background else lines[:1]  # the sidebar shows the findings
        self.report({"WARNING" if result.findings else "INFO"}, ". ".join(lines))
        redraw(context)
        yield


class SetSize(StageOperator["tuple[float, float, list[Finding]]"], bpy.types.Operator):
    """Scale the object so that the median edge of its quads has the length that is set. Seams stay; flat panels go"""

    bl_idname = "flexmaps.set_size"
    bl_label = "Scale to quad edge"

    times: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Times", description="So many times as large as it is, the quad edge too; 0 for the quad edge that is set",
        min=0.0, options={"SKIP_SAVE"},
    )  # fmt: skip

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return "The object's scale is locked; unlock it first" if any(obj.lock_scale) else None

    def prepare(self, surface: ObjectSurface, settings: ObjectSettings) -> Work[tuple[float, float, list[Finding]]]:
        times = self.times

        def work(progress: Progress) -> tuple[float, float, list[Finding]]:
            from ..engine.surface.checking import check

            progress(0.0, "Measuring edges")
            now = check.median_edge(surface.polygons)
            if not 0 < now < float("inf"):
                raise FlexMapsError("The mesh has no size: its edges have no length; scale it by hand first")
            edge = times * now or settings.remesh.edge
            return edge / now, edge, check.all_findings(check.scale_to_metres(surface.polygons, edge=edge))

        return work

    def finish(
        self,
        context: bpy.types.Context,
        obj: bpy.types.Object,
        surface: ObjectSurface,
        result: tuple[float, float, list[Finding]],
    ) -> str:
        factor, edge, findings = result
        if self.times:
            obj.flexmaps.remesh.edge = edge * 1e3
        replacing.scale_object(context, obj, factor)
        replacing.drop_results(obj, findings)
        size = max(dimensions.extents(obj)) * context.scene.unit_settings.scale_length
        return translate("Scaled to {}, spirals of {}", format_length(size), format_length(edge))


def register() -> None:
    followed_views.register()


def unregister() -> None:
    followed_views.unregister()


CLASSES = (QuadRemesh, SetSize)
