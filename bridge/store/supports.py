"""Supports and forces of a piece, from the vertex groups in the settings and from marks on single quads."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine.arrays import Bool, Float, Int
from ...engine.errors import FlexMapsError
from ...engine.extras import registry
from ...engine.params import LoadParams, Settings
from . import attributes, handles, objects, settings
from .columns import read_weights

if TYPE_CHECKING:
    from .surface import ObjectSurface

MIN_CORNERS = (
    2  # a quad belongs to a vertex group if it has so many corners in the group; 2 suffice for an edge on the ground
)
GROUP = "FlexMaps supports"


def read_loads(
    obj: bpy.types.Object, surface: ObjectSurface, params: LoadParams
) -> tuple[Int[np.ndarray, " supports"] | None, Float[np.ndarray, "quads 3"] | None]:
    """Return the supported quads, and the force on every quad in newtons and world axes; None where there are none.

    Parameters
    ----------
    obj : the mesh object
    surface : its surface
    params : settings of the loads

    Raises
    ------
    FlexMapsError where a vertex group is missing or holds no quad.
    """
    return read_supports(obj, surface, params), read_forces(obj, surface, params)


def read_groups(
    obj: bpy.types.Object, surface: ObjectSurface, object_settings: Settings
) -> dict[str, Int[np.ndarray, " some"]]:
    """Return the quads of every vertex group that the load cases use, by name; without groups that contain no quad.

    Return {} where the load cases are not valid, or the extra "structure" is not installed.

    Parameters
    ----------
    obj : the mesh object
    surface : its surface
    object_settings : settings of the object
    """
    if not registry.has("structure"):
        return {}
    from ...engine.extras.structure import cases
    from ...engine.extras.structure.structure_params import StructureParams

    params = object_settings.section(StructureParams)
    try:
        names = cases.parse_plan(params.cases, params.combinations).groups
    except FlexMapsError:
        return {}  # the stage parses the load cases again and reports the error
    quads = {}
    for name in names:
        if obj.vertex_groups.get(name) is not None:
            with suppress(FlexMapsError):
                quads[name] = _read_group(obj, surface, name, "Load cases")
    return quads


def has_group(uid: int, name: str) -> bool:
    """Return whether the object with this id has a vertex group of this name.

    Parameters
    ----------
    uid : ``session_uid`` of the object
    name : name of a vertex group
    """
    return objects.find_by_uid(uid).vertex_groups.get(name) is not None


def read_supports(
    obj: bpy.types.Object, surface: ObjectSurface, params: LoadParams
) -> Int[np.ndarray, " supports"] | None:
    """Return the quads held by the supports' vertex group or by marks on single quads; None where none are held.

    Parameters
    ----------
    obj : the mesh object
    surface : its surface
    params : settings of the loads

    Raises
    ------
    FlexMapsError where the group is missing or holds no quad.
    """
    single = handles.held_quads(surface)
    if not params.supports:
        return single if len(single) else None
    return np.union1d(_read_group(obj, surface, params.supports, "Supports"), single)


def write_loads(
    obj: bpy.types.Object,
    surface: ObjectSurface,
    held: Int[np.ndarray, " supports"] | None,
    force: Float[np.ndarray, "quads 3"] | None,
) -> None:
    """Store supports and forces: in the vertex groups of the settings as far as these match, the rest on single quads.

    Parameters
    ----------
    obj : the mesh object
    surface : its surface
    held : quads that are held, or None
    force : newtons on every quad in world axes, or None
    """
    wanted = np.zeros(0, int) if held is None else np.asarray(held)
    chosen = obj.flexmaps.loads
    in_group = _read_group(obj, surface, chosen.supports, "Supports") if chosen.supports else np.zeros(0, int)
    if not chosen.supports and write_supports(obj, surface, held):
        in_group = wanted
    single = np.zeros(len(surface.polygons.sizes))
    single[np.setdiff1d(wanted, in_group)] = 1.0
    handles.write(obj, handles.HELD, single)
    shared = read_group_force(obj, surface, settings.read(chosen, LoadParams))
    total = np.zeros((len(single), 3)) if force is None else force
    left = total - shared
    # rounding errors are not forces
    handles.write(obj, handles.PULL, np.where(np.abs(left) > 1e-9 * np.abs(total).max(initial=0.0), left, 0.0))


def write_supports(obj: bpy.types.Object, surface: ObjectSurface, quads: Int[np.ndarray, " supports"] | None) -> bool:
    """Store held quads in a vertex group and set it as the supports' group; None clears the setting.

    Returns
    -------
    False where no vertex group can represent exactly these quads, such as a single quad amid others; the setting is
    then empty.
    """
    chosen = obj.flexmaps.loads
    chosen.supports = ""
    if quads is None:
        return True
    corners = surface.polygons.corners
    held = np.isin(surface.polygons.face_of, quads)
    # take the vertices whose quads are all held; if the lowest quads are held, these are the vertices on the ground
    inside = np.bincount(corners[held], minlength=len(surface.positions)) > 0
    inside[corners[~held]] = False
    if not np.array_equal(_quads_of_vertices(surface, inside), np.sort(quads)):
        return False
    group = obj.vertex_groups.get(GROUP) or obj.vertex_groups.new(name=GROUP)
    group.remove(range(len(surface.positions)))
    group.add(np.flatnonzero(inside).tolist(), 1.0, "REPLACE")
    chosen.supports = GROUP
    return True


def read_forces(
    obj: bpy.types.Object, surface: ObjectSurface, params: LoadParams
) -> Float[np.ndarray, "quads 3"] | None:
    """Return the force on every quad: the vertex group's force, shared evenly, plus the forces on single quads.

    Returns
    -------
    (F, 3), newtons in world axes; None without any force.

    Raises
    ------
    FlexMapsError where the group is missing or holds no quad.
    """
    shared, single = read_group_force(obj, surface, params), handles.read_forces(surface)
    total = shared if single is None else shared + single
    return total if total.any() else None


def read_group_force(obj: bpy.types.Object, surface: ObjectSurface, params: LoadParams) -> Float[np.ndarray, "quads 3"]:
    """Return the vertex group's force, shared evenly over its quads, (F, 3) in newtons; raise like ``read_forces``."""
    total, shared = np.array(params.force), np.zeros((len(surface.polygons.sizes), 3))
    if not total.any():
        return shared
    if not params.pulled:
        raise FlexMapsError("There is a force, but nothing that it pulls at; choose a vertex group under Pulled")
    quads = _read_group(obj, surface, params.pulled, "Pulled")
    shared[quads] = total / len(quads)
    return shared


def _read_group(
    obj: bpy.types.Object, surface: ObjectSurface, name: str, setting_label: str
) -> Int[np.ndarray, " quads"]:
    """Return the quads of a vertex group; errors name the setting by its label."""
    group = obj.vertex_groups.get(name)
    if group is None:
        raise FlexMapsError(f"'{obj.name}' has no vertex group '{name}'; choose another one under {setting_label}")
    with attributes.readable_mesh(obj) as data:
        inside = read_weights(data, group.index) > 0.0
    if not inside.any():
        raise FlexMapsError(
            f"The vertex group '{name}' under {setting_label} is empty; select vertices in edit mode and press Assign"
        )
    belonging = _quads_of_vertices(surface, inside)
    if not len(belonging):
        raise FlexMapsError(
            f"No quad has {MIN_CORNERS} corners in the vertex group '{name}' under {setting_label}; add their vertices to it"
        )
    return belonging


def _quads_of_vertices(surface: ObjectSurface, inside: Bool[np.ndarray, " vertices"]) -> Int[np.ndarray, " quads"]:
    """Return the quads with at least ``MIN_CORNERS`` corners among the flagged vertices."""
    polygons = surface.polygons
    corners = np.bincount(polygons.face_of, weights=inside[polygons.corners], minlength=len(polygons.sizes))
    return np.flatnonzero(corners >= MIN_CORNERS)
