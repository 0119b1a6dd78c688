"""Straight runs of edges through a flat patch, from its outline to its outline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from ...arrays import Float, Int
from ...surface.corner_costs import REFLEX_COST
from ..flattening.flatten import FlatPatches

# Largest number of starts times number of directed edges, which bounds memory to about 200 MB. With more, only some
# starts are used; larger values need more memory and find straighter runs in large patches.
MAX_ENTRIES = 10_000_000
CHUNK = 500_000  # number of starts times directed edges between two checks for a cancel; larger values delay a cancel


@dataclass(frozen=True, eq=False)
class StraightRuns:
    """The straightest run of edges through a patch between any two places on its outline.

    A run may follow the border of a hole, where nothing has to be cut. Directed edge i < m is inner edge i; directed
    edge m + i is inner edge i in the opposite direction.

    loop : flat vertices of the outline, in order
    inner : mesh edges inside the patch and round its holes
    tail, head : (2 m,) flat vertices at the start and the end of every directed edge
    starts, ends : directed edges that begin, or end, on the outline
    cost : cost of every run, metres: its length plus costs of bends
    predecessor : (starts, 2 m) for every start and every directed edge, the directed edge before it on the run
    """

    loop: Int[np.ndarray, " points"]
    inner: Int[np.ndarray, " m"]
    tail: np.ndarray
    head: np.ndarray
    starts: Int[np.ndarray, " starts"]
    ends: Int[np.ndarray, " ends"]
    cost: Float[np.ndarray, "starts ends"]
    predecessor: np.ndarray

    def edges(self, start: int, end: int) -> np.ndarray:
        """Return the mesh edges of the run from directed edge ``starts[start]`` to ``ends[end]``, last edge first."""
        walk = [int(self.ends[end])]
        while walk[-1] != self.starts[start]:
            walk.append(int(self.predecessor[start, walk[-1]]))
        return self.inner[np.array(walk) % len(self.inner)]


def straight_runs(flat: FlatPatches, patch: int, tick: Callable[[], None] = lambda: None) -> StraightRuns | None:
    """Find the straightest runs through a patch, by Dijkstra's algorithm on its directed edges.

    Parameters
    ----------
    flat : flat patches
    patch : number of the patch
    tick : called at intervals; may raise an exception to cancel

    Returns
    -------
    the runs, or None if the patch has no inner edges
    """
    layout, mesh = flat.layout, flat.layout.mesh
    loop = flat.outlines[patch]
    inner = layout.uncut_edges[layout.patch_of[mesh.edge_quads[layout.uncut_edges, 0]] == patch]
    if not len(inner):
        return None
    quads = layout.patches[patch]
    away = ~np.isin(layout.flat_corners[quads], loop) & layout.outline_sides[quads]
    inner = np.concatenate([inner, mesh.quad_edges[quads][away]])
    first = (mesh.edge_quads[inner, 0] < 0).astype(np.int64)
    quad, side = mesh.edge_quads[inner, first], mesh.edge_sides[inner, first]
    a, b = layout.flat_corners[quad, side], layout.flat_corners[quad, (side + 1) % 4]
    tail, head = np.concatenate([a, b]), np.concatenate([b, a])
    on_outline = np.zeros(len(flat.points), dtype=bool)
    on_outline[loop] = True
    step = flat.points[head] - flat.points[tail]
    length = np.linalg.norm(step, axis=1)
    one, two = _successor_pairs(tail, head, ~on_outline)
    cross = step[one, 0] * step[two, 1] - step[one, 1] * step[two, 0]
    bend = np.abs(np.arctan2(cross, (step[one] * step[two]).sum(axis=1)))
    # bends up to 22.5 degrees are not corners, because lines of edges bend slightly all the time
    corner = np.maximum(bend - np.pi / 8, 0.0) / (np.pi / 2 - np.pi / 8)
    weight = length[two] + REFLEX_COST * length.mean() * (corner + 0.02 * bend)
    starts, ends = np.flatnonzero(on_outline[tail]), np.flatnonzero(on_outline[head])
    starts = starts[:: max(1, len(starts) * len(tail) // MAX_ENTRIES)]
    graph = coo_array((weight, (one, two)), shape=(len(tail), len(tail))).tocsr()
    found = []
    for part in np.array_split(starts, -(-len(starts) * len(tail) // CHUNK)):
        tick()
        found.append(dijkstra(graph, indices=part, return_predecessors=True))
    cost, before = (np.concatenate(x) for x in zip(*found, strict=True))
    return StraightRuns(loop, inner, tail, head, starts, ends, cost[:, ends] + length[starts, None], before)


def _successor_pairs(tail: np.ndarray, head: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of directed edges of which the second continues the first at an inner vertex, not backwards.

    tail, head : flat vertices at the start and the end of every directed edge
    inside : mask of the flat vertices that are not on the outline
    """
    order = np.argsort(tail, kind="stable")
    count = np.bincount(tail, minlength=len(inside))
    first = np.concatenate([[0], np.cumsum(count)])
    number = np.where(inside[head], count[head], 0)
    one = np.repeat(np.arange(len(head)), number)
    place = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    two = order[first[head[one]] + place]
    forward = head[two] != tail[one]
    return one[forward], two[forward]


def ends_and_unevenness(flat: FlatPatches, runs: StraightRuns) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where runs start (s,) and end (e,) on the outline, and how unevenly they divide the patch (s, e).

    Unevenness is the difference between the areas on both sides of a run over the patch's whole area, from 0 to 1. Runs
    are almost straight, so the area beside a run is approximated by that beside the chord from its start to its end.

    Parameters
    ----------
    flat : flat patches
    runs : runs through one of the patches
    """
    number = np.full(len(flat.points), -1)
    number[runs.loop] = np.arange(len(runs.loop))
    tails, heads = number[runs.tail[runs.starts]], number[runs.head[runs.ends]]
    points = flat.points[runs.loop]
    whole = 0.5 * (points[:, 0] * np.roll(points[:, 1], -1) - points[:, 1] * np.roll(points[:, 0], -1)).sum()
    return tails, heads, np.abs(2.0 * chord_areas(points)[tails[:, None], heads] / whole - 1.0)


def chord_areas(points: np.ndarray) -> Float[np.ndarray, "points points"]:
    """Return the signed area [i, j] between a closed outline from point i to point j and the chord back from j to i.

    points : (points, 2) the outline in order, metres; areas are in square metres
    """
    after = np.roll(points, -1, axis=0)
    parts = 0.5 * (points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0])
    sums = np.concatenate([[0.0], np.cumsum(parts)])[:-1]
    chord = 0.5 * (points[None, :, 0] * points[:, None, 1] - points[None, :, 1] * points[:, None, 0])
    return sums[None, :] - sums[:, None] + chord
