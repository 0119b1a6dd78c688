"""Stability barrier: a term of the objective that keeps equilibria away from snapping, by their smallest eigenvalues.

With the Hessian H and its convex part C, the softest modes have H v = lambda C v. The barrier is half the sum of the
squares of log((enough - m) / (lambda - m)) over every lambda below ``enough``, with m = ``BARRIER_POLE``. The
derivative with respect to p, an increment of a hub or a design variable, is

    d lambda / d p = v . dH/dp v - lambda v . dC/dp v   with v . C v = 1.

It is computed by central differences along v, because third derivatives of the energy are symmetric. The adjoint adds
the part of the derivatives that acts through the equilibrium.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Float
from ..mechanics.arms.curving_changes import CurvingChanges, DesignChanges
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.sensitivity import spread_over_design
from ..mechanics.assembly import Pose
from ..mechanics.elastic import sum_joint_vectors
from ..mechanics.newton_system import NewtonSystem
from .terms import Gradient, Term

# Smallest eigenvalue lambda of an accepted equilibrium (tested as ``Equilibrium.spare``): pieces below it snap after
# changes of 0.01 mm. Larger: safer, more steps are refused (docs/tuning.md)
MIN_STABILITY = 0.01
# Eigenvalue lambda above which a shape counts as stable enough. Larger: short searches of stable pieces end farther
# from the target; smaller: the simulated shape differs from the real one (docs/tuning.md)
STABLE_EIGENVALUE = 0.1
MODE_COUNT = 4  # number of softest modes in the barrier; with fewer, the set changes from step to step
# Weight of the barrier, as a multiple of the mismatch at the start of a stage. Larger: pieces more stable and less like
# their target (docs/tuning.md)
BARRIER_WEIGHT = 0.3
# Smallest mismatch that the weight is computed from, so that a piece on its target keeps from snapping too; an RMSE of
# 0.014 of the distance between neighbouring hubs. Larger: more stable, farther from the target (docs/tuning.md)
LEAST_MISMATCH = 1e-4
# Eigenvalue m at which the logarithm would be infinite: slightly below ``MIN_STABILITY``, at which steps are refused
BARRIER_POLE = 0.008
TANGENT_BELOW = 0.002  # distance of an eigenvalue above the pole below which the logarithm continues as its tangent
# Length of the central differences: largest rotation of a hub, radians, or largest relative shift of neighbouring hubs
# over their distance. Smaller: more exact at the point, worse predictions over a whole step (docs/tuning.md)
DIFFERENCE_TURN = 3e-3
# Relative tolerance of the eigenvalues of a piece whose springs are left out. Larger: quicker, less accurate modes
MODE_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class StabilityRequirement:
    """Required stability of equilibria, which the stability barrier enforces.

    weight : of the barrier in the objective
    enough : eigenvalue above which a mode counts as stable; modes : number of softest modes in the barrier
    """

    weight: float
    enough: float = STABLE_EIGENVALUE
    modes: int = MODE_COUNT

    @classmethod
    def from_mismatch(cls, mismatch: float) -> StabilityRequirement:
        """Return the requirement with the barrier's weight for a stage that starts with this mismatch."""
        return cls(BARRIER_WEIGHT * max(mismatch, LEAST_MISMATCH))

    @property
    def margins(self) -> tuple[float, ...]:
        """Stability margins to test at an equilibrium, see ``equilibrium.solve``."""
        return MIN_STABILITY, self.enough

    def same_modes(self, other: StabilityRequirement) -> bool:
        """Return whether both requirements take the same modes of an equilibrium into account."""
        return type(self) is type(other) and (self.enough, self.modes) == (other.enough, other.modes)

    def rows(self, rises: Float[np.ndarray, " k"], enough: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the barrier's logarithms at eigenvalues ``rises``, and their derivatives with respect to ``rises``.

        They are log((enough - m) / (rises - m)), m = ``BARRIER_POLE``, continued as the tangent near m.
        """
        room = rises - BARRIER_POLE
        near = np.maximum(room, TANGENT_BELOW)
        return np.log((enough - BARRIER_POLE) / near) + (near - room) / TANGENT_BELOW, -1.0 / near

    def merit(self, value: float, rises: Float[np.ndarray, " k"]) -> float:
        """Return the objective ``value`` plus a penalty on too small eigenvalues ``rises``, to rank results."""
        below = rises[rises < STABLE_EIGENVALUE]
        logarithms = self.rows(below, STABLE_EIGENVALUE)[0]
        return value + 0.5 * self.from_mismatch(value).weight * float((logarithms**2).sum())


@dataclass(frozen=True, eq=False)
class RequirementWithoutSprings(StabilityRequirement):
    """Required stability, without its springs, of a piece that springs hold: eigenvalues may be far below 0."""

    @property
    def margins(self) -> tuple[float, ...]:
        """No margins: an equilibrium with springs is stable enough."""
        return ()

    def rows(self, rises: Float[np.ndarray, " k"], enough: float) -> tuple[np.ndarray, np.ndarray]:
        """Return log(2 - rises / enough) for eigenvalues ``rises``, and its derivatives with respect to these."""
        room = 2.0 * enough - rises
        return np.log(room / enough), -1.0 / room


@dataclass(frozen=True, eq=False)
class SoftModes:
    """The softest modes of an equilibrium.

    ways : (k, n, 6) eigenvectors v with v . C v = 1, for the Hessian's convex part C; rises : (k,) eigenvalues
    steps : (k,) lengths of central differences along ``ways``
    """

    ways: Float[np.ndarray, "k spirals 6"]
    rises: Float[np.ndarray, " k"]
    steps: Float[np.ndarray, " k"]

    @classmethod
    def from_equilibrium(
        cls, model: ArmModel, pose: Pose, system: NewtonSystem, asked: StabilityRequirement
    ) -> SoftModes:
        """Return the modes with eigenvalues below ``asked.enough``, of the piece without springs.

        Parameters
        ----------
        model, pose : the elastic model at equilibrium
        system : with the factor of the Hessian there
        asked : required stability
        """
        here = model.expand(model.start(pose))
        count = min(asked.modes, max(len(system.free) - 2, 1))
        alone = system.without_springs
        hessian, convex = alone.values(here.hessian), alone.values(here.convex)
        if alone is system:
            ways, rises = system.softest_at_minimum(hessian, convex, count)
        else:  # springs hold the piece, and it may be unstable without them
            ways, rises = alone.softest_modes(hessian, convex, count, tolerance=MODE_TOLERANCE)
        below = rises < asked.enough
        ways, rises, (a, b) = ways[below], rises[below], model.pairs.T
        centres = pose.whole.centres
        length = float(np.linalg.norm(centres[b] - centres[a], axis=1).mean())
        turns, shifts = np.abs(ways[..., 3:]), np.abs(ways[:, b, :3] - ways[:, a, :3]) / length
        largest = np.maximum(turns.max(axis=(1, 2), initial=0.0), shifts.max(axis=(1, 2), initial=0.0))
        return cls(ways, rises, DIFFERENCE_TURN / largest)

    def joints(self, pairs: np.ndarray) -> Float[np.ndarray, "k joints 12"]:
        """Return the increments of both hubs of every joint, mode by mode."""
        return self.ways[:, pairs].reshape(len(self.ways), -1, 12)

    def variations(self, model: ArmModel, pose: Pose, pairs: np.ndarray) -> Float[np.ndarray, "joints k"]:
        """Return every joint's contribution to v . H v - lambda v . C v, for each mode.

        pairs : (m, 2) hubs of every joint, numbered as in ``ways``; ``model`` and ``pose`` may number them differently
        """
        here, at = model.expand(model.start(pose)), self.joints(pairs)
        whole, convex = (np.einsum("kmi,mij,kmj->mk", at, of, at, optimize=True) for of in (here.hessian, here.convex))
        return whole - self.rises * convex

    def by_hubs(self, model: ArmModel, pose: Pose) -> Float[np.ndarray, "k spirals 6"]:
        """Return the derivatives of the eigenvalues by the hubs' increments at ``pose``, at a fixed design."""
        return np.array([self._by_hubs(model, pose, k) for k in range(len(self.rises))])

    def _by_hubs(self, model: ArmModel, pose: Pose, k: int) -> Float[np.ndarray, "spirals 6"]:
        way, rise, pairs = self.ways[k], self.rises[k], model.pairs
        at, size = way[pairs].reshape(-1, 12, 1), float(self.steps[k])
        rates = model.strain_rates(model.start(pose))
        stress = model.stiffness @ (rates @ at)
        found = np.zeros_like(way)
        for sign in (1.0, -1.0):
            there = model.start(pose.moved(sign * size * way))
            pull = model.expand(there).hessian @ at
            pull -= 2.0 * rise * np.swapaxes(model.strain_rates(there), 1, 2) @ stress
            found += sign / (2.0 * size) * sum_joint_vectors(pull[..., 0], pairs, len(way))
        # rotations do not commute: second derivatives along v and along another increment differ by this term
        turned = sum_joint_vectors((np.swapaxes(rates, 1, 2) @ stress)[..., 0], pairs, len(way))[:, 3:]
        found[:, 3:] -= 0.5 * rise * np.cross(turned, way[:, 3:])
        return found

    def by_curving(self, pose: Pose, changes: CurvingChanges) -> Float[np.ndarray, "k some 2 3"]:
        """Return the derivatives of the eigenvalues by the parameters of ``changes`` at fixed hubs, through D.

        D is the second-order term of the joints' strains. The change of v . H v is a second difference, along v, of the
        changes of the joints' energies.
        """
        model, out = changes.model, []
        for way, rise, size in zip(self.ways, self.rises, self.steps, strict=True):
            behind, here, ahead = (model.start(pose.moved(k * size * way)) for k in (-1.0, 0.0, 1.0))
            rates = (model.motion_at_joint(ahead) - model.motion_at_joint(behind)) / (2.0 * size)
            second = changes.energies(ahead) - 2.0 * changes.energies(here) + changes.energies(behind)
            out.append(second / size**2 - rise * changes.convex(here, rates))
        return np.array(out)

    def by_design(self, changes: DesignChanges, pose: Pose) -> Float[np.ndarray, "k joints 2 5"]:
        """Return the derivatives of the eigenvalues by the design, at fixed hubs.

        The last two axes are the side of the joint, and the four widths and the twist of the spiral on that side.
        """
        model, curving = changes.model, changes.curving
        here, out = model.start(pose), []
        for k, at in enumerate(self.joints(model.pairs)):
            size = float(self.steps[k])
            ahead, behind = (
                model.changes(model.start(pose.moved(sign * size * self.ways[k]))).force_by_design(at)
                for sign in (1.0, -1.0)
            )
            out.append((ahead - behind) / (2.0 * size) - self.rises[k] * model.convex_by_design(here, at))
        found = np.array(out)
        if len(curving.joints):
            for one, more in zip(found, self.by_curving(pose, curving), strict=True):
                one[curving.joints] += spread_over_design(more, model.assembly.sides[curving.joints])
        return found

    def by_spirals(
        self, changes: DesignChanges, pose: Pose, slopes: Float[np.ndarray, "joints 2 5 _"]
    ) -> Float[np.ndarray, "k coordinates"]:
        """Return the derivatives of the eigenvalues with respect to the spirals' design variables, at fixed hubs.

        changes : derivatives of the joints at ``pose``
        slopes : derivatives of the widths and twists on both sides of every joint with respect to these spirals'
            design variables
        """
        joints, each, assembly = self.by_design(changes, pose), slopes.shape[-1], changes.model.assembly
        joints = joints[:, :, :, None] @ slopes
        column = (each * assembly.hub_pairs[..., None] + np.arange(each)).ravel()
        return np.array([np.bincount(column, one.ravel(), each * assembly.spirals) for one in joints])


@dataclass(frozen=True, eq=False)
class StabilityBarrier(Term):
    """Stability barrier at one equilibrium, as a term of the objective.

    asked : required stability; rises : (k,) eigenvalues below it
    changes : computes the derivatives of ``rises`` by the hubs' increments (k, n, 6), and by the design variables at
        fixed hubs (k, coordinates)
    """

    asked: StabilityRequirement
    rises: Float[np.ndarray, " k"]
    changes: Callable[[], tuple[np.ndarray, np.ndarray]]

    @cached_property
    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        return self.asked.rows(self.rises, self.asked.enough)

    @cached_property
    def _by_eigenvalue(self) -> tuple[np.ndarray, np.ndarray]:
        return self.changes()

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the logarithms by the hubs' increments, and by the design variables."""
        by_hubs, by_own = self._by_eigenvalue
        slope = self._rows[1]
        return slope[:, None, None] * by_hubs, slope[:, None] * by_own

    @property
    def value(self) -> float:
        return 0.5 * self.asked.weight * float((self._rows[0] ** 2).sum())

    def merit(self, value: float) -> float:
        """Return the objective ``value`` plus the penalty by which results of searches are ranked."""
        return self.asked.merit(value, self.rises)

    @property
    def gradient(self) -> Gradient:
        return self._back(self._rows[0])

    def gauss_newton_product(self, increments: np.ndarray, change: np.ndarray) -> Gradient:
        by_hubs, by_own = self._slopes
        return self._back(np.einsum("kni,ni->k", by_hubs, increments) + by_own @ change)

    def after_step(self, increments: np.ndarray, change: np.ndarray) -> StabilityBarrier:
        by_hubs, by_own = self._by_eigenvalue
        rises = self.rises + np.einsum("kni,ni->k", by_hubs, increments) + by_own @ change
        # the logarithm is defined up to ``enough`` only
        return StabilityBarrier(self.asked, np.minimum(rises, self.asked.enough), lambda: (by_hubs, by_own))

    def _back(self, rows: Float[np.ndarray, " k"]) -> Gradient:
        """Return the gradient of the logarithms' scalar product with ``rows``, times the barrier's weight (vjp)."""
        by_hubs, by_own = self._slopes
        return Gradient(self.asked.weight * np.einsum("k,kni->ni", rows, by_hubs), self.asked.weight * rows @ by_own)
