"""Preview: the assembled piece as an object beside its model, with all arms, bent as in the last simulation.

Only the operator *Show the piece* rebuilds it, and no stage reads it. Coordinates are in metres.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine.arrays import Float, Int
from ...engine.display import arrange
from ...engine.errors import FlexMapsError
from ...engine.progress import SILENT, Progress
from ..store import attributes
from . import collection, colouring, curves, materials, meshes

if TYPE_CHECKING:
    from ...engine.display.base_mesh import BaseMesh
    from ...engine.display.panel_mesh import PanelMesh
    from ...engine.fabrication.connectors.tips import Tip
    from ...engine.fabrication.standing.base import Base
    from ...engine.mechanics.arms.bent import BentArms
    from ...engine.mechanics.assembly import Pose
    from ...engine.params import ObjectSettings, PreviewParams
    from ...engine.spirals.design import SpiralDesign

KIND, NAME = "assembled", "Assembled"
BASE, BASE_NAME = "base", "Base"
PLATE_GREY = 0.42  # linear grey of the base's plates, which have no patch colour
FIGURES_KEY = "flexmaps_preview"  # custom property of the object: its figures as JSON
WIRE_POINTS = 9  # points along an arm drawn as a wire; more is smoother and slower; chosen by eye


@dataclass(frozen=True, eq=False)
class AssembledPiece:
    """An assembled piece, computed and ready to be shown.

    design : the spirals
    pose : pose of their hubs
    panels : mesh of the arms and hubs; None if arms are drawn as wires
    vertices : vertices of the mesh (V, 3), or points of the wires (A, WIRE_POINTS, 3), metres
    seconds : computing time
    base : mesh of the base's plates, or None
    """

    design: SpiralDesign
    pose: Pose
    panels: PanelMesh | None
    vertices: Float[np.ndarray, "*vertices 3"]
    seconds: float
    base: BaseMesh | None = None


def connector_tips(design: SpiralDesign, settings: ObjectSettings, progress: Progress = SILENT) -> tuple[Tip, ...]:
    """Return the arm ends with connectors; () if the settings of the preview ask for no connectors.

    Parameters
    ----------
    design : the spirals
    settings : settings of the object
    progress : called with a fraction and a text

    Raises
    ------
    FlexMapsError : connectors cannot be made with these settings
    """
    if not settings.preview.joined:
        return ()
    from ...engine.display.solids import DRAWING_TOLERANCE
    from ...engine.fabrication.connectors.connect import connect

    return connect(design, settings.connect, DRAWING_TOLERANCE, progress, settings.cut.mill).tips


def make_base(
    design: SpiralDesign, pose: Pose, supports: Int[np.ndarray, " supports"] | None, settings: ObjectSettings
) -> Base | None:
    """Return the base of a piece.

    Return None if the settings ask for none or it cannot be made; Export reports the reason.

    Parameters
    ----------
    design : the spirals
    pose : pose of their hubs
    supports : indices of the quads that are held
    settings : settings of the object
    """
    if settings.base.base == "none":
        return None
    from ...engine.runs.steps import make_base_or_eyelets

    try:
        return make_base_or_eyelets(design, pose, supports, settings)
    except FlexMapsError:
        return None


def build_piece(
    design: SpiralDesign,
    pose: Pose,
    detail: str,
    tips: Sequence[Tip] = (),
    progress: Progress = SILENT,
    base: Base | None = None,
) -> AssembledPiece:
    """Compute the geometry of an assembled piece; touches no Blender data, so it may run in a thread.

    Parameters
    ----------
    design : the spirals
    pose : pose of their hubs
    detail : "LINES" for wires, or a key of ``engine.display.panel_mesh.DETAILS``
    tips : arm ends with connectors
    progress : called with a fraction and a text
    base : base of the piece; adds its plates, and the feet to the spirals
    """
    from ...engine.display.base_mesh import make_base_mesh
    from ...engine.display.panel_mesh import DETAILS, make_panel_mesh
    from ...engine.mechanics.arms.bent import bend_arms

    began = time.perf_counter()
    arms = bend_arms(design, pose, progress=progress.part(0.0, 0.4))
    below = None if base is None or not base.plates else make_base_mesh(base)
    if detail == "LINES":
        return AssembledPiece(design, pose, None, wire_points(design, arms), time.perf_counter() - began, below)
    design = design if base is None else base.design
    panels = make_panel_mesh(design, DETAILS[detail], tips, progress.part(0.4, 0.8))
    progress(0.8, "Drawing the arms")
    vertices = panels.vertices_at_pose(arms, pose)
    return AssembledPiece(design, pose, panels, vertices, time.perf_counter() - began, below)


def wire_points(design: SpiralDesign, arms: BentArms) -> Float[np.ndarray, "arms points 3"]:
    """Return ``WIRE_POINTS`` points on each bent arm's centre line, from the joint to the hub's centre, metres."""
    from ...engine.mechanics.arms.bent import flat_centre

    arm = np.repeat(np.arange(4 * len(design.width)), WIRE_POINTS)
    begin = np.where(design.is_absent, design.arm_starts, 0.0).reshape(-1, 1)
    t = (begin + (1.0 - begin) * np.linspace(0.0, 1.0, WIRE_POINTS)).ravel()
    flat = flat_centre(design, arm // 4, arm % 4, t[:, None])[:, 0]
    return arms.at(arm, t, flat)[0].reshape(-1, WIRE_POINTS, 3)


# -- the object --------------------------------------------------------------------------------------------------------


def find_piece(obj: bpy.types.Object) -> bpy.types.Object | None:
    """Return the object that shows a model's assembled piece, or None."""
    return next(iter(collection.objects_of_kinds(obj, KIND)), None)


def read_figures(obj: bpy.types.Object) -> dict[str, Any]:
    """Return the figures of a model's assembled piece; {} without a piece.

    The keys are "spirals" and "triangles" (counts), "seconds" (computing time) and "simulated" (whether the pose is
    from a simulation).
    """
    piece = find_piece(obj)
    return json.loads(piece.get(FIGURES_KEY, "{}")) if piece is not None else {}


def show_piece(
    obj: bpy.types.Object, scene: bpy.types.Scene, piece: AssembledPiece, params: PreviewParams, simulated: bool
) -> bpy.types.Object:
    """Make the object of the assembled piece beside its model, replacing an earlier one, and return it.

    Parameters
    ----------
    obj, scene : the model and its scene
    piece : the piece, from ``build_piece``
    params : settings of the preview
    simulated : whether the pose is from a simulation

    Raises
    ------
    FlexMapsError : the model has no values for the chosen colours
    """
    began = time.perf_counter()
    rgb = None if params.colour == "MATERIAL" else quad_colours(obj, params.colour)
    points = piece.vertices.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    anchor = 0.5 * (low + high)
    name = f"{obj.name} {NAME}"
    moved = replace(piece, vertices=piece.vertices - anchor)
    if piece.panels is None:
        data = _wire_curve(name, moved)
    else:
        data = piece_mesh(name, piece.panels, moved.vertices, rgb)
        for kind, domain_values in _face_values(obj, piece.panels.quad_of).items():
            meshes.put_attribute(data, kind, "FACE", domain_values)
    if rgb is None:
        data.materials.append(materials.sheet_material(obj.flexmaps.material.material))
    else:
        materials.assign_colours(
            data, rgb, np.arange(4 * len(rgb)) // 4 if piece.panels is None else piece.panels.quad_of
        )
    place = anchor + shift_beside(obj, scene, low, high) * (params.place == "BESIDE")
    made = _put_object(obj, scene, data, place)
    collection.clear(obj, (BASE,))
    if piece.base is not None:
        stand = plates_mesh(f"{obj.name} {BASE_NAME}", piece.base, -anchor)
        collection.add(obj, scene, BASE, BASE_NAME, stand, place)
    triangles = 0 if piece.panels is None else piece.panels.triangle_count
    figures = {
        "spirals": len(piece.design.width),
        "triangles": triangles,
        "seconds": round(piece.seconds + time.perf_counter() - began, 3),
        "simulated": simulated,
    }
    made[FIGURES_KEY] = json.dumps(figures)
    return made


def shift_beside(
    obj: bpy.types.Object, scene: bpy.types.Scene, low: Float[np.ndarray, " 3"], high: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Return the shift that puts a piece to the left of its model, at the model's lowest height, metres.

    Parameters
    ----------
    obj, scene : the model and its scene
    low, high : lower and upper corner of the piece's bounding box, metres
    """
    box = collection.bounding_corners(obj) * scene.unit_settings.scale_length
    gap = 0.15 * float(np.linalg.norm(high - low))
    middle = 0.5 * (box.min(axis=0) + box.max(axis=0) - low - high)
    return np.array([box[:, 0].min() - gap - high[0], middle[1], box[:, 2].min() - low[2]])


def _put_object(
    obj: bpy.types.Object, scene: bpy.types.Scene, data: bpy.types.ID, position: Float[np.ndarray, " 3"]
) -> bpy.types.Object:
    """Put data into the object of the assembled piece, and return it; an existing object keeps its other properties."""
    made = find_piece(obj)
    if made is not None and made.type != ("MESH" if isinstance(data, bpy.types.Mesh) else "CURVE"):
        collection.clear(obj, (KIND, BASE))
        made = None
    if made is None:
        return collection.add(obj, scene, KIND, NAME, data, position)
    before, made.data = made.data, data
    if before.users == 0:
        bpy.data.batch_remove([before])
    unit = scene.unit_settings.scale_length
    made.name, made.location, made.rotation_euler, made.scale = data.name, position / unit, (0, 0, 0), (1.0 / unit,) * 3
    return made


def quad_colours(obj: bpy.types.Object, kind: str) -> Float[np.ndarray, "quads 3"]:
    """Return the linear colours of the quads that the overlay shows for a kind of value.

    Parameters
    ----------
    obj : the model
    kind : a key of ``colouring.KINDS``

    Raises
    ------
    FlexMapsError : the model has no values of this kind, because their stage has not run
    """
    with attributes.readable_mesh(obj) as mesh:
        values = attributes.read(mesh, colouring.KINDS[kind].attribute)
    if values is None:
        raise FlexMapsError(f"There is no {colouring.KINDS[kind].label.lower()} to show yet; press Simulate first")
    return colouring.colours_and_legend(obj, kind, values)[0]


def _face_values(obj: bpy.types.Object, quad_of: Int[np.ndarray, " faces"]) -> dict[str, np.ndarray]:
    """Return attributes for the piece's faces: the quad of every face, and the model's values of that quad."""
    of_faces = {"flexmaps_quad": quad_of}
    with attributes.readable_mesh(obj) as mesh:
        for name in ("patch", "strain_energy", "strain", "distance"):
            values = attributes.read(mesh, attributes.PREFIX + name)
            if values is not None:
                of_faces[attributes.PREFIX + name] = values[quad_of]
    return of_faces


# -- data of the object -----------------------------------------------------------------------------------------------


def piece_mesh(
    name: str, panels: PanelMesh, vertices: Float[np.ndarray, "vertices 3"], rgb: Float[np.ndarray, "quads 3"] | None
) -> bpy.types.Mesh:
    """Make a Blender mesh of the panels.

    Parameters
    ----------
    name : name of the mesh
    panels : faces of the panels
    vertices : (V, 3), metres, bent or flat
    rgb : linear colours of the quads; None for no colours
    """
    mesh = meshes.make_polygon_mesh(name, vertices, panels.corners, panels.sizes)
    centres = arrange.arrange_patches(panels.design.flat)
    uv = (1e3 * panels.flat_vertices(centres)[:, :2]).astype(np.float32)[panels.corners]
    meshes.put_attribute(mesh, "flexmaps_flat", "CORNER", uv)
    if rgb is not None:
        rgba = np.ones((len(panels.vertex_quad), 4), np.float32)
        rgba[:, :3] = rgb[panels.vertex_quad]
        meshes.put_attribute(mesh, "flexmaps_colour", "POINT", rgba)
        mesh.attributes.active_color_name = "flexmaps_colour"
    meshes.shade_arms(mesh, panels.section)
    return mesh


def plates_mesh(name: str, base: BaseMesh, shift: Float[np.ndarray, " 3"] | float = 0.0) -> bpy.types.Mesh:
    """Make a grey mesh of a base's plates, shifted by a vector in metres."""
    vertices, faces = base.vertices + shift, base.triangles
    data = meshes.make_polygon_mesh(name, vertices, faces.ravel(), np.full(len(faces), 3))
    data.materials.append(materials.plain_material("FlexMaps base", np.full(3, PLATE_GREY)))
    return data


def _wire_curve(name: str, piece: AssembledPiece) -> bpy.types.Curve:
    """Make a curve of the arms as wires, as thick as the mean arm width; four-sided, because there are thousands."""
    return curves.make_lines(name, list(piece.vertices), 0.5 * float(piece.design.width.mean()), sides=4)
