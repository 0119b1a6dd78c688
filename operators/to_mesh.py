"""Convert the active object to a mesh without modifiers, which stages need because they store layouts in the mesh."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

import bpy

from ..bridge.store import modifiers, objects
from ..engine.errors import FlexMapsError
from .stage import AddObjectOperator, ImmediateOperator


class ToMesh(ImmediateOperator, AddObjectOperator, bpy.types.Operator):
    """Make a mesh of a text, curve, surface or metaball, or of a mesh with its modifiers applied; Next keeps the original, hidden. Solidify is left out: panels have the thickness of the sheet"""

    bl_idname = "flexmaps.to_mesh"
    bl_label = "Convert to a mesh"

    keep: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Keep original", description="Hide the original instead of removing it", options={"SKIP_SAVE"}
    )

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        obj = context.object
        if obj is None or (obj.type != "MESH" and obj.type not in objects.CONVERTIBLE):
            return "Select a mesh, text, curve, surface or metaball"
        if objects.drawn_model(obj) is not None:
            return objects.usage_problem(obj)
        return super().problem(context)

    def run(self, context: bpy.types.Context) -> str:
        source = context.object
        if source.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        without, place = modifiers.describe_ignored(source), source.matrix_world.copy()
        with modifiers.surface_only(source), _selected_alone(source, context):
            if not source.visible_get() or not source.select_get():
                raise FlexMapsError(f"'{source.name}' cannot be seen: show it and its collection in the outliner first")
            if not _has_faces(source, context):
                raise FlexMapsError(
                    f"'{source.name}' has no faces: give a curve a bevel or extrude it (Object Data, Geometry), or add faces to a mesh"
                )
            bpy.ops.object.convert(target="MESH", keep_original=self.keep)
        made = context.object
        if objects.bending_parent(made) is not None:  # it would bend the mesh once more
            made.parent, made.matrix_world = None, place
            made.update_tag(refresh={"DATA"})  # Blender evaluates a mesh that loses its parent anew only if told so
        if self.keep:  # otherwise Blender may have removed the source, as it does with metaballs
            source.hide_set(True)
        modifiers.write_note(made.data, without)
        return without


@contextmanager
def _selected_alone(source: bpy.types.Object, context: bpy.types.Context) -> Iterator[None]:
    """Context manager: show and select one object alone, as Blender converts the selection; select the others again."""
    others = [obj for obj in context.selected_objects if obj != source]
    hidden, locked, selected = source.hide_get(), source.hide_select, source.select_get()
    try:
        for obj in others:
            obj.select_set(False)
        source.hide_select = False
        source.hide_set(False)
        source.select_set(True)
        yield
    except (FlexMapsError, RuntimeError):
        source.select_set(selected)
        source.hide_set(hidden)
        raise
    finally:
        with suppress(ReferenceError):  # Blender removes a metaball that is not kept
            source.hide_select = locked
        for obj in others:
            obj.select_set(True)


def _has_faces(obj: bpy.types.Object, context: bpy.types.Context) -> bool:
    """Return whether an object has faces after its modifiers."""
    evaluated = obj.evaluated_get(context.evaluated_depsgraph_get())
    try:
        mesh = evaluated.to_mesh()
        return mesh is not None and len(mesh.polygons) > 0
    finally:
        evaluated.to_mesh_clear()


CLASSES = (ToMesh,)
