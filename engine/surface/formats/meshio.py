"""Read a polygon mesh from a file: OBJ, OFF, PLY and STL.

``.blend`` files are read through Blender (see ``bridge``). Readers only parse; ``check`` decides whether the mesh can
be fabricated.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...errors import FlexMapsError
from .. import shapes
from ..checking.topology import repeated_faces
from ..far import recentre, rounding_step
from ..mesh import PolygonMesh
from ..welding import weld
from .obj import parse_obj
from .off import parse_off
from .ply import parse_ply
from .stl import parse_stl
from .text import RawMesh

PARSERS = {".obj": parse_obj, ".off": parse_off, ".ply": parse_ply, ".stl": parse_stl}
SUFFIXES = tuple(PARSERS)
SHAPE_PREFIX = "shape:"  # prefix of the name of a built-in surface


def read_mesh(path: str | Path) -> PolygonMesh:
    """Read the mesh in the file ``path``; the suffix decides the format.

    Vertices are in the file's unit, (V, 3) float64, in the file's order, unused ones included. STL corners at nearly
    equal positions become one vertex. Texture coordinates, normals, colours and materials are ignored. Points, lines
    and repeated faces are dropped, as Blender's importers do, and reported in ``left_out`` of the mesh.

    Raises
    ------
    FlexMapsError : the file is missing, a folder, unreadable, empty, cut short, of another format, or has invalid
        numbers or indices; the message gives the file and the line or element
    """
    path = Path(path)
    parse = PARSERS.get(path.suffix.lower())
    if os.path.isdir(path):
        raise FlexMapsError(f"{path} is a folder; give a mesh file ({', '.join(SUFFIXES)})")
    if parse is None:
        suffix = f"the suffix '{path.suffix}'" if path.suffix else "no suffix"
        raise FlexMapsError(f"{path} has {suffix}, which is not a known mesh format; save it as {', '.join(SUFFIXES)}")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise FlexMapsError(f"{path} does not exist; check the name of the mesh file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FlexMapsError(f"{path} cannot be read ({reason}); check the file and its permissions") from None
    return parse_mesh(data, path.name)


def parse_mesh(data: bytes, name: str) -> PolygonMesh:
    """Parse the mesh in the bytes of a file; see ``read_mesh``.

    Parameters
    ----------
    data : content of the file
    name : name of the file; the suffix decides the format
    """
    if not data.strip():
        raise FlexMapsError(f"{name} is empty; export the mesh again")
    suffix = Path(name).suffix.lower()
    mesh = _check_raw(PARSERS[suffix](data, name), name)
    return weld(mesh) if suffix == ".stl" else mesh


def _check_raw(raw: RawMesh, name: str) -> PolygonMesh:
    """Return a parsed mesh without repeated faces and faces of fewer than 3 corners.

    Raise FlexMapsError if faces refer to missing or non-finite vertices; ``name`` is the name of the file.
    """
    face_of = np.repeat(np.arange(len(raw.sizes)), raw.sizes)
    outside = (raw.corners < 0) | (raw.corners >= len(raw.vertices))
    if outside.any():
        faces = np.unique(face_of[outside])
        raise FlexMapsError(
            f"{name}, {raw.face_place(int(faces[0]))}: the face refers to a vertex that is not among the"
            f" {len(raw.vertices)} of the file; it may be cut short, so export it again",
            faces=faces,
        )
    left = raw.left_out
    small = np.flatnonzero(raw.sizes < 3)
    if len(small):
        left += (_describe_dropped(small, raw, "a point or a line", "points or lines"),)
    mesh = PolygonMesh(raw.vertices, raw.corners, raw.sizes).subset(raw.sizes >= 3)
    if not len(mesh.sizes):
        raise FlexMapsError(f"{name} holds no faces; export the surface itself, not only points or curves")
    twice = repeated_faces(mesh)
    if len(twice):
        faces = np.flatnonzero(raw.sizes >= 3)[twice]
        left += (_describe_dropped(faces, raw, "a face that is listed before", "faces that are listed before"),)
        mesh = mesh.subset(~np.isin(np.arange(len(mesh.sizes)), twice))
    nowhere = ~np.isfinite(mesh.vertices).all(axis=1)
    bad = np.intersect1d(np.flatnonzero(nowhere), mesh.corners)
    if len(bad):
        more = f" ({len(bad)} such vertices)" if len(bad) > 1 else ""
        raise FlexMapsError(
            f"{name}, {raw.vertex_place(int(bad[0]))}: a coordinate is not a finite number{more}; mend or delete it"
        )
    step = rounding_step(mesh.vertices[np.unique(mesh.corners)]) if raw.is_single_precision else 0.0
    if step:
        left += (
            f"Coordinates are stored to {step:.2g} in the unit of the file at this distance from its origin, so that details are "
            "lost: move the surface to the origin and export it again",
        )
    return PolygonMesh(mesh.vertices, mesh.corners, mesh.sizes, left)


def _describe_dropped(faces: np.ndarray, raw: RawMesh, one: str, many: str) -> str:
    """Return for example "2 faces that are listed before are left out (line 4, line 7)".

    one, many : what is left out, in the singular and in the plural
    """
    places = ", ".join(raw.face_place(int(f)) for f in faces[:3]) + (", ..." if len(faces) > 3 else "")
    if len(faces) == 1:
        return f"{one[0].upper()}{one[1:]} is left out ({places})"
    return f"{len(faces)} {many} are left out ({places})"


def read_upright(source: str, up: str | None = None) -> tuple[str, PolygonMesh]:
    """Read a mesh, turn it so that z points up, and move it to the origin if it lies far away.

    Parameters
    ----------
    source : path of a file, or "shape:NAME" for a built-in surface
    up : axis of the file that points up, "x", "y" or "z"; None for y in OBJ files, else z

    Returns
    -------
    name of the file or the built-in surface; mesh

    Raises
    ------
    FlexMapsError : the axis is unknown, or the file cannot be read, see ``read_mesh``
    """
    if source.startswith(SHAPE_PREFIX):
        name = source.removeprefix(SHAPE_PREFIX)
        return name, PolygonMesh.from_quads(shapes.make(name))
    axis = up or ("y" if source.lower().endswith(".obj") else "z")
    turned = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
    if axis not in turned:
        raise FlexMapsError(f"up is '{axis}'; give x, y or z")
    polygons = recentre(read_mesh(source))
    # replace bytes that are not valid text, for the report and Blender
    name = Path(source).name.encode("utf-8", "replace").decode()
    return name, replace(polygons, vertices=polygons.vertices[:, turned[axis]])
