"""First layout of surfaces without long lines of edges: regions of quads, halved until they can be laid flat.

If irregular vertices are everywhere, cuts along all lines of edges would separate every quad. Instead, a region is
divided between two quads that are far apart, along the cheapest cut that keeps away from both (Katz & Tal 2003), until
every region is a disk, possibly with holes, within the distortion limit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra, maximum_flow

from ...arrays import Bool, Int
from ...params import LayoutParams
from ...progress import SILENT, Progress
from ...surface.curvature import angle_defects, corner_angles
from ...surface.mesh import QuadMesh
from ..flattening.arap import PatchProblem, minimise_max_energy, solve_local_global
from ..flattening.outline import has_simple_outline
from ..layout import PatchLayout, component_numbers, smoothed_edge_lengths
from ..loops import loops_of, perimeter

# Share of the distortion limit that merging may use; the rest is needed to make both sides of seams equally long.
# Larger values merge more patches and leave more seam mismatch.
MERGING_SHARE = 0.85
# Width of the band in which a region is cut, as a share of the distance between the two quads that the cut separates;
# larger values give shorter cuts and more unequal halves
BAND_SHARE = 0.35
# Largest reduction of the cost of cutting an edge whose vertices have curvature, as a share of the edge's length; larger
# values draw cuts to such vertices
CURVATURE_DISCOUNT = 0.6
# Integral curvature of a region, radians, above which flattening is not tried (a hemisphere has 6.3); larger values try
# more regions in vain
MAX_REGION_CURVATURE = 6.5
# Curvature at a vertex (angle defect, radians) above which flattening is not tried (a corner of a cube has 1.57);
# larger values try more regions in vain
MAX_VERTEX_CURVATURE = 1.5


class RegionHalver:
    """Divides a mesh into regions that can be laid flat.

    dual : (D, 2) int, quads on both sides of every inner edge
    centre_distance : (D,) distance between the centres of these two quads, metres
    cut_cost : (D,) cost of cutting the edge, metres: its length, reduced near vertices with curvature
    place : (F,) int, work array: local numbers of the current quads during a call, -1 between calls
    """

    def __init__(self, mesh: QuadMesh, params: LayoutParams):
        self.mesh, self.params = mesh, params
        self.dual, edges = mesh.dual, mesh.dual_edges
        self.centre_distance = np.linalg.norm(mesh.centroids[self.dual[:, 0]] - mesh.centroids[self.dual[:, 1]], axis=1)
        self.defect, self.warp = angle_defects(mesh)
        self.angles = corner_angles(mesh)
        cone = np.minimum(np.abs(self.defect) / 0.5, 1.0)[mesh.edges[edges]].mean(axis=1)
        self.cut_cost = mesh.edge_lengths[edges] * (1.0 - CURVATURE_DISCOUNT * cone)
        self.place = np.full(len(mesh.quads), -1, dtype=np.int64)

    def region_layout(self, quads: Int[np.ndarray, " n"], progress: Progress = SILENT) -> PatchLayout:
        """Divide bodies into regions that can be laid flat, and cut between them.

        A single quad that exceeds the distortion limit remains a region by itself.

        Parameters
        ----------
        quads : all quads of one or more bodies
        progress : called with the fraction done; may cancel
        """
        mesh = self.mesh
        region = np.asarray(mesh.body_of, dtype=np.int64).copy()
        waiting = [quads[region[quads] == n] for n in np.unique(region[quads]).tolist()]
        count, done = int(region.max()) + 1, 0
        while waiting:
            quads = waiting.pop()
            tick = partial(progress, done / len(mesh.quads), "Dividing the surface")
            tick()
            if len(quads) == 1 or self.is_flattenable(quads, tick=tick):
                done += len(quads)
                continue
            for part in self.halves(quads)[1:]:
                region[part] = count
                count += 1
                waiting.append(part)
            waiting.append(quads[region[quads] == region[quads[0]]])
        cut = np.zeros(len(mesh.edges), dtype=bool)
        cut[mesh.dual_edges] = region[self.dual[:, 0]] != region[self.dual[:, 1]]
        return PatchLayout(mesh, cut)

    def is_flattenable(self, quads: np.ndarray, share: float = 1.0, tick: Callable[[], None] = lambda: None) -> bool:
        """Return whether a region can be laid flat in one piece without overlap, within all limits of the layout.

        Parameters
        ----------
        quads : a connected region
        share : share of the distortion limit that may be used
        tick : called before every factorisation and solve; may raise an exception to cancel
        """
        mesh, limit = self.mesh, share * self.params.distortion_limit
        own = np.zeros(len(mesh.quads), dtype=bool)
        own[quads] = True
        sides = ~own[mesh.neighbours[quads]] | (mesh.neighbours[quads] < 0)
        used, count = np.unique(mesh.quads[quads], return_counts=True)
        inside = count == mesh.valence[used]
        bent = self.defect[used[inside]]
        total = float(bent.sum() + self.warp[quads].sum())
        if not sides.any() or abs(total) > MAX_REGION_CURVATURE or np.abs(bent).max(initial=0.0) > MAX_VERTEX_CURVATURE:
            return False
        corners = np.searchsorted(used, mesh.quads[quads])
        if len(np.unique(corners[sides])) != int(sides.sum()):
            return False  # the outline touches itself at a vertex
        loops = loops_of(corners, sides)
        inner = (sides.size - int(sides.sum())) // 2
        if len(used) - (4 * len(quads) - inner) + len(quads) != 2 - len(loops):
            return False
        border = mesh.border[mesh.quad_edges[quads]]
        if not loops.has_only_holes(corners, self.angles[quads], border):
            return False
        lengths, area = smoothed_edge_lengths(mesh)[mesh.quad_edges[quads]], float(mesh.areas[quads].sum())
        around = perimeter(sides, corners, loops, lengths, border, area)
        if around > self.params.compactness_limit * np.sqrt(area) * (1 + 1e-9):
            return False
        problem = PatchProblem(mesh, quads, corners, tick)
        flat = solve_local_global(problem, tolerance=0.01, give_up_above=3 * limit)
        if flat.max_energy > 5 * limit:
            return False
        flat = minimise_max_energy(problem, flat, target=0.9 * limit)
        return flat.max_energy <= limit and flat.flip_count == 0 and has_simple_outline(flat.points, corners, sides)

    def halves(self, quads: np.ndarray) -> list[np.ndarray]:
        """Divide a region in two; return the quads of its connected parts, more than two if the cut leaves islands.

        quads : quads of the region
        """
        place = self.place
        place[quads] = np.arange(len(quads))
        rows = np.flatnonzero((place[self.dual] >= 0).all(axis=1))
        pair = place[self.dual[rows]]
        place[quads] = -1
        n = len(quads)
        graph = csr_array(coo_array((self.centre_distance[rows], pair.T), shape=(n, n)))
        graph = graph + graph.T
        start = dijkstra(graph, indices=0)
        one = int(np.argmax(start))
        from_one = dijkstra(graph, indices=one)
        two = int(np.argmax(from_one))
        from_two = dijkstra(graph, indices=two)
        side = self._minimum_cut(pair, self.cut_cost[rows], from_one, from_two)
        same = side[pair[:, 0]] == side[pair[:, 1]]
        part = component_numbers(n, pair[same, 0], pair[same, 1])
        return [quads[part == k] for k in range(int(part.max()) + 1)]

    def _minimum_cut(
        self, pair: np.ndarray, price: np.ndarray, from_one: np.ndarray, from_two: np.ndarray
    ) -> Bool[np.ndarray, " n"]:
        """Return a mask of the quads on the first side of the cheapest cut (minimum cut) in the middle of a region.

        pair, price : quads on both sides of every inner edge, and the cost of cutting it, metres
        from_one, from_two : distances of all quads from the two quads that the cut must separate, metres
        """
        n = len(from_one)
        share = from_one / np.maximum(from_one + from_two, 1e-300)
        one, two = share <= 0.5 - 0.5 * BAND_SHARE, share >= 0.5 + 0.5 * BAND_SHARE
        scale = 1e4 / price.max()
        capacity = np.maximum((price * scale).astype(np.int32), 1)
        source, sink = n, n + 1
        a = np.concatenate([pair[:, 0], pair[:, 1], np.full(one.sum(), source), np.flatnonzero(two)])
        b = np.concatenate([pair[:, 1], pair[:, 0], np.flatnonzero(one), np.full(two.sum(), sink)])
        much = np.full(one.sum() + two.sum(), 2**29, dtype=np.int32)
        network = csr_array(coo_array((np.concatenate([capacity, capacity, much]), (a, b)), shape=(n + 2, n + 2)))
        network.indices, network.indptr = network.indices.astype(np.int32), network.indptr.astype(np.int32)
        rest = network - maximum_flow(network, source, sink).flow
        rest.data = np.maximum(rest.data, 0)
        rest.eliminate_zeros()
        reached = dijkstra(rest, indices=source, unweighted=True)
        return np.isfinite(reached[:n])
