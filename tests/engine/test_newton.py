"""The one solver against closed forms, and the derivatives of the elastic models block by block."""

from __future__ import annotations

import dataclasses
import sys
from typing import Any

import numpy as np
import pytest
from flexmaps.database.full_steps import FullSteps
from flexmaps.engine import levenberg_marquardt, newton
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.levenberg_marquardt import LevenbergMarquardt
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Assembly, Pose
from flexmaps.engine.mechanics.rods.rod_model import RodModel
from flexmaps.engine.newton import Iteration, LineSearch, LocalModel, minimise
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.optimize import rosen, rosen_der, rosen_hess
from scipy.spatial.transform import Rotation

wrong_blocks = sys.modules["flexmaps_taylor"].wrong_blocks


class Dense:
    """A function of a vector, of which some entries are held; its convex part is the identity."""

    def __init__(self, value: Any, slope: Any, hessian: Any, held: tuple[int, ...] = (), stop: int = 10**6):
        self.value, self.gradient, self.hessian, self.stop = value, slope, hessian, stop
        self.held, self.seen = list(held), []

    def expand(self, x: np.ndarray) -> LocalModel:
        gradient = self.gradient(x)
        gradient[self.held] = 0.0
        return LocalModel(float(self.value(x)), gradient, float(np.linalg.norm(gradient)), abs(float(self.value(x))), x)

    def moved(self, x: np.ndarray, step: np.ndarray) -> np.ndarray:
        return x + step

    def energy(self, x: np.ndarray) -> float:
        return float(self.value(x))

    def watch(self, x: np.ndarray, history: list[Iteration]) -> None:
        self.seen.append(x)
        if len(self.seen) > self.stop:
            raise Cancelled

    def factor(self, here: LocalModel, convex: float, shift: float) -> bool:
        eye = np.eye(len(here.own))
        matrix = (1.0 - convex) * np.asarray(self.hessian(here.own)) + convex * eye
        matrix[self.held] = matrix[:, self.held] = 0.0
        matrix[self.held, self.held] = 1.0
        try:
            self.factors = cho_factor(matrix)
        except LinAlgError:
            return False
        return True

    def step(self, here: LocalModel) -> np.ndarray:
        return -cho_solve(self.factors, here.gradient)

    def slope(self, here: LocalModel, step: np.ndarray) -> float:
        return float(here.gradient @ step)

    def stable(self, x: np.ndarray) -> bool:
        return self.factor(self.expand(x), 0.0, 0.0)

    def exits(self, x: np.ndarray) -> list[np.ndarray]:
        way = np.linalg.eigh(self.hessian(x))[1][:, 0]
        return [x + 0.1 * way, x - 0.1 * way]


MATRIX = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 5.0]])
PULL = np.array([1.0, -2.0, 3.0])


def quadratic(**options: Any) -> Dense:
    return Dense(lambda x: 0.5 * x @ MATRIX @ x - PULL @ x, lambda x: MATRIX @ x - PULL, lambda x: MATRIX, **options)


@pytest.mark.parametrize("rule", [LineSearch(1e-12, 20), FullSteps(1e-12, 20, least=1e-300)])
def test_a_quadratic_is_solved_in_one_step(rule: Any) -> None:
    run = minimise(quadratic(), np.array([5.0, 5.0, -5.0]), rule)
    assert run.ended == newton.CONVERGED
    assert run.state == pytest.approx(np.linalg.solve(MATRIX, PULL), abs=1e-13)
    assert run.history[0].step == 1.0 and run.history[0].modified == 0.0
    # what the slope predicts of a quadratic is twice what it falls by
    assert run.history[0].decrement == pytest.approx(2.0 * (run.history[0].energy - quadratic().energy(run.state)))


def test_held_variables_stay() -> None:
    run = minimise(quadratic(held=(1,)), np.array([5.0, 7.0, -5.0]), LineSearch(1e-12, 20))
    free = np.ix_([0, 2], [0, 2])
    expected = np.linalg.solve(MATRIX[free], PULL[[0, 2]] - MATRIX[[0, 2], 1] * 7.0)
    assert run.ended == newton.CONVERGED and run.state[1] == 7.0
    assert run.state[[0, 2]] == pytest.approx(expected)


@pytest.mark.parametrize("start", [[-1.2, 1.0], [0.0, 3.0], [2.0, -2.0]])
def test_rosenbrock_from_anywhere(start: list[float]) -> None:
    """From the third start on, the Hessian is indefinite on the way."""
    run = minimise(Dense(rosen, rosen_der, rosen_hess), np.array(start), LineSearch(1e-9, 200))
    assert run.ended == newton.CONVERGED and run.state == pytest.approx([1.0, 1.0])
    assert [one.residual for one in run.history][-1] <= 1e-9
    assert run.history[-1].energy == pytest.approx(0.0, abs=1e-18)


def well(**options: Any) -> Dense:
    """(x^2 - 1)^2 + y^2: a saddle at the origin, minima at x = 1 and -1."""
    return Dense(
        lambda x: (x[0] ** 2 - 1.0) ** 2 + x[1] ** 2,
        lambda x: np.array([4.0 * x[0] * (x[0] ** 2 - 1.0), 2.0 * x[1]]),
        lambda x: np.diag([12.0 * x[0] ** 2 - 4.0, 2.0]),
        **options,
    )


def test_an_indefinite_start_and_a_saddle_are_left() -> None:
    run = minimise(well(), np.array([0.2, 1.0]), LineSearch(1e-10, 50))
    assert run.ended == newton.CONVERGED and run.state == pytest.approx([1.0, 0.0], abs=1e-8)
    assert run.history[0].modified == 1.0 and run.history[-1].modified == 0.0
    run = minimise(well(), np.zeros(2), LineSearch(1e-10, 50))
    assert run.ended == newton.CONVERGED and np.abs(run.state) == pytest.approx([1.0, 0.0], abs=1e-8)


def test_it_does_not_creep_along_a_ridge_that_is_hardly_bent() -> None:
    """x^4 / 4 - a x^2 / 2 + y^2 / 2, whose minima lie at the root of a: with the convex part alone, steps grow by a share of a."""
    a = 1e-5
    ridge = Dense(
        lambda x: 0.25 * x[0] ** 4 - 0.5 * a * x[0] ** 2 + 0.5 * x[1] ** 2,
        lambda x: np.array([x[0] ** 3 - a * x[0], x[1]]),
        lambda x: np.diag([3.0 * x[0] ** 2 - a, 1.0]),
    )
    run = minimise(ridge, np.array([1e-4, 1e-3]), LineSearch(1e-13, 100))
    assert run.ended == newton.CONVERGED and run.state == pytest.approx([np.sqrt(a), 0.0], rel=1e-6, abs=1e-9)


def test_full_steps_take_the_convex_part_and_say_so() -> None:
    run = minimise(well(), np.array([0.2, 0.0]), FullSteps(1e-10, 50, (0.0, 1.0), 1e-12))
    assert run.history[0].modified == 1.0 and run.ended == newton.CONVERGED
    assert minimise(well(), np.array([0.2, 0.0]), FullSteps(1e-10, 50)).ended == newton.INDEFINITE


def test_why_it_ends() -> None:
    start = np.array([-1.2, 1.0])
    run = minimise(Dense(rosen, rosen_der, rosen_hess), start, LineSearch(1e-9, 3))
    assert run.ended == newton.ITERATIONS and len(run.history) == 4
    assert minimise(Dense(rosen, rosen_der, rosen_hess), start, FullSteps(1e-9, 2)).ended == newton.ITERATIONS
    uphill = dataclasses.replace(LineSearch(1e-9, 30))
    wrong = Dense(rosen, lambda x: -rosen_der(x), rosen_hess)
    assert minimise(wrong, start, uphill).ended == newton.NO_DESCENT
    broken = Dense(lambda x: np.nan, rosen_der, rosen_hess)
    assert minimise(broken, start, FullSteps(1e-9, 30)).ended == newton.DIVERGED


def test_cancelling_comes_through() -> None:
    with pytest.raises(Cancelled):
        minimise(Dense(rosen, rosen_der, rosen_hess, stop=2), np.array([-1.2, 1.0]), LineSearch(1e-9, 50))


class Residuals(Dense):
    """Rosenbrock's function as a least squares problem for damped steps."""

    must_end = False

    def __init__(self) -> None:
        super().__init__(lambda x: 0.5 * rosen(x), lambda x: 0.5 * rosen_der(x), None)
        self.refused = 0

    def propose(self, here: LocalModel, damping: float, following: float) -> Any:
        jacobian = np.array([[-20.0 * here.own[0], 10.0], [-1.0, 0.0]])
        square = jacobian.T @ jacobian
        step = -np.linalg.solve(square + damping * np.eye(2), here.gradient)
        if np.abs(step).max() < 1e-9:
            return None
        return type("Step", (), {"step": step, "gain": -(here.gradient @ step + 0.5 * step @ square @ step)})

    def shorten(self, here: LocalModel, proposal: Any, share: float) -> Any:
        return type("Step", (), {"step": share * proposal.step, "gain": share * proposal.gain})

    def take_step(self, here: LocalModel, proposal: Any) -> Any:
        return here.own + proposal.step

    def reached(self, x: np.ndarray) -> bool:
        return False

    def note_rejection(self) -> None:
        self.refused += 1

    def note_acceptance(self, x: np.ndarray) -> None:
        self.seen.append(x)


def test_damped_steps_go_downhill_to_the_end() -> None:
    problem = Residuals()
    run = minimise(problem, np.array([-1.2, 1.0]), LevenbergMarquardt(300, 0.0, 0.3))
    assert run.state == pytest.approx([1.0, 1.0], abs=1e-5)
    assert (np.diff([one.energy for one in run.history]) < 0.0).all() and problem.refused > 0


@pytest.mark.parametrize("share", [0.1, 10.0])
def test_damping_of_an_earlier_search_holds_where_it_is_less(share: float) -> None:
    start = np.array([-1.2, 1.0])
    fresh, later = LevenbergMarquardt(1, 0.0, 0.3), LevenbergMarquardt(1, 0.0, 0.3)
    first = minimise(Residuals(), start, fresh).history[0].modified
    later.damping = share * first
    again = minimise(Residuals(), start, later).history[0].modified
    assert (again < first) if share < 1.0 else (again == first)


def test_a_longer_first_step_begins_with_less_damping() -> None:
    start = np.array([-1.2, 1.0])
    short, long = (
        minimise(Residuals(), start, LevenbergMarquardt(1, 0.0, first)).history[0].modified for first in (0.3, 3.0)
    )
    assert short == pytest.approx(10.0 * long)


@pytest.mark.parametrize(("stop", "refused"), [(0.0, levenberg_marquardt.TRIALS), (1e-3, 1)])
def test_a_refused_step_that_was_to_bring_next_to_nothing_is_the_last(stop: float, refused: int) -> None:
    class Uphill(Residuals):
        def propose(self, here: LocalModel, damping: float, following: float) -> Any:
            return type("Step", (), {"step": here.gradient, "gain": 5e-4 * here.energy})

    problem = Uphill()
    run = minimise(problem, np.array([-1.2, 1.0]), LevenbergMarquardt(300, stop, 0.3))
    assert run.ended == newton.CONVERGED and problem.refused == refused


def test_of_a_refused_step_the_share_is_taken_that_a_parabola_finds_least() -> None:
    class TooFar(Residuals):
        def __init__(self) -> None:
            Dense.__init__(self, lambda x: 0.5 * x @ x, lambda x: x, None)
            self.refused = 0

        def propose(self, here: LocalModel, damping: float, following: float) -> Any:
            return type("Step", (), {"step": -10.0 * here.own, "gain": here.energy})

    problem = TooFar()
    run = minimise(problem, np.array([-1.2, 1.0]), LevenbergMarquardt(1, 0.0, 0.3))
    assert problem.refused == 1 and run.state == pytest.approx([0.0, 0.0], abs=1e-12)


def test_damping_falls_faster_until_a_step_goes_too_far() -> None:
    noted: list[tuple[float, int]] = []

    class Noting(Residuals):
        def propose(self, here: LocalModel, damping: float, following: float) -> Any:
            noted.append((damping, self.refused))
            return super().propose(here, damping, following)

    minimise(Noting(), np.array([-1.2, 1.0]), LevenbergMarquardt(300, 0.0, 0.3))
    damping, refused = np.array(noted).T
    falls = damping[1:] / damping[:-1]
    assert falls[refused[1:] == 0].min() < 0.5 * levenberg_marquardt.CUT
    assert falls[refused[:-1] > 0].min() > 0.9 * levenberg_marquardt.CUT


# -- derivatives of the elastic models
# -------------------------------------------------------------------------------------

NAMES = ("first shift", "first turn", "second shift", "second turn")


@pytest.mark.parametrize("kind", ["arm", "arm with curving", "rod"])
def test_every_block_of_a_joint(kind: str) -> None:
    assembly, pose = _joint()
    made = RodModel.from_assembly(assembly, MATERIALS["vero"])
    model = made if kind == "rod" else ArmModel.from_assembly(assembly, MATERIALS["vero"], curving="curving" in kind)
    assert _wrong(model, pose, lambda hessian: hessian) == []


@pytest.mark.parametrize("row, column", [(0, 1), (2, 2), (3, 1)])
def test_a_wrong_block_is_named(row: int, column: int) -> None:
    assembly, pose = _joint()

    def spoilt(hessian: np.ndarray) -> np.ndarray:
        out = hessian.copy()
        out[3 * row : 3 * row + 3, 3 * column : 3 * column + 3] *= 1.02
        return out

    first, second = sorted((row, column))
    found = _wrong(ArmModel.from_assembly(assembly, MATERIALS["vero"]), pose, spoilt)
    assert found == [f"Hessian by {NAMES[first]} and {NAMES[second]}"]


def _joint() -> tuple[Assembly, Pose]:
    """Two unequal spirals in one bent and twisted joint."""
    rng = np.random.default_rng(3)
    lever = np.array([[[0.01, 0.001, 0.0], [-0.009, 0.002, 0.0]]])
    axes = np.broadcast_to(np.eye(3), (1, 2, 3, 3))
    width = np.array([[0.0025] * 4, [0.002] * 4])
    assembly = Assembly(np.array([[0, 1]]), np.array([[1, 3]]), lever, axes, width, np.array([1.5, 2.5]), 0.0015)
    turns = Rotation.from_rotvec(0.4 * rng.normal(size=(2, 3))).as_matrix()
    return assembly, Pose(np.array([[0.0, 0.0, 0.0], [0.018, 0.002, 0.003]]), turns)


def _wrong(model: Any, pose: Pose, changed: Any) -> list[str]:
    state = model.start(pose)
    here = model.expand(state)
    hessian, units = changed(here.hessian[0]), np.tile(np.repeat([0.01, 1.0], 3), 2)
    blocks = {name: np.where(np.arange(12) // 3 == k, units, 0.0) for k, name in enumerate(NAMES)}

    def energy(step: np.ndarray) -> float:
        return model.energy(model.moved(state, step.reshape(2, 6)))

    return wrong_blocks(energy, here.gradient.ravel(), lambda v: hessian @ v, blocks)


@pytest.mark.parametrize(
    ("recent", "taken"), [((9.0, 5.0, 1.0, 1.0, 1.0, 1.0), True), ((9.0, 1.0, 1.0, 1.0, 1.0, 1.0), False)]
)
def test_a_step_may_rise_to_the_largest_of_five_recent_energies(recent: tuple[float, ...], taken: bool) -> None:
    """Grippo, Lampariello and Lucidi: to 4, where one of the last five was 5, but not where only an earlier one was higher."""

    class Hill(Dense):
        def slope(self, here: LocalModel, step: np.ndarray) -> float:
            return -1.0

    hill = Hill(lambda x: 4.0, None, None)
    history = [Iteration(energy, 1.0) for energy in recent]
    here = LocalModel(recent[-1], np.ones(1))
    found = LineSearch(1e-9, 10)._search_line(hill, np.zeros(1), here, np.ones(1), history)
    assert (found is not None) == taken
