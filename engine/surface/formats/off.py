"""Parser of the text forms of Geomview's Object File Format.

Programs disagree on this format. In Geomview's description it is a stream of words, and only a face's colour ends with
the line; MeshLab and libigl ignore further words on the line of a vertex or face; some writers put a face on several
lines, others put all faces on one line. This parser first tries one line per vertex and face, then a stream of words
without colours.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...errors import FlexMapsError
from .text import (
    RawMesh,
    Row,
    first_success,
    parse_floats,
    parse_integer,
    parse_integers,
    place_by_line,
    quote_words,
    refuse_binary,
    split_rows,
)

KEYWORD = re.compile(rb"((?:ST|[CN4])*)(n?)OFF(\d*)", re.IGNORECASE)


@dataclass(frozen=True)
class _OffHeader:
    """Header of an OFF file: numbers of vertices and faces, and layout of a vertex."""

    vertices: int
    faces: int
    stride: int  # numbers per vertex (coordinates, normal, colour, texture), used if lines do not separate vertices


def parse_off(data: bytes, name: str) -> RawMesh:
    """Parse the bytes of an OFF file called ``name``; colours, normals and texture coordinates are ignored."""
    refuse_binary(data, name, "OFF")
    rows = split_rows(data)
    if not rows:
        raise FlexMapsError(f"{name} holds only comments; export the mesh again")
    head, rows = _parse_header(rows, name)
    return first_success(
        [lambda: _build_mesh(head, rows, name, _read_by_line), lambda: _build_mesh(head, rows, name, _read_by_word)]
    )


def _parse_header(rows: list[Row], name: str) -> tuple[_OffHeader, list[Row]]:
    """Parse the header of an OFF file; return the header and the rows after it."""
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
    return _OffHeader(vertex_count, face_count, stride), rows


# words of every vertex, their line numbers; words of every face, their line numbers; rows after the last face
_Parts = tuple[list[list[bytes]], list[int], list[list[bytes]], list[int], list[Row]]


def _build_mesh(
    head: _OffHeader, rows: list[Row], name: str, read: Callable[[_OffHeader, list[Row], str], _Parts]
) -> RawMesh:
    """Build the mesh from the rows after the header; ``read`` is ``_read_by_line`` or ``_read_by_word``."""
    points, point_lines, faces, face_lines, rest = read(head, rows, name)
    vertices = parse_floats(points, point_lines, 3, name, "a vertex").reshape(-1, 3)
    sizes = np.array([len(face) for face in faces], dtype=np.int64)
    corners = parse_integers(faces, face_lines, name)
    if read is _read_by_word and (rest or (len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices))):
        raise FlexMapsError(
            f"{name}: the numbers after its head do not make {head.vertices} vertices and {head.faces} faces; export it again"
        )
    return RawMesh(
        vertices,
        corners,
        sizes,
        place_by_line(point_lines),
        place_by_line(face_lines),
        _describe_trailing_lines(head, rest, name),
    )


def _describe_trailing_lines(head: _OffHeader, rest: list[Row], name: str) -> tuple[str, ...]:
    """Return a message about lines after the last face, if any; raise FlexMapsError if they look like further faces."""
    if not rest:
        return ()
    line, words = rest[0]
    if len(words) > 3 and words[0] == b"%d" % (len(words) - 1) and all(word.isdigit() for word in words):
        raise FlexMapsError(
            f"{name}, line {line}: more lines than the {head.vertices} vertices and {head.faces} faces that its head"
            " promises; export it again"
        )
    many = f"{len(rest)} lines after the last face are" if len(rest) > 1 else "A line after the last face is"
    return (f"{many} left out, from line {line} on ('{quote_words(words)}')",)


def _truncated_error(head: _OffHeader, name: str) -> FlexMapsError:
    return FlexMapsError(
        f"{name} is cut short: its head promises {head.vertices} vertices and {head.faces} faces,"
        " but it ends before the last of them; export it again"
    )


def _read_by_line(head: _OffHeader, rows: list[Row], name: str) -> _Parts:
    """Read one vertex or face per line; ignore further words on the line, such as a colour."""
    points, own = rows[: head.vertices], rows[head.vertices : head.vertices + head.faces]
    if len(points) + len(own) < head.vertices + head.faces:
        raise _truncated_error(head, name)
    faces = []
    for line, words in own:
        size = _parse_face_size(words[0], line, name)
        if len(words) <= size:
            raise FlexMapsError(
                f"{name}, line {line}: the face promises {size} corners but has {len(words) - 1}; mend the line"
            )
        faces.append(words[1 : size + 1])
    vertices, lines = [words[:3] for _, words in points], [line for line, _ in points]
    return vertices, lines, faces, [line for line, _ in own], rows[head.vertices + head.faces :]


def _read_by_word(head: _OffHeader, rows: list[Row], name: str) -> _Parts:
    """Read vertices of ``stride`` numbers each, then faces without colours, regardless of line ends."""
    words = [word for _, row in rows for word in row]
    line_of = [line for line, row in rows for _ in row]
    starts, at = range(0, head.vertices * head.stride, head.stride), head.vertices * head.stride
    faces, lines = [], []
    for _ in range(head.faces):
        size = _parse_face_size(words[at], line_of[at], name) if at < len(words) else 0
        if at + size >= len(words):
            raise _truncated_error(head, name)
        faces.append(words[at + 1 : at + 1 + size])
        lines.append(line_of[at])
        at += 1 + size
    if at > len(words):
        raise _truncated_error(head, name)
    rest = [(line_of[at], words[at:])] if at < len(words) else []
    return [words[k : k + 3] for k in starts], [line_of[k] for k in starts], faces, lines, rest


def _parse_face_size(word: bytes, line: int, name: str) -> int:
    """Convert a word to the number of corners of a face; raise FlexMapsError if it is not one."""
    size = parse_integer(word, line, name)
    if size < 0:
        raise FlexMapsError(f"{name}, line {line}: a face cannot have {size} corners; mend the line")
    return size
