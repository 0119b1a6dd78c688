"""State of the layout during merging: current patches with their flat shapes, and tests of changes against all limits.

To open an edge is to remove its cut, which joins both sides; to close an edge is to cut it.
"""

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
from .sketch import ROOM, Sketch, SketchedPatch, Sketcher

# Smallest relative width of an isthmus in a flat patch, times the largest bottleneck; larger values keep necks wider
# and leave more patches
SLACK = 1.1
# Number of quads above which a patch is given up sooner if its first flattening is far beyond the distortion limit;
# larger values find more merges of large patches
SMALL = 120
# largest compactness of a patch that absorbs a too small patch, as a factor on the limit; larger allows longer patches
LENIENT = 1.25
ATTEMPT = 300.0  # work charged for testing a change, without flattening, in quads times solves; from profiling
SOLVES = 10.0  # work charged for a flattening, in solves: the mean number
# Largest ratio of the shorter outline between an isthmus's ends to its width; a rectangle four times as long as wide
# has 5. Smaller values keep necks wider and leave more patches
BOTTLENECK = 5.0
NOTHING = np.zeros(0, dtype=np.int64)  # empty array of edges


@dataclass(frozen=True, eq=False)
class SeamChange:
    """A tested change: cut edges to join (``opens``), uncut edges to cut (``closes``), and the resulting patches."""

    opens: Int[np.ndarray, " opened"]
    closes: Int[np.ndarray, " closed"]
    pieces: list[SketchedPatch]


class Effort:
    """Budget of work for flattening, counted independently of the machine's speed, so that results are reproducible.

    left : remaining budget, quads times solves
    """

    def __init__(self, left: float = np.inf):
        self.left = left

    @property
    def over(self) -> bool:
        """Whether the budget is used up."""
        return self.left <= 0


class Shared:
    """Cache shared by boards of the same mesh and limits.

    sketcher : measures patches
    flattened : flat patch (None if it failed) and work of a flattening; key: quads, outline, initial rotations, limit
    held : number of quads in all entries of ``flattened``
    """

    def __init__(self, mesh: QuadMesh, params: LayoutParams):
        self.sketcher = Sketcher(mesh, params.neck_min)
        self.flattened: dict[tuple[bytes, bytes, bytes, float], tuple[FlatPatch | None, float]] = {}
        self.held = 0


class Board:
    """State of merging: cuts, pieces (flattened patches), and the symmetries that every change must keep.

    cut : (E,) bool, edges that are cut
    marked : set of edges that are cut or on the border
    pieces, piece_of : pieces by serial number; (F,) serial number of every quad's piece
    bottleneck : largest allowed bottleneck, see ``Sketch``
    distortion_share : share of the distortion limit that may be used
    lenient : whether changes may exceed the limits on isthmuses and compactness
    tick : called at every attempt; may raise to cancel
    shared : cache shared with other boards of the same mesh and limits
    swept, refused : slides already examined, and refused changes, under the present symmetries and limits
    solved : flat patches that were accepted; key: quads, outline, limit
    failed : keys of rejected flattenings with the serials of the merged pieces; from other pieces they may succeed
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
        self.pieces: dict[int, SketchedPatch] = {}
        for quads in layout.patches:
            sketch = self.sketcher.sketch(quads, self.cut)
            problem = PatchProblem(self.mesh, quads, sketch.corners, tick)
            self._put(
                self._with_serial(sketch, minimax(problem, settle(problem), target=0.9 * params.distortion_limit))
            )

    @property
    def layout(self) -> PatchLayout:
        """The current layout, a copy."""
        return PatchLayout(self.mesh, self.cut.copy())

    def is_first_image(self, edges: np.ndarray | Sequence[int]) -> bool:
        """Return whether a run of edges has the smallest edge of all its symmetric images; others can be skipped."""
        if not self.symmetries:
            return True
        lowest = min(int(s.edges[edges].min()) for s in self.symmetries)
        return int(np.min(edges)) <= lowest

    def rotations(self) -> Complex[np.ndarray, "quads 4"]:
        """Return the rotation of every corner triangle, each piece in its own frame."""
        result = np.ones((len(self.mesh.quads), 4), dtype=complex)
        for piece in self.pieces.values():
            result[piece.quads] = piece.flat.rotation
        return result

    def copy(self) -> Board:
        """Return a copy for trials, which shares flattenings and pieces; neither is modified in place."""
        other = copy(self)
        other.cut, other.piece_of, other.pieces = self.cut.copy(), self.piece_of.copy(), dict(self.pieces)
        other.marked, other.swept, other.refused = set(self.marked), set(), set()
        return other

    def pieces_at(self, edges: Int[np.ndarray, " edges"]) -> Int[np.ndarray, "edges 2"]:
        """Return the serials of the pieces on both sides of edges."""
        return self.piece_of[self.mesh.edge_quads[edges]]

    # -- changes ---------------------------------------------------------------------------------------------------

    def attempt(
        self, opens: Int[np.ndarray, " opened"], closes: Int[np.ndarray, " closed"] = NOTHING
    ) -> SeamChange | None:
        """Return the change that opens and closes edges and their symmetric images; None if it would break a limit.

        Only images that touch the same pieces are included; ``apply`` adds the others.
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

    def apply(self, change: SeamChange) -> bool:
        """Make a change with all its symmetric images; if an image breaks a limit, change nothing and return False."""
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

    def _apply(self, change: SeamChange) -> None:
        """Make a change without its symmetric images."""
        self.cut[change.opens] = False
        self.cut[change.closes] = True
        self.marked.difference_update(change.opens.tolist())
        self.marked.update(change.closes.tolist())
        for piece in change.pieces:
            self._put(piece)

    def _put(self, piece: SketchedPatch) -> None:
        """Add a piece, and remove the pieces that share quads with it."""
        for old in np.unique(self.piece_of[piece.quads]).tolist():
            self.pieces.pop(old, None)
        self.pieces[piece.serial] = piece
        self.piece_of[piece.quads] = piece.serial

    def _attempt(self, opens: Int[np.ndarray, " opened"], closes: Int[np.ndarray, " closed"]) -> SeamChange | None:
        """Return the change of exactly these edges, without symmetric images; None if it would break a limit."""
        names = np.unique(self.pieces_at(np.concatenate([opens, closes]))).tolist()
        old = [self.pieces[n] for n in names]
        cut = self.cut.copy()
        cut[opens] = False
        cut[closes] = True
        region = np.sort(np.concatenate([p.quads for p in old]))
        sketches = []
        for quads in self.sketcher.components(region, cut) if len(closes) or len(old) > 2 else [region]:
            parents = [self.pieces[n] for n in np.unique(self.piece_of[quads]).tolist()]
            sketch = self._sketch_if_allowed(quads, cut, parents)
            if sketch is None:
                return None
            sketches.append((sketch, parents))
        pieces = []
        # start with the smallest patch, where a failed flattening costs least
        for sketch, parents in sorted(sketches, key=lambda s: len(s[0].quads)):
            piece = self._solve(sketch, parents, opens)
            if piece is None:
                return None
            pieces.append(piece)
        return SeamChange(np.sort(opens), np.sort(closes), pieces)

    # -- one patch -------------------------------------------------------------------------------------------------

    def _sketch_if_allowed(
        self, quads: Int[np.ndarray, " quads"], cut: Bool[np.ndarray, " edges"], parents: list[SketchedPatch]
    ) -> Sketch | None:
        """Return the sketch of a patch, or None if it breaks a limit that can be checked before flattening.

        A patch may break a limit as far as its parents, the present pieces of its quads, do.
        """
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

    def _solve(self, sketch: Sketch, parents: list[SketchedPatch], opens: np.ndarray) -> SketchedPatch | None:
        """Return the flattened piece; None if it is too distorted, not injective, or has too narrow an isthmus."""
        limit = max(self.distortion_share * self.params.distortion_limit, *(p.flat.worst for p in parents))
        key = (sketch.quads.tobytes(), np.packbits(sketch.sides).tobytes(), limit)
        start = tuple(p.serial for p in parents)
        if key not in self.solved and (key, start) not in self.failed:
            flat = self._cached_flat(sketch, parents, opens, limit)
            if flat is None:
                self.failed.add((key, start))
            else:
                self.solved[key] = flat
        if key not in self.solved:
            return None
        piece = self._with_serial(sketch, self.solved[key])
        if self.lenient:
            return piece
        # the narrowest isthmus may be as narrow as the limit, or as in one of the merged pieces
        return None if piece.isthmus < min(SLACK / self.bottleneck, *(p.isthmus for p in parents)) else piece

    def _cached_flat(
        self, sketch: Sketch, parents: list[SketchedPatch], opens: np.ndarray, limit: float
    ) -> FlatPatch | None:
        """Return the flat patch, from the cache if possible, and subtract its work from the budget."""
        start = self.sketcher.rotations(parents, sketch.quads, opens)
        digest = blake2b(start.tobytes(), digest_size=16).digest()
        key = (sketch.quads.tobytes(), np.packbits(sketch.sides).tobytes(), digest, limit)
        if key not in self.shared.flattened:
            if self.shared.held > ROOM:
                self.shared.flattened, self.shared.held = {}, 0
            self.shared.flattened[key] = self._flatten(sketch, start, limit)
            self.shared.held += len(sketch.quads)
        flat, work = self.shared.flattened[key]
        self.effort.left -= work  # charged for cached results too, so that layouts don't depend on the cache
        return flat

    def _flatten(self, sketch: Sketch, start: np.ndarray, limit: float) -> tuple[FlatPatch | None, float]:
        """Flatten a patch; return it (None if it exceeds the limit or is not injective), and the work."""
        problem = PatchProblem(self.mesh, sketch.quads, sketch.corners, self.tick)
        work = SOLVES * len(sketch.quads)
        # reweighting quads (minimax) halves the largest energy, and lowers it far more if only few quads cause it
        bar = limit * (1.8 + 3.2 * min(1.0, SMALL / len(sketch.quads)) ** 2)
        flat = settle(problem, start, tolerance=0.01, hopeless=bar)
        if flat.worst > bar:
            return None, work
        if flat.worst > limit or flat.flips:
            work *= 4
            flat = minimax(problem, flat, target=0.97 * limit, hopeless=limit)
        good = flat.worst <= limit and not flat.flips and simple(flat.points, sketch.corners, sketch.sides)
        return flat if good else None, work

    def _with_serial(self, sketch: Sketch, flat: FlatPatch) -> SketchedPatch:
        """Return a flattened patch as a piece with the next serial number."""
        self.serial += 1
        return SketchedPatch(self.serial, sketch, flat)


def _array(values: set[int]) -> np.ndarray:
    """Return the elements of a set as a sorted array."""
    return np.array(sorted(values), dtype=np.int64)
