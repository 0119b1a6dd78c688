"""Redraw seams along the straightest path between their ends, through both adjacent patches.

This is for meshes with irregular vertices everywhere, which have no rows of quads by which a seam could slide (see
``straighten``). Straightness is measured by the angles on both sides of the line (Polthier & Schmies 1998).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ...arrays import Int
from ...surface.corner_costs import REFLEX_COST, edge_rings
from ...surface.mesh import QuadMesh
from .board import MergeBoard
from .straighten import MIN_GAIN, gain_of, try_change

# Largest numbers of edges by which the ends of a redrawn seam may move along the outline of both patches, tried in turn;
# more and larger numbers straighten more and take longer
END_SLIDES = (0, 2, 5)


@lru_cache(maxsize=4)
def bend_costs(mesh: QuadMesh) -> csr_array:
    """Return the costs of continuing from a directed edge to a next directed edge, (2 E, 2 E), in median edge lengths.

    A cost is the length of the next edge plus a cost of the bend between the two. Directed edge e runs from the smaller
    to the larger vertex of edge e, directed edge E + e in the opposite direction.
    """
    count = len(mesh.edges)
    first = mesh.edges[:, 0].tolist()
    length = (mesh.edge_lengths / mesh.median_edge).tolist()
    rows, cols, values = [], [], []
    for vertex, ring in enumerate(edge_rings(mesh)):
        if not ring.is_closed:
            continue
        along = np.concatenate([[0.0], np.cumsum(ring.angles)])
        for i, e in enumerate(ring.edges):
            into = count + e if first[e] == vertex else e
            for j, f in enumerate(ring.edges):
                if i == j:
                    continue
                left = abs(along[j] - along[i])
                turn = np.pi * abs(1.0 - 2.0 * left / along[-1])
                corner = max(turn - np.pi / 8, 0.0) / (np.pi / 2 - np.pi / 8)
                rows.append(into)
                cols.append(f if first[f] == vertex else count + f)
                values.append(length[f] + REFLEX_COST * (corner + 0.02 * turn))
    return csr_array((values, (rows, cols)), shape=(2 * count, 2 * count))


def redraw_seams(board: MergeBoard) -> bool:
    """Redraw seams between two patches where that makes the cuts shorter or straighter; return whether any changed."""
    changed = False
    for seam in board.layout.seams:
        names = board.pieces_at(seam[:1])[0]
        around = np.sort(board.pieces_at(seam), axis=1)
        if names[0] == names[1] or not board.cut[seam].all() or (around != np.sort(names)).any():
            continue  # skip inner cuts and seams that no longer exist
        if not board.is_first_image(seam):
            continue
        listed = []
        for slide in END_SLIDES:
            way = _straightest_path(board, seam, names, slide)
            if way is None:
                continue
            opens, closes = np.setdiff1d(seam, way), np.setdiff1d(way, seam)
            if len(opens) and len(closes) and (gain := gain_of(board, opens, closes)) > MIN_GAIN:
                listed.append((-round(gain, 6), slide, opens, closes))
        for _, _, opens, closes in sorted(listed, key=lambda item: item[:2]):
            if try_change(board, opens, closes):
                changed = True
                break
    return changed


def _straightest_path(
    board: MergeBoard, seam: np.ndarray, names: np.ndarray, slide: int
) -> Int[np.ndarray, " n"] | None:
    """Return the edges of the straightest path through both patches between the ends of a seam; None if there is none.

    names : serials of both pieces
    slide : largest number of edges by which the path's ends may differ from the seam's ends, along the outline
    """
    mesh = board.mesh
    quads = np.concatenate([board.pieces[n].quads for n in names.tolist()])
    edges = np.unique(mesh.quad_edges[quads])
    inner = edges[~mesh.border[edges] & np.isin(board.pieces_at(edges), names).all(axis=1)]
    inner = np.union1d(inner[~board.cut[inner]], seam)
    outline = np.setdiff1d(edges, inner)
    ends = _end_vertices(mesh.edges[seam])
    if ends is None or not len(outline):
        return None
    pairs = mesh.edges[outline]
    begin, stop = (_vertices_near(pairs, v, slide) for v in ends)
    if np.intersect1d(begin, stop).size:
        return None
    count = len(mesh.edges)
    rim = np.zeros(len(mesh.vertices), dtype=bool)
    rim[pairs] = True
    nodes = np.concatenate([inner, count + inner])
    tail = np.concatenate([mesh.edges[inner, 0], mesh.edges[inner, 1]])
    head = np.concatenate([mesh.edges[inner, 1], mesh.edges[inner, 0]])
    # the path may touch the outline only at its ends
    usable = (~rim[tail] | np.isin(tail, begin)) & (~rim[head] | np.isin(head, stop))
    nodes, tail, head = nodes[usable], tail[usable], head[usable]
    starts, goals = np.flatnonzero(np.isin(tail, begin)), np.flatnonzero(np.isin(head, stop))
    if not len(starts) or not len(goals):
        return None
    graph = bend_costs(mesh)[nodes][:, nodes]
    cost, before = dijkstra(graph, indices=starts, return_predecessors=True)
    total = cost[:, goals] + (mesh.edge_lengths[nodes[starts] % count] / mesh.median_edge)[:, None]
    if not np.isfinite(total).any():
        return None
    i, j = np.unravel_index(int(np.argmin(np.round(total, 9))), total.shape)
    walk = [int(goals[j])]
    while walk[-1] != starts[i]:
        walk.append(int(before[i, walk[-1]]))
    return np.unique(nodes[walk] % count)


def _end_vertices(pairs: np.ndarray) -> tuple[int, int] | None:
    """Return the two end vertices of a run of edges (n, 2); None if it is closed."""
    vertices, count = np.unique(pairs, return_counts=True)
    tips = vertices[count == 1].tolist()
    return (tips[0], tips[1]) if len(tips) == 2 else None


def _vertices_near(pairs: np.ndarray, vertex: int, steps: int) -> np.ndarray:
    """Return the vertices of outline edges (n, 2) within ``steps`` edges of a vertex."""
    found = np.array([vertex])
    for _ in range(steps):
        touched = np.isin(pairs, found).any(axis=1)
        found = np.union1d(found, pairs[touched])
    return found
