"""Colours on the model for distortion, spirals, patches and the simulated shape, with a legend; also as a colour attribute for renders.

Drawn over the 3D view by a handler of our own, so that no setting of the user's viewport is touched: switched off, all is
as it was before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ...engine import colours
from ..store import attributes, equilibrium
from . import live

# kind -> (attribute, label, unit)
KINDS: dict[str, tuple[str, str, str]] = {
    "ENERGY": ("flexmaps_energy", "Distortion E", ""),
    "SQUARE": ("flexmaps_square", "Distance from a square", ""),
    "WIDTH": ("flexmaps_width", "Width", "mm"),
    "TWIST": ("flexmaps_twist", "Twist", "\N{DEGREE SIGN}"),
    "PATCH": ("flexmaps_patch", "Patches", ""),
    "DISTANCE": ("flexmaps_distance", "Distance to target", "mm"),
    "STRAIN_ENERGY": ("flexmaps_strain_energy", "Strain energy", "mJ"),
    "REACH": ("flexmaps_reach", "What limits the match", ""),
    "SAFETY": ("flexmaps_strain", "Strain", "%"),
}
SIMULATED = ("DISTANCE", "STRAIN_ENERGY", "REACH", "SAFETY")
# what may limit a match -> its colour, sRGB, and what the legend says
LIMITS: dict[str, tuple[tuple[float, float, float], str]] = {
    "matched": ((0.90, 0.92, 0.88), "matches"),
    "softest": ((0.90, 0.45, 0.13), "as soft as it may be"),
    "stiffest": ((0.50, 0.27, 0.60), "as stiff as it may be"),
    "unstable": ((0.76, 0.08, 0.20), "about to snap"),
    "distorted": ((0.95, 0.78, 0.25), "distorted by flattening"),
    "stretched": ((0.14, 0.55, 0.55), "stretched in its plane"),
    "free": ((0.40, 0.58, 0.85), "pulled by its neighbours"),
}
SQUARE_HIGH = 0.25  # the paper's worst quad of a regularised mesh has 0.238
EDIT_ALPHA = 0.55
LEAST_DISTANCE = 0.1  # mm: the scale of distances reaches at least to here, or rounding errors would be coloured
ROW = 18  # height of a line of the legend, in pixels at the usual size
SEAMS, NO_SEAM = "flexmaps_seam", -2
LIFT = 0.005  # how far the colours float above the surface, in edges


@dataclass(frozen=True)
class Legend:
    """What stands beside the colour bar; ``scale`` (n, 3) sRGB is ``None`` where there is no bar.

    entries : sRGB colours with what they stand for, from top to bottom
    """

    title: str
    low: str = ""
    high: str = ""
    scale: np.ndarray | None = None
    entries: tuple[tuple[tuple[float, ...], str], ...] = ()


def painted(obj: bpy.types.Object, kind: str, values: np.ndarray) -> tuple[np.ndarray, Legend]:
    """(F, 3) linear colours of the quads, and their legend."""
    _, label, unit = KINDS[kind]
    if kind == "PATCH":
        count = int(values.max()) + 1
        return colours.of_patches(count)[values.astype(int)], Legend(f"{count} patches")
    if kind == "REACH":
        return _limits(values.astype(int))
    if kind in {"ENERGY", "SQUARE"}:
        high = obj.flexmaps.layout.distortion_limit if kind == "ENERGY" else SQUARE_HIGH
        legend = Legend(f"{label}, largest {values.max():.3f}", "0", f"{high:.3g}", colours.BAD)
        return colours.on_scale(values, 0.0, high, colours.BAD), legend
    if kind == "SAFETY":
        legend = Legend(f"Strain, largest {100 * values.max():.0f} % of the limit", "0", "limit", colours.BAD)
        return colours.on_scale(values, 0.0, 1.0, colours.BAD), legend
    low, high = float(values.min()), float(values.max())
    if kind == "DISTANCE":
        high = max(high, LEAST_DISTANCE)
        legend = Legend(label, "0", f"{high:.3g} mm", colours.BAD)
        return colours.on_scale(values, 0.0, high, colours.BAD), legend
    if kind == "STRAIN_ENERGY":
        low = 0.0
    gap = "" if unit == "\N{DEGREE SIGN}" else " "
    legend = Legend(label, f"{low:.3g}{gap}{unit}", f"{high:.3g}{gap}{unit}", colours.MUCH)
    return colours.on_scale(values, low, high, colours.MUCH), legend


def _limits(kinds: np.ndarray) -> tuple[np.ndarray, Legend]:
    """Colours and legend of what limits every spiral, (F,) numbers of the engine."""
    from ...engine.optimisation.reach import NAMES

    looks = [LIMITS.get(name, ((0.6, 0.6, 0.6), name)) for name in NAMES]
    count = np.bincount(kinds, minlength=len(looks))
    entries = tuple((rgb, f"{text}: {n}") for (rgb, text), n in zip(looks, count.tolist(), strict=True) if n)
    rgb = colours.linear(np.array([rgb for rgb, _ in looks]))
    return rgb[kinds], Legend(KINDS["REACH"][1], entries=entries)


def legend_of(obj: bpy.types.Object, kind: str) -> Legend:
    """The legend of an overlay that ``store`` has written."""
    with attributes.readable(obj) as mesh:
        values = attributes.get(mesh, KINDS[kind][0])
    assert values is not None
    return painted(obj, kind, values)[1]


def store(obj: bpy.types.Object, kind: str) -> bool:
    """Write the colours as the mesh's active colour attribute; False where the stage of that kind has not run."""
    if not _current(obj, kind):
        return False
    with attributes.readable(obj) as mesh:
        values = attributes.get(mesh, KINDS[kind][0])
        sizes = np.empty(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("loop_total", sizes)
    if values is None or len(values) != len(sizes):
        return False
    rgb, _ = painted(obj, kind, values)
    rgba = np.repeat(np.c_[rgb, np.ones(len(rgb))], sizes, axis=0)
    attributes.put(obj, "flexmaps_colour", "CORNER", "FLOAT_COLOR", rgba)
    if not obj.data.is_editmode:
        obj.data.attributes.active_color_name = "flexmaps_colour"
    return True


def renew(obj: bpy.types.Object, made: str = "") -> None:
    """After a stage: colour the object anew, in the kind that is shown, or in the kind that the stage has ``made`` something of.

    That is where nothing else is shown, or what was is gone; who switched the colours off is left without.
    """
    manager = bpy.context.window_manager
    shown = manager.flexmaps_overlay
    if shown != "NONE" and store(obj, shown):
        _redraw(manager)
    elif made and not manager.flexmaps_plain and store(obj, made):
        manager.flexmaps_overlay = made


def switch(kind: str) -> None:
    """What the user wants to see from now on; "NONE": nothing, until they choose again."""
    manager = bpy.context.window_manager
    manager.flexmaps_plain = kind == "NONE"
    manager.flexmaps_overlay = kind


def _current(obj: bpy.types.Object, kind: str) -> bool:
    """Colours of a simulation that the mesh has left behind are not shown."""
    return kind not in SIMULATED or not equilibrium.out_of_date(obj, bpy.context.scene)


# -- drawing in the 3D view --------------------------------------------------------------------------------------------

_handles: list[Any] = []
_cache: dict[tuple[int, str, bool], tuple[Any, Any, Legend] | None] = {}


def register() -> None:
    items = [("NONE", "None", "No colours")]
    items += [(kind, label, f"Colour the quads by: {label.lower()}") for kind, (_, label, _) in KINDS.items()]
    bpy.types.WindowManager.flexmaps_overlay = bpy.props.EnumProperty(items=items, name="Overlay", update=_redraw)
    bpy.types.WindowManager.flexmaps_plain = bpy.props.BoolProperty(name="Colours were switched off")
    handlers = bpy.app.handlers
    handlers.depsgraph_update_post.append(_changed)
    handlers.load_pre.append(_forget)
    handlers.undo_post.append(_forget)
    handlers.redo_post.append(_forget)
    if not bpy.app.background:
        view = bpy.types.SpaceView3D
        _handles.append(view.draw_handler_add(_draw_colours, (), "WINDOW", "POST_VIEW"))
        _handles.append(view.draw_handler_add(live.draw, (), "WINDOW", "POST_VIEW"))
        _handles.append(view.draw_handler_add(_draw_legend, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    handlers = bpy.app.handlers
    handlers.depsgraph_update_post.remove(_changed)
    for which in (handlers.load_pre, handlers.undo_post, handlers.redo_post):
        which.remove(_forget)
    _cache.clear()
    del bpy.types.WindowManager.flexmaps_overlay, bpy.types.WindowManager.flexmaps_plain


def _redraw(manager: bpy.types.WindowManager, context: bpy.types.Context | None = None) -> None:
    _cache.clear()
    for window in manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


@bpy.app.handlers.persistent
def _changed(scene: Any, depsgraph: bpy.types.Depsgraph) -> None:
    if _cache and any(
        isinstance(update.id, bpy.types.Mesh | bpy.types.Object | bpy.types.Key) for update in depsgraph.updates
    ):
        _cache.clear()


@bpy.app.handlers.persistent
def _forget(*_: object) -> None:
    _cache.clear()


def _shown(context: bpy.types.Context) -> tuple[bpy.types.Object, Any, Any, Legend] | None:
    """The object, the faces and lines to draw and the legend; ``None`` where nothing is to be drawn."""
    obj, kind = context.object, context.window_manager.flexmaps_overlay
    if kind == "NONE" or obj is None or obj.type != "MESH" or not obj.visible_get():
        return None
    key = (obj.session_uid, kind, obj.data.is_editmode)
    if key not in _cache:
        _cache[key] = _batch(obj, kind)
    found = _cache[key]
    return None if found is None else (obj, *found)


def _batch(obj: bpy.types.Object, kind: str) -> tuple[Any, Any, Legend] | None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    quads = _quads(obj, KINDS[kind][0])
    if quads is None or not len(quads.values) or not _current(obj, kind):
        return None
    rgb, legend = painted(obj, kind, quads.values)
    seams, corners = quads.seams, quads.positions[quads.corners]
    up, normal = _normals(quads)
    lift = LIFT * float(np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))) * up[quads.corners]
    lifted = corners + lift
    light = 0.78 + 0.22 * normal @ np.array([0.27, -0.45, 0.85])  # enough to read the shape
    srgb = np.clip(rgb, 0.0, 1.0) ** (1 / 2.2) * light[:, None]
    points = lifted[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.float32)
    # in edit mode the mesh that is worked on shines through
    alpha = np.full(len(srgb), EDIT_ALPHA if obj.data.is_editmode else 1.0)
    rgba = np.repeat(np.c_[srgb, alpha], 6, axis=0).astype(np.float32)
    faces = batch_for_shader(gpu.shader.from_builtin("FLAT_COLOR"), "TRIS", {"pos": points, "color": rgba})
    lines = None
    sides = seams != NO_SEAM
    if sides.any():
        higher = lifted + 2 * lift
        ends = np.stack([higher, np.roll(higher, -1, axis=1)], axis=2)
        pen = gpu.shader.from_builtin("POLYLINE_FLAT_COLOR")
        look = {"pos": ends[sides].reshape(-1, 3), "color": np.repeat(_seam_colours(seams[sides], kind), 2, axis=0)}
        lines = batch_for_shader(pen, "LINES", {name: x.astype(np.float32) for name, x in look.items()})
    return faces, lines, legend


def _seam_colours(seams: np.ndarray, kind: str) -> np.ndarray:
    """(N, 4) sRGB of the lines on seams (N,): over the patches each in its own colour, as on the assembly sheet."""
    palette = np.clip(colours.of_seams(int(seams.max()) + 1), 0.0, 1.0) ** (1 / 2.2)
    own = (seams >= 0) & (kind == "PATCH")
    rgb = np.tile(colours.SEAM, (len(seams), 1))
    rgb[own] = palette[seams[own]]
    return np.c_[rgb, np.ones(len(rgb))]


def _normals(quads: _Quads) -> tuple[np.ndarray, np.ndarray]:
    """Of the vertices (V, 3) and of the quads (F, 3). Colours rise along the first, or neighbours would part."""
    p = quads.positions[quads.corners]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    up = np.zeros_like(quads.positions)
    np.add.at(up, quads.corners, normal[:, None])
    return _unit(up), _unit(normal)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


@dataclass(frozen=True, eq=False)
class _Quads:
    """What is coloured: positions (V, 3) in the object's frame, corners (F, 4) into them, a value (F,) and the seams.

    seams : (F, 4) int, the seam on every side, -1 for one that has no number yet, ``NO_SEAM`` where there is none
    """

    positions: np.ndarray
    corners: np.ndarray
    values: np.ndarray
    seams: np.ndarray


def _quads(obj: bpy.types.Object, name: str) -> _Quads | None:
    """The object as it is seen, with the values of a face attribute; None where there are none, or other faces than quads."""
    if obj.data.is_editmode:
        import bmesh

        bm = bmesh.from_edit_mesh(obj.data)
        layer = bm.faces.layers.float.get(name) or bm.faces.layers.int.get(name)
        if layer is None or any(len(face.verts) != 4 for face in bm.faces):
            return None
        bm.verts.index_update()
        positions = np.array([v.co for v in bm.verts], dtype=float)
        corners = np.array([[v.index for v in face.verts] for face in bm.faces])
        found = np.array([face[layer] for face in bm.faces])
        if not attributes.fits(name, found):
            return None
        number = bm.edges.layers.int.get(SEAMS)
        if number is not None and not attributes.fits(SEAMS, np.array([e[number] for e in bm.edges])):
            number = None
        seam = {e: NO_SEAM if not e.seam else -1 if number is None else e[number] for e in bm.edges}
        seams = np.array([[seam[loop.edge] for loop in face.loops] for face in bm.faces])
        return _Quads(positions, corners, found, seams)
    mesh = obj.data
    values = attributes.get(mesh, name)
    if values is None or len(mesh.loops) != 4 * len(mesh.polygons):
        return None
    index = np.empty(len(mesh.loops), np.int32)
    edges, seams = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.edges), bool)
    mesh.loops.foreach_get("vertex_index", index)
    mesh.loops.foreach_get("edge_index", edges)
    mesh.edges.foreach_get("use_seam", seams)
    number = attributes.get(mesh, SEAMS)
    numbers = np.full(len(mesh.edges), -1) if number is None else number
    sides = np.where(seams, numbers, NO_SEAM)[edges].reshape(-1, 4)
    return _Quads(equilibrium.shown_positions(mesh).astype(float), index.reshape(-1, 4), values, sides)


def _draw_colours() -> None:
    import gpu

    shown = _shown(bpy.context)
    if shown is None:
        return
    obj, faces, lines, _ = shown
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_mask_set(True)
    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(obj.matrix_world)
        faces.draw(gpu.shader.from_builtin("FLAT_COLOR"))
        if lines is not None:
            pen = gpu.shader.from_builtin("POLYLINE_FLAT_COLOR")
            pen.bind()
            pen.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
            pen.uniform_float("lineWidth", 3.5)
            lines.draw(pen)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _draw_legend() -> None:
    """Lower left: the title, below it a bar with its ends or a list, on a dark plate that any view lets read."""
    import blf

    moving, shown = live.shown(), _shown(bpy.context)
    legend = moving.legend if moving is not None else None if shown is None else shown[3]
    if legend is None:
        return
    unit = bpy.context.preferences.system.ui_scale
    x, y, width = 90 * unit, 30 * unit + _covered(bpy.context), 180 * unit
    blf.size(0, 12 * unit)
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    below = 34 * unit if legend.scale is not None else ROW * unit * len(legend.entries)
    broad = blf.dimensions(0, legend.title)[0]
    if legend.scale is not None:
        broad = max(broad, width)
    for _, text in legend.entries:
        broad = max(broad, 20 * unit + blf.dimensions(0, text)[0])
    _rectangle(x - 10 * unit, y - 10 * unit, broad + 20 * unit, below + 32 * unit, (0.1, 0.1, 0.1), 0.5)
    _text(x, y + below, legend.title)
    for k, (rgb, text) in enumerate(reversed(legend.entries)):
        _rectangle(x, y + ROW * k * unit, 12 * unit, 12 * unit, rgb)
        _text(x + 20 * unit, y + (ROW * k + 1) * unit, text)
    if legend.scale is not None:
        _bar(x, y + 14 * unit, width, 12 * unit, legend.scale)
        _text(x, y, legend.low)
        _text(x + width - blf.dimensions(0, legend.high)[0], y, legend.high)


def _covered(context: bpy.types.Context) -> int:
    """How many pixels from below Blender's panel of the last operator covers."""
    region = context.region
    tops = [r.y + r.height - region.y for r in context.area.regions if r.type == "HUD" and r.height > 1]
    return max(tops, default=0)


def _bar(x: float, y: float, width: float, height: float, scale: np.ndarray) -> None:
    """A scale (n, 3) of sRGB colours from left to right."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    steps, anchors = np.linspace(0.0, 1.0, 25), np.linspace(0.0, 1.0, len(scale))
    rgb = np.stack([np.interp(steps, anchors, scale[:, k]) for k in range(3)], axis=1)
    points = np.zeros((2 * len(steps), 3), np.float32)
    points[:, 0], points[:, 1] = np.repeat(x + width * steps, 2), np.tile([y, y + height], len(steps))
    rgba = np.repeat(np.c_[rgb, np.ones(len(rgb))], 2, axis=0).astype(np.float32)
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRI_STRIP", {"pos": points, "color": rgba}).draw(shader)


def _rectangle(x: float, y: float, width: float, height: float, rgb: tuple[float, ...], alpha: float = 1.0) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [(x, y, 0), (x + width, y, 0), (x, y + height, 0), (x + width, y + height, 0)]
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": corners})
    shader.bind()
    shader.uniform_float("color", (*rgb, alpha))
    gpu.state.blend_set("ALPHA")
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def _text(x: float, y: float, text: str) -> None:
    import blf

    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.9)
    blf.position(0, x, y, 0)
    blf.draw(0, text)
    blf.disable(0, blf.SHADOW)
