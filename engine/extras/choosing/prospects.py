"""Ways to bring an optimised piece nearer to its target, each with the match that a short search reaches.

A short search takes seconds, a prediction half as long, so only ways that are predicted to help get a search. When the
user presses the button of a way, the full search has the same start and more time. So it comes at least as near to the
target as the short search, apart from small losses when the final outlines are checked.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...mechanics.laplacian import laplacian_difference
from ...mechanics.loads import LOWEST, parse_supports
from ...optimisation.match_limits import MatchLimits
from ...optimisation.optimise import optimise
from ...optimisation.remedies import CUT, wanted_percent
from ...params import Settings
from ...patches.flattening.flatten import FlatPatches
from ...progress import SILENT, Progress
from ...simulation.simulate import Simulation
from ...surface.checking.folds import smooth_folds
from ...surface.mesh import PolygonMesh, QuadMesh
from .judge import SHORT_SHARE, CutPlan, LayoutProblem, flatten_cuts, judge
from .layout_changes import PLANS_PER_STEP, plans_with_cuts, weight_by_fixability
from .predict import PredictionStart, predict

BORDER, ROUND_FOLDS = "border", "round"  # ways beside ``LOWEST`` and ``CUT``: supports at the border, and rounded folds
# Largest ratio of new to present distance from the target at which a way is offered; larger: more buttons, more of them
# with little gain
WORTHWHILE_RATIO = 0.8
MAX_SUPPORT_SHARE = 0.5  # largest share of quads to support; larger: too little of the piece is left to bend


def find_prospects(
    found: Simulation,
    limits: MatchLimits,
    settings: Settings,
    *,
    supports: Int[np.ndarray, " held"] | None = None,
    force: Float[np.ndarray, "quads 3"] | None = None,
    progress: Progress = SILENT,
) -> dict[str, float] | None:
    """Find ways to bring an optimised piece nearer to its target, the best first.

    Parameters
    ----------
    found : simulation of the piece
    limits : the reasons why the piece misses the target
    settings : settings with which it was optimised
    supports : (k,) indices of supported quads; None if the piece has no supports yet, so that supports may be proposed
    force : (F, 3) force on every quad, newtons, or None
    progress : called with the fraction done; may cancel

    Returns
    -------
    for each way, RMS distance from the target, percent of the size, that it reaches; None if the piece is near enough
    already, or has no equilibrium. ``LOWEST`` supports the lowest quads, ``BORDER`` those at the border. ``CUT`` adds
    cuts where the shape misses the target. ``ROUND_FOLDS`` rounds the folds of the target; its distance is from the
    rounded target
    """
    now = found.target_distances["rms_percent"]
    if not found.equilibrium.converged or now <= wanted_percent(settings.choose):
        return None
    ways: list[tuple[str, Any]] = [] if supports is not None else list(support_options(found.target))
    ideas = plans_with_cuts(found.design.flat.layout, weight_by_fixability(_mismatch(found), limits.kind))
    ways += [(CUT, idea) for idea in islice(ideas, PLANS_PER_STEP)]
    design, smooth = found.design, found.target.with_vertices(smooth_folds(PolygonMesh.from_quads(found.target)))
    piece = LayoutProblem(found.target, settings, supports, force, spirals=(design.width, design.twist))
    if not np.array_equal(smooth.vertices, found.target.vertices):
        ways.append((ROUND_FOLDS, replace(piece, mesh=smooth)))
    promise = _PredictionFilter(piece, design.flat, progress.quiet())
    reached: dict[str, float] = {}
    for name, what in progress.each(ways, "Looking for what would bring it nearer"):
        quiet = progress.quiet()
        if name == CUT:
            percent = _distance_with_cuts(piece, what, promise, quiet)
        elif name == ROUND_FOLDS:
            percent = _distance_with_cuts(what, CutPlan(found.design.flat.layout.cut, ROUND_FOLDS), promise, quiet)
        else:
            percent = _distance_with_supports(found, piece, what, promise, quiet)
        if percent <= WORTHWHILE_RATIO * now:
            reached[name] = min(percent, reached.get(name, np.inf))
    return dict(sorted(reached.items(), key=lambda one: one[1]))


class _PredictionFilter:
    """Predicts whether another layout or other supports bring a piece nearer to its target.

    The rod model has no prediction; ``gains`` is then always true.
    """

    def __init__(self, piece: LayoutProblem, flat: FlatPatches, progress: Progress) -> None:
        self.progress = progress
        self.start = (
            None if piece.settings.simulate.model == "rod" else PredictionStart.from_layout(piece, flat, progress)
        )
        self.now = predict(piece, flat, self.start, progress) if self.start else np.inf

    def gains(self, piece: LayoutProblem, flat: FlatPatches) -> bool:
        """Return whether a layout is predicted to come near enough to the target to be worth a search.

        The predicted distance must be at most ``WORTHWHILE_RATIO`` times the one predicted for the present piece.

        piece : the surface, with the supports to try; flat : the layout to try
        """
        return self.start is None or predict(piece, flat, self.start, self.progress) <= WORTHWHILE_RATIO * self.now


def support_options(mesh: QuadMesh) -> list[tuple[str, Int[np.ndarray, " _"]]]:
    """Return sets of quads, each with its name, at which a piece could be supported.

    Sets with more than ``MAX_SUPPORT_SHARE`` of all quads are left out.
    """
    border = np.unique(np.nonzero(mesh.border[mesh.quad_edges])[0])
    found: dict[bytes, tuple[str, np.ndarray]] = {}
    for name, quads in ((LOWEST, parse_supports(mesh, LOWEST)), (BORDER, border)):
        if 0 < len(quads) <= MAX_SUPPORT_SHARE * len(mesh.quads):
            found.setdefault(np.sort(quads).tobytes(), (name, quads))
    return list(found.values())


def _distance_with_supports(
    found: Simulation,
    piece: LayoutProblem,
    supports: Int[np.ndarray, " held"],
    promise: _PredictionFilter,
    progress: Progress,
) -> float:
    """Return the RMS distance from the target, percent of its size, that a short search with other supports reaches.

    Infinite if there is no equilibrium, or if too little gain is predicted.

    found : simulation of the piece; piece : its surface, settings and forces; supports : quads to support
    promise : prediction of the gain, which decides whether the search is made
    """
    settings = piece.settings
    if not promise.gains(replace(piece, supports=supports), found.design.flat):
        return np.inf
    patience = SHORT_SHARE * (settings.optimise.patience or 1.0)
    params = replace(settings.optimise, patience=patience, restart=False, open_slots=False)
    try:
        better = optimise(
            found.design,
            found.target,
            found.material,
            params,
            settings.simulate,
            supports=supports,
            force=piece.force,
            prove=False,
            progress=progress,
        )
    except FlexMapsError:
        return np.inf
    return better.after.target_distances["rms_percent"] if better.after.equilibrium.converged else np.inf


def _distance_with_cuts(piece: LayoutProblem, idea: CutPlan, promise: _PredictionFilter, progress: Progress) -> float:
    """Return the RMS distance from the target, percent of its size, that a short search with other cuts reaches.

    Infinite if the cut surface cannot be flattened or has no equilibrium, or if too little gain is predicted.

    piece : the surface with its supports and settings; idea : the cuts
    promise : prediction of the gain, which decides whether the search is made
    """
    laid = flatten_cuts(piece, idea, progress=progress)
    if laid is None or not promise.gains(piece, laid.flat):
        return np.inf
    judged = judge(piece, laid, progress=progress)
    return np.inf if judged is None else 100.0 * judged.rms


def _mismatch(found: Simulation) -> Float[np.ndarray, " quads"]:
    """Return each quad's mismatch, (F,) square metres: squared difference of the Laplacian coordinates of its centre in
    the simulated shape and in the target."""
    bends = laplacian_difference(found.assembly.pairs, found.equilibrium.pose.centres, found.target.centroids)
    return (bends**2).sum(axis=1)
