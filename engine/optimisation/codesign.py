"""Co-design: spirals and the flat rest shape of their patches sought together, beyond FlexMaps section 7.

A flat shape that is not quite the unrolled surface makes the panels pull each other into shape: where spirals alone are at
the end of what they can be, small changes of their quads still lower the mismatch. Topology, seams and the limits that the
layout keeps stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from ..arrays import Float
from ..errors import FlexMapsError
from ..mechanics.arms.model import ArmModel
from ..params import OptimiseParams
from ..patches.flattening.flatten import FlatPatches, measured, overlapping, seam_mismatch
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign, fitted
from .codesign_problem import WEIGHT, FlatPoint, FlatProblem, FlatRange
from .inverse import Point, Problem
from .optimisers import GOAL, INNER_ITERATIONS, Accepted, Trace

SPAN = 0.5  # range of a flat vertex, as a share of an edge
SEAM = 0.06  # largest difference of a seam's sides, as a share of their length, where it was not more before
MOVING = "Flat shapes"
# How often at the most strains are pressed back anew, and the share of the mismatch that the steps before must bring
TIMES, ENOUGH = 4, 0.05


def refine(
    problem: Problem,
    start: Point,
    design: SpiralDesign,
    params: OptimiseParams,
    method: Callable[..., Point],
    trace: Trace,
    accepted: Accepted,
    progress: Progress = SILENT,
    first: FlatPatches | None = None,
) -> FlatPoint:
    """The best spirals and flat shapes near to a design whose equilibrium is ``start``.

    method : one of ``optimisers``; trace, accepted : as there; first : the flat patches before earlier runs moved them, so
    that limits which they exceed do not creep. ``designed`` makes a design of what is returned.
    Raises FlexMapsError for the rod model, whose rods answer to the size of the whole spiral.
    """
    if not isinstance(start.model, ArmModel):
        raise FlexMapsError(
            "Flat shapes can be moved with the elastic model Arms only; choose it, or leave them as they are"
        )
    weight, first = WEIGHT * start.mismatch.value, first or design.flat
    limits, free = (params.distortion_limit, SEAM), problem.space.free
    # a rim follows the border, whose flat shape stays therefore
    flat = FlatRange.of(design.flat, SPAN, *limits, weight, first, free, border=design.rim is None)
    whole = FlatProblem(**{one.name: getattr(problem, one.name) for one in fields(Problem)}, flat=flat)
    here = whole.at(_stacked(start, design.flat), start.equilibrium.pose, progress.at(0.0, MOVING))
    for k in range(TIMES):
        steps = len(trace.rows)
        found = method(here.problem, here, params, trace, accepted, progress.part(k / TIMES, (k + 1) / TIMES))
        assert isinstance(found, FlatPoint)
        if len(trace.rows) == steps or problem.work.over:
            return found
        fall, here = here.mismatch.value - found.mismatch.value, found.renewed()
        if fall < ENOUGH * here.mismatch.value or here.mismatch.value < GOAL:
            break
    return here


def between(start: Point, found: FlatPoint, share: float, progress: Progress = SILENT) -> FlatPoint:
    """A share of the way from the start of ``refine`` to what it found."""
    here = found.problem.at(_stacked(start, found.problem.flat.flat), start.equilibrium.pose, progress)
    x = found.problem.within(here.x + share * (found.x - here.x), here)
    return found.problem.at(x, start.equilibrium.pose, progress, INNER_ITERATIONS)


def _stacked(start: Point, flat: FlatPatches) -> Float[np.ndarray, " _"]:
    """Coordinates of spirals in their flat shapes as they are."""
    return np.concatenate([start.x, np.full(2 * len(flat.points), 0.5)])


def designed(point: Point, design: SpiralDesign) -> SpiralDesign | None:
    """A point as a design, ``design`` being the one that the search began with; None where patches overlap themselves.

    It can be cut as it is, but for arms that only come near each other since the flat shapes have moved.
    """
    flat, (width, twist) = moved_flat(point, design), point.spirals
    free = point.problem.space.free
    return None if flat is None else fitted(flat, design.params, width, twist, prove=False, free=free)


def moved_flat(point: Point, design: SpiralDesign) -> FlatPatches | None:
    """The flat shapes of a point; those of the design where the search leaves them as they are.

    None where patches came to overlap themselves, which nothing on the way forbids.
    """
    if not isinstance(point, FlatPoint):
        return design.flat
    layout = design.flat.layout
    points = point.problem.flat.points(point.flat_x)
    found = measured(layout, centred(design.flat, points))
    return None if overlapping(found) else found


def centred(flat: FlatPatches, points: np.ndarray) -> np.ndarray:
    """Points (P, 2) with the area centroid of every patch at its origin."""
    layout = flat.layout
    u = points[layout.flat_corners]
    one, two = u[:, 2] - u[:, 0], u[:, 3] - u[:, 1]
    area = 0.5 * (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    total = np.bincount(layout.patch_of, area)
    middle = np.stack([np.bincount(layout.patch_of, area * u[..., k].mean(axis=1)) / total for k in (0, 1)], axis=1)
    out = points.copy()
    out[layout.flat_corners] = u - middle[layout.patch_of][:, None]
    return out


def flat_report(before: FlatPatches, after: FlatPatches) -> dict[str, Any]:
    """What became of the flat shapes, for the ``optimise`` block of report.json; strains are shares."""
    sides = [np.linalg.norm(np.roll(f.corners, -1, axis=1) - f.corners, axis=2) for f in (before, after)]
    grown = np.abs(sides[1] / sides[0] - 1.0)
    report: dict[str, Any] = {"flat_strain_median": float(np.median(grown)), "flat_strain_max": float(grown.max())}
    for name, flat in (("flat_before", before), ("flat", after)):
        seams = seam_mismatch(flat)
        report[name] = {
            "energy_max": float(flat.energy.max()),
            "energy_median": float(np.median(flat.energy)),
            "square_median": float(np.median(flat.square)),
            "seam_mismatch_median": float(np.median(seams)) if len(seams) else 0.0,
            "seam_mismatch_max": float(seams.max(initial=0.0)),
        }
    return report
