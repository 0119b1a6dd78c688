"""Show the assembled piece with every spiral in its true shape."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..bridge.store.i18n import translate
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..bridge.view.preview import AssembledPiece
    from ..engine.params import PreviewParams
    from ..engine.runs.result import Result

    # the assembled piece, the settings to show it with, and whether it is simulated
    BuiltPreview = tuple[AssembledPiece, PreviewParams, bool]


class Preview(ContinuedStage["BuiltPreview"], bpy.types.Operator):
    """Show the assembled piece with every spiral in its true shape, bent as the last simulation found"""

    bl_idname = "flexmaps.preview"
    bl_label = "Preview"

    required_output = "design"

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[BuiltPreview]:
        from ..bridge.store import pose
        from ..bridge.view import preview

        settings, stored = snapshot.settings, pose.read(obj, snapshot.surface.to_metres)
        if settings.preview.colour != "MATERIAL":
            preview.quad_colours(obj, settings.preview.colour)  # fail before the work, not after it

        def go_on(result: Result, progress: Progress) -> BuiltPreview:
            from ..engine.mechanics.assembly import target_pose
            from ..engine.runs.outputs import DesignVersion

            design = result.need(DesignVersion).design
            wires = settings.preview.detail == "LINES"
            tips = () if wires else preview.connector_tips(design, settings, progress.part(0.2, 0.7))
            bending = progress.part(0.7, 1.0)
            stand = target_pose(result.mesh, design.flat.corners) if stored is None else stored
            base = preview.make_base(design, stand, result.supports, settings)
            built = preview.build_piece(design, stand, settings.preview.detail, tips, bending, base)
            return built, settings.preview, stored is not None

        return go_on

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: BuiltPreview
    ) -> str:
        from ..bridge.store import states
        from ..bridge.view import animation, preview

        built, params, simulated = result
        animation.clear(obj)  # preview and animation are shown in the same place
        preview.show_piece(obj, context.scene, built, params, simulated)
        states.stamp_side_result(obj, context.scene, "preview", self._settings_checksums)
        figures = preview.read_figures(obj)
        amounts = figures["spirals"], figures["triangles"], figures["seconds"]
        text = translate("{} spirals, {} triangles in {:.1f} s", *amounts)
        if not simulated:
            return f"{text}. {translate('Not simulated yet: the hubs lie on the target')}"
        if states.is_stale(obj, context.scene, "equilibrium"):
            self.level = "WARNING"
            return f"{text}. {translate('The mesh or a setting was changed since; press Simulate again')}"
        return text


class RemoveLeftOver(bpy.types.Operator):
    """Remove the panels, previews and films of models that were deleted"""

    bl_idname = "flexmaps.remove_left_over"
    bl_label = "Remove panels of deleted models"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..bridge.view import collection

        orphans = collection.find_orphans(context.scene)
        for own in orphans:
            collection.remove(own)
        return {"FINISHED"} if orphans else {"CANCELLED"}


CLASSES = (RemoveLeftOver, Preview)
