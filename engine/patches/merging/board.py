"""The layout while it changes: which patches there are, how they lie flat, and whether a change keeps every limit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np

from ...arrays import Bool, Complex, Int
from ...params import LayoutParams
from ...surface.curvature import corner_angles
from ...surface.mesh import QuadMesh
from ...surface.symmetry import Symmetry
from ..flattening.arap import FlatPatch, PatchProblem, minimax, settle
from ..flattening.outline import simple
from ..layout import PatchLayout
from ..tracing.regions import MERGING_SHARE
from .sketch import ROOM, Piece, Sketch, Sketcher

# over the largest bottleneck: the smallest width of an isthmus over the outline behind it. 1.0 gives 45 instead of 44
# patches on seven surfaces, 1.5 gives 48
SLACK = 1.1
# quads: patches up to this are given more chances. 40 gives 47 patches on seven surfaces, 400 gives 38, in no more time
SMALL = 120
# over the limit: the compactness of a patch that takes a too small one in; 1.05 to 1.6 give the same on seven surfaces
LENIENT = 1.25
ATTEMPT = 300.0  # work, in quads times solves, of an attempt before anything is flattened; estimated from profiles
SOLVES = 10.0  # solves of one flattening, in the mean
# largest outline behind an isthmus, over its width: a rectangle four times as long as wide has 5. On seven surfaces 3.5
# gives 46 patches instead of 44, 8 gives as many as 5 with narrower places
BOTTLENECK = 5.0
NOTHING = np.zeros(0, dtype=np.int64)  # no edges


@dataclass(frozen=True, eq=False)
class Change:
    """Cut edges to open, joined edges to cut, and the pieces that come of it."""

    opens: Int[np.ndarray, " opened"]
    closes: Int[np.ndarray, " closed"]
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


class Shared:
    """What boards of the same mesh and limits need not do twice.

    flattened : by quads, outline, start and limit, what a flattening gave and the work that it took; held : how many quads are in them
    """

    def __init__(self, mesh: QuadMesh, params: LayoutParams):
        self.sketcher = Sketcher(mesh, params.neck_min)
        self.flattened: dict[tuple[bytes, bytes, bytes, float], tuple[FlatPatch | None, float]] = {}
        self.held = 0


class Board:
    """The state of merging: cuts, pieces, and the symmetries that every change must keep.

    cut : (E,) bool; marked : the set of all edges that are cut or on the border; piece_of : (F,) serial of every quad's piece
    bottleneck : the largest that a patch may get, see ``Sketch``; distortion_share : how much of the limit it may use up
    lenient : changes may go beyond the limits on isthmuses, sizes and compactness
    tick : called at every attempt
    shared : with other boards of the same mesh and limits
    swept, refused : what straightening has looked at, and what it was refused, under these symmetries and limits
    solved : what was flattened before; failed : what did not lie flat, and from which parents: others may do better
    """

    def __init__(
        self,
        layout: PatchLayout,
        params: LayoutParams,
        symmetries: Sequence[Symmetry] = (),
        effort: Effort | None = None,
        tick: Callable[[], None] = lambda: None,
        shared: Shared | None = None,
    ):
        self.mesh, self.params, self.symmetries = layout.mesh, params, list(symmetries)
        self.angles = corner_angles(layout.mesh)
        self.cut = layout.cut.copy()
        self.marked = set(np.flatnonzero(layout.cut | layout.mesh.border).tolist())
        self.piece_of = -1 - layout.patch_of
        self.shared = shared or Shared(layout.mesh, params)
        self.sketcher = self.shared.sketcher
        self.bottleneck = BOTTLENECK
        self.distortion_share = MERGING_SHARE
        self.lenient = False
        self.effort = effort or Effort()
        self.tick = tick
        self.serial = 0
        self.swept: set[tuple[object, ...]] = set()
        self.refused: set[tuple[bytes, ...]] = set()
        self.solved: dict[tuple[bytes, bytes, float], FlatPatch] = {}
        self.failed: set[tuple[tuple[bytes, bytes, float], tuple[int, ...]]] = set()
        self.pieces: dict[int, Piece] = {}
        for quads in layout.patches:
            sketch = self.sketcher.sketch(quads, self.cut)
            problem = PatchProblem(self.mesh, quads, sketch.corners, tick)
            self._put(self._named(sketch, minimax(problem, settle(problem), target=0.9 * params.distortion_limit)))

    @property
    def layout(self) -> PatchLayout:
        return PatchLayout(self.mesh, self.cut.copy())

    def is_first_image(self, edges: np.ndarray | Sequence[int]) -> bool:
        """Is a run of edges the first of its mirror images? A change of the others comes to the same."""
        if not self.symmetries:
            return True
        lowest = min(int(s.edges[edges].min()) for s in self.symmetries)
        return int(np.min(edges)) <= lowest

    def rotations(self) -> Complex[np.ndarray, "quads 4"]:
        """The rotation of every corner triangle, each piece in a frame of its own."""
        result = np.ones((len(self.mesh.quads), 4), dtype=complex)
        for piece in self.pieces.values():
            result[piece.quads] = piece.flat.rotation
        return result

    def copy(self) -> Board:
        """The same state, to try something on; pieces, which never change, and what was flattened are shared."""
        other = copy(self)
        other.cut, other.piece_of, other.pieces = self.cut.copy(), self.piece_of.copy(), dict(self.pieces)
        other.marked, other.swept, other.refused = set(self.marked), set(), set()
        return other

    def pieces_at(self, edges: Int[np.ndarray, " edges"]) -> Int[np.ndarray, "edges 2"]:
        """Serials of the pieces on both sides of edges."""
        return self.piece_of[self.mesh.edge_quads[edges]]

    # -- changes ---------------------------------------------------------------------------------------------------

    def attempt(self, opens: Int[np.ndarray, " opened"], closes: Int[np.ndarray, " closed"] = NOTHING) -> Change | None:
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
        touched = set(self.pieces_at(np.concatenate([opens, closes])).ravel().tolist())
        waiting = True
        while waiting:
            waiting = False
            for o, c in images:
                if opened.issuperset(o.tolist()) and closed.issuperset(c.tolist()):
                    continue
                names = set(self.pieces_at(np.concatenate([o, c])).ravel().tolist())
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

    def _attempt(self, opens: Int[np.ndarray, " opened"], closes: Int[np.ndarray, " closed"]) -> Change | None:
        names = np.unique(self.pieces_at(np.concatenate([opens, closes]))).tolist()
        old = [self.pieces[n] for n in names]
        cut = self.cut.copy()
        cut[opens] = False
        cut[closes] = True
        region = np.sort(np.concatenate([p.quads for p in old]))
        sketches = []
        for quads in self.sketcher.components(region, cut) if len(closes) or len(old) > 2 else [region]:
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

    def _allowed(
        self, quads: Int[np.ndarray, " quads"], cut: Bool[np.ndarray, " edges"], parents: list[Piece]
    ) -> Sketch | None:
        """The sketch of a patch if it passes all that can be said without flattening it."""
        mesh, params = self.mesh, self.params
        if len(quads) < min(params.patch_min, *(len(p.quads) for p in parents)):
            return None
        sketch = self.sketcher.sketch(quads, cut)
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
        if sketch.isthmuses > sum(p.sketch.isthmuses for p in parents):
            return None
        return None if sketch.bottleneck > max(self.bottleneck, *(p.sketch.bottleneck for p in parents)) else sketch

    def _solved(self, sketch: Sketch, parents: list[Piece], opens: np.ndarray) -> Piece | None:
        """The flattened patch, if its distortion is allowed and it is injective."""
        limit = max(self.distortion_share * self.params.distortion_limit, *(p.flat.worst for p in parents))
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
        return None if piece.isthmus < min(SLACK / self.bottleneck, *(p.isthmus for p in parents)) else piece

    def _flattened(self, sketch: Sketch, parents: list[Piece], opens: np.ndarray, limit: float) -> FlatPatch | None:
        start = self.sketcher.rotations(parents, sketch.quads, opens)
        digest = blake2b(start.tobytes(), digest_size=16).digest()
        key = (sketch.quads.tobytes(), np.packbits(sketch.sides).tobytes(), digest, limit)
        if key not in self.shared.flattened:
            if self.shared.held > ROOM:
                self.shared.flattened, self.shared.held = {}, 0
            self.shared.flattened[key] = self._flatten(sketch, start, limit)
            self.shared.held += len(sketch.quads)
        flat, work = self.shared.flattened[key]
        self.effort.left -= work  # also where nothing is done: layouts are not to depend on what is remembered
        return flat

    def _flatten(self, sketch: Sketch, start: np.ndarray, limit: float) -> tuple[FlatPatch | None, float]:
        """The patch where it lies flat within the limit, and the work that it took."""
        problem = PatchProblem(self.mesh, sketch.quads, sketch.corners, self.tick)
        work = SOLVES * len(sketch.quads)
        # weighing the bad quads brings the worst energy down by a half; by far more where a few quads hold it all
        bar = limit * (1.8 + 3.2 * min(1.0, SMALL / len(sketch.quads)) ** 2)
        flat = settle(problem, start, tolerance=0.01, hopeless=bar)
        if flat.worst > bar:
            return None, work
        if flat.worst > limit or flat.flips:
            work *= 4
            flat = minimax(problem, flat, target=0.97 * limit, hopeless=limit)
        good = flat.worst <= limit and not flat.flips and simple(flat.points, sketch.corners, sketch.sides)
        return flat if good else None, work

    def _named(self, sketch: Sketch, flat: FlatPatch) -> Piece:
        self.serial += 1
        return Piece(self.serial, sketch, flat)


def _array(values: set[int]) -> np.ndarray:
    return np.array(sorted(values), dtype=np.int64)
