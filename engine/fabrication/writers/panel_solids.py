"""Panels as solids for 3D printing: extruded to the sheet's thickness, as binary STL or 3MF, in millimetres."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ... import MARK
from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...progress import SILENT, Progress
from ...triangulation import triangulate
from ..panels.panel import Panel
from ..sheets import CutSheets
from .operations import WRITING

# vertices or triangles formatted between two reports of progress, which takes some 0.01 s; more delay a cancel
ROWS_AT_ONCE = 10_000
# maximum distance in metres between arcs and edges of the solid; printers resolve nothing finer, and smaller values
# make files larger and slicing slower
TOLERANCE = 2e-5

GROOVE_WIDTH = 4e-4  # width of engraved strokes in metres if no nozzle is given: the nozzle of most printers
GROOVE_DEPTH = (
    0.2  # depth of letters as a share of the thickness; deeper letters are clearer and weaken hubs in bending
)


@dataclass(frozen=True, eq=False)
class TriangleSolid:
    """A closed triangle mesh with outward normals.

    vertices : metres
    """

    name: str
    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]


def extrude_panel(panel: Panel, thickness: float, tolerance: float = TOLERANCE, nozzle: float = 0.0) -> TriangleSolid:
    """Extrude a panel from z = 0 to ``thickness`` metres, with the labels on its hubs as grooves.

    The mesh is closed: every edge belongs to exactly two triangles.

    Parameters
    ----------
    panel : the panel
    thickness : metres
    tolerance : maximum distance between arcs and edges of the solid, metres
    nozzle : width of the grooves in metres; 0 for ``GROOVE_WIDTH``

    Raises
    ------
    FlexMapsError : the panel's outline touches itself
    """
    import shapely

    rings = [curve.sample(tolerance) for curve in (panel.outline, *panel.holes)]
    polygon = shapely.Polygon(rings[0], rings[1:])
    if not polygon.is_valid:
        raise FlexMapsError(f"Panel {panel.number} cannot be made a solid: its outline touches itself")
    grooves = _grooves(panel, polygon, nozzle or GROOVE_WIDTH)
    # edges of the grooves, with the material of the panel on their left, as the panel's own rings have
    edges = [
        _ring_points(r, way) for g in grooves for way, some in ((-1, [g.exterior]), (1, g.interiors)) for r in some
    ]
    left = shapely.difference(polygon, shapely.MultiPolygon(grooves))
    top = list(getattr(left, "geoms", [left]))
    outer, flat = np.concatenate(rings), np.concatenate([*rings, *edges])
    floor = np.concatenate(edges) if edges else np.zeros((0, 2))
    # points and their heights: the panel's bottom, its top with the edges of the grooves, and the bottoms of the
    # grooves
    layers = [(outer, 0.0), (flat, thickness), (floor, (1.0 - GROOVE_DEPTH) * thickness)]
    first = np.cumsum([0, *(len(points) for points, _ in layers)])
    faces = [triangulate([polygon], outer)[:, ::-1], triangulate(top, flat) + first[1]]
    faces += [triangulate(grooves, floor) + first[2]] if grooves else []
    faces += [
        _wall_triangles([len(r) for r in rings], 0, int(first[1])),
        _wall_triangles([len(r) for r in edges], int(first[2]), int(first[1] + len(outer))),
    ]
    vertices = np.concatenate([np.column_stack([points, np.full(len(points), z)]) for points, z in layers])
    return TriangleSolid(
        f"{panel.kind} {panel.number}" if panel.number else panel.kind, vertices, np.concatenate(faces)
    )


def _grooves(panel: Panel, polygon: Any, width: float) -> list[Any]:
    """Return the strokes of letters on hubs as shapely polygons of this width, without those near an edge."""
    import shapely

    lines = [shapely.LineString(c.points).buffer(0.5 * width, quad_segs=2) for c in panel.hub_labels]
    inside = [one for one in lines if polygon.contains(one.buffer(width))]
    joined = shapely.unary_union(inside)
    return [one for one in getattr(joined, "geoms", [joined]) if not one.is_empty]


def _ring_points(ring: Any, way: int) -> Float[np.ndarray, "points 2"]:
    """Return the points of a shapely ring, counter-clockwise, or clockwise for ``way`` -1."""
    points = np.asarray(ring.coords)[:-1]
    return points if ring.is_ccw == (way > 0) else points[::-1]


def _wall_triangles(counts: list[int], low: int, high: int) -> Int[np.ndarray, "triangles 3"]:
    """Return the triangles of vertical walls along rings that have the material on their left.

    counts : number of points of every ring
    low, high : index of the vertex that is the first ring's first point, at the lower and at the upper end of the walls
    """
    start = np.cumsum([0, *counts])
    own = np.arange(start[-1])
    along = np.concatenate([own[:0], *(np.roll(own[a:b], -1) for a, b in pairwise(start.tolist()))])
    return np.concatenate(
        [
            np.stack([own + low, along + low, along + high], axis=1),
            np.stack([own + low, along + high, own + high], axis=1),
        ]
    )


def write_stl(sheets: CutSheets, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write sheet ``index`` (from 0) as binary STL, with the panels in their places."""
    write_solids_stl(_sheet_solids(sheets, index, progress), path, progress)


def write_3mf(sheets: CutSheets, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write sheet ``index`` (from 0) as 3MF, with each panel in its place as an object of its own."""
    write_solids_3mf(_sheet_solids(sheets, index, progress), path, progress)


def _sheet_solids(sheets: CutSheets, index: int, progress: Progress) -> list[TriangleSolid]:
    """Return the panels of one sheet as solids."""
    panels = sheets.panels_on_sheet(index)
    solids = []
    for number, panel in enumerate(panels):
        progress(0.7 * number / len(panels), f"building the solids of sheet {index + 1}")
        solids.append(extrude_panel(panel, sheets.thickness, nozzle=sheets.cut.nozzle))
    return solids


def write_solids_stl(solids: list[TriangleSolid], path: str | os.PathLike[str], progress: Progress = SILENT) -> None:
    """Write all solids into one binary STL file, in millimetres."""
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


def write_solids_3mf(solids: list[TriangleSolid], path: str | os.PathLike[str], progress: Progress = SILENT) -> None:
    """Write a 3MF package (3MF Core Specification 1.3) with one object per solid, in millimetres."""
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
                for text in _object_xml(number, solid, share):
                    stream.write(text.encode())
            items = "".join(f'<item objectid="{n}"/>' for n in range(1, len(solids) + 1))
            stream.write(f"</resources><build>{items}</build></model>".encode())


def _object_xml(number: int, solid: TriangleSolid, progress: Progress) -> Iterator[str]:
    """Yield the XML of one object."""
    yield f'<object id="{number}" type="model" name="{solid.name}"><mesh><vertices>'
    for part in progress.part(0.0, 0.4).batches(len(solid.vertices), ROWS_AT_ONCE, WRITING):
        # nine significant digits resolve a tenth of a micrometre and keep vertices distinct
        points = (solid.vertices[part] * 1e3).tolist()
        yield "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in points)
    yield "</vertices><triangles>"
    for part in progress.part(0.4, 1.0).batches(len(solid.triangles), ROWS_AT_ONCE, WRITING):
        yield "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in solid.triangles[part].tolist())
    yield "</triangles></mesh></object>"
