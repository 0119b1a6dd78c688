"""Flatten all patches together so that both sides of every seam become equally long."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...arrays import Bool, Complex, Float, Int
from ...params import LayoutParams
from ...progress import Progress
from ..layout import PatchLayout
from ..loops import NEXT
from .arap import FlatPatch, PatchProblem, SideSprings, minimise_max_energy, solve_local_global
from .outline import has_simple_outline

LAYOUT_ROUNDS = (
    24  # number of rounds in which the seams of a whole layout are fitted; more may fit better and take longer
)
EDIT_ROUNDS = 10  # number of rounds in which seams are fitted after a manual edit; more make an edit slower than 0.1 s
# Patches with fewer quads share a linear system, because a system of one small patch takes as long as a system of many:
# 3,840 patches of one quad take 3 s instead of 32 s. Larger values gain little.
SMALL_PATCH = 8
BATCH_QUADS = 64  # approximate number of quads in a shared system; larger: fewer and larger systems
# Initial stiffness of the springs on seam sides, where quads have the weight 1; 1 and 10 match seams less well
SPRING_STIFFNESS = 3.0
# Quads whose energy exceeds this share of the distortion limit get more weight; larger values match seams better and
# leave more distortion
ENERGY_CAP = 0.65
# The springs of a seam edge get stiffer if its two flat sides differ in length by more than this share of the edge, and
# softer otherwise; smaller values match seams better and leave more distortion
MISMATCH_CAP = 0.07
# Factor per round on the stiffness of the springs at a patch that exceeds the distortion limit; smaller values soften
# them in fewer rounds
SOFTENING_FACTOR = 0.7


@dataclass(eq=False)
class _FlatteningState:
    """State of a patch, or of several small patches with a common linear system, while seams are fitted."""

    problem: PatchProblem
    flat: FlatPatch
    weights: Float[np.ndarray, " quads"]
    quad: Int[np.ndarray, " sides"]  # local quad of every quad side on a seam
    side: Int[np.ndarray, " sides"]  # number (0 to 3) of this side in its quad
    edge: Int[np.ndarray, " sides"]  # edge of the mesh at this side
    outline: Bool[np.ndarray, "quads 4"]  # mask of the quads' sides on the outline


def match_seams(
    layout: PatchLayout,
    patches: Sequence[np.ndarray],
    corners: Complex[np.ndarray, "quads 4"],
    params: LayoutParams,
    progress: Progress,
    start: Complex[np.ndarray, "quads 4"] | None = None,
    rounds: int = LAYOUT_ROUNDS,
) -> Complex[np.ndarray, "quads 4"]:
    """Flatten patches with springs that pull both sides of every seam to their mean length; return the best round.

    Parameters
    ----------
    layout : mesh and cuts
    patches : quads of each patch to flatten
    corners : flat corners of all quads, complex, metres; used for the patches that stay as they are
    params : limits of the layout
    progress : called with the fraction done
    start : initial rotations of the corner triangles, unit complex numbers, up to a constant rotation of every patch
    rounds : number of rounds

    Returns
    -------
    flat corners of all quads, complex, metres
    """
    mesh = layout.mesh
    limit = params.distortion_limit
    works = _start_all(layout, patches, limit, progress, start)
    length = np.abs(corners[:, NEXT] - corners)
    moving = np.zeros(len(mesh.quads), dtype=bool)
    for work in works:
        moving[work.problem.quads] = True
        _update_lengths(length, work)
    stiffness = np.full(len(mesh.edges), SPRING_STIFFNESS)
    cut = np.flatnonzero(layout.cut)
    pair, sides = mesh.edge_quads[cut], mesh.edge_sides[cut]
    best = [work.flat for work in works]
    best_score = _rank(works, length, pair, sides, mesh.edge_lengths[cut], params)
    for turn in range(rounds):
        for number, work in enumerate(works):
            share = (turn + number / len(works)) / rounds
            work.problem.tick = partial(progress, 0.1 + 0.9 * share, "Fitting the seams")
            _fit_round(work, layout, length, moving, stiffness, params)
        apart = np.abs(length[pair[:, 0], sides[:, 0]] - length[pair[:, 1], sides[:, 1]]) / mesh.edge_lengths[cut]
        change = apart / MISMATCH_CAP
        # distortion matters more than fit: the springs at a patch beyond the distortion limit become softer
        worst = np.zeros(len(mesh.quads))
        for work in works:
            worst[work.problem.quads] = work.problem.max_energies(work.flat.energy)[work.problem.patch_of]
        over = (worst[pair] > params.distortion_limit).any(axis=1)
        change[over] = SOFTENING_FACTOR
        floor = np.where(over, 0.1 * SPRING_STIFFNESS, SPRING_STIFFNESS)
        stiffness[cut] = np.clip(stiffness[cut] * change, floor, 1e3)
        score = _rank(works, length, pair, sides, mesh.edge_lengths[cut], params)
        if score < best_score:
            best, best_score = [work.flat for work in works], score
    made = corners.copy()
    for work, flat in zip(works, best, strict=True):
        made[work.problem.quads] = flat.points[work.problem.corners]
    return made


def _start_all(
    layout: PatchLayout, patches: Sequence[np.ndarray], limit: float, progress: Progress, start: np.ndarray | None
) -> list[_FlatteningState]:
    """Flatten the patches without springs, small patches in batches, large patches one by one; return their states.

    Small patches that overlap or exceed the distortion limit in their batch are flattened again one by one.

    limit : largest allowed distortion E
    start : initial rotations of all corner triangles, or None
    """
    tick = partial(progress, 0.1, "Flattening")
    large = [quads for quads in patches if len(quads) >= SMALL_PATCH]
    small = [quads for quads in patches if len(quads) < SMALL_PATCH]
    heap_of = np.cumsum([len(quads) for quads in small]) // BATCH_QUADS
    works = []
    for number in range(int(heap_of[-1]) + 1 if len(small) else 0):
        heap = [small[k] for k in np.flatnonzero(heap_of == number).tolist()]
        while len(heap) > 1:
            problem = _make_problem(layout, heap, tick)
            flat = solve_local_global(problem, None if start is None else start[problem.quads], tolerance=0.005)
            good = _sound_patches(layout, problem, flat, limit)
            if good.all():
                works.append(_make_state(layout, problem, flat))
                break
            large += [quads for quads, whole in zip(heap, good.tolist(), strict=True) if not whole]
            heap = [quads for quads, whole in zip(heap, good.tolist(), strict=True) if whole]
        else:
            large += heap
    return works + [_flatten_alone(layout, _make_problem(layout, [quads], tick), limit, start) for quads in large]


def _make_problem(layout: PatchLayout, patches: Sequence[np.ndarray], tick: Callable[[], None]) -> PatchProblem:
    """Set up a common linear system for flattening several patches."""
    quads = np.concatenate(patches)
    local = np.unique(layout.flat_corners[quads], return_inverse=True)[1].reshape(-1, 4)
    return PatchProblem(layout.mesh, quads, local, tick, [len(patch) for patch in patches])


def _sound_patches(
    layout: PatchLayout, problem: PatchProblem, flat: FlatPatch, limit: float
) -> Bool[np.ndarray, " patches"]:
    """Return a mask of the patches in ``flat`` that are proven injective and not distorted by more than ``limit``."""
    u, first = flat.points[problem.corners], np.cumsum(problem.sizes) - problem.sizes
    d = u[:, NEXT] - u
    flipped = ~((np.roll(d, 1, axis=1).conj() * d).imag > 0.0).all(axis=1)
    good = ~np.logical_or.reduceat(flipped, first) & (problem.max_energies(flat.energy) <= limit)
    outline = layout.outline_sides[problem.quads]
    if good.all() and has_simple_outline(flat.points, problem.corners, outline, problem.patch_of):
        return good
    for k, (a, b) in enumerate(zip(first.tolist(), (first + problem.sizes).tolist(), strict=True)):
        good[k] &= has_simple_outline(flat.points, problem.corners[a:b], outline[a:b])
    return good


def _flatten_alone(
    layout: PatchLayout, problem: PatchProblem, limit: float, start: np.ndarray | None
) -> _FlatteningState:
    """Flatten one patch without springs; try other initial rotations if it overlaps or is distorted more than ``limit``.

    start : initial rotations of all corner triangles, or None
    """
    outline = layout.outline_sides[problem.quads]
    flat = solve_local_global(problem, None if start is None else start[problem.quads], tolerance=0.005)
    if flat.flip_count or flat.max_energy > limit:
        flat = minimise_max_energy(problem, flat, target=0.95 * limit)
    if flat.flip_count or flat.max_energy > limit or not has_simple_outline(flat.points, problem.corners, outline):
        other = solve_local_global(problem, problem.smoothest_rotations(), tolerance=0.003)
        if (other.flip_count, other.max_energy) < (flat.flip_count, 3 * flat.max_energy):
            other = minimise_max_energy(problem, other, target=0.95 * limit)
        flat = min((flat, other), key=lambda f: (f.flip_count, f.max_energy))
    return _make_state(layout, problem, flat)


def _make_state(layout: PatchLayout, problem: PatchProblem, flat: FlatPatch) -> _FlatteningState:
    """Make the state of flattened patches, with their sides on seams."""
    quad, side = np.nonzero(layout.cut[layout.mesh.quad_edges[problem.quads]])
    edge = layout.mesh.quad_edges[problem.quads[quad], side]
    outline = layout.outline_sides[problem.quads]
    return _FlatteningState(problem, flat, np.ones(len(problem.quads)), quad, side, edge, outline)


def _update_lengths(length: np.ndarray, work: _FlatteningState) -> None:
    """Write the lengths of a patch's flat sides (metres) into ``length`` (F, 4) in place."""
    u = work.flat.points[work.problem.corners]
    length[work.problem.quads] = np.abs(u[:, NEXT] - u)


def _fit_round(
    work: _FlatteningState,
    layout: PatchLayout,
    length: np.ndarray,
    moving: np.ndarray,
    stiffness: np.ndarray,
    params: LayoutParams,
) -> None:
    """Fit a patch to its neighbours for one round: update its quads' weights, set its springs' lengths, solve twice.

    Parameters
    ----------
    work : state of the patch; changed in place
    layout : mesh and cuts
    length : (F, 4) lengths of all flat sides, metres; changed in place
    moving : (F,) mask of the quads that are being flattened; a seam to another quad takes that quad's length
    stiffness : (E,) stiffness of the springs at every edge
    params : limits of the layout
    """
    mesh, problem = layout.mesh, work.problem
    cap = ENERGY_CAP * params.distortion_limit
    work.weights = np.clip(work.weights * np.clip(work.flat.energy / cap, 0.8, 2.0), 1.0, 1e3)
    ends = np.stack([problem.corners[work.quad, work.side], problem.corners[work.quad, NEXT[work.side]]], axis=1)
    column = (mesh.edge_quads[work.edge, 0] == problem.quads[work.quad]).astype(np.int64)
    other, other_side = mesh.edge_quads[work.edge, column], mesh.edge_sides[work.edge, column]
    own, theirs = length[problem.quads[work.quad], work.side], length[other, other_side]
    wanted = np.where(moving[other], 0.5 * (own + theirs), theirs)
    stiff = stiffness[work.edge]
    factor: np.ndarray | None = None
    for _ in range(2):
        vector = work.flat.points[ends[:, 1]] - work.flat.points[ends[:, 0]]
        springs = SideSprings(ends, wanted * vector / np.maximum(np.abs(vector), 1e-300), stiff)
        if factor is None:
            factor = problem.factor(work.weights, springs)
        work.flat = problem.flat_patch(problem.global_step(factor, work.weights, work.flat.rotation, springs))
    _update_lengths(length, work)


def _rank(
    works: list[_FlatteningState],
    length: np.ndarray,
    pair: np.ndarray,
    sides: np.ndarray,
    surface: np.ndarray,
    params: LayoutParams,
) -> tuple[float, float]:
    """Return the rank of a state, smaller is better: flips, overlaps and excess distortion first, then seam mismatch.

    Parameters
    ----------
    works : states of all patches
    length : (F, 4) lengths of all flat sides, metres
    pair, sides : both quads of every cut edge, and their sides on it
    surface : length of every cut edge in space, metres
    params : limits of the layout
    """
    broken = float(sum(work.flat.flip_count + (not _have_simple_outlines(work)) for work in works))
    apart = np.abs(length[pair[:, 0], sides[:, 0]] - length[pair[:, 1], sides[:, 1]]) / surface
    worst = max((work.flat.max_energy for work in works), default=0.0) / params.distortion_limit
    over = max(worst - 0.97, 0.0)
    return broken + over, float(apart.max(initial=0.0) + 3 * np.median(apart)) if len(apart) else worst


def _have_simple_outlines(work: _FlatteningState) -> bool:
    """Return whether the outlines of the patches neither cross nor touch themselves."""
    several = work.problem.patch_of if len(work.problem.sizes) > 1 else None
    return has_simple_outline(work.flat.points, work.problem.corners, work.outline, several)
