"""The assembled piece with its true spirals."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge import notes
from ..bridge.words import told
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work


class Preview(Stage, bpy.types.Operator):
    """Show the assembled piece with every spiral in its true shape, bent as the last simulation found"""

    bl_idname = "flexmaps.preview"
    bl_label = "Preview"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return None if "spirals" in notes.read(obj.data) else "Press Spirals first"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import mesh, pose, preview
        from ..bridge.objects import find

        obj = find(surface.uid)
        found = pose.read(obj, surface.to_metres)
        if settings.preview.colour != "MATERIAL":
            preview.quad_colours(obj, settings.preview.colour)  # asked for before the work, not after

        def work(progress: Progress) -> Any:
            from ..engine.mechanics.assembly import target_pose
            from ..engine.surface import check

            progress(0.0, "Reading the spirals")
            quads = check.as_quad_mesh(surface.polygons)
            design = mesh.design_of(surface, mesh.current_flat(surface, quads), settings.spiral)
            if design is None:
                raise FlexMapsError("There are no spirals yet; press Spirals first")
            wires = settings.preview.detail == "LINES"
            tips = () if wires else preview.tips_of(design, settings, progress.part(0.2, 0.7))
            bending = progress.part(0.7, 1.0)
            stand = target_pose(quads, design.flat.corners) if found is None else found
            built = preview.build(design, stand, settings.preview.detail, tips, bending)
            return built, settings.preview, found is not None

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import animation, equilibrium, preview, states

        built, params, simulated = result
        animation.clear(obj)  # one of both stands there
        preview.show(obj, context.scene, built, params, simulated)
        states.stamp_beside(obj, context.scene, "preview", self._made_from)
        figures = preview.note_of(obj)
        amounts = figures["spirals"], figures["triangles"], figures["seconds"]
        text = told("{} spirals, {} triangles in {:.1f} s", *amounts)
        if not simulated:
            return f"{text}. {told('Not simulated yet: the hubs lie on the target')}"
        if equilibrium.out_of_date(obj, context.scene):
            self.level = "WARNING"
            return f"{text}. {told('The mesh or a setting was changed since; press Simulate again')}"
        return text


CLASSES = (Preview,)
