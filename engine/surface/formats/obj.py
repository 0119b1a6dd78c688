"""Parser of Wavefront OBJ."""

from __future__ import annotations

import numpy as np

from ...errors import FlexMapsError
from .text import RawMesh, parse_floats, parse_integers, place_by_line, refuse_binary, split_rows


def parse_obj(data: bytes, name: str) -> RawMesh:
    """Parse the bytes of an OBJ file called ``name``: vertices and faces of any size; everything else is ignored.

    Understands ``v/vt/vn`` corners, negative (relative) indices, vertex colours, comments and continued lines.
    """
    refuse_binary(data, name, "OBJ")
    points: list[list[bytes]] = []
    point_lines: list[int] = []
    faces: list[list[bytes]] = []
    face_lines: list[int] = []
    known: list[int] = []  # number of vertices before each face, to which its negative indices are added
    for number, words in split_rows(data, join_continued=True):
        if words[0] == b"v":
            points.append(words[1:4])  # further numbers are a weight or a colour
            point_lines.append(number)
        elif words[0] == b"f":
            faces.append(words[1:])
            face_lines.append(number)
            known.append(len(points))
    if not points and not faces:
        raise FlexMapsError(f"{name} holds no vertices and no faces; is it an OBJ file? Export the mesh again")
    vertices = parse_floats(points, point_lines, 3, name, "a vertex").reshape(-1, 3)
    sizes = np.array([len(face) for face in faces], dtype=np.int64)
    if b"/" in data:
        faces = [[word.split(b"/", 1)[0] for word in face] for face in faces]
    index = parse_integers(faces, face_lines, name)
    before = np.repeat(np.array(known, dtype=np.int64), sizes)
    zero = np.flatnonzero(index == 0)
    if len(zero):
        number = face_lines[int(np.searchsorted(np.cumsum(sizes), zero[0], side="right"))]
        raise FlexMapsError(
            f"{name}, line {number}: vertex index 0; OBJ counts vertices from 1, so export the mesh again"
        )
    corners = np.where(index > 0, index - 1, before + index)
    return RawMesh(vertices, corners, sizes, place_by_line(point_lines), place_by_line(face_lines))
