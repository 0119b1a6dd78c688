"""The stages of one search: spirals alone, then flat shapes with them, then the spirals once more.

Every stage ends in a design that can be cut, weighed with the whole elastic model, and the best of those is the result:
a search never ends worse than it began, nor than the best it has held. Every step is weighed with the whole model too: without
the second order of the strains, slender panels come to rest in shapes which the real piece never takes. Derivatives take
that second order as given (see ``arm_sensitivity``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import FlexMapsError
from ..materials import Material
from ..mechanics.arms.model import ArmModel
from ..mechanics.assembly import Assembly, Pose, of_design, target_pose
from ..mechanics.elastic import ElasticModel
from ..mechanics.equilibrium import solve
from ..mechanics.loads import Loads
from ..params import OptimiseParams, SimulateParams
from ..patches.flattening.flatten import FlatPatches
from ..progress import SILENT, Progress
from ..simulation.simulate import Simulation, build_model, simulate
from ..spirals.design import SpiralDesign, fitted
from ..surface.mesh import QuadMesh
from . import codesign
from .codesign_problem import FlatPoint
from .design_space import DesignSpace
from .inverse import Point, Problem
from .objective import Target
from .optimisers import INNER_ITERATIONS, Accepted, Trace, gauss_newton, jumped, lbfgs
from .work import CURVING, FIT, SPACE, Work

Stage = Callable[["Cut", Progress], "Cut"]
GROUPS = {"alike": 1, "pairs": 2, "each": 4}  # of arms with one width, by the setting
METHODS: dict[str, Callable[..., Point]] = {"gauss_newton": gauss_newton, "lbfgs": lbfgs}
CUTTING = "Room between the arms"
TOLERANCE = 1e-6  # of the equilibria on the way, where the settings ask for a finer one; not measured
ALIKE = 1e-6  # relative differences of lengths, and radians
FLAT_STEPS, FLAT_STOP = 20, 5e-3  # with the flat shapes: half of the time, and nearly all of the gain
FLATS, FLAT_GAIN = 3, 0.1  # how often at the most, and the share of the objective that another time must promise
CUT_ITERATIONS = 150  # Newton iterations for what can be cut, which may lie farther away than a step leads
# shares of the way that are tried where a move of the flat shapes does not keep its shape when it is cut
BACK = 0.5, 0.2
POLISH_STEPS, POLISHES, GAIN = 8, 3, 0.01  # of the spirals alone afterwards, and how often, as above
ALONE, WITH_FLATS = 0.3, 0.8  # shares of the time by which these stages are over
# A match of how the surface bends is no use where the whole drifts away: RMS distances that are always allowed, in distances
# of neighbours and against the given design's.
NEAR, FARTHER = 0.2, 1.1
# steps at every place on the way to the whole model, and the shortest way between two
WALK_STEPS, WALK_LEAST = 4, 1.0 / 16.0


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

    def problem(self, design: SpiralDesign, progress: Progress = SILENT) -> Problem:
        """The problem in the whole model, of the spirals in this design's flat shapes."""
        assembly, physics, params = of_design(design), self.physics, self.params
        self.work.add(SPACE, assembly.size)
        mass = design.area * assembly.thickness * self.material.density if physics.gravity else None
        loads = Loads.of(assembly.size, supports=self.supports, clamped=physics.clamped, force=self.force, mass=mass)
        return Problem(
            assembly,
            DesignSpace.of(design, assembly, GROUPS[params.arms], progress),
            Target(assembly.pairs, self.target.centroids, params.laplacian, free=not loads.fixed.any()),
            loads,
            self.model,
            replace(physics, tolerance=max(physics.tolerance, TOLERANCE)),
            params.smoothness,
            (self.material, params.strain_share) if params.strain_share > 0.0 else None,
            self.work,
        )

    def model(self, assembly: Assembly, progress: Progress = SILENT) -> ElasticModel:
        """The whole elastic model."""
        self.work.add(CURVING, assembly.size)
        return build_model(assembly, self.material, self.physics.model, progress=progress)

    def as_at(self, problem: Problem, curving: np.ndarray | None) -> Problem:
        """The problem with this second order of the joints' motion (m, 6, 6, 6) for every design; None leaves it out."""

        def build(assembly: Assembly, progress: Progress) -> ElasticModel:
            model = build_model(assembly, self.material, self.physics.model, quick=True)
            return model.with_curving(curving) if isinstance(model, ArmModel) else model

        return replace(problem, build=build)

    def simulated(self, design: SpiralDesign, start: Pose, progress: Progress) -> Simulation:
        """The whole model's equilibrium near to a pose."""
        rest: dict[str, Any] = {"supports": self.supports, "force": self.force}
        rest["progress"] = replace(progress, shown=None)  # what is shown is the search
        return simulate(design, self.target, self.material, replace(self.physics, restarts=0), start=start, **rest)

    def rested(self, design: SpiralDesign, point: Point) -> Simulation:
        """A design that was made of a point as if it had been simulated: anew only where it differs from the point.

        The strains' second order is the point's.
        """
        assembly, model, found, loads = of_design(design), point.model, point.equilibrium, point.problem.loads
        if not _alike(assembly, point.model.assembly):
            model = build_model(assembly, self.material, self.physics.model, quick=True)
            if isinstance(model, ArmModel) and isinstance(point.model, ArmModel):
                model = model.with_curving(point.model.curving_at_joint)
            found = solve(model, found.pose, loads, point.problem.simulate)
        found = found.placed(loads.laid(found.pose, assembly.pairs, target_pose(self.target, design.flat.corners)))
        return Simulation(design, self.target, self.material, model, assembly, loads, found, [])


def _alike(one: Assembly, two: Assembly) -> bool:
    """Whether two assemblies of the same joints differ by rounding only."""
    apart = [np.abs(one.lever - two.lever) / one.radius.mean(), one.width / two.width - 1.0, one.twist - two.twist]
    return all(float(np.abs(part).max()) < ALIKE for part in apart)


@dataclass(frozen=True, eq=False)
class Cut:
    """A design that can be cut, as far as that is known before its outlines are drawn.

    problem : in the whole model, its space limited to what neighbours left each other; point : the design in it
    farthest : RMS distance that it may have from the target, in distances of neighbours
    """

    design: SpiralDesign
    problem: Problem
    point: Point

    farthest: float

    @property
    def value(self) -> float:
        """The objective; infinite without an equilibrium, and where the piece has come to lie too far away."""
        sound = self.point.equilibrium.converged and self.point.distance <= self.farthest
        return self.point.value if sound else np.inf


@dataclass(eq=False)
class Search:
    """One search.

    distance : of the given design, RMS in distances of neighbours; cuts : the designs that it has held, the last one last
    """

    task: Task
    trace: Trace
    accepted: Accepted
    distance: float
    first: FlatPatches
    cuts: list[Cut] = field(default_factory=list)

    @property
    def best(self) -> Cut:
        return min(self.cuts, key=lambda cut: cut.value)

    def run(self, start: Point, design: SpiralDesign, progress: Progress) -> None:
        """All stages, from a start in this design's flat shapes."""
        params, work = self.task.params, self.task.work
        codesigned = params.codesign and isinstance(start.model, ArmModel)
        here = self.cut(design, start.problem, start, progress.at(0.0, CUTTING))
        work.share = ALONE if codesigned else WITH_FLATS
        alone = 0.3 if codesigned else 0.8
        found = self.improved(here, params, progress.part(0.0, alone))
        ended, within = self.trace.ended, progress.at(alone, CUTTING)
        other = self.cut(design, here.problem, found, within)
        for share in BACK:
            if other.value < here.value:
                break
            # as in ``moved``
            start, x = here.point, here.problem.space.coordinates(*found.spirals)
            part = here.problem.at(start.x + share * (x - start.x), start.equilibrium.pose, within)
            if part.equilibrium.converged:
                other = self.cut(design, here.problem, part, within)
        here = other if other.value < here.value else here
        work.share = WITH_FLATS
        if codesigned:
            here = self._again(self.moved, here, FLATS, FLAT_GAIN, progress.part(0.3, 0.8))
        work.share = 1.0
        self._again(self.polished, here, POLISHES, GAIN, progress.part(0.8, 1.0))
        self.trace.ended = "time" if work.over else "converged" if ended == "time" else ended

    def _again(self, step: Stage, here: Cut, most: int, gain: float, progress: Progress) -> Cut:
        """The design after a stage that is done so often while it brings this share of the objective, the best one."""
        for k in range(most):
            if self.task.work.over:
                break
            try:
                found = step(here, progress.part(k / most, (k + 1) / most))
            except FlexMapsError:  # there is no room to cut what it led to: what there is stays
                break
            here, last = (found if found.value < here.value else here), here.value
            if not here.value < (1.0 - gain) * last:
                break
        return here

    def polished(self, here: Cut, progress: Progress) -> Cut:
        """A few more steps of the spirals alone."""
        short = replace(self.task.params, iterations=min(POLISH_STEPS, self.task.params.iterations))
        found = self.improved(here, short, progress.part(0.0, 0.9))
        return self.cut(here.design, here.problem, found, progress.at(0.9, CUTTING))

    def improved(self, here: Cut, params: OptimiseParams, progress: Progress) -> Point:
        """The best spirals near to a design."""
        return METHODS[params.method](here.problem, here.point, params, self.trace, self.accepted, progress)

    def moved(self, here: Cut, progress: Progress) -> Cut:
        """The best spirals and flat shapes near to a design."""
        params, start = self.task.params, here.point
        rough = replace(params, stop=max(params.stop, FLAT_STOP), iterations=min(FLAT_STEPS, params.iterations))
        method = METHODS[params.method]
        part = progress.part(0.0, 0.8)
        found = codesign.refine(
            start.problem, start, here.design, rough, method, self.trace, self.accepted, part, self.first
        )
        within = progress.at(0.8, CUTTING)

        def cut(point: FlatPoint) -> Cut:
            return self.cut(replace(here.design, flat=codesign.moved_flat(point, here.design)), None, point, within)

        other = cut(found)
        for share in BACK:
            if other.value < here.value:
                break
            # it does not keep its shape when it is cut: not all of the way there, then
            less = codesign.between(start, found, share, within)
            if less.equilibrium.converged:
                other = cut(less)
        return other

    def cut(self, design: SpiralDesign, problem: Problem | None, found: Point, progress: Progress) -> Cut:
        """What was found as a design that can be cut, in this design's flat shapes; noted among ``cuts``.

        problem : that of these flat shapes, with the limits that are known; None to begin anew.
        Where the way there throws the piece into another shape, it is sought from the target's, and the rest gives way
        with what has to, little by little.
        """
        result = self._fitted(design, found, progress)
        made = self._made(result, problem or self.task.problem(result, progress), found, progress)
        if found.equilibrium.converged and jumped(found, made.point, np.zeros((made.point.problem.assembly.size, 6))):
            share, self.task.work.share = self.task.work.share, 1.0  # this cannot wait
            pose = target_pose(self.task.target, design.flat.corners)
            near = self._made(result, made.problem, found, progress, pose)
            made = near if near.value < made.value else made
            walked = self._walked(made, found, progress)
            self.task.work.share = share
            made = walked if walked.value < made.value else made
        self.cuts.append(made)
        return made

    def _fitted(self, design: SpiralDesign, found: Point, progress: Progress) -> SpiralDesign:
        """The spirals of what was found, in this design's flat shapes, as they can be cut."""
        self.task.work.add(FIT, len(design.width))
        return fitted(design.flat, design.params, *found.spirals, prove=False, progress=progress)

    def _made(
        self, result: SpiralDesign, problem: Problem, found: Point, progress: Progress, start: Pose | None = None
    ) -> Cut:
        """What was found as it can be cut, its equilibrium sought from a pose, else from what was found."""
        given_way = result.twist < 0.999 * found.spirals[1]
        space = problem.space.limited(result.width, result.twist, given_way)
        problem = replace(problem, space=space, build=self.task.model)
        x = space.coordinates(result.width, result.twist)
        point = problem.at(x, start or found.equilibrium.pose, progress, CUT_ITERATIONS)
        return Cut(result, problem, point, max(FARTHER * self.distance, NEAR))

    def _walked(self, made: Cut, found: Point, progress: Progress) -> Cut:
        """From what was found to the whole model and to what can be cut, in steps on each of which the rest is adapted."""
        old, new = (getattr(point.model, "curving_at_joint", None) for point in (found, made.point))
        if old is None or new is None:
            return made
        wanted, given = found.spirals[1], made.design.twist
        wide = replace(made.problem.space, cap=np.ones(len(given)))
        here, share, step = found, 0.0, 0.25
        params = replace(self.task.params, iterations=WALK_STEPS)
        while share < 1.0 and step >= WALK_LEAST and not self.task.work.over:
            ahead = min(1.0, share + step)
            twist = wanted + ahead * (given - wanted)
            space = wide.limited(made.design.width, twist, given < 0.999 * wanted)
            problem = self.task.as_at(replace(made.problem, space=space), old + ahead * (new - old))
            x = space.coordinates(*here.spirals)
            point = problem.at(x, here.equilibrium.pose, progress, INNER_ITERATIONS)
            if not point.equilibrium.converged or jumped(here, point, np.zeros((len(x), 6))):
                step *= 0.5
                continue
            here = METHODS[params.method](problem, point, params, self.trace, self.accepted, progress)
            share = ahead
        if share < 1.0:
            return made
        return self._made(self._fitted(made.design, here, progress), made.problem, here, progress)
