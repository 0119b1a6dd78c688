"""Cost of the patch corners that the cuts of a layout make at a vertex; low costs mean smooth outlines."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from .curvature import corner_angles
from .mesh import QuadMesh

# Cost of a reflex corner, in edges of additional cut: a seam takes a detour of up to three edges to avoid such a corner.
# Larger: longer seams with smoother outlines.
REFLEX_COST = 3.0
CONVEX_COST = 0.25  # cost of a convex corner, in edges of cut; larger: straighter outlines, longer seams
ACUTE_COST = 2.0  # cost of a corner too pointed for an arm, in edges of cut; larger: fewer such corners, longer seams
DEAD_END_COST = 0.5  # cost of a cut that ends inside the surface, in edges of cut; larger: fewer such cuts
# Largest and smallest angle of a patch at a vertex, radians, at which its outline counts as straight there: wide enough
# for 2 and for 3 of 5 quads round a vertex. A wider range permits more crooked outlines.
MAX_STRAIGHT, MIN_STRAIGHT = np.radians(222.0), np.radians(138.0)
# Angle of a patch corner, radians, below which it is too pointed for an arm; less than the 60 degrees of a quad where six
# quads meet. Larger: such quads count as too pointed.
MIN_CORNER = np.radians(50.0)


@dataclass(frozen=True, eq=False)
class EdgeRing:
    """Edges round a vertex, counter-clockwise, and the angle from each edge to the next, radians.

    edges : indices of the edges; at a border vertex the first and the last lie on the border
    angles : as many as edges; at a border vertex one less
    is_closed : False at a border vertex, else True
    cost_cache : costs already computed by ``corner_cost``; key: bit pattern of the cut edges
    """

    edges: tuple[int, ...]
    angles: tuple[float, ...]
    is_closed: bool
    cost_cache: dict[int, float] = field(default_factory=dict)


@lru_cache(maxsize=4)
def edge_rings(mesh: QuadMesh) -> list[EdgeRing]:
    """Return the ring of edges round every vertex."""
    follow: list[dict[int, tuple[int, float]]] = [{} for _ in range(len(mesh.vertices))]
    before = np.roll(mesh.quad_edges, 1, axis=1)
    for v, out, back, a in zip(
        mesh.quads.ravel().tolist(),
        mesh.quad_edges.ravel().tolist(),
        before.ravel().tolist(),
        corner_angles(mesh).ravel().tolist(),
        strict=True,
    ):
        follow[v][out] = (back, a)
    return [_build_ring(step) for step in follow]


def _build_ring(step: dict[int, tuple[int, float]]) -> EdgeRing:
    """Build the ring of a vertex; ``step`` maps every edge to the next edge and the angle between them."""
    if not step:
        return EdgeRing((), (), True)
    targets = {edge for edge, _ in step.values()}
    starts = [edge for edge in step if edge not in targets]
    edge = first = starts[0] if starts else min(step)
    edges, angles = [edge], []
    while edge in step:
        edge, angle = step[edge]
        angles.append(angle)
        if edge == first:
            return EdgeRing(tuple(edges), tuple(angles), True)
        edges.append(edge)
    return EdgeRing(tuple(edges), tuple(angles), False)


def corner_cost(ring: EdgeRing, cut: Container[int]) -> float:
    """Return the cost of the patch corners and ends of cuts at a vertex.

    Parameters
    ----------
    ring : edges and angles round the vertex
    cut : edges that are cut or on the border

    Returns
    -------
    cost, in edges of additional cut
    """
    pattern = 0
    for e in ring.edges:
        pattern = 2 * pattern + (e in cut)
    cost = ring.cost_cache.get(pattern)
    if cost is None:
        cost = ring.cost_cache[pattern] = _sum_corner_costs(ring, [e in cut for e in ring.edges])
    return cost


def _sum_corner_costs(ring: EdgeRing, marks: list[bool]) -> float:
    """Add up the costs of the patch corners between cut edges; ``marks`` is a mask of the ring's cut edges."""
    count = sum(marks)
    if count < 2:
        return 0.0 if count == 0 or len(marks) != 4 else DEAD_END_COST
    angles = ring.angles
    if ring.is_closed:
        start = marks.index(True)
        marks = marks[start:] + marks[:start] + [True]
        angles = angles[start:] + angles[:start]
    cost, sector = 0.0, 0.0
    for angle, mark in zip(angles, marks[1:], strict=True):
        sector += angle
        if mark:
            if sector > MAX_STRAIGHT:
                cost += REFLEX_COST
            elif sector < MIN_CORNER:
                cost += ACUTE_COST
            elif sector < MIN_STRAIGHT:
                cost += CONVEX_COST
            sector = 0.0
    return cost
