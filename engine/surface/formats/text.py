"""Text helpers shared by the mesh readers: lines, words and numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...surface.checking.finding import with_count

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")  # byte order marks of UTF-16

Row = tuple[int, list[bytes]]  # line number and words


@dataclass(frozen=True, eq=False)
class RawMesh:
    """Result of a parser, not yet checked.

    vertices, corners, sizes : as in ``PolygonMesh``; indices may be out of range, sizes as small as 0
    vertex_place, face_place : functions from an index to the vertex's or face's place in the file, e.g. "line 12"
    left_out : messages about data of the file that were not read
    is_single_precision : whether the file stores coordinates in single precision
    """

    vertices: Float[np.ndarray, "vertices 3"]
    corners: Int[np.ndarray, " corners"]
    sizes: Int[np.ndarray, " quads"]
    vertex_place: Callable[[int], str]
    face_place: Callable[[int], str]
    left_out: tuple[str, ...] = ()
    is_single_precision: bool = False


def place_by_line(lines: Sequence[int]) -> Callable[[int], str]:
    """Return a function that maps an element's index to its place in the file, such as "line 12"; see ``RawMesh``.

    lines : line number of every element
    """
    return lambda i: f"line {lines[i]}"


def refuse_binary(data: bytes, name: str, format: str) -> None:
    """Raise FlexMapsError if ``data``, the content of file ``name``, is not text, as ``format`` (e.g. "OBJ") requires."""
    if data.startswith(UTF16_MARKS):
        raise FlexMapsError(f"{name} is text in UTF-16, which no {format} file is; save it as UTF-8")
    if b"\0" in data[:4096]:
        raise FlexMapsError(f"{name} is not a text file, so it cannot be {format}; export the mesh again as {format}")


def split_rows(data: bytes, *, join_continued: bool = False) -> list[Row]:
    """Return the lines of a file that are not empty: line number, and words without # comments.

    join_continued : whether a backslash at the end of a line continues it
    """
    return [(number, words) for number, line in _logical_lines(data, join_continued) if (words := line.split())]


def _logical_lines(data: bytes, join_continued: bool) -> Iterator[tuple[int, bytes]]:
    """Yield line numbers and lines without comments; join lines that end with a backslash if ``join_continued``."""
    lines = data.removeprefix(BYTE_ORDER_MARK).splitlines()
    if b"#" in data:
        lines = [line.partition(b"#")[0] for line in lines]
    if not join_continued or b"\\" not in data:
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


def quote_words(words: Sequence[bytes]) -> str:
    """Return words of a file as text for a message, at most 60 characters."""
    return b" ".join(words).decode(errors="replace")[:60]


def describe_trailing_bytes(data: bytes) -> tuple[str, ...]:
    """Return a message about ``data``, the bytes after the last element of a binary file; none if they are blank."""
    if not data.strip(b"\0 \r\n\t"):
        return ()
    return (f"{with_count(len(data), 'byte', 'bytes')} after the last element of the file left out",)


def parse_floats(rows: Sequence[Sequence[bytes]], lines: Sequence[int], width: int, name: str, what: str) -> np.ndarray:
    """Convert rows of words to an (n, width) float array.

    Parameters
    ----------
    rows, lines : words of every row, and its line number
    width : numbers per row
    name, what : name of the file, and of a row's content, for messages

    Raises
    ------
    FlexMapsError : a row does not have ``width`` numbers; gives the first such line
    """
    try:
        flat = np.array([float(word) for row in rows for word in row])
        if flat.size == width * len(rows) and all(len(row) == width for row in rows) and not _has_underscore(rows):
            return flat.reshape(-1, width)
    except ValueError:
        pass
    for row, line in zip(rows, lines, strict=True):
        if len(row) < width:
            raise FlexMapsError(
                f"{name}, line {line}: {what} needs {width} numbers, not '{quote_words(row)}'; the file may be cut short"
            )
        try:
            if not _has_underscore([row]):
                [float(word) for word in row]
                continue
        except ValueError:
            pass
        raise FlexMapsError(f"{name}, line {line}: '{quote_words(row)}' are not {width} numbers; mend the line")
    raise AssertionError("a row of numbers that was refused has no fault")


def parse_integers(rows: Sequence[Sequence[bytes]], lines: Sequence[int], name: str) -> Int[np.ndarray, " corners"]:
    """Convert rows of words, of any lengths, to one array of integers.

    Parameters
    ----------
    rows, lines : words of every row, and its line number
    name : name of the file, for messages

    Raises
    ------
    FlexMapsError : a word is not an integer; gives its line
    """
    try:
        found = np.array([int(word) for word in chain.from_iterable(rows)], dtype=np.int64)
        if not _has_underscore(rows):
            return found
    except (ValueError, OverflowError):
        pass
    for row, line in zip(rows, lines, strict=True):
        for word in row:
            try:
                if not _has_underscore([[word]]):
                    np.int64(int(word))
                    continue
            except (ValueError, OverflowError):
                pass
            raise FlexMapsError(f"{name}, line {line}: '{quote_words([word])}' is not a vertex index; mend the line")
    raise AssertionError("a list of integers that was refused has no fault")


def parse_integer(word: bytes, line: int, name: str) -> int:
    """Convert a word to an integer; raise FlexMapsError with its line if it is not an integer."""
    try:
        if b"_" not in word:
            return int(word)
    except ValueError:
        pass
    raise FlexMapsError(f"{name}, line {line}: '{quote_words([word])}' is not a whole number; mend the line")


def _has_underscore(rows: Sequence[Sequence[bytes]]) -> bool:
    """Return whether a word contains an underscore, which Python accepts between digits but mesh files do not have."""
    return any(b"_" in word for row in rows for word in row)


def first_success(parsers: Sequence[Callable[[], RawMesh]]) -> RawMesh:
    """Call parsers in order and return the first mesh; if all fail, raise the error of the first parser."""
    first: FlexMapsError | None = None
    for way in parsers:
        try:
            return way()
        except FlexMapsError as error:
            first = first or error
    assert first is not None
    raise first
