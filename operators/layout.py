"""Trace, merge, flatten, update from seams: everything that changes where the surface is cut."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge import notes
from ..bridge.words import told
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work


class LayoutStage(Stage):
    """What these stages write: seams, the flat patches, and what they cost."""

    shows = "PATCH"  # on a smooth surface seams are seen in edit mode only

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import arrange, beside, mesh

        flat, block = result
        centres = arrange.side_by_side(flat)
        mesh.write_flat(obj, surface, flat, centres)
        mesh.shelve_design(obj)
        beside.show_flat(obj, context.scene, flat, centres)
        notes.write(obj.data, "layout", block)
        return told("{} patches, largest distortion {:.3f}", block["patches"], block["energy_max"])


class Trace(LayoutStage, bpy.types.Operator):
    """Cut the surface along straight lines of quads, from every irregular vertex on. Seams that are there are replaced"""

    bl_idname = "flexmaps.trace"
    bl_label = "Trace"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        def work(progress: Progress) -> Any:
            from ..engine.patches import flatten, trace
            from ..engine.surface import check

            layout = trace.trace(check.as_quad_mesh(surface.polygons), settings.layout, progress.part(0.0, 0.7))
            flat = flatten.flatten(layout, settings.layout, progress.part(0.7, 1.0))
            return flat, flatten.layout_report(flat) | {notes.TRACED: len(layout.patches) > 1}

        return work


class Merge(LayoutStage, bpy.types.Operator):
    """Join patches as long as they stay within the limits, and cut what is larger than the sheet; begins with the seams, or traces first where there are none"""

    bl_idname = "flexmaps.merge"
    bl_label = "Merge"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import mesh

        def work(progress: Progress) -> Any:
            from ..engine.patches import flatten, merge, split, trace
            from ..engine.surface import check

            quads = check.as_quad_mesh(surface.polygons)
            layout = trace.make_disks(mesh.layout_of(surface, quads))
            traced = trace.trace(quads, settings.layout, progress.part(0.0, 0.1))
            if not surface.seams.any() or (layout.cut == traced.cut).all():
                layout = traced  # nobody chose these cuts
            held = bool(settings.loads.supports)
            flat = merge.merge(layout, settings.layout, progress.part(0.1, 0.9), held=held)
            flat = split.split(flat, settings.layout, settings.sheet, progress.part(0.9, 1.0))
            return flat, flatten.layout_report(flat)

        return work


class FlattenStage(LayoutStage):
    """Flattens the patches between the seams; with ``reuse`` only those that are not flat yet."""

    reuse = False

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import mesh

        def work(progress: Progress) -> Any:
            from ..engine.patches import flatten, trace
            from ..engine.surface import check

            progress(0.0, "Reading the seams")
            quads = check.as_quad_mesh(surface.polygons)
            layout = trace.make_disks(mesh.layout_of(surface, quads))
            previous = mesh.flat_of(surface, quads) if self.reuse else None
            flat = flatten.flatten(layout, settings.layout, progress, previous=previous)
            return flat, flatten.layout_report(flat)

        return work


class Flatten(FlattenStage, bpy.types.Operator):
    """Flatten all patches between the seams anew; a patch that is no disk is cut open"""

    bl_idname = "flexmaps.flatten"
    bl_label = "Flatten"


class UpdateFromSeams(FlattenStage, bpy.types.Operator):
    """Flatten the patches whose seams were edited with Mark Seam and Clear Seam; the others stay as they are"""

    bl_idname = "flexmaps.update_from_seams"
    bl_label = "Update from seams"
    reuse = True

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return None if "layout" in notes.read(obj.data) else "Trace, merge or flatten first"


CLASSES = (Trace, Merge, Flatten, UpdateFromSeams)
