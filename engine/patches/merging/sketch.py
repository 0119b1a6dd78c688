"""Measures of patches before flattening, and flattened patches (pieces), for ``board``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Bool, Complex, Int
from ...surface.mesh import QuadMesh
from ..flattening.arap import FlatPatch
from ..flattening.outline import isthmus_width
from ..layout import component_numbers, next_straight_side, smoothed_edge_lengths
from ..loops import NEXT, OutlineLoops, loops_of, perimeter

# Largest number of quads in all cached measures (or flat patches), at about 100 bytes a quad; a fuller cache is emptied.
# Larger values need more memory and compute less twice.
MAX_CACHED_QUADS = 1_000_000
MAX_ISTHMUS_WIDTH = (
    8  # largest length of an isthmus, in edges; longer straight lines are ignored; larger values take longer
)


@dataclass(frozen=True, eq=False)
class PatchMeasures:
    """Measures of a patch before flattening.

    An isthmus is a straight line of edges through the patch, from outline to outline. Lines from border to border of
    the surface do not count, because there the surface itself is narrow.

    quads : quads of the patch
    corners : flat vertices of the quads, numbered from 0 within the patch
    sides : mask of the quads' sides on the outline
    loops : loops of the outline
    rim : mask of flat vertices on the border of the surface
    perimeter : metres on the surface, see ``loops.perimeter``
    area : square metres on the surface
    isthmuses : number of isthmuses narrower than the smallest allowed neck
    bottleneck : largest ratio, over all isthmuses, of the shorter part of the outline between the isthmus's ends to the
        length of the isthmus, both in edges
    """

    quads: Int[np.ndarray, " quads"]
    corners: Int[np.ndarray, "quads 4"]
    sides: Bool[np.ndarray, "quads 4"]
    loops: OutlineLoops
    rim: Bool[np.ndarray, " vertices"]
    perimeter: float
    area: float
    isthmuses: int
    bottleneck: float

    @property
    def compactness(self) -> float:
        """Perimeter / sqrt(area): 4 for a square, more for long or ragged patches."""
        return self.perimeter / self.area**0.5

    @property
    def is_flattenable(self) -> bool:
        """Whether the patch is a disk, possibly with holes."""
        inner = (self.sides.size - int(self.sides.sum())) // 2
        euler = int(self.corners.max()) + 1 - (4 * len(self.quads) - inner) + len(self.quads)
        return euler == 2 - len(self.loops)


@dataclass(frozen=True, eq=False)
class FlatPiece:
    """A flattened patch (piece) with its measures and a unique serial number."""

    serial: int
    measures: PatchMeasures
    flat: FlatPatch

    @cached_property
    def isthmus(self) -> float:
        """Relative width of the narrowest isthmus of the flat outline, see ``isthmus_width``."""
        loops = self.measures.loops
        around = loops.vertices(int(np.argmax(loops.lengths)))
        return isthmus_width(self.flat.points[around], self.measures.rim[around])

    @property
    def quads(self) -> np.ndarray:
        """Quads of the patch."""
        return self.measures.quads


class PatchMeasurer:
    """Measures patches of a mesh under changing cuts.

    neck_min : width of the smallest allowed neck, in quads
    place : (F,) int, work array: local numbers of the current quads during a call, -1 between calls
    next_straight : (4 F,) int, at 4 q + k the side (4 times quad plus side) that continues side k of quad q straight
        ahead; -1 where the line ends
    cache : measures of patches; key: quads and sides on the outline
    cached_quads : number of quads of all patches in ``cache``
    """

    def __init__(self, mesh: QuadMesh, neck_min: int):
        self.mesh, self.neck_min = mesh, neck_min
        self.place = np.full(len(mesh.quads), -1, dtype=np.int64)
        quad, side, valid = next_straight_side(mesh, *np.divmod(np.arange(mesh.quads.size), 4))
        self.next_straight = np.where(valid, 4 * quad + side, -1)
        self.cache: dict[tuple[bytes, bytes], PatchMeasures] = {}
        self.cached_quads = 0

    def measure(self, quads: Int[np.ndarray, " quads"], cut: Bool[np.ndarray, " edges"]) -> PatchMeasures:
        """Return the measures of a patch; results are cached.

        Parameters
        ----------
        quads : quads of the patch
        cut : mask of the edges that are cut
        """
        sides = (cut | self.mesh.border)[self.mesh.quad_edges[quads]]
        key = quads.tobytes(), sides.tobytes()
        if key not in self.cache:
            if self.cached_quads > MAX_CACHED_QUADS:
                self.cache, self.cached_quads = {}, 0
            self.cache[key] = self._measure(quads, sides, cut)
            self.cached_quads += len(quads)
        return self.cache[key]

    def _measure(
        self, quads: Int[np.ndarray, " quads"], sides: Bool[np.ndarray, "quads 4"], cut: Bool[np.ndarray, " edges"]
    ) -> PatchMeasures:
        """Compute the measures of a patch."""
        mesh = self.mesh
        qa, ka, qb, kb = self.joints(quads, cut)
        a = np.concatenate([4 * qa + ka, 4 * qa + NEXT[ka]])
        b = np.concatenate([4 * qb + NEXT[kb], 4 * qb + kb])
        corners = component_numbers(4 * len(quads), a, b).reshape(-1, 4)
        loops = loops_of(corners, sides)
        border, area = mesh.border[mesh.quad_edges[quads]], float(mesh.areas[quads].sum())
        around = perimeter(sides, corners, loops, smoothed_edge_lengths(mesh)[mesh.quad_edges[quads]], border, area)
        rim = np.zeros(len(loops.loop), dtype=bool)
        rim[corners] = mesh.on_border[mesh.quads[quads]]
        return PatchMeasures(
            quads, corners, sides, loops, rim, around, area, *self._isthmuses(quads, corners, sides, loops, rim)
        )

    def joints(
        self, quads: Int[np.ndarray, " quads"], cut: Bool[np.ndarray, " edges"]
    ) -> tuple[
        Int[np.ndarray, " joints"], Int[np.ndarray, " joints"], Int[np.ndarray, " joints"], Int[np.ndarray, " joints"]
    ]:
        """Return the uncut sides between some quads, each once: a quad, its side, the quad across, that quad's side.

        The results are positions in ``quads`` and side numbers 0 to 3.

        Parameters
        ----------
        quads : the quads
        cut : mask of the edges that are cut
        """
        mesh, place = self.mesh, self.place
        place[quads] = np.arange(len(quads))
        other = mesh.neighbours[quads]
        edge = mesh.quad_edges[quads]
        joined = (other >= 0) & ~cut[edge] & (place[other] > np.arange(len(quads))[:, None])
        qa, ka = np.nonzero(joined)
        edge = edge[qa, ka]
        column = (mesh.edge_quads[edge, 0] == quads[qa]).astype(np.int64)
        qb, kb = place[other[qa, ka]], mesh.edge_sides[edge, column]
        place[quads] = -1
        return qa, ka, qb, kb

    def components(self, quads: Int[np.ndarray, " quads"], cut: Bool[np.ndarray, " edges"]) -> list[np.ndarray]:
        """Return the quads of every patch (connected component) into which cuts divide some quads.

        Parameters
        ----------
        quads : the quads to divide
        cut : mask of the edges that are cut
        """
        qa, _, qb, _ = self.joints(quads, cut)
        labels = component_numbers(len(quads), qa, qb)
        return [quads[labels == n] for n in range(int(labels.max()) + 1)]

    def _isthmuses(
        self,
        quads: Int[np.ndarray, " quads"],
        corners: Int[np.ndarray, "quads 4"],
        sides: Bool[np.ndarray, "quads 4"],
        loops: OutlineLoops,
        rim: Bool[np.ndarray, " vertices"],
    ) -> tuple[int, float]:
        """Return ``PatchMeasures.isthmuses`` and ``PatchMeasures.bottleneck``.

        Lines between two different loops of the outline count as isthmuses, but not as bottlenecks.
        """
        where = loops.position
        q, k = np.nonzero(~sides & (where[corners] >= 0))
        at, begin, ahead = 4 * quads[q] + k, corners[q, k], corners[:, NEXT].ravel()
        short, bottleneck = 0, 0.0
        self.place[quads] = 4 * np.arange(len(quads))
        for steps in range(1, MAX_ISTHMUS_WIDTH + 1):
            tip = ahead[self.place[at >> 2] + (at & 3)]
            end = where[tip] >= 0
            if end.any():
                one, two = begin[end], tip[end]
                behind = np.abs(where[two] - where[one])
                behind = np.minimum(behind, loops.lengths[loops.loop[one]] - behind)
                own = rim[one] & rim[two]
                behind[own | (loops.loop[one] != loops.loop[two])] = 0
                bottleneck = max(bottleneck, float(behind.max()) / steps)
                short += int((~own).sum()) if steps < self.neck_min else 0
            at = np.where(end, -1, self.next_straight[at])
            going = at >= 0
            at, begin = at[going], begin[going]
            if not len(at):
                break
        self.place[quads] = -1
        return short, bottleneck

    def rotations(
        self, parents: list[FlatPiece], quads: Int[np.ndarray, " quads"], opens: Int[np.ndarray, " opened"]
    ) -> Complex[np.ndarray, "quads 4"]:
        """Return initial rotations of the corner triangles for flattening a merged patch.

        They are the rotations of the merged pieces, each piece turned as a whole so that its flat sides along the
        joined edges are parallel to those of its neighbours.

        Parameters
        ----------
        parents : the merged pieces
        quads : quads of the merged patch
        opens : edges that are joined
        """
        mesh, place = self.mesh, self.place
        place[quads] = np.arange(len(quads))
        rotation = np.empty((len(quads), 4), dtype=complex)
        side = np.empty((len(quads), 4), dtype=complex)
        owner = np.empty(len(quads), dtype=np.int64)
        for i, p in enumerate(parents):
            row = place[p.quads]
            kept = row >= 0
            u = p.flat.points[p.measures.corners[kept]]
            side[row[kept]] = u[:, NEXT] - u
            rotation[row[kept]] = p.flat.rotation[kept]
            owner[row[kept]] = i
        if len(parents) > 1:
            pair, sides = place[mesh.edge_quads[opens]], mesh.edge_sides[opens]
            inside = (pair >= 0).all(axis=1)
            pair, sides = pair[inside], sides[inside]
            link = np.zeros((len(parents), len(parents)), dtype=complex)
            product = -side[pair[:, 0], sides[:, 0]] * side[pair[:, 1], sides[:, 1]].conj()
            np.add.at(link, (owner[pair[:, 0]], owner[pair[:, 1]]), product)
            link += link.conj().T
            rotation *= _propagate_turns(link)[owner][:, None]
        place[quads] = -1
        return rotation


def _propagate_turns(link: Complex[np.ndarray, "parents parents"]) -> Complex[np.ndarray, " parents"]:
    """Return rotations of the merged pieces that make their flat sides along joined edges parallel on average.

    The first rotation is 1; for linked pieces, turn[b] = turn[a] * link[a, b] / |link[a, b]|.

    link : sum over the joined edges between two pieces of the relative rotation of their flat sides; 0 without such edges
    """
    turn = np.zeros(len(link), dtype=complex)
    turn[0] = 1.0
    waiting = [0]
    while waiting:
        a = waiting.pop()
        for b in np.flatnonzero((np.abs(link[a]) > 0) & (turn == 0)).tolist():
            turn[b] = turn[a] * link[a, b] / abs(link[a, b])
            waiting.append(b)
    turn[turn == 0] = 1.0
    return turn
