"""Fewer patches: greedy merging by opening runs of cut edges (FlexMaps section 4)."""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .arap import NEXT, FlatPatch, PatchProblem, minimax, settle
from .flatten import FlatPatches, flatten
from .layout import PatchLayout, groups, straight_on
from .mesh import QuadMesh
from .outline import simple
from .params import LayoutParams
from .progress import SILENT, Progress


@dataclass(frozen=True, eq=False)
class Piece:
    """One patch while the layout changes.

    serial : a number that no other piece has
    quads : (q,) int; corners : (q, 4) int local flat vertices; sides : (q, 4) bool outline sides
    perimeter, area : metres and square metres on the surface; necks : number of too narrow isthmuses
    flat : its flattening
    """

    serial: int
    quads: np.ndarray
    corners: np.ndarray
    sides: np.ndarray
    perimeter: float
    area: float
    necks: int
    flat: FlatPatch

    @property
    def compactness(self) -> float:
        return self.perimeter / self.area**0.5


class Board:
    """The layout while it changes: cuts, pieces and what has been tried."""

    def __init__(self, layout: PatchLayout, params: LayoutParams):
        self.mesh, self.params = layout.mesh, params
        self.cut = layout.cut.copy()
        self.piece_of = -1 - layout.patch_of
        self.serial = 0
        self.solved = 0
        self.pieces: dict[int, Piece] = {}
        self.place = np.full(len(layout.mesh.quads), -1, dtype=np.int64)
        for quads in layout.patches:
            piece = self.piece(quads, self.cut, None)
            assert piece is not None
            self.put(piece)

    # -- pieces ----------------------------------------------------------------------------------------------------

    def put(self, piece: Piece) -> None:
        for old in np.unique(self.piece_of[piece.quads]).tolist():
            self.pieces.pop(old, None)
        self.pieces[piece.serial] = piece
        self.piece_of[piece.quads] = piece.serial

    def local_corners(self, quads: np.ndarray, cut: np.ndarray) -> np.ndarray:
        """(q, 4) int: flat vertices of some quads, numbered 0.. among themselves."""
        mesh, place = self.mesh, self.place
        place[quads] = np.arange(len(quads))
        other = mesh.neighbours[quads]
        edge = mesh.quad_edges[quads]
        joined = (other >= 0) & ~cut[edge] & (place[other] > np.arange(len(quads))[:, None])
        qa, ka = np.nonzero(joined)
        edge = edge[qa, ka]
        pair, sides = mesh.edge_quads[edge], mesh.edge_sides[edge]
        column = (pair[:, 0] == quads[qa]).astype(np.int64)
        rows = np.arange(len(edge))
        qb, kb = place[pair[rows, column]], sides[rows, column]
        place[quads] = -1
        a = np.concatenate([4 * qa + ka, 4 * qa + NEXT[ka]])
        b = np.concatenate([4 * qb + NEXT[kb], 4 * qb + kb])
        return groups(4 * len(quads), a, b).reshape(-1, 4)

    def narrow(self, quads: np.ndarray, corners: np.ndarray, sides: np.ndarray) -> int:
        """Number of straight lines from outline to outline that are shorter than the smallest neck."""
        outline = np.zeros(int(corners.max()) + 1, dtype=bool)
        outline[corners[sides]] = True
        outline[corners[:, NEXT][sides]] = True
        q, k = np.nonzero(~sides & outline[corners])
        found = 0
        for _ in range(1, self.params.neck_min):
            end = outline[corners[q, NEXT[k]]]
            found += int(end.sum())
            q, k = q[~end], k[~end]
            if len(q) and self.params.neck_min > 2:
                self.place[quads] = np.arange(len(quads))
                quad, k, valid = straight_on(self.mesh, quads[q], k)
                q, k = self.place[quad[valid]], k[valid]
                self.place[quads] = -1
        return found

    def piece(
        self, quads: np.ndarray, cut: np.ndarray, rotation: np.ndarray | None, parents: Iterable[Piece] = ()
    ) -> Piece | None:
        """The piece made of these quads under these cuts, flattened; None where a limit forbids it.

        parents : the pieces it would replace; without them nothing is forbidden
        """
        mesh, params = self.mesh, self.params
        sides = (cut | mesh.border)[mesh.quad_edges[quads]]
        perimeter = float((mesh.edge_lengths[mesh.quad_edges[quads]] * sides).sum())
        area = float(mesh.areas[quads].sum())
        parents = list(parents)
        if parents:
            allowed = max(params.compactness_limit, max(p.compactness for p in parents))
            if perimeter / area**0.5 > allowed:
                return None
        corners = self.local_corners(quads, cut)
        inner = (sides.size - int(sides.sum())) // 2
        if int(corners.max()) + 1 - (4 * len(quads) - inner) + len(quads) != 1:
            return None
        necks = self.narrow(quads, corners, sides)
        if parents and necks > sum(p.necks for p in parents):
            return None
        self.solved += 1
        problem = PatchProblem(mesh, quads, corners)
        limit = params.distortion_limit
        if not parents:
            flat = minimax(problem, settle(problem, rotation), target=0.9 * limit)
            self.serial += 1
            return Piece(self.serial, quads, corners, sides, perimeter, area, necks, flat)
        limit = max(limit, max(p.flat.worst for p in parents))
        flat = settle(problem, rotation, tolerance=0.01, hopeless=1.8 * limit)
        if flat.worst > 1.8 * limit:
            return None
        if flat.worst > limit or flat.flips:
            flat = minimax(problem, flat, target=0.97 * limit)
        if flat.worst > limit or flat.flips or not simple(flat.points, corners, sides):
            return None
        self.serial += 1
        return Piece(self.serial, quads, corners, sides, perimeter, area, necks, flat)

    # -- opening cuts ----------------------------------------------------------------------------------------------

    def opened(self, edges: np.ndarray) -> Piece | None:
        """The piece that opening a run of cut edges gives; None where a limit forbids it."""
        mesh = self.mesh
        names = np.unique(self.piece_of[mesh.edge_quads[edges]]).tolist()
        parents = [self.pieces[n] for n in names]
        cut = self.cut.copy()
        cut[edges] = False
        quads = np.sort(np.concatenate([p.quads for p in parents])) if len(parents) > 1 else parents[0].quads
        return self.piece(quads, cut, self.turned(parents, quads, edges), parents)

    def turned(self, parents: list[Piece], quads: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """(q, 4) complex: the parents' rotations, turned to fit along the opened edges."""
        mesh, place = self.mesh, self.place
        rotation = np.empty((len(quads), 4), dtype=complex)
        place[quads] = np.arange(len(quads))
        rows = [place[p.quads] for p in parents]
        place[quads] = -1
        index = {p.serial: i for i, p in enumerate(parents)}
        side = np.empty((len(quads), 4), dtype=complex)
        for p, r in zip(parents, rows, strict=True):
            u = p.flat.points[p.corners]
            side[r] = u[:, NEXT] - u
        place[quads] = np.arange(len(quads))
        pair, sides = mesh.edge_quads[edges], mesh.edge_sides[edges]
        va, vb = side[place[pair[:, 0]], sides[:, 0]], -side[place[pair[:, 1]], sides[:, 1]]
        place[quads] = -1
        links: dict[tuple[int, int], complex] = {}
        for a, b, x, y in zip(*self.piece_of[pair].T.tolist(), va.tolist(), vb.tolist(), strict=True):
            links[index[a], index[b]] = links.get((index[a], index[b]), 0j) + x * y.conjugate()
            links[index[b], index[a]] = links.get((index[b], index[a]), 0j) + y * x.conjugate()
        turn = {0: 1 + 0j}
        waiting = [0]
        while waiting:
            a = waiting.pop()
            for (x, y), value in sorted(links.items(), key=lambda item: item[0]):
                if x == a and y not in turn:
                    turn[y] = turn[a] * value / max(abs(value), 1e-300)
                    waiting.append(y)
        for i, (p, r) in enumerate(zip(parents, rows, strict=True)):
            rotation[r] = p.flat.rotation * turn.get(i, 1)
        return rotation

    def apply(self, edges: np.ndarray, piece: Piece) -> None:
        self.cut[edges] = False
        self.put(piece)


def merge(layout: PatchLayout, params: LayoutParams, progress: Progress = SILENT) -> FlatPatches:
    """Merge patches greedily while every limit holds; the least distorting merge with the longest seam comes first."""
    board = Board(layout, params)
    greedy(board, progress.part(0.0, 0.8))
    result = PatchLayout(layout.mesh, board.cut)
    return flatten(result, params, progress.part(0.8, 1.0))


def greedy(board: Board, progress: Progress) -> None:
    """Open whole seams, best first, until no seam can be opened."""
    mesh, limit = board.mesh, board.params.distortion_limit
    tried: dict[tuple[int, ...], Piece | None] = {}
    heap: list[tuple[float, tuple[int, ...], bool]] = []
    first = len(board.pieces)
    while True:
        current: dict[tuple[int, ...], np.ndarray] = {}
        for edges in PatchLayout(mesh, board.cut).seams:
            a, b = sorted(board.piece_of[mesh.edge_quads[edges[0]]].tolist())
            key = (a, b, int(edges.min()), len(edges))
            current[key] = edges
            if key not in tried and a != b:
                tried[key] = None
                pa, pb = board.pieces[a], board.pieces[b]
                shared = float(mesh.edge_lengths[edges].sum())
                bonus = 3.0 * shared / min(pa.perimeter, pb.perimeter)
                heapq.heappush(heap, (max(pa.flat.worst, pb.flat.worst) / limit - bonus, key, False))
        while heap:
            score, key, known = heapq.heappop(heap)
            if key not in current:
                continue
            edges = current[key]
            if known:
                break
            piece = tried[key] = board.opened(edges)
            if piece is not None:
                pa, pb = board.pieces[key[0]], board.pieces[key[1]]
                bonus = 3.0 * float(mesh.edge_lengths[edges].sum()) / min(pa.perimeter, pb.perimeter)
                heapq.heappush(heap, (piece.flat.worst / limit - bonus, key, True))
        else:
            return
        found = tried[key]
        assert found is not None
        board.apply(edges, found)
        progress(1.0 - len(board.pieces) / first, f"Merging: {len(board.pieces)} patches")
