"""The layout while it changes: which patches there are, how they lie flat, and whether a change keeps every limit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...params import LayoutParams
from ...surface.curvature import corner_angles
from ...surface.symmetry import Symmetry
from ..flattening.arap import NEXT, FlatPatch, PatchProblem, minimax, settle
from ..flattening.outline import narrowness, simple
from ..layout import PatchLayout, drawn_lengths, groups, straight_on
from ..loops import Loops, loops_of, perimeter
from ..tracing.regions import ROOM

NECK = 1.1  # over the largest waist: the smallest width of an isthmus over the outline behind it
SMALL = 120  # quads: patches up to this are given more chances
REACH = 8  # quads: isthmuses wider than this are none
LENIENT = 1.25  # over the limit: the compactness that a patch may have that takes a too small one in
# work in quads times solves: that of an attempt before anything is flattened, and solves of one flattening
ATTEMPT, SOLVES = 300.0, 10.0
WAIST = 5.0  # largest outline behind an isthmus, over its width: a rectangle four times as long as wide has 5
NOTHING = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Sketch:
    """A patch before it is flattened.

    quads : (q,) int; corners : (q, 4) int local flat vertices; sides : (q, 4) bool outline sides
    loops : the closed loops of its outline; rim : (n,) bool, flat vertices on the border of the surface
    perimeter : metres on the surface, of the longest loop, see ``loops.perimeter``
    area : square metres on the surface; necks : number of too narrow isthmuses
    waist : the longest outline that hangs on one straight line through the patch, over the length of that line, in edges;
        lines from border to border are left out
    """

    quads: np.ndarray
    corners: np.ndarray
    sides: np.ndarray
    loops: Loops
    rim: np.ndarray
    perimeter: float
    area: float
    necks: int
    waist: float

    @property
    def compactness(self) -> float:
        return self.perimeter / self.area**0.5

    @property
    def planar(self) -> bool:
        """Is the patch a disk, apart from holes?"""
        inner = (self.sides.size - int(self.sides.sum())) // 2
        euler = int(self.corners.max()) + 1 - (4 * len(self.quads) - inner) + len(self.quads)
        return euler == 2 - len(self.loops)


@dataclass(frozen=True, eq=False)
class Piece:
    """One flattened patch; ``serial`` is a number that no other piece has."""

    serial: int
    sketch: Sketch
    flat: FlatPatch

    @cached_property
    def neck(self) -> float:
        """Width of the narrowest isthmus of the flat outline over the shorter outline behind it."""
        loops = self.sketch.loops
        around = loops.vertices(int(np.argmax(loops.lengths)))
        return narrowness(self.flat.points[around], self.sketch.rim[around])

    @property
    def quads(self) -> np.ndarray:
        return self.sketch.quads


@dataclass(frozen=True, eq=False)
class Change:
    """Cut edges to open, joined edges to cut, and the pieces that come of it."""

    opens: np.ndarray
    closes: np.ndarray
    pieces: list[Piece]


class Effort:
    """How much flattening may still be done: the same work everywhere, whatever the machine, so that results repeat.

    left : quads times solves
    """

    def __init__(self, left: float = np.inf):
        self.left = left

    @property
    def over(self) -> bool:
        return self.left <= 0


class Board:
    """The state of merging: cuts, pieces, and the symmetries that every change must keep.

    ``cut`` is (E,) bool, ``marked`` the set of all edges that are cut or on the border, ``piece_of`` (F,) serials.
    ``lenient`` lets changes go beyond the limits on necks, sizes and compactness; ``tick`` is called at every attempt.
    """

    def __init__(
        self,
        layout: PatchLayout,
        params: LayoutParams,
        symmetries: Sequence[Symmetry] = (),
        effort: Effort | None = None,
        tick: Callable[[], None] = lambda: None,
    ):
        self.mesh, self.params, self.symmetries = layout.mesh, params, list(symmetries)
        self.angles = corner_angles(layout.mesh)
        self.cut = layout.cut.copy()
        self.marked = set(np.flatnonzero(layout.cut | layout.mesh.border).tolist())
        self.piece_of = -1 - layout.patch_of
        self.place = np.full(len(layout.mesh.quads), -1, dtype=np.int64)
        self.waist = WAIST
        self.room = ROOM
        self.lenient = False
        self.effort = effort or Effort()
        self.tick = tick
        self.serial = 0
        # what straightening has looked at and what it was refused, under these symmetries and limits
        self.swept: set[tuple[object, ...]] = set()
        self.refused: set[tuple[bytes, ...]] = set()
        # what was flattened before: good for every start; what failed may still work from other parents
        self.solved: dict[tuple[bytes, bytes, float], FlatPatch] = {}
        self.failed: set[tuple[tuple[bytes, bytes, float], tuple[int, ...]]] = set()
        self.pieces: dict[int, Piece] = {}
        for quads in layout.patches:
            sketch = self.sketch(quads, self.cut)
            problem = PatchProblem(self.mesh, quads, sketch.corners, tick)
            self._put(self._named(sketch, minimax(problem, settle(problem), target=0.9 * params.distortion_limit)))

    @property
    def layout(self) -> PatchLayout:
        return PatchLayout(self.mesh, self.cut.copy())

    def leads(self, edges: np.ndarray | Sequence[int]) -> bool:
        """Is a run of edges the first of its mirror images? A change of the others comes to the same."""
        if not self.symmetries:
            return True
        lowest = min(int(s.edges[edges].min()) for s in self.symmetries)
        return int(np.min(edges)) <= lowest

    def rotations(self) -> np.ndarray:
        """(F, 4) complex: the rotation of every corner triangle, each piece in a frame of its own."""
        result = np.ones((len(self.mesh.quads), 4), dtype=complex)
        for piece in self.pieces.values():
            result[piece.quads] = piece.flat.rotation
        return result

    def copy(self) -> Board:
        """The same state, to try something on; pieces, which never change, and what was flattened are shared."""
        other = object.__new__(Board)
        other.__dict__.update(self.__dict__)
        other.cut, other.piece_of, other.pieces = self.cut.copy(), self.piece_of.copy(), dict(self.pieces)
        other.marked, other.swept, other.refused = set(self.marked), set(), set()
        return other

    def sides_of(self, edges: np.ndarray) -> np.ndarray:
        """(n, 2) int: serials of the pieces on both sides of edges."""
        return self.piece_of[self.mesh.edge_quads[edges]]

    # -- changes ---------------------------------------------------------------------------------------------------

    def attempt(self, opens: np.ndarray, closes: np.ndarray = NOTHING) -> Change | None:
        """What comes of opening and closing edges, their mirror images included; None where a limit forbids it.

        Images that touch the same pieces are done together, the others are left to ``apply``.
        """
        self.tick()
        if self.effort.over:
            return None
        self.effort.left -= ATTEMPT
        if not self.symmetries:
            return self._attempt(opens, closes)
        images = [(s.edges[opens], s.edges[closes]) for s in self.symmetries]
        opened, closed = set(opens.tolist()), set(closes.tolist())
        touched = set(self.sides_of(np.concatenate([opens, closes])).ravel().tolist())
        waiting = True
        while waiting:
            waiting = False
            for o, c in images:
                if opened.issuperset(o.tolist()) and closed.issuperset(c.tolist()):
                    continue
                names = set(self.sides_of(np.concatenate([o, c])).ravel().tolist())
                if names & touched:
                    touched |= names
                    opened.update(o.tolist())
                    closed.update(c.tolist())
                    waiting = True
        if opened & closed:
            return None
        return self._attempt(_array(opened), _array(closed))

    def apply(self, change: Change) -> bool:
        """Make a change with all its mirror images; False, and nothing done, where an image fails."""
        if not self.symmetries:
            self._apply(change)
            return True
        before = self.copy()
        done = {(change.opens.tobytes(), change.closes.tobytes())}
        self._apply(change)
        for s in self.symmetries:
            o, c = np.sort(s.edges[change.opens]), np.sort(s.edges[change.closes])
            if (o.tobytes(), c.tobytes()) in done:
                continue
            done.add((o.tobytes(), c.tobytes()))
            image = self._attempt(o, c) if self.cut[o].all() and not self.cut[c].any() else None
            if image is None:
                self.cut, self.piece_of, self.pieces = before.cut, before.piece_of, before.pieces
                self.marked = before.marked
                return False
            self._apply(image)
        return True

    def _apply(self, change: Change) -> None:
        self.cut[change.opens] = False
        self.cut[change.closes] = True
        self.marked.difference_update(change.opens.tolist())
        self.marked.update(change.closes.tolist())
        for piece in change.pieces:
            self._put(piece)

    def _put(self, piece: Piece) -> None:
        for old in np.unique(self.piece_of[piece.quads]).tolist():
            self.pieces.pop(old, None)
        self.pieces[piece.serial] = piece
        self.piece_of[piece.quads] = piece.serial

    def _attempt(self, opens: np.ndarray, closes: np.ndarray) -> Change | None:
        names = np.unique(self.sides_of(np.concatenate([opens, closes]))).tolist()
        old = [self.pieces[n] for n in names]
        cut = self.cut.copy()
        cut[opens] = False
        cut[closes] = True
        region = np.sort(np.concatenate([p.quads for p in old]))
        sketches = []
        for quads in self._components(region, cut) if len(closes) or len(old) > 2 else [region]:
            parents = [self.pieces[n] for n in np.unique(self.piece_of[quads]).tolist()]
            sketch = self._allowed(quads, cut, parents)
            if sketch is None:
                return None
            sketches.append((sketch, parents))
        pieces = []
        # the smallest first: it is the cheapest to fail on
        for sketch, parents in sorted(sketches, key=lambda s: len(s[0].quads)):
            piece = self._solved(sketch, parents, opens)
            if piece is None:
                return None
            pieces.append(piece)
        return Change(np.sort(opens), np.sort(closes), pieces)

    # -- one patch -------------------------------------------------------------------------------------------------

    def _allowed(self, quads: np.ndarray, cut: np.ndarray, parents: list[Piece]) -> Sketch | None:
        """The sketch of a patch if it passes all that can be said without flattening it."""
        mesh, params = self.mesh, self.params
        if len(quads) < min(params.patch_min, *(len(p.quads) for p in parents)):
            return None
        sketch = self.sketch(quads, cut)
        allowed = max(params.compactness_limit, min(p.sketch.compactness for p in parents))
        if self.lenient:
            allowed = max(LENIENT * params.compactness_limit, *(p.sketch.compactness for p in parents))
        if sketch.compactness > allowed * (1 + 1e-9):
            return None
        border = mesh.border[mesh.quad_edges[quads]]
        if not sketch.planar or not sketch.loops.mere_holes(sketch.corners, self.angles[quads], border):
            return None
        if self.lenient:
            return sketch
        if sketch.necks > sum(p.sketch.necks for p in parents):
            return None
        return None if sketch.waist > max(self.waist, *(p.sketch.waist for p in parents)) else sketch

    def _solved(self, sketch: Sketch, parents: list[Piece], opens: np.ndarray) -> Piece | None:
        """The flattened patch, if its distortion is allowed and it is injective."""
        limit = max(self.room * self.params.distortion_limit, *(p.flat.worst for p in parents))
        key = (sketch.quads.tobytes(), np.packbits(sketch.sides).tobytes(), limit)
        start = tuple(p.serial for p in parents)
        if key not in self.solved and (key, start) not in self.failed:
            flat = self._flattened(sketch, parents, opens, limit)
            if flat is None:
                self.failed.add((key, start))
            else:
                self.solved[key] = flat
        if key not in self.solved:
            return None
        piece = self._named(sketch, self.solved[key])
        if self.lenient:
            return piece
        # an isthmus may only be as narrow as those of the parents, or as the limit
        return None if piece.neck < min(NECK / self.waist, *(p.neck for p in parents)) else piece

    def _flattened(self, sketch: Sketch, parents: list[Piece], opens: np.ndarray, limit: float) -> FlatPatch | None:
        problem = PatchProblem(self.mesh, sketch.quads, sketch.corners, self.tick)
        self.effort.left -= SOLVES * len(sketch.quads)
        # weighing the bad quads brings the worst energy down by a half; by far more where a few quads hold it all
        bar = limit * (1.8 + 3.2 * min(1.0, SMALL / len(sketch.quads)) ** 2)
        flat = settle(problem, self._turned(parents, sketch.quads, opens), tolerance=0.01, hopeless=bar)
        if flat.worst > bar:
            return None
        if flat.worst > limit or flat.flips:
            self.effort.left -= 3 * SOLVES * len(sketch.quads)
            flat = minimax(problem, flat, target=0.97 * limit)
        if flat.worst > limit or flat.flips or not simple(flat.points, sketch.corners, sketch.sides):
            return None
        return flat

    def _named(self, sketch: Sketch, flat: FlatPatch) -> Piece:
        self.serial += 1
        return Piece(self.serial, sketch, flat)

    def sketch(self, quads: np.ndarray, cut: np.ndarray) -> Sketch:
        """Measures of the patch that some quads make under some cuts (E,) bool."""
        mesh = self.mesh
        sides = (cut | mesh.border)[mesh.quad_edges[quads]]
        qa, ka, qb, kb = self._joints(quads, cut)
        a = np.concatenate([4 * qa + ka, 4 * qa + NEXT[ka]])
        b = np.concatenate([4 * qb + NEXT[kb], 4 * qb + kb])
        corners = groups(4 * len(quads), a, b).reshape(-1, 4)
        loops = loops_of(corners, sides)
        border, area = mesh.border[mesh.quad_edges[quads]], float(mesh.areas[quads].sum())
        around = perimeter(sides, corners, loops, drawn_lengths(mesh)[mesh.quad_edges[quads]], border, area)
        rim = np.zeros(len(loops.loop), dtype=bool)
        rim[corners] = mesh.on_border[mesh.quads[quads]]
        necks, waist = self._necks(quads, corners, sides, loops, rim)
        return Sketch(quads, corners, sides, loops, rim, around, area, necks, waist)

    def _joints(self, quads: np.ndarray, cut: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Uncut sides among some quads: local quad, side, local other quad, its side; each side once."""
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

    def _components(self, quads: np.ndarray, cut: np.ndarray) -> list[np.ndarray]:
        qa, _, qb, _ = self._joints(quads, cut)
        labels = groups(len(quads), qa, qb)
        return [quads[labels == n] for n in range(int(labels.max()) + 1)]

    def _necks(
        self, quads: np.ndarray, corners: np.ndarray, sides: np.ndarray, loops: Loops, rim: np.ndarray
    ) -> tuple[int, float]:
        """Straight lines from outline to outline: how many are too short, and the longest outline behind one, relative.

        Lines from border to border do not count: there the surface itself is narrow. Those between two loops have
        nothing behind them.
        """
        where = loops.where
        q, k = np.nonzero(~sides & (where[corners] >= 0))
        begin = corners[q, k]
        found, waist = 0, 0.0
        self.place[quads] = np.arange(len(quads))
        for steps in range(1, REACH + 1):
            at = corners[q, NEXT[k]]
            end = where[at] >= 0
            if end.any():
                one, two = begin[end], at[end]
                behind = np.abs(where[two] - where[one])
                behind = np.minimum(behind, loops.lengths[loops.loop[one]] - behind)
                own = rim[one] & rim[two]
                behind[own | (loops.loop[one] != loops.loop[two])] = 0
                waist = max(waist, float(behind.max()) / steps)
                found += int((~own).sum()) if steps < self.params.neck_min else 0
            if end.all():
                break
            q, k, begin = q[~end], k[~end], begin[~end]
            quad, side, valid = straight_on(self.mesh, quads[q], k)
            q, k, begin = self.place[quad[valid]], side[valid], begin[valid]
        self.place[quads] = -1
        return found, waist

    def _turned(self, parents: list[Piece], quads: np.ndarray, opens: np.ndarray) -> np.ndarray:
        """(q, 4) complex: the parents' rotations, turned to fit along the opened edges."""
        mesh, place = self.mesh, self.place
        place[quads] = np.arange(len(quads))
        rotation = np.empty((len(quads), 4), dtype=complex)
        side = np.empty((len(quads), 4), dtype=complex)
        owner = np.empty(len(quads), dtype=np.int64)
        for i, p in enumerate(parents):
            row = place[p.quads]
            kept = row >= 0
            u = p.flat.points[p.sketch.corners[kept]]
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
            rotation *= _spread(link)[owner][:, None]
        place[quads] = -1
        return rotation


def _spread(link: np.ndarray) -> np.ndarray:
    """(n,) complex turns of n parents such that turn[a] ~ turn[b] * conj(link[a, b]), from the first one on."""
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


def _array(values: set[int]) -> np.ndarray:
    return np.array(sorted(values), dtype=np.int64)
