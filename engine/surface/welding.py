"""Weld vertices of different faces whose positions differ only by noise; the tolerance follows from edge lengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Float, Int
from ..components import components
from .mesh import PolygonMesh

# Distance below which vertices are welded, as a share of the length of a short edge (``short_edge_length``). Larger: thin
# slits close; smaller: noise keeps faces apart.
WELD_SHARE = 0.01
# Factors on the welding distance that are tried in order, as some programs leave more noise. The first factor is used
# after which the next factor welds no further vertices. Larger factors: more noise is welded, and thin slits close.
WELD_FACTORS = (1.0, 2.0, 4.0, 8.0)
# Percentile of the edge lengths that counts as the length of a short edge. Larger: thin slits close; near 0 a few
# slivers make the tolerance too small.
SHORT_PERCENTILE = 5.0


def short_edge_length(mesh: PolygonMesh) -> float:
    """Return the 5th percentile of the lengths of all faces' sides, without sides of length 0."""
    p = mesh.vertices[mesh.corners]
    lengths = np.linalg.norm(p[mesh.next_corner] - p, axis=1)
    lengths = lengths[lengths > 0]
    return float(np.percentile(lengths, SHORT_PERCENTILE)) if len(lengths) else 0.0


def weld(mesh: PolygonMesh) -> PolygonMesh:
    """Return a mesh in which vertices that only noise separates are merged at their mean, never two corners of a face."""
    used = np.unique(mesh.corners)
    with np.errstate(over="ignore"):
        squares = np.square(mesh.vertices[used])
    if not np.isfinite(squares).all():  # no number, or too large for distances: the checks name these vertices
        return mesh
    near = WELD_SHARE * short_edge_length(mesh)
    tried = [weld_clusters(mesh, used, factor * near) for factor in WELD_FACTORS]
    left = [len(np.unique(label[used])) for label in tried]
    # use the smallest distance beyond which no more vertices merge; without such a distance, noise and shape cannot be
    # distinguished, and the smallest distance of all is used
    best = next((k for k in range(len(WELD_FACTORS) - 1) if left[k] == left[k + 1]), 0)
    return merge_labelled(mesh, tried[best])


def weld_clusters(
    mesh: PolygonMesh, vertices: Int[np.ndarray, " some"], max_distance: float
) -> Int[np.ndarray, " vertices"]:
    """Group vertices into clusters to be welded, without two corners of one face in any cluster.

    Parameters
    ----------
    mesh : unchecked mesh, metres
    vertices : vertices that may be welded
    max_distance : largest distance of two neighbours in a cluster, metres

    Returns
    -------
    (V,) index of the first vertex of every vertex's cluster; its own index if it stays alone
    """
    label = np.arange(len(mesh.vertices))
    pairs = vertices[cKDTree(mesh.vertices[vertices]).query_pairs(max_distance, output_type="ndarray")]
    if not len(pairs):
        return label
    group = components(len(mesh.vertices), *pairs.T)
    for bad in np.unique(_degenerate_clusters(mesh, group)):
        group = _split_clusters(mesh, group, pairs[group[pairs[:, 0]] == bad])
    _, first, inverse = np.unique(group, return_index=True, return_inverse=True)
    return first[inverse]


def merge_labelled(mesh: PolygonMesh, label: Int[np.ndarray, " vertices"]) -> PolygonMesh:
    """Merge the vertices of every cluster at their mean position.

    Parameters
    ----------
    mesh : mesh to weld
    label : (V,) index of the first vertex of every vertex's cluster, from ``weld_clusters``

    Returns
    -------
    a mesh with one vertex per cluster; ``mesh`` itself if every vertex is alone
    """
    if (label == np.arange(len(label))).all():
        return mesh
    kept, index, counts = np.unique(label, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(index, mesh.vertices[:, k], len(kept)) for k in range(3)], axis=1)
    alone = counts == 1
    vertices = sums / counts[:, None]
    vertices[alone] = mesh.vertices[kept[alone]]
    return replace(mesh, vertices=vertices, corners=index.reshape(-1)[mesh.corners])


def _degenerate_clusters(mesh: PolygonMesh, group: Int[np.ndarray, " vertices"]) -> np.ndarray:
    """Return the clusters that contain two different corners of one face."""
    face, of_corner = mesh.face_of, group[mesh.corners]
    order = np.lexsort((mesh.corners, of_corner, face))
    f, g, v = face[order], of_corner[order], mesh.corners[order]
    return g[1:][(f[1:] == f[:-1]) & (g[1:] == g[:-1]) & (v[1:] != v[:-1])]


def _split_clusters(mesh: PolygonMesh, group: np.ndarray, pairs: Int[np.ndarray, "pairs 2"]) -> np.ndarray:
    """Split a cluster so that no part has two corners of one face, by joining its pairs anew, the nearest pair first.

    group : cluster of every vertex
    pairs : pairs of near vertices in the cluster to split
    """
    vertices = np.unique(pairs)
    face = mesh.face_of
    faces: dict[int, set[int]] = {v: set() for v in vertices.tolist()}
    for corner in np.flatnonzero(np.isin(mesh.corners, vertices)).tolist():
        faces[int(mesh.corners[corner])].add(int(face[corner]))
    own = {v: [v] for v in faces}
    root = {v: v for v in faces}
    away: Float[np.ndarray, " pairs"] = np.linalg.norm(np.diff(mesh.vertices[pairs], axis=1)[:, 0], axis=1)
    for a, b in pairs[np.argsort(away, kind="stable")].tolist():
        a, b = root[a], root[b]
        if a != b and not faces[a] & faces[b]:
            faces[a] |= faces[b]
            own[a] += own[b]
            root |= dict.fromkeys(own[b], a)
    made, free = group.copy(), int(group.max()) + 1
    for number, members in enumerate(own[r] for r in dict.fromkeys(root.values())):
        made[members] = free + number
    return made
