"""The layout of patches: a boolean per edge says where the surface is cut (FlexMaps section 4).

Every change of a layout (merging, cutting, joining, manual edits) flips a run of edges between cut and uncut. A patch
may have cuts inside itself: in this way a sphere becomes a single patch.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..arrays import Bool, Float, Int
from ..surface.curvature import corner_angles
from ..surface.mesh import QuadMesh
from .loops import compactness_lengths, loops_of


def _renumber_by_first(labels: np.ndarray) -> Int[np.ndarray, " nodes"]:
    """Renumber labels from 0 in the order in which they first occur."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


def loops_of_sides(start: Int[np.ndarray, " sides"], end: Int[np.ndarray, " sides"]) -> Int[np.ndarray, " sides"]:
    """Return the closed loop to which every directed side belongs, numbered from 0.

    Parameters
    ----------
    start, end : nodes (such as flat vertices) at both ends of every side
    """
    used, ends = np.unique(np.stack([start, end]), return_inverse=True)
    ends = ends.reshape(2, -1)
    return component_numbers(len(used), ends[0], ends[1])[ends[0]]


def component_numbers(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the connected component of every node; components are numbered from 0, ordered by their smallest node.

    Parameters
    ----------
    count : number of nodes
    a, b : nodes at both ends of every link

    Returns
    -------
    (count,) int
    """
    if count > 4000:
        graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count, count))
        labels = connected_components(graph, directed=False)[1]
        return _renumber_by_first(labels)
    # for few nodes, propagating the smallest label is faster than building a sparse graph
    labels = np.arange(count)
    while True:
        before = labels.copy()
        low = np.minimum(labels[a], labels[b])
        np.minimum.at(labels, a, low)
        np.minimum.at(labels, b, low)
        labels = labels[labels]
        if (labels == before).all():
            break
    roots = labels == np.arange(count)
    return (np.cumsum(roots) - 1)[labels]


@dataclass(frozen=True, eq=False)
class PatchLayout:
    """A quad mesh and its cuts.

    mesh : the surface
    cut : True where the surface is cut; border edges are never marked
    notes : entries of the report about the layout, such as kept symmetries and patches beyond a limit
    origin : how the program made the first cuts: along "lines" of quads or between "regions"; "" for other cuts, such
        as cuts by a person or after merging
    """

    mesh: QuadMesh
    cut: Bool[np.ndarray, " edges"]
    notes: dict[str, object] = field(default_factory=dict)
    origin: str = ""

    @cached_property
    def uncut_edges(self) -> Int[np.ndarray, " joints"]:
        """Inner edges that are not cut."""
        return np.flatnonzero(~self.cut & ~self.mesh.border)

    @cached_property
    def patch_of(self) -> Int[np.ndarray, " quads"]:
        """Patch of every quad; patches are numbered from 0 by their smallest quad."""
        a, b = self.mesh.edge_quads[self.uncut_edges].T
        return component_numbers(len(self.mesh.quads), a, b)

    @cached_property
    def patches(self) -> tuple[np.ndarray, ...]:
        """Quads of every patch, ascending."""
        order = np.argsort(self.patch_of, kind="stable")
        counts = np.bincount(self.patch_of)
        return tuple(np.split(order, np.cumsum(counts)[:-1]))

    @cached_property
    def flat_corners(self) -> Int[np.ndarray, "quads 4"]:
        """Flat vertex of every quad corner, numbered 0..P-1.

        Flat vertices are the vertices of the mesh after it has been cut open: corners of two quads share a flat vertex
        if they meet at an uncut edge of both quads.
        """
        mesh = self.mesh
        (qa, qb), (ka, kb) = mesh.edge_quads[self.uncut_edges].T, mesh.edge_sides[self.uncut_edges].T
        # sides of two quads on an edge have opposite directions: corner k meets corner k'+1, k+1 meets k'
        a = np.concatenate([4 * qa + ka, 4 * qa + (ka + 1) % 4])
        b = np.concatenate([4 * qb + (kb + 1) % 4, 4 * qb + kb])
        return component_numbers(4 * len(mesh.quads), a, b).reshape(-1, 4)

    # -- measures of every patch ---------------------------------------------------------------------------------

    @cached_property
    def euler_characteristic(self) -> Int[np.ndarray, " patches"]:
        """Euler characteristic of every patch, cut open along its inner cuts; 1 for a disk, less 1 for every hole."""
        n = len(self.patches)
        patch = np.repeat(self.patch_of, 4)
        _, first = np.unique(self.flat_corners, return_index=True)
        vertices = np.bincount(patch[first], minlength=n)
        faces = np.bincount(self.patch_of, minlength=n)
        inner = np.bincount(self.patch_of[self.mesh.edge_quads[self.uncut_edges, 0]], minlength=n)
        return vertices - (4 * faces - inner) + faces

    @cached_property
    def outline_sides(self) -> Bool[np.ndarray, "quads 4"]:
        """Mask of quad sides on the outline of their patch (cut or border)."""
        return (self.cut | self.mesh.border)[self.mesh.quad_edges]

    @cached_property
    def loop_of(self) -> Int[np.ndarray, "quads 4"]:
        """Loop of an outline to which each side of a quad belongs, numbered from 0; -1 for sides inside a patch."""
        quad, side = np.nonzero(self.outline_sides)
        start, end = self.flat_corners[quad, side], self.flat_corners[quad, (side + 1) % 4]
        result = np.full(self.outline_sides.shape, -1, dtype=np.int64)
        result[quad, side] = loops_of_sides(start, end)
        return result

    @cached_property
    def loop_patch(self) -> Int[np.ndarray, " loops"]:
        """Patch to whose outline every loop belongs."""
        quad, side = np.nonzero(self.outline_sides)
        patch = np.empty(int(self.loop_of.max()) + 1, dtype=np.int64)
        patch[self.loop_of[quad, side]] = self.patch_of[quad]
        return patch

    @cached_property
    def loop_lengths(self) -> Float[np.ndarray, " loops"]:
        """Length of every loop on the surface, metres; ragged borders count as smooth, and inner cuts count twice."""
        sides = self.outline_sides
        return np.bincount(self.loop_of[sides], weights=smoothed_edge_lengths(self.mesh)[self.mesh.quad_edges][sides])

    @cached_property
    def is_flattenable(self) -> Bool[np.ndarray, " patches"]:
        """Mask of patches whose topology allows laying them flat: disks, also with holes, but not tubes."""
        loops = np.bincount(self.loop_patch, minlength=len(self.patches))
        good = (self.euler_characteristic == 2 - loops) & (loops > 0)  # closed patches cannot be laid flat
        for patch in np.flatnonzero(good & (loops > 1)).tolist():
            quads = self.patches[patch]
            corners = np.unique(self.flat_corners[quads], return_inverse=True)[1].reshape(-1, 4)
            found = loops_of(corners, self.outline_sides[quads])
            good[patch] = found.has_only_holes(
                corners, corner_angles(self.mesh)[quads], self.mesh.border[self.mesh.quad_edges[quads]]
            )
        return good

    @cached_property
    def compactness(self) -> Float[np.ndarray, " patches"]:
        """Perimeter / sqrt(area) on the surface: 4 for a square, 3.54 for a disk.

        The perimeter is the length of the patch's longest loop, because its other loops are holes of the surface; see
        ``compactness_lengths`` for narrow surfaces.
        """
        area = np.bincount(self.patch_of, weights=self.mesh.areas)
        weights = np.where(self.mesh.border, smoothed_edge_lengths(self.mesh), 0.0)[self.mesh.quad_edges]
        sides = self.outline_sides
        border = np.bincount(self.loop_of[sides], weights=weights[sides])
        result = np.zeros(len(self.patches))
        np.maximum.at(result, self.loop_patch, compactness_lengths(self.loop_lengths, border, area[self.loop_patch]))
        return result / np.sqrt(area)

    @cached_property
    def on_outline(self) -> Bool[np.ndarray, " points"]:
        """Mask of flat vertices on the outline of their patch."""
        quad, side = np.nonzero(self.outline_sides)
        mask = np.zeros(int(self.flat_corners.max()) + 1, dtype=bool)
        mask[self.flat_corners[quad, side]] = True
        mask[self.flat_corners[quad, (side + 1) % 4]] = True
        return mask

    def isthmus_widths(self, widest: int = 8, *, own: bool = True) -> Int[np.ndarray, " patches"]:
        """Return the number of quads across the narrowest isthmus of every patch, at most ``widest``.

        An isthmus is a straight line of uncut edges through the patch with both ends on the outline.

        Parameters
        ----------
        widest : upper bound of the result
        own : whether to count also lines from border to border of the surface, where the surface itself is narrow
        """
        mesh, corners, outline = self.mesh, self.flat_corners, self.on_outline
        result = np.full(len(self.patches), widest, dtype=np.int64)
        quad, side = mesh.edge_quads[self.uncut_edges], mesh.edge_sides[self.uncut_edges]
        for way in range(2):
            q, k = quad[:, way].copy(), side[:, way].copy()
            begins = outline[corners[q, k]]
            q, k = q[begins], k[begins]
            rim = mesh.on_border[mesh.quads[q, k]]
            for steps in range(1, widest):
                end = outline[corners[q, (k + 1) % 4]]
                counts = end & (own | ~(rim & mesh.on_border[mesh.quads[q, (k + 1) % 4]]))
                np.minimum.at(result, self.patch_of[q[counts]], steps)
                q, k, rim = q[~end], k[~end], rim[~end]
                q, k, valid = next_straight_side(mesh, q, k)
                q, k, rim = q[valid], k[valid], rim[valid]
        return result

    # -- seams -----------------------------------------------------------------------------------------------------

    @cached_property
    def cut_degree(self) -> Int[np.ndarray, " vertices"]:
        """Number of cut edges at every vertex."""
        return np.bincount(self.mesh.edges[self.cut].ravel(), minlength=len(self.mesh.vertices))

    @cached_property
    def seam_of(self) -> Int[np.ndarray, " edges"]:
        """Seam of every cut edge, numbered from 0, ordered by smallest edge; -1 for other edges.

        A seam is a maximal run of cut edges that meets neither another cut nor a border between its ends.
        """
        return self._run_numbers((self.cut_degree == 2) & ~self.mesh.on_border)

    def _run_numbers(self, passing: Bool[np.ndarray, " vertices"]) -> Int[np.ndarray, " edges"]:
        """Return for every edge the index of its run of cut edges, -1 if it is not cut.

        passing : mask of the vertices at which runs continue; at all other vertices they end
        """
        mesh = self.mesh
        ids = np.flatnonzero(self.cut)
        result = np.full(len(self.cut), -1, dtype=np.int64)
        if not len(ids):
            return result
        ends = mesh.edges[ids]
        node = np.where(passing[ends], ends, len(mesh.vertices) + 2 * np.arange(len(ids))[:, None] + np.arange(2))
        labels = component_numbers(len(mesh.vertices) + 2 * len(ids), node[:, 0], node[:, 1])[node[:, 0]]
        result[ids] = _renumber_by_first(labels)
        return result

    @cached_property
    def seam_edges(self) -> tuple[np.ndarray, ...]:
        """Edges of every seam, ascending."""
        return self._split_runs(self.seam_of)

    @cached_property
    def short_seam_edges(self) -> tuple[np.ndarray, ...]:
        """Edges of every part of a seam between irregular vertices, ascending; a seam without any is one part."""
        mesh = self.mesh
        return self._split_runs(self._run_numbers((self.cut_degree == 2) & ~mesh.on_border & ~mesh.irregular))

    def _split_runs(self, run_of: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the edges of every run; ``run_of`` numbers the run of each cut edge."""
        ids = np.flatnonzero(self.cut)
        if not len(ids):
            return ()
        order = np.argsort(run_of[ids], kind="stable")
        return tuple(np.split(ids[order], np.cumsum(np.bincount(run_of[ids]))[:-1]))

    @cached_property
    def seams(self) -> tuple[np.ndarray, ...]:
        """Edges of every seam, in order along it."""
        return tuple(order_run(self.mesh, edges) for edges in self.seam_edges)


@lru_cache(maxsize=4)
def smoothed_edge_lengths(mesh: QuadMesh) -> Float[np.ndarray, " edges"]:
    """Return the length of every edge for measuring outlines, metres; a ragged border counts as if it were smooth.

    Both edges at a reflex vertex of the border count together as the straight line between their far ends.
    """
    lengths = mesh.edge_lengths
    reflex = np.flatnonzero(mesh.on_border & (mesh.valence > 3))
    if not len(reflex):
        return lengths
    result = lengths.copy()
    edges = np.flatnonzero(mesh.border & np.isin(mesh.edges, reflex).any(axis=1))
    at: dict[int, list[int]] = {}
    for e in edges.tolist():
        for v in mesh.edges[e].tolist():
            at.setdefault(v, []).append(e)
    for v in reflex.tolist():
        if len(at[v]) == 2:
            ends = mesh.edges[at[v]].sum(axis=1) - v
            share = np.linalg.norm(mesh.vertices[ends[0]] - mesh.vertices[ends[1]]) / lengths[at[v]].sum()
            result[at[v]] = np.minimum(result[at[v]], share * lengths[at[v]])
    return result


def sublayout(layout: PatchLayout, quads: Int[np.ndarray, " quads"]) -> tuple[PatchLayout, np.ndarray]:
    """Return the layout of some quads as a mesh of their own.

    Parameters
    ----------
    layout : layout of the whole mesh
    quads : the quads, ascending

    Returns
    -------
    layout of the new mesh, and for each of its edges the edge of the whole mesh
    """
    mesh = layout.mesh
    used, corners = np.unique(mesh.quads[quads], return_inverse=True)
    part = QuadMesh(mesh.vertices[used], corners.reshape(-1, 4))
    # the new mesh numbers its vertices and edges in the order of the whole mesh, so sorted edges correspond
    edges = np.unique(mesh.quad_edges[quads])
    return PatchLayout(part, layout.cut[edges] & ~part.border, origin=layout.origin), edges


def next_straight_side(
    mesh: QuadMesh, quad: Int[np.ndarray, " n"], side: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Step along straight lines of edges: return the next edge, straight ahead, as a side of a quad.

    Parameters
    ----------
    mesh : quad mesh
    quad, side : current edges, as sides of quads on one side of the lines; lines run in the direction of these sides

    Returns
    -------
    quad, side : next edges, as sides of quads on the same side of the lines
    valid : mask, False if the line ends at a border or an irregular vertex
    """
    vertex = mesh.quads[quad, (side + 1) % 4]
    valid = (mesh.valence[vertex] == 4) & ~mesh.on_border[vertex]
    # the quad across the next side of the quad contains the next edge, and lies on the same side of the line
    across = mesh.quad_edges[quad, (side + 1) % 4]
    pair, sides = mesh.edge_quads[across], mesh.edge_sides[across]
    other = np.where(pair[:, 0] == quad, 1, 0)
    rows = np.arange(len(quad))
    next_quad, next_side = pair[rows, other], (sides[rows, other] + 1) % 4
    return np.where(valid, next_quad, 0), np.where(valid, next_side, 0), valid


def order_run(mesh: QuadMesh, edges: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Return the edges of a run in order along it, from the end edge with the smaller number.

    A closed run begins at its smallest edge.
    """
    if len(edges) < 3:
        return np.sort(edges)
    at: dict[int, list[int]] = {}
    for e, (a, b) in zip(edges.tolist(), mesh.edges[edges].tolist(), strict=True):
        at.setdefault(a, []).append(e)
        at.setdefault(b, []).append(e)
    tips = sorted(users[0] for users in at.values() if len(users) == 1)
    edge = tips[0] if tips else int(edges.min())
    a, b = mesh.edges[edge].tolist()
    vertex = (b if len(at[a]) == 1 else a) if tips else b
    walk, seen = [edge], {edge}
    while True:
        following = [e for e in at[vertex] if e not in seen]
        if not following:
            return np.array(walk)
        edge = following[0]
        walk.append(edge)
        seen.add(edge)
        a, b = mesh.edges[edge].tolist()
        vertex = b if vertex == a else a
