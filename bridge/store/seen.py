"""Which surface a stage works on: what is seen of an object, whether it is hidden or not, without what FlexMaps shows itself.

Where what is seen has the mesh's own faces (shape keys, armatures, lattices and the like), stages work on the points that are
seen. Where it has others (Subdivision, Mirror, Boolean), ``objects.changed_by_modifiers`` says so, and no stage begins.
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

_STEPS = 12  # of Newton's method; armatures need one, lattices and curves three
_SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625)  # of a step; shorter ones where modifiers follow the box of all points
_CLOSE = 1e-6  # of the object's size: Blender stores single precision
_SLOPE = 1e-3  # of the object's size: difference quotients lose least between rounding and curvature there
_SINGULAR = 1e-3  # ways along which modifiers move points by a smaller share than along others are left


def deforming(obj: bpy.types.Object) -> bool:
    """Return whether modifiers, or a parent that bends it, move the object's points."""
    bent = obj.parent is not None and obj.parent_type in {"ARMATURE", "LATTICE"}
    return bent or any(modifier.show_viewport and modifier.type in DEFORMING for modifier in obj.modifiers)


def keyed(obj: bpy.types.Object) -> bool:
    """Return whether shape keys of the user's may move the object's points."""
    return keys.foreign_keys(obj.data)


def points(obj: bpy.types.Object, scene: bpy.types.Scene) -> Float[np.ndarray, "vertices 3"] | None:
    """The points that are seen, in the object's own frame; None where they are the mesh's own.

    Raises ``FlexMapsError`` where the seen points cannot be told.
    """
    bent = deforming(obj)
    if not bent and not keyed(obj):
        return None
    if obj.data.is_editmode:
        raise FlexMapsError("Leave Edit Mode first (Tab): shape keys or modifiers move what is seen there")
    if not bent and obj.data.shape_keys.use_relative:
        return _mixed(obj)
    with keys.shown_at(obj, 0.0), evaluated(obj, scene) as there:
        mesh = there.to_mesh()
        try:
            if len(mesh.vertices) != len(obj.data.vertices):
                raise FlexMapsError(f"Modifiers give '{obj.name}' other faces than its mesh; apply them first")
            return _positions(mesh.vertices, len(mesh.vertices))
        finally:
            there.to_mesh_clear()


def _mixed(obj: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """Relative shape keys mixed as Blender does, without ours."""
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
    """Return the points in the mesh's own frame that modifiers bend to the wanted ones, by Newton's method at every vertex.

    Points that no modifier can bring there, as behind a Shrinkwrap, stay where the last step took them.

    Parameters
    ----------
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
    found = np.empty(3 * count, np.float32)
    items.foreach_get("co", found)
    return found.reshape(-1, 3)


def _weights(obj: bpy.types.Object, group: int) -> Float[np.ndarray, " vertices"]:
    found = np.zeros(len(obj.data.vertices), np.float32)
    for vertex in obj.data.vertices:
        for member in vertex.groups:
            if member.group == group:
                found[vertex.index] = member.weight
    return found


def shown(obj: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """The points as the view shows them, our shapes included, in the object's own frame."""
    mesh = obj.data
    if mesh.is_editmode or not (deforming(obj) or keyed(obj)):
        return keys.shown_positions(mesh)
    if not deforming(obj) and mesh.shape_keys.use_relative:
        own = keys.shown_positions(mesh) - _positions(mesh.vertices, len(mesh.vertices))
        return _mixed(obj) + own
    there = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    if len(there.vertices) != len(mesh.vertices):
        return keys.shown_positions(mesh)
    return _positions(there.vertices, len(mesh.vertices))


def state(obj: bpy.types.Object) -> bytes:
    """What decides the seen points beside the mesh's own; empty where nothing does. Quick enough for a redraw."""
    data = b""
    if keyed(obj) and not obj.data.is_editmode and obj.data.shape_keys.use_relative:
        data += _mixed(obj).tobytes()
    if deforming(obj):
        for modifier in obj.modifiers:
            if modifier.show_viewport and modifier.type in DEFORMING:
                data += _described(modifier).encode()
        data += b"" if obj.parent is None else _placed(obj.parent)
    return data


def _described(modifier: bpy.types.Modifier) -> str:
    """The values of a modifier's properties, and where the objects are that it follows."""
    told = [modifier.type]
    for prop in modifier.bl_rna.properties:
        value: Any = getattr(modifier, prop.identifier, None)
        if prop.type in {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"} and not prop.identifier.startswith("show_"):
            told.append(str(list(value) if getattr(prop, "is_array", False) else value))
        elif isinstance(value, bpy.types.Object):
            told.append(_placed(value).hex())
    return " ".join(told)


def _placed(obj: bpy.types.Object) -> bytes:
    """Where an object stands, and how its bones or its lattice's points do."""
    data = np.round(np.array(obj.matrix_world), 6).tobytes()
    if obj.pose is not None:
        data += b"".join(np.round(np.array(bone.matrix), 6).tobytes() for bone in obj.pose.bones)
    if obj.type == "LATTICE":
        data += b"".join(np.round(np.array(point.co_deform), 6).tobytes() for point in obj.data.points)
    return data


def is_evaluated(obj: bpy.types.Object) -> bool:
    """Return whether Blender keeps the object up to date: hidden ones it leaves as they were."""
    layer = bpy.context.view_layer
    return layer is not None and layer.objects.get(obj.name) == obj and obj.visible_get(view_layer=layer)


@contextmanager
def evaluated(obj: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """The object as it is seen, or would be if it were not hidden."""
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
    """From the object's frame to the world's, of hidden objects too."""
    if is_evaluated(obj) or obj.is_evaluated:
        return np.array(obj.matrix_world, dtype=float)
    with evaluated(obj, scene) as there:
        return np.array(there.matrix_world, dtype=float)
