"""Render pictures of a piece: its layout, its panels, its simulated shape, or several of them side by side."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Bool, Float, Int
from ...engine.display import arrange
from ...engine.errors import FlexMapsError
from ...engine.params import ObjectSettings, RenderParams
from ..store import attributes, mesh, pose, settings, shape_keys, snapshot, supports, vertex_positions
from . import animation, collection, colouring, curves, materials, meshes, preview
from .picture_legend import add_legend
from .studio import Studio, points_of, studio

if TYPE_CHECKING:
    from ...engine.fabrication.connectors.tips import Tip
    from ...engine.fabrication.standing.base import Base
    from ...engine.mechanics.assembly import Pose
    from ...engine.spirals.design import SpiralDesign

SIZE = (1280, 720)  # width and height of the main job's pictures, pixels
SAMPLES = 8  # samples per pixel before denoising; more is less noisy and slower; chosen by eye
Size = tuple[int, int] | None
ABOVE, ASIDE = (0.0, 0.0, 1.0), (0.62, -1.0, 0.80)  # directions from the piece to the camera
CLAY = (0.80, 0.79, 0.76)  # sRGB of a target without colours
GAP = 0.12  # gap between objects side by side, as a fraction of the widest object's width; chosen by eye
# Width of the panels in front, as a fraction of the total width of the objects behind; by eye
PANELS_WIDTH = 1.05
# Number of spirals from which arms are drawn in medium detail; larger is rounder and slower; by eye
MANY_SPIRALS = 1200


def render_layout(obj: bpy.types.Object, path: str | Path, size: Size = None, samples: int | None = None) -> None:
    """Render the target in the colours of its patches, with quad edges as thin lines and seams as dark lines.

    Parameters
    ----------
    obj : the model
    path : the PNG file
    size : pixels across and down; default is ``SIZE``
    samples : samples per pixel; default is ``SAMPLES``
    """
    with studio(size or SIZE, samples or SAMPLES) as studio_scene:
        _add_target(studio_scene, obj, "PATCH")
        studio_scene.set_up(ASIDE)
        studio_scene.render_picture(path)


def render_panels(obj: bpy.types.Object, path: str | Path, size: Size = None, samples: int | None = None) -> None:
    """Render the flat panels straight from above; without spirals, render the flat patches.

    Parameters
    ----------
    obj : the model
    path : the PNG file
    size : pixels across and down; default is ``SIZE``
    samples : samples per pixel; default is ``SAMPLES``

    Raises
    ------
    FlexMapsError : there are no flat patches yet
    """
    with studio(size or SIZE, samples or SAMPLES) as studio_scene:
        design = stored_design(obj)
        own = collection.find(obj)
        shown = [o for o in own.objects if not o.hide_render] if own is not None else []
        solid = next((o for o in shown if o.get("flexmaps_kind") == "panels" and not o.modifiers), None)
        if design is not None and solid is not None:
            studio_scene.add_data(solid.data.copy())  # the panels beside the model, drawn with their connectors
        elif design is not None:
            _add_panels(studio_scene, obj, design, "PATCH")
        else:
            if not shown:
                raise FlexMapsError("There are no flat panels yet; press Lay out the panels first")
            for other in shown:
                studio_scene.add_object(other)
        studio_scene.set_up(ABOVE)
        studio_scene.render_picture(path)


def render_shape(obj: bpy.types.Object, path: str | Path, size: Size = None, samples: int | None = None) -> None:
    """Render the assembled piece in its simulated shape, coloured by distance to the target, with a legend.

    Parameters
    ----------
    obj : the model
    path : the PNG file
    size : pixels across and down; default is ``SIZE``
    samples : samples per pixel; default is ``SAMPLES``

    Raises
    ------
    FlexMapsError : there is no simulated shape yet
    """
    design = stored_design(obj)
    if shape_keys.equilibrium_key(obj.data) is None or design is None:
        raise FlexMapsError("There is no simulated shape yet; press Simulate first")
    with studio(size or SIZE, samples or SAMPLES) as studio_scene:
        _add_assembled(studio_scene, obj, design, "DISTANCE")
        studio_scene.set_up(ASIDE)
        add_legend(studio_scene, colouring.legend_of(obj, "DISTANCE"))
        studio_scene.render_picture(path)


def render_overview(obj: bpy.types.Object, path: str | Path) -> None:
    """Render target, assembled piece and flat panels in one picture, in the colours of the patches.

    Parameters
    ----------
    obj : the model
    path : the PNG file

    Raises
    ------
    FlexMapsError : there are no spirals yet
    """
    render_together(obj, path, RenderParams(pixels_x=SIZE[0], samples=SAMPLES))


def render_together(obj: bpy.types.Object, path: str | Path, params: RenderParams, pack: Path | None = None) -> None:
    """Render target, assembled piece and flat panels on a common ground; the settings choose which of them.

    Connectors are drawn if the settings of the preview ask for them.

    Parameters
    ----------
    obj : the model
    path : the PNG file
    params : settings of the picture
    pack : .blend file to write the scene to, instead of rendering it, see ``studio``

    Raises
    ------
    FlexMapsError : there are no spirals or no values to colour by, or the settings choose nothing
    """
    design = stored_design(obj)
    if design is None:
        raise FlexMapsError("There are no spirals yet; press Spirals first")
    if not (params.target or params.assembled or params.panels):
        raise FlexMapsError("Nothing is to be shown; switch Target, Assembled or Panels on")
    finish = obj.flexmaps.material.material if params.finish == "SHEET" else params.finish
    size = (params.pixels_x, max(params.pixels_y, 16))
    tips = (
        preview.connector_tips(design, settings.read(obj.flexmaps, ObjectSettings))
        if params.assembled or params.panels
        else ()
    )
    with studio(
        size, params.samples, "GREY" if finish in materials.APPEARANCES else "WHITE", pack=pack
    ) as studio_scene:
        standing = []
        if params.target:
            standing.append(_add_target(studio_scene, obj, finish))
        if params.assembled:
            standing.append(_add_assembled(studio_scene, obj, design, finish, tips))
        wide, depth = _line_up(standing, params.azimuth)
        if params.panels:
            flat = _add_panels(
                studio_scene, obj, design, finish, tips, PANELS_WIDTH * wide if standing else None, params.azimuth
            )
            _place_in_front(flat, wide, depth, params.azimuth)
        studio_scene.set_up(_camera_direction(params), tight=not params.pixels_y)
        if finish in colouring.KINDS and finish != "PATCH":
            add_legend(studio_scene, colouring.legend_of(obj, finish))
        studio_scene.render_picture(path)


def render_film(obj: bpy.types.Object, path: str | Path, params: RenderParams, pack: Path | None = None) -> int:
    """Render the animation of the assembly as PNG files or as a film, and return the number of frames.

    Parameters
    ----------
    obj : the model
    path : the .mp4 file; otherwise frames are written as PNG files, numbered after this path's name
    params : settings of the picture
    pack : .blend file to write the scene to, instead of rendering it, see ``studio``

    Raises
    ------
    FlexMapsError : there is no animation
    """
    shown, scene = animation.find_objects(obj), bpy.context.scene
    if not shown:
        raise FlexMapsError("There is no animation yet; press Animate the assembly first")
    frames = (scene.frame_start, animation.last_frame(obj))
    with studio(
        (params.pixels_x, params.pixels_y or params.pixels_x * 9 // 16), params.samples, pack=pack
    ) as studio_scene:
        for other in shown:
            studio_scene.add_object(other)
        seen = studio_scene.points_in(np.linspace(*frames, 24).astype(int).tolist())
        studio_scene.set_up(_camera_direction(params), seen)
        studio_scene.render_film(path, frames, (scene.render.fps, scene.render.fps_base))
    return frames[1] - frames[0] + 1


def _camera_direction(params: RenderParams) -> tuple[float, float, float]:
    """Return the unit vector from the piece to the camera, for the settings' azimuth and elevation."""
    c, s = np.cos(params.elevation), np.sin(params.elevation)
    return c * np.sin(params.azimuth), -c * np.cos(params.azimuth), s


def stored_design(obj: bpy.types.Object) -> SpiralDesign | None:
    """Return the spirals stored in an object; None if it has no usable ones."""
    result = snapshot.read_piece(obj).result
    return None if result is None else result.design


# -- content of pictures ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ObjectGroup:
    """Objects in the studio that are moved together; its size is that of its meshes, without its lines (curves)."""

    objects: tuple[bpy.types.Object, ...]

    def bounds(self, azimuth: float) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """Return the lower and upper corner of the meshes' bounding box in ``_camera_axes(azimuth)``, metres."""
        bodies = [points_of(obj) for obj in self.objects if obj.type == "MESH"]
        there = np.concatenate(bodies) @ _camera_axes(azimuth).T
        return there.min(axis=0), there.max(axis=0)

    def move(self, shift: Float[np.ndarray, " 3"], azimuth: float) -> None:
        """Shift the group by a vector in the axes of ``_camera_axes(azimuth)``, metres."""
        for obj in self.objects:
            obj.location = np.array(obj.location) + shift @ _camera_axes(azimuth)


def _camera_axes(azimuth: float) -> Float[np.ndarray, "3 3"]:
    """Return the unit vectors to the right, to the back and up, as seen by a level camera at an azimuth, as rows."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _line_up(groups: list[ObjectGroup], azimuth: float) -> tuple[float, float]:
    """Place groups side by side on a common ground, seen from an azimuth; return their width and depth in metres."""
    boxes = [group.bounds(azimuth) for group in groups]
    gap = GAP * max((float((high - low)[0]) for low, high in boxes), default=0.0)
    at = depth = 0.0
    for group, (low, high) in zip(groups, boxes, strict=True):
        group.move(np.array([at - low[0], -0.5 * (low + high)[1], -low[2]]), azimuth)
        at += float((high - low)[0]) + gap
        depth = max(depth, float((high - low)[1]))
    return max(at - gap, 0.0), depth


def _place_in_front(panels: ObjectGroup, width: float, depth: float, azimuth: float) -> None:
    """Place the panels on the ground in front of the other groups, whose width and depth are given in metres."""
    low, high = panels.bounds(azimuth)
    shift = 0.5 * width - 0.5 * (low + high)[0]
    panels.move(np.array([shift, -0.5 * depth - GAP * width - high[1], -low[2]]), azimuth)


def _set_finish(data: bpy.types.ID, finish: str) -> None:
    """Give mesh data a material: a sheet's if ``finish`` is a key of ``APPEARANCES``, else its own colour attribute."""
    chosen = (
        materials.sheet_material(finish)
        if finish in materials.APPEARANCES
        else materials.plain_material("FlexMaps panel", None)
    )
    data.materials.append(chosen)


def _colours(obj: bpy.types.Object, finish: str) -> Float[np.ndarray, "quads 3"] | None:
    """Return linear colours of the quads; None if ``finish`` is a sheet's material."""
    return None if finish in materials.APPEARANCES else preview.quad_colours(obj, finish)


def _add_target(studio_scene: Studio, obj: bpy.types.Object, finish: str) -> ObjectGroup:
    """Add the target with its quad edges, seams and borders as lines; coloured by patch if ``finish`` is "PATCH"."""
    surface = mesh.read_surface(obj, bpy.context.scene)
    polygons = surface.polygons
    data = meshes.make_polygon_mesh("FlexMaps target", polygons.vertices, polygons.corners, polygons.sizes)
    with attributes.readable_mesh(obj) as own:
        known = attributes.read(own, colouring.KINDS["PATCH"].attribute) is not None
    if known and finish == "PATCH":
        meshes.set_corner_colours(data, np.repeat(preview.quad_colours(obj, "PATCH"), polygons.sizes, axis=0))
        data.materials.append(materials.plain_material("FlexMaps panel", None))
    else:
        data.materials.append(materials.plain_material("FlexMaps clay", colours.srgb_to_linear(np.array(CLAY))))
    made = studio_scene.add_data(data)
    pairs, count = np.sort(surface.edge_vertices, axis=1), np.array([len(polygons.vertices), 1])
    sides = np.stack([polygons.corners, polygons.corners[polygons.next_corner]], axis=1)
    number, used = np.unique(np.sort(sides, axis=1) @ count, return_counts=True)
    border = np.isin(pairs @ count, number[used == 1])
    return ObjectGroup((made, *_add_lines(studio_scene, polygons.vertices, pairs, border | surface.seams)))


def _add_assembled(
    studio_scene: Studio, obj: bpy.types.Object, design: SpiralDesign, finish: str, tips: Sequence[Tip] = ()
) -> ObjectGroup:
    """Add the assembled piece, bent as in the last simulation; without a simulation, hubs lie on the target."""
    rgb = _colours(obj, finish)
    built = preview.build_piece(design, _hub_pose(obj, design), _detail(design), tips, base=_make_base(obj, design))
    assert built.panels is not None
    data = preview.piece_mesh("FlexMaps assembled", built.panels, built.vertices, rgb)
    _set_finish(data, finish)
    piece = studio_scene.add_data(data)
    if built.base is None:
        return ObjectGroup((piece,))
    return ObjectGroup((piece, studio_scene.add_data(preview.plates_mesh("FlexMaps base", built.base))))


def _hub_pose(obj: bpy.types.Object, design: SpiralDesign) -> Pose:
    """Return the hubs' pose of the last simulation; without a simulation, their pose on the target."""
    from ...engine.mechanics.assembly import target_pose

    stand = pose.read(obj, vertex_positions.to_metres(obj, bpy.context.scene))
    return target_pose(design.flat.layout.mesh, design.flat.corners) if stand is None else stand


def _make_base(obj: bpy.types.Object, design: SpiralDesign) -> Base | None:
    """Return the base; None if the settings ask for none or it cannot be made."""
    used = settings.read(obj.flexmaps, ObjectSettings)
    if used.base.base == "none":
        return None
    held = supports.read_supports(obj, mesh.read_surface(obj, bpy.context.scene), used.loads)
    return preview.make_base(design, _hub_pose(obj, design), held, used)


def _add_panels(
    studio_scene: Studio,
    obj: bpy.types.Object,
    design: SpiralDesign,
    finish: str,
    tips: Sequence[Tip] = (),
    width: float | None = None,
    azimuth: float = 0.0,
) -> ObjectGroup:
    """Add the flat panels side by side, about ``width`` metres wide and turned towards a camera at an azimuth."""
    from ...engine.display.panel_mesh import DETAILS, make_panel_mesh

    rgb, base = _colours(obj, finish), _make_base(obj, design)
    design = design if base is None else base.design
    made = make_panel_mesh(design, DETAILS[_detail(design)], tips)
    flat = made.flat_vertices(arrange.arrange_patches(design.flat, width)) @ _camera_axes(azimuth)
    data = preview.piece_mesh("FlexMaps panels", made, flat, rgb)
    _set_finish(data, finish)
    return ObjectGroup((studio_scene.add_data(data),))


def _detail(design: SpiralDesign) -> str:
    return "FINE" if len(design.width) < MANY_SPIRALS else "MEDIUM"


def _add_lines(
    studio_scene: Studio,
    points: Float[np.ndarray, "vertices 3"],
    pairs: Int[np.ndarray, "edges 2"],
    bold: Bool[np.ndarray, " edges"],
) -> Iterable[bpy.types.Object]:
    """Add edges as thin round lines; edges in the mask ``bold`` are thicker and darker."""
    edge = float(np.median(np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)))
    thick = max(0.05 * edge, 0.0022 * float(np.linalg.norm(np.ptp(points, axis=0))))
    for name, chosen, radius, grey in (("quad", ~bold, 0.014 * edge, 0.32), ("seam", bold, thick, 0.1)):
        curve = curves.make_lines(
            f"FlexMaps {name} lines", [points[p] for p in curves.join_chains(pairs[chosen])], radius
        )
        colour = colours.srgb_to_linear(np.array([grey, grey, 1.25 * grey]))
        curve.materials.append(materials.plain_material(f"FlexMaps {name} line", colour))
        yield studio_scene.add_data(curve, framed=False)
