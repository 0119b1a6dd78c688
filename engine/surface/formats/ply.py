"""Parser of PLY, the Stanford polygon format, as text or binary."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ...errors import FlexMapsError
from .text import (
    BYTE_ORDER_MARK,
    RawMesh,
    Row,
    describe_trailing_bytes,
    parse_floats,
    parse_integer,
    parse_integers,
    place_by_line,
    quote_words,
)

PLY_TYPES = {
    b"char": "i1", b"int8": "i1", b"uchar": "u1", b"uint8": "u1", b"short": "i2", b"int16": "i2", b"ushort": "u2",
    b"uint16": "u2", b"int": "i4", b"int32": "i4", b"uint": "u4", b"uint32": "u4", b"float": "f4", b"float32": "f4",
    b"double": "f8", b"float64": "f8",
}  # fmt: skip
PLY_ORDERS = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
FACE_LISTS = (b"vertex_indices", b"vertex_index")


@dataclass(frozen=True)
class _Property:
    """A property of an element in the PLY header."""

    name: bytes
    type: str  # numpy type of the value, or of a list's items
    count_type: str = ""  # numpy type of a list's length; "" for a single value


@dataclass(frozen=True)
class _Element:
    """An element (vertex, face, ...) in the PLY header."""

    name: bytes
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_no_list(self) -> bool:
        """Whether the element has no list property."""
        return not any(p.count_type for p in self.properties)


def parse_ply(data: bytes, name: str) -> RawMesh:
    """Parse the bytes of a PLY 1.0 file called ``name``: text or binary in either byte order, any elements and properties."""
    data = data.removeprefix(BYTE_ORDER_MARK)
    order, elements, start, head_lines = _parse_header(data, name)
    for wanted in (b"vertex", b"face"):
        if not any(e.name == wanted for e in elements):
            strips = any(e.name == b"tristrips" for e in elements)
            hint = "it holds triangle strips, so export it with faces" if strips else "export the surface again"
            raise FlexMapsError(f"{name} has no {wanted.decode()} elements; {hint}")
    reader = _parse_text if order == "" else _parse_binary
    return reader(data[start:], order, elements, name, head_lines)


def _parse_header(data: bytes, name: str) -> tuple[str, list[_Element], int, int]:
    """Return the byte order ("" for text), the elements, the offset of the body, and the number of header lines."""
    if not data.startswith(b"ply"):
        raise FlexMapsError(f"{name} is not a PLY file, as it does not begin with 'ply'; export the mesh again")
    # the first line decides how lines end, because a binary body may begin with any byte
    old_mac = re.match(rb"ply[ \t]*\r(?!\n)", data) is not None
    end = re.search(rb"\r[ \t]*end_header[ \t]*\r" if old_mac else rb"\n[ \t]*end_header[ \t]*\r?\n", data)
    if end is None:
        raise FlexMapsError(f"{name} is cut short: its head has no line 'end_header'; export it again")
    lines = data[: end.start()].split(b"\r" if old_mac else b"\n")
    order, elements = None, []
    for number, line in enumerate(lines, 1):
        words = line.split()
        try:
            if not words or words[0] in (b"ply", b"comment", b"obj_info"):
                continue
            if words[0] == b"format":
                order = PLY_ORDERS[words[1]]
            elif words[0] == b"element":
                elements.append(_Element(words[1], int(words[2])))
                if elements[-1].count < 0:
                    raise ValueError
            elif words[0] == b"property" and words[1] == b"list":
                if PLY_TYPES[words[2]][0] == "f":
                    raise ValueError
                elements[-1].properties.append(_Property(words[4], PLY_TYPES[words[3]], PLY_TYPES[words[2]]))
            elif words[0] == b"property":
                elements[-1].properties.append(_Property(words[2], PLY_TYPES[words[1]]))
            else:
                raise ValueError
        except (KeyError, IndexError, ValueError):
            raise FlexMapsError(
                f"{name}, line {number}: '{quote_words(words)}' does not belong in a PLY head; export it again"
            ) from None
    if order is None:
        raise FlexMapsError(f"{name} does not say whether it is text or binary; export it again")
    return order, elements, end.end(), len(lines) + 1


def _coordinate_columns(element: _Element, name: str) -> list[int]:
    """Return the positions of x, y and z among the vertex properties."""
    names = [p.name for p in element.properties]
    if not {b"x", b"y", b"z"} <= set(names) or not element.has_no_list:
        raise FlexMapsError(f"{name}: its vertices have no x, y and z; export it again")
    return [names.index(axis) for axis in (b"x", b"y", b"z")]


def _face_list(element: _Element, name: str) -> int:
    """Return the position of the property that holds a face's vertex indices."""
    for i, p in enumerate(element.properties):
        if p.name in FACE_LISTS and p.count_type and p.type[0] != "f":
            return i
    raise FlexMapsError(f"{name}: its faces have no list of vertex indices; export it again")


def _parse_text(data: bytes, order: str, elements: list[_Element], name: str, head_lines: int) -> RawMesh:
    """Read the body of a text file (``data``) as a stream of words; it begins after ``head_lines`` lines."""
    rows = [(n, words) for n, line in enumerate(data.splitlines(), head_lines + 1) if (words := line.split())]
    return _build_text_mesh(_words_of(rows, elements, name), elements, name)


# line number and words of every element of one kind, and messages about data that were not read
_ElementRows = tuple[list[Row], tuple[str, ...]]


def _words_of(rows: list[Row], elements: list[_Element], name: str) -> Iterator[_ElementRows]:
    """Yield, for every kind of element, its elements with the words of their properties, regardless of line ends."""
    words = [word for _, row in rows for word in row]
    line_of = [line for line, row in rows for _ in row]
    at = 0
    for element in elements:
        own: list[Row] = []
        for _ in range(element.count if element.properties else 0):
            end = at
            for p in element.properties:
                end += 1
                if p.count_type and end <= len(words):
                    end += max(parse_integer(words[end - 1], line_of[end - 1], name), 0)
                if end > len(words):
                    raise _truncated_error(name, element)
            own.append((line_of[at], words[at:end]))
            at = end
        left: tuple[str, ...] = ()
        if element is elements[-1] and at < len(words):
            rest = quote_words(words[at:])
            left = (f"What follows the last element is left out, from line {line_of[at]} on ('{rest}')",)
        yield own, left


def _build_text_mesh(found: Iterator[_ElementRows], elements: list[_Element], name: str) -> RawMesh:
    """Build the mesh from the words of all elements, as ``_words_of`` yields them."""
    vertices, corners, sizes = np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64)
    point_lines: list[int] = []
    face_lines: list[int] = []
    left: tuple[str, ...] = ()
    for element, (own, more) in zip(elements, found, strict=True):
        left += more
        lines = [n for n, _ in own]
        if element.name == b"vertex":
            columns = _coordinate_columns(element, name)
            points = [[words[c] for c in columns] for _, words in own]
            vertices = parse_floats(points, lines, 3, name, "a vertex").reshape(-1, 3)
            point_lines = lines
        elif element.name == b"face":
            faces = [_parse_vertex_list(words, element, _face_list(element, name), name, n) for n, words in own]
            sizes = np.array([len(f) for f in faces], dtype=np.int64)
            corners = parse_integers(faces, lines, name)
            face_lines = lines
    return RawMesh(vertices, corners, sizes, place_by_line(point_lines), place_by_line(face_lines), left)


def _parse_vertex_list(words: list[bytes], element: _Element, wanted: int, name: str, line: int) -> list[bytes]:
    """Return the vertex indices (property number ``wanted``) among the words of a face."""
    at, found = 0, []
    for i, p in enumerate(element.properties):
        length = parse_integer(words[at], line, name) if p.count_type else 0
        if i == wanted:
            found = words[at + 1 : at + 1 + length]
        at += 1 + length
    return found


def _parse_binary(data: bytes, order: str, elements: list[_Element], name: str, head_lines: int) -> RawMesh:
    """Read the body of a binary file (``data``) in the byte order ``order``."""
    at, vertices, corners, sizes = 0, np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64)
    single = False
    for element in elements:
        columns = _coordinate_columns(element, name) if element.name == b"vertex" else []
        if element.has_no_list:
            dtype = np.dtype([(f"p{i}", order + p.type) for i, p in enumerate(element.properties)])
            need = element.count * dtype.itemsize
            if at + need > len(data):
                raise _truncated_error(name, element)
            if element.name == b"vertex":
                table = np.frombuffer(data, dtype, element.count, at)
                vertices = np.stack([table[f"p{c}"].astype(float) for c in columns], axis=1)
                single = all(table[f"p{c}"].dtype.itemsize <= 4 for c in columns)
            elif element.name == b"face":
                _face_list(element, name)
            at += need
            continue
        wanted = _face_list(element, name) if element.name == b"face" else -1
        found, counts, at = _read_binary_lists(data, at, order, element, wanted, name)
        if element.name == b"face":
            corners, sizes = found, counts
    left = describe_trailing_bytes(data[at:])
    return RawMesh(vertices, corners, sizes, lambda i: f"vertex {i}", lambda i: f"face {i}", left, single)


def _truncated_error(name: str, element: _Element) -> FlexMapsError:
    """Return the error for data that end too early."""
    return FlexMapsError(
        f"{name} is cut short: it ends within its {element.count} {element.name.decode(errors='replace')}"
        " elements; export it again"
    )


def _read_binary_lists(
    data: bytes, at: int, order: str, element: _Element, wanted: int, name: str
) -> tuple[np.ndarray, np.ndarray, int]:
    """Read the list property number ``wanted`` of all elements of one kind; -1 to skip the elements.

    data, at, order : body of the file, offset of the first element in it, and byte order

    Runs of elements with lists of equal length are read at once, with the layout of the run's first element.

    Returns
    -------
    items of all lists; length of each list; offset of the next kind of element
    """
    items: list[np.ndarray] = []
    lengths: list[np.ndarray] = []
    done, chunk = 0, element.count
    while done < element.count:
        dtype = _record_type(data, at, order, element)
        if dtype is None or at + dtype.itemsize > len(data):
            raise _truncated_error(name, element)
        fit = min(element.count - done, chunk, (len(data) - at) // dtype.itemsize)
        table = np.frombuffer(data, dtype, fit, at)
        same = np.ones(fit, dtype=bool)
        for i, p in enumerate(element.properties):
            if p.count_type:
                same &= table[f"n{i}"] == table[f"n{i}"][0]
        run = fit if same.all() else int(np.argmin(same))
        if wanted >= 0:
            items.append(table[f"p{wanted}"][:run].astype(np.int64).ravel())
            lengths.append(np.full(run, int(table[f"n{wanted}"][0]), dtype=np.int64))
        at += run * dtype.itemsize
        done += run
        chunk = max(2 * run, 16)  # after short runs read only a little ahead, so that mixed faces take linear time
    empty = np.zeros(0, np.int64)
    return np.concatenate([empty, *items]), np.concatenate([empty, *lengths]), at


def _record_type(data: bytes, at: int, order: str, element: _Element) -> np.dtype | None:
    """Return the numpy type of the record at offset ``at``; None if the data end within it."""
    fields: list[tuple] = []
    for i, p in enumerate(element.properties):
        if not p.count_type:
            fields.append((f"p{i}", order + p.type))
            at += np.dtype(p.type).itemsize
            continue
        count = np.dtype(order + p.count_type)
        if at + count.itemsize > len(data):
            return None
        length = int(np.frombuffer(data, count, 1, at)[0])
        at += count.itemsize + length * np.dtype(p.type).itemsize
        if length < 0 or at > len(data):
            return None
        fields += [(f"n{i}", count), (f"p{i}", order + p.type, (length,))]
    return np.dtype(fields)
