"""Parser of the text forms of Geomview's Object File Format.

Programs disagree on it. In Geomview's description it is a stream of words, and only a face's colour ends with the line;
MeshLab and libigl ignore further words on the line of a vertex or face; some writers put a face on several lines,
others put all faces on one. The first way that reads the whole file without contradiction is taken, the usual one
first.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...errors import FlexMapsError
from .text import RawMesh, Row, first_that_fits, integers, lines_place, numbers, refuse_binary, rows_of, shown, whole

KEYWORD = re.compile(rb"((?:ST|[CN4])*)(n?)OFF(\d*)", re.IGNORECASE)


@dataclass(frozen=True)
class _Head:
    """Header of an OFF file."""

    vertices: int
    faces: int
    stride: int  # numbers per vertex, if vertices are not separated by lines


def parse_off(data: bytes, name: str) -> RawMesh:
    """Parse OFF; colours, normals and texture coordinates are ignored."""
    refuse_binary(data, name, "OFF")
    rows = rows_of(data)
    if not rows:
        raise FlexMapsError(f"{name} holds only comments; export the mesh again")
    head, rows = _head(rows, name)

    def way(vertices: Callable, faces: Callable) -> Callable[[], RawMesh]:
        return lambda: _mesh(head, rows, name, vertices, faces)

    ways = [
        way(_vertices_by_line, _faces_by_line),
        way(_vertices_by_line, _faces_over_lines),
        way(_vertices_by_word, _faces_over_lines),
        way(_vertices_by_word, _faces_by_word),
    ]
    # read by line last, so that errors are reported for faces that span several lines
    if not _face_fills_its_line(head, rows):
        ways.append(ways.pop(0))
    return first_that_fits(ways)


def _head(rows: list[Row], name: str) -> tuple[_Head, list[Row]]:
    """Return the numbers of vertices and faces that the header promises, and the rows after it."""
    line, words = rows[0]
    kind = KEYWORD.fullmatch(words[0])
    letters, word_after = b"", words[1:]
    if kind:
        letters = kind[1].upper()
        if b"4" in letters or kind[2] == b"n":
            raise FlexMapsError(
                f"{name}, line {line}: only meshes in three dimensions can be read; export it as plain OFF"
            )
        letters += kind[2].upper()
        if b"BINARY" in (word.upper() for word in words):
            raise FlexMapsError(f"{name}, line {line}: binary OFF cannot be read; export it as text")
        if kind[3]:  # "OFF490 518 0", as in ModelNet
            word_after = [kind[3], *word_after]
        rows = [(line, word_after), *rows[1:]] if word_after else rows[1:]
        if not rows:
            raise FlexMapsError(f"{name} is cut short after its first line; export it again")
    line, words = rows[0]
    # some files omit the number of edges, which no reader uses
    edges = 0 if len(words) == 2 and len(rows) > 1 and len(rows[1][1]) > 1 else 1
    counts: list[bytes] = []
    while rows and len(counts) < 2 + edges:
        taken = rows[0][1][: 2 + edges - len(counts)]
        counts += taken
        left = rows[0][1][len(taken) :]
        rows = [(rows[0][0], left), *rows[1:]] if left else rows[1:]
    try:
        vertex_count, face_count = int(counts[0]), int(counts[1])
    except (ValueError, IndexError):
        raise FlexMapsError(f"{name}, line {line}: no numbers of vertices and faces here; is it an OFF file?") from None
    if vertex_count < 0 or face_count < 0:
        raise FlexMapsError(f"{name}, line {line}: a negative number of vertices or faces; export it again")
    stride = 3 + 3 * (b"N" in letters) + 4 * (b"C" in letters) + 2 * (b"ST" in letters)
    return _Head(vertex_count, face_count, stride), rows


def _face_fills_its_line(head: _Head, rows: list[Row]) -> bool:
    """Return whether the first face stands on one line, in a file with one line per vertex."""
    if len(rows) <= head.vertices:
        return True
    first = rows[head.vertices][1]
    return not first[0].isdigit() or len(first) > 1


def _mesh(head: _Head, rows: list[Row], name: str, read_vertices: Callable, read_faces: Callable) -> RawMesh:
    """Read the mesh with one way of reading vertices and one of reading faces.

    Both functions take the header, the rows left and the name; they return the data, its lines and the rows after it.
    """
    if len(rows) == 0 and head.vertices + head.faces:
        raise _cut_short(head, name)
    vertices, point_lines, rest = read_vertices(head, rows, name)
    faces, face_lines, rest = read_faces(head, rest, name)
    sizes = np.array([len(face) for face in faces], dtype=np.int64)
    corners = integers(faces, face_lines, name)
    if read_faces is not _faces_by_line and (
        rest or (len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices))
    ):
        raise FlexMapsError(
            f"{name}: the numbers after its head do not make {head.vertices} vertices and {head.faces} faces; export it again"
        )
    return RawMesh(vertices, corners, sizes, lines_place(point_lines), lines_place(face_lines), _left(head, rest, name))


def _left(head: _Head, rest: list[Row], name: str) -> tuple[str, ...]:
    """Describe lines after the last face; raise if they would be further faces."""
    if not rest:
        return ()
    line, words = rest[0]
    if len(words) > 3 and words[0] == b"%d" % (len(words) - 1) and all(word.isdigit() for word in words):
        raise FlexMapsError(
            f"{name}, line {line}: more lines than the {head.vertices} vertices and {head.faces} faces that its head"
            " promises; export it again"
        )
    many = f"{len(rest)} lines after the last face are" if len(rest) > 1 else "A line after the last face is"
    return (f"{many} left out, from line {line} on ('{shown(words)}')",)


def _cut_short(head: _Head, name: str) -> FlexMapsError:
    return FlexMapsError(
        f"{name} is cut short: its head promises {head.vertices} vertices and {head.faces} faces,"
        " but it ends before the last of them; export it again"
    )


def _vertices_by_line(head: _Head, rows: list[Row], name: str) -> tuple[np.ndarray, list[int], list[Row]]:
    """Read one vertex per line; ignore further words of the line."""
    own = rows[: head.vertices]
    if len(own) < head.vertices:
        raise _cut_short(head, name)
    lines = [line for line, _ in own]
    found = numbers([words[:3] for _, words in own], lines, 3, name, "a vertex")
    return found.reshape(-1, 3), lines, rows[head.vertices :]


def _vertices_by_word(head: _Head, rows: list[Row], name: str) -> tuple[np.ndarray, list[int], list[Row]]:
    """Read vertices of ``stride`` numbers each, regardless of line ends."""
    words: list[bytes] = []
    lines: list[int] = []
    at = 0
    while at < len(rows) and len(words) < head.vertices * head.stride:
        words += rows[at][1]
        lines += [rows[at][0]] * len(rows[at][1])
        at += 1
    need = head.vertices * head.stride
    if len(words) < need:
        raise _cut_short(head, name)
    starts = range(0, need, head.stride)
    rest = [(lines[-1], words[need:]), *rows[at:]] if len(words) > need else rows[at:]
    lines = [lines[k] for k in starts]
    found = numbers([words[k : k + 3] for k in starts], lines, 3, name, "a vertex")
    return found.reshape(-1, 3), lines, rest


def _size(word: bytes, line: int, name: str) -> int:
    """Return the number of corners of a face."""
    size = whole(word, line, name)
    if size < 0:
        raise FlexMapsError(f"{name}, line {line}: a face cannot have {size} corners; mend the line")
    return size


def _faces_by_line(head: _Head, rows: list[Row], name: str) -> tuple[list[list[bytes]], list[int], list[Row]]:
    """Read one face per line; further words of the line are its colour."""
    own = rows[: head.faces]
    if len(own) < head.faces:
        raise _cut_short(head, name)
    faces = []
    for line, words in own:
        size = _size(words[0], line, name)
        if len(words) <= size:
            raise FlexMapsError(
                f"{name}, line {line}: the face promises {size} corners but has {len(words) - 1}; mend the line"
            )
        faces.append(words[1 : size + 1])
    return faces, [line for line, _ in own], rows[head.faces :]


def _faces_over_lines(head: _Head, rows: list[Row], name: str) -> tuple[list[list[bytes]], list[int], list[Row]]:
    """Read faces that begin on a new line and may continue over several; further words of the last line are the colour."""
    faces, lines, at = [], [], 0
    for _ in range(head.faces):
        if at == len(rows):
            raise _cut_short(head, name)
        line, words = rows[at]
        size = _size(words[0], line, name)
        at += 1
        words = list(words)
        while len(words) <= size:
            if at == len(rows):
                raise _cut_short(head, name)
            words += rows[at][1]
            at += 1
        faces.append(words[1 : size + 1])
        lines.append(line)
    return faces, lines, rows[at:]


def _faces_by_word(head: _Head, rows: list[Row], name: str) -> tuple[list[list[bytes]], list[int], list[Row]]:
    """Read faces without colours, regardless of line ends."""
    words = [word for _, row in rows for word in row]
    line_of = [line for line, row in rows for _ in row]
    faces, lines, at = [], [], 0
    for _ in range(head.faces):
        if at >= len(words):
            raise _cut_short(head, name)
        size = _size(words[at], line_of[at], name)
        if at + size >= len(words):
            raise _cut_short(head, name)
        faces.append(words[at + 1 : at + 1 + size])
        lines.append(line_of[at])
        at += 1 + size
    rest = [(line_of[at], words[at:])] if at < len(words) else []
    return faces, lines, rest
