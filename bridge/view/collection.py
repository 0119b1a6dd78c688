"""The collection that holds the objects beside a model, such as its flat panels.

Stages rebuild these objects and never read them. Their data is in metres; the objects are scaled to the scene's unit.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.arrays import Float


def collection_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Collection:
    """Return the model's collection; create it if missing, and rename it if the model was renamed."""
    own = find(obj)
    if own is None:
        own = bpy.data.collections.new(f"FlexMaps {obj.name}")
    if own not in scene.collection.children_recursive:  # new, or appended from another file
        scene.collection.children.link(own)
    if own.name != f"FlexMaps {obj.name}":
        own.name = f"FlexMaps {obj.name}"
    own["flexmaps_owner"] = obj.name
    obj["flexmaps_collection"] = own
    return own


def find(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """Return the model's collection, or None; a duplicate of a model does not get the original's collection."""
    own = obj.get("flexmaps_collection")
    if not isinstance(own, bpy.types.Collection):
        return None
    name = own.get("flexmaps_owner")
    owner = bpy.data.objects.get(name) if isinstance(name, str) else None
    if owner is not None and owner != obj and owner.get("flexmaps_collection") == own:
        return None
    return own


def find_orphans(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Return the collections in the scene whose model was deleted; quick enough for every redraw of the sidebar."""
    owned = {own.session_uid for own in map(_stored_collection, bpy.data.objects) if own is not None}
    return [
        one for one in scene.collection.children_recursive if "flexmaps_owner" in one and one.session_uid not in owned
    ]


def _stored_collection(obj: bpy.types.Object) -> bpy.types.Collection | None:
    own = obj.get("flexmaps_collection")
    return own if isinstance(own, bpy.types.Collection) else None


def remove(own: bpy.types.Collection) -> None:
    """Delete a collection with all its objects, and the data that only these objects use."""
    data = [other.data for other in own.all_objects if other.data is not None]
    for other in list(own.all_objects):
        bpy.data.objects.remove(other)
    bpy.data.collections.remove(own)
    bpy.data.batch_remove([one for one in dict.fromkeys(data) if one.users == 0])


def objects_of_kinds(obj: bpy.types.Object, *kinds: str) -> list[bpy.types.Object]:
    """Return objects in the model's collection by kind.

    Parameters
    ----------
    obj : the model
    kinds : values of the custom property ``flexmaps_kind`` to look for
    """
    own = find(obj)
    return [] if own is None else [o for o in own.objects if o.get("flexmaps_kind") in kinds]


def clear(obj: bpy.types.Object, kinds: tuple[str, ...] = ("panels", "backs", "seams", "outlines")) -> None:
    """Delete objects in the model's collection by kind.

    Parameters
    ----------
    obj : the model
    kinds : values of the custom property ``flexmaps_kind`` to delete
    """
    for other in objects_of_kinds(obj, *kinds):
        data = other.data
        bpy.data.objects.remove(other)
        if data is not None and data.users == 0:
            (bpy.data.meshes if isinstance(data, bpy.types.Mesh) else bpy.data.curves).remove(data)


def layout_corner(obj: bpy.types.Object, scene: bpy.types.Scene, gap: float) -> Float[np.ndarray, " 3"]:
    """Return the upper left corner of the flat layout in metres: right of the model, at its lowest height.

    Parameters
    ----------
    obj, scene : the model and its scene
    gap : distance from the model, metres
    """
    box = bounding_corners(obj) * scene.unit_settings.scale_length
    low, high = box.min(axis=0), box.max(axis=0)
    return np.array([high[0] + gap, high[1], low[2]])


def bounding_corners(obj: bpy.types.Object) -> Float[np.ndarray, "8 3"]:
    """Return the corners of the object's bounding box in world axes, in the scene's unit."""
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
    """Add an object to the model's collection.

    Parameters
    ----------
    obj, scene : the model and its scene
    kind : value of its custom property ``flexmaps_kind``
    name : second part of its name; the first is the model's name
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
