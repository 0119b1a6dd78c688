"""Volumetric equilibrium of whole designs: the solids of all spirals welded at their joints, arms condensed to their ends.

The energy of an element needs its own rest shape alone. So every spiral keeps its rest shape in its own patch's plane, both arms
of a joint share the nodes of their ends, and nowhere is a rest shape of the whole needed. Newton's method with mixed
stresses (Magisano, Leonetti and Garcea 2017); Young's modulus 1, lengths in ``design_mesh.UNIT``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..engine.arrays import Bool, Float, Int
from ..engine.errors import FlexMapsError
from ..engine.linalg import NotPositiveDefinite, SparseCholesky, SparsityPattern
from ..engine.mechanics.assembly import Pose, assembly_from_design
from ..engine.newton import CONVERGED, INDEFINITE, Iteration, LocalModel, minimise
from ..engine.progress import SILENT, Progress
from ..engine.spirals.design import SpiralDesign
from .condensed import Condensed, Pieces, condense
from .design_mesh import UNIT, DesignMesh, Resolution, make_mesh
from .elastic import Elements, lower_entries
from .full_steps import FullSteps
from .solid import ARMS
from .statics import Group

ITERATIONS = 60  # Newton steps; none of the stored states takes more than 12
TOLERANCE = 1e-8  # work of the last step over the energy; positions end far closer than the mesh resolves
HOLD = 100.0  # stiffness that is added against the motion of held hubs; the multipliers make them exact whatever it is
SHARES = (0.0, 0.5, 0.8, 1.0)  # of the stress that is left out where the tangent is indefinite with it
TOGETHER = 2  # spirals whose tangents are in memory at once: 20 MB; more of them cost more in page faults
FIT = 1e-6  # ``UNIT``, by which the ends of both arms of a joint may differ


@dataclass(frozen=True, eq=False)
class Balance:
    """An equilibrium of a design's solid, or the attempt at one.

    nodes : deformed positions; centres, rotations : of every hub, at the centre of its quad
    reactions : force and moment on every held hub, at its centre
    energy; strain : 99 % of the volume of every spiral stays below it; iterations
    stable : the last tangent had only positive eigenvalues
    """

    nodes: Float[np.ndarray, "spirals nodes 3"]
    centres: Float[np.ndarray, "spirals 3"]
    rotations: Float[np.ndarray, "spirals 3 3"]
    reactions: Float[np.ndarray, "held 6"]
    energy: float
    strain: Float[np.ndarray, " spirals"]
    iterations: int
    converged: bool
    stable: bool


@dataclass(frozen=True, eq=False)
class _Batch:
    """Some spirals, the elements of their hubs first, then those of their arms."""

    spirals: slice
    elements: Elements
    hubs: int  # elements of hubs


class DesignSolid:
    """The solid of a design ready to be loaded.

    pairs, sides : the spirals of every joint and the arms that meet there; lever, axes : as those of an ``Assembly``
    held : the hubs whose mean motion is prescribed, at least one; ``joined`` False leaves all spirals by themselves
    stiffness : (6, 6), as in ``Elements``, in the flat frames of the patches
    """

    def __init__(
        self,
        design: SpiralDesign,
        poisson: float,
        held: list[int],
        resolution: Resolution | None = None,
        *,
        joined: bool = True,
        stiffness: Float[np.ndarray, "6 6"] | None = None,
    ):
        if not held:
            raise FlexMapsError("A solid needs at least one held hub; hold any one of a free body")
        self.design, self.held, self.stiffness = design, held, stiffness
        self.mesh: DesignMesh = make_mesh(design, resolution or Resolution())
        joints = assembly_from_design(design).whole
        self.pairs, self.sides, self.lever, self.axes = joints.pairs, joints.sides, joints.lever, joints.axes
        n, count = self.mesh.numbering, len(self.mesh.nodes)
        self.tips = n.sections[:, -1]
        self.batches = [self._batch(i, min(i + TOGETHER, count), poisson) for i in range(0, count, TOGETHER)]
        self.hubs = self._hub_groups()
        # what is left after the arms are condensed: hubs, and the ends of the arms
        self.local = np.concatenate([np.arange(n.hub_size), self.tips.ravel()])
        self.number = self._welded(joined)
        self.size = 3 * (int(self.number.max()) + 1)
        self.pattern = self._pattern()
        self.cholesky = SparseCholesky(self.pattern)

    @property
    def unknowns(self) -> int:
        """Degrees of freedom before the arms are condensed."""
        n = self.mesh.numbering
        return self.size + 3 * len(self.mesh.nodes) * (n.size - len(self.local))

    def _batch(self, start: int, stop: int, poisson: float) -> _Batch:
        n, size = self.mesh.numbering, stop - start
        shift = n.size * np.arange(size)
        hubs = shift[:, None, None, None] + n.hub
        arms = (shift[:, None, None, None] + n.arms.reshape(-1, 4, 16)).reshape(-1, 4, 16)
        index = np.concatenate([hubs.reshape(-1, 4, 16), arms])
        elements = Elements(self.mesh.nodes[start:stop].reshape(-1, 3), index, poisson, self.stiffness)
        return _Batch(slice(start, stop), elements, size * len(n.hub))

    def _hub_groups(self) -> list[Group]:
        """The hubs as bodies: their volume, weighted so that its mean lies at the centre of the quad."""
        n, out = self.mesh.numbering, []
        for batch in self.batches:
            count = batch.spirals.stop - batch.spirals.start
            own = batch.elements.node_volumes[: batch.hubs].reshape(count, -1)
            nodes = np.arange(n.hub_size)
            for volumes, rest in zip(own, self.mesh.nodes[batch.spirals]):
                weights = np.bincount(n.hub.ravel(), volumes, n.hub_size) / volumes.sum()
                r = rest[: n.hub_size]
                middle = weights @ r
                spread = np.einsum("g,gi,gj->ij", weights, r - middle, r - middle)
                weights *= 1.0 - (r - middle) @ np.linalg.solve(spread, middle)
                out.append(Group.of(rest, nodes, weights))
        return out

    def _welded(self, joined: bool) -> Int[np.ndarray, "spirals kept"]:
        """Numbers of the nodes that are kept; those of both ends of a joint are one."""
        n, count = self.mesh.numbering, len(self.mesh.nodes)
        label = np.arange(count * len(self.local)).reshape(count, -1)
        ends = n.hub_size + np.arange(self.tips.size).reshape(ARMS, n.side, -1)
        for e, ((a, b), (k, l)) in enumerate(zip(self.pairs, self.sides) if joined else ()):
            at = [
                (self.mesh.nodes[s, self.tips[arm]] - self.lever[e, j] / UNIT) @ self.axes[e, j]
                for j, (s, arm) in enumerate(((a, k), (b, l)))
            ]
            other = at[1].reshape(n.side, -1, 3)[::-1].reshape(-1, 3)
            if np.abs(at[0] - other).max() > FIT:
                raise FlexMapsError(f"The arms of spirals {a} and {b} do not fit together", faces=[int(a), int(b)])
            label[b, ends[l][::-1]] = label[a, ends[k]]
        return np.unique(label, return_inverse=True)[1].reshape(label.shape)

    def _ends(self) -> Int[np.ndarray, "4 both"]:
        """Of every arm the kept nodes of its root, then those of its end."""
        ends = self.mesh.numbering.hub_size + np.arange(self.tips.size).reshape(ARMS, -1)
        return np.concatenate([self.mesh.numbering.sections[:, 0], ends], axis=1)

    def _pattern(self) -> SparsityPattern:
        rows, cols = [], []
        hub, ends = self.mesh.numbering.hub, self._ends()
        for batch in self.batches:
            number = self.number[batch.spirals]
            r, c = lower_entries(3 * number[:, hub].reshape(-1, 4, 16)[..., None] + np.arange(3))
            dofs = (3 * number[:, ends][..., None] + np.arange(3)).reshape(-1, 3 * ends.shape[1])
            rows += [r, np.broadcast_to(dofs[:, :, None], (*dofs.shape, dofs.shape[1])).ravel()]
            cols += [c, np.broadcast_to(dofs[:, None, :], (*dofs.shape, dofs.shape[1])).ravel()]
        for spiral in self.held:
            r, c = np.meshgrid(self.hub_dofs(spiral), self.hub_dofs(spiral), indexing="ij")
            rows, cols = [*rows, r.ravel()], [*cols, c.ravel()]
        return SparsityPattern(np.concatenate(rows), np.concatenate(cols), self.size)

    def hub_dofs(self, spiral: int) -> np.ndarray:
        return (3 * self.number[spiral, : self.mesh.numbering.hub_size][:, None] + np.arange(3)).ravel()

    # -- fields of all nodes -------------------------------------------------------------------------------------

    def flat(self, batch: _Batch, field: Float[np.ndarray, "spirals nodes 3"]) -> Float[np.ndarray, "rows 3"]:
        """A field on the nodes of a batch, in the order of its elements' nodes."""
        return field[batch.spirals].reshape(-1, 3)

    def gradients(self, nodes: Float[np.ndarray, "spirals nodes 3"]) -> list[np.ndarray]:
        """Deformation gradients of every batch's elements."""
        return [b.elements.gradients(self.flat(b, nodes - self.mesh.nodes)) for b in self.batches]

    def energy(self, state: list[np.ndarray]) -> float:
        """Elastic energy of deformation gradients."""
        return sum(b.elements.energy(b.elements.strain(f)) for b, f in zip(self.batches, state))

    def forces(self, state: list[np.ndarray]) -> Float[np.ndarray, "spirals nodes 3"]:
        """Derivative of the energy by the nodes' positions; of shared nodes, each spiral's own part."""
        out = np.empty_like(self.mesh.nodes)
        for b, f in zip(self.batches, state):
            el = b.elements
            nodal = el.forces(f, el.stress(el.strain(f)))
            count = out[b.spirals].size // 3
            parts = [np.bincount(el.index.ravel(), nodal[..., i].ravel(), count) for i in range(3)]
            out[b.spirals] = np.stack(parts, axis=1).reshape(out[b.spirals].shape)
        return out

    def weight(self, direction: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "spirals nodes 3"]:
        """Nodal forces of a body force of this density on all material."""
        out = np.empty_like(self.mesh.nodes)
        for b in self.batches:
            volume = np.bincount(b.elements.index.ravel(), b.elements.node_volumes.ravel(), out[b.spirals].size // 3)
            out[b.spirals] = volume.reshape(-1, out.shape[1])[..., None] * direction
        return out

    def frames(self, nodes: np.ndarray) -> tuple[Float[np.ndarray, "spirals 3"], Float[np.ndarray, "spirals 3 3"]]:
        """Centres and rotations of the hubs."""
        found = [group.frame(x) for group, x in zip(self.hubs, nodes)]
        return np.array([c for c, _ in found]), np.array([r for _, r in found])

    def strains(self, nodes: np.ndarray) -> Float[np.ndarray, " spirals"]:
        """The strain that 99 % of the volume of every spiral stays below."""
        out = []
        for b in self.batches:
            field = self.flat(b, nodes - self.mesh.nodes)
            owner = b.elements.index[:, 0, 0] // self.mesh.numbering.size
            out += [b.elements.peak_strain(field, only=np.flatnonzero(owner == i)) for i in range(owner.max() + 1)]
        return np.array(out)

    # -- tangent -------------------------------------------------------------------------------------------------

    def condensed(self, batch: _Batch, f: np.ndarray, stress: np.ndarray, gradient: np.ndarray) -> tuple:
        """Tangents of the hubs' elements, and the arms of a batch condensed to their ends."""
        n, tangents = self.mesh.numbering, batch.elements.tangents(f, stress)
        arms = Pieces(tangents[batch.hubs :], n.pieces, n.across)
        at = gradient[batch.spirals][:, n.sections].reshape(-1, 3 * n.pieces + 1, 3 * n.sections.shape[2])
        return tangents[: batch.hubs], condense(arms, at)

    # -- start ---------------------------------------------------------------------------------------------------

    def guess(self, pose: Pose) -> Float[np.ndarray, "spirals nodes 3"]:
        """Nodes for given poses of all hubs, metres: every joint half way between both hubs, arms bent as in the linear limit."""
        from scipy.spatial.transform import Rotation

        n, nodes, pose = self.mesh.numbering, self.mesh.nodes, pose.whole
        tip = np.zeros((len(nodes), ARMS, *self.tips.shape[1:], 3))
        a, b = self.pairs.T
        frames = pose.rotations[self.pairs] @ self.axes
        between = Rotation.from_matrix(np.swapaxes(frames[:, 0], 1, 2) @ frames[:, 1]).as_rotvec()
        joint = frames[:, 0] @ Rotation.from_rotvec(0.5 * between).as_matrix()
        ends = pose.centres[self.pairs] + np.einsum("ekij,ekj->eki", pose.rotations[self.pairs], self.lever)
        middle = ends.mean(axis=1)
        for j, (spiral, arm) in enumerate(zip((a, b), self.sides.T)):
            rest = nodes[spiral[:, None], self.tips[arm]]
            turned = joint @ np.swapaxes(self.axes[:, j], 1, 2)
            place = np.einsum("eij,egj->egi", turned, rest - self.lever[:, j, None] / UNIT) + middle[:, None] / UNIT
            local = (place - pose.centres[spiral, None] / UNIT) @ pose.rotations[spiral]
            tip[spiral, arm] = local - rest
        moved, still = nodes.copy(), np.zeros_like(nodes)
        for batch in self.batches:
            rest = np.broadcast_to(np.eye(3), (*batch.elements.weight.shape, 3, 3))
            arms: Condensed = self.condensed(batch, rest, np.zeros_like(rest), still)[1]
            own = tip[batch.spirals].reshape(-1, 3 * self.tips.shape[1])
            inside = arms.back(np.zeros_like(own), own).reshape(-1, ARMS, 3 * n.pieces + 1, self.tips.shape[1], 3)
            moved[batch.spirals][:, n.sections] += inside
        return pose.centres[:, None] / UNIT + np.einsum("nij,ngj->ngi", pose.rotations, moved)

    # -- equilibrium ---------------------------------------------------------------------------------------------

    def constraints(self, centres: np.ndarray, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Functionals (size, 6 h) of the kept nodes that are fixed while the held hubs keep given poses, and their values.

        In the turned frame the moments of the nodes' positions vanish exactly if that frame is the polar rotation.
        """
        functionals, values = np.zeros((self.size, 6 * len(self.held))), np.zeros(6 * len(self.held))
        for h, (spiral, c, r) in enumerate(zip(self.held, centres, rotations)):
            hub = self.hubs[spiral]
            turned = Group(hub.nodes, hub.weights, c, hub.arms @ r.T)
            functionals[self.hub_dofs(spiral), 6 * h : 6 * h + 6] = turned.spread.reshape(-1, 6)
            values[6 * h : 6 * h + 3] = c
        return functionals, values

    def solve(
        self,
        start: Float[np.ndarray, "spirals nodes 3"],
        pose: Pose,
        load: Float[np.ndarray, "spirals nodes 3"],
        fixed: Bool[np.ndarray, "held 6"] | None = None,
        progress: Progress = SILENT,
    ) -> Balance:
        """Equilibrium from start positions of the nodes, held hubs as in a pose (metres), dead nodal forces.

        fixed : which of shift and turn of the held hubs are prescribed; all by default
        """
        functionals, values = self.constraints(pose.centres[self.held] / UNIT, pose.rotations[self.held])
        chosen = np.ones(len(values), dtype=bool) if fixed is None else np.ravel(fixed)
        problem = Loaded(self, functionals[:, chosen], values[chosen], load, progress)
        run = minimise(problem, problem.start(start), FullSteps(TOLERANCE, ITERATIONS, SHARES, 1e-12, ITERATIONS))
        if run.ended == INDEFINITE:
            raise NotPositiveDefinite("the solid falls apart: a spiral hangs on no held hub")
        x, stable, reactions = run.state.nodes, run.history[-1].modified == 0.0, np.zeros(len(chosen))
        reactions[chosen] = -problem.multipliers
        out, energy, ended = reactions.reshape(-1, 6), run.state.energy, run.ended == CONVERGED
        return Balance(x, *self.frames(x), out, energy, self.strains(x), len(run.history), ended, stable)

    def pulled(self, force: Float[np.ndarray, "spirals 3"]) -> Float[np.ndarray, "spirals nodes 3"]:
        """Nodal forces of dead forces at the hubs."""
        out = np.zeros_like(self.mesh.nodes)
        for spiral, hub in enumerate(self.hubs[: len(force)]):
            out[spiral, hub.nodes] = hub.weights[:, None] * force[spiral]
        return out


@dataclass(frozen=True, eq=False)
class _State:
    """Nodes, the deformation gradients of every batch's elements, the mixed stress that the step which led here predicted, and
    the elastic energy.
    """

    nodes: Float[np.ndarray, "spirals nodes 3"]
    f: list[np.ndarray]
    mixed: list[np.ndarray]
    energy: float


@dataclass(eq=False)
class Loaded:
    """A solid under dead ``load`` at its nodes whose ``functionals`` of the kept nodes keep ``values`` (a ``newton.Problem``).

    multipliers : of the last step, the forces that keep them; arms : of the last factor, by batch
    kept : of the last factor, the gradient by the kept nodes
    """

    solid: DesignSolid
    functionals: Float[np.ndarray, "size fixed"]
    values: Float[np.ndarray, " fixed"]
    load: Float[np.ndarray, "spirals nodes 3"]
    progress: Progress = SILENT
    multipliers: np.ndarray = field(init=False)
    arms: list[Condensed] = field(init=False)
    kept: np.ndarray = field(init=False)

    def start(self, nodes: np.ndarray) -> _State:
        f = self.solid.gradients(nodes)
        return _State(nodes, f, [np.zeros_like(one) for one in f], self.solid.energy(f))

    def expand(self, state: _State) -> LocalModel:
        return LocalModel(state.energy, self.solid.forces(state.f) - self.load, own=state)

    def moved(self, state: _State, step: np.ndarray) -> _State:
        """The mixed stress is that of the strain linearised about the state (Magisano, Leonetti, Garcea 2017)."""
        mixed, moved = [], []
        for b, f in zip(self.solid.batches, state.f):
            el = b.elements
            slope = el.gradients(self.solid.flat(b, step)) - np.eye(3)
            change = np.swapaxes(f, -1, -2) @ slope
            mixed.append(el.stress(el.strain(f) + 0.5 * (change + np.swapaxes(change, -1, -2))))
            moved.append(f + slope)
        return _State(state.nodes + step, moved, mixed, self.solid.energy(moved))

    def energy(self, state: _State) -> float:
        return state.energy

    def watch(self, state: _State, history: list[Iteration]) -> None:
        work = history[-2].decrement / max(state.energy, 1e-300) if len(history) > 1 else 1.0
        done = (len(history) - 1) / ITERATIONS
        self.progress(done, f"iteration {len(history)}, work of the last step over the energy {work:.1e}")

    def factor(self, here: LocalModel, convex: float, shift: float) -> bool:
        solid, state = self.solid, here.own
        ends = solid._ends()
        kept = 3 * solid.number[..., None] + np.arange(3)
        right = np.bincount(kept.ravel(), here.gradient[:, solid.local].ravel(), solid.size)
        values, self.arms = [], []
        for batch, f, s in zip(solid.batches, state.f, state.mixed):
            try:
                hubs, arms = solid.condensed(batch, f, (1.0 - convex) * s, here.gradient)
            except np.linalg.LinAlgError:
                return False
            right += np.bincount(kept[batch.spirals][:, ends].ravel(), arms.gradient.ravel(), solid.size)
            values += [hubs.ravel(), arms.stiffness.ravel()]
            self.arms.append(arms)
        for spiral in solid.held:
            own = self.functionals[solid.hub_dofs(spiral)]
            values.append((HOLD * own @ own.T).ravel())
        self.kept = right
        return solid.cholesky.attempt(solid.pattern.sum(np.concatenate(values)))

    def step(self, here: LocalModel) -> np.ndarray:
        solid, n = self.solid, self.solid.mesh.numbering
        columns = solid.cholesky.solve(np.column_stack([-self.kept, self.functionals]))
        now = np.zeros(solid.size)
        kept = 3 * solid.number[..., None] + np.arange(3)
        now[kept] = here.own.nodes[:, solid.local]
        gap = self.values - self.functionals.T @ now
        schur = self.functionals.T @ columns[:, 1:]
        self.multipliers = np.linalg.solve(schur, self.functionals.T @ columns[:, 0] - gap)
        found = columns[:, 0] - columns[:, 1:] @ self.multipliers
        out = np.empty_like(here.own.nodes)
        out[:, solid.local] = found[kept]
        ends = solid._ends()
        for batch, arms in zip(solid.batches, self.arms):
            both = found[kept[batch.spirals][:, ends]].reshape(len(arms.gradient), -1)
            inside = arms.back(*np.split(both, 2, axis=1)).reshape(-1, ARMS, 3 * n.pieces + 1, ends.shape[1] // 2, 3)
            out[batch.spirals][:, n.sections] = inside
        return out

    def slope(self, here: LocalModel, step: np.ndarray) -> float:
        kept = 3 * self.solid.number[..., None] + np.arange(3)
        moved = np.zeros(self.solid.size)
        moved[kept] = step[:, self.solid.local]
        return float((here.gradient * step).sum() + (self.functionals @ self.multipliers) @ moved)
