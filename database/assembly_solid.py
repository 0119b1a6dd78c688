"""Volumetric equilibrium of whole assemblies: welded solids of many spirals, Newton's method with mixed stresses.

The energy of an element needs its own rest shape alone. So every spiral keeps its rest shape in its own patch's plane,
arms are welded by giving the nodes of both tip faces one number, and nowhere is a rest shape of the whole needed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from ..engine.arrays import Bool, Float
from ..engine.errors import FlexMapsError
from ..engine.linalg import NotPositiveDefinite, Pattern, SparseCholesky
from ..engine.newton import CONVERGED, INDEFINITE, FullSteps, Iteration, Local, minimise
from ..engine.progress import SILENT, Progress
from . import linear
from .assemblies import Plan
from .elastic import Elements, lower_entries
from .geometry import QUARTER, Spiral, centre_line
from .statics import Group, Model

ITERATIONS = 60  # Newton steps; none of the stored states takes more than 5
TOLERANCE = 1e-8  # work of the last step over the energy; positions end far closer than the mesh resolves
HOLD = 100.0  # stiffness that is added against the motion of held hubs; the multipliers make them exact whatever it is
SHARES = (0.0, 0.5, 0.8, 1.0)  # of the stress that is left out where the tangent is indefinite with it
HALF_TURN = np.diag([-1.0, -1.0, 1.0])  # about the normal: what joins the axes of two tips


@dataclass(frozen=True, eq=False)
class Balance:
    """An equilibrium of an assembly, or the attempt at one. Arm widths, Young's modulus 1.

    nodes : deformed positions of the welded nodes
    centres, rotations : mean position and rotation of every hub
    reactions : force and moment on every held hub, at its centre
    energy; strain : 99 % of the volume stays below it; iterations
    stable : the last tangent had only positive eigenvalues
    """

    nodes: Float[np.ndarray, "nodes 3"]
    centres: Float[np.ndarray, "spirals 3"]
    rotations: Float[np.ndarray, "spirals 3 3"]
    reactions: Float[np.ndarray, "held 6"]
    energy: float
    strain: float
    iterations: int
    converged: bool
    stable: bool


class Welded:
    """An assembly ready to be loaded.

    plan : which arms meet; models : the distinct spirals; of : (n,) int, which of them every spiral is
    held : the hubs whose mean motion is prescribed, at least one
    """

    def __init__(self, plan: Plan, models: Sequence[Model], of: np.ndarray, held: Sequence[int]):
        if not len(held):
            raise FlexMapsError("An assembly needs at least one held hub; hold any one of a free body")
        self.plan, self.models, self.of, self.held = plan, list(models), np.asarray(of), list(held)
        self.numbers = _weld(plan, self.models, self.of)
        self.size = 3 * (1 + max(int(n.max()) for n in self.numbers))
        self._local = [_spiral_pattern(m.elements) for m in self.models]
        self.pattern = self._pattern()
        self.cholesky = SparseCholesky(self.pattern)

    def model(self, spiral: int) -> Model:
        return self.models[self.of[spiral]]

    def _pattern(self) -> Pattern:
        rows, cols = [], []
        for i, number in enumerate(self.numbers):
            local = self._local[self.of[i]]
            dofs = (3 * number[:, None] + np.arange(3)).ravel()
            r, c = dofs[local.indices], dofs[local.columns]
            rows.append(np.maximum(r, c))
            cols.append(np.minimum(r, c))
        for h in self.held:
            dofs = self._hub_dofs(h)
            r, c = np.meshgrid(dofs, dofs, indexing="ij")
            rows.append(r.ravel())
            cols.append(c.ravel())
        return Pattern(np.concatenate(rows), np.concatenate(cols), self.size)

    def _hub_dofs(self, spiral: int) -> np.ndarray:
        return (3 * self.numbers[spiral][self.model(spiral).hub.nodes][:, None] + np.arange(3)).ravel()

    # -- start ---------------------------------------------------------------------------------------------------

    def guess(self, centres: np.ndarray, rotations: np.ndarray) -> Float[np.ndarray, "nodes 3"]:
        """Node positions for given poses of all hubs: every arm bends from its hub to the joint, half way between hubs.

        The field in a spiral is the linear limit's under the tip motions that the joints ask for.
        """
        motions = np.zeros((self.plan.count, 4, 6))
        for (a, b), (k, l) in zip(self.plan.pairs, self.plan.arms):
            ta, tb = self.model(a).tips[k].centre, self.model(b).tips[l].centre
            turn = joint_turn(self.model(a).solid.spiral, k, self.model(b).solid.spiral, l)
            half = _half_way(rotations[a], rotations[b] @ turn)
            middle = 0.5 * (centres[a] + rotations[a] @ ta + centres[b] + rotations[b] @ tb)
            for s, arm, tip, joint in ((a, k, ta, half), (b, l, tb, half @ turn.T)):
                motions[s, arm, :3] = rotations[s].T @ (middle - centres[s]) - tip
                motions[s, arm, 3:] = _vector(rotations[s].T @ joint)
        out, count = np.zeros((self.size // 3, 3)), np.zeros(self.size // 3)
        fields = [_tip_fields(m) for m in self.models]
        for i, number in enumerate(self.numbers):
            x = self.model(i).solid.nodes + np.einsum("gikl,kl->gi", fields[self.of[i]], motions[i])
            np.add.at(out, number, centres[i] + x @ rotations[i].T)
            np.add.at(count, number, 1.0)
        return out / count[:, None]

    def frames(self, nodes: np.ndarray) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
        """Centres and rotations of the hubs for (N, 3) node positions."""
        found = [self.model(i).hub.frame(nodes[number]) for i, number in enumerate(self.numbers)]
        return np.array([c for c, _ in found]), np.array([r for _, r in found])

    # -- equilibrium ---------------------------------------------------------------------------------------------

    def _constraints(self, centres: np.ndarray, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(size, 6 h) functionals of the nodes that are fixed while the held hubs keep given poses, and their values.

        In the turned frame the moments of the nodes' positions vanish exactly if that frame is the polar rotation.
        """
        functionals, values = np.zeros((self.size, 6 * len(self.held))), np.zeros(6 * len(self.held))
        for h, (spiral, c, r) in enumerate(zip(self.held, centres, rotations)):
            hub = self.model(spiral).hub
            turned = Group(hub.nodes, hub.weights, c, hub.arms @ r.T)
            functionals[self._hub_dofs(spiral), 6 * h : 6 * h + 6] = turned.spread.reshape(-1, 6)
            values[6 * h : 6 * h + 3] = c
        return functionals, values

    def gradients(self, nodes: Float[np.ndarray, "nodes 3"]) -> list[np.ndarray]:
        """Deformation gradients of every spiral's elements."""
        return [
            self.model(i).elements.gradients(nodes[n] - self.model(i).solid.nodes) for i, n in enumerate(self.numbers)
        ]

    def energy(self, state: list[Float[np.ndarray, "... 4 16 3 3"]]) -> float:
        """Elastic energy of deformation gradients."""
        parts = enumerate(state)
        return sum(self.model(i).elements.energy(self.model(i).elements.strain(f)) for i, f in parts)

    def forces(self, state: list[Float[np.ndarray, "... 4 16 3 3"]]) -> Float[np.ndarray, " size"]:
        """Derivative of the energy by the node positions."""
        out = np.zeros(self.size)
        for i, f in enumerate(state):
            el = self.model(i).elements
            nodal = el.forces(f, el.stress(el.strain(f)))
            dofs = 3 * self.numbers[i][el.index][..., None] + np.arange(3)
            out += np.bincount(dofs.ravel(), nodal.ravel(), self.size)
        return out

    def stiffness(self, state: list[np.ndarray], stress: list[np.ndarray], functionals: np.ndarray) -> np.ndarray:
        """Lower-triangle values of the tangent on ``pattern``, the held hubs stiffened."""
        values = []
        for i, (f, s) in enumerate(zip(state, stress)):
            values.append(self._local[self.of[i]].sum(self.model(i).elements.tangents(f, s)))
        for spiral in self.held:
            own = functionals[self._hub_dofs(spiral)]
            values.append((HOLD * own @ own.T).ravel())
        return self.pattern.sum(np.concatenate(values))

    def solve(
        self,
        start: Float[np.ndarray, "nodes 3"],
        centres: Float[np.ndarray, "held 3"],
        rotations: Float[np.ndarray, "held 3 3"],
        forces: Float[np.ndarray, "spirals 3"],
        fixed: Bool[np.ndarray, "held 6"] | None = None,
        progress: Progress = SILENT,
    ) -> Balance:
        """Equilibrium from start positions of the nodes, held hubs at given poses, dead forces at the hubs.

        fixed : which of shift and turn of the held hubs are prescribed; all by default
        """
        functionals, values = self._constraints(centres, rotations)
        chosen = np.ones(len(values), dtype=bool) if fixed is None else np.ravel(fixed)
        functionals, values = functionals[:, chosen], values[chosen]
        load = np.zeros((self.size // 3, 3))
        for i, number in enumerate(self.numbers):
            hub = self.model(i).hub
            load[number[hub.nodes]] += hub.weights[:, None] * forces[i]
        problem = _Loaded(self, functionals, values, load, progress)
        run = minimise(problem, problem.start(start), FullSteps(TOLERANCE, ITERATIONS, SHARES, 1e-12, ITERATIONS))
        if run.ended == INDEFINITE:
            raise NotPositiveDefinite("the assembly falls apart: a spiral hangs on no held hub")
        x, stable, reactions = run.state.nodes, run.history[-1].modified == 0.0, np.zeros(len(chosen))
        reactions[chosen] = -problem.multipliers
        energy, strain, iterations = run.state.energy, self.strain(x), len(run.history)
        converged = run.ended == CONVERGED
        return Balance(x, *self.frames(x), reactions.reshape(-1, 6), energy, strain, iterations, converged, stable)

    def strain(self, nodes: Float[np.ndarray, "nodes 3"]) -> float:
        """The strain that 99 % of the volume of the most strained spiral stays below."""
        return max(
            self.model(i).elements.peak_strain(nodes[n] - self.model(i).solid.nodes) for i, n in enumerate(self.numbers)
        )


@dataclass(frozen=True, eq=False)
class _State:
    """Node positions, the deformation gradients of every spiral's elements, and the mixed stress that the step which led
    here predicted; the elastic energy.
    """

    nodes: Float[np.ndarray, "nodes 3"]
    f: list[np.ndarray]
    mixed: list[np.ndarray]
    energy: float


@dataclass(eq=False)
class _Loaded:
    """An assembly under dead ``load`` at its nodes whose ``functionals`` keep ``values`` (a ``newton.Problem``).

    multipliers : of the last step, the forces that keep them
    """

    welded: Welded
    functionals: Float[np.ndarray, "size fixed"]
    values: Float[np.ndarray, " fixed"]
    load: Float[np.ndarray, "nodes 3"]
    progress: Progress
    multipliers: np.ndarray = field(init=False)

    def start(self, nodes: np.ndarray) -> _State:
        f = self.welded.gradients(nodes)
        return _State(nodes, f, [np.zeros_like(one) for one in f], self.welded.energy(f))

    def expand(self, state: _State) -> Local:
        return Local(state.energy, self.welded.forces(state.f) - self.load.ravel(), own=state)

    def moved(self, state: _State, step: np.ndarray) -> _State:
        """The mixed stress is that of the strain linearised about the state (Magisano, Leonetti, Garcea 2017)."""
        mixed = []
        for i, (f, number) in enumerate(zip(state.f, self.welded.numbers)):
            el = self.welded.model(i).elements
            slope = el.gradients(step[number]) - np.eye(3)
            change = np.swapaxes(f, -1, -2) @ slope
            mixed.append(el.stress(el.strain(f) + 0.5 * (change + np.swapaxes(change, -1, -2))))
        nodes = state.nodes + step
        moved = self.welded.gradients(nodes)
        return _State(nodes, moved, mixed, self.welded.energy(moved))

    def energy(self, state: _State) -> float:
        return state.energy

    def watch(self, state: _State, history: list[Iteration]) -> None:
        work = history[-2].decrement / max(state.energy, 1e-300) if len(history) > 1 else 1.0
        done = (len(history) - 1) / ITERATIONS
        self.progress(done, f"iteration {len(history)}, work of the last step over the energy {work:.1e}")

    def factor(self, here: Local, convex: float, shift: float) -> bool:
        stress = [(1.0 - convex) * s for s in here.own.mixed] if convex else here.own.mixed
        return self.welded.cholesky.attempt(self.welded.stiffness(here.own.f, stress, self.functionals))

    def step(self, here: Local) -> np.ndarray:
        columns = self.welded.cholesky.solve(np.column_stack([-here.gradient, self.functionals]))
        gap = self.values - self.functionals.T @ here.own.nodes.ravel()
        schur = self.functionals.T @ columns[:, 1:]
        self.multipliers = np.linalg.solve(schur, self.functionals.T @ columns[:, 0] - gap)
        return (columns[:, 0] - columns[:, 1:] @ self.multipliers).reshape(-1, 3)

    def slope(self, here: Local, step: np.ndarray) -> float:
        return float((here.gradient + self.functionals @ self.multipliers) @ step.ravel())


def tip_axes(spiral: Spiral, arm: int) -> Float[np.ndarray, "3 3"]:
    """Columns: the outward tangent of an arm at its tip, the direction to the left of it, the normal."""
    tangent = complex(centre_line(spiral, 1.0)[1] * QUARTER**arm)
    return np.array([[tangent.real, -tangent.imag, 0.0], [tangent.imag, tangent.real, 0.0], [0.0, 0.0, 1.0]])


def joint_turn(first: Spiral, arm: int, second: Spiral, other: int) -> Float[np.ndarray, "3 3"]:
    """Takes a direction in the flat frame of the first spiral of a joint to the same one in the second's."""
    return tip_axes(second, other) @ HALF_TURN @ tip_axes(first, arm).T


def _vector(rotation: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_rotvec()


def _half_way(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return a @ Rotation.from_rotvec(0.5 * _vector(a.T @ b)).as_matrix()


def _weld(plan: Plan, models: list[Model], of: np.ndarray) -> list[np.ndarray]:
    """Per spiral the numbers of its nodes; the nodes of joined tip faces share theirs."""
    counts = [len(models[k].solid.nodes) for k in of]
    start = np.concatenate([[0], np.cumsum(counts)])
    label = np.arange(start[-1])
    for (a, b), (k, l) in zip(plan.pairs, plan.arms):
        ta, tb = models[of[a]].tips[k], models[of[b]].tips[l]
        axes, other = (tip_axes(models[of[i]].solid.spiral, arm) for i, arm in ((a, k), (b, l)))
        distance, match = cKDTree(ta.arms @ axes).query(tb.arms @ other @ HALF_TURN)
        if len(ta.nodes) != len(tb.nodes) or distance.max() > 1e-6 or len(np.unique(match)) != len(match):
            raise FlexMapsError(f"The arms of spirals {a} and {b} do not fit together: give both one width")
        label[start[b] + tb.nodes] = start[a] + ta.nodes[match]
    number = np.unique(label, return_inverse=True)[1].reshape(-1)
    return [number[s:e] for s, e in itertools.pairwise(start)]


def _spiral_pattern(elements: Elements) -> Pattern:
    """Where one spiral's tangent, not yet welded, has entries."""
    dofs = 3 * elements.index[..., None] + np.arange(3)
    return Pattern(*lower_entries(dofs), int(dofs.max()) + 1)


def _tip_fields(model: Model) -> Float[np.ndarray, "nodes 3 4 6"]:
    """Displacement per unit motion (shift, turn) of the tips against the hub, in the linear limit."""
    out = np.zeros((*model.solid.nodes.shape, 4, 6))
    wrenches = np.eye(6)
    for k in range(4):
        tip, hub = model.tips[k], model.hub
        offset = tip.centre - hub.centre
        nodal = np.zeros((*model.solid.nodes.shape, 6))
        nodal[tip.nodes] += tip.spread @ wrenches
        nodal[hub.nodes] -= hub.spread @ (linear.transport(offset).T @ wrenches)
        found = model.expand(model.rest.solve(model.reduce(nodal)))
        of_hub = np.einsum("gij,gik->jk", hub.spread, found[hub.nodes])
        arms = model.solid.nodes - hub.centre
        found -= of_hub[:3] + np.cross(of_hub[3:].T, arms[:, None, :]).swapaxes(1, 2)
        of_tip = np.einsum("gij,gik->jk", tip.spread, found[tip.nodes])
        out[:, :, k] = found @ np.linalg.inv(of_tip)
    return out
