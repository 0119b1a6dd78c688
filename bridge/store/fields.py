"""Read vertex groups, colours and attributes made with Blender's own tools, as one number per quad."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine.arrays import Float, Int
from ...engine.errors import FlexMapsError
from . import attributes
from .columns import read_weights

if TYPE_CHECKING:
    from .surface import ObjectSurface

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # weights of linear red, green and blue (ITU-R BT.709)
PROTECT = attributes.PREFIX + "protect"


def list_fields(obj: bpy.types.Object) -> list[str]:
    """Return the names that ``read_field`` accepts: vertex groups, then the user's other attributes."""
    groups = [group.name for group in obj.vertex_groups]
    usable = [
        a.name
        for a in obj.data.attributes
        if a.data_type in _KINDS and a.domain in _DOMAINS and not _is_internal(a.name)
    ]
    return [*groups, *(name for name in usable if name not in groups)]


def read_field(obj: bpy.types.Object, surface: ObjectSurface, name: str) -> Float[np.ndarray, " quads"]:
    """Return a vertex group's weights, a colour's brightness or numbers as means over the quads, clipped to [0, 1].

    Parameters
    ----------
    obj : the mesh object
    surface : its surface
    name : name of the vertex group, colour attribute or attribute

    Raises
    ------
    FlexMapsError where the object has nothing of that name, or its values are not finite numbers.
    """
    with attributes.readable_mesh(obj) as data:
        group = obj.vertex_groups.get(name)
        if group is not None:
            return _over_quads(surface, read_weights(data, group.index), "POINT")
        attribute = data.attributes.get(name)
        if attribute is None:
            raise FlexMapsError(f"'{obj.name}' has no vertex group, colour or attribute '{name}'")
        if attribute.data_type not in _KINDS or attribute.domain not in _DOMAINS:
            raise FlexMapsError(f"'{name}' of '{obj.name}' has no numbers or colours of vertices, faces or corners")
        prop, width = _KINDS[attribute.data_type]
        kind = bool if attribute.data_type == "BOOLEAN" else np.int32 if attribute.data_type == "INT" else np.float32
        values: np.ndarray = np.empty(width * len(attribute.data), kind)
        attribute.data.foreach_get(prop, values)
        rows = values.reshape(-1, width).astype(float)
        means = _over_quads(surface, rows[:, :3] @ LUMINANCE if width > 1 else rows[:, 0], attribute.domain)
    if not np.isfinite(means).all():
        raise FlexMapsError(
            f"'{name}' of '{obj.name}' has a value that is not a number; correct it, or choose another attribute"
        )
    return means


def write_protected(obj: bpy.types.Object, quads: Int[np.ndarray, " protected"] | None) -> None:
    """Mark exactly these spirals as protected from Optimise; None or an empty array removes the marks.

    Parameters
    ----------
    obj : the mesh object
    quads : indices of the protected quads, or None
    """
    if quads is None or not len(quads):
        attributes.remove(obj, PROTECT)
        return
    marks = np.zeros(len(obj.data.polygons), np.int32)
    marks[quads] = 1
    attributes.write(obj, PROTECT, *attributes.SPECS["protect"][:2], marks)


def count_protected(obj: bpy.types.Object) -> int:
    """Return the number of protected spirals; 0 in edit mode. Fast enough for every redraw."""
    marks = None if obj.data.is_editmode else attributes.read(obj.data, PROTECT)
    return 0 if marks is None else int(marks.sum())


def write_stiffness(obj: bpy.types.Object, values: Float[np.ndarray, " quads"]) -> None:
    """Store the stiffness of every spiral; any change of the design removes it.

    Parameters
    ----------
    obj : the mesh object
    values : (F,), N mm/rad
    """
    attributes.write(obj, attributes.PREFIX + "stiffness", *attributes.SPECS["stiffness"][:2], values)


def _over_quads(surface: ObjectSurface, values: np.ndarray, domain: str) -> Float[np.ndarray, " quads"]:
    """Average values of vertices, faces or corners (in Blender's order) over each face, and clip to [0, 1]."""
    sizes = surface.polygons.sizes
    if domain != "FACE":
        at = surface.loops if domain == "CORNER" else surface.polygons.corners
        values = np.bincount(surface.polygons.face_of, weights=values[at], minlength=len(sizes)) / sizes
    return np.clip(values, 0.0, 1.0)


def _is_internal(name: str) -> bool:
    return name.startswith((attributes.PREFIX, ".")) or name in {"sharp_face", "sharp_edge", "material_index"}


# attribute types that can be read -> property of their data, numbers per element
_KINDS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "BOOLEAN": ("value", 1),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
}
_DOMAINS = {"POINT", "FACE", "CORNER"}
