"""Stages of a search: steps that change flat shapes and spirals alternate with steps that change the spirals only.

Every stage ends in a design that can be cut, and the best of these is the result, so a search never ends worse than it
began. Every step is evaluated with second-order strains: without them slender panels come to rest in shapes that the
real piece never takes.
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
from .gauss_newton import Accepted, SearchRecord, run_gauss_newton
from .inverse import DesignPoint
from .near_target import is_near, is_overstrained
from .point_copy import with_position_share, with_problem
from .remedies import WANTED_PERCENT
from .task import Task
from .terms import FULL_STRAIN_PENALTY, NO_STRAIN_PENALTY
from .work import SLOW

Stage = Callable[["StageResult", Progress], "StageResult"]
# Largest weight of position against curvature (``objective.Target.position_share``) in the first cycle, for a piece
# that is about to snap far from its target. Matching positions would hold such a piece between two shapes; matching
# curvature leads it out. Larger: more pieces stay between two shapes
BENDING_POSITION_SHARE = 0.1
# Largest number of consecutive steps that change flat shapes and spirals. Then follow steps that change only spirals,
# after which the barriers at the limits of flat shapes are set anew. Fewer: large surfaces end farther from the target;
# more: small saddles end farther from it (docs/tuning.md)
FLAT_STEPS = 9
# Steps of one kind (with flat shapes, or spirals only) end after two consecutive steps that each lower the objective by
# less than this share, divided by ``StageResult.rate_factor``. A larger share switches sooner to the other kind
CYCLE_STOP = 0.1
# A cycle is a series of steps with flat shapes, then of steps that change only spirals. MAX_CYCLES: largest number of
# cycles. CYCLE_GAIN: share by which a cycle must lower the objective for another to follow; larger ends sooner, farther
# from the target
MAX_CYCLES, CYCLE_GAIN = 20, 0.05
# Shares of the change of flat shapes and spirals to try if the whole change makes a patch overlap itself, or leaves the
# piece too far from its target
BACKTRACK_SHARES = 0.5, 0.2
# Rounds of steps that change only spirals: steps in a round, largest number of rounds, and share by which a round must
# lower the objective for another to follow. A larger share ends sooner, farther from the target
POLISH_STEPS, MAX_POLISHES, POLISH_GAIN = 4, 12, 0.01
TIME_WITH_FLATS = 0.85  # share of the time limit at which the cycles must end
# If arms are overstrained at the end, further steps change only spirals. RELIEF_TIME_SHARE: their largest time as a
# share of the time so far; larger: slower, fewer overstrained arms. RELIEF_STEPS: steps between two updates of the
# multipliers of the strain limits; more: slower (docs/tuning.md)
RELIEF_TIME_SHARE, RELIEF_STEPS = 0.5, 1
# Share by which a step against overstrain must be predicted to lower the objective to be tried again, shorter, when it
# was refused. Larger: gives up sooner (docs/tuning.md)
RELIEF_STOP = 0.25
# Smallest factor on the decreases of steps when the search decides whether to go on, for a piece that springs hold or
# that is farther from its target than ``WANTED_PERCENT``. Larger: longer searches, more pieces within that distance
# (docs/tuning.md)
UNMET_FACTOR = 8.0
# Factor on the decreases of steps, as above, for overstrained pieces within ``WANTED_PERCENT`` of their target. Larger:
# longer searches, less strain (docs/tuning.md)
STRAINED_FACTOR = 2.0
# RMS distances from the target that a result may always have, in distances of neighbouring hubs, and as a multiple of
# the given design's distance: a match in curvature is useless if the piece drifts away. Larger: less often refused
ALWAYS_ALLOWED_DISTANCE, MAX_DISTANCE_GROWTH = 0.2, 1.1


@dataclass(frozen=True, eq=False)
class StageResult:
    """Result of a stage.

    design : the spirals on their flat patches; point : the design's equilibrium and objective
    max_distance : largest allowed RMS distance from the target, in distances of neighbouring hubs
    """

    design: SpiralDesign
    point: DesignPoint
    max_distance: float

    @property
    def is_sound(self) -> bool:
        """Whether the design has an equilibrium within the allowed distance from the target."""
        return self.point.equilibrium.converged and self.point.relative_distance <= self.max_distance

    @property
    def value(self) -> float:
        """Objective, for comparing designs of one stage, where strains have equal weights; inf if not ``is_sound``."""
        return self.point.value if self.is_sound else np.inf

    def with_updated_multipliers(self) -> StageResult:
        """Return this result with updated multipliers of the strain limits."""
        return replace(self, point=self.point.with_updated_multipliers())

    def with_full_strain_weight(self) -> StageResult:
        """Return this result with a weight of excess strain at which one arm counts as in ``FULL_STRAIN_PENALTY``."""
        problem, strains = self.point.problem, self.point.strains
        if problem.strain_limit is None or strains is None:
            return self
        strain_limit = problem.strain_limit.with_weight_at_least(
            FULL_STRAIN_PENALTY * self.point.mismatch.value * strains.values.size
        )
        return replace(self, point=with_problem(self.point, replace(problem, strain_limit=strain_limit)))

    def with_stability_weight(self) -> StageResult:
        """Return this result with the stability barrier weighted for a stage that starts here."""
        return replace(self, point=self.point.with_stability_weight())

    def with_position_share(self, position_share: float) -> StageResult:
        """Return this result with another weight of position against curvature, see ``objective.Target``."""
        point = with_position_share(self.point, position_share)
        return self if point is self.point else replace(self, point=point.with_strain_weight(point.mismatch.value))

    @property
    def distance_percent(self) -> float:
        """RMS distance from the target, in percent of its size."""
        return 100.0 * self.point.distance_metres / self.design.flat.layout.mesh.diagonal

    @property
    def is_overstrained(self) -> bool:
        """Whether the largest strain exceeds the limit by so much that the user is warned."""
        return is_overstrained(self.point)

    @property
    def rate_factor(self) -> float:
        """Factor on the decreases of further steps, see ``Work.rate_factor``, and divisor of ``CYCLE_STOP``.

        A piece held by springs counts as far from its target, because it moves away when they are removed.
        """
        far = self.distance_percent / WANTED_PERCENT
        if far > 1.0 or self.point.problem.loads.springs is not None:
            return max(UNMET_FACTOR, far)
        return STRAINED_FACTOR if self.is_overstrained else 1.0

    def merit(self, strain_penalty: float) -> float:
        """Return ``DesignPoint.merit``, for comparing results of different stages; inf if not ``is_sound``."""
        return self.point.merit(strain_penalty) if self.is_sound else np.inf


@dataclass(eq=False)
class Search:
    """A search with all its stages; in all methods ``here`` is the stage result from which a stage starts.

    task : inputs other than the design; trace : record of all steps; accepted : called with every better point
    max_distance : largest allowed RMS distance from the target, in distances of neighbouring hubs
    first_flat : the flat patches before earlier runs moved them; results : of all stages, in order
    is_snapping : whether the piece was about to snap far from its target at the start
    """

    task: Task
    trace: SearchRecord
    accepted: Accepted
    max_distance: float
    first_flat: FlatPatches
    results: list[StageResult] = field(default_factory=list)
    is_snapping: bool = False

    @property
    def best(self) -> StageResult:
        """Stage result with the smallest ``merit(FULL_STRAIN_PENALTY)``."""
        return min(self.results, key=lambda one: one.merit(FULL_STRAIN_PENALTY))

    def run(self, starts: list[DesignPoint], design: SpiralDesign, progress: Progress) -> None:
        """Run all stages from the first of ``starts``; take every separate body from the start where it matches best.

        Parameters
        ----------
        starts : points in the design's flat patches, the best first
        design : the design to begin with, whose flat patches ``starts`` have
        progress : reports progress and raises Cancelled
        """
        params, work = self.task.params, self.task.work
        tried = [self.add_result(design, start) for start in starts]
        here = self._with_best_bodies(tried, tried[0], progress.at(0.0, "Finding starting shapes"))
        work.begin_stage(TIME_WITH_FLATS)
        codesigned = params.codesign and here.point.arm_model is not None
        if codesigned:
            here = self.run_cycles(here, progress.part(0.0, 0.8))
        else:
            found = self.optimise_spirals(here, params, progress.part(0.0, 0.8))
            here = found if found.value < here.value else here
        slow = work.is_slow
        # in cycles ``FLAT_STEPS`` and ``POLISH_STEPS`` limit the number of steps, whatever the settings allow
        limited = self.trace.ended == ITERATIONS and not (codesigned and params.iterations > FLAT_STEPS)
        if not codesigned:
            work.begin_stage(1.0)
            here = self._repeat(self.polish, here, MAX_POLISHES, POLISH_GAIN, progress.part(0.8, 0.95))
        late = work.is_late  # read before ``relieve_strains``, which extends the limit
        self.relieve_strains(here, progress.part(0.95, 1.0))
        if is_near(self.best.with_stability_weight().point, params):
            self.trace.ended = REACHED
        elif slow or work.is_slow:
            self.trace.ended = SLOW
        elif late or work.is_late:
            self.trace.ended = TIME
        else:
            self.trace.ended = ITERATIONS if limited else CONVERGED

    def _with_best_bodies(self, tried: list[StageResult], best: StageResult, progress: Progress) -> StageResult:
        """Return a result that takes every separate body from the result in ``tried`` where that body matches best.

        Return ``best`` if the combination is not better.
        """
        target = best.point.mismatch.target
        nearest = np.argmin([one.point.mismatch.value_by_body for one in tried], axis=0)[target.body_of_spiral]
        if (nearest == nearest[0]).all():
            return best
        (width, twist), pose = best.point.width_and_twist, best.point.equilibrium.pose
        for k, one in enumerate(tried):
            hubs = np.flatnonzero(nearest == k)
            width[hubs], twist[hubs] = (spirals[hubs] for spirals in one.point.width_and_twist)
            pose = pose.with_part(hubs, one.point.equilibrium.pose.part(hubs))
        space = best.point.problem.space.extended_to(replace(best.design, width=width, twist=twist))
        problem = replace(best.point.problem, space=space)
        found = self.add_result(best.design, problem.point_at(space.coordinates(width, twist), pose, progress))
        return found if found.merit(NO_STRAIN_PENALTY) < best.merit(NO_STRAIN_PENALTY) else best

    def run_cycles(self, here: StageResult, progress: Progress) -> StageResult:
        """Run cycles (``run_cycle``) while each lowers the objective by ``CYCLE_GAIN``; return the best result.

        If the piece is about to snap far from its target, ``_bend_cycle`` comes first.
        """
        if here.distance_percent > WANTED_PERCENT and here.with_stability_weight().point.stability_barrier is not None:
            here = self._bend_cycle(here, progress)
        return self._repeat(self.run_cycle, here, MAX_CYCLES, CYCLE_GAIN, progress)

    def _bend_cycle(self, here: StageResult, progress: Progress) -> StageResult:
        """Run one cycle that compares mostly curvature, for a piece that is about to snap far from its target."""
        self.is_snapping, lies, work = True, self.task.params.lies, self.task.work
        found = self._repeat(
            self.run_cycle, here.with_position_share(min(lies, BENDING_POSITION_SHARE)), 1, CYCLE_GAIN, progress
        )
        work.begin_stage(
            work.share, ends_at_rate=work.ends_at_rate
        )  # forget the decreases so far, which belong to another objective
        return found.with_position_share(lies)

    def relieve_strains(self, here: StageResult, progress: Progress) -> None:
        """Take further steps that reduce strains if arms are overstrained; append the results to ``results``."""
        if here.is_overstrained:
            self.task.work.begin_overtime(RELIEF_TIME_SHARE * self.task.work.seconds_done)
            self._repeat(self.relieve_step, here.with_full_strain_weight(), MAX_POLISHES, 1.0, progress)

    def add_result(self, design: SpiralDesign, point: DesignPoint) -> StageResult:
        """Append the result of a stage, a point in the design's flat shapes, to ``results``; return the result."""
        width, twist = point.width_and_twist
        found = StageResult(replace(design, width=width, twist=twist), point, self.max_distance)
        self.results.append(replace(found, point=with_position_share(point, self.task.params.lies)))
        return found

    def _repeat(self, step: Stage, here: StageResult, most: int, gain: float, progress: Progress) -> StageResult:
        """Repeat a stage from the result ``here``, at most ``most`` times, while it lowers the objective by ``gain``.

        ``gain`` is a share of the objective. While arms are overstrained, any decrease is enough. Return the last
        result that was better.
        """
        for k in range(most):
            if self.task.work.is_over:
                break
            self.task.work.rate_factor = here.rate_factor
            start = here.with_updated_multipliers().with_stability_weight()
            if is_near(start.point, self.task.params):
                break
            found = step(start, progress.part(k / most, (k + 1) / most))
            if not found.value < start.value:
                break
            here = found
            if not here.is_overstrained and here.value >= (1.0 - gain) * start.value:
                break
        return here

    def polish(
        self, here: StageResult, progress: Progress, steps: int = POLISH_STEPS, stop: float = 0.0
    ) -> StageResult:
        """Take at most ``steps`` further steps that change only the spirals; ``stop`` : see ``_limited_params``."""
        return self.optimise_spirals(here, self._limited_params(steps, stop), progress)

    def _limited_params(self, steps: int, stop: float) -> OptimiseParams:
        """Return the settings for at most ``steps`` steps, which end after two consecutive decreases below ``stop``.

        stop : decrease of the objective, as a share of it
        """
        params = self.task.params
        return replace(params, iterations=min(steps, params.iterations), stop=params.stop and max(params.stop, stop))

    def relieve_step(self, here: StageResult, progress: Progress) -> StageResult:
        """Take ``RELIEF_STEPS`` steps that change only spirals, to reduce strains beyond the limit.

        ``_repeat`` has updated the multipliers of the strain limits before this call.
        """
        return self.polish(here, progress, RELIEF_STEPS, RELIEF_STOP)

    def optimise_spirals(self, here: StageResult, params: OptimiseParams, progress: Progress) -> StageResult:
        """Optimise only the spirals, with fixed flat shapes; append the results to ``results``."""
        start = bearable = here.point

        def accepted(point: DesignPoint) -> None:
            nonlocal bearable
            self.accepted(point)
            if point.merit(FULL_STRAIN_PENALTY) < bearable.merit(FULL_STRAIN_PENALTY):
                bearable = point

        found = run_gauss_newton(start.problem, start, params, self.trace, accepted, progress)
        if bearable not in (start, found):  # the last steps may have raised strains, with no time left to reduce them
            self.add_result(here.design, bearable)
        return self.add_result(here.design, found)

    def run_cycle(self, here: StageResult, progress: Progress) -> StageResult:
        """Run one cycle: optimise flat shapes and spirals together, then only the spirals."""
        found = self.optimise_flat_shapes(here, progress.part(0.0, 0.8))
        found = found if found.value < here.value else here
        if self.task.work.is_over:
            return found
        return self.polish(found, progress.part(0.8, 1.0), stop=CYCLE_STOP / found.rate_factor)

    def optimise_flat_shapes(self, here: StageResult, progress: Progress) -> StageResult:
        """Optimise flat shapes and spirals together; take only a share of the change if the whole is not better."""
        start, rough = here.point, self._limited_params(FLAT_STEPS, CYCLE_STOP / here.rate_factor)
        part, steps = progress.part(0.0, 0.9), len(self.trace.rows)
        found = codesign.refine_flat_shapes(
            start.problem, start, here.design, rough, self.trace, self.accepted, part, self.first_flat
        )
        if not self.trace.rows[steps:]:
            return here  # the time ended before the first step, or no step was accepted
        within = progress.at(0.9, codesign.FLAT_SHAPES)
        other = self._add_as_design(here, found, within)
        for share in BACKTRACK_SHARES:
            if other is not None and other.value < here.value:
                break
            less = codesign.interpolate(start, found, share, within)
            other = self._add_as_design(here, less, within) if less.equilibrium.converged else None
        return other or here

    def _add_as_design(self, here: StageResult, found: FlatPoint, progress: Progress) -> StageResult | None:
        """Turn a point with moved flat shapes into a stage result; return None if a patch overlaps itself."""
        design = codesign.to_design(found, here.design)
        if design is None:
            return None
        point = self.task.evaluate(design, found.problem, found.equilibrium.pose, progress, known=found)
        return self.add_result(design, point)
