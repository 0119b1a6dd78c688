"""Simulated results of a search, and the last change to them: less twist where slots close in space."""

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
from .inverse import DesignPoint
from .optimisers import CANCELLED
from .remedies import WANTED_PERCENT
from .search import Search, StageResult
from .terms import LOOSE

# Factor on the twist of a spiral whose slots close in space, largest number of such reductions, and factor by which the mismatch, or a
# strain beyond the limit, may grow. With a factor of 0.8, eight reductions and two idle ones, five surfaces end as far from their targets or
# farther, and more slots stay closed (docs/tuning.md). Reductions before the last steps of the search left strained arms that these had no time to relieve
TWIST_FACTOR, MAX_UNWINDINGS, MAX_GROWTH = 0.9, 16, 1.1
# RMS distance from the target, in percent of the size, within which the mismatch may grow by any factor: nobody sees it, and slots that
# close can be seen. A sphere of 520 quads kept three closed slots at 0.041 %, and one at 0.011 %; all open at 0.045 and 0.012 %
UNSEEN_PERCENT = 0.1
# Factor by which the mismatch of a piece within the wanted distance may grow if no slot stays closed, and less where some do: a piece whose arms touch is worth less
# than one that lies a little farther. The mismatch is a square, so 2 lets the distance grow 1.4 times. A cross of 480 quads kept 16 closed
# slots at 0.49 %; all open at 0.54 to 0.56 %
OPEN_GROWTH = 2.0
MAX_IDLE = 4  # reductions in a row that may open no slot
# Largest number of further searches, and the share of the work before that each may add. In five runs of Suzanne's search that differ by rounding, 4
# to 10 slots closed, and 0 to 5 stayed closed with less twist alone. With further searches all open in four runs, and one stays closed in
# the fifth, at up to 1.08 times the RMSE
MAX_SEARCHES, SEARCH_SHARE = 4, 0.15
# Largest number of such searches in a row that may leave as many slots closed. A bunny of 2,362 quads kept two after four of them, which took
# half of its 117 s, and a folded mug 36 after three
MAX_FRUITLESS = 2
# Steps of such a search, and rings of neighbours around the spirals with less twist that it changes too. On a surface of 986 quads 2 steps of
# 38 spirals take 2.9 s and raise the RMSE by 2.3 %, 4 steps 5.2 s and 2.0 %, 4 steps of all spirals 8 s and -0.4 to 0.1 %
EASED_STEPS, EASED_RINGS = 2, 3
MIN_TWIST = 0.1  # radians, twist below which a spiral becomes straight


@dataclass(frozen=True, eq=False)
class SimulatedResult:
    """Simulated result of a search.

    point : of the search from which the design was made; farthest : largest allowed RMS distance from the target, as in ``Search``
    nearby : slots, of which only those that may have closed were measured in this shape; None to measure all
    """

    simulation: Simulation
    point: DesignPoint
    farthest: float
    nearby: SpaceSlots | None = None

    @property
    def slots(self) -> SpaceSlots | None:
        """The slots in space; None without an equilibrium."""
        return self.simulation.slots() if self.nearby is None else self.nearby

    @property
    def closed(self) -> float:
        """Number of slots closed in space; infinite without an equilibrium."""
        return np.inf if self.slots is None else float(len(self.slots.closed))

    def merit(self, strictness: float) -> float:
        """Return ``DesignPoint.merit`` of the simulated shape; infinite without an equilibrium, or too far from the target."""
        target, pose = self.point.problem.target, self.simulation.equilibrium.pose
        if not self.simulation.equilibrium.converged or target.distance(pose) > self.farthest:
            return np.inf
        mismatch = target.compare(pose.centres)
        strains = self.simulation.strain
        largest = None if strains is None else float(strains.max()) * self.simulation.material.strain_limit
        return self.point.merit(strictness, mismatch, largest)

    def bears(self, other: SimulatedResult) -> bool:
        """Return whether strains, the mismatch and the lack of stability are hardly larger than in ``other``, before slots were opened.

        All may grow by ``MAX_GROWTH``; the mismatch of a piece within ``UNSEEN_PERCENT`` of its target by any factor, and that of a piece
        within ``WANTED_PERCENT`` by up to ``OPEN_GROWTH``, the more the larger the share of the closed slots that are open now.
        """
        if self.merit(LOOSE) == np.inf or self.strained_by(other).any():
            return False
        target, percent, growth = self.point.problem.target, self.simulation.match["rms_percent"], MAX_GROWTH
        now, before = (target.compare(one.simulation.equilibrium.pose.centres).value for one in (self, other))
        if percent <= WANTED_PERCENT and self.closed < other.closed:
            growth += (OPEN_GROWTH - MAX_GROWTH) * (1.0 - self.closed / other.closed)
        now = min(now, before) if percent <= UNSEEN_PERCENT else now
        return self._with_stability(now) <= growth * other._with_stability(before)

    def _with_stability(self, mismatch: float) -> float:
        """Return a mismatch with the penalty on the lack of stability of the search's point."""
        barrier = self.point.barrier
        return mismatch if barrier is None else barrier.merit(mismatch)

    def strained_by(self, other: SimulatedResult) -> Bool[np.ndarray, " spirals"]:
        """Return a mask of overstrained spirals: beyond the limit, or ``MAX_GROWTH`` times the other result's worst if that is beyond it."""
        before, strain = other.simulation.strain, self.simulation.strain
        if before is None or strain is None:
            return np.zeros(len(self.simulation.design.twist), bool)
        worst = float(before.max())
        return strain > (OVERSTRAIN_SHARE if worst <= OVERSTRAIN_SHARE else MAX_GROWTH * worst)


def open_closed_slots(search: Search, found: SimulatedResult, progress: Progress) -> SimulatedResult:
    """Reduce twists of a proved result until no slot closes in space; return ``found`` if that opens none or costs too much.

    Where spirals with less twist, or their neighbours, would be overstrained, a few further steps of the search take these twists as upper
    limits. ``found`` is also returned after a cancel, and if the settings allow slots to close.
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
    best = replace(best, nearby=None, point=_with_kept(best.point, found.point))
    return best if best.bears(found) and best.closed < found.closed else found


def with_room(design: SpiralDesign, free: Bool[np.ndarray, " spirals"], progress: Progress) -> SpiralDesign:
    """Return a design in which arms beside spirals with less twist have room in the flat sheet too; the same object if they have."""
    made = make_fabricable(design.flat, design.params, design.width, design.twist, prove=False, free=free)
    if made.unlike(design).any():
        design = replace(design, width=made.width, twist=made.twist).reusing(design)
    return resolve_contacts(design, progress, free=free)


def _open_slots(search: Search, found: SimulatedResult, progress: Progress) -> SimulatedResult:
    """Return the result with the fewest closed slots, by less twist and by further searches, that ``SimulatedResult.bears`` accepts."""
    best, free = found, found.point.problem.space.free
    here = again = _unwind(search, found, found, progress, bearable=True)
    fruitless = 0
    for searches in range(MAX_SEARCHES + 1):
        before = best
        if again.closed < best.closed:
            design = with_room(again.simulation.design, free, progress)
            if design is not again.simulation.design:
                here = again = _with_design(search, again, design, progress)
            if again.closed < best.closed and again.bears(found):
                best = again
        fruitless = fruitless + 1 if searches and best is before else 0
        if not best.closed or searches == MAX_SEARCHES or fruitless == MAX_FRUITLESS:
            break
        eased = _ease_strains(search, here, found, progress)
        if eased is None:
            break
        here, again = eased, _unwind(search, eased, found, progress, bearable=True)
    return best


def _unwind(
    search: Search, found: SimulatedResult, before: SimulatedResult, progress: Progress, *, bearable: bool
) -> SimulatedResult:
    """Reduce twists step by step; return the result with the fewest closed slots, ``found`` if none has fewer.

    before : result of the search; spirals that are kept in its problem do not change
    bearable : overstrained spirals and their neighbours keep their twists, and ``SimulatedResult.bears`` must accept the result
    """
    if bearable and not found.closed:
        found = replace(found, nearby=None)  # slots farther away may have closed
    free, here, given = before.point.problem.space.free.copy(), found, found.simulation.design.twist
    best, idle = found, 0
    for _ in range(MAX_UNWINDINGS):
        design, slots = here.simulation.design, here.slots
        if bearable:
            pairs = search.task.target.dual
            free[pairs[here.strained_by(before)[pairs].any(axis=1)]] = False
        twist = design.twist if slots is None else np.where(free, reduce_twist(design, slots, free), given)
        if (twist == design.twist).all():
            break
        here = _with_design(search, here, replace(design, twist=twist).reusing(design), progress)
        fewer = here.closed < best.closed and (here.bears(before) if bearable else here.merit(LOOSE) < np.inf)
        if fewer and bearable and not here.closed:
            here = replace(here, nearby=None)
            fewer = here.closed < best.closed
        if fewer:
            best, idle = here, 0
        elif (idle := idle + 1) > MAX_IDLE:
            break
    return best


def _ease_strains(
    search: Search, found: SimulatedResult, before: SimulatedResult, progress: Progress
) -> SimulatedResult | None:
    """Open closed slots by less twist, then take a few steps of the search near there, with these twists as upper limits.

    Estimates of slots within spirals are corrected to the exact widths. Slots between spirals have no estimate: the twists
    of spirals beside such a closed slot cannot grow. Return None if no slot opens, no step improves, no strain beyond the
    limit decreases, or the design cannot be cut.

    before : result of the search, whose kept spirals do not change
    """
    loose = _unwind(search, found, before, progress, bearable=False)
    closed, slots = found.slots, loose.slots
    if closed is None or slots is None or (loose is found and len(closed.closed)):
        return None
    design, given, work = loose.simulation.design, found.point.problem, search.task.work
    beside = closed.arms[closed.closed] // 4
    space = replace(given.space, kept=before.point.problem.space.kept).including(design)
    limited = design.twist < found.simulation.design.twist
    limited[beside[beside[:, 0] != beside[:, 1]]] = True
    space = space.winding_at_most(design, limited)
    near = design.unlike(found.simulation.design) | loose.strained_by(before)
    mates = opposite_sides(search.task.target)[0]
    for _ in range(EASED_RINGS):
        near |= near[mates].any(axis=1)
    space = space.keeping(design, np.flatnonzero(~near))
    x, pose = space.coordinates(design.width, design.twist), loose.simulation.equilibrium.pose
    point = replace(given, space=space).at(x, pose, progress)
    if not point.equilibrium.converged:
        return None
    work.extend(SEARCH_SHARE * work.done)
    start = StageResult(design, _with_measured_slots(point, slots), found.farthest).strict().pressed()
    ended = search.trace.ended
    held = search.polished(start, progress, EASED_STEPS)
    search.trace.ended = ended
    if held.point is start.point:
        return None
    try:
        design = resolve_contacts(held.design.reusing(design), progress, free=space.free)
    except FlexMapsError:
        return None
    eased = _with_design(search, replace(loose, point=held.point), design, progress)
    strains = [one.simulation.strain for one in (loose, eased)]
    worst = [0.0 if strain is None else float(strain.max()) for strain in strains]
    return None if loose.strained_by(before).any() and worst[0] <= worst[1] else eased


def _with_kept(point: DesignPoint, other: DesignPoint) -> DesignPoint:
    """Return the point in a problem in which the spirals kept are those kept in the problem of ``other``."""
    space = replace(point.problem.space, kept=other.problem.space.kept)
    return replace(point, problem=replace(point.problem, space=space))


def _with_measured_slots(point: DesignPoint, slots: SpaceSlots) -> DesignPoint:
    """Return the point in a problem whose estimates of slots agree with the exact ``slots`` of this state."""
    opening, model = point.problem.opening, point.arms
    if opening is None or model is None:
        return point
    measured = opening.with_excess(model, point.equilibrium.pose, slots)
    return replace(point, problem=replace(point.problem, opening=measured))


def reduce_twist(
    design: SpiralDesign, slots: SpaceSlots, free: Bool[np.ndarray, " spirals"]
) -> Float[np.ndarray, " spirals"]:
    """Return the design's twists, reduced by one step at free spirals with closed slots; the same array if there are none."""
    culprits = np.zeros(len(free), dtype=bool)
    culprits[np.unique(slots.arms[slots.closed] // 4)] = True
    culprits &= free & (design.twist > 0.0)
    less = np.where(TWIST_FACTOR * design.twist < MIN_TWIST, 0.0, TWIST_FACTOR * design.twist)
    return np.where(culprits, less, design.twist) if culprits.any() else design.twist


def _with_design(search: Search, found: SimulatedResult, design: SpiralDesign, progress: Progress) -> SimulatedResult:
    """Return a result with another design, simulated from the present pose; slots that may have closed are measured."""
    simulation, slots = search.task.simulated(design, found.simulation.equilibrium.pose, progress), found.slots
    if slots is None:
        return replace(found, simulation=simulation, nearby=None)
    doubtful = (slots.of_quads < min_slot_width(design.params)) | design.changed_arms(found.simulation.design)
    return replace(found, simulation=simulation, nearby=simulation.slots_near(doubtful, slots))
