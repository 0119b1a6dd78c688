"""Stages of one search: steps with the flat shapes and of the spirals alone in turn, and of the spirals alone at the end.

Every stage ends in a design that can be cut, and the best of these is the result: a search never ends worse than it began.
Every step is evaluated with the whole elastic model: without the second order of the strains, slender panels come to rest in
shapes that the real piece never takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..newton import CONVERGED, ITERATIONS, REACHED, TIME
from ..params import OptimiseParams
from ..patches.flattening.flatten import FlatPatches
from ..progress import Progress
from ..spirals.design import SpiralDesign
from . import codesign
from .codesign_problem import FlatPoint
from .inverse import DesignPoint
from .near_target import is_near, is_overstrained
from .optimisers import Accepted, SearchRecord, gauss_newton
from .other_weights import with_lies, with_problem
from .remedies import WANTED_PERCENT
from .task import Task
from .terms import LOOSE, STRICT
from .work import SLOW

Stage = Callable[["StageResult", Progress], "StageResult"]
# Largest weight of position against curvature in the first steps with the flat shapes of a piece that is about to snap far from its target.
# Positions hold such a piece between two shapes, curvature leads it out
BENDING_LIES = 0.1
# Largest number of steps with the flat shapes before a few of the spirals alone, which lead flat shapes away from their limits, whose barriers
# are then set anew. With fewer, large surfaces end farther from their target; with more, small saddles do (docs/tuning.md)
FLAT_STEPS = 9
# Such steps, of either kind, end after two in a row that each lower the objective by less than this share, divided by
# ``StageResult.rate_factor``. A larger share changes sooner from one kind to the other
CYCLE_STOP = 0.1
# largest number of such cycles, and the share of the objective that one must bring for the next
MAX_CYCLES, CYCLE_GAIN = 20, 0.05
# shares of a stage's change that are tried if with all of it a patch overlaps itself, or the piece ends too far from its target
BACKTRACK_SHARES = 0.5, 0.2
# steps of the spirals alone in a round, largest number of rounds at the end, and the share of the objective that a round must bring
POLISH_STEPS, MAX_POLISHES, POLISH_GAIN = 4, 12, 0.01
TIME_WITH_FLATS = 0.85  # share of the time limit at which the cycles must end
# Share of the work before that steps of the spirals alone may add where arms are visibly overstrained, and the number of steps between
# two updates of the strains' multipliers. With one, a surface of 986 quads comes from 1.13 of its limit to 1.00 in two steps, with four in
# four. With a share of 0.25 the arms of a head of 472 quads stayed at 1.05 of their limit
OVERTIME, RELIEF_STEPS = 0.5, 1
# Share of the objective that a refused one of these steps must have been predicted to bring, else no shorter one is tried. With larger
# ones a search gives up sooner
RELIEF_STOP = 0.25
# Factor on the decreases of steps while springs hold a piece, or it is farther from its target than ``WANTED_PERCENT``, so that its search
# is given up later; the ratio of the two distances if that is larger. Without it, five of ten surfaces ended at 1.05 to 1.4 % though the
# same search, going on, brought them within 1 % (docs/tuning.md)
UNMET_FACTOR = 8.0
# The same for nearer pieces while arms are visibly overstrained. With 1, one of five runs of a pointed spindle ended at 1.08 of the limit and
# 0.61 % of the size, the others at 0.91 and 0.17 to 0.20 %; with 8, a surface of 986 quads ends at 0.10 in place of 0.11 %, after 1.3 times
# the seconds
STRAINED_FACTOR = 2.0
# A match in curvature is useless if the whole piece drifts away. RMS distances from the target that are always allowed: in distances of
# neighbours, and as a multiple of the given design's
ALWAYS_ALLOWED_DISTANCE, FARTHER = 0.2, 1.1


@dataclass(frozen=True, eq=False)
class StageResult:
    """Result of a stage.

    design, point : the design and its point; farthest : largest allowed RMS distance from the target, in distances of neighbours
    """

    design: SpiralDesign
    point: DesignPoint
    farthest: float

    @property
    def sound(self) -> bool:
        """Whether it is in equilibrium within the allowed distance from the target."""
        return self.point.equilibrium.converged and self.point.distance <= self.farthest

    @property
    def value(self) -> float:
        """Objective, for comparing designs of one stage, where strains have equal weight; infinite if not sound."""
        return self.point.value if self.sound else np.inf

    def pressed(self) -> StageResult:
        """Return this result with updated multipliers of the strain limits."""
        return replace(self, point=self.point.pressed())

    def strict(self) -> StageResult:
        """Return this result with a weight of excess strain by which one arm counts as much as in ``merit(STRICT)``."""
        problem, strains = self.point.problem, self.point.strains
        if problem.bearing is None or strains is None:
            return self
        bearing = problem.bearing.weighed(STRICT * self.point.mismatch.value * strains.values.size)
        return replace(self, point=with_problem(self.point, replace(problem, bearing=bearing)))

    def firmed(self) -> StageResult:
        """Return this result at the start of a stage that keeps away from snapping."""
        return replace(self, point=self.point.firmed())

    def compared(self, lies: float) -> StageResult:
        """Return this result at the start of stages that weigh curvature against position by ``lies``, see ``objective.Target``."""
        point = with_lies(self.point, lies)
        return self if point is self.point else replace(self, point=point.weighed(point.mismatch.value))

    @property
    def percent(self) -> float:
        """RMS distance from the target, in percent of its size."""
        return 100.0 * self.point.metres_away / self.design.flat.layout.mesh.diagonal

    @property
    def strained(self) -> bool:
        """Whether the largest strain exceeds the limit so far that users get a message."""
        return is_overstrained(self.point)

    @property
    def rate_factor(self) -> float:
        """Factor on the decreases of further steps, see ``Work.factor``, and divisor of ``CYCLE_STOP``.

        A piece that springs hold counts as far, because it rests farther away once they are gone.
        """
        far = self.percent / WANTED_PERCENT
        if far > 1.0 or self.point.problem.loads.springs is not None:
            return max(UNMET_FACTOR, far)
        return STRAINED_FACTOR if self.strained else 1.0

    def merit(self, strictness: float) -> float:
        """Return ``DesignPoint.merit``, for comparing results of stages; infinite if not sound."""
        return self.point.merit(strictness) if self.sound else np.inf


@dataclass(eq=False)
class Search:
    """A search through all of its stages.

    accepted : called with every better point; farthest : largest allowed RMS distance from the target, in distances of neighbours
    first : the flat patches before earlier runs moved them; held : results of all stages, in their order
    snapping : whether the piece was about to snap far from its target at the start
    """

    task: Task
    trace: SearchRecord
    accepted: Accepted
    farthest: float
    first: FlatPatches
    held: list[StageResult] = field(default_factory=list)
    snapping: bool = False

    @property
    def best(self) -> StageResult:
        """Stage result with the best merit."""
        return min(self.held, key=lambda one: one.merit(STRICT))

    def run(self, starts: list[DesignPoint], design: SpiralDesign, progress: Progress) -> None:
        """Run all stages from the first start, with every body of the piece as in the start where it matches best.

        starts : points in the design's flat shapes, the best first
        """
        params, work = self.task.params, self.task.work
        tried = [self.hold(design, start) for start in starts]
        here = self._with_best_bodies(tried, tried[0], progress.at(0.0, "Starting shapes"))
        work.begin(TIME_WITH_FLATS)
        codesigned = params.codesign and here.point.arms is not None
        if codesigned:
            here = self.cycled(here, progress.part(0.0, 0.8))
        else:
            found = self.improved(here, params, progress.part(0.0, 0.8))
            here = found if found.value < here.value else here
        slow = work.slow
        # with the flat shapes, steps of either kind end after a few, whatever the settings say
        limited = self.trace.ended == ITERATIONS and not (codesigned and params.iterations > FLAT_STEPS)
        if not codesigned:
            work.begin(1.0)
            here = self._repeat(self.polished, here, MAX_POLISHES, POLISH_GAIN, progress.part(0.8, 0.95))
        late = work.late  # read before ``relieve``, which extends the limit
        self.relieve(here, progress.part(0.95, 1.0))
        if is_near(self.best.firmed().point, params):
            self.trace.ended = REACHED
        elif slow or work.slow:
            self.trace.ended = SLOW
        elif late or work.late:
            self.trace.ended = TIME
        else:
            self.trace.ended = ITERATIONS if limited else CONVERGED

    def _with_best_bodies(self, tried: list[StageResult], best: StageResult, progress: Progress) -> StageResult:
        """Return a result with every body of the piece as in the result where it matches best; ``best`` if that is no better."""
        target = best.point.mismatch.target
        nearest = np.argmin([one.point.mismatch.by_body for one in tried], axis=0)[target.body_of]
        if (nearest == nearest[0]).all():
            return best
        (width, twist), pose = best.point.spirals, best.point.equilibrium.pose
        for k, one in enumerate(tried):
            hubs = np.flatnonzero(nearest == k)
            width[hubs], twist[hubs] = (spirals[hubs] for spirals in one.point.spirals)
            pose = pose.with_part(hubs, one.point.equilibrium.pose.part(hubs))
        space = best.point.problem.space.including(replace(best.design, width=width, twist=twist))
        problem = replace(best.point.problem, space=space)
        found = self.hold(best.design, problem.at(space.coordinates(width, twist), pose, progress))
        return found if found.merit(LOOSE) < best.merit(LOOSE) else best

    def cycled(self, here: StageResult, progress: Progress) -> StageResult:
        """Repeat ``together`` while it pays, after ``_bend`` if the piece is about to snap far from its target; return the best result."""
        if here.percent > WANTED_PERCENT and here.firmed().point.barrier is not None:
            here = self._bend(here, progress)
        return self._repeat(self.together, here, MAX_CYCLES, CYCLE_GAIN, progress)

    def _bend(self, here: StageResult, progress: Progress) -> StageResult:
        """Take ``together`` once with a mismatch that is mostly of curvature, for a piece that is about to snap far from its target."""
        self.snapping, lies, work = True, self.task.params.lies, self.task.work
        found = self._repeat(self.together, here.compared(min(lies, BENDING_LIES)), 1, CYCLE_GAIN, progress)
        work.begin(work.share, rated=work.rated)  # the rates of another objective say nothing about the next steps
        return found.compared(lies)

    def relieve(self, here: StageResult, progress: Progress) -> None:
        """Append results with less strain to ``held`` where arms are visibly overstrained."""
        if here.strained:
            self.task.work.extend(OVERTIME * self.task.work.done)
            self._repeat(self.relieved, here.strict(), MAX_POLISHES, 1.0, progress)

    def hold(self, design: SpiralDesign, point: DesignPoint) -> StageResult:
        """Append a point in this design's flat shapes to ``held``, and return it."""
        width, twist = point.spirals
        found = StageResult(replace(design, width=width, twist=twist), point, self.farthest)
        self.held.append(replace(found, point=with_lies(point, self.task.params.lies)))
        return found

    def _repeat(self, step: Stage, here: StageResult, most: int, gain: float, progress: Progress) -> StageResult:
        """Repeat a stage, at most ``most`` times, while it lowers the objective by the share ``gain``; return the best result.

        It goes on too while arms are visibly overstrained, as long as the objective decreases at all.
        """
        for k in range(most):
            if self.task.work.over:
                break
            self.task.work.factor = here.rate_factor
            start = here.pressed().firmed()
            if is_near(start.point, self.task.params):
                break
            found = step(start, progress.part(k / most, (k + 1) / most))
            if not found.value < start.value:
                break
            here = found
            if not here.strained and here.value >= (1.0 - gain) * start.value:
                break
        return here

    def polished(
        self, here: StageResult, progress: Progress, steps: int = POLISH_STEPS, stop: float = 0.0
    ) -> StageResult:
        """Take a few more steps of the spirals alone; ``stop`` : smallest share of the objective that these must bring."""
        return self.improved(here, self._limited(steps, stop), progress)

    def _limited(self, steps: int, stop: float) -> OptimiseParams:
        """Return the settings of at most so many steps, of which two in a row must each bring at least the share ``stop``."""
        params = self.task.params
        return replace(params, iterations=min(steps, params.iterations), stop=params.stop and max(params.stop, stop))

    def relieved(self, here: StageResult, progress: Progress) -> StageResult:
        """Take ``RELIEF_STEPS`` steps of the spirals alone, before which the multipliers of strains are updated."""
        return self.polished(here, progress, RELIEF_STEPS, RELIEF_STOP)

    def improved(self, here: StageResult, params: OptimiseParams, progress: Progress) -> StageResult:
        """Optimise the spirals alone."""
        start = bearable = here.point

        def accepted(point: DesignPoint) -> None:
            nonlocal bearable
            self.accepted(point)
            if point.merit(STRICT) < bearable.merit(STRICT):
                bearable = point

        found = gauss_newton(start.problem, start, params, self.trace, accepted, progress)
        if bearable not in (start, found):  # the time may end before strains that the last steps raised are low again
            self.hold(here.design, bearable)
        return self.hold(here.design, found)

    def together(self, here: StageResult, progress: Progress) -> StageResult:
        """Optimise flat shapes and spirals together, then the spirals alone."""
        found = self.moved(here, progress.part(0.0, 0.8))
        found = found if found.value < here.value else here
        if self.task.work.over:
            return found
        return self.polished(found, progress.part(0.8, 1.0), stop=CYCLE_STOP / found.rate_factor)

    def moved(self, here: StageResult, progress: Progress) -> StageResult:
        """Optimise flat shapes and spirals together; take less of the change if the result is not a better design."""
        start, rough = here.point, self._limited(FLAT_STEPS, CYCLE_STOP / here.rate_factor)
        part, steps = progress.part(0.0, 0.9), len(self.trace.rows)
        found = codesign.refine_flat_shapes(
            start.problem, start, here.design, rough, self.trace, self.accepted, part, self.first
        )
        if not self.trace.rows[steps:]:
            return here  # the time ended before the first step, or no step was accepted
        within = progress.at(0.9, codesign.FLAT_SHAPES)
        other = self._as_design(here, found, within)
        for share in BACKTRACK_SHARES:
            if other is not None and other.value < here.value:
                break
            less = codesign.interpolate(start, found, share, within)
            other = self._as_design(here, less, within) if less.equilibrium.converged else None
        return other or here

    def _as_design(self, here: StageResult, found: FlatPoint, progress: Progress) -> StageResult | None:
        """Turn a point with moved flat shapes into a design, and append it to ``held``; None if a patch overlaps itself."""
        design = codesign.to_design(found, here.design)
        if design is None:
            return None
        point = self.task.point(design, found.problem, found.equilibrium.pose, progress, known=found)
        return self.hold(design, point)
