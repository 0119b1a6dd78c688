"""Operators that change where the surface is cut: trace, merge, flatten, update from seams."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import derived_properties, stored_report
from ..bridge.store.i18n import panels, translate
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage
from .stage import Work

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.patches.flattening.flatten import FlatPatches
    from ..engine.runs.result import Result

    FlatReported = tuple[FlatPatches, dict[str, Any]]  # flat patches and their report block


class LayoutStage(ContinuedStage):
    """Base of the operators that change the layout: write seams, flat patches and their report block."""

    overlay_kind = "PATCH"  # colour the patches, because Blender draws seams in edit mode only

    def _read(self, context: bpy.types.Context) -> Work:
        derived_properties.store_border_setting(context.object)
        return super()._read(context)

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: FlatReported
    ) -> str:
        from ..bridge.store import mesh, states
        from ..bridge.view import flat_panels
        from ..engine.display import arrange

        flat, block = result
        centres = arrange.arrange_patches(flat)
        mesh.write_flat(obj, surface, flat, centres)
        mesh.shelve_design(obj)
        flat_panels.show_flat(obj, context.scene, flat, centres)
        stored_report.write(obj.data, "layout", block)
        states.stamp_side_result(obj, context.scene, "forecast", self._settings_checksums)
        return describe_layout(block)

    def after_write(self, context: bpy.types.Context, obj: bpy.types.Object, result: object) -> Iterator[None]:
        """Frame the object and its panels in the 3D views, but only after the first layout of its quads."""
        from ..bridge.view import collection, framing

        own = collection.find(obj)
        if own is not None and framing.FRAMED_KEY not in obj:
            obj[framing.FRAMED_KEY] = True
            framing.frame_objects(context, obj, *own.objects)
        return iter(())


def describe_layout(block: dict[str, Any]) -> str:
    """Return a line for the user from the report block "layout": number of panels and largest distortion."""
    if block["energy_max"] < 0.0005:  # three digits after the point would be zeros
        return translate("{} without distortion", panels(block["patches"]))
    return translate("{}, largest distortion {:.3f}", panels(block["patches"]), block["energy_max"])


def with_report(result: Result, **entries: object) -> FlatReported:
    """Return the flat patches and their report block; too slow for the main thread with thousands of quads.

    Parameters
    ----------
    result : result that holds the flat patches
    entries : further entries of the block
    """
    from ..engine.patches.flattening.flattening_report import layout_report
    from ..engine.runs.outputs import FinalLayout

    flat = result.need(FinalLayout).flat
    return flat, layout_report(flat) | entries


class Trace(LayoutStage, bpy.types.Operator):
    """Cut the surface along straight lines of quads, from every irregular vertex on. Seams that are there are replaced"""

    bl_idname = "flexmaps.trace"
    bl_label = "Trace"

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        def go_on(result: Result, progress: Progress) -> FlatReported:
            from ..engine.runs import job
            from ..engine.runs.outputs import TracedLayout

            made = job.run_stages(result, snapshot.settings, ("trace",), progress)
            return with_report(made, **{stored_report.TRACED: len(made.need(TracedLayout).layout.patches) > 1})

        return go_on


class Merge(LayoutStage, bpy.types.Operator):
    """Join panels as long as they stay within the limits, and cut what is larger than the sheet; begins with the seams, or traces first where there are none"""

    bl_idname = "flexmaps.merge"
    bl_label = "Lay out the panels"
    reads_loads = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        def go_on(result: Result, progress: Progress) -> FlatReported:
            from ..engine.runs import job, manual_changes

            traced = manual_changes.trace_with_seams(
                result, snapshot.read_seams(result), snapshot.settings, progress.part(0.0, 0.1)
            )
            return with_report(job.run_stages(traced, snapshot.settings, ("merge", "split"), progress.part(0.1, 1.0)))

        return go_on


class FlattenStage(LayoutStage):
    """Base of operators that flatten the patches between the seams; with ``reuse``, only changed patches."""

    reuse = False

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        from ..bridge.store import mesh

        reuse = self.reuse

        def go_on(result: Result, progress: Progress) -> FlatReported:
            from ..engine.runs import manual_changes

            previous = mesh.read_flat(snapshot.surface, result.mesh) if reuse else None
            return with_report(
                manual_changes.flatten_by_hand(
                    result, snapshot.read_seams(result), snapshot.settings, progress, previous
                )
            )

        return go_on


class Flatten(FlattenStage, bpy.types.Operator):
    """Flatten all panels between the seams anew; a panel that is not a disk is cut open"""

    bl_idname = "flexmaps.flatten"
    bl_label = "Flatten"


class UpdateFromSeams(FlattenStage, bpy.types.Operator):
    """Flatten the panels whose seams were edited with Mark Seam and Clear Seam; the others stay as they are"""

    bl_idname = "flexmaps.update_from_seams"
    bl_label = "Update from seams"
    reuse = True

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return stored_report.missing_result(obj.data, "flat")


CLASSES = (Trace, Merge, Flatten, UpdateFromSeams)
