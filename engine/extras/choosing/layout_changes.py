"""Changes of a layout, with their symmetric images: cuts and darts where the shape of the assembled panels misses the
target, and seams that are joined. A dart is a cut that ends inside a panel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...arrays import Float, Int
from ...optimisation.match_limits import REASON_NAMES
from ...patches.layout import PatchLayout, next_straight_side
from ...patches.merging.dissolve import limited_board
from ...patches.tracing.trace import middle_line
from ...simulation.shortfall import quad_curvatures
from ...surface.symmetry import Symmetry, preserved_by
from .judge import CutPlan, FlatLayout, JudgedLayout, LayoutProblem, flatten_cuts

# number of vertices at which cuts and darts begin, and number of seams to join; larger: more layouts to try, more time
MAX_PLACES = 3
PLANS_PER_STEP = 2  # number of cuts to try at a time while a user waits; larger: more layouts to try, more time
# reasons why a spiral misses the target (see ``match_limits``) that another cut can remove
FIXABLE_REASONS = tuple(REASON_NAMES.index(name) for name in ("unstable", "distorted", "stretched"))
# weight of the mismatch of quads with other reasons (``FIXABLE_REASONS`` have weight 1); above 0 so that cuts are also
# tried where other reasons prevail
UNFIXABLE_WEIGHT = 0.25


def propose_changes(piece: LayoutProblem, judged: JudgedLayout, *, fewer: bool, more: bool) -> Iterator[CutPlan]:
    """Yield changed layouts, each with one change and its images under the symmetries that the layout keeps.

    Parameters
    ----------
    piece : the surface, its symmetries and settings
    judged : the layout to change
    fewer : whether to yield layouts with one of the least important seams joined
    more : whether to yield layouts with a cut or a dart added where the shape misses the target
    """
    layout = judged.laid.flat.layout
    kept = preserved_by(piece.symmetries, layout.cut)

    def changed(edges: np.ndarray, value: bool, origin: str) -> CutPlan:
        cut = layout.cut.copy()
        cut[with_images(edges, kept)] = value
        return CutPlan(cut & ~layout.mesh.border, origin)

    if more:
        for edges, origin in propose_cuts(layout, fixable_mismatch(judged)):
            yield changed(edges, True, origin)
    if fewer:
        for edges in seams_by_importance(layout, fixable_mismatch(judged))[:MAX_PLACES]:
            joined = changed(edges, False, "joined")
            if PatchLayout(layout.mesh, joined.cut).is_flattenable.all():
                yield joined


def with_images(edges: Int[np.ndarray, " some"], symmetries: Sequence[Symmetry]) -> Int[np.ndarray, " more"]:
    """Return indices of edges together with the indices of their images under symmetries, sorted, each once."""
    return np.unique(np.concatenate([edges, *(symmetry.edges[edges] for symmetry in symmetries)]))


def fixable_mismatch(judged: JudgedLayout) -> Float[np.ndarray, " quads"]:
    """Return each quad's mismatch, (F,) square metres, weighted as in ``weight_by_fixability``."""
    return weight_by_fixability(judged.blame, judged.kind)


def weight_by_fixability(
    blame: Float[np.ndarray, " quads"], kind: Int[np.ndarray, " quads"]
) -> Float[np.ndarray, " quads"]:
    """Weight each quad's mismatch by 1 if another cut can remove its reason, else by ``UNFIXABLE_WEIGHT``.

    Parameters
    ----------
    blame : (F,) mismatch of every quad: squared difference of its bending from the target's, square metres
    kind : (F,) reason for the mismatch, index into ``match_limits.REASON_NAMES``
    """
    return blame * np.where(np.isin(kind, FIXABLE_REASONS), 1.0, UNFIXABLE_WEIGHT)


def plans_with_cuts(layout: PatchLayout, blame: Float[np.ndarray, " quads"]) -> Iterator[CutPlan]:
    """Yield plans with one more cut than a layout each; parameters as in ``propose_cuts``."""
    for edges, origin in propose_cuts(layout, blame):
        cut = layout.cut.copy()
        cut[edges] = True
        yield CutPlan(cut & ~layout.mesh.border, origin)


def propose_cuts(layout: PatchLayout, blame: np.ndarray) -> Iterator[tuple[np.ndarray, str]]:
    """Yield sets of edges to cut, each with a description of the cut.

    First the middle line of the patch with the largest mismatch, then straight lines from the vertices with most
    mismatch to the outline of their patch, in one direction (a dart) or two (a cut).

    Parameters
    ----------
    layout : mesh and cuts
    blame : (F,) mismatch of every quad, weighted as in ``weight_by_fixability``
    """
    worst = int(np.bincount(layout.patch_of, blame).argmax())
    middle = middle_line(layout, worst)
    if len(middle):
        yield middle, "cut in the middle"
    seen = set[bytes]()
    for vertex in _worst_vertices(layout, blame):
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


def _worst_vertices(layout: PatchLayout, blame: np.ndarray) -> list[int]:
    """Return at most ``MAX_PLACES`` vertices inside patches, those with most mismatch and Gaussian curvature first."""
    mesh = layout.mesh
    inside = (layout.cut_degree == 0) & ~mesh.on_border & (mesh.valence > 0)
    curved = quad_curvatures(layout)
    weight = blame / max(float(blame.max()), 1e-300) + curved / max(float(curved.max()), 1e-300)
    each = np.bincount(mesh.quads.ravel(), np.repeat(weight, 4), len(mesh.vertices)) / np.maximum(mesh.valence, 1)
    order = np.argsort(np.where(inside, -each, np.inf), kind="stable")[: int(inside.sum())]
    chosen: list[int] = []
    for vertex in order.tolist():
        near = np.linalg.norm(mesh.vertices[chosen] - mesh.vertices[vertex], axis=1) if chosen else np.zeros(0)
        if (near > 3.0 * mesh.median_edge).all():  # keep chosen places apart
            chosen.append(vertex)
        if len(chosen) == MAX_PLACES:
            break
    return chosen


def _rays(layout: PatchLayout, vertex: int) -> Iterator[Int[np.ndarray, " some"]]:
    """Yield the edges of each straight line from a vertex to its patch's outline that meets no irregular vertex."""
    mesh = layout.mesh
    outline = (layout.cut_degree > 0) | mesh.on_border
    for quad, side in np.argwhere(mesh.quads == vertex).tolist():
        q, k, walk = np.array([quad]), np.array([side]), list[int]()
        while len(walk) <= len(mesh.edges):
            walk.append(int(mesh.quad_edges[q[0], k[0]]))
            if outline[mesh.quads[q[0], (k[0] + 1) % 4]]:
                yield np.array(walk)
                break
            q, k, valid = next_straight_side(mesh, q, k)
            if not valid[0]:
                break


def merge_across_seams(piece: LayoutProblem, judged: JudgedLayout, most: int) -> FlatLayout | None:
    """Join panels until at most ``most`` are left, and flatten; None if the limits on panels forbid it or this fails.

    The least important seams are joined first, with their images under the symmetries that the layout keeps.

    Parameters
    ----------
    piece : the surface, its symmetries and settings
    judged : the layout to change
    most : largest number of panels
    """
    layout, params, blame = judged.laid.flat.layout, piece.settings.layout, fixable_mismatch(judged)
    board = limited_board(layout, params, piece.symmetries)
    while len(board.pieces) > most:
        for seam in seams_by_importance(board.layout, blame):
            change = board.attempt(seam) if board.is_first_image(seam) else None
            if change is not None and len(change.pieces) == 1 and board.apply(change):
                break
        else:
            return None
    return flatten_cuts(piece, CutPlan(board.cut & ~layout.mesh.border, "joined"))


def seams_by_importance(layout: PatchLayout, blame: np.ndarray) -> list[Int[np.ndarray, " _"]]:
    """Return the edges of every seam, least important first.

    The importance of a seam is the mismatch plus the Gaussian curvature of the quads beside it, each as a share of the
    whole surface's, divided by the number of edges of the seam.

    Parameters
    ----------
    layout : mesh and cuts
    blame : (F,) mismatch of every quad, weighted as in ``weight_by_fixability``
    """
    mesh, opened = layout.mesh, PatchLayout(layout.mesh, np.zeros(len(layout.cut), dtype=bool))
    curved = quad_curvatures(opened)
    weight = blame / max(float(blame.sum()), 1e-300) + curved / max(float(curved.sum()), 1e-300)

    def loss(edges: np.ndarray) -> float:
        return float(weight[np.unique(mesh.edge_quads[edges])].sum()) / len(edges)

    return sorted(layout.seam_edges, key=lambda edges: (round(loss(edges), 12), int(edges.min())))
