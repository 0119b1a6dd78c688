"""Prediction of how near a layout can come to its target, without a search.

The curvature-adjusted spirals, or those of an optimised layout, are brought to equilibrium. One Gauss-Newton step of spirals and
flat shapes, within all bounds, leads to a second equilibrium; the prediction is the distance after another step from there if hubs moved
linearly with the design. A search takes more steps, each of which is expected to reduce the distance by the same factor. Limits of strains are
left out.

Over 88 layouts of 21 surfaces its rank correlation with what searches reach is 0.91, and 68 % of predictions are within a factor of 1.5; of
67 layouts predicted with the spirals of another, optimised layout, 0.94 and 81 %. With one equilibrium, which takes half of the
time, the former are 0.78 and 60 %. These were measured with steps that brought less of the decrease; with the present ones it is 0.92 and 70 % over
40 layouts of 11 surfaces. ``bench layout --match`` measures them.
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
from ...optimisation.reach import find_limits
from ...optimisation.scaling import CurvatureEstimate
from ...optimisation.task import Task
from ...optimisation.work import Work
from ...patches.flattening.flatten import FlatPatches
from ...progress import SILENT, Progress
from ...spirals.design import SpiralDesign
from ...spirals.fabricable import make_fabricable
from .judge import FlatLayout, JudgedLayout, LayoutProblem, judge_shape, starting_spirals

# Shares of the first step that are tried in turn until the piece comes nearer. With the full step alone, 59 % of the predictions of 22 surfaces are
# within a factor of 1.5 of what a search reaches, with both shares 64 %; a third share changes no prediction
SHARES = 1.0, 0.3
PRODUCT_SHARE = 0.02  # of the progress that is left, for each product with the model's matrix; a step takes some 100
DAMPING = 1e-4  # penalty, as a share of the objective, on a step over the whole range of one coordinate


@dataclass(frozen=True, eq=False)
class PredictionStart:
    """Start of the predictions for all layouts of a piece.

    spirals : widths (F, 4) metres and twists (F,) radians of a design that can be cut; space : its design space
    """

    spirals: tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]
    space: DesignSpace

    @classmethod
    def from_layout(cls, piece: LayoutProblem, flat: FlatPatches, progress: Progress = SILENT) -> PredictionStart:
        """Return the spirals of the piece, or the curvature-adjusted ones, changed where they cannot be cut in a layout."""
        design = make_fabricable(flat, piece.settings.spiral, *starting_spirals(piece), prove=False, progress=progress)
        return cls((design.width, design.twist), _task(piece).space(design, progress))

    def with_uniform_spirals(self, width: float = 0.5, twist: float = 0.5) -> PredictionStart:
        """Return a start with equally wide and equally twisted spirals in all quads.

        Parameters
        ----------
        width, twist : from 0 to 1, shares of their ranges
        """
        return replace(self, spirals=self.space.design(self.space.uniform(width, twist)))


def predict(
    piece: LayoutProblem,
    flat: FlatPatches,
    start: PredictionStart | None = None,
    progress: Progress = SILENT,
    *,
    further: int = 0,
) -> float:
    """Return the RMS distance from the target that a search of a layout may reach.

    Parameters
    ----------
    piece : the surface, how it is held, and what it is made of
    flat : one of its layouts
    start : made from any layout of the piece, which saves half of the time; default is made from this layout
    further : steps of a search after the second, each expected to shrink the distance by the same share as the second

    Returns
    -------
    A share of the size of the surface; infinite if the layout has no equilibrium, or its quads have no room for spirals.
    """
    try:
        start = start or PredictionStart.from_layout(piece, flat, progress.part(0.0, 0.1))
        design, point = _rest(piece, flat, start, progress.part(0.1, 0.4))
        return _predicted(design, point, progress.part(0.4, 1.0), further)
    except FlexMapsError:
        return np.inf


def judge_by_prediction(
    piece: LayoutProblem, start: PredictionStart, laid: FlatLayout, progress: Progress = SILENT
) -> JudgedLayout | None:
    """Return a layout judged by its prediction, not by a search; None if it has no equilibrium.

    Parameters
    ----------
    piece : the surface, how it is held, and what it is made of
    start : made from any layout of the piece
    laid : the layout
    """
    try:
        design, point = _rest(piece, laid.flat, start, progress.part(0.0, 0.4))
        rms = _predicted(design, point, progress.part(0.4, 1.0))
        if not np.isfinite(rms):
            return None
        rested = _task(piece).rested(design, point)
        found = judge_shape(laid, rested, find_limits(rested, remedies=False), 0.0, thorough=False)
    except FlexMapsError:
        return None
    return replace(found, rms=rms, largest=found.largest * rms / max(found.rms, rms))


def _rest(
    piece: LayoutProblem, flat: FlatPatches, start: PredictionStart, progress: Progress
) -> tuple[SpiralDesign, FlatPoint]:
    """Return the design that a prediction begins with, and its equilibrium, from which flat shapes may move."""
    task = _task(piece)
    design = make_fabricable(flat, piece.settings.spiral, *start.spirals, prove=False, progress=progress)
    problem = task.problem(design, progress, start.space.including(design))
    limits = task.params.distortion_limit, MAX_SEAM_MISMATCH
    free, movable = problem.space.free, design.rim is None
    shapes = FlatRange.from_patches(
        flat, MAX_SHIFT, *limits, 0.0, flat, free, border=movable
    )  # ``update_stiffness`` decides the weight
    whole = FlatProblem.from_problem(problem, shapes)
    x = np.concatenate([problem.space.coordinates(design.width, design.twist), np.full(2 * len(shapes.span), 0.5)])
    return design, whole.at(x, target_pose(piece.mesh, flat.corners), progress).renewed()


def _predicted(design: SpiralDesign, point: FlatPoint, progress: Progress, further: int = 0) -> float:
    """Return the predicted distance as a share of the size; infinite if the point is not an equilibrium.

    further : steps after the second, each of which shrinks the distance by the share by which the second does
    """
    if not point.equilibrium.converged:
        return np.inf
    pose, step = point.equilibrium.pose, _step(point, progress.part(0.0, 0.4))
    before = between = _distance(point, pose)
    for share in SHARES:
        after = point.problem.at(point.problem.within(point.x + share * step, point), pose, progress.part(0.4, 0.6))
        moved = _distance(after, after.equilibrium.pose)
        # the value is infinite where flat shapes leave their limits
        if after.equilibrium.converged and np.isfinite(after.value) and moved < before:
            point, between = after.renewed(), moved
            step = _step(point, progress.part(0.6, 1.0))
            break
    moved = _moved(point, step)
    shrunk = min(1.0, moved / between) ** further if between > 0.0 else 1.0
    return shrunk * min(before, moved) / design.flat.layout.mesh.diagonal


def _moved(point: FlatPoint, step: Float[np.ndarray, " coordinates"]) -> float:
    """Return metres RMS from the target after a step along which hubs move linearly."""
    pose = point.equilibrium.pose
    return _distance(point, replace(pose, centres=pose.centres + point.moves(step)[: len(pose.centres), :3]))


def _step(point: FlatPoint, progress: Progress) -> Float[np.ndarray, " coordinates"]:
    """Return the step that nearly minimises the linear model of the mismatch within the bounds."""
    damping, bending = DAMPING * point.value / len(point.x), CurvatureEstimate(len(point.x))
    products = progress.shares(PRODUCT_SHARE)

    def product(way: np.ndarray) -> np.ndarray:
        next(products)(0.0)  # the only place to cancel in this step
        return point.gauss_newton(way)

    point.prepare(progress)
    bending.refine(product)
    units = bending.units(point.value, damping)
    return bounded_step(point.x, point.gradient, lambda way: product(way) + damping * way, point.rooms, units)


def _distance(point: FlatPoint, pose: Pose) -> float:
    """Return metres RMS from the target."""
    target = point.problem.target
    return target.unit * target.distance(pose)


def _task(piece: LayoutProblem) -> Task:
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
