"""Changes of a layout where its equilibrium misses the target: cuts, darts and joins, together with their symmetric images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...arrays import Float, Int
from ...optimisation.reach import REASON_NAMES
from ...patches.layout import PatchLayout, straight_on
from ...patches.merging.dissolve import limited_board
from ...patches.tracing.trace import middle_line
from ...simulation.shortfall import angle_defects
from ...surface.symmetry import Symmetry, keeping
from .judge import FlatLayout, Idea, JudgedLayout, LayoutProblem, lay_flat

PLACES = 3  # vertices from which cuts and darts are tried, and seams that are opened; not measured, it bounds the time
IDEAS = 2  # cuts to try at a time while a user waits: each takes as long as a support
# reasons that limit a spiral's match (see ``reach``) and that another cut can remove
MENDED = tuple(REASON_NAMES.index(name) for name in ("unstable", "distorted", "stretched"))
OTHERWISE = 0.25  # weight of the other reasons; above 0 so that places with other reasons alone are found too


def moves(piece: LayoutProblem, judged: JudgedLayout, *, fewer: bool, more: bool) -> Iterator[Idea]:
    """Return changes of a judged layout: with ``more`` cuts and darts where it misses the target, with ``fewer`` cuts elsewhere.

    Every change comes with its images under the symmetries which the layout keeps.
    """
    layout = judged.laid.flat.layout
    kept = keeping(piece.symmetries, layout.cut)

    def changed(edges: np.ndarray, value: bool, origin: str) -> Idea:
        cut = layout.cut.copy()
        cut[with_images(edges, kept)] = value
        return Idea(cut & ~layout.mesh.border, origin)

    if more:
        for edges, origin in cuts(layout, fixable_mismatch(judged)):
            yield changed(edges, True, origin)
    if fewer:
        for edges in weakest(layout, fixable_mismatch(judged))[:PLACES]:
            joined = changed(edges, False, "joined")
            if PatchLayout(layout.mesh, joined.cut).planar.all():
                yield joined


def with_images(edges: Int[np.ndarray, " some"], symmetries: Sequence[Symmetry]) -> Int[np.ndarray, " more"]:
    """Return edges with their images under symmetries."""
    return np.unique(np.concatenate([edges, *(symmetry.edges[edges] for symmetry in symmetries)]))


def fixable_mismatch(judged: JudgedLayout) -> Float[np.ndarray, " quads"]:
    """Return (F,) each quad's share in the mismatch, weighted by whether another cut could remove its reason."""
    return weight_by_fixability(judged.blame, judged.kind)


def weight_by_fixability(
    blame: Float[np.ndarray, " quads"], kind: Int[np.ndarray, " quads"]
) -> Float[np.ndarray, " quads"]:
    """Weight differences of bending by whether another cut could remove their reason, ``kind`` as in ``reach``."""
    return blame * np.where(np.isin(kind, MENDED), 1.0, OTHERWISE)


def with_cuts(layout: PatchLayout, blame: Float[np.ndarray, " quads"]) -> Iterator[Idea]:
    """Yield layouts with one more cut each, see ``cuts``."""
    for edges, origin in cuts(layout, blame):
        cut = layout.cut.copy()
        cut[edges] = True
        yield Idea(cut & ~layout.mesh.border, origin)


def cuts(layout: PatchLayout, blame: np.ndarray) -> Iterator[tuple[np.ndarray, str]]:
    """Yield edges to cut: through the middle of the worst patch, and from its worst vertices to the outline."""
    worst = int(np.bincount(layout.patch_of, blame).argmax())
    middle = middle_line(layout, worst)
    if len(middle):
        yield middle, "cut in the middle"
    seen = set[bytes]()
    for vertex in _places(layout, blame):
        rays = sorted(_rays(layout, vertex), key=lambda ray: float(layout.mesh.edge_lengths[ray].sum()))
        if not rays:
            continue
        tries = [(rays[0], "a dart")]
        if len(rays) > 1:
            tries.append((np.concatenate(rays[:2]), "cut through the worst place"))
        for edges, origin in tries:
            if edges.tobytes() not in seen:
                seen.add(edges.tobytes())
                yield edges, origin


def _places(layout: PatchLayout, blame: np.ndarray) -> list[int]:
    """Return vertices inside patches, those with the largest mismatch and the most enclosed curvature first."""
    mesh = layout.mesh
    inside = (layout.cut_degree == 0) & ~mesh.on_border & (mesh.valence > 0)
    curved = angle_defects(layout)
    weight = blame / max(float(blame.max()), 1e-300) + curved / max(float(curved.max()), 1e-300)
    each = np.bincount(mesh.quads.ravel(), np.repeat(weight, 4), len(mesh.vertices)) / np.maximum(mesh.valence, 1)
    order = np.argsort(np.where(inside, -each, np.inf), kind="stable")[: int(inside.sum())]
    chosen: list[int] = []
    for vertex in order.tolist():
        near = np.linalg.norm(mesh.vertices[chosen] - mesh.vertices[vertex], axis=1) if chosen else np.zeros(0)
        if (near > 3.0 * mesh.median_edge).all():  # keep chosen places apart
            chosen.append(vertex)
        if len(chosen) == PLACES:
            break
    return chosen


def _rays(layout: PatchLayout, vertex: int) -> Iterator[Int[np.ndarray, " some"]]:
    """Return the straight lines from a vertex inside a patch to its outline; those that end at an irregular vertex are left out."""
    mesh = layout.mesh
    outline = (layout.cut_degree > 0) | mesh.on_border
    for quad, side in np.argwhere(mesh.quads == vertex).tolist():
        q, k, walk = np.array([quad]), np.array([side]), list[int]()
        while len(walk) <= len(mesh.edges):
            walk.append(int(mesh.quad_edges[q[0], k[0]]))
            if outline[mesh.quads[q[0], (k[0] + 1) % 4]]:
                yield np.array(walk)
                break
            q, k, valid = straight_on(mesh, q, k)
            if not valid[0]:
                break


def merge_across_seams(piece: LayoutProblem, judged: JudgedLayout, most: int) -> FlatLayout | None:
    """Join panels of a judged layout until it has at most a number of panels, within the limits; None if these forbid it.

    The seams that matter least go first, with their images under the symmetries that the layout keeps.
    """
    layout, params, blame = judged.laid.flat.layout, piece.settings.layout, fixable_mismatch(judged)
    board = limited_board(layout, params, piece.symmetries)
    while len(board.pieces) > most:
        for seam in weakest(board.layout, blame):
            change = board.attempt(seam) if board.is_first_image(seam) else None
            if change is not None and len(change.pieces) == 1 and board.apply(change):
                break
        else:
            return None
    return lay_flat(piece, Idea(board.cut & ~layout.mesh.border, "joined"))


def weakest(layout: PatchLayout, blame: np.ndarray) -> list[Int[np.ndarray, " _"]]:
    """Return the seams, least important first: those with the least mismatch and relieved curvature per length."""
    mesh, opened = layout.mesh, PatchLayout(layout.mesh, np.zeros(len(layout.cut), dtype=bool))
    curved = angle_defects(opened)
    weight = blame / max(float(blame.sum()), 1e-300) + curved / max(float(curved.sum()), 1e-300)

    def loss(edges: np.ndarray) -> float:
        return float(weight[np.unique(mesh.edge_quads[edges])].sum()) / len(edges)

    return sorted(layout.seam_edges, key=lambda edges: (round(loss(edges), 12), int(edges.min())))
