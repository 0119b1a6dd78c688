"""The panels as solids for 3D printing: every panel extruded to the sheet's thickness, as binary STL or as 3MF, in millimetres."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ... import MARK
from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...progress import SILENT, Progress
from ..panels.panel import Panel
from ..sheets import CutSheets
from .operations import WRITING

ROWS = 10_000  # vertices or triangles that are put into words together, some hundredths of a second
TOLERANCE = 2e-5  # metres between the arcs and the edges of the solid: printers show nothing finer, and less doubles file and slicing


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed triangle mesh, outward.

    vertices : metres
    """

    name: str
    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]


def extruded(panel: Panel, thickness: float, tolerance: float = TOLERANCE) -> Solid:
    """A panel from z = 0 up to ``thickness`` metres; every edge has exactly two triangles.

    Raises ``FlexMapsError`` where the panel's outline touches itself.
    """
    import shapely

    rings = [curve.sampled(tolerance) for curve in (panel.outline, *panel.holes)]
    flat = np.concatenate(rings)
    polygon = shapely.Polygon(rings[0], rings[1:])
    if not polygon.is_valid:
        raise FlexMapsError(f"Panel {panel.number} cannot be made a solid: its outline touches itself")
    filled = shapely.constrained_delaunay_triangles(polygon)
    corners = shapely.get_coordinates(filled).reshape(-1, 4, 2)[:, :3]
    triangles = places(flat, corners.reshape(-1, 2)).reshape(-1, 3)
    assert triangles.min() >= 0  # the triangles' corners are the polygon's, exactly
    a, b, c = flat[triangles].transpose(1, 0, 2)
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    triangles[clockwise] = triangles[clockwise, ::-1]
    count = len(flat)
    start = np.cumsum([0, *(len(r) for r in rings)])
    along = np.concatenate([np.roll(np.arange(a, b), -1) for a, b in pairwise(start.tolist())])
    own = np.arange(count)
    walls = np.concatenate(
        [np.stack([own, along, along + count], axis=1), np.stack([own, along + count, own + count], axis=1)]
    )
    faces = np.concatenate([triangles[:, ::-1], triangles + count, walls])
    vertices = np.zeros((2 * count, 3))
    vertices[:count, :2] = vertices[count:, :2] = flat
    vertices[count:, 2] = thickness
    return Solid(f"{panel.kind} {panel.number}" if panel.number else panel.kind, vertices, faces)


def places(known: Float[np.ndarray, "known 2"], points: Float[np.ndarray, "points 2"]) -> Int[np.ndarray, " points"]:
    """Which of the ``known`` points every one of ``points`` is, exactly; -1 for none."""
    keys, wanted = _keys(known), _keys(points)
    order = np.argsort(keys)
    place = np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)
    return np.where(keys[order][place] == wanted, order[place], -1)


def _keys(points: np.ndarray) -> np.ndarray:
    # adding zero makes -0.0 the same as 0.0; complex numbers sort by both parts
    return np.ascontiguousarray(points + 0.0).view(complex).ravel()


def write_stl(sheets: CutSheets, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write one sheet as binary STL, the panels where they lie on it."""
    stl(_solids(sheets, index, progress), path, progress)


def write_3mf(sheets: CutSheets, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write one sheet as 3MF, which keeps the panels apart by their numbers."""
    package_3mf(_solids(sheets, index, progress), path, progress)


def _solids(sheets: CutSheets, index: int, progress: Progress) -> list[Solid]:
    panels = sheets.on_sheet(index)
    solids = []
    for number, panel in enumerate(panels):
        progress(0.7 * number / len(panels), f"solids of sheet {index + 1}")
        solids.append(extruded(panel, sheets.thickness))
    return solids


def stl(solids: list[Solid], path: str | os.PathLike[str], progress: Progress = SILENT) -> None:
    """All solids in one binary STL file, in millimetres."""
    count = sum(len(s.triangles) for s in solids)
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])
    with open(path, "wb") as stream:
        stream.write(f"{MARK}, millimetres".encode("ascii", "replace").ljust(80))
        stream.write(np.uint32(count).tobytes())
        for solid in progress.part(0.7, 1.0).each(solids, WRITING):
            rows = np.zeros(len(solid.triangles), dtype=record)
            rows["corners"] = solid.vertices[solid.triangles] * 1e3
            edges = np.diff(solid.vertices[solid.triangles], axis=1)
            normal = np.cross(edges[:, 0], edges[:, 1])
            rows["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
            stream.write(rows.tobytes())


def package_3mf(solids: list[Solid], path: str | os.PathLike[str], progress: Progress = SILENT) -> None:
    """A 3MF package (3MF Core Specification 1.3) with one object per solid, in millimetres."""
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    kinds = (
        "application/vnd.openxmlformats-package.relationships+xml",
        "application/vnd.ms-package.3dmanufacturing-3dmodel+xml",
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as package:
        package.writestr(
            "[Content_Types].xml",
            f'{head}<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
            f'<Default Extension="rels" ContentType="{kinds[0]}"/><Default Extension="model" ContentType="{kinds[1]}"/></Types>',
        )
        package.writestr(
            "_rels/.rels",
            f'{head}<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
            '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
            'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>',
        )
        with package.open("3D/3dmodel.model", "w") as stream:
            stream.write(
                f'{head}<model unit="millimeter" xml:lang="en-US" '
                'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
                f'<metadata name="Application">{MARK}</metadata><resources>'.encode()
            )
            for number, solid in enumerate(solids, start=1):
                share = progress.part(0.7 + 0.3 * (number - 1) / len(solids), 0.7 + 0.3 * number / len(solids))
                for text in _object(number, solid, share):
                    stream.write(text.encode())
            items = "".join(f'<item objectid="{n}"/>' for n in range(1, len(solids) + 1))
            stream.write(f"</resources><build>{items}</build></model>".encode())


def _object(number: int, solid: Solid, progress: Progress) -> Iterator[str]:
    yield f'<object id="{number}" type="model" name="{solid.name}"><mesh><vertices>'
    for part in progress.part(0.0, 0.4).batches(len(solid.vertices), ROWS, WRITING):
        # a tenth of a micrometre; and no two vertices may fall together
        points = (solid.vertices[part] * 1e3).tolist()
        yield "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in points)
    yield "</vertices><triangles>"
    for part in progress.part(0.4, 1.0).batches(len(solid.triangles), ROWS, WRITING):
        yield "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in solid.triangles[part].tolist())
    yield "</triangles></mesh></object>"
