"""Draw the active model's colours and seams, the shape of a running simulation, and their legend over the 3D view.

Draw handlers of FlexMaps draw them, so that the viewport's settings stay unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...engine import colours
from ...engine.arrays import Float, Int, Shaped
from ...engine.display.depth_offset import pull_forward
from ..store import attributes, vertex_positions
from ..store.columns import column
from . import colouring, legend
from .legend import Legend
from .live_shape import LIFT, LiveShape

# opacity of the colours in edit mode; smaller shows the mesh below better and the colours worse; chosen by eye
EDIT_ALPHA = 0.55
SEAM_ATTRIBUTE = "flexmaps_seam"  # edge attribute with the index of the seam
KIND_KEY = "flexmaps_overlay"  # custom property of the scene: the kind of colours shown
FALLBACK_KINDS = ("DISTANCE", "TWIST", "PATCH")  # kinds of colours that stages switch on, the latest stage first
NO_SEAM = -2  # seam index of an edge that is not a seam; -1 is a seam without an index
# sRGB and alpha of the bars that show the widths of a spiral's pairs of opposite arms
BAR_COLOUR = (0.05, 0.05, 0.05, 1.0)
BAR_LENGTH = 0.8  # length of the longest bar, as a fraction of its quad; larger bars run together; chosen by eye


def update_after_stage(obj: bpy.types.Object, new_kind: str = "") -> None:
    """Recolour the object after a stage: with the stage's new values, or else with the kind of colours shown before.

    A kind that the user chose stays while it is available; if the user chose no colours, none appear.

    Parameters
    ----------
    obj : the mesh object
    new_kind : kind of colours for which the stage has computed values, or ""
    """
    manager = bpy.context.window_manager
    shown, chosen = manager.flexmaps_overlay, manager.flexmaps_chosen
    kinds = (shown,) if chosen and shown == "NONE" else (shown, new_kind) if chosen else (new_kind, shown)
    kind = next((kind for kind in kinds if kind not in {"", "NONE"} and colouring.store_colours(obj, kind)), shown)
    if kind == shown:
        _redraw(manager)
    else:
        manager.flexmaps_overlay, manager.flexmaps_chosen = kind, False


def choose_kind(kind: str) -> None:
    """Show the kind of colours that the user chose; "NONE" shows no colours until the user chooses again."""
    manager = bpy.context.window_manager
    manager.flexmaps_overlay, manager.flexmaps_chosen = kind, True


# -- drawing in the 3D view --------------------------------------------------------------------------------------------

_handles: list[Any] = []
_cache: dict[tuple[int, str, bool], tuple[Any, Any, Legend] | None] = {}


def register(running: Callable[[], Any]) -> None:
    """Register properties, event handlers and draw handlers.

    ``running`` returns the intermediate result of the running job or live mode; a ``LiveShape`` is drawn.
    """
    bpy.types.WindowManager.flexmaps_overlay = bpy.props.EnumProperty(
        items=colouring.OVERLAY_ITEMS, name="Overlay", update=_on_switch
    )
    bpy.types.WindowManager.flexmaps_chosen = bpy.props.BoolProperty(name="The user chose the colours, or none")
    handlers = bpy.app.handlers
    handlers.depsgraph_update_post.append(_on_change)
    handlers.load_pre.append(_clear_cache)
    handlers.load_post.append(_on_load)
    handlers.undo_post.append(_on_undo)
    handlers.redo_post.append(_on_undo)
    if not bpy.app.background:
        view = bpy.types.SpaceView3D
        _handles.append(view.draw_handler_add(_draw_colours, (), "WINDOW", "POST_VIEW"))
        _handles.append(view.draw_handler_add(_draw_live, (running,), "WINDOW", "POST_VIEW"))
        _handles.append(view.draw_handler_add(_draw_legend, (running,), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    handlers = bpy.app.handlers
    handlers.depsgraph_update_post.remove(_on_change)
    handlers.load_pre.remove(_clear_cache)
    handlers.load_post.remove(_on_load)
    for which in (handlers.undo_post, handlers.redo_post):
        which.remove(_on_undo)
    _cache.clear()
    del bpy.types.WindowManager.flexmaps_overlay, bpy.types.WindowManager.flexmaps_chosen


def _on_switch(manager: bpy.types.WindowManager, context: bpy.types.Context) -> None:
    """Store the kind of colours in the scene, so that it is shown again when the file is opened."""
    if context.scene is not None and context.scene.get(KIND_KEY, "NONE") != manager.flexmaps_overlay:
        context.scene[KIND_KEY] = manager.flexmaps_overlay
    _redraw(manager)


@bpy.app.handlers.persistent
def _on_load(*_: object) -> None:
    kept = bpy.context.scene.get(KIND_KEY, "NONE")
    if kept in colouring.KINDS:
        bpy.context.window_manager.flexmaps_overlay = kept


@bpy.app.handlers.persistent
def _on_undo(*_: object) -> None:
    """Handle undo and redo: if the object has lost the values of the shown kind, show values of an earlier stage."""
    _cache.clear()
    manager, obj = bpy.context.window_manager, bpy.context.view_layer.objects.active
    shown = manager.flexmaps_overlay
    if shown == "NONE" or obj is None or obj.type != "MESH":
        return
    there = [kind for kind in (shown, *FALLBACK_KINDS) if attributes.has(obj, colouring.KINDS[kind].attribute)]
    if there and there[0] != shown and colouring.is_current(obj, there[0]):
        manager.flexmaps_overlay = there[0]


def _redraw(manager: bpy.types.WindowManager, context: bpy.types.Context | None = None) -> None:
    _cache.clear()
    for window in manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


@bpy.app.handlers.persistent
def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if _cache and any(
        isinstance(update.id, bpy.types.Mesh | bpy.types.Object | bpy.types.Key) for update in depsgraph.updates
    ):
        _cache.clear()


@bpy.app.handlers.persistent
def _clear_cache(*_: object) -> None:
    _cache.clear()


def _current_batch(context: bpy.types.Context) -> tuple[bpy.types.Object, Any, Any, Legend] | None:
    """Return the object, GPU batches of its faces and lines, and the legend; None if there is nothing to draw."""
    obj, kind = context.object, context.window_manager.flexmaps_overlay
    if kind == "NONE" or obj is None or obj.type != "MESH" or not obj.visible_get():
        return None
    key = (obj.session_uid, kind, obj.data.is_editmode)
    if key not in _cache:
        _cache[key] = _make_batch(obj, kind)
    batch = _cache[key]
    return None if batch is None else (obj, *batch)


def _make_batch(obj: bpy.types.Object, kind: str) -> tuple[Any, Any, Legend] | None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    quads = _read_quads(obj, kind)
    if quads is None or not len(quads.values) or not colouring.is_current(obj, kind):
        return None
    rgb, legend = colouring.colours_and_legend(obj, kind, quads.values)
    seams, corners = quads.seams, quads.positions[quads.corners]
    up, normal = _normals(quads)
    lifted = on_both_sides(corners, up[quads.corners])
    light = 0.78 + 0.22 * np.concatenate([normal, -normal]) @ colours.LIGHT  # weak shading that shows the shape
    srgb = np.tile(np.clip(rgb, 0.0, 1.0) ** (1 / 2.2), (2, 1)) * light[:, None]
    points = outward_triangles(lifted).reshape(-1, 3).astype(np.float32)
    alpha = np.full(len(srgb), EDIT_ALPHA if obj.data.is_editmode else 1.0)
    rgba = np.repeat(np.c_[srgb, alpha], 6, axis=0).astype(np.float32)
    faces = batch_for_shader(gpu.shader.from_builtin("FLAT_COLOR"), "TRIS", {"pos": points, "color": rgba})
    lines = None
    sides = seams != NO_SEAM
    higher = on_both_sides(corners, 3 * up[quads.corners])
    ends = np.stack([higher, np.roll(higher, -1, axis=1)], axis=2)[np.tile(sides, (2, 1))]
    pens = np.tile(_seam_colours(seams[sides], kind), (2, 1)) if sides.any() else np.zeros((0, 4))
    if kind == "ANISOTROPY" and quads.width is not None:
        bars = width_bars(higher, np.tile(quads.width, (2, 1)))
        ends, pens = np.concatenate([ends, bars]), np.concatenate([pens, np.tile(BAR_COLOUR, (len(bars), 1))])
    if len(ends):
        pen = gpu.shader.from_builtin("POLYLINE_FLAT_COLOR")
        look = {"pos": ends.reshape(-1, 3), "color": np.repeat(pens, 2, axis=0)}
        lines = batch_for_shader(pen, "LINES", {name: x.astype(np.float32) for name, x in look.items()})
    return faces, lines, legend


def on_both_sides(
    corners: Float[np.ndarray, "quads 4 3"], up: Float[np.ndarray, "quads 4 3"]
) -> Float[np.ndarray, "2*quads 4 3"]:
    """Return the quads twice: lifted along their normals, then lowered, so that colours show on both sides.

    Parameters
    ----------
    corners : corners of the quads
    up : unit normals at the corners
    """
    lift = LIFT * float(np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))) * up
    return np.concatenate([corners + lift, corners - lift])


def outward_triangles(lifted: Float[np.ndarray, "sides 4 3"]) -> Float[np.ndarray, "sides 6 3"]:
    """Return two triangles per quad, counter-clockwise seen from the side to which ``on_both_sides`` moved the quad."""
    upper, lower = np.split(lifted, 2)
    return np.concatenate([upper[:, [0, 1, 2, 0, 2, 3]], lower[:, [0, 2, 1, 0, 3, 2]]])


def width_bars(
    corners: Float[np.ndarray, "quads 4 3"], width: Float[np.ndarray, "quads 4"]
) -> Float[np.ndarray, "bars 2 3"]:
    """Return two bars per quad, which join the middles of opposite sides and show the widths of the arms there.

    A bar's length is proportional to the sum of the two arms' widths; the longest bar covers ``BAR_LENGTH`` of its quad.
    A bar is an array of its two ends, in the frame of the corners.
    """
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
    centre, share = corners.mean(axis=1), width[:, :2] + width[:, 2:]
    long = BAR_LENGTH * share / max(float(share.max()), 1e-30)
    half = 0.5 * (middles[:, :2] - middles[:, 2:]) * long[:, :, None]
    return np.stack([centre[:, None] - half, centre[:, None] + half], axis=2).reshape(-1, 2, 3)


def _seam_colours(seams: Int[np.ndarray, " sides"], kind: str) -> Float[np.ndarray, "sides 4"]:
    """Return sRGB and alpha of the seams' lines; with the colours of patches, each seam has its own colour.

    The assembly sheet uses equal colours.
    """
    palette = np.clip(colours.seam_colours(int(seams.max()) + 1), 0.0, 1.0) ** (1 / 2.2)
    own = (seams >= 0) & (kind == "PATCH")
    rgb = np.tile(colours.SEAM, (len(seams), 1))
    rgb[own] = palette[seams[own]]
    return np.c_[rgb, np.ones(len(rgb))]


def _normals(quads: _ColouredQuads) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "quads 3"]]:
    """Return unit normals of vertices and of quads.

    Quads are lifted along the vertex normals: along their own normals, neighbours would separate.
    """
    p = quads.positions[quads.corners]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    up = np.zeros_like(quads.positions)
    np.add.at(up, quads.corners, normal[:, None])
    return _normalise(up), _normalise(normal)


def _normalise(vectors: Float[np.ndarray, "vectors 3"]) -> Float[np.ndarray, "vectors 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


@dataclass(frozen=True, eq=False)
class _ColouredQuads:
    """The quads to colour.

    positions : vertices in the object's frame
    values : value of every quad
    seams : index of the seam on every side, -1 for a seam without an index, ``NO_SEAM`` without a seam
    width : widths of the four arms, millimetres; only for the kind "ANISOTROPY"
    """

    positions: Float[np.ndarray, "vertices 3"]
    corners: Int[np.ndarray, "quads 4"]
    values: Shaped[np.ndarray, " quads"]
    seams: Int[np.ndarray, "quads 4"]
    width: Float[np.ndarray, "quads 4"] | None = None


def _read_quads(obj: bpy.types.Object, kind: str) -> _ColouredQuads | None:
    """Return the object's quads as they are seen, with the values of a kind.

    Return None if the object has no such values, or faces that are not quads.
    """
    name = colouring.KINDS[kind].attribute
    if obj.data.is_editmode:
        import bmesh

        bm = bmesh.from_edit_mesh(obj.data)
        layer = bm.faces.layers.float.get(name) or bm.faces.layers.int.get(name)
        corner = bm.loops.layers.float.get(name)
        if (layer is None and corner is None) or any(len(face.verts) != 4 for face in bm.faces):
            return None
        bm.verts.index_update()
        positions = np.array([v.co for v in bm.verts], dtype=float)
        corners = np.array([[v.index for v in face.verts] for face in bm.faces])
        if corner is not None:
            own = np.array([loop[corner] for face in bm.faces for loop in face.loops])
        else:
            own = np.array([face[layer] for face in bm.faces])
            own = np.repeat(own, 4) if name == "flexmaps_width" else own  # older files store one width per face
        if not attributes.is_valid(name, own):
            return None
        number = bm.edges.layers.int.get(SEAM_ATTRIBUTE)
        if number is not None and not attributes.is_valid(SEAM_ATTRIBUTE, np.array([e[number] for e in bm.edges])):
            number = None
        seam = {e: NO_SEAM if not e.seam else -1 if number is None else e[number] for e in bm.edges}
        seams = np.array([[seam[loop.edge] for loop in face.loops] for face in bm.faces])
        return _ColouredQuads(positions, corners, colouring.to_quad_values(kind, own), seams, _widths(kind, own))
    mesh = obj.data
    values = attributes.read(mesh, name)
    if values is None or len(mesh.loops) != 4 * len(mesh.polygons):
        return None
    index, edges = column(mesh.loops, "vertex_index"), column(mesh.loops, "edge_index")
    number = attributes.read(mesh, SEAM_ATTRIBUTE)
    numbers = np.full(len(mesh.edges), -1) if number is None else number
    sides = np.where(column(mesh.edges, "use_seam"), numbers, NO_SEAM)[edges].reshape(-1, 4)
    seen = vertex_positions.read_displayed(obj).astype(float)
    return _ColouredQuads(
        seen, index.reshape(-1, 4), colouring.to_quad_values(kind, values), sides, _widths(kind, values)
    )


def _widths(kind: str, values: np.ndarray) -> Float[np.ndarray, "quads 4"] | None:
    return attributes.corners_by_face(values) if kind == "ANISOTROPY" else None


def _draw_colours() -> None:
    import gpu

    shown = _current_batch(bpy.context)
    if shown is None:
        return
    obj, faces, lines, _ = shown
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_mask_set(True)
    # draw only sides that face the eye: both sides of a quad lie too close together for the depth buffer
    gpu.state.face_culling_set("FRONT" if obj.matrix_world.is_negative else "BACK")
    projection = gpu.matrix.get_projection_matrix()
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        gpu.matrix.multiply_matrix(obj.matrix_world)
        gpu.matrix.load_projection_matrix(Matrix(pull_forward(projection)))
        faces.draw(gpu.shader.from_builtin("FLAT_COLOR"))
        gpu.state.face_culling_set("NONE")
        if lines is not None:
            gpu.matrix.load_projection_matrix(Matrix(pull_forward(projection, 2.0)))
            pen = gpu.shader.from_builtin("POLYLINE_FLAT_COLOR")
            pen.bind()
            pen.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
            pen.uniform_float("lineWidth", 3.5)
            lines.draw(pen)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _draw_live(running: Callable[[], Any]) -> None:
    shape = running()
    if isinstance(shape, LiveShape):
        shape.draw()


def _draw_legend(running: Callable[[], Any]) -> None:
    """Draw the legend of the running simulation's shape if there is one, else of the model's colours."""
    shape, shown = running(), _current_batch(bpy.context)
    wanted = shape.legend if isinstance(shape, LiveShape) else None if shown is None else shown[3]
    if wanted is not None:
        legend.draw(wanted)
