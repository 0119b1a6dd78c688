"""The assembled piece with its true spirals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..bridge import notes
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .spirals import DRAWN
from .stage import Stage, Work

if TYPE_CHECKING:
    from ..engine.fabrication.connector_path import Tip


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
            from ..engine.fabrication.connectors import connect
            from ..engine.mechanics.assembly import target_pose
            from ..engine.surface import check

            progress(0.0, "Reading the spirals")
            quads = check.as_quad_mesh(surface.polygons)
            design = mesh.design_of(surface, mesh.current_flat(surface, quads), settings.spiral)
            if design is None:
                raise FlexMapsError("There are no spirals yet; press Spirals first")
            tips: tuple[Tip, ...] = ()
            if settings.preview.joined and settings.preview.detail != "LINES":
                made = connect(design, settings.connect, DRAWN, progress.part(0.2, 0.7), settings.cut.mill)
                tips = made.tips
            progress(0.7, "Bending the arms")
            stand = target_pose(quads, design.flat.corners) if found is None else found
            return preview.build(design, stand, settings.preview.detail, tips), settings.preview, found is not None

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import animation, equilibrium, preview

        built, params, simulated = result
        animation.clear(obj)  # one of both stands there
        preview.show(obj, context.scene, built, params, simulated)
        figures = preview.note_of(obj)
        text = f"{figures['spirals']} spirals, {figures['triangles']} triangles in {figures['seconds']:.1f} s"
        if not simulated:
            return f"{text}. Not simulated yet: the hubs lie on the target"
        if equilibrium.out_of_date(obj, context.scene):
            self.level = "WARNING"
            return f"{text}. The mesh or a setting was changed since; press Simulate again"
        return text


CLASSES = (Preview,)
