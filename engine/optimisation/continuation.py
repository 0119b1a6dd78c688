"""Continuation of a search that ended far from its target: springs pull all hubs to it, and are weakened in steps.

A search that begins far from its target can stall in a local minimum between two shapes of the piece, at 2 to 8 % of
the size. Springs keep the piece near the target while spirals and flat shapes change, until it rests there by itself.
The required stability is computed without the springs, so that the piece does not snap when they are removed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..mechanics.assembly import target_pose
from ..mechanics.loads import Springs
from ..progress import Progress
from ..simulation.shortfall import find_far_bodies
from .gauss_newton import SearchRecord
from .inverse import DesignPoint
from .near_target import NEAR_PERCENT
from .point_copy import with_problem
from .remedies import WANTED_PERCENT
from .search import Search, StageResult
from .stability import RequirementWithoutSprings

# RMS distance from the target, in percent of the size, beyond which a search goes on with springs; ``WANTED_PERCENT``
# for pieces about to snap, ``NEAR_PERCENT`` for flat ones. Smaller: more pieces take the time, without gain
# (docs/tuning.md)
FAR_PERCENT = 2.0
# Stiffnesses of the springs, the stiffest first, as shares of the mean translational stiffness of the joints
SHARES = (1e-3, 1e-4, 1e-5, 1e-6)
# Distances from the target, as shares of the distance before this stage. The stage is given up if a piece on springs is
# farther than HOPEFUL. It succeeds if the piece without springs is within SUCCESS. Smaller: given up sooner, succeeds
# less often
HOPEFUL, SUCCESS = 0.5, 0.5
# On springs, steps that change only spirals come first. They end after two consecutive steps that each lower the
# objective by less than this share; then the flat shapes move too. Larger: fewer of these steps
FIRST_STOP = 0.45
# Weight of the stability barrier, as a multiple of the mismatch before this stage. Larger: pieces are more stable
# without springs, but farther from the target
STABILITY_WEIGHT = 1.0
# Work that this stage may add with springs, and after their removal, as shares of the usual time of the search. Larger:
# slower, more pieces reach their target
TIME_WITH_SPRINGS, TIME_AFTER_SPRINGS = 1.25, 0.75
MESSAGE = "Held near the target by springs"  # text of the progress during this stage, which shows no shapes


def continue_far(search: Search, progress: Progress) -> None:
    """Go on with springs from the best result of a search that ended far from its target.

    New results are appended to ``search.results``.

    Parameters
    ----------
    search : a search without springs that has ended
    progress : reports progress and raises Cancelled
    """
    here, work, ended = search.best, search.task.work, search.trace.ended
    if (
        not search.task.params.codesign
        or here.point.arm_model is None
        or here.distance_percent <= _allowed_percent(search, here)
    ):
        return
    work.begin_overtime(TIME_WITH_SPRINGS * work.usual)
    released = _release_from_springs(search, here, progress.part(0.0, 0.7).saying(MESSAGE))
    if released is not None:
        work.begin_overtime(TIME_AFTER_SPRINGS * work.usual, ends_at_rate=True)
        search.relieve_strains(search.run_cycles(released, progress.part(0.7, 0.95)), progress.part(0.95, 1.0))
    search.trace.ended = ended  # users are told how the search without springs ended


def _allowed_percent(search: Search, here: StageResult) -> float:
    """Return the distance from the target, in percent of the size, up to which the result ``here`` needs no springs."""
    pose, held = here.point.equilibrium.pose, here.point.problem.loads.fixed[:, :3].any(axis=1)
    bodies = find_far_bodies(here.design.flat.layout, search.task.target, pose.centres, held)
    flat = [one for one in bodies if one.is_flat]
    if any(one.has_seam or one.is_supported for one in flat):
        return NEAR_PERCENT
    if flat and len(flat) == len(bodies):
        return np.inf  # without seams and supports nothing can bend these bodies out of the plane
    return WANTED_PERCENT if search.is_snapping else FAR_PERCENT


def _release_from_springs(search: Search, here: StageResult, progress: Progress) -> StageResult | None:
    """Return a result without springs within ``SUCCESS`` times the distance of ``here``; None if none is found."""
    task, design, like = search.task, here.design, here.point
    pose = target_pose(task.target, design.flat.corners)
    unit = _mean_stiffness(here.point)
    stability = RequirementWithoutSprings(STABILITY_WEIGHT * here.point.mismatch.value)
    for k, share in enumerate(SHARES):
        within = progress.part(k / len(SHARES), (k + 1) / len(SHARES))
        with_springs = replace(task, springs=Springs(share * unit, task.target.centroids))
        stage = replace(
            search, task=with_springs, trace=SearchRecord(), accepted=_ignore, max_distance=np.inf, results=[]
        )
        point = with_springs.evaluate(design, replace(like.problem, stability=stability), pose, within)
        if not point.equilibrium.converged:
            return None
        point = point.with_strain_weight(point.mismatch.value)
        point = with_problem(
            point, replace(point.problem, stability=stability)
        )  # ``with_strain_weight`` has replaced the required stability
        coarse = replace(task.params, stop=max(task.params.stop, FIRST_STOP))
        start = stage.optimise_spirals(StageResult(design, point, np.inf), coarse, within.part(0.0, 0.3))
        result = stage.run_cycle(start, within.part(0.3, 1.0))
        if result.distance_percent > HOPEFUL * here.distance_percent:
            return None
        design, like, pose = result.design, result.point, result.point.equilibrium.pose
        alone = task.evaluate(design, here.point.problem, pose, within)
        free = StageResult(design, alone.with_strain_weight(alone.mismatch.value), search.max_distance)
        if free.is_sound and free.distance_percent <= SUCCESS * here.distance_percent:
            return search.add_result(design, free.point)
        if task.work.is_over:
            break
    return None


def _mean_stiffness(point: DesignPoint) -> float:
    """Return the mean translational stiffness of the joints, newtons per metre."""
    blocks = point.model.expand(point.model.start(point.equilibrium.pose)).convex
    return float(np.einsum("mii->m", blocks[:, :3, :3]).mean()) / 3.0


def _ignore(point: DesignPoint) -> None:
    """Ignore a better point: it is not shown, because the piece would rest elsewhere without springs."""
