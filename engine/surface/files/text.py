"""What the readers of all mesh formats share: lines and words of a text file, and the numbers among them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...surface.checking.finding import counted

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
WIDE_MARKS = (b"\xff\xfe", b"\xfe\xff")  # of text in UTF-16

Row = tuple[int, list[bytes]]  # the number of a line, and its words


@dataclass(frozen=True, eq=False)
class RawMesh:
    """What a parser found, not yet checked.

    vertices, corners, sizes : as in PolygonMesh; indices may be out of range, and
        sizes as small as 0
    vertex_place, face_place : tell where in the file a vertex or a face stands, for messages ("line 12")
    left_out : sentences about what the file holds beyond its mesh
    single : whether coordinates are stored in single precision
    """

    vertices: Float[np.ndarray, "vertices 3"]
    corners: Int[np.ndarray, " corners"]
    sizes: Int[np.ndarray, " quads"]
    vertex_place: Callable[[int], str]
    face_place: Callable[[int], str]
    left_out: tuple[str, ...] = ()
    single: bool = False


def lines_place(lines: Sequence[int]) -> Callable[[int], str]:
    """A place function from the line number of every element."""
    return lambda i: f"line {lines[i]}"


def refuse_binary(data: bytes, name: str, format: str) -> None:
    """Raise when ``data`` cannot be the text that ``format`` is made of."""
    if data.startswith(WIDE_MARKS):
        raise FlexMapsError(f"{name} is text in UTF-16, which no {format} file is; save it as UTF-8")
    if b"\0" in data[:4096]:
        raise FlexMapsError(f"{name} is not a text file, so it is no {format} file; export the mesh again as {format}")


def rows_of(data: bytes, *, continued: bool = False) -> list[Row]:
    """The lines that hold words, without comments (#); ``continued``: a line that ends in a backslash goes on in the next."""
    return [(number, words) for number, line in _logical_lines(data, continued) if (words := line.split())]


def _logical_lines(data: bytes, continued: bool) -> Iterator[tuple[int, bytes]]:
    lines = data.removeprefix(BYTE_ORDER_MARK).splitlines()
    if b"#" in data:
        lines = [line.partition(b"#")[0] for line in lines]
    if not continued or b"\\" not in data:
        yield from enumerate(lines, 1)
        return
    start, parts = 0, []
    for number, line in enumerate(lines, 1):
        start = start or number
        stripped = line.rstrip()
        if stripped.endswith(b"\\"):
            parts.append(stripped[:-1])
            continue
        yield start, b" ".join([*parts, line])
        start, parts = 0, []
    if parts:
        yield start, b" ".join(parts)


def shown(words: Sequence[bytes]) -> str:
    """Words of a file for a message."""
    return b" ".join(words).decode(errors="replace")[:60]


def bytes_left(data: bytes) -> tuple[str, ...]:
    """What is said of the bytes after the last element of a binary file."""
    if not data.strip(b"\0 \r\n\t"):
        return ()
    return (f"{counted(len(data), 'byte', 'bytes')} after the last element of the file left out",)


def numbers(rows: Sequence[Sequence[bytes]], lines: Sequence[int], width: int, name: str, what: str) -> np.ndarray:
    """(n, width) float from rows of words; raises with the line of the first row that does not fit."""
    try:
        flat = np.array([float(word) for row in rows for word in row])
        if flat.size == width * len(rows) and all(len(row) == width for row in rows) and not _grouped(rows):
            return flat.reshape(-1, width)
    except ValueError:
        pass
    for row, line in zip(rows, lines, strict=True):
        if len(row) < width:
            raise FlexMapsError(
                f"{name}, line {line}: {what} needs {width} numbers, not '{shown(row)}'; the file may be cut short"
            )
        try:
            if not _grouped([row]):
                [float(word) for word in row]
                continue
        except ValueError:
            pass
        raise FlexMapsError(f"{name}, line {line}: '{shown(row)}' are not {width} numbers; mend the line")
    raise AssertionError("a row of numbers that was refused has no fault")


def integers(rows: Sequence[Sequence[bytes]], lines: Sequence[int], name: str) -> Int[np.ndarray, " corners"]:
    """From rows of words of any length; raises with the line of the first word that is no integer."""
    try:
        found = np.array([int(word) for word in chain.from_iterable(rows)], dtype=np.int64)
        if not _grouped(rows):
            return found
    except (ValueError, OverflowError):
        pass
    for row, line in zip(rows, lines, strict=True):
        for word in row:
            try:
                if not _grouped([[word]]):
                    np.int64(int(word))
                    continue
            except (ValueError, OverflowError):
                pass
            raise FlexMapsError(f"{name}, line {line}: '{shown([word])}' is not a vertex index; mend the line")
    raise AssertionError("a list of integers that was refused has no fault")


def whole(word: bytes, line: int, name: str) -> int:
    """The integer that a word is; raises with its line."""
    try:
        if b"_" not in word:
            return int(word)
    except ValueError:
        pass
    raise FlexMapsError(f"{name}, line {line}: '{shown([word])}' is not a whole number; mend the line")


def _grouped(rows: Sequence[Sequence[bytes]]) -> bool:
    """Whether digits are grouped by underscores, which Python takes for numbers and no mesh file means."""
    return any(b"_" in word for row in rows for word in row)


def first_that_fits(ways: Sequence[Callable[[], RawMesh]]) -> RawMesh:
    """The mesh by the first way of reading that fits; raises the first way's error where none does."""
    first: FlexMapsError | None = None
    for way in ways:
        try:
            return way()
        except FlexMapsError as error:
            first = first or error
    assert first is not None
    raise first
