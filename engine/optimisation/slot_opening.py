"""Simulated results of a search, and the step after it: reduce twists where slots close in the bent shape."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bool, Float
from ..errors import Cancelled, FlexMapsError
from ..materials import OVERSTRAIN_SHARE
from ..mechanics.clearance.slots_in_space import SpaceSlots
from ..progress import Progress
from ..simulation.simulate import Simulation
from ..spirals.clearance.slots import min_slot_width
from ..spirals.curves.spiral import opposite_sides
from ..spirals.design import SpiralDesign
from ..spirals.fabricable import make_fabricable, resolve_contacts
from .gauss_newton import CANCELLED
from .inverse import DesignPoint
from .remedies import WANTED_PERCENT
from .search import Search, StageResult
from .terms import NO_STRAIN_PENALTY

# TWIST_FACTOR: factor on the twist of a spiral whose slots close in space; smaller: fewer equilibria, more slots stay
# closed. MAX_UNWINDINGS: largest number of such reductions. MAX_GROWTH: largest factor by which the mismatch, or a
# strain beyond the limit, may grow (docs/tuning.md)
TWIST_FACTOR, MAX_UNWINDINGS, MAX_GROWTH = 0.9, 16, 1.1
# RMS distance from the target, in percent of the size, up to which opening slots may raise the mismatch by any factor,
# because closed slots are seen and this distance is not. Larger: more slots open, farther from the target
# (docs/tuning.md)
UNSEEN_PERCENT = 0.1
# Largest growth of the mismatch where all slots open and the piece stays within ``WANTED_PERCENT``; less where some
# stay closed. The mismatch is a square: 2 lets the distance grow 1.4 times. Larger: more slots open, farther from the
# target (docs/tuning.md)
OPEN_GROWTH = 2.0
MAX_IDLE = 4  # largest number of reductions in a row that open no slot; more: more slots open, slower
# Largest number of short searches that relieve strains after reductions, and the share of the work so far that each may
# add. More: more slots open, slower (docs/tuning.md)
MAX_SHORT_SEARCHES, SHORT_SEARCH_SHARE = 4, 0.15
# Largest number of consecutive short searches that open no further slot; more: slower, rarely opens one
# (docs/tuning.md)
MAX_FRUITLESS = 2
# Steps of a short search, and rings of neighbours that it changes around the spirals with less twist. More: nearer to
# the target and slower (docs/tuning.md)
SHORT_SEARCH_STEPS, SHORT_SEARCH_RINGS = 2, 3
MIN_TWIST = 0.1  # radians; a spiral whose twist falls below this becomes straight


@dataclass(frozen=True, eq=False)
class SimulatedResult:
    """Simulated result of a search.

    point : point of the search that the design was made from
    max_distance : largest allowed RMS distance from the target, in distances of neighbouring hubs
    known_slots : slots, measured in this shape only where they may have closed, else in an earlier shape; None to
        measure all
    """

    simulation: Simulation
    point: DesignPoint
    max_distance: float
    known_slots: SpaceSlots | None = None

    @property
    def slots(self) -> SpaceSlots | None:
        """The slots in space; None without an equilibrium."""
        return self.simulation.slots() if self.known_slots is None else self.known_slots

    @property
    def closed(self) -> float:
        """Number of slots closed in space; infinite without an equilibrium."""
        return np.inf if self.slots is None else float(len(self.slots.closed))

    def merit(self, strain_penalty: float) -> float:
        """Return ``DesignPoint.merit`` of the simulated shape; inf beyond ``max_distance`` or without equilibrium."""
        target, pose = self.point.problem.target, self.simulation.equilibrium.pose
        if not self.simulation.equilibrium.converged or target.relative_distance(pose) > self.max_distance:
            return np.inf
        mismatch = target.compare(pose.centres)
        strains = self.simulation.strain
        largest = None if strains is None else float(strains.max()) * self.simulation.material.strain_limit
        return self.point.merit(strain_penalty, mismatch, largest)

    def can_replace(self, other: SimulatedResult) -> bool:
        """Return whether this result is acceptable in place of ``other``, the result before slots were opened.

        No spiral may be overstrained (see ``overstrained_spirals``), and the mismatch with its penalty on instability
        may grow by ``MAX_GROWTH``. Within ``WANTED_PERCENT`` of the target it may grow by up to ``OPEN_GROWTH``, in
        proportion to the share of closed slots that have opened; within ``UNSEEN_PERCENT`` growth of the mismatch does
        not count.
        """
        if self.merit(NO_STRAIN_PENALTY) == np.inf or self.overstrained_spirals(other).any():
            return False
        target, percent, growth = self.point.problem.target, self.simulation.target_distances["rms_percent"], MAX_GROWTH
        now, before = (target.compare(one.simulation.equilibrium.pose.centres).value for one in (self, other))
        if percent <= WANTED_PERCENT and self.closed < other.closed:
            growth += (OPEN_GROWTH - MAX_GROWTH) * (1.0 - self.closed / other.closed)
        now = min(now, before) if percent <= UNSEEN_PERCENT else now
        return self._with_stability(now) <= growth * other._with_stability(before)

    def _with_stability(self, mismatch: float) -> float:
        """Return a mismatch plus the penalty on instability at ``point``."""
        barrier = self.point.stability_barrier
        return mismatch if barrier is None else barrier.merit(mismatch)

    def overstrained_spirals(self, other: SimulatedResult) -> Bool[np.ndarray, " spirals"]:
        """Return a mask of the overstrained spirals of this result.

        A spiral is overstrained beyond the limit, or, if ``other`` exceeds the limit already, beyond ``MAX_GROWTH``
        times the largest strain of ``other``.
        """
        before, strain = other.simulation.strain, self.simulation.strain
        if before is None or strain is None:
            return np.zeros(len(self.simulation.design.twist), bool)
        worst = float(before.max())
        return strain > (OVERSTRAIN_SHARE if worst <= OVERSTRAIN_SHARE else MAX_GROWTH * worst)


def open_closed_slots(search: Search, found: SimulatedResult, progress: Progress) -> SimulatedResult:
    """Reduce twists until no slot closes in the bent shape; return ``found`` if none opens or the match suffers.

    If spirals with less twist, or their neighbours, would be overstrained, a few more steps of the search follow, with
    the reduced twists as upper limits. ``found`` is also returned after a cancel, and if the settings allow slots to
    close.

    Parameters
    ----------
    search : the search that has ended
    found : its best result, whose flat outlines are proved to be free of contacts
    progress : reports progress and raises Cancelled
    """
    if not search.task.params.open_slots:
        return found
    try:
        best = _open_slots(search, found, progress)
    except Cancelled:
        search.trace.ended = CANCELLED
        return found
    except FlexMapsError:
        return found
    if best is found:
        return found
    best = replace(best, known_slots=None, point=_with_fixed_spirals_of(best.point, found.point))
    return best if best.can_replace(found) and best.closed < found.closed else found


def separate_arms(design: SpiralDesign, free: Bool[np.ndarray, " spirals"], progress: Progress) -> SpiralDesign:
    """Return a design whose arms do not touch in the flat sheet either, after twists were reduced.

    Parameters
    ----------
    design : with reduced twists; returned as it is if no arms touch
    free : mask of the spirals that may change
    progress : reports progress and raises Cancelled
    """
    made = make_fabricable(design.flat, design.params, design.width, design.twist, check_outlines=False, free=free)
    if made.changed_spirals(design).any():
        design = replace(design, width=made.width, twist=made.twist).reuse_cache_of(design)
    return resolve_contacts(design, progress, free=free)


def _open_slots(search: Search, found: SimulatedResult, progress: Progress) -> SimulatedResult:
    """Return the result with the fewest closed slots that ``can_replace`` accepts in place of ``found``.

    Reductions of twists alternate with short searches that relieve strains.
    """
    best, free = found, found.point.problem.space.free_spirals
    here = again = _reduce_twists(search, found, found, progress, bearable=True)
    fruitless = 0
    for searches in range(MAX_SHORT_SEARCHES + 1):
        before = best
        if again.closed < best.closed:
            design = separate_arms(again.simulation.design, free, progress)
            if design is not again.simulation.design:
                here = again = _with_design(search, again, design, progress)
            if again.closed < best.closed and again.can_replace(found):
                best = again
        fruitless = fruitless + 1 if searches and best is before else 0
        if not best.closed or searches == MAX_SHORT_SEARCHES or fruitless == MAX_FRUITLESS:
            break
        relieved = _relieve_strains(search, here, found, progress)
        if relieved is None:
            break
        here, again = relieved, _reduce_twists(search, relieved, found, progress, bearable=True)
    return best


def _reduce_twists(
    search: Search, found: SimulatedResult, before: SimulatedResult, progress: Progress, *, bearable: bool
) -> SimulatedResult:
    """Reduce the twists of ``found`` step by step; return the result with the fewest closed slots, at worst ``found``.

    before : result before slots were opened; the spirals fixed in its problem do not change
    bearable : whether overstrained spirals and their neighbours keep their twists, and ``SimulatedResult.can_replace``
        must accept the result
    """
    if bearable and not found.closed:
        found = replace(found, known_slots=None)  # measure all slots, as others may have closed too
    free, here, given = before.point.problem.space.free_spirals.copy(), found, found.simulation.design.twist
    best, idle = found, 0
    for _ in range(MAX_UNWINDINGS):
        design, slots = here.simulation.design, here.slots
        if bearable:
            pairs = search.task.target.dual
            free[pairs[here.overstrained_spirals(before)[pairs].any(axis=1)]] = False
        twist = design.twist if slots is None else np.where(free, reduce_twist(design, slots, free), given)
        if (twist == design.twist).all():
            break
        here = _with_design(search, here, replace(design, twist=twist).reuse_cache_of(design), progress)
        fewer = here.closed < best.closed and (
            here.can_replace(before) if bearable else here.merit(NO_STRAIN_PENALTY) < np.inf
        )
        if fewer and bearable and not here.closed:
            here = replace(here, known_slots=None)
            fewer = here.closed < best.closed
        if fewer:
            best, idle = here, 0
        elif (idle := idle + 1) > MAX_IDLE:
            break
    return best


def _relieve_strains(
    search: Search, found: SimulatedResult, before: SimulatedResult, progress: Progress
) -> SimulatedResult | None:
    """Reduce twists where slots are closed, then take a few steps of the search with these twists as upper limits.

    The estimated widths of slots within spirals are corrected to the exact ones. Slots between spirals have no
    estimate, so the twists of spirals beside such a closed slot cannot grow. Return None if no slot opens, no step
    lowers the objective, strains beyond the limit do not decrease, or the design cannot be cut.

    before : result before slots were opened; the spirals fixed in its problem do not change
    """
    loose = _reduce_twists(search, found, before, progress, bearable=False)
    closed, slots = found.slots, loose.slots
    if closed is None or slots is None or (loose is found and len(closed.closed)):
        return None
    design, given, work = loose.simulation.design, found.point.problem, search.task.work
    beside = closed.arms[closed.closed] // 4
    space = replace(given.space, fixed_spirals=before.point.problem.space.fixed_spirals).extended_to(design)
    limited = design.twist < found.simulation.design.twist
    limited[beside[beside[:, 0] != beside[:, 1]]] = True
    space = space.with_twist_limits(design, limited)
    near = design.changed_spirals(found.simulation.design) | loose.overstrained_spirals(before)
    mates = opposite_sides(search.task.target)[0]
    for _ in range(SHORT_SEARCH_RINGS):
        near |= near[mates].any(axis=1)
    space = space.with_fixed_spirals(design, np.flatnonzero(~near))
    x, pose = space.coordinates(design.width, design.twist), loose.simulation.equilibrium.pose
    point = replace(given, space=space).point_at(x, pose, progress)
    if not point.equilibrium.converged:
        return None
    work.begin_overtime(SHORT_SEARCH_SHARE * work.seconds_done)
    start = (
        StageResult(design, _with_measured_slots(point, slots), found.max_distance)
        .with_full_strain_weight()
        .with_updated_multipliers()
    )
    ended = search.trace.ended
    held = search.polish(start, progress, SHORT_SEARCH_STEPS)
    search.trace.ended = ended
    if held.point is start.point:
        return None
    try:
        design = resolve_contacts(held.design.reuse_cache_of(design), progress, free=space.free_spirals)
    except FlexMapsError:
        return None
    relieved = _with_design(search, replace(loose, point=held.point), design, progress)
    strains = [one.simulation.strain for one in (loose, relieved)]
    worst = [0.0 if strain is None else float(strain.max()) for strain in strains]
    return None if loose.overstrained_spirals(before).any() and worst[0] <= worst[1] else relieved


def _with_fixed_spirals_of(point: DesignPoint, other: DesignPoint) -> DesignPoint:
    """Return the point in a problem that fixes the same spirals as the problem of ``other``."""
    space = replace(point.problem.space, fixed_spirals=other.problem.space.fixed_spirals)
    return replace(point, problem=replace(point.problem, space=space))


def _with_measured_slots(point: DesignPoint, slots: SpaceSlots) -> DesignPoint:
    """Return the point in a problem whose estimated slot widths are corrected to the exact ``slots`` of this state."""
    opening, model = point.problem.slot_requirement, point.arm_model
    if opening is None or model is None:
        return point
    measured = opening.with_measured_slots(model, point.equilibrium.pose, slots)
    return replace(point, problem=replace(point.problem, slot_requirement=measured))


def reduce_twist(
    design: SpiralDesign, slots: SpaceSlots, free: Bool[np.ndarray, " spirals"]
) -> Float[np.ndarray, " spirals"]:
    """Reduce the twists of free spirals with closed slots by one step; return the design's own array if there are none.

    Parameters
    ----------
    design : the present spirals
    slots : in the bent shape
    free : mask of the spirals that may change
    """
    culprits = np.zeros(len(free), dtype=bool)
    culprits[np.unique(slots.arms[slots.closed] // 4)] = True
    culprits &= free & (design.twist > 0.0)
    less = np.where(TWIST_FACTOR * design.twist < MIN_TWIST, 0.0, TWIST_FACTOR * design.twist)
    return np.where(culprits, less, design.twist) if culprits.any() else design.twist


def _with_design(search: Search, found: SimulatedResult, design: SpiralDesign, progress: Progress) -> SimulatedResult:
    """Return ``found`` with another design, simulated from its pose; measure only slots that may have closed."""
    simulation, slots = search.task.simulate(design, found.simulation.equilibrium.pose, progress), found.slots
    if slots is None:
        return replace(found, simulation=simulation, known_slots=None)
    doubtful = (slots.narrowest_per_quad < min_slot_width(design.params)) | design.changed_arms(found.simulation.design)
    return replace(found, simulation=simulation, known_slots=simulation.slots_near(doubtful, slots))
