"""What the cuts of a layout look like at every vertex, as one number: the less, the better drawn."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from .curvature import corner_angles
from .mesh import QuadMesh

# cost of a corner of a patch, in edges, by its angle: reflex ones spoil an outline most; chosen by eye, so that a seam goes
# three edges round rather than have one
REFLEX = 3.0
CONVEX = 0.25  # cost of a corner narrower than a straight line
SHARP = 2.0  # cost of a corner too pointed for an arm
TIP = 0.5  # cost of a cut that ends nowhere
WIDE, NARROW = np.radians(222.0), np.radians(138.0)  # 2 and 3 of 5 quads round a vertex count as straight
ACUTE = np.radians(50.0)  # below the 60 degrees of six quads round a vertex


@dataclass(frozen=True, eq=False)
class Ring:
    """Edges round a vertex, counter-clockwise, and the angle from each to the next, radians.

    On the border the first and last edge are the border's and there is one angle less.
    """

    edges: tuple[int, ...]
    angles: tuple[float, ...]
    closed: bool
    known: dict[int, float] = field(default_factory=dict)


@lru_cache(maxsize=4)
def rings(mesh: QuadMesh) -> list[Ring]:
    """The ring of every vertex."""
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
    """Cost of the patch corners at a vertex: reflex ones most, then very sharp ones, then the end of a cut.

    cut : the edges that are cut or on the border
    """
    pattern = 0
    for e in ring.edges:
        pattern = 2 * pattern + (e in cut)
    cost = ring.known.get(pattern)
    if cost is None:
        cost = ring.known[pattern] = _cost(ring, [e in cut for e in ring.edges])
    return cost


def _cost(ring: Ring, marks: list[bool]) -> float:
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
