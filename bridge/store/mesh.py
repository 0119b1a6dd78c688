"""Convert between a Blender mesh and the engine's types; no other module does.

Between two stages, the Blender mesh stores the piece: UV seams are the cuts of the layout, a UV map holds the flat
patches, face and corner attributes hold values of quads:

 seams             edge    where the surface is cut, editable by hand
 flexmaps_seam     edge    number of the seam that a cut edge of the flat patches belongs to, -1 elsewhere
 flexmaps_flat     corner  UV map: the flat patches side by side, millimetres
 flexmaps_patch    face    number of the patch
 flexmaps_energy   face    distortion E
 flexmaps_square   face    deviation of the flat quad from a square, Esq
 flexmaps_width    corner  width of the arm that ends at the side from this corner to the face's next corner, millimetres;
                           older files store one width per face, for all four arms
 flexmaps_twist    face    twist of the spiral, degrees
 flexmaps_stiffness face   stiffness of the spiral, N mm/rad, if it was computed; any change of the design removes it
 flexmaps_protect  face    1 where Optimise must not change the spiral
 flexmaps_last_width, flexmaps_last_twist    width and twist before the patches were cut anew: a start for new spirals
 flexmaps_colour   corner  colours of the overlay, for renders

``equilibrium`` lists the attributes that a simulation adds.

The engine orders corners counter-clockwise seen from outside; for a mirrored object this reverses Blender's order. So
widths stay at their sides when the user applies a mirroring and turns the normals outwards again. *Flip Normals* alone
turns the surface inside out, so the spirals must be made anew.

Engine coordinates are world coordinates in metres.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...engine.arrays import Float, Int
from ...engine.errors import FlexMapsError
from ...engine.params import SpiralParams
from ...engine.patches.flattening.flatten import FlatPatches, with_energies
from ...engine.patches.layout import PatchLayout
from ...engine.spirals.design import SpiralDesign
from ...engine.spirals.fabricable import make_fabricable, unfabricable_quads
from ...engine.surface.far import rounding_step
from ...engine.surface.mesh import PolygonMesh, QuadMesh
from . import attributes, equilibrium, modifiers, shape_keys, stored_report, vertex_positions
from .columns import column
from .objects import modifier_problem, usage_problem
from .surface import ObjectSurface
from .vertex_positions import evaluated_object, to_metres

FLAT_NAMES = ("seam", "flat", "patch", "energy", "square")
DESIGN_NAMES = ("width", "twist")
LAST_NAMES = ("last_width", "last_twist")
NAMES = FLAT_NAMES + DESIGN_NAMES + LAST_NAMES + ("stiffness",)  # written by stages; the user's marks are not included
DAMAGED = "The attribute '{}' holds other values than FlexMaps writes and is left out: run its stage again"
COARSE = "Vertices are stored to {:.2g} mm at this distance from the object's origin, so that details are lost: model near the origin and move the object"
DAMAGED_REPORT = "The notes of earlier stages are damaged and are left out: run the stages again"
OLD_REPORT = (
    "An early version of FlexMaps made the notes of earlier stages, and they are left out: run the stages again"
)


# -- surface ---------------------------------------------------------------------------------------------------------


def read_surface(obj: bpy.types.Object, scene: bpy.types.Scene) -> ObjectSurface:
    """Read an object's mesh into the engine's arrays.

    Parameters
    ----------
    obj, scene : the object, and the scene with its units

    Raises
    ------
    FlexMapsError where the object is not a usable mesh, or modifiers change its faces.
    """
    problem = usage_problem(obj) or modifier_problem(obj)
    if problem:
        raise FlexMapsError(problem)
    seen = vertex_positions.read_with_user_keys(obj, scene)
    with attributes.readable_mesh(obj) as mesh:
        return _surface(mesh, obj.session_uid, to_metres(obj, scene), seen)


def read_in_any_mode(obj: bpy.types.Object, scene: bpy.types.Scene) -> ObjectSurface:
    """Read an object's mesh in any mode, also while the user paints or sculpts, and without checking modifiers.

    Parameters
    ----------
    obj, scene : the object, and the scene with its units
    """
    seen = None if obj.data.is_editmode else vertex_positions.read_with_user_keys(obj, scene)
    with attributes.readable_mesh(obj) as mesh:
        return _surface(mesh, obj.session_uid, to_metres(obj, scene), seen)


def read_evaluated(obj: bpy.types.Object, scene: bpy.types.Scene) -> PolygonMesh:
    """Return the polygons after modifiers (except ``list_ignored``) and without a simulated shape, metres in world axes.

    Parameters
    ----------
    obj, scene : the object, and the scene with its units
    """
    with modifiers.surface_only(obj) as left, shape_keys.blend_shown(obj, 0.0), evaluated_object(obj, scene) as there:
        mesh = there.to_mesh()
        try:
            return _surface(mesh, obj.session_uid, to_metres(there, scene), remarks=left).polygons
        finally:
            there.to_mesh_clear()


def _surface(
    mesh: bpy.types.Mesh,
    uid: int,
    matrix: Float[np.ndarray, "4 4"],
    keyed: Float[np.ndarray, "vertices 3"] | None = None,
    remarks: tuple[str, ...] = (),
) -> ObjectSurface:
    if not len(mesh.polygons):
        raise FlexMapsError("The mesh has no faces; add some, or select another object")
    positions, pairs = column(mesh.vertices, "co"), column(mesh.edges, "vertices")
    seams, corners = column(mesh.edges, "use_seam"), column(mesh.loops, "vertex_index")
    sizes = column(mesh.polygons, "loop_total")
    loops = np.arange(len(corners))
    if np.linalg.det(matrix[:3, :3]) < 0:  # mirroring turns the faces inside out: reverse the corners
        starts = np.repeat(np.cumsum(sizes) - sizes, sizes)
        count = np.repeat(sizes, sizes)
        loops = starts + (count - (loops - starts)) % count
    keyed = positions if keyed is None else keyed
    vertices = keyed.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    values, damaged = attributes.read_all(mesh)
    remarks += tuple(DAMAGED.format(attributes.PREFIX + name) for name in damaged)
    if stored_report.is_damaged(mesh) or stored_report.lacks_checksums(mesh):
        remarks += (DAMAGED_REPORT if stored_report.is_damaged(mesh) else OLD_REPORT,)
    step = rounding_step(keyed[np.unique(corners)]) * 1e3 * float(np.abs(np.linalg.det(matrix[:3, :3]))) ** (1 / 3)
    remarks += (COARSE.format(step),) if step else ()
    polygons = PolygonMesh(vertices, corners[loops].astype(np.int64), sizes.astype(np.int64), remarks)
    none = np.zeros(0, dtype=np.int64)
    spoilt = np.union1d(polygons.face_of[damaged.get("width", none)], damaged.get("twist", none))
    return ObjectSurface(uid, polygons, positions, pairs, seams, loops, matrix, values, spoilt, keyed)


def write_vertices(obj: bpy.types.Object, surface: ObjectSurface, mesh: QuadMesh) -> None:
    """Move the object's vertices to the engine's positions; vertices without a quad stay where they are.

    Parameters
    ----------
    obj : the mesh object
    surface : the surface as it was read
    mesh : the same quads with new vertices, metres

    Raises
    ------
    FlexMapsError where the user has shape keys, which fix the vertices.
    """
    if shape_keys.has_user_keys(obj.data):
        raise FlexMapsError("The mesh has shape keys, which fix its vertices; remove them first")
    equilibrium.clear(obj)
    if obj.data.shape_keys is not None and not obj.data.is_editmode:
        obj.shape_key_clear()  # a basis without other keys would keep the old positions
    inverse = np.linalg.inv(surface.to_metres)
    there = mesh.vertices[mesh.quads.ravel()] @ inverse[:3, :3].T + inverse[:3, 3]
    positions, corners = surface.positions.astype(float).copy(), surface.polygons.corners
    positions[corners] += there - surface.keyed_positions[corners]
    attributes.write_positions(obj, positions)


# -- layout, flat patches, design ------------------------------------------------------------------------------------


def read_layout(surface: ObjectSurface, mesh: QuadMesh) -> PatchLayout:
    """Return the layout that cuts the mesh at the object's seams."""
    return PatchLayout(mesh, surface.seams[surface.edge_of] & ~mesh.border)


def read_flat(surface: ObjectSurface, mesh: QuadMesh) -> FlatPatches | None:
    """Return the stored flat patches with the cuts they were made with; None where there are none.

    Parameters
    ----------
    surface, mesh : the object's surface, and its quads

    Raises
    ------
    FlexMapsError where the UV map or the surface was changed since they were stored.
    """
    if any(name not in surface.values for name in FLAT_NAMES):
        return None
    layout = PatchLayout(mesh, (surface.values["seam"][surface.edge_of] >= 0) & ~mesh.border)
    corners = surface.values["flat"].astype(float)[surface.loops].reshape(-1, 4, 2) * 1e-3
    points = np.zeros((int(layout.flat_corners.max()) + 1, 2))
    points[layout.flat_corners] = corners
    away = np.abs(points[layout.flat_corners] - corners).max(axis=(1, 2))
    torn = np.flatnonzero(~(away <= 1e-5 * np.abs(corners).max()))
    if len(torn):
        raise FlexMapsError("The UV map 'flexmaps_flat' was changed; press Flatten to make it anew", faces=torn)
    with np.errstate(all="ignore"):  # a UV map of zero size yields NaN, which is then reported as a change
        points[layout.flat_corners] -= patch_centres(layout, points)[layout.patch_of][:, None]
        flat = with_energies(layout, points)
    stored = surface.values["energy"].astype(float)
    moved = np.flatnonzero(~(np.abs(flat.energy - stored) <= 1e-4 + 0.02 * stored))
    if len(moved):
        raise FlexMapsError("The surface was changed after it was flattened; press Flatten to do it anew", faces=moved)
    return flat


def patch_centres(layout: PatchLayout, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "patches 2"]:
    """Return the area centroid of every flat patch, metres; ``points``: positions of all flat vertices, metres."""
    p = points[layout.flat_corners]
    a, b = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    weight = np.bincount(layout.patch_of, area)
    return np.stack([np.bincount(layout.patch_of, area * p[:, :, k].mean(axis=1)) / weight for k in range(2)], axis=1)


def require_current_flat(surface: ObjectSurface, mesh: QuadMesh) -> FlatPatches:
    """Return the stored flat patches if they still match the seams.

    Raises
    ------
    FlexMapsError where there are no flat patches, or the seams were edited since.
    """
    flat = read_flat(surface, mesh)
    if flat is None:
        raise FlexMapsError("There are no flat panels yet; press Lay out the panels or Flatten first")
    changed = np.flatnonzero(flat.layout.cut != read_layout(surface, mesh).cut)
    if len(changed):
        raise FlexMapsError("The seams were edited; press Update from seams first", edges=changed)
    return flat


def read_design(
    surface: ObjectSurface, flat: FlatPatches, params: SpiralParams, names: tuple[str, ...] = DESIGN_NAMES
) -> SpiralDesign | None:
    """Return the stored spirals; None where there are none.

    Parameters
    ----------
    surface, flat : the surface and its flat patches
    params : settings of the spirals
    names : attributes to read: ``DESIGN_NAMES``, or ``LAST_NAMES`` for the spirals before the patches were cut anew
    """
    values = _read_spirals(surface, names)
    return None if values is None else SpiralDesign(flat, params, *values)


def last_spirals(surface: ObjectSurface) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]] | None:
    """Return widths in metres and twists in radians from before the patches were cut anew; None where there are none."""
    return _read_spirals(surface, LAST_NAMES)


def _read_spirals(
    surface: ObjectSurface, names: tuple[str, ...]
) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]] | None:
    if any(name not in surface.values for name in names):
        return None
    width, twist = (surface.values[name].astype(float) for name in names)
    return attributes.corners_by_face(width[surface.loops]) * 1e-3, np.radians(twist)


def read_start(
    surface: ObjectSurface, flat: FlatPatches, params: SpiralParams, block: dict[str, Any] | None
) -> SpiralDesign:
    """Return the initial spirals for a stage: the stored ones, adjusted to changed settings and patches.

    Parameters
    ----------
    surface, flat : the surface and its flat patches
    params : settings of the spirals
    block : report block of the stage that made the spirals, or None

    Raises
    ------
    FlexMapsError where there are no spirals, or the user changed some so that they cannot be cut.
    """
    if len(surface.invalid_faces):
        raise uncuttable_error(surface.invalid_faces)
    design = read_design(surface, flat, params)
    is_ours = block is not None and design is not None and is_as_reported(design, block)
    if design is None:
        design = read_design(surface, flat, params, LAST_NAMES)
        is_ours = design is not None and bool(np.isfinite(design.width).all() and np.isfinite(design.twist).all())
    if design is None:
        raise FlexMapsError("There are no spirals yet; press Spirals first")
    wrong = unfabricable_quads(design)
    if not len(wrong):
        return design
    if not is_ours:
        raise uncuttable_error(wrong)
    return make_fabricable(flat, params, design.width, design.twist, check_outlines=False)


def uncuttable_error(faces: Int[np.ndarray, " faces"]) -> FlexMapsError:
    """Return the error to raise for spirals that the user changed so that they cannot be cut."""
    text = f"{len(faces)} spirals were changed by hand into some that cannot be cut; press Spirals to make them anew"
    return FlexMapsError(text, faces=faces)


def is_as_reported(design: SpiralDesign, block: dict[str, Any]) -> bool:
    """Return whether the smallest, mean and largest width and twist equal those in a report block.

    Parameters
    ----------
    design : the spirals
    block : report block of the stage that stored the spirals
    """
    own = {"width_mm": design.width * 1e3, "twist_deg": np.degrees(design.twist)}
    return all(
        np.allclose([values.min(), values.mean(), values.max()], block[name], rtol=1e-4, atol=1e-3)
        for name, values in own.items()
    )


def write_flat(
    obj: bpy.types.Object, surface: ObjectSurface, flat: FlatPatches, centres: Float[np.ndarray, "patches 2"]
) -> None:
    """Store seams, UV map and face attributes of the flat patches.

    Parameters
    ----------
    obj : the mesh object
    surface : the surface as it was read
    flat : the flat patches
    centres : position of each patch's origin in the UV map, metres
    """
    cut = np.zeros(len(surface.edge_vertices), bool)
    cut[surface.edge_of] = flat.layout.cut
    uv = np.empty((len(surface.loops), 2))
    uv[surface.loops] = ((flat.corners + centres[flat.layout.patch_of][:, None]) * 1e3).reshape(-1, 2)
    attributes.write(obj, "flexmaps_flat", "CORNER", "FLOAT2", uv)
    seam = np.full(len(cut), -1)
    seam[surface.edge_of] = flat.layout.seam_of
    attributes.write(obj, "flexmaps_seam", "EDGE", "INT", seam)
    attributes.write(obj, "flexmaps_patch", "FACE", "INT", flat.layout.patch_of)
    attributes.write(obj, "flexmaps_energy", "FACE", "FLOAT", flat.energy)
    attributes.write(obj, "flexmaps_square", "FACE", "FLOAT", flat.irregularity)
    attributes.write_seams(obj, cut)


def write_design(obj: bpy.types.Object, surface: ObjectSurface, design: SpiralDesign) -> None:
    """Store the spirals, and remove the simulation and the stiffness of earlier spirals.

    Parameters
    ----------
    obj : the mesh object
    surface, design : the surface as it was read, and its spirals
    """
    clear(obj, (*LAST_NAMES, "stiffness"))
    _write_spirals(obj, surface, DESIGN_NAMES, design.width, design.twist)


def write_last_spirals(
    obj: bpy.types.Object,
    surface: ObjectSurface,
    width: Float[np.ndarray, "quads 4"],
    twist: Float[np.ndarray, " quads"],
) -> None:
    """Store widths and twists as the initial guess for the spirals of new patches.

    Parameters
    ----------
    obj : the mesh object
    surface : the surface as it was read
    width : (F, 4), metres
    twist : (F,), radians
    """
    _write_spirals(obj, surface, LAST_NAMES, width, twist)


def _write_spirals(
    obj: bpy.types.Object, surface: ObjectSurface, names: tuple[str, ...], width: np.ndarray, twist: np.ndarray
) -> None:
    corners = np.empty(len(surface.loops))
    corners[surface.loops] = width.ravel() * 1e3
    for name, values in zip(names, (corners, np.maximum(np.degrees(twist), 0.0)), strict=True):
        attributes.write(obj, attributes.PREFIX + name, *attributes.SPECS[name][:2], values)


def shelve_design(obj: bpy.types.Object) -> None:
    """Move the spirals' attributes to ``LAST_NAMES`` before the patches are cut anew; drop stiffness and simulation."""
    with attributes.readable_mesh(obj) as mesh:
        kept = [attributes.read(mesh, attributes.PREFIX + name) for name in DESIGN_NAMES]
    for name, values in zip(LAST_NAMES, kept, strict=True):
        if values is not None:
            domain, kind = attributes.SPECS[name][:2]
            attributes.write(obj, attributes.PREFIX + name, domain, kind, values)
    clear(obj, (*DESIGN_NAMES, "stiffness"))


def clear(obj: bpy.types.Object, names: tuple[str, ...]) -> None:
    """Remove attributes that an earlier stage made out of date, and the simulation.

    Parameters
    ----------
    obj : the mesh object
    names : names without prefix
    """
    for name in names:
        attributes.remove(obj, attributes.PREFIX + name)
    equilibrium.clear(obj)
