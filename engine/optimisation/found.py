"""What a search has found, simulated, and the last change to it: spirals wound less where their slots close in space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bool, Float
from ..errors import Cancelled, FlexMapsError
from ..materials import STRAINED
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.slots_in_space import SpaceSlots
from ..progress import Progress
from ..simulation.simulate import Simulation
from ..spirals.design import SpiralDesign, proved
from .inverse import Point
from .optimisers import STOPPED
from .search import Held, Search
from .terms import LOOSE

# Share of its twist that a spiral keeps whose slots close in space, how often at the most, and by how many times the mismatch, and a strain
# beyond the limit, may grow for it. On two surfaces 27 and 30 closed slots were open after two or three times; the RMSE grew by .3 and .1 %.
# Unwinding before the last steps of the search left arms that these had no time to ease
UNWOUND, UNWINDINGS, OPENED = 0.8, 8, 1.1
IDLE = 2  # times that this may open no more
# Searches after that, and the share of the whole search's time for each. In five runs of Suzanne's search that differ by rounding 4 to 10 slots closed, and 0 to
# 5 of them stayed so by less twist alone; with these all open in four and one stays in the fifth, at up to 1.08 times the RMSE. A search takes
# .1 to .15 of the time before it
EASINGS, EASING = 4, 0.15
STRAIGHT = 0.1  # radians of twist, less of which is none


@dataclass(frozen=True, eq=False)
class Found:
    """A simulated design, the point of the search that it was, and its largest RMS distance as in ``Search``."""

    simulation: Simulation
    point: Point
    farthest: float

    def merit(self, strictness: float) -> float:
        """Return ``Point.merit`` of the simulated shape; infinite without an equilibrium, or too far from the target."""
        target, pose = self.point.problem.target, self.simulation.equilibrium.pose
        if not self.simulation.equilibrium.converged or target.distance(pose) > self.farthest:
            return np.inf
        mismatch = target.compare(pose.centres)
        strains = self.simulation.strain
        largest = None if strains is None else float(strains.max()) * self.simulation.material.strain_limit
        return self.point.merit(strictness, mismatch, largest)

    def bears(self, other: Found) -> bool:
        """Whether open slots are worth what they cost: it lies hardly farther from the target, and arms are hardly strained more."""
        if self.merit(LOOSE) == np.inf:
            return False
        target = self.point.problem.target
        values = [target.compare(one.simulation.equilibrium.pose.centres).value for one in (self, other)]
        return bool(values[0] <= OPENED * values[1] and not self.strained_by(other).any())

    def strained_by(self, other: Found) -> Bool[np.ndarray, " spirals"]:
        """Return which spirals are strained too much: beyond what the material bears, or a tenth beyond the other result's worst if that is more already."""
        before, strain = other.simulation.strain, self.simulation.strain
        if before is None or strain is None:
            return np.zeros(len(self.simulation.design.twist), bool)
        worst = float(before.max())
        return strain > (STRAINED if worst <= STRAINED else OPENED * worst)


def opened(search: Search, found: Found, progress: Progress) -> Found:
    """Return a proved result with spirals unwound until no slot closes in space; the same where that costs too much or opens none.

    Where slots may close, as the settings say, nothing is done. Where less wound spirals would be strained too much, or their neighbours, the
    search goes on for a few steps with these twists as upper limits. Where the user cancels, the result stays as it is.
    """
    if not search.task.params.open_slots:
        return found
    try:
        best = _open_slots(search, found, progress)
        if best is found:
            return found
        design = proved(best.simulation.design, progress, free=found.point.problem.space.free)
        best = best if design is best.simulation.design else _redesigned(search, best, design, progress)
    except Cancelled:
        search.trace.ended = STOPPED
        return found
    except FlexMapsError:
        return found
    return best if best.bears(found) and _closed(best) < _closed(found) else found


def _open_slots(search: Search, found: Found, progress: Progress) -> Found:
    """Return the result with the fewest closed slots that ``found`` allows, by less twist and by more steps of the search."""
    best = here = _unwind(search, found, found, progress, bearable=True)
    for _ in range(EASINGS):
        eased = _ease_strains(search, here, found, progress) if _closed(best) else None
        if eased is None:
            break
        here = eased
        again = _unwind(search, eased, found, progress, bearable=True)
        if _closed(again) < _closed(best) and again.bears(found):
            best = again
    return best


def _unwind(search: Search, found: Found, before: Found, progress: Progress, *, bearable: bool) -> Found:
    """Return the result with the fewest closed slots among those whose spirals are unwound step by step; the same where none has fewer.

    before : the result of the search, which says what spirals are free
    bearable : spirals whose arms are then strained too much, and those beside them, keep their twists, and only results count that ``before`` allows
    """
    free, here, given = before.point.problem.space.free.copy(), found, found.simulation.design.twist
    least, best, idle = _closed(found), found, 0
    for _ in range(UNWINDINGS):
        design, slots = here.simulation.design, here.simulation.slots(progress)
        if bearable:
            pairs = search.task.target.dual
            free[pairs[here.strained_by(before)[pairs].any(axis=1)]] = False
        twist = design.twist if slots is None else np.where(free, unwound(design, slots, free), given)
        if (twist == design.twist).all():
            break
        here = _redesigned(search, here, replace(design, twist=twist), progress)
        if _closed(here) < least and (here.bears(before) if bearable else here.merit(LOOSE) < np.inf):
            least, best, idle = _closed(here), here, 0
        elif (idle := idle + 1) > IDLE:
            break
    return best


def _ease_strains(search: Search, found: Found, before: Found, progress: Progress) -> Found | None:
    """Open the closed slots by less twist, then search a few steps on with these twists as upper limits.

    Estimates of slots within spirals are corrected to the measured widths. Slots between spirals have no estimate, so the spirals
    beside a closed one stay as they are. Return None where no slot opens, no step improves, or the design cannot be cut.

    before : the result of the search, which says what spirals are free
    """
    loose = _unwind(search, found, before, progress, bearable=False)
    closed, slots = found.simulation.slots(), loose.simulation.slots()
    if closed is None or slots is None or (loose is found and len(closed.closed)):
        return None
    design, given, work = loose.simulation.design, found.point.problem, search.task.work
    beside = closed.arms[closed.closed] // 4
    space = replace(given.space, kept=before.point.problem.space.kept).including(design)
    space = space.winding_at_most(design, design.twist < found.simulation.design.twist)
    space = space.keeping(design, np.unique(beside[beside[:, 0] != beside[:, 1]]))
    x, pose = space.coordinates(design.width, design.twist), loose.simulation.equilibrium.pose
    point = replace(given, space=space).at(x, pose, progress)
    if not point.equilibrium.converged:
        return None
    work.share = EASING + (work.done / work.limit if work.limit else 0.0)
    start = Held(design, _with_measured_slots(point, slots).pressed(), found.farthest)
    held = search.polished(start, progress)
    if held.point is start.point:
        return None
    try:
        design = proved(held.design, progress, free=space.free)
    except FlexMapsError:
        return None
    pose = held.point.equilibrium.pose
    return Found(search.task.simulated(design, pose, progress), held.point, found.farthest)


def _with_measured_slots(point: Point, slots: SpaceSlots) -> Point:
    """Return the point in a problem whose estimates of slots agree with what was measured there."""
    opening, model = point.problem.opening, point.model
    if opening is None or not isinstance(model, ArmModel):
        return point
    measured = opening.with_excess(model, point.equilibrium.pose, slots)
    return replace(point, problem=replace(point.problem, opening=measured))


def unwound(
    design: SpiralDesign, slots: SpaceSlots, free: Bool[np.ndarray, " spirals"]
) -> Float[np.ndarray, " spirals"]:
    """Return the design's twists, one step less where slots close in space and spirals are ``free``; its own where none can be less."""
    culprits = np.zeros(len(free), dtype=bool)
    culprits[np.unique(slots.arms[slots.closed] // 4)] = True
    culprits &= free & (design.twist > 0.0)
    less = np.where(UNWOUND * design.twist < STRAIGHT, 0.0, UNWOUND * design.twist)
    return np.where(culprits, less, design.twist) if culprits.any() else design.twist


def _redesigned(search: Search, found: Found, design: SpiralDesign, progress: Progress) -> Found:
    """Return what was found with another design, simulated from where it rests."""
    return replace(found, simulation=search.task.simulated(design, found.simulation.equilibrium.pose, progress))


def _closed(found: Found) -> float:
    """Return how many slots are closed in space; infinite without an equilibrium."""
    slots = found.simulation.slots()
    return np.inf if slots is None else float(len(slots.closed))
