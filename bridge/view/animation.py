"""The animation of the assembly: one object per panel, moved by keyframes and bent by shape keys.

The shape keys are absolute: one animated value, the evaluation time, selects and interpolates them. The objects are
children of an empty, which can be moved or scaled; a new animation replaces the empty and the objects.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.patches.joining import panel_numbers
from ..store import attributes
from . import collection, materials, meshes, preview

if TYPE_CHECKING:
    from collections.abc import Callable

    from ...engine.extras.film.assembly_film import Film, PanelTrack

KIND, ROOT = "film", "Assembly"
LAST_FRAME = "flexmaps_last_frame"  # custom property of the empty: last frame of the animation
# seconds of rest before the first panel moves and after the last one has arrived; longer leaves less time for the
# motion in between; chosen by eye
LEAD, TAIL = 0.4, 1.2


def show(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    film: Film,
    seconds: float,
    rgb: Float[np.ndarray, "quads 3"] | None,
    place: Float[np.ndarray, " 3"],
) -> tuple[bpy.types.Object, int]:
    """Make the objects of an animation beside its model, replacing an earlier animation.

    Parameters
    ----------
    obj, scene : the model and its scene
    film : the animation
    seconds : its length
    rgb : linear colours of the quads, or None for the sheet's material
    place : position of the empty, metres, added to all positions of the film

    Returns
    -------
    The empty, and the last frame.
    """
    clear(obj)
    root = bpy.data.objects.new(f"{obj.name} {ROOT}", None)
    root["flexmaps_kind"] = KIND
    root.empty_display_size = 0.05
    unit = scene.unit_settings.scale_length
    root.location, root.scale = place / unit, (1.0 / unit,) * 3
    collection.collection_of(obj, scene).objects.link(root)
    rate = scene.render.fps / scene.render.fps_base
    first = scene.frame_start
    pace = max(seconds - LEAD - TAIL, 0.5) / film.length

    def frame(time: float) -> float:
        return first + rate * (LEAD + pace * time)

    whole = preview.piece_mesh(
        "FlexMaps film", film.panels, film.panels.flat_vertices(np.zeros((len(film.tracks), 2))), rgb
    )
    quad_of, patch_of = film.panels.quad_of, film.panels.design.flat.layout.patch_of
    try:
        for track in film.tracks:
            made = _make_panel(obj, scene, film, track, whole)
            if rgb is None:
                made.data.materials.append(materials.sheet_material(obj.flexmaps.material.material))
            else:
                materials.assign_colours(made.data, rgb[quad_of[patch_of[quad_of] == track.patch]])
            made.parent = root
            _animate_shape(made, track, frame)
            _animate_motion(made, track, frame)
    finally:
        bpy.data.meshes.remove(whole)
    last = int(np.ceil(frame(film.length) + rate * TAIL))
    root[LAST_FRAME] = last
    return root, last


def clear(obj: bpy.types.Object) -> None:
    """Remove a model's animation: objects, meshes and unused actions."""
    for other in collection.objects_of_kinds(obj, KIND):
        # an object and its shape keys may share an action
        actions = {holder.animation_data.action.name for holder in _animated_data(other)}
        data = other.data
        bpy.data.objects.remove(other)
        if data is not None:
            bpy.data.meshes.remove(data)
        for action in map(bpy.data.actions.get, actions):
            if action is not None and action.users == 0:
                bpy.data.actions.remove(action)


def _animated_data(obj: bpy.types.Object) -> list[Any]:
    keys = obj.data.shape_keys if obj.data is not None else None
    held = [holder for holder in (obj, keys) if holder is not None and holder.animation_data is not None]
    return [holder for holder in held if holder.animation_data.action is not None]


def find_objects(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """Return the objects of a model's animation, the parent empty first; [] without an animation."""
    return sorted(collection.objects_of_kinds(obj, KIND), key=lambda o: o.type != "EMPTY")


def last_frame(obj: bpy.types.Object) -> int:
    """Return the last frame of a model's animation, which has to exist."""
    return int(find_objects(obj)[0][LAST_FRAME])


# -- one panel ---------------------------------------------------------------------------------------------------------


def _make_panel(
    obj: bpy.types.Object, scene: bpy.types.Scene, film: Film, track: PanelTrack, all_panels: bpy.types.Mesh
) -> bpy.types.Object:
    """Make the object of a panel: its faces, UV map and colours are taken from the mesh ``all_panels``."""
    panels = film.panels
    index = np.full(len(panels.vertex_quad), -1)
    index[track.vertices] = np.arange(len(track.vertices))
    patch_of = panels.design.flat.layout.patch_of
    faces = patch_of[panels.quad_of] == track.patch
    corners = np.repeat(faces, panels.sizes)
    number = panel_numbers(panels.design.flat.layout)[track.patch]
    name = f"{obj.name} {ROOT} {number:02d}"
    mesh = meshes.make_polygon_mesh(name, track.shapes[0], index[panels.corners[corners]], panels.sizes[faces])
    uv = np.empty(2 * len(all_panels.loops), np.float32)
    all_panels.attributes["flexmaps_flat"].data.foreach_get("vector", uv)
    meshes.put_attribute(mesh, "flexmaps_flat", "CORNER", uv.reshape(-1, 2)[corners])
    colour = attributes.read(all_panels, "flexmaps_colour")
    if colour is not None:
        meshes.put_attribute(mesh, "flexmaps_colour", "POINT", colour[track.vertices])
        mesh.attributes.active_color_name = "flexmaps_colour"
    meshes.shade_arms(mesh, panels.section[track.vertices])
    made = bpy.data.objects.new(name, mesh)
    made["flexmaps_kind"] = KIND
    collection.collection_of(obj, scene).objects.link(made)
    return made


def _animate_shape(panel: bpy.types.Object, track: PanelTrack, frame: Callable[[float], float]) -> None:
    """Add the panel's shapes as absolute shape keys, and animate their evaluation time; ``frame``: seconds -> frame."""
    for k, points in enumerate(track.shapes):
        key = panel.shape_key_add(name="Flat" if k == 0 else f"Shape {k}", from_mix=False)
        key.data.foreach_set("co", np.ascontiguousarray(points, dtype=np.float32).ravel())
        key.interpolation = "KEY_LINEAR"
    keys = panel.data.shape_keys
    keys.use_relative = False
    for which, time in zip(track.which.tolist(), track.shape_times.tolist(), strict=True):
        keys.eval_time = keys.key_blocks[which].frame
        keys.keyframe_insert("eval_time", frame=frame(time))
    _interpolate_linearly(keys)


def _animate_motion(panel: bpy.types.Object, track: PanelTrack, frame: Callable[[float], float]) -> None:
    from mathutils import Matrix

    panel.rotation_mode = "QUATERNION"
    before = None
    for time, turn, place in zip(track.times, track.turns, track.places, strict=True):
        panel.location = place
        turned = Matrix(turn.tolist()).to_quaternion()
        if before is not None:
            turned.make_compatible(before)
        panel.rotation_quaternion = before = turned
        panel.keyframe_insert("location", frame=frame(time))
        panel.keyframe_insert("rotation_quaternion", frame=frame(time))
    _interpolate_linearly(panel)


def _interpolate_linearly(holder: bpy.types.ID) -> None:
    """Set linear interpolation between keyframes, which are dense enough for it."""
    for curve in _fcurves(holder.animation_data):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def _fcurves(data: bpy.types.ID) -> list[Any]:
    """Return the action's F-curves; Blender 4.4 and later keep them in layers and slots."""
    action = data.action
    if hasattr(action, "layers") and len(action.layers):
        bag = action.layers[0].strips[0].channelbag(data.action_slot)
        return list(bag.fcurves)
    return list(action.fcurves)
