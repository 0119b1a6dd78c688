"""Queries about Blender objects that FlexMaps works on; fast enough for every redraw, without heavy imports."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.errors import FlexMapsError
from . import modifiers
from .i18n import translate

SAMPLE_SIZE = (
    64  # edges sampled to estimate the quad size; more is more exact (a factor of 2 suffices) and slows redraws
)
# Blender's id of a mesh -> its numbers of vertices, edges and corners, and whether it has loose vertices
_LOOSE_CACHE: dict[int, tuple[tuple[int, ...], bool]] = {}
CONVERTIBLE = {"CURVE", "SURFACE", "FONT", "META"}  # object types that Blender can convert to meshes


def usage_problem(obj: bpy.types.Object | None) -> str | None:
    """Return why FlexMaps cannot work on this object, as a sentence; None if it can."""
    if obj is None:
        return "Select a mesh object"
    if obj.type != "MESH":
        return translate("'{}' is not a mesh; select one, or convert it to a mesh", obj.name)
    if is_linked(obj):
        return translate("'{}' is linked from another file; make it local first", obj.name)
    if obj.mode not in {"OBJECT", "EDIT"}:
        return "Go to Object Mode or Edit Mode"
    return None


def is_linked(obj: bpy.types.Object) -> bool:
    """Return whether the object or its mesh is linked from another .blend file."""
    return obj.library is not None or (obj.data is not None and obj.data.library is not None)


def modifier_problem(obj: bpy.types.Object) -> str | None:
    """Return which modifier or parent changes the mesh, as a sentence; None if nothing does."""
    for modifier in modifiers.list_changing(obj):
        return translate("Apply or remove the modifier '{}' first: the layout lives in the mesh itself", modifier.name)
    if obj.parent is not None and obj.parent_type in {"ARMATURE", "LATTICE"}:
        return translate(
            "'{}' bends the mesh as its parent: clear the parent first, or make it a modifier", obj.parent.name
        )
    return None


def other_users(obj: bpy.types.Object) -> str:
    """Return the names of the other objects that use the same mesh, as a short text; "" where there are none."""
    if obj.data.users < 2:
        return ""
    others = [f"'{o.name}'" for o in bpy.data.objects if o.data == obj.data and o != obj]
    return ", ".join(others[:2]) + (f" (+{len(others) - 2})" if len(others) > 2 else "")


def list_open_files() -> tuple[Path, ...]:
    """Return the open .blend file, if it was ever saved, and the files that it links."""
    linked = (bpy.path.abspath(library.filepath) for library in bpy.data.libraries)
    return tuple(Path(path) for path in (bpy.data.filepath, *linked) if path)


def find_by_uid(uid: int) -> bpy.types.Object:
    """Return the object with this ``session_uid``, even if renamed; raise ``FlexMapsError`` if it was deleted."""
    for obj in bpy.data.objects:
        if obj.session_uid == uid and obj.users:
            return obj
    raise FlexMapsError("The object was deleted meanwhile; nothing was changed")


def extents(obj: bpy.types.Object) -> tuple[float, ...]:
    """Return ``Object.dimensions`` (Blender units, object's own axes), but without vertices that belong to no face."""
    mesh = obj.data
    whole = tuple(obj.dimensions)
    if obj.type != "MESH" or not len(mesh.polygons) or modifiers.list_changing(obj) or not _has_loose(mesh):
        return whole
    from .columns import column

    points = column(mesh.vertices, "co")[column(mesh.loops, "vertex_index")]
    lengths = points.max(axis=0) - points.min(axis=0)
    return tuple(float(x * abs(s)) for x, s in zip(lengths, obj.matrix_world.to_scale(), strict=True))


def _has_loose(mesh: bpy.types.Mesh) -> bool:
    """Return whether vertices belong to no face; cached until the number of vertices, edges or corners changes."""
    parts = len(mesh.vertices), len(mesh.edges), len(mesh.loops)
    if _LOOSE_CACHE.get(mesh.session_uid, (None, False))[0] != parts:
        from .columns import column

        used = set(column(mesh.loops, "vertex_index").tolist())
        _LOOSE_CACHE[mesh.session_uid] = parts, len(used) < len(mesh.vertices)
    return _LOOSE_CACHE[mesh.session_uid][1]


def quad_edge(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Return the approximate median edge length in metres, from a sample of edges."""
    mesh, matrix = obj.data, obj.matrix_world.to_3x3()
    lengths = []
    for k in range(0, len(mesh.edges), max(1, len(mesh.edges) // SAMPLE_SIZE)):
        a, b = mesh.edges[k].vertices
        lengths.append((matrix @ (mesh.vertices[a].co - mesh.vertices[b].co)).length)
    lengths.sort()
    return lengths[len(lengths) // 2] * scene.unit_settings.scale_length if lengths else 0.0
