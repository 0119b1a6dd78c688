"""A scan as it comes from a file: points, or a mesh that is sampled evenly."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Float
from ..errors import FlexMapsError
from ..surface.files.meshio import PARSERS, SUFFIXES
from ..surface.files.text import RawMesh

MOST = 60_000  # points that are kept: a spiral of a piece of 2,000 has 30 of them, its own waviness is seen
FEWEST = 100  # points below which a scan shows no shape
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}  # metres


@dataclass(frozen=True, eq=False)
class Scan:
    """A scan of a built piece.

    points : in the scan's own unit and frame; name : for messages and reports
    unit : one of ``UNITS``; "" where metres or millimetres, whichever comes nearer the piece's size
    anywhere : whether it may lie in any pose, not only roughly as the piece does
    """

    points: Float[np.ndarray, "points 3"]
    name: str = "scan"
    unit: str = ""
    anywhere: bool = True


def read(path: str | Path, unit: str = "", anywhere: bool = True) -> Scan:
    """The scan in a file: of a mesh points spread evenly over its faces, else its points, at most ``MOST`` of them.

    Raises FlexMapsError where it cannot be read, is empty, or holds no number where one belongs.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if unit not in ("", *UNITS):
        raise FlexMapsError(f"'{unit}' is no unit of a scan; give {', '.join(UNITS)}")
    if os.path.isdir(path) or suffix not in PARSERS:
        raise FlexMapsError(f"{path} is no scan that can be read; save it as {', '.join(SUFFIXES)}")
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FlexMapsError(f"{path} cannot be read ({reason}); check the name of the scan") from None
    if not data.strip():
        raise FlexMapsError(f"{path.name} is empty; export the scan again")
    head = data[: data.find(b"end_header")]
    if suffix == ".ply" and b"element face" not in head:  # points alone: the reader of meshes asks for faces
        data = data.replace(b"end_header", b"element face 0\nproperty list uchar int vertex_indices\nend_header", 1)
    points = _points(PARSERS[suffix](data, path.name), path.name)
    return Scan(points, path.name, unit, anywhere)


def _points(raw: RawMesh, name: str) -> Float[np.ndarray, "points 3"]:
    """Points of the mesh in a file."""
    random = np.random.default_rng(0)
    fans = [
        (start, k)
        for start, size in zip(np.cumsum(raw.sizes) - raw.sizes, raw.sizes, strict=True)
        for k in range(1, size - 1)
    ]
    if not fans:
        return raw.vertices[random.permutation(len(raw.vertices))[:MOST]]
    first, step = np.array(fans).T
    triangles = np.column_stack([raw.corners[first], raw.corners[first + step], raw.corners[first + step + 1]])
    if triangles.min() < 0 or triangles.max() >= len(raw.vertices):
        raise FlexMapsError(
            f"{name}: a face refers to a vertex that is not there; it may be cut short, export it again"
        )
    corners = raw.vertices[triangles]
    with np.errstate(invalid="ignore", over="ignore"):
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not np.isfinite(areas).all() or not areas.sum() > 0:
        return raw.vertices[random.permutation(len(raw.vertices))[:MOST]]  # ``compare`` names what is no number
    of = random.choice(len(corners), MOST, p=areas / areas.sum())
    return np.einsum("nk,nki->ni", random.dirichlet(np.ones(3), MOST), corners[of])
