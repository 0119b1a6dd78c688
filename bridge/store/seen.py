"""The surface that a stage works on: an object as the user sees it, hidden or not, without the shapes that FlexMaps shows.

If the seen surface has the mesh's own faces (shape keys, armatures, lattices and the like), stages work on the seen points.
If it has other faces (Subdivision, Mirror, Boolean), ``objects.changed_by_modifiers`` reports it, and no stage starts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.errors import FlexMapsError
from . import keys
from .objects import DEFORMING

_STEPS = 12  # Newton steps at most; armatures need one, lattices and curves three
_SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625)  # step lengths tried; short ones help where modifiers follow the bounding box
_CLOSE = 1e-6  # tolerance in the object's size: Blender stores single precision
_SLOPE = 1e-3  # step of difference quotients in the object's size: balances rounding and curvature
_SINGULAR = 1e-3  # relative cut-off of the pseudo-inverse: ignores directions in which modifiers hardly move points


def deforming(obj: bpy.types.Object) -> bool:
    """Return whether modifiers, or an armature or lattice as parent, move the object's points."""
    bent = obj.parent is not None and obj.parent_type in {"ARMATURE", "LATTICE"}
    return bent or any(modifier.show_viewport and modifier.type in DEFORMING for modifier in obj.modifiers)


def keyed(obj: bpy.types.Object) -> bool:
    """Return whether the user's shape keys may move the object's points."""
    return keys.foreign_keys(obj.data)


def points(obj: bpy.types.Object, scene: bpy.types.Scene) -> Float[np.ndarray, "vertices 3"] | None:
    """Return the seen points in the object's own frame; None where they are the mesh's own.

    Raises
    ------
    FlexMapsError in edit mode, or where modifiers make other faces.
    """
    bent = deforming(obj)
    if not bent and not keyed(obj):
        return None
    if obj.data.is_editmode:
        raise FlexMapsError("Leave Edit Mode first (Tab): shape keys or modifiers move what is seen there")
    if not bent and obj.data.shape_keys.use_relative:
        return _mix_keys(obj)
    with keys.shown_at(obj, 0.0), evaluated(obj, scene) as there:
        mesh = there.to_mesh()
        try:
            if len(mesh.vertices) != len(obj.data.vertices):
                raise FlexMapsError(f"Modifiers give '{obj.name}' other faces than its mesh; apply them first")
            return _positions(mesh.vertices, len(mesh.vertices))
        finally:
            there.to_mesh_clear()


def _mix_keys(obj: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """Mix relative shape keys as Blender does, without FlexMaps' own keys."""
    blocks, count = obj.data.shape_keys.key_blocks, len(obj.data.vertices)
    ours = {key.name for key in keys.keys_of(obj.data)}
    pinned = obj.active_shape_key
    if obj.show_only_shape_key and pinned is not None and pinned.name not in ours:
        return _positions(pinned.data, count)
    mixed = _positions(obj.data.shape_keys.reference_key.data, count)
    for key in blocks:
        if key.mute or not key.value or key.name in ours or key == obj.data.shape_keys.reference_key:
            continue
        step = key.value * (_positions(key.data, count) - _positions(key.relative_key.data, count))
        group = obj.vertex_groups.get(key.vertex_group) if key.vertex_group else None
        mixed += step if group is None else step * _weights(obj, group.index)[:, None]
    return mixed


def points_before_bending(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    put: Callable[[Float[np.ndarray, "vertices 3"]], None],
    start: Float[np.ndarray, "vertices 3"],
    wanted: Float[np.ndarray, "vertices 3"],
) -> Float[np.ndarray, "vertices 3"]:
    """Return the points of the mesh that modifiers move to the wanted places, by Newton's method at every vertex.

    Points that no modifier can move there, such as behind a Shrinkwrap, stay where the last step took them.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    put : stores points in the mesh, or in the shape key that is shown
    start, wanted : in the object's own frame
    """
    points, size = start.astype(float), float(np.ptp(start, axis=0).max())
    missing = wanted - _seen_with(obj, scene, put, points)
    for _ in range(_STEPS):
        if np.abs(missing).max() <= _CLOSE * size:
            break
        slope = np.empty((len(points), 3, 3))
        for axis in range(3):
            offset = _SLOPE * size * np.eye(3)[axis]
            ahead, behind = (_seen_with(obj, scene, put, points + way * offset) for way in (1.0, -1.0))
            slope[:, :, axis] = (ahead - behind) / (2.0 * _SLOPE * size)
        step = np.einsum("nij,nj->ni", np.linalg.pinv(slope, rcond=_SINGULAR), missing)
        for share in _SHARES:
            trial = points + share * step
            left = wanted - _seen_with(obj, scene, put, trial)
            if np.linalg.norm(left) < np.linalg.norm(missing):
                points, missing = trial, left
                break
        else:
            break
    return points


def _seen_with(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    put: Callable[[Float[np.ndarray, "vertices 3"]], None],
    points: Float[np.ndarray, "vertices 3"],
) -> Float[np.ndarray, "vertices 3"]:
    put(points)
    obj.data.update()
    with evaluated(obj, scene) as there:
        mesh = there.to_mesh()
        try:
            return _positions(mesh.vertices, len(points)).astype(float)
        finally:
            there.to_mesh_clear()


def _positions(items: bpy.types.bpy_prop_collection, count: int) -> Float[np.ndarray, "vertices 3"]:
    coordinates = np.empty(3 * count, np.float32)
    items.foreach_get("co", coordinates)
    return coordinates.reshape(-1, 3)


def _weights(obj: bpy.types.Object, group: int) -> Float[np.ndarray, " vertices"]:
    weights = np.zeros(len(obj.data.vertices), np.float32)
    for vertex in obj.data.vertices:
        for member in vertex.groups:
            if member.group == group:
                weights[vertex.index] = member.weight
    return weights


def shown(obj: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """Return the points as the 3D view shows them, FlexMaps' shapes included, in the object's own frame."""
    mesh = obj.data
    if mesh.is_editmode or not (deforming(obj) or keyed(obj)):
        return keys.shown_positions(mesh)
    if not deforming(obj) and mesh.shape_keys.use_relative:
        own = keys.shown_positions(mesh) - _positions(mesh.vertices, len(mesh.vertices))
        return _mix_keys(obj) + own
    there = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    if len(there.vertices) != len(mesh.vertices):
        return keys.shown_positions(mesh)
    return _positions(there.vertices, len(mesh.vertices))


def state(obj: bpy.types.Object) -> bytes:
    """Return all that moves the seen points away from the mesh, as bytes; quick enough for a redraw."""
    data = b""
    if keyed(obj) and not obj.data.is_editmode and obj.data.shape_keys.use_relative:
        data += _mix_keys(obj).tobytes()
    if deforming(obj):
        for modifier in obj.modifiers:
            if modifier.show_viewport and modifier.type in DEFORMING:
                data += _describe(modifier).encode()
        data += b"" if obj.parent is None else _placement(obj.parent)
    return data


def _describe(modifier: bpy.types.Modifier) -> str:
    """Return the values of a modifier's properties as text, with the places of the objects that it follows."""
    texts = [modifier.type]
    for prop in modifier.bl_rna.properties:
        value: Any = getattr(modifier, prop.identifier, None)
        if prop.type in {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"} and not prop.identifier.startswith("show_"):
            texts.append(str(list(value) if getattr(prop, "is_array", False) else value))
        elif isinstance(value, bpy.types.Object):
            texts.append(_placement(value).hex())
    return " ".join(texts)


def _placement(obj: bpy.types.Object) -> bytes:
    """Return an object's matrix as bytes, with those of its bones or the points of its lattice."""
    data = np.round(np.array(obj.matrix_world), 6).tobytes()
    if obj.pose is not None:
        data += b"".join(np.round(np.array(bone.matrix), 6).tobytes() for bone in obj.pose.bones)
    if obj.type == "LATTICE":
        data += b"".join(np.round(np.array(point.co_deform), 6).tobytes() for point in obj.data.points)
    return data


def is_evaluated(obj: bpy.types.Object) -> bool:
    """Return whether Blender keeps the object's evaluated state up to date, which it does not for hidden objects."""
    layer = bpy.context.view_layer
    return layer is not None and layer.objects.get(obj.name) == obj and obj.visible_get(view_layer=layer)


@contextmanager
def evaluated(obj: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """Yield the evaluated object, also where it is hidden."""
    if is_evaluated(obj):
        graph = bpy.context.evaluated_depsgraph_get()
        graph.update()
        yield obj.evaluated_get(graph)
        return
    place, hidden = bpy.data.scenes.new(".FlexMaps"), obj.hide_viewport
    try:
        place.frame_current = scene.frame_current
        place.collection.objects.link(obj)
        obj.hide_viewport = False
        layer = place.view_layers[0]
        layer.update()
        yield obj.evaluated_get(layer.depsgraph)
    finally:
        obj.hide_viewport = hidden
        bpy.data.scenes.remove(place)


def world(obj: bpy.types.Object, scene: bpy.types.Scene) -> Float[np.ndarray, "4 4"]:
    """Return the matrix from the object's frame to the world's, also of hidden objects."""
    if is_evaluated(obj) or obj.is_evaluated:
        return np.array(obj.matrix_world, dtype=float)
    with evaluated(obj, scene) as there:
        return np.array(there.matrix_world, dtype=float)
