"""Co-design: optimise spirals and the flat rest shape of their patches together, an extension of FlexMaps section 7.

Panels whose flat shape differs slightly from the flattened surface pull each other into shape. So small changes of the
flat quads lower the mismatch even where all spirals are at their bounds. Topology, seams and limits of the layout do
not change.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import FlexMapsError
from ..params import OptimiseParams
from ..patches.flattening.flatten import FlatPatches, overlapping_patches, seam_mismatch, with_energies
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign
from ..spirals.fabricable import make_fabricable
from .codesign_problem import BARRIER_WEIGHT, FlatPoint, FlatProblem, FlatRange
from .gauss_newton import MAX_NEWTON_ITERATIONS, Accepted, SearchRecord, run_gauss_newton
from .inverse import DesignPoint, InverseProblem

MAX_SHIFT = 0.5  # largest shift of a flat vertex along x or y, over the least mean edge length of the quads at it
# Largest difference in length between both sides of a cut edge, as a share of its length; where the first flat patches
# have a larger difference, that is the limit. Larger: better match, seams that fit worse
MAX_SEAM_MISMATCH = 0.06
FLAT_SHAPES = "Flat shapes"  # text of the progress


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
    """Optimise the spirals and flat shapes of a design; ``to_design`` turns the result into a design.

    Parameters
    ----------
    problem : the inverse problem with only the spirals as unknowns
    start : point of ``design`` in ``problem``, at equilibrium
    design, params : the design to begin with, and the settings
    trace, accepted : as in ``run_gauss_newton``
    progress : reports progress and raises Cancelled
    first : the flat patches before earlier runs moved them; limits that these exceed are relaxed to their values, not
        to the values of ``design``, which would drift from run to run

    Raises
    ------
    FlexMapsError : the elastic model is not the arm model
    """
    if start.arm_model is None:
        raise FlexMapsError(
            "Flat shapes can be moved with the elastic model Arms only; choose it, or leave them as they are"
        )
    weight, first = BARRIER_WEIGHT * start.mismatch.value, first or design.flat
    limits, free = (params.distortion_limit, MAX_SEAM_MISMATCH), problem.space.free_spirals
    # a rim is made for the border's flat shape, so the border must not move
    flat = FlatRange.from_patches(design.flat, MAX_SHIFT, *limits, weight, first, free, border=design.rim is None)
    whole = FlatProblem.from_problem(problem, flat)
    here = whole.convert_point(start, progress.at(0.0, FLAT_SHAPES))
    found = run_gauss_newton(whole, here, params, trace, accepted, progress)
    assert isinstance(found, FlatPoint)
    return found


def interpolate(start: DesignPoint, found: FlatPoint, share: float, progress: Progress = SILENT) -> FlatPoint:
    """Return a point between the start of ``refine_flat_shapes`` and its result ``found``, at its own equilibrium.

    Parameters
    ----------
    start : argument of ``refine_flat_shapes``
    found : its result
    share : 0 at the start, 1 at the result
    progress : reports progress and raises Cancelled
    """
    here = found.problem.convert_point(start, progress)
    x = found.problem.restore_clearances(here.x + share * (found.x - here.x), here.x)
    return found.problem.point_at(x, start.equilibrium.pose, progress, MAX_NEWTON_ITERATIONS)


def to_design(point: DesignPoint, design: SpiralDesign) -> SpiralDesign | None:
    """Convert a point of a search to a design that can be cut; return None if a patch overlaps itself.

    Widths and twists change where arms have come too close to each other in the moved flat shapes.

    Parameters
    ----------
    point : the result of the search
    design : the design that the search began with
    """
    flat, (width, twist) = flat_shapes_of(point, design), point.width_and_twist
    free = point.problem.space.free_spirals
    return None if flat is None else make_fabricable(flat, design.params, width, twist, check_outlines=False, free=free)


def flat_shapes_of(point: DesignPoint, design: SpiralDesign) -> FlatPatches | None:
    """Return the flat shapes of a point: the flat shapes of ``design`` if the search does not move them.

    Return None if a patch overlaps itself, which no bound of the search prevents.
    """
    if not isinstance(point, FlatPoint):
        return design.flat
    layout = design.flat.layout
    points = point.problem.flat.points(point.flat_x)
    found = with_energies(layout, centre_patches(design.flat, points))
    return None if overlapping_patches(found) else found


def centre_patches(flat: FlatPatches, points: np.ndarray) -> np.ndarray:
    """Return the points (P, 2), shifted patch by patch so that the area centroid of every patch is at the origin."""
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
    """Describe how flat shapes have changed from ``before`` to ``after``, for the ``optimise`` block of report.json.

    Strains are relative changes of the lengths of quad edges.
    """
    sides = [np.linalg.norm(np.roll(f.corners, -1, axis=1) - f.corners, axis=2) for f in (before, after)]
    grown = np.abs(sides[1] / sides[0] - 1.0)
    report: dict[str, Any] = {"flat_strain_median": float(np.median(grown)), "flat_strain_max": float(grown.max())}
    for name, flat in (("flat_before", before), ("flat", after)):
        seams = seam_mismatch(flat)
        report[name] = {
            "energy_max": float(flat.energy.max()),
            "energy_median": float(np.median(flat.energy)),
            "square_median": float(np.median(flat.irregularity)),
            "seam_mismatch_median": float(np.median(seams)) if len(seams) else 0.0,
            "seam_mismatch_max": float(seams.max(initial=0.0)),
        }
    return report
