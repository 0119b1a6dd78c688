"""Static equilibrium of one spiral: one factorisation pattern a spiral, Newton's method with mixed stresses.

One tip is held, the others carry dead forces and moments. In the geometric stiffness stands the stress of the mixed
iteration, extrapolated from the previous step (Magisano, Leonetti and Garcea 2017), so that the full load converges in
one step where the plain iteration needs many.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import null_space
from scipy.spatial import cKDTree

from ..engine.arrays import Float, Int
from ..engine.linalg import SparseCholesky, SparsityPattern
from ..engine.newton import CONVERGED, Iteration, LocalModel, minimise
from .elastic import STATION_PAIRS, Elements, lower_entries, tangent_entries
from .full_steps import FullSteps
from .geometry import Spiral
from .solid import ARMS, COARSE, Fineness, Solid, make_solid

ITERATIONS = 25  # Newton steps of a load step; no sample that converges in one load step takes more than 9
# load steps that are tried one after the other; of the samples that converge 95 % take one, 4 % three, 2 % twelve
STEPS = (1, 3, 12)
# work of the last step over the energy; the step squares it, so that energies end within 1e-10 of full convergence
ENERGY_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Group:
    """Nodes that share a frame: a tip face or the hub.

    weights : share of the face or volume that each node stands for, in all 1
    centre : rest position of the weighted mean
    arms : rest positions from there
    """

    nodes: Int[np.ndarray, " group"]
    weights: Float[np.ndarray, " group"]
    centre: Float[np.ndarray, " 3"]
    arms: Float[np.ndarray, "group 3"]

    @classmethod
    def of(cls, positions: np.ndarray, nodes: np.ndarray, weights: np.ndarray) -> Group:
        centre = weights @ positions[nodes]
        return cls(nodes, weights, centre, positions[nodes] - centre)

    @cached_property
    def spread(self) -> Float[np.ndarray, "group 3 6"]:
        """Nodal forces per unit of force and moment at the centre; its transpose gives the mean motion."""
        r, a = self.arms, self.weights
        inertia = np.einsum("g,gij->ij", a, (r**2).sum(1)[:, None, None] * np.eye(3) - r[:, :, None] * r[:, None, :])
        turn = np.linalg.inv(inertia)
        moment = np.cross(turn.T[None, :, :], r[:, None, :])  # (G, j, i): (J^-1 e_j) x r
        out = np.zeros((len(r), 3, 6))
        out[:, :, :3] = np.eye(3)
        out[:, :, 3:] = np.swapaxes(moment, 1, 2)
        return out * a[:, None, None]

    def frame(self, positions: np.ndarray) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
        """Centre and rotation from rest, by polar decomposition, of (N, 3) deformed node positions."""
        x = positions[self.nodes]
        centre = self.weights @ x
        moment = np.einsum("g,gi,gj->ij", self.weights, x - centre, self.arms)
        u, _, vt = np.linalg.svd(moment)
        return centre, u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


@dataclass(frozen=True, eq=False)
class Solution:
    """A static equilibrium, or the attempt at one.

    displacement : arm widths
    energy : Young's modulus times cubed arm width
    iterations : Newton steps in all
    steps : load steps that were needed
    converged : False where no number of load steps led to an equilibrium
    """

    displacement: Float[np.ndarray, "nodes 3"]
    energy: float
    iterations: int
    steps: int
    converged: bool


@dataclass(frozen=True, eq=False)
class _Numbering:
    """Degrees of freedom: three a node, but six fewer in the held face, whose mean motion is zero.

    free, held : of the nodes off and on that face; common, special : the elements off and at it
    block : the degrees of freedom of all nodes of the latter, which make one dense block; slots : where their tangents go in it
    """

    free: Int[np.ndarray, " free"]
    held: Int[np.ndarray, " held"]
    common: Int[np.ndarray, " common"]
    special: Int[np.ndarray, " special"]
    block: Int[np.ndarray, " block"]
    slots: Int[np.ndarray, " slots"]
    pattern: SparsityPattern
    cholesky: SparseCholesky

    @classmethod
    def of(cls, solid: Solid, index: Int[np.ndarray, "elements 4 16"], face: Group, backend: str | None) -> _Numbering:
        """index : the nodes of the elements; face : the one that is held"""
        count = 3 * len(solid.nodes)
        held = (3 * face.nodes[:, None] + np.arange(3)).ravel()
        free = np.setdiff1d(np.arange(count), held)
        rest = len(held) - 6
        reduced = np.full(count, -1)
        reduced[free] = np.arange(len(free))
        reduced[held[:rest]] = len(free) + np.arange(rest)
        # the held face's elements make one dense block of their own
        tip = solid.tip_elements[0]
        common = np.setdiff1d(np.arange(len(index)), tip)
        dofs = 3 * index[..., None] + np.arange(3)
        rows, cols = lower_entries(reduced[dofs[common]])
        block = np.unique(dofs[tip])
        tip_rows, tip_cols = (np.searchsorted(block, part) for part in tangent_entries(dofs[tip]))
        slots = (tip_rows * len(block) + tip_cols).ravel()
        outside = np.setdiff1d(block, held)
        own = np.concatenate([reduced[outside], len(free) + np.arange(rest)])
        own_rows, own_cols = np.meshgrid(own, own, indexing="ij")
        pattern = SparsityPattern(
            np.concatenate([rows, own_rows.ravel()]),
            np.concatenate([cols, own_cols.ravel()]),
            count - 6,
        )
        return cls(free, held, common, tip, block, slots, pattern, SparseCholesky(pattern, backend))


class Model:
    """One spiral ready to be loaded: tip 0 is held in the mean, tips 1 to 3 and the hub are tracked."""

    def __init__(
        self,
        spiral: Spiral,
        poisson: float,
        fineness: Fineness = COARSE,
        *,
        backend: str | None = None,
        like: Model | None = None,
        stiffness: Float[np.ndarray, "6 6"] | None = None,
        whole: int | None = None,
    ):
        """``stiffness`` as in ``Elements``, ``whole`` as in ``make_solid``; ``like`` is a model of the same plan (scale, twist, fillet, fineness) whose numbering is used again."""
        self.solid: Solid = make_solid(spiral, fineness, whole)
        nodes = self.solid.nodes
        self.elements = Elements(nodes, self.solid.elements, poisson, stiffness)
        self.tips = [self._tip(k) for k in range(ARMS)]
        volumes = np.zeros(len(nodes))
        own = self.solid.hub_elements
        np.add.at(volumes, self.elements.index[own], self.elements.node_volumes[own])
        inside = np.flatnonzero(volumes)
        self.hub = Group.of(nodes, inside, volumes[inside] / volumes.sum())
        self._basis = null_space(self.tips[0].spread.reshape(-1, 6).T)
        known = (
            _Numbering.of(self.solid, self.elements.index, self.tips[0], backend) if like is None else like.numbering
        )
        self.numbering: _Numbering = known
        self.pattern, self.cholesky, self.size = known.pattern, known.cholesky, known.pattern.size
        self._block_transform = self._held_transform()

    def _tip(self, k: int) -> Group:
        own = self.elements.index[self.solid.tip_elements[k], -1]
        section = np.outer([1, 5, 5, 1], [1, 5, 5, 1]).ravel() / 144.0
        share = np.zeros(len(self.solid.nodes))
        np.add.at(share, own, np.broadcast_to(section, own.shape) / len(own))
        nodes = np.flatnonzero(share)
        return Group.of(self.solid.nodes, nodes, share[nodes])

    def _held_transform(self) -> np.ndarray:
        """From the reduced degrees of freedom of the held face's elements to all of theirs."""
        block, held = self.numbering.block, np.searchsorted(self.numbering.block, self.numbering.held)
        outside = np.setdiff1d(np.arange(len(block)), held)
        out = np.zeros((len(block), len(outside) + self._basis.shape[1]))
        out[outside, np.arange(len(outside))] = 1.0
        out[held, len(outside) :] = self._basis
        return out

    # -- between all nodes and the degrees of freedom ------------------------------------------------------------

    def expand(self, q: Float[np.ndarray, " size *columns"]) -> Float[np.ndarray, "nodes 3 *columns"]:
        """Nodal displacements of degrees of freedom."""
        full = np.zeros((3 * len(self.solid.nodes), *q.shape[1:]))
        full[self.numbering.free] = q[: len(self.numbering.free)]
        full[self.numbering.held] = self._basis @ q[len(self.numbering.free) :]
        return full.reshape(len(self.solid.nodes), 3, *q.shape[1:])

    def reduce(self, nodal: Float[np.ndarray, "nodes 3 *columns"]) -> Float[np.ndarray, " size *columns"]:
        """The work of nodal forces on the degrees of freedom."""
        full = nodal.reshape(3 * len(self.solid.nodes), *nodal.shape[2:])
        return np.concatenate([full[self.numbering.free], self._basis.T @ full[self.numbering.held]])

    def loads(self, wrenches: Float[np.ndarray, "4 6"]) -> Float[np.ndarray, "nodes 3"]:
        """Nodal forces of dead forces and moments at the four tips; those at tip 0 do no work."""
        out = np.zeros_like(self.solid.nodes)
        for tip, wrench in zip(self.tips, wrenches):
            out[tip.nodes] += tip.spread @ wrench
        return out

    # -- equilibrium ---------------------------------------------------------------------------------------------

    def inner_forces(self, f: np.ndarray, stress: np.ndarray) -> Float[np.ndarray, " size"]:
        """Derivative of the energy by the degrees of freedom."""
        per_element = self.elements.forces(f, stress)
        flat = self.elements.index.ravel()
        nodal = np.stack(
            [np.bincount(flat, per_element[..., i].ravel(), len(self.solid.nodes)) for i in range(3)], axis=1
        )
        return self.reduce(nodal)

    def stiffness(self, f: np.ndarray, stress: np.ndarray) -> Float[np.ndarray, " entries"]:
        """Lower-triangle values of the tangent on ``pattern``."""
        tangents = self.elements.tangents(f, stress)
        size = len(self.numbering.block)
        special = tangents[self.numbering.special]
        # pairs of equal stations hold both triangles already; half of them, plus the transpose of all, is the whole
        equal = [k for k, (p, r) in enumerate(STATION_PAIRS) if p == r]
        special[:, equal] *= 0.5
        half = np.bincount(self.numbering.slots, weights=special.ravel(), minlength=size**2).reshape(size, size)
        block = half + half.T
        block = self._block_transform.T @ block @ self._block_transform
        return self.pattern.sum(np.concatenate([tangents[self.numbering.common].ravel(), block.ravel()]))

    @cached_property
    def rest(self) -> SparseCholesky:
        """The factor of the unloaded spiral's tangent: the linear limit, and the first step of every equilibrium."""
        factor = SparseCholesky(self.pattern, self.cholesky.backend)
        factor.factor(self.rest_stiffness())
        return factor

    def rest_stiffness(self) -> Float[np.ndarray, " entries"]:
        """Lower-triangle values of the unloaded spiral's tangent on ``pattern``."""
        f = np.broadcast_to(np.eye(3), (*self.elements.weight.shape, 3, 3))
        return self.stiffness(f, np.zeros_like(f))

    def solve(self, nodal_forces: Float[np.ndarray, "nodes 3"]) -> Solution:
        """Equilibrium under dead nodal forces, in one step where possible, else in 3 or 12 load steps."""
        target = self.reduce(nodal_forces)
        iterations = 0
        for steps in STEPS:
            q, ended = np.zeros(self.size), CONVERGED
            for step in range(1, steps + 1):
                loaded = _Loaded(self, target * (step / steps))
                run = minimise(loaded, loaded.start(q), FullSteps(ENERGY_TOLERANCE, ITERATIONS))
                q, ended = run.state.q, run.ended
                iterations += len(run.history)
                if ended != CONVERGED:
                    break
            if ended == CONVERGED:
                u = self.expand(q)
                energy = self.elements.energy(self.elements.strain(self.elements.gradients(u)))
                return Solution(u, energy, iterations, steps, True)
        return Solution(np.zeros_like(self.solid.nodes), 0.0, iterations, STEPS[-1], False)

    # -- what is looked at ---------------------------------------------------------------------------------------

    def frames(self, displacement: np.ndarray) -> tuple[Float[np.ndarray, "5 3"], Float[np.ndarray, "5 3 3"]]:
        """Centres and rotations of tips 0 to 3 and the hub under (N, 3) nodal displacements."""
        found = [g.frame(self.solid.nodes + displacement) for g in (*self.tips, self.hub)]
        return np.array([c for c, _ in found]), np.array([r for _, r in found])

    @cached_property
    def _sides(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Nodes on the left and right side of every arm, without the arm's first element."""
        left, right = [], []
        across, through = self.solid.fineness.across, self.solid.fineness.through
        for k in range(ARMS):
            own = self.solid.elements[self.solid.arm_of == k].reshape(across, -1, through, 4, 4, 4)
            right.append(np.unique(own[0, 1:, :, :, 0, :]))
            left.append(np.unique(own[-1, 1:, :, :, -1, :]))
        return left, right

    def clearance(self, displacement: Float[np.ndarray, "nodes 3"]) -> float:
        """Smallest distance in arm widths between nodes on the facing sides of neighbouring arms, off the hub."""
        x = self.solid.nodes + displacement
        left, right = self._sides
        return float(min(cKDTree(x[left[k]]).query(x[right[(k + 1) % ARMS]])[0].min() for k in range(ARMS)))


@dataclass(frozen=True, eq=False)
class _State:
    """A deformed spiral: degrees of freedom q, and of its elements the deformation gradients f, the strain, the stress and
    the mixed stress that the step which led here predicted; the elastic energy.
    """

    q: Float[np.ndarray, " size"]
    f: Float[np.ndarray, "elements 4 16 3 3"]
    strain: Float[np.ndarray, "elements 4 16 3 3"]
    stress: Float[np.ndarray, "elements 4 16 3 3"]
    mixed: Float[np.ndarray, "elements 4 16 3 3"]
    energy: float


@dataclass(frozen=True, eq=False)
class _Loaded:
    """A spiral under dead forces ``target`` on its degrees of freedom (a ``newton.Problem``).

    The energy is the elastic one alone: full steps are judged by their work against it.
    """

    model: Model
    target: Float[np.ndarray, " size"]

    def start(self, q: Float[np.ndarray, " size"]) -> _State:
        el = self.model.elements
        f = el.gradients(self.model.expand(q))
        strain = el.strain(f)
        stress = el.stress(strain)
        return _State(q, f, strain, stress, stress, el.energy(strain))

    def expand(self, state: _State) -> LocalModel:
        return LocalModel(state.energy, self.model.inner_forces(state.f, state.stress) - self.target, own=state)

    def moved(self, state: _State, step: Float[np.ndarray, " size"]) -> _State:
        el = self.model.elements
        slope = el.gradients(self.model.expand(step)) - np.eye(3)
        linear = np.swapaxes(state.f, -1, -2) @ slope
        mixed = el.stress(state.strain + 0.5 * (linear + np.swapaxes(linear, -1, -2)))
        f = state.f + slope
        strain = el.strain(f)
        return _State(state.q + step, f, strain, el.stress(strain), mixed, el.energy(strain))

    def energy(self, state: _State) -> float:
        return state.energy

    def watch(self, state: _State, history: list[Iteration]) -> None:
        pass

    def factor(self, here: LocalModel, convex: float, shift: float) -> bool:
        state: _State = here.own
        if not state.q.any():  # ``Model.rest`` has this factor already
            return True
        return self.model.cholesky.attempt(self.model.stiffness(state.f, state.mixed))

    def step(self, here: LocalModel) -> Float[np.ndarray, " size"]:
        factor = self.model.cholesky if here.own.q.any() else self.model.rest
        return -factor.solve(here.gradient)

    def slope(self, here: LocalModel, step: Float[np.ndarray, " size"]) -> float:
        return float(here.gradient @ step)
