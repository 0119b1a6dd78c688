"""Find the areas that drawn lines enclose: nearby ends are joined, duplicate rings dropped, inner rings are holes.

Lengths in metres.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...components import components
from ...tolerances import DOUBLE_TOL

if TYPE_CHECKING:
    from shapely import Polygon

SNAP_DISTANCE = 2e-4  # metres within which ends are joined and lines count as equal; if larger, separate lines merge


@dataclass(eq=False)
class _Ring:
    """A closed ring, its nesting depth (0 is outermost), and the index of the outermost ring around it."""

    polygon: Polygon
    depth: int
    root: int


def enclosed_areas(lines: Iterable[tuple[np.ndarray, bool]]) -> list[Polygon]:
    """Return the areas of material, largest first: an outermost ring without its holes, and rings inside these holes.

    lines : for every line its points (N, 2), metres, and whether it is closed
    """
    import shapely

    closed: list[np.ndarray] = []
    open_: list[np.ndarray] = []
    for points, shut in lines:
        near = len(points) > 2 and float(np.linalg.norm(points[0] - points[-1])) <= SNAP_DISTANCE
        (closed if shut or near else open_).append(points)
    rings = [p for points in closed if len(points) >= 3 for p in _outer_rings(points)]
    rings += [shapely.Polygon(p.exterior) for p in _areas_within_open_lines([p for p in open_ if len(p) >= 2])]
    found: list[_Ring] = []
    made: dict[int, Polygon] = {}
    for polygon in _without_duplicates(sorted(rings, key=lambda r: -r.area)):
        # a hole that crosses the outline around it makes a notch, so it counts as inside the outline
        inner = polygon.buffer(-SNAP_DISTANCE)
        around = [
            r for r in found if r.polygon.intersects(inner) and (r.depth % 2 == 0 or _contains(r.polygon, polygon))
        ]
        deepest = max(around, key=lambda r: r.depth, default=None)
        if deepest is None:
            made[len(found)] = polygon
            found.append(_Ring(polygon, 0, len(found)))
            continue
        ring = _Ring(polygon, deepest.depth + 1, deepest.root)
        before = made[ring.root]
        made[ring.root] = before.difference(polygon) if ring.depth % 2 else before.union(polygon)
        found.append(ring)
    parts = [p for area in made.values() for p in shapely.get_parts(area) if p.geom_type == "Polygon"]
    return sorted(parts, key=lambda p: -p.area)


def _contains(outer: Polygon, inner: Polygon) -> bool:
    """Return whether ``inner`` lies inside ``outer``, with the snap distance as tolerance."""
    return bool(outer.buffer(SNAP_DISTANCE).contains(inner))


def _outer_rings(points: np.ndarray) -> list[Polygon]:
    """Return the outer rings of a closed line that may cross itself; loops inside them are ignored."""
    import shapely

    ring = shapely.Polygon(points)
    if ring.is_valid:
        return [ring] if ring.area > 0.0 else []
    faces = shapely.get_parts(shapely.polygonize([shapely.unary_union(ring.exterior, grid_size=DOUBLE_TOL)]))
    return [shapely.Polygon(p.exterior) for p in shapely.get_parts(shapely.unary_union(faces)) if p.area > 0.0]


def _areas_within_open_lines(lines: list[np.ndarray]) -> list[Polygon]:
    """Return the areas enclosed by open lines whose ends meet within the snap distance."""
    import shapely
    from scipy.spatial import cKDTree

    if not lines:
        return []
    lines = [points.copy() for points in lines]
    ends = np.concatenate([points[[0, -1]] for points in lines])
    pairs = cKDTree(ends).query_pairs(SNAP_DISTANCE, output_type="ndarray")
    group = components(len(ends), *pairs.T)
    middle = np.stack([np.bincount(group, x) for x in ends.T], axis=1) / np.bincount(group)[:, None]
    for i, points in enumerate(lines):
        points[[0, -1]] = middle[group[2 * i : 2 * i + 2]]
    strings = [shapely.LineString(p) for p in lines]
    # join ends that meet no other end to a line within the snap distance
    alone = shapely.points(ends[np.bincount(group)[group] == 1])
    tree = shapely.STRtree(strings)
    point, line = tree.query(alone, predicate="dwithin", distance=SNAP_DISTANCE)
    bridges = shapely.shortest_line(alone[point], np.array(strings, dtype=object)[line])
    whole = shapely.unary_union([*strings, *bridges[shapely.length(bridges) > 0.0]], grid_size=DOUBLE_TOL)
    return [p for p in shapely.get_parts(shapely.polygonize(shapely.get_parts(whole))) if p.area > 0.0]


def _without_duplicates(rings: list[Polygon]) -> list[Polygon]:
    """Return the rings that do not coincide with an earlier ring, within the snap distance."""
    import shapely

    kept: list[Polygon] = []
    bands: list[Polygon] = []
    for ring in rings:
        band = _snap_band(ring)
        near = shapely.STRtree(bands).query(ring.exterior, predicate="covered_by") if bands else ()
        if not any(band.covers(kept[k].exterior) for k in near):
            kept.append(ring)
            bands.append(band)
    return kept


def _snap_band(ring: Polygon) -> Polygon:
    """Return the area within the snap distance of the sides of a ring, with sharp corners."""
    return ring.exterior.buffer(SNAP_DISTANCE, join_style="mitre")
