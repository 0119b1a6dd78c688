"""Test pieces whose reported figures are compared with a new simulation of the stored piece."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from flexmaps.engine.extras.choosing.judge import FlatLayout, LayoutProblem, judge
from flexmaps.engine.extras.live.live_input import LiveInput
from flexmaps.engine.extras.live.live_piece import LivePiece
from flexmaps.engine.extras.structure.analysis import solve_without_loads
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.optimisation.optimise import optimise
from flexmaps.engine.optimisation.wishes import Wishes
from flexmaps.engine.params import Settings, with_values
from flexmaps.engine.patches.flattening.flatten import with_energies
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.simulation.rests import OTHER_REST_CODES
from flexmaps.engine.simulation.simulate import Simulation, simulate
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from harness import EDGE

SOFT = 0.05  # softest mode's share of its stiffness below which states are compared less closely
FINE = 1e-4  # metres, distance below which differences are not relative to it: single precision is felt there
PUSH = 0.3  # newtons, on the spiral farthest from the supports


@dataclass(frozen=True)
class Case:
    """supports : as in ``job.run``; clamped, gravity, force, wish : what else acts; rim : whether the border has one"""

    name: str
    mesh: QuadMesh
    supports: str | None = None
    clamped: bool = True
    gravity: bool = False
    force: bool = False
    rim: bool = False
    wish: bool = False

    def spirals(self, patience: float) -> tuple[Result, Settings]:
        """The piece as far as its spirals, and settings with this patience of the search."""
        values = {"simulate.clamped": self.clamped, "simulate.gravity": self.gravity, "optimise.patience": patience}
        settings = with_values(Settings(), values | ({"spiral.border": "rim"} if self.rim else {}))
        mesh = PolygonMesh.from_quads(self.mesh)
        made = job.run(mesh, settings, edge=EDGE, stop_after="spirals", supports=self.supports)
        held = np.zeros(0, int) if made.supports is None else made.supports
        centres = made.mesh.centroids
        away = np.linalg.norm(centres - centres[held].mean(axis=0), axis=1) if len(held) else centres[:, 2]
        if self.force:
            force = np.zeros((len(centres), 3))
            force[int(away.argmax())] = [0.0, 0.0, -PUSH]
            made = made.with_user(force=force)
        if self.wish:
            quad = np.array([int(away.argmax())])
            made = made.with_user(wishes=Wishes(quad, centres[quad] + np.array([[0.0, 0.0, 0.1 * EDGE]])))
        return made, settings


@dataclass(frozen=True)
class State:
    """rms : metres; energy : joules; strain : share of the material's limit; None where a stage does not tell"""

    rms: float
    energy: float | None
    strain: float | None

    @classmethod
    def of_simulation(cls, found: Simulation) -> State:
        strain = None if found.strain is None else float(found.strain.max())
        return cls(1e-3 * found.target_distances["rms_mm"], float(found.equilibrium.per_joint.sum()), strain)

    def apart(self, other: State) -> float:
        """Largest relative difference of what both tell."""
        pairs = [(self.rms, other.rms, FINE), (self.energy, other.energy, 1e-9), (self.strain, other.strain, 1e-3)]
        return max(abs(a - b) / max(abs(b), least) for a, b, least in pairs if a is not None and b is not None)


@dataclass(frozen=True)
class Comparison:
    """What a stage reported and what a fresh simulation found; softest : mode's share of its stiffness there."""

    stage: str
    reported: State
    fresh: State
    softest: float

    @property
    def apart(self) -> float:
        return self.reported.apart(self.fresh)

    @property
    def tolerance(self) -> float:
        """Largest difference that is allowed."""
        return 1e-3 if self.softest > SOFT else 1e-2


def fresh(
    result: Result, settings: Settings, design: SpiralDesign, *, loaded: bool = True, start: Pose | None = None
) -> Simulation:
    """Simulate a design as it is stored, in single precision; start from the target by default."""
    flat, (width, twist) = design.flat, (_single(design.width), _single(design.twist))
    stored = replace(design, flat=with_energies(flat.layout, _single(flat.points)), width=width, twist=twist)
    physics = settings.simulate if loaded else replace(settings.simulate, gravity=False)
    force = result.force if loaded else None
    material = settings.material.chosen
    return simulate(stored, result.mesh, material, physics, supports=result.supports, force=force, start=start)


def _single(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32).astype(float)


def _compare(stage: str, reported: State, found: Simulation) -> Comparison:
    return Comparison(stage, reported, State.of_simulation(found), found.softest()[1])


def after_optimise(result: Result, settings: Settings) -> list[Comparison]:
    """Optimise, then what Simulate, its advice, and Structure tell."""
    made = job.run_stages(result, settings, ("optimise", "simulate"))
    assert made.optimisation is not None and made.simulation is not None and made.design is not None
    # where the stage names another rest, a simulation from the target may find that one
    other = any(one.code in OTHER_REST_CODES for one in made.simulation.findings)
    start = made.simulation.equilibrium.pose if other else None
    found = fresh(made, settings, made.design, start=start)
    block = made.optimisation.report()
    told = State(found.diagonal * block["rms_percent"] / 100.0, None, block["strain_share_max"])
    rest = solve_without_loads(made.simulation, settings.simulate)
    at_rest = replace(made.simulation, equilibrium=rest.with_pose(made.simulation.loads.align(
        rest.pose, made.simulation.assembly.pairs, made.simulation.equilibrium.pose)))  # fmt: skip
    return [
        _compare("optimise", told, found),
        _compare("simulate", State.of_simulation(made.simulation), found),
        _compare(
            "structure", State.of_simulation(at_rest), fresh(made, settings, made.design, loaded=False, start=start)
        ),
    ]


def after_stop(result: Result, settings: Settings, looks: int = 5) -> list[Comparison]:
    """Optimise that is stopped after some steps, and Simulate after it."""
    seen: list[object] = []
    assert result.design is not None
    stopping = Progress(shown=seen.append, stopped=lambda: len(seen) > looks)
    found = optimise(
        result.design,
        result.mesh,
        settings.material.chosen,
        replace(settings.optimise, stop=1e-6),
        settings.simulate,
        supports=result.supports,
        force=result.force,
        wishes=result.wishes,
        progress=stopping,
    )
    again = fresh(result, settings, found.design)
    return [_compare("stopped", State.of_simulation(found.after), again)]


def after_judging(result: Result, settings: Settings, share: float, thorough: bool | None) -> list[Comparison]:
    """Compare the figures that Choose and Explore report of a layout."""
    assert result.flat is not None
    piece = LayoutProblem(result.mesh, settings, result.supports, result.force)
    judged = judge(piece, FlatLayout(result.flat, "", 1), share, thorough=thorough)
    assert judged is not None
    found = fresh(result, settings, SpiralDesign(judged.flat, settings.spiral, *judged.spirals))
    told = State(judged.rms * found.diagonal, None, judged.strain)
    return [_compare("choose" if thorough is None else "explore", told, found)]


def after_live(result: Result, settings: Settings) -> list[Comparison]:
    """Live mode after a change of some spirals."""
    design, mesh = result.design, result.mesh
    assert design is not None
    flat, some = design.flat, slice(0, len(design.twist) // 3)
    rest = (settings.spiral, settings.layout, settings.material.chosen, settings.simulate)
    loads, sizes, cut = (result.supports, result.force), np.full(len(mesh.quads), 4), flat.layout.cut
    known = (mesh.vertices, mesh.quads.ravel(), sizes, cut, cut, flat.corners, flat.energy)
    first = LiveInput(*known, design.width, design.twist, *rest, *loads)
    width, twist = design.width.copy(), design.twist.copy()
    width[some], twist[some] = 0.9 * width[some], 1.1 * twist[some]
    given, piece = replace(first, width=width, twist=twist), LivePiece()
    for now, before in ((first, None), (given, first)):
        piece.change(now.changes(before))
        while not (shape := piece.advance()).resting:
            pass
    found = fresh(result, settings, replace(design, width=width, twist=twist))
    return [_compare("live", State(shape.rms, None, None), found)]


# what compares the states that a stage reports, by its name; figures are shares of the optimiser's patience
STAGES: dict[str, Callable[[Result, Settings], list[Comparison]]] = {
    "optimise": after_optimise,
    "stopped": after_stop,
    "choose": lambda result, settings: after_judging(result, settings, 0.15, None),
    "explore": lambda result, settings: after_judging(result, settings, 0.15, True),
    "live": after_live,
}
