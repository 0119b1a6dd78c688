"""Vertex positions that a stage works on: the mesh with the user's own shape keys, but without FlexMaps' shape keys.

They are also computed for hidden objects. If modifiers or a parent change the mesh, ``objects.modifier_problem``
reports it, and no stage starts.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.errors import FlexMapsError
from . import shape_keys
from .columns import column, read_weights

# distance from the world's origin, metres, beyond which coordinates are relative to the object's own origin; there
# float32 has steps of 8 mm. Larger loses digits in the search for an equilibrium; smaller drops the position sooner
FAR = 1e5


def read_with_user_keys(obj: bpy.types.Object, scene: bpy.types.Scene) -> Float[np.ndarray, "vertices 3"] | None:
    """Return the vertices moved by the user's shape keys, in the object's frame; None if the user has no shape keys.

    Raises
    ------
    FlexMapsError in edit mode.
    """
    if not shape_keys.has_user_keys(obj.data):
        return None
    if obj.data.is_editmode:
        raise FlexMapsError("Leave Edit Mode first (Tab): shape keys move what is seen there")
    if obj.data.shape_keys.use_relative:
        return _mix_keys(obj)
    with shape_keys.blend_shown(obj, 0.0), evaluated_object(obj, scene) as there:
        mesh = there.to_mesh()
        try:
            return column(mesh.vertices, "co")
        finally:
            there.to_mesh_clear()


def _mix_keys(obj: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """Blend relative shape keys by value and vertex group as Blender does, without FlexMaps' own keys."""
    blocks = obj.data.shape_keys.key_blocks
    ours = {key.name for key in shape_keys.simulated_keys(obj.data)}
    pinned = obj.active_shape_key
    if obj.show_only_shape_key and pinned is not None and pinned.name not in ours:
        return column(pinned.data, "co")
    mixed = column(obj.data.shape_keys.reference_key.data, "co")
    for key in blocks:
        if key.mute or not key.value or key.name in ours or key == obj.data.shape_keys.reference_key:
            continue
        step = key.value * (column(key.data, "co") - column(key.relative_key.data, "co"))
        group = obj.vertex_groups.get(key.vertex_group) if key.vertex_group else None
        mixed += step if group is None else step * read_weights(obj.data, group.index)[:, None]
    return mixed


def read_target(obj: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """Return the vertices moved by the user's shape keys, in the object's frame; fast enough for every redraw.

    In edit mode, edits since entering it are missing. Absolute shape keys count only if the object is visible.
    """
    mesh = obj.data
    if not shape_keys.has_user_keys(mesh):
        return column(mesh.vertices, "co")
    if mesh.shape_keys.use_relative:
        return _mix_keys(obj)
    there = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return column((there if len(there.vertices) == len(mesh.vertices) else mesh).vertices, "co")


def read_displayed(obj: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """Return the vertices as the 3D view shows them, moved by all shape keys, in the object's frame."""
    mesh = obj.data
    if mesh.is_editmode or not shape_keys.has_user_keys(obj.data):
        return shape_keys.simulated_positions(mesh)
    if mesh.shape_keys.use_relative:
        own = shape_keys.simulated_positions(mesh) - column(mesh.vertices, "co")
        return _mix_keys(obj) + own
    there = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return column(there.vertices, "co")


def user_keys_as_bytes(obj: bpy.types.Object) -> bytes:
    """Return the vertices moved by the user's relative shape keys as bytes, for a checksum; b"" where none apply."""
    if not shape_keys.has_user_keys(obj.data) or obj.data.is_editmode or not obj.data.shape_keys.use_relative:
        return b""
    return _mix_keys(obj).tobytes()


def is_evaluated(obj: bpy.types.Object) -> bool:
    """Return whether Blender keeps the object's evaluated copy up to date: only where the object is visible."""
    layer = bpy.context.view_layer
    return layer is not None and layer.objects.get(obj.name) == obj and obj.visible_get(view_layer=layer)


@contextmanager
def evaluated_object(obj: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """Context manager: yield the evaluated object; a hidden object is evaluated in a temporary scene."""
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


def world_matrix(obj: bpy.types.Object, scene: bpy.types.Scene) -> Float[np.ndarray, "4 4"]:
    """Return the object's up-to-date world matrix, also for a hidden object."""
    if is_evaluated(obj) or obj.is_evaluated:
        return np.array(obj.matrix_world, dtype=float)
    with evaluated_object(obj, scene) as there:
        return np.array(there.matrix_world, dtype=float)


def to_metres(obj: bpy.types.Object, scene: bpy.types.Scene) -> Float[np.ndarray, "4 4"]:
    """Return the matrix from the object's frame to metres in world axes; without translation beyond ``FAR``.

    Parameters
    ----------
    obj, scene : the object, and the scene with its units
    """
    matrix = world_matrix(obj, scene)
    matrix[:3] *= scene.unit_settings.scale_length
    if np.abs(matrix[:3, 3]).max() > FAR:
        matrix[:3, 3] = 0.0
    return matrix
