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
from ..flattening.arap import FlatPatch, PatchProblem, minimise_max_energy, solve_local_global
from ..flattening.outline import has_simple_outline
from ..layout import PatchLayout
from ..tracing.regions import MERGING_SHARE
from .sketch import MAX_CACHED_QUADS, FlatPiece, PatchMeasurer, PatchMeasures

# An isthmus of a flat patch must be at least as wide, relative to the outline (see ``isthmus_width``), as this number
# divided by the largest allowed bottleneck; larger values keep necks wider and leave more patches
NECK_FACTOR = 1.1
# Number of quads up to which a patch is given up only if its first flattening exceeds 5 times the distortion limit;
# larger patches are given up earlier, the largest at 1.8 times. Larger values find more merges of large patches.
SMALL_PIECE = 120
# Factor on the limit of compactness for a patch that absorbs a too small patch; larger allows longer patches
LENIENT_FACTOR = 1.25
ATTEMPT_WORK = 300.0  # work charged for testing a change, besides flattening, in quads times solves; from profiling
SOLVES_PER_FLATTENING = 10.0  # work charged for a flattening, in solves: their mean number
# Largest allowed ratio of the shorter part of the outline between an isthmus's ends to the isthmus's width; a rectangle
# four times as long as wide has 5. Smaller values keep necks wider and leave more patches.
BOTTLENECK = 5.0
NO_EDGES = np.zeros(0, dtype=np.int64)  # empty array of edges


@dataclass(frozen=True, eq=False)
class SeamChange:
    """A tested change: cut edges to join (``joins``), uncut edges to cut (``cuts``), and the resulting patches."""

    joins: Int[np.ndarray, " opened"]
    cuts: Int[np.ndarray, " closed"]
    pieces: list[FlatPiece]


class WorkBudget:
    """Budget of work for flattening, counted independently of the machine's speed, so that results are reproducible.

    remaining : work that is left, in quads times solves
    """

    def __init__(self, left: float = np.inf):
        self.remaining = left

    @property
    def is_spent(self) -> bool:
        """Whether the budget is used up."""
        return self.remaining <= 0


class BoardCache:
    """Cache shared by boards of the same mesh and limits.

    measurer : measures patches
    flattenings : flat patch (None if it failed) and work of a flattening; key: quads, outline, initial rotations, limit
    quad_count : number of quads in all entries of ``flattenings``
    """

    def __init__(self, mesh: QuadMesh, params: LayoutParams):
        self.measurer = PatchMeasurer(mesh, params.neck_min)
        self.flattenings: dict[tuple[bytes, bytes, bytes, float], tuple[FlatPatch | None, float]] = {}
        self.quad_count = 0


class MergeBoard:
    """State of merging: cuts, pieces (flattened patches), and the symmetries that every change must keep.

    cut : (E,) bool, edges that are cut
    cut_or_border : set of edges that are cut or on the border
    pieces, piece_of : pieces by serial number; (F,) serial number of every quad's piece
    bottleneck : largest allowed bottleneck, see ``PatchMeasures``
    distortion_share : share of the distortion limit that may be used
    is_lenient : whether changes may exceed the limits on isthmuses and compactness
    tick : called at every attempt to change the layout; may raise an exception to cancel
    cache : cache shared with other boards of the same mesh and limits
    tried_slides : slides of seams that were already examined
    refused_changes : changes that were refused under the present symmetries and limits
    accepted_patches : flat patches that were accepted; key: quads, outline, limit
    failed_flattenings : for rejected flat patches, pairs of such a key and the serials of the merged pieces; merged from
        other pieces, the patch is flattened from another start, which may succeed
    """

    def __init__(
        self,
        layout: PatchLayout,
        params: LayoutParams,
        symmetries: Sequence[Symmetry] = (),
        budget: WorkBudget | None = None,
        tick: Callable[[], None] = lambda: None,
        cache: BoardCache | None = None,
    ):
        self.mesh, self.params, self.symmetries = layout.mesh, params, list(symmetries)
        self.angles = corner_angles(layout.mesh)
        self.cut = layout.cut.copy()
        self.cut_or_border = set(np.flatnonzero(layout.cut | layout.mesh.border).tolist())
        self.piece_of = -1 - layout.patch_of
        self.cache = cache or BoardCache(layout.mesh, params)
        self.measurer = self.cache.measurer
        self.bottleneck = BOTTLENECK
        self.distortion_share = MERGING_SHARE
        self.is_lenient = False
        self.budget = budget or WorkBudget()
        self.tick = tick
        self.serial = 0
        self.tried_slides: set[tuple[object, ...]] = set()
        self.refused_changes: set[tuple[bytes, ...]] = set()
        self.accepted_patches: dict[tuple[bytes, bytes, float], FlatPatch] = {}
        self.failed_flattenings: set[tuple[tuple[bytes, bytes, float], tuple[int, ...]]] = set()
        self.pieces: dict[int, FlatPiece] = {}
        for quads in layout.patches:
            measures = self.measurer.measure(quads, self.cut)
            problem = PatchProblem(self.mesh, quads, measures.corners, tick)
            self._add_piece(
                self._with_serial(
                    measures,
                    minimise_max_energy(problem, solve_local_global(problem), target=0.9 * params.distortion_limit),
                )
            )

    @property
    def layout(self) -> PatchLayout:
        """The current layout, a copy."""
        return PatchLayout(self.mesh, self.cut.copy())

    def is_first_image(self, edges: np.ndarray | Sequence[int]) -> bool:
        """Return whether no symmetric image of a run of edges has a smaller edge; other runs can be skipped as images."""
        if not self.symmetries:
            return True
        lowest = min(int(s.edges[edges].min()) for s in self.symmetries)
        return int(np.min(edges)) <= lowest

    def rotations(self) -> Complex[np.ndarray, "quads 4"]:
        """Return the rotation of every corner triangle from the surface to its flat piece, unit complex numbers."""
        result = np.ones((len(self.mesh.quads), 4), dtype=complex)
        for piece in self.pieces.values():
            result[piece.quads] = piece.flat.rotation
        return result

    def copy(self) -> MergeBoard:
        """Return a copy for trials, which shares flattenings and pieces; neither is modified in place."""
        other = copy(self)
        other.cut, other.piece_of, other.pieces = self.cut.copy(), self.piece_of.copy(), dict(self.pieces)
        other.cut_or_border, other.tried_slides, other.refused_changes = set(self.cut_or_border), set(), set()
        return other

    def pieces_at(self, edges: Int[np.ndarray, " edges"]) -> Int[np.ndarray, "edges 2"]:
        """Return the serials of the pieces on both sides of edges."""
        return self.piece_of[self.mesh.edge_quads[edges]]

    # -- changes ---------------------------------------------------------------------------------------------------

    def attempt(
        self, joins: Int[np.ndarray, " opened"], cuts: Int[np.ndarray, " closed"] = NO_EDGES
    ) -> SeamChange | None:
        """Return the change that joins cut edges (``joins``) and cuts edges (``cuts``); None if it would break a limit.

        The change includes the edges' symmetric images as far as they touch the same pieces; ``apply`` adds all other
        images.
        """
        self.tick()
        if self.budget.is_spent:
            return None
        self.budget.remaining -= ATTEMPT_WORK
        if not self.symmetries:
            return self._attempt_exactly(joins, cuts)
        images = [(s.edges[joins], s.edges[cuts]) for s in self.symmetries]
        opened, closed = set(joins.tolist()), set(cuts.tolist())
        touched = set(self.pieces_at(np.concatenate([joins, cuts])).ravel().tolist())
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
        return self._attempt_exactly(_sorted_array(opened), _sorted_array(closed))

    def apply(self, change: SeamChange) -> bool:
        """Make a change with all its symmetric images; if an image breaks a limit, change nothing and return False."""
        if not self.symmetries:
            self._apply_exactly(change)
            return True
        before = self.copy()
        done = {(change.joins.tobytes(), change.cuts.tobytes())}
        self._apply_exactly(change)
        for s in self.symmetries:
            o, c = np.sort(s.edges[change.joins]), np.sort(s.edges[change.cuts])
            if (o.tobytes(), c.tobytes()) in done:
                continue
            done.add((o.tobytes(), c.tobytes()))
            image = self._attempt_exactly(o, c) if self.cut[o].all() and not self.cut[c].any() else None
            if image is None:
                self.cut, self.piece_of, self.pieces = before.cut, before.piece_of, before.pieces
                self.cut_or_border = before.cut_or_border
                return False
            self._apply_exactly(image)
        return True

    def _apply_exactly(self, change: SeamChange) -> None:
        """Make a change without its symmetric images."""
        self.cut[change.joins] = False
        self.cut[change.cuts] = True
        self.cut_or_border.difference_update(change.joins.tolist())
        self.cut_or_border.update(change.cuts.tolist())
        for piece in change.pieces:
            self._add_piece(piece)

    def _add_piece(self, piece: FlatPiece) -> None:
        """Add a piece, and remove the pieces that share quads with it."""
        for old in np.unique(self.piece_of[piece.quads]).tolist():
            self.pieces.pop(old, None)
        self.pieces[piece.serial] = piece
        self.piece_of[piece.quads] = piece.serial

    def _attempt_exactly(
        self, joins: Int[np.ndarray, " opened"], cuts: Int[np.ndarray, " closed"]
    ) -> SeamChange | None:
        """Return the change that joins and cuts exactly these edges, without images; None if it would break a limit."""
        names = np.unique(self.pieces_at(np.concatenate([joins, cuts]))).tolist()
        old = [self.pieces[n] for n in names]
        cut = self.cut.copy()
        cut[joins] = False
        cut[cuts] = True
        region = np.sort(np.concatenate([p.quads for p in old]))
        measured = []
        for quads in self.measurer.components(region, cut) if len(cuts) or len(old) > 2 else [region]:
            parents = [self.pieces[n] for n in np.unique(self.piece_of[quads]).tolist()]
            measures = self._measure_if_allowed(quads, cut, parents)
            if measures is None:
                return None
            measured.append((measures, parents))
        pieces = []
        # start with the smallest patch, where a failed flattening costs least
        for measures, parents in sorted(measured, key=lambda s: len(s[0].quads)):
            piece = self._flatten_piece(measures, parents, joins)
            if piece is None:
                return None
            pieces.append(piece)
        return SeamChange(np.sort(joins), np.sort(cuts), pieces)

    # -- one patch -------------------------------------------------------------------------------------------------

    def _measure_if_allowed(
        self, quads: Int[np.ndarray, " quads"], cut: Bool[np.ndarray, " edges"], parents: list[FlatPiece]
    ) -> PatchMeasures | None:
        """Return the measures of a patch, or None if it breaks a limit that can be checked before flattening.

        A patch may break a limit only as much as the present pieces of its quads (``parents``) already do.
        """
        mesh, params = self.mesh, self.params
        if len(quads) < min(params.patch_min, *(len(p.quads) for p in parents)):
            return None
        measures = self.measurer.measure(quads, cut)
        allowed = max(params.compactness_limit, min(p.measures.compactness for p in parents))
        if self.is_lenient:
            allowed = max(LENIENT_FACTOR * params.compactness_limit, *(p.measures.compactness for p in parents))
        if measures.compactness > allowed * (1 + 1e-9):
            return None
        border = mesh.border[mesh.quad_edges[quads]]
        if not measures.is_flattenable or not measures.loops.has_only_holes(
            measures.corners, self.angles[quads], border
        ):
            return None
        if self.is_lenient:
            return measures
        if measures.isthmuses > sum(p.measures.isthmuses for p in parents):
            return None
        return (
            None if measures.bottleneck > max(self.bottleneck, *(p.measures.bottleneck for p in parents)) else measures
        )

    def _flatten_piece(self, measures: PatchMeasures, parents: list[FlatPiece], opens: np.ndarray) -> FlatPiece | None:
        """Flatten a measured patch; return None if it is too distorted, not injective, or has too narrow an isthmus.

        parents : present pieces of the patch's quads
        opens : edges that are joined
        """
        limit = max(self.distortion_share * self.params.distortion_limit, *(p.flat.max_energy for p in parents))
        key = (measures.quads.tobytes(), np.packbits(measures.sides).tobytes(), limit)
        start = tuple(p.serial for p in parents)
        if key not in self.accepted_patches and (key, start) not in self.failed_flattenings:
            flat = self._cached_flat(measures, parents, opens, limit)
            if flat is None:
                self.failed_flattenings.add((key, start))
            else:
                self.accepted_patches[key] = flat
        if key not in self.accepted_patches:
            return None
        piece = self._with_serial(measures, self.accepted_patches[key])
        if self.is_lenient:
            return piece
        # the narrowest isthmus may be as narrow as the limit, or as in one of the merged pieces
        return None if piece.isthmus < min(NECK_FACTOR / self.bottleneck, *(p.isthmus for p in parents)) else piece

    def _cached_flat(
        self, measures: PatchMeasures, parents: list[FlatPiece], opens: np.ndarray, limit: float
    ) -> FlatPatch | None:
        """Return the patch laid flat, from the cache if possible, and subtract the work from the budget.

        parents : present pieces of the patch's quads
        opens : edges that are joined
        limit : largest allowed distortion E; None is returned if the patch exceeds it or is not injective
        """
        start = self.measurer.rotations(parents, measures.quads, opens)
        digest = blake2b(start.tobytes(), digest_size=16).digest()
        key = (measures.quads.tobytes(), np.packbits(measures.sides).tobytes(), digest, limit)
        if key not in self.cache.flattenings:
            if self.cache.quad_count > MAX_CACHED_QUADS:
                self.cache.flattenings, self.cache.quad_count = {}, 0
            self.cache.flattenings[key] = self._flatten(measures, start, limit)
            self.cache.quad_count += len(measures.quads)
        flat, work = self.cache.flattenings[key]
        self.budget.remaining -= work  # charged for cached results too, so that layouts don't depend on the cache
        return flat

    def _flatten(self, measures: PatchMeasures, start: np.ndarray, limit: float) -> tuple[FlatPatch | None, float]:
        """Flatten a patch; return it (None if it exceeds the limit or is not injective), and the work to charge.

        start : initial rotations of the corner triangles, unit complex numbers
        limit : largest allowed distortion E
        """
        problem = PatchProblem(self.mesh, measures.quads, measures.corners, self.tick)
        work = SOLVES_PER_FLATTENING * len(measures.quads)
        # reweighting quads (minimax) about halves the largest energy, and lowers it far more if only few quads cause it
        bar = limit * (1.8 + 3.2 * min(1.0, SMALL_PIECE / len(measures.quads)) ** 2)
        flat = solve_local_global(problem, start, tolerance=0.01, give_up_above=bar)
        if flat.max_energy > bar:
            return None, work
        if flat.max_energy > limit or flat.flip_count:
            work *= 4
            flat = minimise_max_energy(problem, flat, target=0.97 * limit, give_up_above=limit)
        good = (
            flat.max_energy <= limit
            and not flat.flip_count
            and has_simple_outline(flat.points, measures.corners, measures.sides)
        )
        return flat if good else None, work

    def _with_serial(self, measures: PatchMeasures, flat: FlatPatch) -> FlatPiece:
        """Return a flattened patch as a piece with the next serial number."""
        self.serial += 1
        return FlatPiece(self.serial, measures, flat)


def _sorted_array(values: set[int]) -> np.ndarray:
    """Return the elements of a set as a sorted array."""
    return np.array(sorted(values), dtype=np.int64)
