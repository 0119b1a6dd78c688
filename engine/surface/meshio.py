"""Read a polygon mesh from a file: OBJ, OFF, PLY and STL.

``.blend`` files are read through Blender (see ``bridge``). Readers only parse; whether the mesh can be made is the
business of ``check``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import FlexMapsError
from .mesh import PolygonMesh
from .mesh_binary import parse_ply, parse_stl
from .mesh_text import RawMesh, parse_obj, parse_off

PARSERS = {".obj": parse_obj, ".off": parse_off, ".ply": parse_ply, ".stl": parse_stl}
SUFFIXES = tuple(PARSERS)


def read(path: str | Path) -> PolygonMesh:
    """Read the mesh in the file ``path``; the suffix tells the format.

    Vertices come in the file's own unit, (V, 3) float64, in the file's order, used or not. Corners of STL triangles at
    exactly the same position become one vertex. Texture coordinates, normals, colours and materials are left out.

    Raises FlexMapsError, naming the file and the line or element, when there is no such file or it is a folder, cannot
    be read, is empty, cut short, of another format, or holds numbers or indices that make no sense.
    """
    path = Path(path)
    parse = PARSERS.get(path.suffix.lower())
    if path.is_dir():
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
    if not data.strip():
        raise FlexMapsError(f"{path.name} is empty; export the mesh again")
    return _checked(parse(data, path.name), path.name)


def _checked(raw: RawMesh, name: str) -> PolygonMesh:
    """Raise for coordinates that are no numbers and for faces that refer to vertices which are not there."""
    if not len(raw.sizes):
        raise FlexMapsError(f"{name} holds no faces; export the surface itself, not only points or curves")
    bad = np.flatnonzero(~np.isfinite(raw.vertices).all(axis=1))
    if len(bad):
        more = f" ({len(bad)} such vertices)" if len(bad) > 1 else ""
        raise FlexMapsError(
            f"{name}, {raw.vertex_place(int(bad[0]))}: a coordinate is not a finite number{more}; mend or delete it"
        )
    face_of = np.repeat(np.arange(len(raw.sizes)), raw.sizes)
    bad = np.flatnonzero((raw.corners < 0) | (raw.corners >= len(raw.vertices)))
    if len(bad):
        face = int(face_of[bad[0]])
        raise FlexMapsError(
            f"{name}, {raw.face_place(face)}: the face refers to a vertex that is not among the"
            f" {len(raw.vertices)} of the file; it may be cut short, so export it again",
            faces=np.unique(face_of[bad]),
        )
    return PolygonMesh(raw.vertices, raw.corners, raw.sizes)
