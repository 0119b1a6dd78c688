"""Cut a single panel in two, because a panel without a seam stays flat.

The two sides of a seam are equally long. If they have different curves in the flat panels, the closed seam forces the
piece out of the plane. The less the panels are distorted, the more these curves differ. On a surface that bends in one
direction only, panels are not distorted and both sides have equal curves. There the optimisation makes the curves differ
later, which works along a seam that is straight in space.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ...arrays import Bool
from ...params import LayoutParams
from ...progress import Progress
from ...surface.curvature import LOW_RELIEF, relief
from ...surface.mesh import QuadMesh
from ...surface.symmetry import Symmetry, preserved_by
from ..flattening.flatten import flatten
from ..layout import PatchLayout
from ..splitting.straight_runs import ends_and_unevenness, straight_runs
from .board import MergeBoard
from .straighten import fault_cost

# Number of decimals to which ratings of cuts are rounded; among equally rated cuts, the straightest in space is taken
RATING_DECIMALS = 6
MAX_CUTS = 12  # largest number of cuts that are tried; with more, panels may be less distorted, and it takes longer
# Smallest share of the panel's area on either side of a cut; chosen by eye. Larger: more even halves, fewer cuts tried.
MIN_AREA_SHARE = 0.25
# Smallest distance between the ends of two tried cuts, as a share of the outline; chosen by eye. Larger: the tried cuts
# differ more.
MIN_END_DISTANCE = 0.03


def needs_no_halving(board: MergeBoard) -> bool:
    """Return whether the layout need not be halved.

    This is so if it has a cut or several panels, or if the surface is nearly flat or too small for two panels.
    """
    mesh = board.layout.mesh
    if len(board.pieces) != 1 or board.cut.any() or len(mesh.quads) < 2 * board.params.patch_min:
        return True
    return relief(mesh.vertices) <= LOW_RELIEF * mesh.diagonal


def cut_in_half(board: MergeBoard, whole_group: list[Symmetry], progress: Progress) -> MergeBoard:
    """Return a board with the single panel cut where that leaves the least distortion; ``board`` if no cut is possible.

    Cuts that keep more of the symmetries ``whole_group`` are preferred.
    """
    layout = board.layout
    ranked: list[tuple[float, float, int, MergeBoard]] = []
    for number, cut in enumerate(_straight_cuts(layout, board.params, progress)):
        tick = partial(progress, 0.5 + 0.5 * number / MAX_CUTS, "Looking for the seam that drives the panel")
        tick()
        if not PatchLayout(layout.mesh, cut).is_flattenable.all():
            continue
        made = MergeBoard(
            PatchLayout(layout.mesh, cut), board.params, budget=board.budget, tick=tick, cache=board.cache
        )
        kept = preserved_by(whole_group, made.cut)
        share = 0.6 + 0.4 / (1 + len(kept))
        left = sum(float(p.flat.energy @ layout.mesh.areas[p.quads]) for p in made.pieces.values())
        wrong = fault_cost(made, made.pieces.values()) - len(made.pieces)
        rating = round(round(wrong, 6) + share * left / float(layout.mesh.areas.sum()), RATING_DECIMALS)
        ranked.append((rating, _total_turn(layout.mesh, made.cut), number, made))
    return min(ranked, key=lambda r: r[:3])[-1] if ranked else board


def _total_turn(mesh: QuadMesh, cut: Bool[np.ndarray, " edges"]) -> float:
    """Return the sum of the angles in space between successive edges of a cut, radians, rounded to 6 decimals."""
    edges = mesh.edges[cut]
    ways = mesh.vertices[edges[:, 1]] - mesh.vertices[edges[:, 0]]
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    vertex, away = edges.T.ravel(), np.concatenate([ways, -ways])
    order = np.argsort(vertex, kind="stable")
    vertex, away = vertex[order], away[order]
    cosine = -(away[:-1] * away[1:]).sum(axis=1)[vertex[:-1] == vertex[1:]]
    return round(float(np.arccos(np.clip(cosine, -1.0, 1.0)).sum()), 6)


def _straight_cuts(layout: PatchLayout, params: LayoutParams, progress: Progress) -> list[np.ndarray]:
    """Return straight cuts through the panel as (E,) masks; straight cuts that divide it evenly come first."""
    mesh = layout.mesh
    flat = flatten(layout, params, progress)
    runs = straight_runs(flat, 0, partial(progress, 0.4, "Looking for the seam that drives the panel"))
    if runs is None:
        return []
    tails, heads, uneven = ends_and_unevenness(flat, runs)
    score = runs.cost / np.sqrt(mesh.areas.sum()) + uneven**2
    score[uneven > 1.0 - 2.0 * MIN_AREA_SHARE] = np.inf
    found: list[np.ndarray] = []
    places: list[np.ndarray] = []
    for at in np.argsort(score, axis=None, kind="stable").tolist():
        start, end = divmod(at, score.shape[1])
        if not np.isfinite(score[start, end]) or len(found) == MAX_CUTS:
            break
        # skip runs that end near the ends of a better run
        place = np.sort([tails[start], heads[end]])
        near = [np.abs(place - other) for other in places]
        if any((np.minimum(d, len(runs.loop) - d) <= MIN_END_DISTANCE * len(runs.loop)).all() for d in near):
            continue
        places.append(place)
        cut = np.zeros(len(mesh.edges), dtype=bool)
        cut[runs.edges(start, end)] = True
        found.append(cut & ~mesh.border)
    return found
