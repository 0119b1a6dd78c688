"""Make designs that can be cut: of equal spirals, from curvature, or near given spirals (FlexMaps section 7)."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..progress import SILENT, Progress
from ..surface.checking.finding import with_count
from .clearance import slots
from .clearance.clearance_model import ClearanceModel
from .clearance.gap_opening import open_gaps
from .constraints import NO_CONSTRAINTS, Constraints
from .contacts import nearest_quads
from .curves.spiral import opposite_sides, same_width
from .design import SpiralDesign
from .quad_enlarging import enlarge_quads
from .solid_hubs import mark_solid_hubs, mark_too_small, refuse_many_solid_hubs, suggest_quad_count, with_solid_hubs

NO_ROOM = "There is no room for the arms of {} however thin and straight; make the mesh more regular there"


def uniform_design(
    flat: FlatPatches, params: SpiralParams, *, width: float | None = None, twist: float | None = None
) -> SpiralDesign:
    """Make a design of equal spirals; where a quad lacks room, arms become thinner and twists smaller.

    Parameters
    ----------
    flat, params : flat patches, and settings of the spirals
    width : metres; default is the middle of the allowed range
    twist : radians; default is half of the largest allowed twist

    Raises
    ------
    FlexMapsError : with the faces that are far too small for the smallest width
    """
    width = 0.5 * (params.width_min + params.width_max) if width is None else width
    twist = 0.5 * params.twist_max if twist is None else twist
    count = len(flat.corners)
    return make_fabricable(flat, params, np.full((count, 4), float(width)), np.full(count, float(twist)))


def design_from_curvature(
    flat: FlatPatches,
    params: SpiralParams,
    curvature: Float[np.ndarray, " quads"],
    progress: Progress = SILENT,
) -> SpiralDesign:
    """Make the curvature-adjusted start design (FlexMaps section 7): more curvature gives thinner arms and more twist.

    Parameters
    ----------
    flat, params : flat patches, and settings of the spirals
    curvature : (F,) RMS curvature of the target, 1/m
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : with the faces that are far too small for the smallest width
    """
    return design_from_spirals(flat, params, *curvature_adjusted(params, curvature), progress)


def design_from_spirals(
    flat: FlatPatches,
    params: SpiralParams,
    width: Float[np.ndarray, "quads 4"],
    twist: Float[np.ndarray, " quads"],
    progress: Progress = SILENT,
    *,
    constraints: Constraints = NO_CONSTRAINTS,
) -> SpiralDesign:
    """Make a start design near given widths (metres) and twists (radians) that can be cut and meets the constraints.

    If quads have no room for spirals, move the flat points near them; the design then has its own flat patches.

    Parameters
    ----------
    flat, params : flat patches, and settings of the spirals
    width, twist : (F, 4) metres, (F,) radians
    progress : called with the fraction done; may cancel
    constraints : quads whose spirals are to be straight, or as wide as possible

    Raises
    ------
    FlexMapsError : with the faces that are far too small for the smallest width
    """
    width, twist, straight = width.copy(), twist.copy(), constraints.straight
    twist[straight] = 0.0
    mesh = flat.layout.mesh
    width[straight] = np.where(mesh.border[mesh.quad_edges[straight]], params.width_max, width[straight])
    width[constraints.wide] = params.width_max
    result: SpiralDesign | FlexMapsError
    try:
        result = make_fabricable(flat, params, width, twist, progress=progress.part(0.0, 0.5))
    except FlexMapsError as error:
        result = error
    tight = np.array(result.faces) if isinstance(result, FlexMapsError) else np.flatnonzero(result.has_solid_hub)
    if len(tight):
        moved = enlarge_quads(flat, tight, progress.part(0.5, 0.6))
        with suppress(FlexMapsError):  # the error about the original patches is more helpful
            retry = make_fabricable(moved, params, width, twist, progress=progress.part(0.6, 1.0))
            result = retry if retry.has_solid_hub.sum() < len(tight) else result
    if isinstance(result, SpiralDesign):
        return result
    raise result


def curvature_adjusted(
    params: SpiralParams, curvature: Float[np.ndarray, " quads"]
) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
    """Return widths (metres) and twists (radians) for an RMS curvature C (1/m), without checks whether they can be cut.

    Widths and twists are linear in c = C / C_max. C_max is the percentile ``params.curvature_top`` of the curvature.
    The publication takes the maximum (100), but a single sharp crease would then leave c near 0 on the rest of the
    surface.

    Parameters
    ----------
    params : ranges of widths and twists
    curvature : (F,) 1/m
    """
    curvature = np.asarray(curvature, dtype=float)
    top = float(np.percentile(curvature, params.curvature_top))
    c = np.clip(curvature / top, 0.0, 1.0) if top > 0.0 else np.zeros_like(curvature)
    width = params.width_max - c * (params.width_max - params.width_min)
    return same_width(width), params.twist_min + c * (params.twist_max - params.twist_min)


def make_fabricable(
    flat: FlatPatches,
    params: SpiralParams,
    width: Float[np.ndarray, "quads 4"],
    twist: Float[np.ndarray, " quads"],
    *,
    check_outlines: bool = True,
    free: Bool[np.ndarray, " quads"] | None = None,
    progress: Progress = SILENT,
) -> SpiralDesign:
    """Make a design near given widths and twists that can be cut: all gaps, also between spirals, are wide enough.

    Parameters
    ----------
    flat, params : flat patches, and settings of the spirals
    width, twist : (F, 4) metres, (F,) radians
    check_outlines : draw the finished outlines and repair the few places where they still touch
    free : mask of the spirals that may change; default is all
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : with the faces that are far too small for the smallest width
    """
    free = np.ones(len(twist), dtype=bool) if free is None else free
    low, high = slots.width_range(flat, params)
    small = mark_too_small(flat, params)
    refuse_many_solid_hubs(
        np.flatnonzero(small & free), len(twist), slots.too_small_message(flat, params, np.flatnonzero(small))
    )
    if check_outlines:  # a quad that had a solid hub may have room for a spiral in these flat patches
        width = np.where((free & ~small & mark_solid_hubs(width, params))[:, None], low[:, None], width)
    most = np.where(free, high, np.inf)
    progress(0.0, "making room between the arms")
    width, room = np.minimum(width, most[:, None]), ClearanceModel.from_flat(flat, params)
    progress(0.0, "making room between the arms")
    twist = np.where(free, np.minimum(twist, params.twist_max), twist)
    width, twist = with_solid_hubs(params, width, twist, (small | mark_solid_hubs(width, params)) & free)
    shut = room.quads_with_closed_gaps(width, twist) & free
    if shut.any():  # reduce far too large twists at once, so that ``open_gaps`` needs fewer rounds
        twist = np.where(shut, slots.twist_bound(flat, params, width, progress.part(0.0, 0.2), twist), twist)
    spirals = open_gaps(room, low, width, twist, free & ~mark_solid_hubs(width, params), progress.part(0.2, 0.6))
    design = SpiralDesign(flat, params, *spirals)
    return resolve_contacts(design, progress.part(0.6, 1.0), free=free) if check_outlines else design


def unfabricable_quads(design: SpiralDesign, quads: Bool[np.ndarray, " quads"] | None = None) -> Int[np.ndarray, " n"]:
    """Return the quads whose spiral cannot be cut: not finite, too thin, too wide, too much twist, or a closed gap.

    Parameters
    ----------
    design : spirals that a user or an older version may have made
    quads : mask of quads; check only gaps beside them; default is all
    """
    low, high = slots.width_range(design.flat, design.params)
    finite = np.isfinite(design.width).all(axis=1) & np.isfinite(design.twist)
    width, twist = np.where(finite[:, None], design.width, low[:, None]), np.where(finite, design.twist, 0.0)
    slack = 1e-3  # tolerance, for rounding and for limits found by iteration
    least, most = (1.0 - slack) * np.minimum(low, slots.MIN_WIDTH_SHARE * design.params.width_min), (1.0 + slack) * high
    fits = (width.min(axis=1) >= least) & (width.max(axis=1) <= most)
    fits &= (twist >= -slack) & (twist <= (1.0 + slack) * design.params.twist_max)
    # ignore the slot at seams and the range of the stiffness table: a piece that violates them can be cut, and glued
    room = ClearanceModel.from_flat(design.flat, replace(design.params, slot_seam=0.0)).without_twist_limits
    spirals = np.clip(width, 0.1 * low[:, None], high[:, None]), np.clip(twist, 0.0, None)
    terms = room.clearances(*spirals, below=-slack, quads=quads)
    fits[terms.arms[:, [0, 2]] // 4] = False
    fits |= mark_solid_hubs(width, design.params) & (twist <= slack)
    return np.flatnonzero(~(finite & fits))


def resolve_contacts(
    design: SpiralDesign, progress: Progress = SILENT, rounds: int = 60, free: Bool[np.ndarray, " quads"] | None = None
) -> SpiralDesign:
    """Draw the outlines, and unwind the spirals around every place where outlines touch; most designs have none.

    Parameters
    ----------
    design : spirals without closed gaps, as returned by ``open_gaps``
    progress : called with the fraction done; may cancel
    rounds : largest number of times that outlines are drawn and spirals unwound
    free : mask of the spirals that may change; default is all

    Raises
    ------
    FlexMapsError : with the faces where even straight and thin arms touch
    """
    mate = opposite_sides(design.flat.layout.mesh)[0]
    thinnest = slots.MIN_WIDTH_SHARE * design.params.width_min
    free = np.ones(len(design.twist), dtype=bool) if free is None else free
    start, culprits = design, np.empty(0, dtype=np.int64)
    for turn in range(rounds):
        part = progress.part(turn / rounds, (turn + 1) / rounds)
        culprits, where = _quads_in_contact(design, part)
        if not len(culprits):
            return design
        # first unwind the spirals in contact and their neighbours, whose twists also determine the directions of
        # joints; then thin the arms
        beside = np.union1d(culprits, mate[culprits])
        still = (design.twist == 0.0) | ~free
        straight = culprits[
            still[culprits] & still[mate[culprits]].all(axis=1) & (free & ~design.has_solid_hub)[culprits]
        ]
        beside = beside[free[beside]]
        twist, width = design.twist.copy(), design.width.copy()
        twist[beside] = np.where(twist[beside] < 0.3, 0.0, 0.75 * twist[beside])
        width[straight] = np.maximum(0.85 * width[straight], thinnest)
        if (twist == design.twist).all() and (width == design.width).all():
            # nothing can be unwound any further: give the quad nearest to each contact a solid hub
            worst = culprits if where is None else nearest_quads(design.flat, where, 1)
            given_up = np.zeros(len(twist), dtype=bool)
            given_up[worst] = True
            given_up &= free & ~design.has_solid_hub
            if not given_up.any():
                break
            culprits = np.flatnonzero(given_up | design.has_solid_hub)
            refuse_many_solid_hubs(culprits, len(twist), NO_ROOM.format(with_count(len(culprits), "quad", "quads")))
            # restore the spirals that were unwound for these quads
            begun = with_solid_hubs(design.params, start.width, start.twist, given_up | design.has_solid_hub)
            restored = make_fabricable(
                design.flat, design.params, *begun, check_outlines=False, free=free, progress=part
            )
            width, twist = restored.width, restored.twist
        design = replace(design, twist=twist, width=width).reuse_cache_of(design)
    raise FlexMapsError(
        NO_ROOM.format(with_count(len(culprits), "quad", "quads")),
        faces=culprits,
        quads=suggest_quad_count(len(design.twist)),
    )


def _quads_in_contact(design: SpiralDesign, progress: Progress) -> tuple[Int[np.ndarray, " n"], np.ndarray | None]:
    """Return the quads to change and the places where outlines touch, as from ``find_contacts``.

    If slots have no root, return their quads and None, because outlines cannot be drawn.
    """
    progress(0.0, "rounding the roots of the slots")
    culprits = np.flatnonzero(design.roots.is_missing.any(axis=1))
    if len(culprits):
        return culprits, None
    where = design.cache.update_contacts(design.outlines(progress=progress.part(0.0, 0.8)), progress.part(0.8, 1.0))
    return (nearest_quads(design.flat, where) if len(where) else culprits), where
