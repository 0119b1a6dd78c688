"""Variants of a layout with no more panels: with a seam shifted, or with one seam joined in exchange for a new cut."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...arrays import Float, Int
from ...patches.layout import PatchLayout
from ...simulation.shortfall import quad_curvatures
from ...surface.mesh import QuadMesh
from ...surface.symmetry import Symmetry, preserved_by
from .judge import CutPlan, JudgedLayout, LayoutProblem
from .layout_changes import fixable_mismatch, propose_cuts, seams_by_importance, with_images

SHIFT_ROWS = (1, 2, 4)  # distances by which a seam is shifted, in rows of quads; more values: more variants, more time
SEAMS_PER_CUT = 6  # number of seams tried in exchange for each new cut; larger: more variants, more time
MAX_VARIANTS = 24  # largest number of variants to flatten; larger: more time (24 with 1,000 quads take some 10 s)


def make_variants(piece: LayoutProblem, judged: JudgedLayout) -> list[CutPlan]:
    """Return variants of a judged layout, those with the least Gaussian curvature within panels first.

    Each change is tried alone, and together with its images under the symmetries that the layout keeps.

    Parameters
    ----------
    piece : the surface and its symmetries
    judged : the layout
    """
    layout = judged.laid.flat.layout
    kept = preserved_by(piece.symmetries, layout.cut)
    found: dict[bytes, CutPlan] = {}
    for symmetries in (kept, []) if kept else ([],):
        for idea in (*_shift_seams(layout, symmetries), *_exchange_seams(layout, symmetries, fixable_mismatch(judged))):
            found.setdefault(idea.cut.tobytes(), idea)
    found.pop((layout.cut & ~layout.mesh.border).tobytes(), None)
    worth = [(_estimate_distortion(PatchLayout(layout.mesh, idea.cut)), k) for k, idea in enumerate(found.values())]
    ideas = list(found.values())
    return [ideas[k] for _, k in sorted(worth)[:MAX_VARIANTS]]


def _estimate_distortion(layout: PatchLayout) -> float:
    """Estimate a layout's distortion: for each panel the integral of the absolute Gaussian curvature, squared; summed
    over all panels, radians squared."""
    return round(float((np.bincount(layout.patch_of, quad_curvatures(layout)) ** 2).sum()), 9)


def _shift_seams(layout: PatchLayout, symmetries: Sequence[Symmetry]) -> Iterator[CutPlan]:
    """Yield plans with one seam, and its images under symmetries, shifted to one side by a number of rows of quads.

    Every seam, both sides, and all numbers in ``SHIFT_ROWS`` are tried.
    """
    for seam in layout.seams:
        for quads, sides in _quads_beside(layout.mesh, seam):
            for rows in SHIFT_ROWS:
                taken = _quads_in_rows(layout, quads, sides, rows)
                if taken is None:
                    break
                cut = layout.cut.copy()
                cut[with_images(seam, symmetries)] = False
                cut[with_images(np.setdiff1d(_outline(layout.mesh, taken), seam), symmetries)] = True
                yield CutPlan(cut & ~layout.mesh.border, "a seam moved")


def _quads_beside(mesh: QuadMesh, seam: Int[np.ndarray, " edges"]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield, for the left and the right of a seam, the quads there and which of their sides (0 to 3) lie on the seam.

    seam : edges of the seam in order
    """
    ends = mesh.edges[seam]
    start = ends[:, 0].copy()
    if len(seam) > 1:
        meets = np.isin(ends[0], ends[1])
        start[0] = ends[0][~meets][0] if (~meets).any() else ends[0, 0]
        for k in range(1, len(seam)):
            start[k] = ends[k - 1].sum() - start[k - 1]
    quads, sides = mesh.edge_quads[seam], mesh.edge_sides[seam]
    # whether a quad's side runs in the direction of the seam: true for one of the two quads at each edge
    along = mesh.quads[quads, sides] == start[:, None]
    for way in (along, ~along):
        which = way.argmax(axis=1)[:, None]
        yield np.take_along_axis(quads, which, 1)[:, 0], np.take_along_axis(sides, which, 1)[:, 0]


def _quads_in_rows(
    layout: PatchLayout, quads: Int[np.ndarray, " edges"], sides: Int[np.ndarray, " edges"], rows: int
) -> Int[np.ndarray, " some"] | None:
    """Return the quads in the first ``rows`` rows beside a seam; None if another seam or the border lies in between.

    quads : quads of the first row; sides : which of their sides (0 to 3) lie on the seam
    """
    mesh, closed, taken = layout.mesh, layout.cut | layout.mesh.border, []
    for _ in range(rows):
        taken.append(quads)
        across = (sides + 2) % 4
        edges = mesh.quad_edges[quads, across]
        if closed[edges].any():
            return None
        other = (mesh.edge_quads[edges, 0] == quads).astype(np.int64)
        quads, sides = mesh.edge_quads[edges, other], mesh.edge_sides[edges, other]
    return np.unique(np.concatenate(taken))


def _outline(mesh: QuadMesh, quads: Int[np.ndarray, " some"]) -> Int[np.ndarray, " edges"]:
    """Return the outline of a set of quads: the edges that belong to only one of them."""
    edges, count = np.unique(mesh.quad_edges[quads], return_counts=True)
    return edges[count == 1]


def _exchange_seams(
    layout: PatchLayout, symmetries: Sequence[Symmetry], blame: Float[np.ndarray, " quads"]
) -> Iterator[CutPlan]:
    """Yield plans with a new cut where the shape misses the target, and one of the least important seams joined.

    blame : (F,) mismatch of every quad, weighted as in ``fixable_mismatch``
    """
    mesh, panels = layout.mesh, len(layout.patches)
    for edges, name in propose_cuts(layout, blame):
        new = with_images(edges, symmetries)
        cut = layout.cut.copy()
        cut[new] = True
        more = PatchLayout(mesh, cut & ~mesh.border)
        for seam in seams_by_importance(more, blame)[: SEAMS_PER_CUT + 1]:
            if np.isin(seam, new).any():
                continue
            joined = more.cut.copy()
            joined[with_images(seam, symmetries)] = False
            after = PatchLayout(mesh, joined)
            if len(after.patches) <= panels and after.is_flattenable.all():
                yield CutPlan(joined, f"{name}, another joined")
