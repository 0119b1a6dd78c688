"""Analyse the piece under its load cases: snapping, displacement, strength."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..bridge.store import stored_report
from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage
from .stage import ImmediateOperator, ObjectOperator

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.extras.structure.analysis import StructuralAnalysis
    from ..engine.runs.result import Result


class CheckStructure(ContinuedStage["StructuralAnalysis"], bpy.types.Operator):
    """Follow every load case until the piece snaps, and tell how far it gives way, and what its arms and joints carry. The shape itself stays"""

    bl_idname = "flexmaps.structure"
    bl_label = "Check structure"
    required_output = "simulation"
    reads_loads = True
    overlay_kind = "UTILISATION"

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[StructuralAnalysis]:
        from ..bridge.store import equilibrium

        rest = equilibrium.read_rest_pose(obj, bpy.context.scene, snapshot.surface)
        if rest is None:
            raise FlexMapsError("The simulated shape is not an equilibrium, or is out of date; press Simulate first")
        settings = snapshot.settings

        def go_on(result: Result, progress: Progress) -> StructuralAnalysis:
            from ..engine.extras.structure.load_stage import LoadAnalysis
            from ..engine.runs import job

            at_rest = job.simulate_from_pose(result, rest, settings, progress.part(0.0, 0.1))
            made = job.run_stages(at_rest, settings, ("structure",), progress.part(0.1, 1.0))
            return made.need(LoadAnalysis).structure

        return go_on

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: StructuralAnalysis
    ) -> str:
        from ..bridge.store import equilibrium

        equilibrium.write_utilisation(obj, result.utilisation)
        block = result.report()
        stored_report.write(obj.data, "structure", block)
        messages = [finding["message"] for finding in block.get("findings", ())]
        self.level = "WARNING" if messages else "INFO"
        return ". ".join(messages) or translate("{} loads are borne", len(block["outcomes"]))


class AddLoad(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Add a load to the load cases; loads of one name act together"""

    bl_idname = "flexmaps.add_load"
    bl_label = "Add load"

    name: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Load case", description="A word; loads of one name act together", default="load"
    )
    kind: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Kind",
        items=[
            ("weight", "Weight", "The sheet's own weight"),
            ("point", "Point load (N)", "One force, shared by the quads"),
            ("line", "Line load (N/m)", "A force along a line of quads, by its length"),
            ("pressure", "Pressure (N/m2)", "From outside along the normals, which it follows"),
            ("wind", "Wind (N/m2)", "Along an axis, on the area that it sees"),
            ("snow", "Snow (N/m2)", "Along an axis, on the area that it sees"),
            ("move", "Movement (mm)", "Of supports"),
        ],
        default="snow",
    )
    value: bpy.props.FloatProperty(name="Value", description="N, N/m, N/m2 or mm, as the kind says", default=500.0)  # type: ignore[valid-type]
    axis: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Axis", items=[(sign + a, sign + a.upper(), "") for a in "xyz" for sign in ("", "-")], default="-z"
    )
    group: bpy.props.StringProperty(name="Group", description="Vertex group that it acts on; empty: all quads")  # type: ignore[valid-type]
    factor: bpy.props.FloatProperty(name="Factor", default=1.0)  # type: ignore[valid-type]
    lasting: bpy.props.BoolProperty(name="Lasts for years", description="It counts after a year too")  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        for prop in ("name", "kind"):
            layout.prop(self, prop)
        if self.kind != "weight":
            layout.prop(self, "value")
        if self.kind not in {"weight", "pressure"}:
            layout.prop(self, "axis")
        layout.prop_search(self, "group", context.object, "vertex_groups")
        layout.prop(self, "factor")
        if self.kind != "weight":
            layout.prop(self, "lasting")

    def run(self, context: bpy.types.Context) -> None:
        from ..engine.extras.structure import cases

        wanted = context.object.flexmaps.structure
        line = cases.format_line(self.name, self.kind, self.value, self.axis, self.group, self.factor, self.lasting)
        wanted.cases = "; ".join([*cases.split_lines(wanted.cases), line])


class RemoveLoad(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Take this load out"""

    bl_idname = "flexmaps.remove_load"
    bl_label = "Remove load"

    number: bpy.props.IntProperty(min=0, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def run(self, context: bpy.types.Context) -> None:
        from ..engine.extras.structure import cases

        wanted = context.object.flexmaps.structure
        left = cases.split_lines(wanted.cases)
        del left[self.number : self.number + 1]
        wanted.cases = "; ".join(left)


CLASSES = (CheckStructure, AddLoad, RemoveLoad)
