"""Properties of an object that are derived from several others: its size, how it is supported, its border arms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatVectorProperty

from ...engine.params import SpiralParams
from . import dimensions, vertex_positions
from .columns import column
from .i18n import CONTEXT

if TYPE_CHECKING:
    from collections.abc import Sequence

MILLIMETRES = 1e3  # millimetres in a metre
SUPPORT_KINDS = (
    ("FREE", "Free", "Nothing holds the piece"),
    ("STANDS", "Stands", "It stands on the quads that are held, at first the lowest"),
    ("HANGS", "Hangs", "It hangs by holes in the hubs of the quads that are held, at first the highest"),
)
BORDERS = SpiralParams.__dataclass_fields__["border"].metadata["choices"]
# height above the lowest vertex within which vertices are held by default, in edge lengths; larger holds more; by eye
HOLD_HEIGHT = 0.25


def _get_size(obj: bpy.types.Object) -> tuple[float, float, float]:
    """Return the size in millimetres along the object's own axes, without a simulated shape."""
    unit = MILLIMETRES * bpy.context.scene.unit_settings.scale_length
    return tuple(unit * length for length in dimensions.extents(obj))  # type: ignore[return-value]


def _set_size(obj: bpy.types.Object, size: Sequence[float]) -> None:
    """Scale the object uniformly to the entry of ``size`` that differs most, and set the wanted quad edge accordingly.

    Otherwise a later remesh would scale the object back.
    """
    factors = [new / old for new, old in zip(size, _get_size(obj), strict=True) if old > 0 and new > 0]
    factor = max(factors, key=lambda f: abs(f - 1.0), default=1.0)
    if factor == 1.0 or any(obj.lock_scale):
        return
    obj.scale = [s * factor for s in obj.scale]
    bpy.context.view_layer.update()
    edge = dimensions.estimate_quad_edge(obj, bpy.context.scene)
    if edge > 0:
        obj.flexmaps.remesh.edge = MILLIMETRES * edge


def has_border(mesh: bpy.types.Mesh) -> bool:
    """Return whether the mesh has an open border, judged by the counts of edges and corners, which is fast."""
    return 2 * len(mesh.edges) > len(mesh.loops)


def border_setting(obj: bpy.types.Object) -> str:
    """Return the setting for border arms. Its default is "left_out" for an open mesh that has no layout yet."""
    spiral, cut = obj.flexmaps.spiral, "flexmaps_flat" in obj.data.attributes
    return "left_out" if has_border(obj.data) and not cut and not spiral.is_property_set("border") else spiral.border


def store_border_setting(obj: bpy.types.Object) -> None:
    """Store the setting for border arms in all objects that share the mesh, because they share its panels."""
    if not has_border(obj.data):
        return
    for other in bpy.data.objects:
        if other.data == obj.data and not other.flexmaps.spiral.is_property_set("border"):
            other.flexmaps.spiral.border = border_setting(other)


def _get_border(obj: bpy.types.Object) -> int:
    return [name for name, *_ in BORDERS].index(border_setting(obj))


def _set_border(obj: bpy.types.Object, number: int) -> None:
    obj.flexmaps.spiral.border = BORDERS[number][0]


def _get_support_kind(obj: bpy.types.Object) -> int:
    wanted = obj.flexmaps
    if wanted.base.base == "eyelets":
        return 2
    return int(wanted.base.base != "none" or bool(wanted.loads.supports))


def _set_support_kind(obj: bpy.types.Object, number: int) -> None:
    loads, base = obj.flexmaps.loads, obj.flexmaps.base
    if number == 0:
        loads.supports, base.base = "", "none"
        return
    if number == 2 or base.base == "eyelets":
        base.base = "eyelets" if number == 2 else "none"
    if not loads.supports:
        set_supports(obj, _extreme_vertices(obj, highest=number == 2))


def _extreme_vertices(obj: bpy.types.Object, *, highest: bool) -> list[int]:
    """Return the indices of the lowest or highest vertices in world space."""
    if not len(obj.data.polygons):
        return []
    up = np.array(obj.matrix_world)[2, :3] * (-1 if highest else 1)
    used = np.flatnonzero(dimensions.face_vertices(obj.data))
    heights = vertex_positions.read_target(obj)[used] @ up
    near = HOLD_HEIGHT * dimensions.estimate_quad_edge(obj, bpy.context.scene)
    near /= bpy.context.scene.unit_settings.scale_length
    return used[heights <= heights.min() + near].tolist()


def border_vertices(obj: bpy.types.Object) -> list[int]:
    """Return the indices of the vertices on the open border."""
    mesh = obj.data
    uses = np.bincount(column(mesh.loops, "edge_index"), minlength=len(mesh.edges))
    return np.unique(column(mesh.edges, "vertices")[uses == 1]).tolist()


def set_supports(obj: bpy.types.Object, vertices: list[int]) -> None:
    """Make these vertices the only ones in the supports' vertex group.

    Parameters
    ----------
    obj : the mesh object
    vertices : indices of Blender's vertices
    """
    from . import supports  # imported here because it imports scipy

    group = obj.vertex_groups.get(supports.GROUP) or obj.vertex_groups.new(name=supports.GROUP)
    editing = obj.mode == "EDIT"
    if editing:
        bpy.ops.object.mode_set(mode="OBJECT")
    group.remove(range(len(obj.data.vertices)))
    group.add(vertices, 1.0, "REPLACE")
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    obj.flexmaps.loads.supports = group.name


def register() -> None:
    bpy.types.Object.flexmaps_size = FloatVectorProperty(
        name="Size",
        description="Width, depth and height in millimetres, along the object's own axes; any of them scales the whole piece",
        get=_get_size,
        set=_set_size,
        min=0.0,
        precision=0,
        step=100,
        translation_context=CONTEXT,
    )
    bpy.types.Object.flexmaps_rests = EnumProperty(
        name="Rests", items=SUPPORT_KINDS, get=_get_support_kind, set=_set_support_kind, translation_context=CONTEXT
    )

    bpy.types.Object.flexmaps_border = EnumProperty(
        name="Border", items=BORDERS, get=_get_border, set=_set_border, translation_context=CONTEXT
    )


def unregister() -> None:
    del bpy.types.Object.flexmaps_size, bpy.types.Object.flexmaps_rests, bpy.types.Object.flexmaps_border
