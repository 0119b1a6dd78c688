"""Areas from drawn lines: ends that nearly meet are joined, rings that coincide count once, rings in rings are holes.

Lengths in metres.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from shapely import Polygon

JOINED = 2e-4  # metres within which ends meet and lines coincide; more joins what is meant to be apart
_NODE = 1e-9  # metres to which crossings of lines are rounded


@dataclass(eq=False)
class _Ring:
    """A ring: its area, how many rings lie around it, and the outermost of them."""

    polygon: Polygon
    depth: int
    root: int


def areas(lines: Iterable[tuple[np.ndarray, bool]]) -> list[Polygon]:
    """The area within every outermost ring, with its holes, the largest first.

    lines : points (N, 2) and whether they are closed
    """
    import shapely

    closed: list[np.ndarray] = []
    open_: list[np.ndarray] = []
    for points, shut in lines:
        near = len(points) > 2 and float(np.linalg.norm(points[0] - points[-1])) <= JOINED
        (closed if shut or near else open_).append(points)
    rings = [p for points in closed if len(points) >= 3 for p in _simple(points)]
    rings += [shapely.Polygon(p.exterior) for p in _enclosed([p for p in open_ if len(p) >= 2])]
    found: list[_Ring] = []
    made: dict[int, Polygon] = {}
    for polygon in _different(sorted(rings, key=lambda r: -r.area)):
        # a ring across an outline is a notch, so it counts as lying inside of it
        inner = polygon.buffer(-JOINED)
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
    return bool(outer.buffer(JOINED).contains(inner))


def _simple(points: np.ndarray) -> list[Polygon]:
    """A closed line as rings that do not cross themselves, without what lies inside of their loops."""
    import shapely

    ring = shapely.Polygon(points)
    if ring.is_valid:
        return [ring] if ring.area > 0.0 else []
    faces = shapely.get_parts(shapely.polygonize([shapely.unary_union(ring.exterior, grid_size=_NODE)]))
    return [shapely.Polygon(p.exterior) for p in shapely.get_parts(shapely.unary_union(faces)) if p.area > 0.0]


def _enclosed(lines: list[np.ndarray]) -> list[Polygon]:
    """What open lines enclose together."""
    import shapely
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if not lines:
        return []
    lines = [points.copy() for points in lines]
    ends = np.concatenate([points[[0, -1]] for points in lines])
    pairs = cKDTree(ends).query_pairs(JOINED, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(ends), len(ends)))
    count, group = connected_components(graph, directed=False)
    middle = np.stack([np.bincount(group, x, count) for x in ends.T], axis=1) / np.bincount(group)[:, None]
    for i, points in enumerate(lines):
        points[[0, -1]] = middle[group[2 * i : 2 * i + 2]]
    strings = [shapely.LineString(p) for p in lines]
    # an end that stops short of the middle of a line
    alone = shapely.points(ends[np.bincount(group)[group] == 1])
    tree = shapely.STRtree(strings)
    point, line = tree.query(alone, predicate="dwithin", distance=JOINED)
    bridges = shapely.shortest_line(alone[point], np.array(strings, dtype=object)[line])
    whole = shapely.unary_union([*strings, *bridges[shapely.length(bridges) > 0.0]], grid_size=_NODE)
    return [p for p in shapely.get_parts(shapely.polygonize(shapely.get_parts(whole))) if p.area > 0.0]


def _different(rings: list[Polygon]) -> list[Polygon]:
    """The rings that do not coincide with an earlier one."""
    import shapely

    kept: list[Polygon] = []
    bands: list[Polygon] = []
    for ring in rings:
        band = _band(ring)
        near = shapely.STRtree(bands).query(ring.exterior, predicate="covered_by") if bands else ()
        if not any(band.covers(kept[k].exterior) for k in near):
            kept.append(ring)
            bands.append(band)
    return kept


def _band(ring: Polygon) -> Polygon:
    """What lies within ``JOINED`` of the sides of a ring, with sharp corners."""
    return ring.exterior.buffer(JOINED, join_style="mitre")
