"""Simulate the shape that an assembled design takes, and report to users what may be wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..materials import FILLET_STRAIN, OVERSTRAIN_SHARE, Material
from ..mechanics.arms.bent import Bender, bend_arms
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.strain_changes import max_strain_per_spiral
from ..mechanics.assembly import Assembly, Pose, assembly_from_design, target_pose
from ..mechanics.clearance.slots_in_space import SpaceSlots, slots_in_space
from ..mechanics.elastic import ElasticModel
from ..mechanics.equilibrium import Equilibrium, other_minima, solve
from ..mechanics.laplacian import laplacian_rmse
from ..mechanics.loads import Loads
from ..mechanics.newton_system import NewtonSystem
from ..mechanics.rods.rod_model import RodModel
from ..mechanics.support_poses import SupportPoses
from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign
from ..surface.checking.check import Finding
from ..surface.checking.finding import merge_alike, with_count
from ..surface.mesh import QuadMesh
from ..threads import one_thread
from .band import ToleranceBand
from .rests import SNAP_STIFFNESS, reported_rest, rest_findings
from .shortfall import FarBody, find_far_bodies

# If the torsion of any joint differs by more than this, in radians, between the simulated shape and the target, the
# shape is probably a false minimum, which the real piece would not take; larger: fewer warnings; by eye
FALSE_MINIMUM_TORSION = 1.0


@dataclass(frozen=True, eq=False)
class Simulation:
    """The equilibrium of a design, aligned with its target.

    design, target, material : what was simulated: spirals on flat patches, mesh that they should match, and sheet
    model, assembly, loads : elastic model, spirals and joints at rest, supports and forces
    equilibrium : the simulated shape; its pose is aligned with the target as far as supports allow
    others : other equilibria that were found, if they were searched for
    rest_from_target : member of ``others`` that a search from the target's pose reaches; None if there is none
    band : effect of the tolerances of real sheets; None if it was not computed
    slots_cache, softest_cache : caches of the results of ``slots`` and ``softest``; empty before their first call
    """

    design: SpiralDesign
    target: QuadMesh
    material: Material
    model: ElasticModel
    assembly: Assembly
    loads: Loads
    equilibrium: Equilibrium
    others: list[Equilibrium]
    band: ToleranceBand | None = None
    rest_from_target: Equilibrium | None = None
    slots_cache: list[SpaceSlots] = field(default_factory=list, init=False, repr=False)
    softest_cache: list[tuple[np.ndarray, float]] = field(default_factory=list, init=False, repr=False)

    @cached_property
    def vertices(self) -> Float[np.ndarray, "vertices 3"]:
        """Vertices (V, 3) of the simulated shape, metres: the vertices of the flat quads, moved with their hubs."""
        return move_vertices(self.design, self.equilibrium.pose, self.target)

    @cached_property
    def distance(self) -> Float[np.ndarray, " quads"]:
        """Distance (F,) from every spiral's centre to the centre of its quad in the target, metres."""
        return np.linalg.norm(self.equilibrium.pose.centres - self.target.centroids, axis=1)

    @cached_property
    def energy(self) -> Float[np.ndarray, " quads"]:
        """Elastic energy (F,) of every spiral, joules: half of the energy of each of its joints."""
        halves, owners = np.repeat(0.5 * self.equilibrium.per_joint, 2), self.model.assembly.hub_pairs
        return np.bincount(owners.ravel(), weights=halves, minlength=self.assembly.size)

    @cached_property
    def joint_strain(self) -> Float[np.ndarray, "joints 2"] | None:
        """Largest strain (m, 2) on the surface of both arms of every joint, except in the fillets at the hubs.

        None for the rod model.
        """
        return self.model.strains(self.model.start(self.equilibrium.pose), self.material)

    @cached_property
    def strain(self) -> Float[np.ndarray, " quads"] | None:
        """Largest strain (F,) in the arms of every spiral's joints, as a share of the material's strain limit.

        Both arms of a joint count for both of its spirals (see ``strain_changes.max_strain_per_spiral``). None for the
        rod model.
        """
        if self.joint_strain is None:
            return None
        return max_strain_per_spiral(self.model.assembly, self.joint_strain) / self.material.strain_limit

    def slots(self, progress: Progress = SILENT) -> SpaceSlots | None:
        """Return the slots between the bent arms, measured at the first call; None if there is no equilibrium."""
        if not self.slots_cache and self.equilibrium.converged:
            pose = self.equilibrium.pose
            arms = bend_arms(self.design, pose, material=self.material, progress=progress.part(0.0, 0.5))
            self.slots_cache.append(slots_in_space(self.design, arms, progress.part(0.5, 1.0)))
        return self.slots_cache[0] if self.slots_cache else None

    def slots_near(self, quads: Bool[np.ndarray, " quads"], others: SpaceSlots) -> SpaceSlots | None:
        """Return ``others`` with the slots within and between some quads measured anew; None if there is no
        equilibrium.

        Parameters
        ----------
        quads : mask of these quads
        others : all slots, measured in nearly this shape
        """
        if not self.equilibrium.converged:
            return None
        bender, some = Bender.from_design(self.design, self.material, quads), np.flatnonzero(quads)
        arms = bender.bend(self.equilibrium.pose, only=quads)
        return others.with_quads_of(slots_in_space(self.design, arms, quads=some), some)

    def softest(self, progress: Progress = SILENT) -> tuple[np.ndarray, float]:
        """Return the softest motion of the hubs and its stiffness, computed at the first call.

        Returns
        -------
        (F, 6) : shift and turn of every hub
        float : stiffness of this motion, as a share (see ``rests.Softest``); negative at a saddle
        """
        if self.softest_cache:
            return self.softest_cache[0]
        pose, pairs = self.equilibrium.pose, self.model.pairs
        system = NewtonSystem(pairs, self.loads.held_increments(pairs, pose.centres))
        here = self.model.expand(self.model.start(pose))
        progress(0.0, "Finding how the shape moves most easily")
        values, metric = system.values(here.hessian), system.values(here.convex)
        if self.equilibrium.converged and len(system.free) and system.factor(values):
            modes, rise = system.softest_at_minimum(values, metric, 1)
        else:
            modes, rise = system.softest_modes(values, metric, progress=progress)
        self.softest_cache.append((modes[0][: self.assembly.size], float(rise[0])))
        return self.softest_cache[0]

    @cached_property
    def far_bodies(self) -> list[FarBody]:
        """The bodies that come to rest far from their target, or stay flat; none if there is no equilibrium."""
        if not self.equilibrium.converged:
            return []
        held = self.loads.fixed[:, :3].any(axis=1)
        return find_far_bodies(self.design.flat.layout, self.target, self.equilibrium.pose.centres, held)

    @cached_property
    def torsion_change(self) -> Float[np.ndarray, " joints"]:
        """Absolute difference (m,) between the torsion of every joint and its torsion in the target, radians."""
        aim = target_pose(self.target, self.design.flat.corners)
        here, there = (self.model.torsion(self.model.start(pose)) for pose in (self.equilibrium.pose, aim))
        return np.abs(np.angle(np.exp(1j * (here - there))))

    @property
    def is_locked(self) -> bool:
        """True if a torsion differs from that in the target by more than ``FALSE_MINIMUM_TORSION``."""
        return bool(self.torsion_change.max(initial=0.0) > FALSE_MINIMUM_TORSION)

    @cached_property
    def findings(self) -> list[Finding]:
        """Warnings about the shape, such as: no equilibrium, far from the target, overstrained, about to snap."""
        findings = []
        if not self.equilibrium.converged:
            findings.append(Finding("no-equilibrium", "warning", self.equilibrium.status))
        elif self.is_locked:
            worst = int(np.argmax(self.torsion_change))
            quads = self.model.pairs[worst]
            text = (
                f"The twist of two neighbours against each other differs by {np.degrees(self.torsion_change[worst]):.0f} degrees from that in the target: "
                "probably not the shape that the piece would take. Press Optimise again"
            )
            findings.append(Finding("knotted", "warning", text, tuple(quads[quads < len(self.target.quads)].tolist())))
        far = []
        for piece in self.far_bodies:
            beside = np.unique(self.target.edge_quads[piece.cut_edges])
            faces = tuple((beside if len(beside) else piece.quads).tolist())
            text, code = piece.fault_text + piece.remedy_text, "stays-flat" if piece.is_flat else "far-from-target"
            far.append(Finding(code, "warning", text, faces, tuple(piece.cut_edges.tolist())))
        findings += merge_alike(far)  # one message about several bodies with the same fault, such as two eyes
        alone = np.setdiff1d(np.arange(self.assembly.size), self.assembly.pairs)
        if len(alone):
            text = f"{with_count(len(alone), 'quad is', 'quads are')} joined to no other quad and {'bends' if len(alone) == 1 else 'bend'} nothing: delete such quads, or join them to the others"
            findings.append(Finding("joined-to-nothing", "warning", text, tuple(alone.tolist())))
        for part in self.model.beyond():
            text = (
                f"{with_count(len(part.spirals), 'spiral lies', 'spirals lie')} outside the range of the elastic model ({part}): it computes "
                "with the limit of its range, so the shape is less sure there; change width, twist or quad size to be sure"
            )
            findings.append(Finding("beyond-model", "warning", text, tuple(part.spirals.tolist())))
        strained = np.zeros(0, dtype=int) if self.strain is None else np.flatnonzero(self.strain > OVERSTRAIN_SHARE)
        if self.strain is not None and len(strained):
            text = (
                f"The arms of {with_count(len(strained), 'spiral', 'spirals')} are strained by up to {100.0 * self.strain.max():.0f} % of {self.material.bears}"
                f"{self._strain_note}: they may break or stay bent. Press Optimise, take a thinner sheet, or make the piece larger"
            )
            findings.append(Finding("strained", "warning", text, tuple(strained.tolist())))
        slots = self.slots()
        if slots is not None and len(slots.closed):
            beside = np.unique(slots.arms[slots.closed] // 4)
            text = (
                f"{with_count(len(slots.closed), 'slot closes', 'slots close')} in this shape: arms of {with_count(len(beside), 'spiral', 'spirals')} would touch (the "
                f"model lets them overlap, here by up to {-1e3 * slots.width.min():.2g} mm). In the real piece they press on each other; to open "
                "the slots, wind these spirals less with the brush Twist and Ctrl, then simulate"
            )
            findings.append(Finding("slots-close", "warning", text, tuple(beside.tolist())))
        rests = self.equilibrium, self.others, self.rest_from_target, self.softest, self._strain_at
        return findings + rest_findings(*rests, self.target, self.diagonal)

    def _strain_at(self, rest: Equilibrium) -> Float[np.ndarray, " quads"] | None:
        """Return ``strain`` in the equilibrium ``rest`` of the piece."""
        return self.strain if rest is self.equilibrium else replace(self, equilibrium=rest).strain

    @property
    def _strain_note(self) -> str:
        """Remark in brackets in a message to users: where the strain occurs, and how exact it is."""
        if self.strain is None or not self.material.breaks:
            return " (on their surface, give or take 15 %)"
        at_fillets = 100.0 * FILLET_STRAIN * self.strain.max()
        return f" (on their surface, give or take 15 %; at the fillets of their roots about {at_fillets:.0f} %)"

    @cached_property
    def reactions(self) -> Float[np.ndarray, "quads 3"]:
        """Forces (F, 3) of the supports on the spirals, newtons; 0 for spirals without support."""
        gradient = self.model.expand(self.model.start(self.equilibrium.pose)).gradient
        return np.where(self.loads.fixed[:, :3], gradient[:, :3] - self.loads.force, 0.0)

    @property
    def diagonal(self) -> float:
        """Diagonal of the target's bounding box, metres; percentages in messages are shares of it."""
        return self.target.diagonal

    @cached_property
    def target_distances(self) -> dict[str, float]:
        """Distances from the target, under the keys that they have in the block ``equilibrium`` of report.json."""
        rms, far = float(np.sqrt((self.distance**2).mean())), float(self.distance.max())
        bends = laplacian_rmse(self.assembly.pairs, self.equilibrium.pose.centres, self.target.centroids)
        return {
            "rms_mm": 1e3 * rms,
            "rms_percent": 100.0 * rms / self.diagonal,
            "max_mm": 1e3 * far,
            "max_percent": 100.0 * far / self.diagonal,
            "laplacian_rmse_mm": 1e3 * bends,
        }

    def report(self, progress: Progress = SILENT) -> dict[str, Any]:
        """Return the block ``equilibrium`` of report.json."""
        e, slots = self.equilibrium, self.slots(progress)
        block: dict[str, Any] = {
            "model": self.model.name,
            "material": self.material.name,
            "lasts": "years" if self.material.for_years else "days",
            "converged": e.converged,
            "locked": self.is_locked,
            "status": e.status,
            "iterations": e.iterations,
            "residual": e.residual,
            "negative_eigenvalues": e.negative_eigenvalues,
            "twist_max": e.torsion_max,
            "energy": e.energy,
            **self.target_distances,
        }
        if slots is not None:
            block |= {"slot_min_mm": 1e3 * float(slots.width.min()), "slots_closed": len(slots.closed)}
        if self.strain is not None:
            block["strain_share_max"] = float(self.strain.max())
            if self.material.breaks:
                block["fillet_strain_share_max"] = FILLET_STRAIN * float(self.strain.max())
        if self.findings:
            block["findings"] = [finding.as_dict() for finding in self.findings]
        if self.band is not None:
            block["band"] = self.band.report()
        other = reported_rest(self.equilibrium, self.others, self.rest_from_target)
        if e.converged and other is not None:
            there = replace(self, equilibrium=other)
            block["other_rest"] = {"rms_percent": there.target_distances["rms_percent"]}
            if there.strain is not None:
                block["other_rest"]["strain_share_max"] = float(there.strain.max())
        if self.others:
            block["other_energies"] = [o.energy for o in self.others]
        return block


def build_model(
    assembly: Assembly,
    material: Material,
    name: str,
    *,
    quick: bool = False,
    slopes: bool = True,
    progress: Progress = SILENT,
) -> ElasticModel:
    """Build the elastic model of an assembly.

    Parameters
    ----------
    assembly : spirals and joints at rest
    material : of the sheet
    name : "arm" or "rod"
    quick : leave out the strains' second-order term (see ``arms.curving``), which matters under strong forces only
    slopes : compute the derivatives of the arms' compliances by the design now, for a search for a design; otherwise
        they are computed at their first use
    progress : is updated and can cancel

    Raises
    ------
    FlexMapsError : the rod model is requested for an assembly with a rim
    """
    if name == "rod":
        if assembly.rim is not None:
            raise FlexMapsError(
                "The rod model cannot simulate a rim; take the arm model, or choose Stubs or Left out for the border"
            )
        return RodModel.from_assembly(assembly, material)
    return ArmModel.from_assembly(assembly, material, curving=not quick, slopes=slopes, progress=progress)


@one_thread
def simulate(
    design: SpiralDesign,
    target: QuadMesh,
    material: Material,
    params: SimulateParams,
    *,
    supports: Int[np.ndarray, " some"] | None = None,
    force: Float[np.ndarray, "quads 3"] | None = None,
    start: Pose | None = None,
    quick: bool = False,
    progress: Progress = SILENT,
) -> Simulation:
    """Solve for the shape that a design takes when it is assembled.

    Parameters
    ----------
    design : spirals on flat patches
    target : mesh that the piece should match
    material : of the sheet
    params : settings of the simulation
    supports : (k,) indices of the quads that are held at their places in the target; None to hold none
    force : (F, 3) forces on the spirals, newtons; None for none
    start : pose in which the search for the equilibrium starts; default the target's pose
    quick : leave out the strains' second-order term (see ``arms.curving``), as the optimiser does
    progress : is updated, shows the vertices (V, 3) of the present shape, and can cancel

    Raises
    ------
    FlexMapsError : the loads would carry an unsupported body away, or ``supports`` names spirals that do not exist
    """
    assembly = assembly_from_design(design)
    within = progress.at(0.0, "Computing the stiffness of the arms")
    model = build_model(assembly, material, params.model, quick=quick, slopes=False, progress=within)
    progress(0.0, "Reading the loads")
    mass = design.area * assembly.thickness * material.density if params.gravity else None
    loads = Loads.for_spirals(assembly.size, supports=supports, clamped=params.clamped, force=force, mass=mass)
    support_poses = SupportPoses(loads, target, design.flat.corners)

    def align_to_target(pose: Pose) -> Pose:
        return loads.align(pose, assembly.pairs, support_poses.fitted_pose)

    watched = progress.showing(lambda pose: move_vertices(design, align_to_target(pose), target))
    main = watched.part(0.0, 0.3 if params.restarts else 1.0)
    begin = support_poses.fitted_pose if start is None else support_poses.place_supports(start)
    equilibrium = solve(model, begin, loads, params, main, margins=(SNAP_STIFFNESS,))
    others = other_minima(model, equilibrium, loads, params, watched.part(0.3, 1.0))
    equilibrium, *others = (e.with_pose(align_to_target(e.pose)) for e in (equilibrium, *others))
    return Simulation(design, target, material, model, assembly, loads, equilibrium, others)


def move_vertices(design: SpiralDesign, pose: Pose, mesh: QuadMesh) -> Float[np.ndarray, "vertices 3"]:
    """Return the vertices (V, 3) of a shape in which every flat quad moves rigidly with its hub, metres.

    A vertex gets the mean of the positions that the quads around it would give it.

    Parameters
    ----------
    design : with the flat quads
    pose : of the hubs
    mesh : connects quads and vertices; vertices without a quad keep their positions in it
    """
    local = np.zeros((*mesh.quads.shape, 3))
    corners = design.flat.corners
    local[..., :2] = corners - corners.mean(axis=1, keepdims=True)
    points = pose.centres[:, None] + np.einsum("fij,fkj->fki", pose.rotations, local)
    count = np.bincount(mesh.quads.ravel(), minlength=len(mesh.vertices))
    total = [np.bincount(mesh.quads.ravel(), points[..., k].ravel(), len(mesh.vertices)) for k in range(3)]
    return np.where(count[:, None] > 0, np.stack(total, axis=1) / np.maximum(count, 1)[:, None], mesh.vertices)
