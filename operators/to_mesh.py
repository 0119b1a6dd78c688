"""Convert the active object to a mesh without modifiers, which stages need because they store layouts in the mesh."""

from __future__ import annotations

import bpy

from ..bridge.store import modifiers, objects
from ..engine.errors import FlexMapsError
from .stage import AddObjectOperator, ImmediateOperator


class ToMesh(ImmediateOperator, AddObjectOperator, bpy.types.Operator):
    """Turn a text, curve, surface or metaball into a mesh, or apply the modifiers of a mesh to a copy and hide the original. Solidify is left out: panels have the thickness of the sheet"""

    bl_idname = "flexmaps.to_mesh"
    bl_label = "Apply modifiers"

    keep: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Keep original", description="Hide the original instead of removing it", options={"SKIP_SAVE"}
    )

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        obj = context.object
        if obj is None or (obj.type != "MESH" and obj.type not in objects.CONVERTIBLE):
            return "Select a mesh, text, curve, surface or metaball"
        return super().problem(context)

    def run(self, context: bpy.types.Context) -> str:
        source = context.object
        if source.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        without = modifiers.describe_ignored(source)
        with modifiers.surface_only(source):
            if not _has_faces(source, context):
                raise FlexMapsError(
                    f"'{source.name}' has no faces: give a curve a bevel or extrude it (Object Data, Geometry), or add faces to a mesh"
                )
            bpy.ops.object.convert(target="MESH", keep_original=self.keep)
        if self.keep:  # otherwise Blender may have removed the source, as it does with metaballs
            source.hide_set(True)
        modifiers.write_note(context.object.data, without)
        return without


def _has_faces(obj: bpy.types.Object, context: bpy.types.Context) -> bool:
    """Return whether an object has faces after its modifiers."""
    evaluated = obj.evaluated_get(context.evaluated_depsgraph_get())
    try:
        mesh = evaluated.to_mesh()
        return mesh is not None and len(mesh.polygons) > 0
    finally:
        evaluated.to_mesh_clear()


CLASSES = (ToMesh,)
