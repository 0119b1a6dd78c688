"""Read and write attributes of a Blender mesh, in object mode and in edit mode.

In edit mode Blender keeps the mesh in a separate BMesh. Reading copies the BMesh to a temporary mesh, and writing goes
directly into the BMesh, so that edit mode is never left and its undo covers every change.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bmesh
import bpy
import numpy as np

from ...engine.arrays import Bool, Float, Int, Shaped
from ...engine.errors import FlexMapsError
from .columns import column

PREFIX = "flexmaps_"
MAX_VALUE = 1e30  # clip limit, below float32's 3e38; a folded quad's deviation from a square is unbounded

# attribute type -> (property of its data, numbers per element, numpy type, name of the BMesh layers). No stage writes
# BOOLEAN, because scripts cannot access its layers in edit mode before Blender 4.5
KINDS: dict[str, tuple[str, int, type, str]] = {
    "FLOAT": ("value", 1, np.float32, "float"),
    "INT": ("value", 1, np.int32, "int"),
    "BOOLEAN": ("value", 1, np.bool_, "bool"),
    "FLOAT2": ("vector", 2, np.float32, "uv"),
    "FLOAT_VECTOR": ("vector", 3, np.float32, "float_vector"),
    "FLOAT_COLOR": ("color", 4, np.float32, "float_color"),
}


# attributes that FlexMaps writes: name without prefix -> domain, type, smallest and largest value; infinity stands for
# the largest index of a face or edge
SPECS: dict[str, tuple[str, str, float, float]] = {
    "cut": ("EDGE", "BOOLEAN", 0, 1),  # in older files, in place of "seam"
    "seam": ("EDGE", "INT", -1, np.inf),
    "choices": ("EDGE", "INT", 0, 255),  # bit k is set where layout k cuts
    "flat": ("CORNER", "FLOAT2", -MAX_VALUE, MAX_VALUE),
    "patch": ("FACE", "INT", 0, np.inf),
    "energy": ("FACE", "FLOAT", 0, MAX_VALUE),
    "square": ("FACE", "FLOAT", 0, MAX_VALUE),
    "width": ("CORNER", "FLOAT", 1e-3, 1e3),
    "twist": ("FACE", "FLOAT", 0, 1e3),
    "stiffness": ("FACE", "FLOAT", 0, MAX_VALUE),
    "protect": ("FACE", "INT", 0, 1),
    "last_width": ("CORNER", "FLOAT", 1e-3, 1e3),
    "last_twist": ("FACE", "FLOAT", 0, 1e3),
    "distance": ("FACE", "FLOAT", 0, MAX_VALUE),
    "strain_energy": ("FACE", "FLOAT", -MAX_VALUE, MAX_VALUE),
    "strain": ("FACE", "FLOAT", 0, MAX_VALUE),
    "slot": ("FACE", "FLOAT", -MAX_VALUE, MAX_VALUE),
    "reach": ("FACE", "INT", 0, 6),
    "scan": ("FACE", "FLOAT", -1, MAX_VALUE),
    "utilisation": ("FACE", "FLOAT", 0, MAX_VALUE),
    "hub": ("FACE", "FLOAT_VECTOR", -MAX_VALUE, MAX_VALUE),
    "hub_x": ("FACE", "FLOAT_VECTOR", -MAX_VALUE, MAX_VALUE),
    "hub_y": ("FACE", "FLOAT_VECTOR", -MAX_VALUE, MAX_VALUE),
    "held": ("FACE", "FLOAT", 0, 1),
    "pull": ("FACE", "FLOAT_VECTOR", -MAX_VALUE, MAX_VALUE),
    "wish": ("FACE", "FLOAT_VECTOR", -MAX_VALUE, MAX_VALUE),
    "colour": ("CORNER", "FLOAT_COLOR", -MAX_VALUE, MAX_VALUE),
}
# attributes that older files store per face instead of per corner
FORMERLY_ON_FACES = ("width", "last_width")


@contextmanager
def readable_mesh(obj: bpy.types.Object) -> Iterator[bpy.types.Mesh]:
    """Context manager: yield a mesh with the user's latest edits, in edit mode too; with shape keys, the basis."""
    if not obj.data.is_editmode:
        yield obj.data
        return
    copy = bpy.data.meshes.new(".flexmaps")
    try:
        bm = bmesh.from_edit_mesh(obj.data)
        bm.to_mesh(copy)
        if obj.active_shape_key_index > 0:  # the user edits a shape key other than the basis
            layer = bm.verts.layers.shape[obj.data.shape_keys.reference_key.name]
            copy.vertices.foreach_set("co", np.array([v[layer] for v in bm.verts], np.float32).ravel())
        yield copy
    finally:
        bpy.data.meshes.remove(copy)


def read(mesh: bpy.types.Mesh, name: str) -> np.ndarray | None:
    """Return the values of an attribute, (N,) or (N, 2 to 4); None if it is missing or not valid.

    An attribute of FlexMaps is not valid if another program or script gave it another type or values out of its bounds.
    Widths that an older file stores per face are repeated for every corner.

    Parameters
    ----------
    mesh : Blender's mesh, outside edit mode
    name : name with prefix
    """
    values = read_as_stored(mesh, name)
    return _on_corners(mesh, name, values)


def read_as_stored(mesh: bpy.types.Mesh, name: str) -> np.ndarray | None:
    """Return the values as ``read`` does, but leave widths that older files store per face as they are, (faces,).

    Parameters
    ----------
    mesh : Blender's mesh, outside edit mode
    name : name with prefix
    """
    values = _read_unchecked(mesh, name)
    return None if values is None or (_is_ours(name) and not is_valid(name, values)) else values


def corners_by_face(values: Shaped[np.ndarray, " corners"]) -> Float[np.ndarray, "quads 4"]:
    """Reshape corner values of a quad mesh from (4 F,) to (F, 4)."""
    return values.reshape(-1, 4).astype(float)


def _on_corners(mesh: bpy.types.Mesh, name: str, values: np.ndarray | None) -> np.ndarray | None:
    """Repeat face values of older files for all corners of each face; return other values unchanged."""
    attribute = mesh.attributes.get(name)
    if values is None or attribute is None or not _is_older_form(name, attribute):
        return values
    return np.repeat(values, column(mesh.polygons, "loop_total"))


def _is_older_form(name: str, attribute: bpy.types.Attribute) -> bool:
    return name.removeprefix(PREFIX) in FORMERLY_ON_FACES and (attribute.domain, attribute.data_type) == (
        "FACE",
        "FLOAT",
    )


def _read_unchecked(mesh: bpy.types.Mesh, name: str) -> np.ndarray | None:
    """Return the values without checking bounds; None if the attribute is missing or has another domain or type."""
    attribute = mesh.attributes.get(name)
    if attribute is None or attribute.data_type not in KINDS:
        return None
    as_ours = _is_ours(name) and (attribute.domain, attribute.data_type) == SPECS[name.removeprefix(PREFIX)][:2]
    if _is_ours(name) and not as_ours and not _is_older_form(name, attribute):
        return None
    prop, width, dtype, _ = KINDS[attribute.data_type]
    values: np.ndarray = np.empty(len(attribute.data) * width, dtype=dtype)
    attribute.data.foreach_get(prop, values)
    return values.reshape(-1, width) if width > 1 else values


def _is_ours(name: str) -> bool:
    return name.startswith(PREFIX) and name.removeprefix(PREFIX) in SPECS


def is_valid(name: str, values: Shaped[np.ndarray, "elements ..."]) -> bool:
    """Return whether all values of a FlexMaps attribute are finite and within its bounds.

    Parameters
    ----------
    name : name with prefix
    values : values of all elements
    """
    return bool(_in_bounds(name, values).all())


def _in_bounds(name: str, values: Shaped[np.ndarray, "#elements ..."]) -> Bool[np.ndarray, "#elements ..."]:
    _, _, low, high = SPECS[name.removeprefix(PREFIX)]
    if high == np.inf:
        high = len(values) - 1
    return np.asarray((values >= low) & (values <= high))


def read_all(mesh: bpy.types.Mesh) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the valid and the damaged FlexMaps attributes of a mesh, by name without the prefix.

    Returns
    -------
    Valid name -> values, and damaged name -> indices of the elements whose values are out of bounds (empty where the
    domain or type is wrong).
    """
    sound: dict[str, np.ndarray] = {}
    unsound: dict[str, np.ndarray] = {}
    for name in SPECS:
        if PREFIX + name in mesh.attributes:
            values = _on_corners(mesh, PREFIX + name, _read_unchecked(mesh, PREFIX + name))
            wrong = np.zeros(0, bool) if values is None else ~_in_bounds(PREFIX + name, values)
            if values is None or wrong.any():
                unsound[name] = np.unique(np.nonzero(wrong)[0])
            else:
                sound[name] = values
    if "cut" in sound and PREFIX + "seam" not in mesh.attributes:
        sound["seam"] = np.where(sound["cut"], 0, -1).astype(np.int32)  # older files have no seam numbers
    return sound, unsound


def has(obj: bpy.types.Object, name: str) -> bool:
    """Return whether the object's mesh has an attribute of that name, in edit mode too.

    Parameters
    ----------
    obj : the mesh object
    name : name with prefix
    """
    return name in obj.data.attributes


def write(obj: bpy.types.Object, name: str, domain: str, kind: str, values: np.ndarray) -> None:
    """Write an attribute; create it where it is missing or has another domain or type.

    Parameters
    ----------
    obj : a mesh object, in edit mode or not
    name : name with prefix
    domain : "POINT", "EDGE", "FACE" or "CORNER"
    kind : a key of ``KINDS``; "FLOAT2" on "CORNER" makes a UV map
    values : (N,) or (N, 2 to 4), in Blender's order of elements

    Raises
    ------
    FlexMapsError where the mesh has no room for another UV map.
    """
    if KINDS[kind][2] is np.float32:  # larger values would overflow to infinity and make the mesh invalid
        values = np.clip(values, -MAX_VALUE, MAX_VALUE)
    if obj.data.is_editmode:
        _write_bmesh(obj.data, name, domain, kind, values)
        return
    mesh = obj.data
    attribute = mesh.attributes.get(name)
    if attribute is not None and (attribute.domain != domain or attribute.data_type != kind):
        mesh.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        if kind == "FLOAT2":
            if mesh.uv_layers.new(name=name, do_init=False) is None:
                raise FlexMapsError(
                    f"The mesh has no room for another UV map; remove one, so that '{name}' can be made"
                )
        else:
            mesh.attributes.new(name, kind, domain)
        attribute = mesh.attributes[name]
    prop, _, dtype, _ = KINDS[kind]
    attribute.data.foreach_set(prop, np.ascontiguousarray(values, dtype=dtype).ravel())
    mesh.update()


def _sequence(bm: bmesh.types.BMesh, domain: str) -> Any:
    return {"POINT": bm.verts, "EDGE": bm.edges, "FACE": bm.faces, "CORNER": bm.loops}[domain]


def _write_bmesh(mesh: bpy.types.Mesh, name: str, domain: str, kind: str, values: np.ndarray) -> None:
    bm = bmesh.from_edit_mesh(mesh)
    layers = getattr(_sequence(bm, domain).layers, KINDS[kind][3])
    layer = layers.get(name)
    if layer is None:
        if name in mesh.attributes:  # it exists with another type or domain
            mesh.attributes.remove(mesh.attributes[name])
        layer = layers.new(name)
    rows = np.asarray(values, dtype=KINDS[kind][2]).tolist()
    if domain == "CORNER":
        loops = (loop for face in bm.faces for loop in face.loops)
        if kind == "FLOAT2":
            for loop, row in zip(loops, rows, strict=True):
                loop[layer].uv = row
        else:
            for loop, row in zip(loops, rows, strict=True):
                loop[layer] = row
    else:
        for element, row in zip(_sequence(bm, domain), rows, strict=True):
            element[layer] = row
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)


def remove(obj: bpy.types.Object, name: str) -> None:
    """Remove an attribute if it exists, in edit mode too.

    Parameters
    ----------
    obj : the mesh object
    name : name with prefix
    """
    if name in obj.data.attributes:
        obj.data.attributes.remove(obj.data.attributes[name])
        if obj.data.is_editmode:
            bmesh.update_edit_mesh(obj.data)


def write_seams(obj: bpy.types.Object, seams: Bool[np.ndarray, " edges"]) -> None:
    """Set the UV seams from one flag per edge, in Blender's order."""
    if obj.data.is_editmode:
        bm = bmesh.from_edit_mesh(obj.data)
        for edge, seam in zip(bm.edges, seams.tolist(), strict=True):
            edge.seam = seam
        bmesh.update_edit_mesh(obj.data, loop_triangles=False, destructive=False)
    else:
        obj.data.edges.foreach_set("use_seam", np.ascontiguousarray(seams, dtype=bool))
        obj.data.update()


def write_positions(obj: bpy.types.Object, positions: Float[np.ndarray, "vertices 3"]) -> None:
    """Move the vertices to positions in the object's own frame."""
    if obj.data.is_editmode:
        bm = bmesh.from_edit_mesh(obj.data)
        for vertex, position in zip(bm.verts, positions.tolist(), strict=True):
            vertex.co = position
        bm.normal_update()
        bmesh.update_edit_mesh(obj.data, destructive=False)
    else:
        obj.data.vertices.foreach_set("co", np.ascontiguousarray(positions, dtype=np.float32).ravel())
        obj.data.update()


def select(obj: bpy.types.Object, faces: Int[np.ndarray, " faces"], edges: Int[np.ndarray, " edges"]) -> None:
    """Select exactly these faces and edges of Blender's mesh.

    Parameters
    ----------
    obj : the mesh object
    faces, edges : their indices in Blender's order
    """
    mesh = obj.data
    if mesh.is_editmode:
        bm = bmesh.from_edit_mesh(mesh)
        for sequence in (bm.verts, bm.edges, bm.faces):
            sequence.ensure_lookup_table()
            for element in sequence:
                element.select = False
        for sequence, wanted in ((bm.edges, edges), (bm.faces, faces)):
            for index in wanted:
                sequence[index].hide = False
                sequence[index].select_set(True)
        bm.select_flush_mode()
        bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)
        return
    faces_on, edges_on, points_on = (np.zeros(len(s), bool) for s in (mesh.polygons, mesh.edges, mesh.vertices))
    faces_on[faces], edges_on[edges] = True, True
    corners, starts = column(mesh.loops, "vertex_index"), column(mesh.polygons, "loop_start")
    face_of = np.searchsorted(starts, np.arange(len(corners)), side="right") - 1
    chosen = faces_on[face_of]
    edges_on[column(mesh.loops, "edge_index")[chosen]] = True
    points_on[corners[chosen]] = True
    points_on[column(mesh.edges, "vertices")[edges_on]] = True
    mesh.polygons.foreach_set("select", faces_on)
    mesh.edges.foreach_set("select", edges_on)
    mesh.vertices.foreach_set("select", points_on)
    mesh.update()
