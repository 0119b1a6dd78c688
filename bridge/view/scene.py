"""Write finished results into a Blender scene, for the main job and for scripts; uses the operators' functions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import bpy
import numpy as np

from ...engine.display import arrange, solids
from ...engine.errors import FlexMapsError
from ...engine.fabrication.sheets import CutSheets
from ...engine.params import Settings
from ...engine.patches.flattening.flatten import FlatPatches
from ...engine.progress import SILENT, Progress
from ...engine.runs import report
from ...engine.runs.result import Result
from ...engine.spirals.design import SpiralDesign
from ...engine.surface.mesh import QuadMesh
from ..store import choices as stored
from ..store import (
    equilibrium,
    fields,
    handles,
    mesh,
    modifiers,
    scans,
    settings,
    shape_keys,
    states,
    stored_report,
    supports,
)
from ..store.objects import CONVERTIBLE
from ..store.surface import ObjectSurface
from . import collection, colouring, flat_panels, materials, meshes, scan_points, scene_file, thumbnails

if TYPE_CHECKING:
    from ...engine.extras.choosing.choice import Choice
    from ...engine.extras.scanning.compare import Comparison
    from ...engine.extras.structure.analysis import StructuralAnalysis


def open_blend(path: str | Path) -> bpy.types.Object:
    """Open a .blend file, closing the open one, and return its active mesh object, or else its first mesh object.

    If it has no mesh with faces, convert a text, curve, surface or metaball to a mesh.

    Raises
    ------
    FlexMapsError : the file cannot be read, or has no object with faces
    """
    path = Path(path)
    if not path.is_file():
        raise FlexMapsError(f"There is no file {path}; give the path of a .blend file")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
    except (OSError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[-1].removeprefix("Error: ")
        raise FlexMapsError(f"{path.name} cannot be opened ({reason}); save it again in Blender") from error
    context = bpy.context
    active = context.view_layer.objects.active
    candidates = [active, *context.scene.objects] if active is not None else list(context.scene.objects)
    obj = next((o for o in candidates if o.type == "MESH" and len(o.data.polygons)), None)
    obj = obj or next(filter(None, (convert_to_mesh(o, context) for o in candidates if o.type in CONVERTIBLE)), None)
    if obj is None:
        raise FlexMapsError(f"{path.name} holds no object with faces; add a mesh, or give another file")
    if obj.mode != "OBJECT":
        obj.update_from_editmode()
    return obj


def convert_to_mesh(obj: bpy.types.Object, context: bpy.types.Context) -> bpy.types.Object | None:
    """Convert a text, curve, surface or metaball to a mesh object, and hide the original.

    Return None if the mesh would have no faces.

    Parameters
    ----------
    obj : the object to convert
    context : Blender's context
    """
    without = modifiers.describe_ignored(obj)
    with modifiers.surface_only(obj):
        data = bpy.data.meshes.new_from_object(obj.evaluated_get(context.evaluated_depsgraph_get()))
    if not len(data.polygons):
        bpy.data.meshes.remove(data)
        return None
    modifiers.write_note(data, without)
    made = bpy.data.objects.new(f"{obj.name} mesh", data)
    made.matrix_world = obj.matrix_world
    for one in obj.users_collection:
        one.objects.link(made)
    obj.hide_render = obj.hide_viewport = True
    context.view_layer.update()
    return made


def show_result(
    result: Result, name: str = "FlexMaps", job_settings: Settings | None = None, progress: Progress = SILENT
) -> bpy.types.Object:
    """Replace the open file by a new one with a job's results: the model with attributes and colours, and its panels.

    Parameters
    ----------
    result : results of the job
    name : name of the model
    job_settings : settings to give to the model
    progress : called with a fraction and a text
    """
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True, load_ui=True)
    return _fill_scene(bpy.context.scene, result, name, job_settings, progress)


def _fill_scene(
    scene: bpy.types.Scene, result: Result, name: str, job_settings: Settings | None, progress: Progress = SILENT
) -> bpy.types.Object:
    """Put a job's results into an empty scene, and return the model."""
    scene.unit_settings.length_unit = "MILLIMETERS"
    obj = add_model(scene, result.mesh, name)
    write_result(result, obj, scene, job_settings, progress)
    if shape_keys.equilibrium_key(obj.data) is not None:
        shape_keys.equilibrium_key(obj.data).value = 0.0  # type: ignore[union-attr]  # the file opens at the target
    return obj


def write_result(
    result: Result,
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    job_settings: Settings | None = None,
    progress: Progress = SILENT,
) -> None:
    """Write a job's results into an object, as the operators of all its stages would.

    Parameters
    ----------
    result : results of the job
    obj : object with the quads of the job's mesh, in the same order; its vertices are moved to the mesh's vertices
    scene : its scene
    job_settings : settings to give to the object
    progress : called with a fraction and a text

    Raises
    ------
    FlexMapsError : the object's faces differ from the quads of the job's mesh
    """
    surface = mesh.read_surface(obj, scene)
    quads, corners = result.mesh, surface.polygons.corners
    if not np.array_equal(np.unique(corners, return_inverse=True)[1].ravel(), quads.quads.ravel()):
        raise FlexMapsError(f"'{obj.name}' has other faces than when it was read; read it again")
    if job_settings is not None and hasattr(obj, "flexmaps"):
        settings.write(obj.flexmaps, job_settings)
        supports.write_loads(obj, surface, result.supports, result.force)
    moved = surface.polygons.vertices[corners] - quads.vertices[quads.quads.ravel()]
    if np.abs(moved).max() > 1e-5 * quads.median_edge:
        mesh.write_vertices(obj, surface, quads)
        surface = mesh.read_surface(obj, scene)
    offsets = np.zeros((len(quads.quads), 3)) if result.wishes is None else result.wishes.offsets(quads)
    handles.write_wishes(obj, surface.to_metres, offsets)
    stored_report.write_checks(obj.data, result.findings)
    if result.flat is not None:
        _write_flat(result, result.flat, obj, scene, surface, progress.part(0.1, 0.9))
    choice = cast("Choice | None", result.value("choice"))
    if choice is not None:
        layouts = [one.flat for one in choice.proposals]
        stored.write_cuts(obj, surface, [flat.layout.cut for flat in layouts])
        thumbnails.store_thumbnails(obj, thumbnails.draw_thumbnails(layouts))
    progress(0.9, "writing notes in the Blender file")
    if result.simulation is not None and result.limits is not None:
        equilibrium.write(obj, surface, result.simulation, result.limits)
    scan = cast("Comparison | None", result.value("scan"))
    if scan is not None:
        scans.write(obj, scan, scan_points.show_points(obj, scene, scan))
    fields.write_protected(obj, result.protected)
    examined = cast("StructuralAnalysis | None", result.value("structure"))
    if examined is not None:
        equilibrium.write_utilisation(obj, examined.utilisation)
    stored_report.write_all(obj.data, report.report_blocks(result))
    states.stamp(obj, scene)


def _write_flat(
    result: Result,
    flat: FlatPatches,
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    surface: ObjectSurface,
    progress: Progress,
) -> None:
    """Write seams, flat patches and spirals into the object, and make the objects beside the model."""
    progress(0.0, "placing panels side by side")
    centres = arrange.arrange_patches(flat)
    progress(0.1, "drawing flat panels in the Blender file")
    mesh.write_flat(obj, surface, flat, centres)
    colouring.store_colours(obj, "PATCH")
    if result.design is None:
        mesh.shelve_design(obj)
        flat_panels.show_flat(obj, scene, flat, centres)
        return
    mesh.write_design(obj, surface, result.design)
    progress(0.2, "building the solids of the panels")
    cut = result.sheets
    design = result.design if cut is None or cut.base is None else cut.base.design
    shape = solids.make_solids(design, centres, () if cut is None else cut.connections.tips)
    drawing = flat_panels.PanelDrawing(design, "", centres, shape, _outlines(result.sheets, result.design))
    for _ in drawing.show(obj, scene):
        progress(0.6, "drawing panels in the Blender file")


def _outlines(sheets: CutSheets | None, design: SpiralDesign) -> list[tuple[Any, ...]]:
    if sheets is not None:
        return [(panel.outline, *panel.holes) for panel in sheets.panels if panel.patch >= 0]
    return [(o.outer, *o.holes) for o in design.outlines(solids.DRAWING_TOLERANCE)]


def add_model(scene: bpy.types.Scene, quads: QuadMesh, name: str) -> bpy.types.Object:
    """Add a surface to a scene as a mesh object, which is selected and active.

    Parameters
    ----------
    scene : the scene
    quads : the surface, metres
    name : name of the object
    """
    data = meshes.make_quad_mesh(name, quads.vertices / scene.unit_settings.scale_length, quads.quads)
    data.materials.append(materials.plain_material("FlexMaps panel", None))
    obj = bpy.data.objects.new(name, data)
    scene.collection.objects.link(obj)
    layer = scene.view_layers[0]
    layer.objects.active = obj
    obj.select_set(True, view_layer=layer)
    layer.update()
    return obj


def save_file(path: str | Path) -> None:
    """Save a compressed copy of the open file, with its 3D views framed on all objects, replacing an existing file.

    Raises
    ------
    FlexMapsError : the file cannot be written
    """
    _frame_views()
    path = Path(path).absolute()  # Blender's working folder may differ
    path.unlink(missing_ok=True)  # otherwise Blender keeps the existing file as a backup beside it
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, copy=True, check_existing=False)
    except (OSError, RuntimeError) as error:
        raise FlexMapsError(f"{path} cannot be written; choose another folder or make room on the disk") from error


def save_result(path: str | Path, result: Result, name: str, job_settings: Settings | None = None) -> None:
    """Save a job's results as a .blend file of their own; the open file does not change.

    Parameters
    ----------
    path : the .blend file
    result : results of the job
    name : name of the model
    job_settings : settings to give to the model

    Raises
    ------
    FlexMapsError : the file cannot be written
    """
    path = Path(path).absolute()
    there = _all_data()
    scene = bpy.data.scenes.new(name)
    try:
        _fill_scene(scene, result, name, job_settings)
        path.unlink(missing_ok=True)
        try:
            scene_file.write_scene(path, scene, compress=True)
        except (OSError, RuntimeError) as error:
            raise FlexMapsError(f"{path} cannot be written; choose another folder or make room on the disk") from error
    finally:
        bpy.data.batch_remove(_all_data() - there)


def _all_data() -> set[bpy.types.ID]:
    """Return all data-blocks of the open file."""
    groups = (getattr(bpy.data, prop.identifier) for prop in bpy.data.bl_rna.properties if prop.type == "COLLECTION")
    return {one for group in groups for one in group if isinstance(one, bpy.types.ID)}


def _frame_views() -> None:
    """Frame all objects in the 3D views, so that the file opens with everything in view, even a small piece."""
    objects = bpy.context.scene.objects
    boxes = [collection.bounding_corners(o) for o in objects]
    if not boxes:
        return
    points = np.concatenate(boxes)
    low, high = points.min(axis=0), points.max(axis=0)
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type != "VIEW_3D" or space.region_3d is None:
                    continue
                space.clip_start = 0.001 * float(np.linalg.norm(high - low))
                space.shading.color_type = "VERTEX"
                space.region_3d.view_location = 0.5 * (low + high)
                space.region_3d.view_distance = 1.2 * float(np.linalg.norm(high - low))
