"""The collection with the objects beside a model; stages rebuild it and never read it back.

Coordinates are the engine's, in metres; the objects are scaled to the scene's unit.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.arrays import Float


def collection_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Collection:
    """Return the object's collection, created if missing and renamed after the object."""
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
    """Return the object's collection, or None; a duplicate of an object must not use the original's."""
    own = obj.get("flexmaps_collection")
    if not isinstance(own, bpy.types.Collection):
        return None
    name = own.get("flexmaps_owner")
    owner = bpy.data.objects.get(name) if isinstance(name, str) else None
    if owner is not None and owner != obj and owner.get("flexmaps_collection") == own:
        return None
    return own


def left_over(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Return the collections in the scene whose model was deleted. Quick enough for a panel."""
    owned = {own.session_uid for own in map(_pointed_at, bpy.data.objects) if own is not None}
    return [
        one for one in scene.collection.children_recursive if "flexmaps_owner" in one and one.session_uid not in owned
    ]


def _pointed_at(obj: bpy.types.Object) -> bpy.types.Collection | None:
    own = obj.get("flexmaps_collection")
    return own if isinstance(own, bpy.types.Collection) else None


def remove(own: bpy.types.Collection) -> None:
    """Delete a collection, all objects in it, and their data if nothing else uses it."""
    data = [other.data for other in own.all_objects if other.data is not None]
    for other in list(own.all_objects):
        bpy.data.objects.remove(other)
    bpy.data.collections.remove(own)
    bpy.data.batch_remove([one for one in dict.fromkeys(data) if one.users == 0])


def of_kinds(obj: bpy.types.Object, *kinds: str) -> list[bpy.types.Object]:
    """Return the objects of the given kinds in the object's collection.

    Parameters
    ----------
    obj : the model
    kinds : values of ``flexmaps_kind``
    """
    own = existing(obj)
    return [] if own is None else [o for o in own.objects if o.get("flexmaps_kind") in kinds]


def clear(obj: bpy.types.Object, kinds: tuple[str, ...] = ("panels", "backs", "seams", "outlines")) -> None:
    """Remove objects of the given kinds from the object's collection.

    Parameters
    ----------
    obj : the model
    kinds : values of ``flexmaps_kind``
    """
    for other in of_kinds(obj, *kinds):
        data = other.data
        bpy.data.objects.remove(other)
        if data is not None and data.users == 0:
            (bpy.data.meshes if isinstance(data, bpy.types.Mesh) else bpy.data.curves).remove(data)


def origin(obj: bpy.types.Object, scene: bpy.types.Scene, gap: float) -> Float[np.ndarray, " 3"]:
    """Return in metres the upper left corner for the flat layout: right of the model, at its lowest height.

    Parameters
    ----------
    obj, scene : the model and its scene
    gap : distance from the model, metres
    """
    box = box_of(obj) * scene.unit_settings.scale_length
    low, high = box.min(axis=0), box.max(axis=0)
    return np.array([high[0] + gap, high[1], low[2]])


def box_of(obj: bpy.types.Object) -> Float[np.ndarray, "8 3"]:
    """Return the corners of the object's box in the world, in the scene's unit."""
    from mathutils import Vector

    return np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])


def add(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    kind: str,
    name: str,
    data: bpy.types.ID,
    place: Float[np.ndarray, " 3"],
) -> bpy.types.Object:
    """Add an object with data in metres to the model's collection.

    Parameters
    ----------
    obj, scene : the model and its scene
    kind : value of ``flexmaps_kind``
    name : name after the model's
    data : mesh or curve, metres
    place : position, metres
    """
    unit = scene.unit_settings.scale_length
    made = bpy.data.objects.new(f"{obj.name} {name}", data)
    made["flexmaps_kind"] = kind
    made.location = place / unit
    made.scale = (1.0 / unit,) * 3
    collection_of(obj, scene).objects.link(made)
    return made
