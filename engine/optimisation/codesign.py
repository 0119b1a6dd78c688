"""Co-design: optimise spirals and the flat rest shape of their patches together, beyond FlexMaps section 7.

Panels whose flat shape differs slightly from the unrolled surface pull each other into shape. Small changes of the flat quads
therefore lower the mismatch even where all spirals are at their bounds. The topology, the seams and the limits of the layout
do not change.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import FlexMapsError
from ..params import OptimiseParams
from ..patches.flattening.flatten import FlatPatches, overlapping, seam_mismatch, with_energies
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign
from ..spirals.fabricable import make_fabricable
from .codesign_problem import BARRIER_WEIGHT, FlatPoint, FlatProblem, FlatRange
from .inverse import DesignPoint, InverseProblem
from .optimisers import MAX_NEWTON_ITERATIONS, Accepted, SearchRecord, gauss_newton

MAX_SHIFT = 0.5  # largest shift of a flat vertex along x or y, as a share of the shortest mean edge of its quads
MAX_SEAM_MISMATCH = (
    0.06  # largest difference between both sides of a seam, as a share of their length, unless it was larger before
)
FLAT_SHAPES = "Flat shapes"  # shown with the progress


def refine_flat_shapes(
    problem: InverseProblem,
    start: DesignPoint,
    design: SpiralDesign,
    params: OptimiseParams,
    trace: SearchRecord,
    accepted: Accepted,
    progress: Progress = SILENT,
    first: FlatPatches | None = None,
) -> FlatPoint:
    """Return the best spirals and flat shapes near a design; ``to_design`` turns the result into a design.

    Parameters
    ----------
    problem : of the spirals alone
    start : equilibrium of ``design`` in ``problem``
    design, params : with the flat shapes to begin with; the settings
    trace, accepted : as in ``gauss_newton``
    progress : reports progress and raises Cancelled
    first : the flat patches before earlier runs moved them, so that limits which they exceed do not creep

    Raises
    ------
    FlexMapsError : the elastic model is not the one of arms
    """
    if start.arms is None:
        raise FlexMapsError(
            "Flat shapes can be moved with the elastic model Arms only; choose it, or leave them as they are"
        )
    weight, first = BARRIER_WEIGHT * start.mismatch.value, first or design.flat
    limits, free = (params.distortion_limit, MAX_SEAM_MISMATCH), problem.space.free
    # a rim is made for the border's flat shape, so the border must not move
    flat = FlatRange.from_patches(design.flat, MAX_SHIFT, *limits, weight, first, free, border=design.rim is None)
    whole = FlatProblem.from_problem(problem, flat)
    here = whole.unmoved(start, progress.at(0.0, FLAT_SHAPES))
    found = gauss_newton(whole, here, params, trace, accepted, progress)
    assert isinstance(found, FlatPoint)
    return found


def interpolate(start: DesignPoint, found: FlatPoint, share: float, progress: Progress = SILENT) -> FlatPoint:
    """Return the point a share of the way from the start of ``refine_flat_shapes`` to its result ``found``."""
    here = found.problem.unmoved(start, progress)
    x = found.problem.within(here.x + share * (found.x - here.x), here)
    return found.problem.at(x, start.equilibrium.pose, progress, MAX_NEWTON_ITERATIONS)


def to_design(point: DesignPoint, design: SpiralDesign) -> SpiralDesign | None:
    """Return the design of a point; None where patches overlap themselves. ``design`` : the one that the search began with.

    The design can be cut, except where arms have come too near each other because the flat shapes have moved.
    """
    flat, (width, twist) = flat_shapes_of(point, design), point.spirals
    free = point.problem.space.free
    return None if flat is None else make_fabricable(flat, design.params, width, twist, prove=False, free=free)


def flat_shapes_of(point: DesignPoint, design: SpiralDesign) -> FlatPatches | None:
    """Return the flat shapes of a point, or the design's where the search does not move them.

    None where a patch overlaps itself, which no bound of the search prevents.
    """
    if not isinstance(point, FlatPoint):
        return design.flat
    layout = design.flat.layout
    points = point.problem.flat.points(point.flat_x)
    found = with_energies(layout, centre_patches(design.flat, points))
    return None if overlapping(found) else found


def centre_patches(flat: FlatPatches, points: np.ndarray) -> np.ndarray:
    """Return points (P, 2) moved so that the area centroid of every patch is at its origin."""
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
    """Return how the flat shapes have changed, for the ``optimise`` block of report.json; strains are shares of lengths."""
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
