"""The flat patches and the spirals as objects beside the model, in a collection of the model's own.

They are pictures: made anew by every stage that changes them, never read back. Everything lies in the world's xy plane,
at the height of the model's lowest point, to the right of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine import colours
from ..store.objects import find

if TYPE_CHECKING:
    from ...engine.display.solids import Solid
    from ...engine.patches.flattening.flatten import FlatPatches
    from ...engine.spirals.arcs import Curve
    from ...engine.spirals.design import SpiralDesign

LOOK = "flexmaps_look"  # on the panels: what their connectors were made with
PLAIN = "plain"  # the look of those without connectors and outlines, still to be drawn as they will be cut
LINE = 0.03  # half the thickness of a drawn line, in quad edges


def collection_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Collection:
    """The collection that belongs to the object, made where it is missing; it follows the object's name."""
    found = existing(obj)
    if found is None:
        found = bpy.data.collections.new(f"FlexMaps {obj.name}")
    if found not in scene.collection.children_recursive:  # new, or appended with the object
        scene.collection.children.link(found)
    if found.name != f"FlexMaps {obj.name}":
        found.name = f"FlexMaps {obj.name}"
    found["flexmaps_owner"] = obj.name
    obj["flexmaps_collection"] = found
    return found


def existing(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """The object's collection, if it has one of its own: a duplicate of an object must not take the original's."""
    found = obj.get("flexmaps_collection")
    if not isinstance(found, bpy.types.Collection):
        return None
    name = found.get("flexmaps_owner")
    owner = bpy.data.objects.get(name) if isinstance(name, str) else None
    if owner is not None and owner != obj and owner.get("flexmaps_collection") == found:
        return None
    return found


def panels_of(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """The panels that stand beside an object."""
    found = existing(obj)
    return [] if found is None else [o for o in found.objects if o.get("flexmaps_kind") == "panels"]


def clear(obj: bpy.types.Object, kinds: tuple[str, ...] = ("panels", "seams", "outlines")) -> None:
    """Remove what was laid out beside the object, by kind."""
    found = existing(obj)
    if found is None:
        return
    for other in list(found.objects):
        if other.get("flexmaps_kind") in kinds:
            data = other.data
            bpy.data.objects.remove(other)
            if data is not None and data.users == 0:
                (bpy.data.meshes if isinstance(data, bpy.types.Mesh) else bpy.data.curves).remove(data)


def origin(obj: bpy.types.Object, scene: bpy.types.Scene, gap: float) -> np.ndarray:
    """(3,) metres: where the upper left corner of what is laid out goes: right of the model, at its lowest height."""
    box = np.array([obj.matrix_world @ v for v in map(vector, obj.bound_box)]) * scene.unit_settings.scale_length
    low, high = box.min(axis=0), box.max(axis=0)
    return np.array([high[0] + gap, high[1], low[2]])


def vector(corner: object) -> object:
    from mathutils import Vector

    return Vector(corner)


def add(
    obj: bpy.types.Object, scene: bpy.types.Scene, kind: str, name: str, data: bpy.types.ID, place: np.ndarray
) -> bpy.types.Object:
    """Put data that is in metres into the object's collection, at a place (3,) in metres."""
    unit = scene.unit_settings.scale_length
    made = bpy.data.objects.new(f"{obj.name} {name}", data)
    made["flexmaps_kind"] = kind
    made.location = place / unit
    made.scale = (1.0 / unit,) * 3
    collection_of(obj, scene).objects.link(made)
    return made


# -- flat patches ------------------------------------------------------------------------------------------------------


def show_flat(obj: bpy.types.Object, scene: bpy.types.Scene, flat: FlatPatches, centres: np.ndarray) -> None:
    """The patches as one mesh, and their outlines as lines; the two sides of a seam have the same colour.

    centres : (N, 2) metres, where the origin of every patch lies
    """
    clear(obj)
    edge = flat.layout.mesh.median_edge
    place = origin(obj, scene, 3 * edge)
    points = np.zeros((len(flat.points), 3))
    points[flat.layout.flat_corners, :2] = flat.corners + centres[flat.layout.patch_of][:, None]
    mesh = quads(f"{obj.name} panels", points, flat.layout.flat_corners)
    rgb = colours.of_patches(len(flat.layout.patches))[flat.layout.patch_of]
    paint(mesh, np.repeat(rgb, 4, axis=0))
    wear(mesh, rgb)
    add(obj, scene, "panels", "panels", mesh, place)

    sides = flat.layout.outline_sides
    ids, starts, ends = _outline(flat, sides)
    runs = [(points[np.append(starts[run], ends[run][-1:])], int(ids[run[0]])) for run in _runs(ids, starts, ends)]
    curve = lines(f"{obj.name} seams", [r[0] for r in runs], LINE * edge)
    palette = colours.of_seams(len(flat.layout.seams))  # as on the assembly sheet
    for k, colour in enumerate(palette):
        curve.materials.append(material(f"FlexMaps seam {k + 1:02d}", colour))
    curve.materials.append(material("FlexMaps border", colours.linear(colours.SEAM)))
    for spline, (_, seam) in zip(curve.splines, runs, strict=True):
        spline.material_index = seam if seam >= 0 else len(palette)
    add(obj, scene, "seams", "seams", curve, place)


def _outline(flat: FlatPatches, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seam (-1 at the border), first and last flat vertex of every side of a quad that lies on an outline."""
    quad, side = np.nonzero(sides)
    corners = flat.layout.flat_corners
    seam = flat.layout.seam_of[flat.layout.mesh.quad_edges[quad, side]]
    return seam, corners[quad, side], corners[quad, (side + 1) % 4]


def _runs(ids: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> list[np.ndarray]:
    """Sides of the outlines put together into the longest runs of one seam each, as index arrays."""
    at = {int(s): i for i, s in enumerate(starts)}
    following = np.array([at.get(int(e), -1) for e in ends], int)  # none where a closed body has no cut
    same = (following >= 0) & (ids[following] == ids)
    has_before = np.zeros(len(ids), bool)
    has_before[following[same]] = True
    result, seen = [], np.zeros(len(ids), bool)
    for first in np.concatenate([np.flatnonzero(~has_before), np.flatnonzero(has_before)]):
        run, i = [], int(first)
        while i >= 0 and not seen[i]:
            seen[i] = True
            run.append(i)
            i = int(following[i]) if same[i] else -1
        if run:
            result.append(np.array(run))
    return result


# -- data --------------------------------------------------------------------------------------------------------------


def quads(name: str, points: np.ndarray, corners: np.ndarray) -> bpy.types.Mesh:
    """A mesh of quads: points (V, 3), corners (F, 4)."""
    return polygons(name, points, corners.ravel(), np.full(len(corners), 4))


def polygons(name: str, points: np.ndarray, corners: np.ndarray, sizes: np.ndarray) -> bpy.types.Mesh:
    """A mesh of polygons: points (V, 3), corners (C,) face after face, sizes (F,).

    Quickly: as attributes, values are copied at once, where vertices and loops take them one by one.
    """
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(points))
    mesh.attributes["position"].data.foreach_set("vector", np.ascontiguousarray(points, dtype=np.float32).ravel())
    mesh.loops.add(len(corners))
    mesh.attributes[".corner_vert"].data.foreach_set("value", np.ascontiguousarray(corners, dtype=np.int32))
    mesh.polygons.add(len(sizes))
    mesh.polygons.foreach_set("loop_start", (np.cumsum(sizes) - sizes).astype(np.int32))
    mesh.attributes.new("sharp_face", "BOOLEAN", "FACE").data.foreach_set("value", np.ones(len(sizes), bool))
    mesh.update(calc_edges=True)
    return mesh


def paint(mesh: bpy.types.Mesh, rgb: np.ndarray) -> None:
    """The colour of every corner, (C, 3) linear, as the attribute that our materials and the overlay use."""
    attribute = mesh.attributes.get("flexmaps_colour")
    if attribute is None:
        attribute = mesh.attributes.new("flexmaps_colour", "FLOAT_COLOR", "CORNER")
    rgba = np.ones((len(rgb), 4), np.float32)
    rgba[:, :3] = rgb
    attribute.data.foreach_set("color", rgba.ravel())
    mesh.attributes.active_color_name = "flexmaps_colour"


def lines(name: str, polylines: list[np.ndarray], radius: float, sides: int = 8) -> bpy.types.Curve:
    """A curve object's data of round lines through points (n, 3) each, closed where first and last are the same.

    sides : of their sections, an even number of at least 4
    """
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth = radius
    curve.bevel_resolution = sides // 2 - 2
    for points in polylines:
        closed = len(points) > 2 and bool((points[0] == points[-1]).all())
        points = points[:-1] if closed else points
        spline = curve.splines.new("POLY")
        spline.points.add(len(points) - 1)
        spline.points.foreach_set("co", np.c_[points, np.ones(len(points))].astype(np.float32).ravel())
        spline.use_cyclic_u = closed
    return curve


def material(name: str, rgb: np.ndarray | None) -> bpy.types.Material:
    """A matt material of one colour (linear), or, with ``None``, of the colour attribute; made once per file."""
    found = bpy.data.materials.get(name)
    if found is not None:
        return found
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.55
    if rgb is None:
        source = made.node_tree.nodes.new("ShaderNodeAttribute")
        source.attribute_name = "flexmaps_colour"
        source.location = (-300, 200)
        made.node_tree.links.new(source.outputs["Color"], shader.inputs["Base Color"])
    else:
        colour = (*map(float, rgb), 1.0)
        shader.inputs["Base Color"].default_value = colour
        made.diffuse_color = colour
    return made


FEW = 64


def wear(data: bpy.types.Mesh | bpy.types.Curve, rgb: np.ndarray, of: np.ndarray | None = None) -> None:
    """Give the faces, or the lines, the materials of their colours (N, 3), linear: so they are seen in solid view too.

    of : (M,) int, the colour of every face or line; one each if not given

    Where there are more than ``FEW`` colours, as on maps, one material shows the colour attribute of a mesh; lines have none,
    and get fewer shades.
    """
    found, which = np.unique(np.round(rgb, 5), axis=0, return_inverse=True)
    lines = isinstance(data, bpy.types.Curve)
    shades = FEW
    while lines and len(found) > FEW:
        shades //= 2
        found, which = np.unique(np.round(rgb * shades) / shades, axis=0, return_inverse=True)
    if len(found) > FEW:
        data.materials.append(material("FlexMaps panel", None))
        return
    for name, colour in zip(colours.hexadecimal(found), found, strict=True):
        data.materials.append(material(f"FlexMaps {name}", colour))
    index = (which.ravel() if of is None else which.ravel()[of]).astype(np.int32)
    if lines:
        data.splines.foreach_set("material_index", index)
    else:  # as an attribute, which is many times as fast
        data.attributes.new("material_index", "INT", "FACE").data.foreach_set("value", index)


def glowing(name: str, rgb: np.ndarray | None) -> bpy.types.Material:
    """Like ``material``, but as bright as its colour, whatever the light."""
    known = name in bpy.data.materials
    made = material(name, rgb)
    if not known:
        shader, nodes, links = made.node_tree.nodes["Principled BSDF"], made.node_tree.nodes, made.node_tree.links
        light = nodes.new("ShaderNodeEmission")
        for link in shader.inputs["Base Color"].links:
            links.new(link.from_socket, light.inputs["Color"])
        light.inputs["Color"].default_value = shader.inputs["Base Color"].default_value
        links.new(light.outputs["Emission"], nodes["Material Output"].inputs["Surface"])
        nodes.remove(shader)
    return made


# -- spirals -----------------------------------------------------------------------------------------------------------


def show_spirals(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    design: SpiralDesign,
    shape: Solid,
    outlines: Sequence[Sequence[Curve]],
    centres: np.ndarray,
) -> Iterator[None]:
    """The panels as they will be cut: solids to look at, and the true outlines as one curve object per panel.

    Made in pieces, so that a window can live on between them. Raises ``FlexMapsError`` where the object was deleted.
    shape : of ``solids``; outlines : the curves of every panel in its patch's own frame; centres : (N, 2) metres, where
    its origin lies
    """
    uid = obj.session_uid
    clear(obj)
    place = origin(obj, scene, 3 * design.flat.layout.mesh.median_edge)
    mesh = polygons(f"{obj.name} panels", shape.vertices, shape.corners, shape.sizes)
    layout = design.flat.layout
    # connectors have their seam's colour, as on the assembly sheet
    palette = np.concatenate([colours.of_patches(len(layout.patches)), colours.of_seams(len(layout.seams))])
    row = np.where(shape.seam_of < 0, layout.patch_of[shape.quad_of], len(layout.patches) + shape.seam_of)
    paint(mesh, np.repeat(palette[row], shape.sizes, axis=0))
    wear(mesh, palette[row])
    made = add(obj, scene, "panels", "panels", mesh, place)
    if shape.flat:  # thick in renders only
        thick = made.modifiers.new("Thickness", "SOLIDIFY")
        thick.thickness, thick.offset, thick.show_viewport = design.params.thickness, -1.0, False
    for k, curves in enumerate(outlines):
        yield
        obj = find(uid)
        data = drawing(f"{obj.name} outline {k + 1}", curves)
        lift = np.array([*centres[k], 1.02 * design.params.thickness])
        made = add(obj, scene, "outlines", f"outline {k + 1}", data, place + lift)
        made.hide_render = True
        if made.name in bpy.context.view_layer.objects:  # the user may have excluded the collection
            # from afar thousands of black lines hide the panels; the eye in the outliner brings them back
            made.hide_set(True)


def drawing(name: str, curves: Sequence[Curve]) -> bpy.types.Curve:
    """Closed curves of arcs as Blender's Bezier curves, without thickness."""
    made = bpy.data.curves.new(name, "CURVE")
    made.dimensions = "2D"
    made.fill_mode = "NONE"
    made.resolution_u = 3
    for curve in curves:
        spline = made.splines.new("BEZIER")
        spline.bezier_points.add(len(curve.points) - 1)
        for attribute, values in zip(("co", "handle_left", "handle_right"), bezier(curve), strict=True):
            flat = np.c_[values, np.zeros(len(values))].astype(np.float32)
            spline.bezier_points.foreach_set(attribute, flat.ravel())
        spline.use_cyclic_u = True
    return made


def bezier(curve: Curve) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Knots, left and right handles (N, 2) of a closed curve of arcs; an arc of 90 degrees strays by 0.03 % of its radius."""
    a, b = curve.points, np.roll(curve.points, -1, axis=0)
    # seen from the chord, an arc's tangents lean by half its angle; handle = 4/3 tan(angle / 4) radius
    quarter = np.arctan(curve.bulge)
    chord = (b - a)[:, 0] + 1j * (b - a)[:, 1]
    length = np.where(
        np.abs(quarter) > 1e-9, 2.0 * curve.bulge / (3.0 * np.sin(np.where(quarter == 0, 1, 2 * quarter))), 1 / 3
    )
    out = chord * length * np.exp(-2j * quarter)
    into = chord * length * np.exp(2j * quarter)
    right = a + np.stack([out.real, out.imag], axis=1)
    left = np.roll(b - np.stack([into.real, into.imag], axis=1), 1, axis=0)
    return a, left, right
