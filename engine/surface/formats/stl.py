"""Parser of STL, text and binary."""

from __future__ import annotations

import re

import numpy as np

from ...errors import FlexMapsError
from .text import BYTE_ORDER_MARK, RawMesh, describe_trailing_bytes, parse_floats

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])  # 50 bytes per triangle
HEADER_BYTES = 84  # length of the header, bytes: 80 of any text, 4 for the number of triangles


def parse_stl(data: bytes, name: str) -> RawMesh:
    """Parse the bytes of an STL file called ``name``, text or binary; merge corners at exactly equal positions.

    Corners at nearly equal positions are left to ``weld``.
    """
    count = int.from_bytes(data[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    end = HEADER_BYTES + RECORD.itemsize * count
    text = data.removeprefix(BYTE_ORDER_MARK).lstrip()
    left: tuple[str, ...] = ()
    single = True
    # decide by the size, not the first word: binary headers may begin with "solid" too
    if len(data) != end and text[:5].lower() == b"solid" and b"\0" not in data:
        points, left = _text_points(text, data[: len(data) - len(text)].count(b"\n"), name)
        single = False
    elif count and HEADER_BYTES < end <= len(data):
        records = np.frombuffer(data, RECORD, count, HEADER_BYTES)
        points = records["corners"].reshape(-1, 3).astype(float)
        left = describe_trailing_bytes(data[end:])
    elif HEADER_BYTES <= len(data) < end:
        raise FlexMapsError(
            f"{name} is cut short: it promises {count} triangles and holds {(len(data) - HEADER_BYTES) // RECORD.itemsize};"
            " export it again"
        )
    elif len(data) == end:
        points = np.zeros((0, 3))
    else:
        raise FlexMapsError(f"{name} is neither text nor binary STL; export it again")
    if not np.isfinite(points).all():
        bad = int(np.argmin(np.isfinite(points).all(axis=1))) // 3
        raise FlexMapsError(
            f"{name}, triangle {bad}: a coordinate is not a finite number; export it again", faces=[bad]
        )
    _, first, index = np.unique(points, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))  # number the vertices in order of appearance
    corners = rank[index.ravel()]
    sizes = np.full(len(points) // 3, 3, dtype=np.int64)
    places = (lambda i: f"vertex {i}", lambda i: f"triangle {i}")
    return RawMesh(points[np.sort(first)], corners, sizes, *places, left, single)


def _text_points(data: bytes, lines_before: int, name: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the corner positions of a text STL, (3 n, 3), and a message if the file has no end.

    Lines do not matter, except that the name of a solid ends with its line. ``lines_before`` is the number of lines of
    the file before ``data``, for messages.
    """
    words: list[bytes] = []
    line_of: list[int] = []
    ended = False
    for number, line in enumerate(data.splitlines(), lines_before + 1):
        own = line.split()
        if own and own[0].lower() == b"solid":
            # skip the solid's name; the whole file may be on one line
            facet = re.search(rb"\sfacet\s+normal\s+[-+.\d]", line, re.IGNORECASE)
            own = line[facet.start() :].split() if facet else []
        # after endsolid comes the name of the solid
        end = next((k for k, word in enumerate(own) if word.lower() == b"endsolid"), len(own))
        ended |= end < len(own)
        words += own[:end]
        line_of += [number] * end
    rows: list[list[bytes]] = []
    lines: list[int] = []
    facets = 0
    for k, word in enumerate(words):
        keyword = word.lower()
        if keyword == b"vertex":
            rows.append(words[k + 1 : k + 4])
            lines.append(line_of[k])
        elif keyword == b"endfacet":
            facets += 1
            if len(rows) != 3 * facets:
                raise FlexMapsError(f"{name}, line {line_of[k]}: the triangle does not have 3 corners; export it again")
    if len(rows) != 3 * facets:
        raise FlexMapsError(f"{name} is cut short: its last triangle is not whole; export it again")
    points = parse_floats(rows, lines, 3, name, "a corner").reshape(-1, 3)
    return points, () if ended else ("The file has no end ('endsolid'): where triangles are missing, export it again",)
