"""Prediction of how near a layout can come to its target, without a search.

The prediction starts at the equilibrium of spirals adjusted to the curvature, or of an optimised layout's spirals. A
Gauss-Newton step changes spirals and flat shapes within their bounds and leads to a second equilibrium. There a second
step is computed; the prediction is the distance after it if hubs moved linearly with the design. A search takes more
steps; each further step is assumed to reduce the distance by the same factor as the second, or by less, the more
coordinates of the design have reached their bounds by then. Strain limits are ignored.

For 82 layouts of 21 surfaces, the rank correlation with the results of searches is 0.96, and 78 % of the predictions
are within a factor of 1.5 of these results (one further step assumed, as in *Merge*). ``bench layout --match`` measures
both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...mechanics.assembly import Pose, target_pose
from ...optimisation.bounded_step import bounded_step
from ...optimisation.codesign import MAX_SEAM_MISMATCH, MAX_SHIFT
from ...optimisation.codesign_problem import FlatPoint, FlatProblem, FlatRange
from ...optimisation.design_space import DesignSpace
from ...optimisation.match_limits import find_limits
from ...optimisation.preconditioning import CurvatureEstimate
from ...optimisation.task import Task
from ...optimisation.work import Work
from ...patches.flattening.flatten import FlatPatches
from ...progress import SILENT, Progress
from ...spirals.design import SpiralDesign
from ...spirals.fabricable import make_fabricable
from .judge import FlatLayout, JudgedLayout, LayoutProblem, judge_shape, starting_spirals

# Fractions of the first step, tried in turn until the distance from the target decreases; more: slower, hardly better
STEP_FRACTIONS = 1.0, 0.3
# Share of the remaining progress for each Gauss-Newton matrix product (some 100 a step); changes only the display
PRODUCT_SHARE = 0.02
# Levenberg-Marquardt damping of coordinates that run from 0 to 1, as a share of the objective divided by their number;
# larger: shorter, safer steps
DAMPING = 1e-4
# The share of the design's coordinates that are at their bounds, times BOUND_EFFECT, is the share by which a further
# step brings less than the second; from 1 on it brings nothing. Larger: larger predicted distances if many coordinates
# are at their bounds (docs/tuning.md)
BOUND_EFFECT = 4.0
# Largest distance of a coordinate from its bound, as a share of its range, that counts as 0; any small value will do
AT_BOUND = 1e-6


@dataclass(frozen=True, eq=False)
class PredictionStart:
    """Starting design shared by the predictions of all layouts of a piece.

    spirals : widths (F, 4) metres and twists (F,) radians that can be cut in at least one layout
    space : design space of that layout: bounds and scaling of widths and twists
    """

    spirals: tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]
    space: DesignSpace

    @classmethod
    def from_layout(cls, piece: LayoutProblem, flat: FlatPatches, progress: Progress = SILENT) -> PredictionStart:
        """Return the start made of ``starting_spirals``, changed where they cannot be cut in a layout.

        Parameters
        ----------
        piece : the surface and settings
        flat : one of its layouts
        progress : called with the fraction done; may cancel
        """
        design = make_fabricable(
            flat, piece.settings.spiral, *starting_spirals(piece), check_outlines=False, progress=progress
        )
        return cls((design.width, design.twist), _make_task(piece).build_space(design, progress))

    def with_uniform_spirals(self, width: float = 0.5, twist: float = 0.5) -> PredictionStart:
        """Return a start whose spirals have the same relative width and relative twist in all quads.

        Parameters
        ----------
        width, twist : positions in each spiral's range, from 0 (narrowest, least twist) to 1 (widest, most twist)
        """
        return replace(self, spirals=self.space.width_and_twist(self.space.uniform(width, twist)))


def predict(
    piece: LayoutProblem,
    flat: FlatPatches,
    start: PredictionStart | None = None,
    progress: Progress = SILENT,
    *,
    further: int = 0,
) -> float:
    """Predict the RMS distance from the target that a search of a layout would reach.

    Parameters
    ----------
    piece : the surface, its supports and forces, and the settings
    flat : one of its layouts
    start : start made from any layout of the piece; saves half of the time. By default it is made from ``flat``
    progress : called with the fraction done; may cancel
    further : steps after the second, each assumed to reduce the distance by the same factor as the second, or by less
        where coordinates are at their bounds

    Returns
    -------
    share of the size of the surface; infinite if the layout has no equilibrium, or its quads have no room for spirals
    """
    try:
        start = start or PredictionStart.from_layout(piece, flat, progress.part(0.0, 0.1))
        design, point = _solve_start(piece, flat, start, progress.part(0.1, 0.4))
        return _predict_distance(design, point, progress.part(0.4, 1.0), further)
    except FlexMapsError:
        return np.inf


def judge_by_prediction(
    piece: LayoutProblem, start: PredictionStart, laid: FlatLayout, progress: Progress = SILENT
) -> JudgedLayout | None:
    """Judge a layout by its prediction, without a search; None if it has no equilibrium.

    Parameters
    ----------
    piece : the surface, its supports and forces, and the settings
    start : start made from any layout of the piece
    laid : the layout
    progress : called with the fraction done; may cancel
    """
    try:
        design, point = _solve_start(piece, laid.flat, start, progress.part(0.0, 0.4))
        rms = _predict_distance(design, point, progress.part(0.4, 1.0))
        if not np.isfinite(rms):
            return None
        rested = _make_task(piece).simulate_point(design, point)
        found = judge_shape(laid, rested, find_limits(rested, remedies=False), 0.0, thorough=False)
    except FlexMapsError:
        return None
    return replace(found, rms=rms, largest=found.largest * rms / max(found.rms, rms))


def _solve_start(
    piece: LayoutProblem, flat: FlatPatches, start: PredictionStart, progress: Progress
) -> tuple[SpiralDesign, FlatPoint]:
    """Return the starting design of a prediction, and its equilibrium as a function of spirals and flat shapes."""
    task = _make_task(piece)
    design = make_fabricable(flat, piece.settings.spiral, *start.spirals, check_outlines=False, progress=progress)
    problem = task.build_problem(design, progress, start.space.extended_to(design))
    limits = task.params.distortion_limit, MAX_SEAM_MISMATCH
    free, movable = problem.space.free_spirals, design.rim is None
    shapes = FlatRange.from_patches(
        flat, MAX_SHIFT, *limits, 0.0, flat, free, border=movable
    )  # the penalty weight is 0 here: ``with_updated_weights`` sets it later
    whole = FlatProblem.from_problem(problem, shapes)
    x = np.concatenate([problem.space.coordinates(design.width, design.twist), np.full(2 * len(shapes.span), 0.5)])
    return design, whole.point_at(x, target_pose(piece.mesh, flat.corners), progress).with_updated_weights()


def _predict_distance(design: SpiralDesign, point: FlatPoint, progress: Progress, further: int = 0) -> float:
    """Return the predicted RMS distance, a share of the size; infinite if ``point`` is not an equilibrium.

    further : steps after the second, each assumed to reduce the distance by the same factor as the second, or by less
        where coordinates are at their bounds
    """
    if not point.equilibrium.converged:
        return np.inf
    pose, step = point.equilibrium.pose, _gauss_newton_step(point, progress.part(0.0, 0.4))
    before = between = _distance(point, pose)
    for share in STEP_FRACTIONS:
        after = point.problem.point_at(
            point.problem.restore_clearances(point.x + share * step, point.x), pose, progress.part(0.4, 0.6)
        )
        moved = _distance(after, after.equilibrium.pose)
        # the objective is infinite if flat shapes violate their limits
        if after.equilibrium.converged and np.isfinite(after.value) and moved < before:
            point, between = after.with_updated_weights(), moved
            step = _gauss_newton_step(point, progress.part(0.6, 1.0))
            break
    moved = _linearised_distance(point, step)
    further_effect = further * max(0.0, 1.0 - BOUND_EFFECT * _share_at_bounds(point.x + step))
    shrunk = min(1.0, moved / between) ** further_effect if between > 0.0 else 1.0
    return shrunk * min(before, moved) / design.flat.layout.mesh.diagonal


def _share_at_bounds(x: Float[np.ndarray, " coordinates"]) -> float:
    """Return the share of the design's coordinates, in [0, 1], that are at a bound of their range."""
    return float(((x <= AT_BOUND) | (x >= 1.0 - AT_BOUND)).mean())


def _linearised_distance(point: FlatPoint, step: Float[np.ndarray, " coordinates"]) -> float:
    """Return the RMS distance from the target, metres, after a step of the design, if hubs moved linearly with it."""
    pose = point.equilibrium.pose
    return _distance(point, replace(pose, centres=pose.centres + point.hub_increments(step)[: len(pose.centres), :3]))


def _gauss_newton_step(point: FlatPoint, progress: Progress) -> Float[np.ndarray, " coordinates"]:
    """Return the Gauss-Newton step of the design that nearly minimises the linearised mismatch within the bounds."""
    damping, bending = DAMPING * point.value / len(point.x), CurvatureEstimate(len(point.x))
    products = progress.shares(PRODUCT_SHARE)

    def product(way: np.ndarray) -> np.ndarray:
        next(products)(0.0)  # reports progress; the only place where the user can cancel a step
        return point.gauss_newton_product(way)

    point.precompute(progress)
    bending.refine(product)
    units = bending.units(point.value, damping)
    return bounded_step(
        point.x, point.gradient, lambda way: product(way) + damping * way, point.linear_clearances, units
    )


def _distance(point: FlatPoint, pose: Pose) -> float:
    """Return the RMS distance of a pose from the target, metres."""
    target = point.problem.target
    return target.unit_length * target.relative_distance(pose)


def _make_task(piece: LayoutProblem) -> Task:
    settings = piece.settings
    params = replace(settings.optimise, strain_share=0.0, open_slots=False)
    count = len(piece.mesh.quads)
    return Task(
        piece.mesh,
        settings.material.chosen,
        params,
        settings.simulate,
        piece.supports,
        piece.force,
        Work.for_spirals(count, 0.0),
    )
