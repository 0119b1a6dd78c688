"""The collection that belongs to a model: what stands beside it, made anew by every stage that changes it, never read back.

Engine coordinates, metres; the objects are scaled to the scene's unit.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.arrays import Float


def collection_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Collection:
    """The collection that belongs to the object, made where it is missing; it follows the object's name."""
    own = existing(obj)
    if own is None:
        own = bpy.data.collections.new(f"FlexMaps {obj.name}")
    if own not in scene.collection.children_recursive:  # new, or appended with the object
        scene.collection.children.link(own)
    if own.name != f"FlexMaps {obj.name}":
        own.name = f"FlexMaps {obj.name}"
    own["flexmaps_owner"] = obj.name
    obj["flexmaps_collection"] = own
    return own


def existing(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """The object's collection, if it has one of its own: a duplicate of an object must not take the original's."""
    own = obj.get("flexmaps_collection")
    if not isinstance(own, bpy.types.Collection):
        return None
    name = own.get("flexmaps_owner")
    owner = bpy.data.objects.get(name) if isinstance(name, str) else None
    if owner is not None and owner != obj and owner.get("flexmaps_collection") == own:
        return None
    return own


def left_over(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Collections in the scene whose model was deleted: nothing of them is of use to any other object. Cheap enough for a panel."""
    owned = {own.session_uid for own in map(_pointed_at, bpy.data.objects) if own is not None}
    return [
        one for one in scene.collection.children_recursive if "flexmaps_owner" in one and one.session_uid not in owned
    ]


def _pointed_at(obj: bpy.types.Object) -> bpy.types.Collection | None:
    own = obj.get("flexmaps_collection")
    return own if isinstance(own, bpy.types.Collection) else None


def remove(own: bpy.types.Collection) -> None:
    """A collection with all that stands in it, and what nothing else uses of that."""
    data = [other.data for other in own.all_objects if other.data is not None]
    for other in list(own.all_objects):
        bpy.data.objects.remove(other)
    bpy.data.collections.remove(own)
    bpy.data.batch_remove([one for one in dict.fromkeys(data) if one.users == 0])


def clear(obj: bpy.types.Object, kinds: tuple[str, ...] = ("panels", "backs", "seams", "outlines")) -> None:
    """Remove what was laid out beside the object, by kind."""
    own = existing(obj)
    if own is None:
        return
    for other in list(own.objects):
        if other.get("flexmaps_kind") in kinds:
            data = other.data
            bpy.data.objects.remove(other)
            if data is not None and data.users == 0:
                (bpy.data.meshes if isinstance(data, bpy.types.Mesh) else bpy.data.curves).remove(data)


def origin(obj: bpy.types.Object, scene: bpy.types.Scene, gap: float) -> Float[np.ndarray, " 3"]:
    """Metres: where the upper left corner of what is laid out goes: right of the model, at its lowest height."""
    box = np.array([obj.matrix_world @ v for v in map(vector, obj.bound_box)]) * scene.unit_settings.scale_length
    low, high = box.min(axis=0), box.max(axis=0)
    return np.array([high[0] + gap, high[1], low[2]])


def vector(corner: object) -> object:
    """As Blender's own, which its matrices ask for."""
    from mathutils import Vector

    return Vector(corner)


def add(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    kind: str,
    name: str,
    data: bpy.types.ID,
    place: Float[np.ndarray, " 3"],
) -> bpy.types.Object:
    """Put data that is in metres into the object's collection, at a place in metres."""
    unit = scene.unit_settings.scale_length
    made = bpy.data.objects.new(f"{obj.name} {name}", data)
    made["flexmaps_kind"] = kind
    made.location = place / unit
    made.scale = (1.0 / unit,) * 3
    collection_of(obj, scene).objects.link(made)
    return made
