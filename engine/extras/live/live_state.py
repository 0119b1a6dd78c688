"""Model, loads and mesh of a live piece, built from its input; parts that a change does not affect are reused.

A live piece is one whose equilibrium is computed again after every change by the user. A change rebuilds the patches
whose seams or vertices changed, and the joints whose spirals or rest geometry changed. Two quantities that are slow to
compute and less important are approximate at first: the weights of the spirals and, if many joints changed, the
second-order strains. ``LiveState.refine`` computes them when the piece is at equilibrium.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Bool, Float, Int
from ...mechanics.arms.arm_access import as_arm_model
from ...mechanics.arms.model import ArmModel
from ...mechanics.assembly import Assembly, Pose, assembly_from_design
from ...mechanics.elastic import ElasticModel
from ...mechanics.loads import Loads
from ...mechanics.newton_system import NewtonSystem
from ...mechanics.support_poses import SupportPoses
from ...patches.flattening.flatten import FlatPatches, flatten, with_corners
from ...patches.layout import PatchLayout
from ...patches.tracing.trace import make_disks
from ...simulation.simulate import build_model
from ...spirals.design import SpiralDesign
from ...surface.checking import check
from ...surface.mesh import PolygonMesh, QuadMesh
from .live_input import LiveInput, equal_inputs

# largest number of joints whose second-order strains are computed in one step (15 ms); larger: the live shape is jerky
BATCH = 500
# absolute and relative tolerance of stored distortions, which .blend files keep in single precision
ROUNDING = (1e-4, 0.02)


@dataclass(frozen=True, eq=False)
class LiveState:
    """All data that are needed to solve for the equilibrium of a live piece.

    given : input from which the other fields are computed
    mesh, flat : target, and its flat patches
    assembly, model : spirals with their joints, and their elastic model
    aim : pose of the hubs in the target
    loads : supports and forces
    system : linear system that is solved in every step of Newton's method
    strains_outdated : True for joints whose second-order strains were computed for an earlier design
    area : area of every spiral's material, square metres; None without gravity
    guessed : True if ``area`` is an estimate
    """

    given: LiveInput
    mesh: QuadMesh
    flat: FlatPatches
    assembly: Assembly
    model: ElasticModel
    aim: Pose
    loads: Loads
    system: NewtonSystem
    strains_outdated: Bool[np.ndarray, " joints"]
    area: Float[np.ndarray, " quads"] | None = None
    guessed: bool = False

    @classmethod
    def from_input(
        cls, given: LiveInput, old: LiveState | None = None, start: Pose | None = None
    ) -> tuple[LiveState, Pose]:
        """Build the state of a piece, and a pose to start from.

        Parameters
        ----------
        given : the input
        old : earlier state, whose unaffected parts are reused
        start : present pose of the hubs of ``old``; supported hubs are moved to their places in the target. Default is
            the pose of all hubs in the target

        Raises
        ------
        FlexMapsError : no such piece can be made, or no support holds it against its loads
        """
        mesh = _update_mesh(given, old)
        old = old if old is not None and mesh.quads is old.mesh.quads else None
        flat = _update_flat_patches(given, mesh, old)
        design = SpiralDesign(flat, given.spiral, given.width, given.twist)
        assembly = assembly_from_design(design)
        model, outdated = _update_model(assembly, given, old)
        area, guessed = _update_areas(design, given, old)
        loads = _make_loads(given, area)
        support_poses = SupportPoses(loads, mesh, flat.corners)
        aim = support_poses.fitted_pose
        pose = aim if start is None else support_poses.place_supports(_adapt_pose(start, flat, old))
        if assembly.rim is None or old is None or old.flat is not flat or old.assembly.rim is None:
            pose = replace(pose, nodes=None)  # poses of rim nodes are only valid for the rim that they belong to
        held = loads.held_increments(assembly.pairs, pose.centres)
        if (
            old is not None
            and equal_inputs(held, old.system.held[: len(held)])
            and equal_inputs(model.pairs, old.model.pairs)
        ):
            system = old.system  # reuses its symbolic factorisation
        else:
            system = NewtonSystem(model.pairs, held)
        return cls(given, mesh, flat, assembly, model, aim, loads, system, outdated, area, guessed), pose

    @property
    def refinable(self) -> bool:
        """Whether some strains are outdated or the areas are estimates, so that ``refine`` has work to do."""
        return self.guessed or bool(self.strains_outdated.any())

    def refine(self) -> Generator[None, None, LiveState]:
        """Compute all approximate parts in small steps; finally return the exact state."""
        given, model, arms = self.given, self.model, as_arm_model(self.model)
        if arms is not None:
            joints = np.flatnonzero(self.strains_outdated)
            for first in range(0, len(joints), BATCH):
                some = joints[first : first + BATCH]
                part = arms.part(np.unique(self.assembly.pairs[some]), some).with_own_curving()
                model = arms = _replace_joints(arms, part, self.assembly, some, given.material)
                yield
        area = self.design.area if self.guessed else self.area
        outdated, loads = np.zeros_like(self.strains_outdated), _make_loads(given, area)
        return replace(self, model=model, area=area, loads=loads, strains_outdated=outdated, guessed=False)

    @property
    def design(self) -> SpiralDesign:
        """The design of the piece, made from its input and flat patches."""
        return SpiralDesign(self.flat, self.given.spiral, self.given.width, self.given.twist)

    @property
    def unit(self) -> float:
        """Mean distance between the hubs of a joint in the target, metres."""
        a, b = self.assembly.pairs.T
        return float(np.linalg.norm(self.aim.centres[b] - self.aim.centres[a], axis=1).mean())

    def align(self, pose: Pose) -> Pose:
        """Align a pose with the target by a rigid motion, as far as supports allow."""
        return self.loads.align(pose, self.assembly.pairs, self.aim)


def _update_mesh(given: LiveInput, old: LiveState | None) -> QuadMesh:
    """Return the target mesh after checks; it shares the topology of the old mesh if faces are unchanged."""
    alike = (
        old is not None
        and equal_inputs(given.corners, old.given.corners)
        and equal_inputs(given.sizes, old.given.sizes)
    )
    if alike and old is not None and equal_inputs(given.vertices, old.given.vertices):
        return old.mesh
    mesh = check.as_quad_mesh(PolygonMesh(given.vertices, given.corners, given.sizes))
    if alike and old is not None and np.array_equal(mesh.quads, old.mesh.quads):
        return old.mesh.with_vertices(mesh.vertices)
    return mesh


def _update_flat_patches(given: LiveInput, mesh: QuadMesh, old: LiveState | None) -> FlatPatches:
    """Return the flat patches: stored ones where possible, flattened again where seams or vertices have changed."""
    names = ("vertices", "seams", "cut", "flat", "energy", "layout")
    if old is not None and all(equal_inputs(getattr(given, name), getattr(old.given, name)) for name in names):
        return old.flat
    old_layout = PatchLayout(mesh, given.cut & ~mesh.border)
    stored = with_corners(old_layout, given.flat)
    least, share = ROUNDING
    with np.errstate(invalid="ignore"):
        moved = ~(np.abs(stored.energy - given.energy) <= least + share * given.energy)
    layout = make_disks(PatchLayout(mesh, given.seams & ~mesh.border))
    if not moved.any() and np.array_equal(layout.cut, old_layout.cut):
        return stored
    return flatten(layout, given.layout, previous=stored, moved_quads=moved)


def _update_model(
    assembly: Assembly, given: LiveInput, old: LiveState | None
) -> tuple[ElasticModel, Bool[np.ndarray, " joints"]]:
    """Return the elastic model, and the new value of ``LiveState.strains_outdated``."""
    material, name = given.material, given.simulate.model
    rimmed = assembly.rim is not None or (old is not None and old.assembly.rim is not None)
    arms = None if old is None or rimmed else as_arm_model(old.model)
    if name != ArmModel.name or old is None or arms is None:
        return build_model(assembly, material, name, slopes=False), np.zeros(len(assembly.pairs), bool)
    joints = _changed_joints(assembly, material, old.assembly, old.given)
    if not joints.any():
        return replace(arms, assembly=assembly), old.strains_outdated
    some = np.flatnonzero(joints)
    hubs = np.unique(assembly.pairs[some])
    exact, few = len(some) <= BATCH, assembly.part(hubs, some)
    if exact:
        part = ArmModel.from_assembly(few, material, slopes=False)
    else:
        part = arms.part(hubs, some).rebuilt(few, material)
    outdated = old.strains_outdated.copy()
    outdated[some] = not exact
    return _replace_joints(arms, part, assembly, some, material), outdated


def _changed_joints(assembly: Assembly, material: Any, old: Assembly, given: LiveInput) -> Bool[np.ndarray, " joints"]:
    """Return a mask of the joints whose elastic properties differ from those of an earlier assembly and input."""
    for name in ("thickness", "clockwise", "cut", "grain"):
        if getattr(assembly, name) != getattr(old, name):
            return np.ones(len(assembly.pairs), bool)
    if material != given.material:
        return np.ones(len(assembly.pairs), bool)
    spirals = (assembly.width != old.width).any(axis=1) | (assembly.twist != old.twist)
    moved = (assembly.lever != old.lever).any(axis=(1, 2)) | (assembly.axes != old.axes).any(axis=(1, 2, 3))
    return moved | spirals[assembly.pairs].any(axis=1)


def _replace_joints(
    model: ArmModel, part: ArmModel, assembly: Assembly, joints: Int[np.ndarray, " j"], material: Any
) -> ArmModel:
    """Return a copy of a model with some joints replaced.

    model : the whole model; part : a model of the new joints only
    assembly, material : assembly and material of the result; joints : indices of the replaced joints
    """

    def put(whole: np.ndarray, some: np.ndarray) -> np.ndarray:
        out = whole.copy()
        out[joints] = some
        return out

    # drop derivatives with respect to the design, which a live piece does not need
    compliance = replace(model.compliance, by=None).map_arrays(
        lambda name, whole: put(whole, getattr(part.compliance, name))
    )
    names = ("at_joint", "lever", "rest", "stiffness", "offset", "curving_at_joint")
    arrays: dict[str, Any] = {name: put(getattr(model, name), getattr(part, name)) for name in names}
    return replace(model, assembly=assembly, compliance=compliance, material=material, **arrays)


def _update_areas(
    design: SpiralDesign, given: LiveInput, old: LiveState | None
) -> tuple[Float[np.ndarray, " quads"] | None, bool]:
    """Return the areas of the spirals' material, square metres, and whether they are estimates.

    Exact areas are slow, so new ones are first estimated from the lengths of the arms. None without gravity.
    """
    if not given.simulate.gravity:
        return None, False
    names = ("width", "twist", "spiral")
    if (
        old is not None
        and old.flat is design.flat
        and all(equal_inputs(getattr(given, n), getattr(old.given, n)) for n in names)
    ):
        if old.area is not None:
            return old.area, old.guessed
    corners = design.flat.corners
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1)) - corners.mean(axis=1, keepdims=True)
    wind = np.maximum(given.twist, 1e-9)
    # length of the spiral r = (1 - t) R, angle = twist t, divided by R
    stretch = 0.5 * (np.sqrt(1.0 + wind**2) + np.arcsinh(wind) / wind)
    return stretch * (np.linalg.norm(middles, axis=2) * given.width).sum(axis=1), True


def _make_loads(given: LiveInput, area: Float[np.ndarray, " quads"] | None) -> Loads:
    """Return supports and forces, including weight if ``area`` (square metres) is not None."""
    mass = None if area is None else area * given.spiral.thickness * given.material.density
    clamped = given.simulate.clamped
    return Loads.for_spirals(len(given.sizes), supports=given.supports, clamped=clamped, force=given.force, mass=mass)


def _adapt_pose(pose: Pose, flat: FlatPatches, old: LiveState | None) -> Pose:
    """Convert a pose to new flat patches: rotations of hubs refer to flat quads, which may have turned."""
    if old is None or old.flat is flat or len(pose.centres) != len(flat.corners):
        return pose
    before, now = (
        (c - c.mean(axis=1, keepdims=True)) @ np.array([1.0, 1.0j]) for c in (old.flat.corners, flat.corners)
    )
    turn = (before * now.conj()).sum(axis=1)  # rotation from the new flat frame to the old one, as a complex number
    turn /= np.maximum(np.abs(turn), 1e-300)
    back = np.zeros((len(turn), 3, 3))
    back[:, 0, 0] = back[:, 1, 1] = turn.real
    back[:, 1, 0], back[:, 0, 1] = turn.imag, -turn.imag
    back[:, 2, 2] = 1.0
    return Pose(pose.centres, pose.rotations @ back)  # without rim nodes, because the rim has changed
