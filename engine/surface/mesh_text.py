"""Parsers of the text formats OBJ and OFF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from ..errors import FlexMapsError


@dataclass(frozen=True, eq=False)
class RawMesh:
    """What a parser found, not yet checked.

    vertices : (V, 3) float, corners : (C,) int, sizes : (F,) int as in PolygonMesh; indices may be out of range
    vertex_place, face_place : tell where in the file a vertex or a face stands, for messages ("line 12")
    """

    vertices: np.ndarray
    corners: np.ndarray
    sizes: np.ndarray
    vertex_place: Callable[[int], str]
    face_place: Callable[[int], str]


def lines_place(lines: Sequence[int]) -> Callable[[int], str]:
    """A place function from the line number of every element."""
    return lambda i: f"line {lines[i]}"


def refuse_binary(data: bytes, name: str, format: str) -> None:
    """Raise when ``data`` cannot be the text that ``format`` is made of."""
    if b"\0" in data[:4096]:
        raise FlexMapsError(f"{name} is not a text file, so it is no {format} file; export the mesh again as {format}")


def numbers(rows: list[list[bytes]], lines: Sequence[int], width: int, name: str, what: str) -> np.ndarray:
    """(n, width) float from rows of words; raises with the line of the first row that does not fit."""
    try:
        flat = np.array([float(word) for row in rows for word in row])
        if flat.size == width * len(rows) and all(len(row) == width for row in rows):
            return flat.reshape(-1, width)
    except ValueError:
        pass
    for row, line in zip(rows, lines, strict=True):
        text = b" ".join(row).decode(errors="replace")
        if len(row) < width:
            raise FlexMapsError(
                f"{name}, line {line}: {what} needs {width} numbers, not '{text}'; the file may be cut short"
            )
        try:
            [float(word) for word in row]
        except ValueError:
            raise FlexMapsError(f"{name}, line {line}: '{text}' are not {width} numbers; mend the line") from None
    raise AssertionError("a row of numbers that was refused has no fault")


def integers(rows: list[list[bytes]], lines: Sequence[int], name: str) -> np.ndarray:
    """(C,) int from rows of words of any length; raises with the line of the first word that is no integer."""
    try:
        return np.array([int(word) for word in chain.from_iterable(rows)], dtype=np.int64)
    except (ValueError, OverflowError):
        pass
    for row, line in zip(rows, lines, strict=True):
        for word in row:
            try:
                np.int64(int(word))
            except (ValueError, OverflowError):
                text = word.decode(errors="replace")
                raise FlexMapsError(f"{name}, line {line}: '{text}' is not a vertex index; mend the line") from None
    raise AssertionError("a list of integers that was refused has no fault")


# -- OBJ -------------------------------------------------------------------------------------------------------------


def parse_obj(data: bytes, name: str) -> RawMesh:
    """Parse Wavefront OBJ: vertices and faces of any size; everything else is passed over.

    Understands ``v/vt/vn`` corners, indices counted backwards, vertex colours, comments and continued lines.
    """
    refuse_binary(data, name, "OBJ")
    points: list[list[bytes]] = []
    point_lines: list[int] = []
    faces: list[list[bytes]] = []
    face_lines: list[int] = []
    known: list[int] = []  # vertices read before each face: what backward indices count from
    for number, line in _logical_lines(data):
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            points.append(words[1:4])  # further numbers are a weight or a colour
            point_lines.append(number)
        elif words[0] == b"f":
            faces.append(words[1:])
            face_lines.append(number)
            known.append(len(points))
    if not points and not faces:
        raise FlexMapsError(f"{name} holds no vertices and no faces; is it an OBJ file? Export the mesh again")
    vertices = numbers(points, point_lines, 3, name, "a vertex").reshape(-1, 3)
    sizes = np.array([len(face) for face in faces], dtype=np.int64)
    _refuse_small(sizes, face_lines, name)
    if b"/" in data:
        faces = [[word.split(b"/", 1)[0] for word in face] for face in faces]
    index = integers(faces, face_lines, name)
    before = np.repeat(np.array(known, dtype=np.int64), sizes)
    zero = np.flatnonzero(index == 0)
    if len(zero):
        number = face_lines[int(np.searchsorted(np.cumsum(sizes), zero[0], side="right"))]
        raise FlexMapsError(
            f"{name}, line {number}: vertex index 0; OBJ counts vertices from 1, so export the mesh again"
        )
    corners = np.where(index > 0, index - 1, before + index)
    return RawMesh(vertices, corners, sizes, lines_place(point_lines), lines_place(face_lines))


def _logical_lines(data: bytes) -> list[tuple[int, bytes]]:
    """Line number and text, without comments, continued lines joined."""
    if data.startswith(b"\xef\xbb\xbf"):
        data = data[3:]
    lines = data.splitlines()
    if b"#" in data:
        lines = [line.partition(b"#")[0] for line in lines]
    if b"\\" not in data:
        return list(enumerate(lines, 1))
    joined: list[tuple[int, bytes]] = []
    start, parts = 0, []
    for number, line in enumerate(lines, 1):
        start = start or number
        stripped = line.rstrip()
        if stripped.endswith(b"\\"):
            parts.append(stripped[:-1])
            continue
        joined.append((start, b" ".join([*parts, line])))
        start, parts = 0, []
    if parts:
        joined.append((start, b" ".join(parts)))
    return joined


def _refuse_small(sizes: np.ndarray, lines: Sequence[int], name: str) -> None:
    small = np.flatnonzero(sizes < 3)
    if len(small):
        raise FlexMapsError(
            f"{name}, line {lines[int(small[0])]}: a face has {sizes[small[0]]} corners where it needs 3 or more;"
            " the file may be cut short, so export it again",
            faces=small,
        )


# -- OFF -------------------------------------------------------------------------------------------------------------


def parse_off(data: bytes, name: str) -> RawMesh:
    """Parse the Object File Format in its text forms (OFF, and with colours, normals or texture coordinates)."""
    refuse_binary(data, name, "OFF")
    rows = [(number, words) for number, line in _logical_lines(data) if (words := line.split())]
    if not rows:
        raise FlexMapsError(f"{name} holds only comments; export the mesh again")
    counts, rest = _off_counts(rows, name)
    vertex_count, face_count = counts
    if len(rest) < vertex_count + face_count:
        raise FlexMapsError(
            f"{name} is cut short: its head promises {vertex_count} vertices and {face_count} faces,"
            f" but only {len(rest)} lines follow; export it again"
        )
    if len(rest) > vertex_count + face_count:
        raise FlexMapsError(
            f"{name}, line {rest[vertex_count + face_count][0]}: more lines than the {vertex_count} vertices and"
            f" {face_count} faces that its head promises; export it again"
        )
    points, faces = rest[:vertex_count], rest[vertex_count:]
    point_lines, face_lines = [n for n, _ in points], [n for n, _ in faces]
    vertices = numbers([words[:3] for _, words in points], point_lines, 3, name, "a vertex").reshape(-1, 3)
    sizes = integers([words[:1] for _, words in faces], face_lines, name)
    _refuse_small(sizes, face_lines, name)
    for size, (line, words) in zip(sizes, faces, strict=True):
        if len(words) <= size:
            raise FlexMapsError(
                f"{name}, line {line}: the face promises {size} corners but has {len(words) - 1}; mend the line"
            )
    corners = integers([words[1 : size + 1] for size, (_, words) in zip(sizes, faces, strict=True)], face_lines, name)
    return RawMesh(vertices, corners, sizes, lines_place(point_lines), lines_place(face_lines))


def _off_counts(
    rows: list[tuple[int, list[bytes]]], name: str
) -> tuple[tuple[int, int], list[tuple[int, list[bytes]]]]:
    """The promised numbers of vertices and faces, and the rows after the head."""
    line, words = rows[0]
    rest = rows[1:]
    if words[0].upper().endswith(b"OFF"):
        kind = words[0].upper()[:-3]
        if b"N4" in kind or kind.endswith(b"4") or (kind.endswith(b"N") and words[0].startswith(b"n")):
            raise FlexMapsError(
                f"{name}, line {line}: only meshes in three dimensions can be read; export it as plain OFF"
            )
        if b"BINARY" in (word.upper() for word in words):
            raise FlexMapsError(f"{name}, line {line}: binary OFF cannot be read; export it as text")
        words = words[1:]
        if not words:
            if not rest:
                raise FlexMapsError(f"{name} is cut short after its first line; export it again")
            (line, words), rest = rest[0], rest[1:]
    try:
        vertex_count, face_count = int(words[0]), int(words[1])
    except (ValueError, IndexError):
        raise FlexMapsError(f"{name}, line {line}: no numbers of vertices and faces here; is it an OFF file?") from None
    if vertex_count < 0 or face_count < 0:
        raise FlexMapsError(f"{name}, line {line}: a negative number of vertices or faces; export it again")
    return (vertex_count, face_count), rest
