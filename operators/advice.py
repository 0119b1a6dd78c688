"""Operators that apply a remedy advised by the optimiser, rerun the stages, and report the effect.

The remedies are a larger piece, a thinner sheet, and finer quads.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import advice, stored_report
from ..bridge.store.objects import find_by_uid
from ..engine.errors import FlexMapsError
from ..engine.optimisation.remedies import FINER, LARGER, MILLIMETRES, THINNER
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..bridge.view.remedied_piece import RemediedPiece
    from ..engine.runs.result import Result


class RemedyStage(ContinuedStage["RemediedPiece"]):
    """Base of the remedies' operators: change the piece as advised, then rerun the stages that had run before.

    remedy : name of the remedy in the advice
    """

    required_output = "flat"
    reads_loads = True
    remedy = ""

    _amount = 0.0  # amount from the advice, see ``remedies.remedy_amounts``
    _figures: Any = None  # report block "equilibrium" when the advice was given

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return stored_report.missing_result(obj.data, "design") or advice.refusal(obj.data, cls.remedy)

    def apply_remedy(self, result: Result, snapshot: Snapshot, was_optimised: bool, progress: Progress) -> Result:
        """Return the result with the remedy applied and spirals made; runs outside Blender's main thread.

        ``was_optimised``: whether the spirals were optimised before.
        """
        raise NotImplementedError

    def settings(self, snapshot: Snapshot) -> ObjectSettings:
        """Return the settings with the remedy applied."""
        return snapshot.settings

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[RemediedPiece]:
        from ..bridge.store import states
        from ..bridge.view import live_shape, optimisation_shape, remedied_piece
        from ..bridge.view.flat_panels import PanelDrawing

        blocks = stored_report.read(obj.data)
        if states.read_states(obj, bpy.context.scene)["reach"].kind != states.DONE:
            raise FlexMapsError("The advice is out of date; press Simulate or Optimise first")
        amount = advice.read_advice(obj.data)[self.remedy]
        assert amount is not None
        self._amount, self._figures = amount, blocks["equilibrium"]
        was_optimised, wanted = "optimise" in blocks, self.settings(snapshot)
        search = optimisation_shape.make_optimiser(wanted)

        def go_on(result: Result, progress: Progress) -> remedied_piece.RemediedPiece:
            from ..engine.runs import report
            from ..engine.runs.outputs import DesignVersion

            made = self.apply_remedy(result, snapshot, was_optimised, progress.part(0.0, 0.3))
            if was_optimised:
                made = search(made, progress.part(0.3, 0.9))
                made = live_shape.simulate_and_show(
                    made, replace(wanted, simulate=replace(wanted.simulate, restarts=0)), progress.part(0.9, 0.92)
                )
            else:
                made = live_shape.simulate_and_show(made, wanted, progress.part(0.3, 0.9))
            progress(0.92, "Drawing outlines")
            panels = PanelDrawing.from_design(made.need(DesignVersion).design, wanted, progress.part(0.92, 0.99))
            return remedied_piece.RemediedPiece(
                result, made, panels, report.report_blocks(made, progress=progress.part(0.99, 1.0))
            )

        return go_on

    def after_write(self, context: bpy.types.Context, obj: bpy.types.Object, result: RemediedPiece) -> Iterator[None]:
        return result.panels.show(obj, context.scene)

    def write_piece(
        self,
        context: bpy.types.Context,
        obj: bpy.types.Object,
        surface: ObjectSurface,
        piece: RemediedPiece,
        before: float,
        after: float,
    ) -> str:
        """Write the changed piece and its report into an object that has its shape, and return a text for the user.

        ``before`` and ``after`` are values of the quantity that the remedy changes.
        """
        from ..bridge.view import remedied_piece

        text, good = remedied_piece.write_remedied_piece(
            obj, context.scene, surface, piece, (self.remedy, before, after), self._figures
        )
        self.level = "INFO" if good else "WARNING"
        return text


class MakeLarger(RemedyStage, bpy.types.Operator):
    """Enlarge the object by the advised factor and update panels, spirals and shape; optimised spirals are optimised again. Reports how much nearer the shape is"""

    bl_idname = "flexmaps.make_larger"
    bl_label = "Larger"
    remedy = LARGER

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return super().obstacle(obj) or (
            "The object's scale is locked; unlock it first" if any(obj.lock_scale) else None
        )

    def apply_remedy(self, result: Result, snapshot: Snapshot, was_optimised: bool, progress: Progress) -> Result:
        from ..bridge.store import mesh
        from ..engine.runs import job
        from ..engine.runs.outputs import DesignVersion

        about = snapshot.surface.to_metres[:3, 3]
        made = job.scale_piece(result, self._amount, about, snapshot.settings, progress.part(0.0, 0.8))
        if (
            was_optimised
            or snapshot.spirals_block is None
            or not mesh.is_as_reported(result.need(DesignVersion).design, snapshot.spirals_block)
        ):
            return made  # optimised or hand-made spirals are a better start than spirals computed from the curvature
        return job.run_stages(made, snapshot.settings, ("spirals",), progress.part(0.8, 1.0))

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: RemediedPiece
    ) -> str:
        from ..bridge.store import mesh, states
        from ..bridge.view import framing
        from ..bridge.view.remedied_piece import has_same_quads

        scale = obj.scale.copy()
        obj.scale = scale * self._amount
        context.view_layer.update()
        now = mesh.read_surface(obj, context.scene)
        if not has_same_quads(now, result.after.mesh):
            obj.scale = scale
            context.view_layer.update()
            raise FlexMapsError(
                f"Something else sets the scale of '{obj.name}', a constraint or a driver; scale it there"
            )
        framing.scale_views(context, obj, self._amount)
        # scaling changes the checksum of "down" as well, although the object was not turned
        self._settings_checksums |= {"down": states.read_settings_checksums(obj, context.scene)["down"]}
        stored_report.write_checks(obj.data, result.after.findings)
        return self.write_piece(context, obj, now, result, 1.0, self._amount)


class MakeThinner(RemedyStage, bpy.types.Operator):
    """Take the next thinner sheet and simulate again; optimised spirals are optimised again. Reports how much nearer the shape is"""

    bl_idname = "flexmaps.make_thinner"
    bl_label = "Thinner sheet"
    remedy = THINNER

    _was = 0.0  # thickness before, millimetres

    def settings(self, snapshot: Snapshot) -> ObjectSettings:
        spiral = replace(snapshot.settings.spiral, thickness=self._amount / MILLIMETRES)
        return replace(snapshot.settings, spiral=spiral)

    def apply_remedy(self, result: Result, snapshot: Snapshot, was_optimised: bool, progress: Progress) -> Result:
        from ..engine.runs.outputs import DesignVersion

        result.need(DesignVersion)
        self._was = snapshot.settings.spiral.thickness * MILLIMETRES
        return result.without_outdated(self.settings(snapshot))

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: RemediedPiece
    ) -> str:
        from ..bridge.store import states
        from ..engine.runs import stages

        obj.flexmaps.spiral.thickness = self._amount
        now, others = states.read_settings_checksums(obj, context.scene), stages.STAGES["spirals"].settings
        # accept the new thickness as an input, unless the user changed another setting of the spirals meanwhile
        if all(now[part] == self._settings_checksums[part] for part in others):
            self._settings_checksums |= {"spiral": now["spiral"]}
        return self.write_piece(context, obj, surface, result, self._was, self._amount)


class MakeFiner(RemedyStage, bpy.types.Operator):
    """Make a new object of about twice as many quads, hide this one, and make again what there was. Its seams are made anew: those marked by hand, and a layout that was chosen, stay with the old object"""

    bl_idname = "flexmaps.make_finer"
    bl_label = "Finer quads"
    remedy = FINER

    _made = 0  # Blender's id of the new object

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        problem = super().obstacle(obj)
        if problem is None and obj.mode != "OBJECT":
            return "Go to Object Mode: a new object is made"
        if problem is None and (obj.flexmaps.loads.supports or obj.flexmaps.loads.pulled):
            return "Supports and forces belong to the old quads: use Quad remesh, and choose them anew"
        return problem

    def apply_remedy(self, result: Result, snapshot: Snapshot, was_optimised: bool, progress: Progress) -> Result:
        from ..bridge.hosts import remesh
        from ..engine.runs import job
        from ..engine.surface.checking import check
        from ..engine.surface.mesh import PolygonMesh

        settings, polygons = snapshot.settings, snapshot.surface.polygons
        remeshed = remesh.make_quads(polygons, round(self._amount), settings, progress.part(0.0, 0.5))
        begun = job.check_input(remeshed.polygons)
        made = job.run_until(begun, settings, "design", progress=progress.part(0.5, 1.0), fresh=True)
        return made.with_surface(findings=[*check.all_findings(PolygonMesh.from_quads(made.mesh)), *remeshed.findings])

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: RemediedPiece
    ) -> str:
        from ..bridge.hosts import remesh
        from ..bridge.store import mesh, states
        from ..bridge.view import overlay, replacing
        from ..bridge.view.remedied_piece import has_same_quads
        from ..engine.surface.mesh import PolygonMesh

        quads = result.after.mesh
        made = remesh.as_object(PolygonMesh.from_quads(quads), obj, context.scene)
        try:
            context.view_layer.update()
            now = mesh.read_surface(made, context.scene)
            if not has_same_quads(now, quads):
                raise FlexMapsError(f"'{obj.name}' is sheared by its parents; apply its scale and rotation first")
            stored_report.write_checks(made.data, result.after.findings)
            text = self.write_piece(context, made, now, result, len(surface.polygons.sizes), len(quads.quads))
        except FlexMapsError:
            bpy.data.meshes.remove(made.data)  # removes the object too
            raise
        replacing.replace_object(context, obj, made)
        states.stamp(made, context.scene, self._settings_checksums)
        overlay.update_after_stage(made, self.overlay_kind)
        self._made = made.session_uid
        return text

    def after_write(self, context: bpy.types.Context, obj: bpy.types.Object, result: RemediedPiece) -> Iterator[None]:
        return super().after_write(context, find_by_uid(self._made), result)


CLASSES = (MakeLarger, MakeThinner, MakeFiner)
