"""Cost of the patch corners that the cuts of a layout make at a vertex; lower is a cleaner outline."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from .curvature import corner_angles
from .mesh import QuadMesh

# Costs are in edges of cut. This one is for a reflex corner, which spoils an outline most. Chosen by eye, so that a
# seam rather goes three edges round than has such a corner, or turns by a right angle on its way. For turns 1.5 and 6 give the same on two surfaces.
REFLEX = 3.0
CONVEX = 0.25  # cost of a corner narrower than a straight line
SHARP = 2.0  # cost of a corner too pointed for an arm
TIP = 0.5  # cost of a cut that ends inside the surface
# radians: angles between them count as straight, so that 2 and 3 of 5 quads round a vertex do
WIDE, NARROW = np.radians(222.0), np.radians(138.0)
ACUTE = np.radians(50.0)  # radians: corners below it are too pointed; six quads round a vertex make 60 degrees


@dataclass(frozen=True, eq=False)
class Ring:
    """Edges round a vertex, counter-clockwise, and the angle from each to the next, radians.

    At a border vertex the first and the last edge lie on the border, and there is one angle less than edges. ``known``
    caches costs by the pattern of cut edges.
    """

    edges: tuple[int, ...]
    angles: tuple[float, ...]
    closed: bool
    known: dict[int, float] = field(default_factory=dict)


@lru_cache(maxsize=4)
def rings(mesh: QuadMesh) -> list[Ring]:
    """Return the ring of every vertex."""
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
    return [_ring(step) for step in follow]


def _ring(step: dict[int, tuple[int, float]]) -> Ring:
    """Build a ring by following the edges round a vertex; ``step`` maps an edge to the next edge and the angle between."""
    if not step:
        return Ring((), (), True)
    targets = {edge for edge, _ in step.values()}
    starts = [edge for edge in step if edge not in targets]
    edge = first = starts[0] if starts else min(step)
    edges, angles = [edge], []
    while edge in step:
        edge, angle = step[edge]
        angles.append(angle)
        if edge == first:
            return Ring(tuple(edges), tuple(angles), True)
        edges.append(edge)
    return Ring(tuple(edges), tuple(angles), False)


def corner_cost(ring: Ring, cut: Container[int]) -> float:
    """Return the cost of the patch corners at a vertex: reflex and very sharp corners, ends of cuts.

    Parameters
    ----------
    ring : edges and angles round the vertex
    cut : edges that are cut or on the border

    Returns
    -------
    cost, in edges
    """
    pattern = 0
    for e in ring.edges:
        pattern = 2 * pattern + (e in cut)
    cost = ring.known.get(pattern)
    if cost is None:
        cost = ring.known[pattern] = _cost(ring, [e in cut for e in ring.edges])
    return cost


def _cost(ring: Ring, marks: list[bool]) -> float:
    """Add up the costs of the sectors between cut edges; ``marks`` tells for every edge of the ring whether it is cut."""
    count = sum(marks)
    if count < 2:
        return 0.0 if count == 0 or len(marks) != 4 else TIP
    angles = ring.angles
    if ring.closed:
        start = marks.index(True)
        marks = marks[start:] + marks[:start] + [True]
        angles = angles[start:] + angles[:start]
    cost, sector = 0.0, 0.0
    for angle, mark in zip(angles, marks[1:], strict=True):
        sector += angle
        if mark:
            if sector > WIDE:
                cost += REFLEX
            elif sector < ACUTE:
                cost += SHARP
            elif sector < NARROW:
                cost += CONVEX
            sector = 0.0
    return cost
