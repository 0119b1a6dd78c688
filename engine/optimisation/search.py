"""The stages of one search: spirals alone, then by turns with the flat shapes and alone, and alone at the end.

Every step ends in a design that can be cut, weighed with the whole elastic model, and the best of those is the result:
a search never ends worse than it began, nor than the best it has held. Every step is weighed with the whole model too: without
the second order of the strains, slender panels come to rest in shapes which the real piece never takes. Derivatives take
that second order as given (see ``arm_sensitivity``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..materials import Material
from ..mechanics.arms.model import ArmModel
from ..mechanics.assembly import Assembly, Pose, of_design, target_pose
from ..mechanics.elastic import ElasticModel
from ..mechanics.loads import Loads
from ..mechanics.stance import Stance
from ..params import OptimiseParams, SimulateParams
from ..patches.flattening.flatten import FlatPatches
from ..progress import SILENT, Progress
from ..simulation.simulate import Simulation, build_model, simulate
from ..spirals.constraints import FREE, Constraints
from ..spirals.design import SpiralDesign
from ..spirals.room import Room
from ..surface.mesh import QuadMesh
from . import codesign
from .codesign_problem import FlatPoint
from .design_space import DesignSpace
from .inverse import Point, Problem
from .objective import Target
from .open_slots import Opening
from .optimisers import GOAL, INNER_ITERATIONS, Accepted, Trace, gauss_newton, lbfgs
from .remedies import WANTED
from .terms import LENIENT, STRICT, Bearing
from .wishes import Wishes
from .work import CURVING, SPACE, Work

Stage = Callable[["Held", Progress], "Held"]
GROUPS = {"alike": 1, "pairs": 2, "each": 4}  # of arms with one width, by the setting
METHODS: dict[str, Callable[..., Point]] = {"gauss_newton": gauss_newton, "lbfgs": lbfgs}
TOLERANCE = 1e-6  # of the equilibria on the way, where the settings ask for a finer one; not measured
ALIKE = 1e-6  # relative differences of lengths, and radians
# The share of the objective that steps of the spirals alone must bring, else the flat shapes move too. What spirals bring to an end first leaves
# surfaces farther away after the same work
FIRST_STOP = 0.45
# With the flat shapes, until the spirals have a few steps alone, which cost a third and make room again where the limits of the flat
# shapes are near. A surface of 1296 quads came to 1.0 mm that way, to 1.12 with three times eight steps first
FLAT_STEPS, FLAT_STOP = 6, 5e-3
CYCLES, CYCLE_GAIN = 20, 0.05  # how often at the most, and the share of the objective that another time must promise
# shares of the way that are tried where a patch has come to overlap itself, or the piece to lie too far away
BACK = 0.5, 0.2
POLISH_STEPS, POLISHES, GAIN = (
    4,
    12,
    0.01,
)  # of the spirals alone, between two pushes, and how often in the end, as above
UNSTABLE = 3  # steps refused as unstable, beyond which the barrier is stronger; not measured
ALONE, WITH_FLATS = 0.4, 0.85  # shares of the time by which these stages are over
# Largest strain, as a share of its limit, beyond which a search takes all of its time; not measured: monkeys of 472 quads begin at five times
STRAINED = 1.25
# Largest strain, as a share of its limit, beyond which the last stage may go on until strains hold, and the share of the time by which it is
# over then. Two searches of one piece of 472 spirals had ended at 1.00 and 1.02 of the limit: with these both hold
TIGHT, OVERTIME = 0.9898, 1.25
# A match of how the surface bends is no use where the whole drifts away: RMS distances that are always allowed, in distances
# of neighbours and against the given design's.
NEAR, FARTHER = 0.2, 1.1


@dataclass(frozen=True, eq=False)
class Task:
    """What a search is given besides the design; ``work`` counts for all of its problems."""

    target: QuadMesh
    material: Material
    params: OptimiseParams
    physics: SimulateParams
    supports: np.ndarray | None
    force: np.ndarray | None
    work: Work
    constraints: Constraints = FREE
    wishes: Wishes | None = None

    def problem(self, design: SpiralDesign, progress: Progress = SILENT, space: DesignSpace | None = None) -> Problem:
        """The problem in the whole model, of the spirals in this design's flat shapes; by default with a space of its own."""
        assembly, physics, params = of_design(design), self.physics, self.params
        mass = design.area * assembly.thickness * self.material.density if physics.gravity else None
        loads = Loads.of(assembly.size, supports=self.supports, clamped=physics.clamped, force=self.force, mass=mass)
        return Problem(
            assembly,
            space or self.space(design, progress),
            self.aim(assembly, not loads.fixed.any()),
            loads,
            self.model,
            replace(physics, tolerance=max(physics.tolerance, TOLERANCE)),
            params.smoothness,
            Bearing(self.material, params.strain_share) if params.strain_share > 0.0 else None,
            Opening.of(design) if params.open_slots else None,
            self.work,
            room=Room.of(design.flat, design.params),
            stance=Stance(loads, self.target, design.flat.corners),
        )

    def aim(self, assembly: Assembly, free: bool) -> Target:
        """What the spirals' centres are compared with."""
        wishes = self.wishes if self.params.urge > 0.0 else None
        return Target(assembly.pairs, self.target.centroids, self.params.lies, free, wishes, self.params.urge)

    def space(self, design: SpiralDesign, progress: Progress = SILENT) -> DesignSpace:
        """The coordinates of designs in the same patches."""
        self.work.add(SPACE, len(design.width))
        groups = GROUPS[self.params.arms]
        space = DesignSpace.of(design, of_design(design), groups, progress, self.constraints)
        return space.including(design)

    def model(self, assembly: Assembly, progress: Progress = SILENT) -> ElasticModel:
        """The whole elastic model."""
        self.work.add(CURVING, assembly.size)
        return build_model(assembly, self.material, self.physics.model, progress=progress)

    def simulated(self, design: SpiralDesign, start: Pose, progress: Progress) -> Simulation:
        """The whole model's equilibrium near to a pose."""
        rest: dict[str, Any] = {"supports": self.supports, "force": self.force}
        rest["progress"] = replace(progress, shown=None)  # what is shown is the search
        return simulate(design, self.target, self.material, replace(self.physics, restarts=0), start=start, **rest)

    def rested(self, design: SpiralDesign, point: Point) -> Simulation:
        """The state of a design that was made of a point: the point's own where nothing differs, else simulated from there.

        A search weighs its spirals once, at the start of a stage, so under gravity it is always simulated.
        """
        assembly, found, loads = of_design(design), point.equilibrium, point.problem.loads
        if self.physics.gravity or not _alike(assembly.whole, point.model.assembly):
            return self.simulated(design, found.pose, SILENT)
        found = found.placed(loads.laid(found.pose, assembly.pairs, target_pose(self.target, design.flat.corners)))
        return Simulation(design, self.target, self.material, point.model, assembly, loads, found, [])


def _alike(one: Assembly, two: Assembly) -> bool:
    """Whether two assemblies of the same joints differ by rounding only."""
    apart = [np.abs(one.lever - two.lever) / one.radius.mean(), one.width / two.width - 1.0, one.twist - two.twist]
    return all(float(np.abs(part).max()) < ALIKE for part in apart)


@dataclass(frozen=True, eq=False)
class Held:
    """A design that a stage has ended with, and its point; farthest : RMS distance that it may have from the target, in
    distances of neighbours
    """

    design: SpiralDesign
    point: Point
    farthest: float

    @property
    def sound(self) -> bool:
        """Whether it is in equilibrium, and the piece does not lie too far away."""
        return self.point.equilibrium.converged and self.point.distance <= self.farthest

    @property
    def value(self) -> float:
        """The objective, to compare designs on the way, whose strains weigh alike; infinite where they are not sound."""
        return self.point.value if self.sound else np.inf

    def pressed(self) -> Held:
        """The same where strains push back as they ask for by now."""
        return replace(self, point=self.point.pressed())

    def firmed(self, *, strong: bool) -> Held:
        """The same at the start of a stage; strong : that keeps farther away from where pieces snap."""
        return replace(self, point=self.point.firmed(strong=strong))

    @property
    def strained(self) -> bool:
        """Whether any arm is strained beyond its limit, which more steps may still mend."""
        return self._largest_strain > 1.0

    @property
    def needs_time(self) -> bool:
        """Whether a search takes all of its time: an arm is strained far beyond its limit, or the piece farther from its target than is wanted."""
        away = self.point.problem.target.unit * self.point.distance
        return self._largest_strain > STRAINED or away > 0.01 * WANTED * self.design.flat.layout.mesh.diagonal

    @property
    def tight(self) -> bool:
        """Whether the largest strain is so near its limit that the changes of a proof may carry it beyond."""
        return self._largest_strain > TIGHT

    @property
    def _largest_strain(self) -> float:
        """The largest strain of all arms as a share of its limit; 0 where strains do not count."""
        bearing, strains = self.point.problem.bearing, self.point.strains
        return 0.0 if bearing is None or strains is None else float(strains.values.max() / bearing.limit)

    def merit(self, strictness: float) -> float:
        """To compare results, as ``Point.merit``; infinite likewise."""
        return self.point.merit(strictness) if self.sound else np.inf


@dataclass(eq=False)
class Search:
    """One search.

    farthest : RMS distance that a result may have from the target, in distances of neighbours
    first : the flat patches before earlier runs moved them; held : the designs of all stages, the last one last
    """

    task: Task
    trace: Trace
    accepted: Accepted
    farthest: float
    first: FlatPatches
    held: list[Held] = field(default_factory=list)

    @property
    def best(self) -> Held:
        return min(self.held, key=lambda one: one.merit(STRICT))

    def run(self, starts: list[Point], design: SpiralDesign, progress: Progress) -> int:
        """Go through all stages from the start that is best after the first one; return its place in ``starts``.

        starts : in this design's flat shapes; each has an equal part of the first stage's time
        """
        params, work = self.task.params, self.task.work
        codesigned = params.codesign and isinstance(starts[0].model, ArmModel)
        first, end = (replace(params, stop=max(params.stop, FIRST_STOP)), 0.3) if codesigned else (params, 0.8)
        tried: list[Held] = []
        for k, start in enumerate(starts):
            work.share = work.enough * (ALONE if codesigned else WITH_FLATS) * (k + 1) / len(starts)
            here = self.hold(design, start)
            part = progress.part(end * k / len(starts), end * (k + 1) / len(starts))
            other = self.improved(here, first, part)
            tried.append(other if other.value < here.value else here)
        chosen = min(range(len(tried)), key=lambda k: tried[k].merit(LENIENT))
        here, ended = tried[chosen], self.trace.ended
        for share in (work.enough, 1.0):
            work.share = WITH_FLATS * share
            if codesigned:
                here = self._again(self.together, here, CYCLES, CYCLE_GAIN, progress.part(0.3, 0.8))
            work.share = share
            here = self._again(self.polished, here, POLISHES, GAIN, progress.part(0.8, 0.95))
            if not here.needs_time:
                break
        if work.over and here.tight:
            work.share = OVERTIME
            self._again(self.polished, here, POLISHES, 1.0, progress.part(0.95, 1.0))
        self.trace.ended = "time" if work.over else "converged" if ended == "time" else ended
        return chosen

    def hold(self, design: SpiralDesign, point: Point) -> Held:
        """A point in this design's flat shapes, noted among ``held``."""
        width, twist = point.spirals
        self.held.append(Held(replace(design, width=width, twist=twist), point, self.farthest))
        return self.held[-1]

    def _again(self, step: Stage, here: Held, most: int, gain: float, progress: Progress) -> Held:
        """The design after a stage that is done so often while it brings this share of the objective, the best one."""
        for k in range(most):
            if self.task.work.over:
                break
            start = here.pressed().firmed(strong=self.trace.unstable > UNSTABLE)
            found = step(start, progress.part(k / most, (k + 1) / most))
            if not found.value < start.value:
                break
            here = found
            exact = self.task.params.stop > 0.0 and here.point.mismatch.value < GOAL
            if not here.strained and (exact or here.value >= (1.0 - gain) * start.value):
                break
        return here

    def polished(self, here: Held, progress: Progress) -> Held:
        """A few more steps of the spirals alone."""
        short = replace(self.task.params, iterations=min(POLISH_STEPS, self.task.params.iterations))
        return self.improved(here, short, progress)

    def improved(self, here: Held, params: OptimiseParams, progress: Progress) -> Held:
        """The best spirals near to a design."""
        start = bearable = here.point

        def accepted(point: Point) -> None:
            nonlocal bearable
            self.accepted(point)
            if point.merit(STRICT) < bearable.merit(STRICT):
                bearable = point

        found = METHODS[params.method](start.problem, start, params, self.trace, accepted, progress)
        if bearable not in (start, found):  # time may be over before the last step's strains are down again
            self.hold(here.design, bearable)
        return self.hold(here.design, found)

    def together(self, here: Held, progress: Progress) -> Held:
        """Flat shapes and spirals, and then the spirals alone."""
        found = self.moved(here, progress.part(0.0, 0.8))
        found = found if found.value < here.value else here
        return found if self.task.work.over else self.polished(found, progress.part(0.8, 1.0))

    def moved(self, here: Held, progress: Progress) -> Held:
        """The best spirals and flat shapes near to a design."""
        params, start = self.task.params, here.point
        rough = replace(params, stop=max(params.stop, FLAT_STOP), iterations=min(FLAT_STEPS, params.iterations))
        method, part, steps = METHODS[params.method], progress.part(0.0, 0.9), len(self.trace.rows)
        found = codesign.refine(
            start.problem, start, here.design, rough, method, self.trace, self.accepted, part, self.first
        )
        if not self.trace.rows[steps:]:
            return here  # time was over before the first step, or no step brought anything
        within, other = progress.at(0.9, codesign.MOVING), self._settled(here, found, progress.at(0.9, codesign.MOVING))
        for share in BACK:
            if other is not None and other.value < here.value:
                break
            less = codesign.between(start, found, share, within)
            other = self._settled(here, less, within) if less.equilibrium.converged else None
        return other or here

    def _settled(self, here: Held, found: FlatPoint, progress: Progress) -> Held | None:
        """What was found with moved flat shapes as a design of spirals alone; None where patches overlap themselves."""
        design = codesign.designed(found, here.design)
        if design is None:
            return None
        space = found.problem.space.including(design)
        problem = self.task.problem(design, progress, space)
        problem = replace(problem, bearing=found.problem.bearing, firmness=found.problem.firmness)
        x = space.coordinates(design.width, design.twist)
        point = problem.at(x, found.equilibrium.pose, progress, INNER_ITERATIONS)
        return self.hold(design, point)
