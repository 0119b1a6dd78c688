"""The rod model: rigid hubs joined by straight edges from centre to centre, with stretch, two bendings and torsion.

It is that of FlexMaps section 6.1, eq. 1-4 (Malomo et al. 2018), with curvature binormal and torsion after Bergou et
al. 2008 and 2010. The roll of an edge, its rotation about itself, affects the energy of that edge only. So the energy
is minimised over all rolls, which leaves six unknowns per spiral. The paper measures the roll from a frame that is
transported in time. Here it is measured from the first hub's frame, carried onto the edge by the shortest rotation. The
two rolls differ by the reference torsion, which eq. 4 subtracts, so the energies are equal. The only history that a
state needs is the number of whole turns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Float
from ...materials import Material
from ..assembly import Assembly, Pose
from ..elastic import Expansion, JointsOnly, sum_joint_vectors
from ..out_of_range import OutOfRange
from ..vectors import outer
from . import rod_stiffness, strains
from .motion import END_INCREMENTS, ROLL_SIGNS, RodState, first_order, roll_coupling, second_order
from .rod_sensitivity import gradient_by_design


@dataclass(frozen=True, eq=False)
class RodModel(JointsOnly):
    """The rod model of an assembly: m edges, one per joint.

    The parameters of a spiral are k_s (stretch), k_b0 and k_b1 (bending) and k_t (torsion). Each half of an edge has
    the parameters of the spiral at its end.

    assembly : spirals and joints at rest
    springs : (m, 2, 3) k_b0, k_b1 and k_t over the length of the half edge, at either end, N m
    stretch : (m,) k_s times the length of the half edge, summed over both ends, joules
    rest : (m, 2, 3, 3) axes of the edge at rest as columns, in the flat frame of the hub at either end: along the edge,
        to its left, normal
    length : (m,) length of the edges at rest, metres
    by_design : (n, 4, 2) derivatives of every spiral's k_s, k_b0, k_b1, k_t by the mean width of its arms (per metre)
        and by its twist (per radian)
    """

    assembly: Assembly
    springs: Float[np.ndarray, "joints 2 3"]
    stretch: Float[np.ndarray, " joints"]
    rest: Float[np.ndarray, "joints 2 3 3"]
    length: Float[np.ndarray, " joints"]
    by_design: Float[np.ndarray, "spirals 4 2"]
    name: str = "rod"

    @classmethod
    def from_assembly(cls, assembly: Assembly, material: Material) -> RodModel:
        """Build the model of an assembly of one material.

        Parameters
        ----------
        assembly, material : spirals and joints at rest, and the material of their sheet
        """
        found = rod_stiffness.rod_parameters(
            _scale(assembly),
            assembly.width.mean(axis=1),
            assembly.twist,
            thickness=assembly.thickness,
            youngs=material.youngs,
        )
        return cls.with_parameters(assembly, found.values, np.stack([found.by_width, found.by_twist], axis=2))

    @classmethod
    def with_parameters(
        cls, assembly: Assembly, parameters: np.ndarray, by_design: np.ndarray | None = None
    ) -> RodModel:
        """Build the model from the rod parameters of its spirals.

        At rest an edge is straight, from centre to centre, with both hubs in one plane.

        Parameters
        ----------
        assembly : spirals and joints at rest
        parameters : (n, 4) k_s (N), k_b0, k_b1, k_t (N m^2) of every spiral
        by_design : (n, 4, 2) as in ``RodModel``; default zeros
        """
        change = np.zeros((*parameters.shape, 2)) if by_design is None else by_design
        half, moduli = assembly.radius, parameters[assembly.pairs]
        across = assembly.axes[:, 0] @ np.swapaxes(assembly.axes[:, 1], 1, 2)
        span = assembly.lever[:, 0] - np.einsum("mij,mj->mi", across, assembly.lever[:, 1])
        length = np.linalg.norm(span, axis=1)
        along = span / length[:, None]
        along = np.stack([along, np.einsum("mji,mj->mi", across, along)], axis=1)
        normal = np.broadcast_to([0.0, 0.0, 1.0], along.shape)
        rest = np.stack([along, np.cross(normal, along), normal], axis=3)
        springs = moduli[..., 1:] / half[..., None]
        return cls(assembly, springs, (moduli[..., 0] * half).sum(axis=1), rest, length, change)

    def rebuilt(self, assembly: Assembly, material: Material) -> RodModel:
        return RodModel.from_assembly(assembly, material)

    @property
    def pairs(self) -> np.ndarray:
        return self.assembly.pairs

    def part(self, hubs: np.ndarray, joints: np.ndarray) -> RodModel:
        of_joints = {name: getattr(self, name)[joints] for name in ("springs", "stretch", "rest", "length")}
        return replace(self, assembly=self.assembly.part(hubs, joints), by_design=self.by_design[hubs], **of_joints)

    def scale_stiffness(self, share: np.ndarray) -> RodModel:
        return replace(self, springs=share[:, None, None] * self.springs, stretch=share * self.stretch)

    def start(self, pose: Pose) -> RodState:
        return self._state(pose, None)

    def moved(self, state: RodState, step: np.ndarray) -> RodState:
        first, second = self.pairs.T
        change = np.einsum("mi,mi->m", state.tangent, step[second, :3] - step[first, :3])
        return replace(self._state(state.pose.moved(step), state), predicted=state.length + change)

    def beyond(self) -> list[OutOfRange]:
        known = self.assembly
        return rod_stiffness.beyond(_scale(known), known.width.mean(axis=1), known.twist, known.thickness)

    def torsion(self, state: RodState) -> np.ndarray:
        return state.torsion

    def energy(self, state: RodState) -> float:
        return float(self._stretch_energy(state.length)[0].sum() + self._end_energies(state).sum())

    def gradient_by_design(self, state: RodState) -> np.ndarray:
        return gradient_by_design(self.assembly, self.springs, self.length, self.by_design, state)

    def _end_energies(self, state: RodState) -> Float[np.ndarray, "joints 2"]:
        """Return the energies (m, 2) of bending and torsion at both ends, joules."""
        with np.errstate(invalid="ignore", over="ignore"):
            return strains.energy(self.springs, state.bend, state.angles)

    def _stretch_energy(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the stretch energies (m,) of edges of these lengths (m,), joules, and their derivatives, newtons.

        Eq. 2 of FlexMaps.
        """
        strain = length / self.length - 1.0
        return 0.5 * self.stretch * strain**2, self.stretch * strain / self.length

    def _state(self, pose: Pose, before: RodState | None) -> RodState:
        """Return the state at a pose.

        before : a state at a nearby pose; whole turns are added to torsion and roll so that they are closest to those
            of this state. None adds no turns
        """
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            first, second = self.pairs.T
            edge = pose.centres[second] - pose.centres[first]
            length = np.sqrt(np.einsum("mi,mi->m", edge, edge))
            tangent = edge / length[:, None]
            frames = pose.rotations[self.pairs] @ self.rest
            seen = np.einsum("mkij,mi->mkj", frames, tangent)
            near = 1.0 + seen[..., 0]
            bend = seen[..., 1:] * [2.0, -2.0] / near[..., None]
            carried = frames[..., 2] - (seen[..., 2] / near)[..., None] * (frames[..., 0] + tangent[:, None])
            sine = np.einsum("mi,mi->m", tangent, np.cross(carried[:, 0], carried[:, 1]))
            torsion = np.arctan2(sine, np.einsum("mi,mi->m", carried[:, 0], carried[:, 1]))
            share = self.springs[:, 1, 2] / self.springs[..., 2].sum(axis=1)
            guess = share * torsion
            if before is not None:
                torsion = torsion + 2.0 * np.pi * np.round((before.torsion - torsion) / (2.0 * np.pi))
                guess = before.roll + share * (torsion - before.torsion)
            roll = strains.relaxed_roll(self.springs, bend, torsion, guess)
        return RodState(pose, length, tangent, frames, bend, torsion, roll, length)

    def expand(self, state: RodState, ahead: bool = False) -> Expansion:
        """Compute energy, gradient and Hessian by the hubs' increments; the rolls are eliminated by Schur complements.

        Parameters
        ----------
        state : about which the energy is expanded
        ahead : compute the Hessian with the tension that the last step predicted (see ``ElasticModel.expand``) instead
            of the tension at ``state``; bending and torsion are always those at ``state``
        """
        joules, tension = self._stretch_energy(state.length)
        ends = strains.expand(self.springs, state.bend, state.angles)
        slope = ends.gradient * ROLL_SIGNS
        motion = first_order(state)
        jacobian = motion.jacobian
        gradient = np.einsum("mki,mkij->mkj", slope, jacobian)
        gradient[:, 0, :3] += tension[:, None] * state.tangent
        per_joint = joules + ends.energy.sum(axis=1)
        along = outer(state.tangent, state.tangent)
        steep = (self.stretch / self.length**2)[:, None, None] * along
        pull = self._stretch_energy(state.predicted)[1] if ahead else tension
        lateral = (pull / state.length)[:, None, None] * (np.eye(3) - along)
        flip = np.outer(ROLL_SIGNS, ROLL_SIGNS)
        geometric = second_order(state, motion, slope)
        blocks = gradient[:, 0] @ END_INCREMENTS[0] + gradient[:, 1] @ END_INCREMENTS[1]
        return Expansion(
            float(per_joint.sum()),
            per_joint,
            sum_joint_vectors(blocks, self.pairs, self.assembly.size),
            _eliminate_roll(ends.hessian * flip, jacobian, steep + lateral, geometric),
            _eliminate_roll(ends.convex * flip, jacobian, steep, None),
        )


def _eliminate_roll(
    ends: Float[np.ndarray, "joints 2 3 3"],
    jacobian: Float[np.ndarray, "joints 2 3 6"],
    stretch: Float[np.ndarray, "joints 3 3"],
    geometric: Float[np.ndarray, "joints 2 6 6"] | None,
) -> Float[np.ndarray, "joints 12 12"]:
    """Return the second derivatives (m, 12, 12) of the edges' energies by the increments of their two hubs.

    When the hubs move, the roll of every edge takes the value of least energy; its effect on the second derivatives is
    a Schur complement. (d, w) are the increments of ``motion.END_INCREMENTS``.

    Parameters
    ----------
    ends : (m, 2, 3, 3) second derivatives of the energy by the curvatures x, y and the roll at either end
    jacobian : (m, 2, 3, 6) derivatives of x, y and roll by (d, w)
    stretch : (m, 3, 3) second derivatives of the stretch energy by d
    geometric : (m, 2, 6, 6) geometric stiffness by (d, w), the result of ``motion.second_order``; None leaves it out
    """
    row = roll_coupling(ends, jacobian)
    out = outer(row / -ends[..., 2, 2].sum(axis=1)[:, None], row)
    own = np.swapaxes(jacobian, 2, 3) @ ends @ jacobian
    if geometric is not None:
        own += geometric
    shift = own[:, 0, :3, :3] + own[:, 1, :3, :3] + stretch
    for rows, columns, sign in ((0, 0, 1.0), (6, 6, 1.0), (0, 6, -1.0), (6, 0, -1.0)):
        out[:, rows : rows + 3, columns : columns + 3] += sign * shift
    for k, turn in ((0, slice(3, 6)), (1, slice(9, 12))):
        out[:, turn, turn] += own[:, k, 3:, 3:]
        for shifted, sign in ((slice(0, 3), -1.0), (slice(6, 9), 1.0)):
            out[:, shifted, turn] += sign * own[:, k, :3, 3:]
            out[:, turn, shifted] += sign * own[:, k, 3:, :3]
    return out


def _scale(assembly: Assembly) -> Float[np.ndarray, " spirals"]:
    """Return the scale (n,) of the spirals, metres: twice the mean distance from the hub's centre to its joints.

    Spirals without a joint get any positive value.
    """
    arms = np.bincount(assembly.pairs.ravel(), minlength=assembly.size)
    total = np.bincount(assembly.pairs.ravel(), weights=assembly.radius.ravel(), minlength=assembly.size)
    return np.where(arms > 0, 2.0 * total / np.maximum(arms, 1), 10.0 * assembly.thickness)
