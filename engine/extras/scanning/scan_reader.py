"""Read a scan from a file of points, or of a mesh, which is sampled evenly."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...surface.formats.meshio import PARSERS, SUFFIXES
from ...surface.formats.text import RawMesh

MAX_POINTS = 60_000  # largest number of points to use (30 per spiral with 2,000 spirals); larger: more exact, slower
MIN_POINTS = 100  # smallest number of points of a scan
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}  # metres per unit


@dataclass(frozen=True, eq=False)
class Scan:
    """A scan of a built piece.

    points : points in the scan's own unit and frame
    name : name for messages and reports
    unit : key of ``UNITS``; "" for metres or millimetres, whichever is closer to the piece's size
    anywhere : whether the orientation is arbitrary; False if it roughly agrees with the piece's
    """

    points: Float[np.ndarray, "points 3"]
    name: str = "scan"
    unit: str = ""
    anywhere: bool = True


def read_scan(path: str | Path, unit: str = "", anywhere: bool = True) -> Scan:
    """Read a scan: points sampled evenly from the faces of a mesh, or the points themselves; at most ``MAX_POINTS``.

    Parameters
    ----------
    path : path of the file
    unit, anywhere : see ``Scan``

    Raises
    ------
    FlexMapsError : the file cannot be read, is empty, or has invalid numbers
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if unit not in ("", *UNITS):
        raise FlexMapsError(f"'{unit}' is not a unit of length for a scan; give one of {', '.join(UNITS)}")
    if os.path.isdir(path) or suffix not in PARSERS:
        raise FlexMapsError(f"{path} is not a readable scan; save it as {', '.join(SUFFIXES)}")
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FlexMapsError(f"{path} cannot be read ({reason}); check the name of the scan") from None
    if not data.strip():
        raise FlexMapsError(f"{path.name} is empty; export the scan again")
    head = data[: data.find(b"end_header")]
    if suffix == ".ply" and b"element face" not in head:  # the mesh reader requires an element for faces
        data = data.replace(b"end_header", b"element face 0\nproperty list uchar int vertex_indices\nend_header", 1)
    points = _sample_points(PARSERS[suffix](data, path.name), path.name)
    return Scan(points, path.name, unit, anywhere)


def _sample_points(raw: RawMesh, name: str) -> Float[np.ndarray, "points 3"]:
    """Return points sampled from a mesh, or its vertices if it has no faces; at most ``MAX_POINTS``.

    name : file name for messages
    """
    random = np.random.default_rng(0)
    fans = [
        (start, k)
        for start, size in zip(np.cumsum(raw.sizes) - raw.sizes, raw.sizes, strict=True)
        for k in range(1, size - 1)
    ]
    if not fans:
        return raw.vertices[random.permutation(len(raw.vertices))[:MAX_POINTS]]
    first, step = np.array(fans).T
    triangles = np.column_stack([raw.corners[first], raw.corners[first + step], raw.corners[first + step + 1]])
    if triangles.min() < 0 or triangles.max() >= len(raw.vertices):
        raise FlexMapsError(f"{name}: a face refers to a missing vertex; the file may be incomplete, export it again")
    corners = raw.vertices[triangles]
    with np.errstate(invalid="ignore", over="ignore"):
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not np.isfinite(areas).all() or not areas.sum() > 0:
        # return the vertices unchanged: ``compare_scan`` reports numbers that are not finite
        return raw.vertices[random.permutation(len(raw.vertices))[:MAX_POINTS]]
    of = random.choice(len(corners), MAX_POINTS, p=areas / areas.sum())
    return np.einsum("nk,nki->ni", random.dirichlet(np.ones(3), MAX_POINTS), corners[of])
