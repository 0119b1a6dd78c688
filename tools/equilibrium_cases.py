"""Test assemblies for the equilibrium: designs of meshes, smooth objects of any number of spirals, single rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.materials import material
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Assembly, Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.rods.rod_model import RodModel
from flexmaps.engine.mechanics.rods.rod_stiffness import rod_parameters
from flexmaps.engine.params import LayoutParams, Settings, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.runs import job
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.curves.spiral import same_width
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.curvature import rms_curvature
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from harness import EDGE
from scipy.spatial.transform import Rotation

MATERIAL = material("vero")


@dataclass(frozen=True, eq=False)
class Subject:
    """Subject of an equilibrium: spirals and joints, both models of them, the pose in the target.

    outside : number of spirals outside the rod model's parameters; they get the median ones
    """

    name: str
    assembly: Assembly
    arm: ArmModel
    rod: RodModel
    outside: int
    pose: Pose

    @property
    def size(self) -> float:
        """Metres, the diagonal of the box around the hubs."""
        return float(np.linalg.norm(np.ptp(self.pose.centres, axis=0)))


def subject(name: str, assembly: Assembly, pose: Pose) -> Subject:
    rod, outside = rods(assembly)
    return Subject(name, assembly, ArmModel.from_assembly(assembly, MATERIAL), rod, outside, pose)


def rods(assembly: Assembly) -> tuple[RodModel, int]:
    """The rod model, with median parameters for spirals outside its range; and how many these are."""
    arms = np.bincount(assembly.pairs.ravel(), minlength=assembly.size)
    scale = 2.0 * np.bincount(assembly.pairs.ravel(), assembly.radius.ravel(), assembly.size) / arms
    inside = np.arange(assembly.size)
    while True:
        try:
            found = rod_parameters(
                scale[inside],
                assembly.width[inside].mean(axis=1),
                assembly.twist[inside],
                thickness=assembly.thickness,
                youngs=MATERIAL.youngs,
            )
            break
        except FlexMapsError as error:
            inside = np.delete(inside, error.faces)
    parameters = np.tile(np.median(found.values, axis=0), (assembly.size, 1))
    parameters[inside] = found.values
    return RodModel.with_parameters(assembly, parameters), assembly.size - len(inside)


def of_mesh(name: str, polygons: PolygonMesh) -> Subject:
    """The curvature-adjusted design of a mesh in its merged patches, of whatever size; raises FlexMapsError if refused."""
    result = job.run(polygons, Settings(), edge=EDGE, stop_after="merge")
    assert result.flat is not None
    spirals = fabricable.design_from_curvature(result.flat, SpiralParams(), rms_curvature(result.mesh))
    return subject(name, assembly_from_design(spirals), target_pose(result.mesh, result.flat.corners))


def of_shape(name: str, mesh: QuadMesh, *, twist: float = 1.5) -> Subject:
    """Equal spirals in the traced patches of a smooth surface, as it is: quick for any number of quads."""
    mesh = mesh.moved(mesh.vertices * (EDGE / mesh.median_edge))
    flat = flatten.flatten(trace.trace(mesh, LayoutParams()), LayoutParams())
    spirals = fabricable.uniform_design(flat, SpiralParams(), twist=twist)
    return subject(name, assembly_from_design(spirals), target_pose(mesh, flat.corners))


def torus(count: int) -> Subject:
    """A torus of about ``count`` spirals. Its long strips are flattened with strains at the limit, so that it buckles."""
    across = round(np.sqrt(count / 2.5))
    return of_shape(f"torus {count}", shapes.torus(round(2.5 * across), across))


def dome(count: int) -> Subject:
    """Half a sphere of about ``count`` spirals."""
    return of_shape(f"dome {count}", shapes.dome(2 * round(0.5 * np.sqrt(count / 3.0))))


def straight_row(count: int) -> Subject:
    """Spirals with straight arms side by side along x, their patches' normals up."""
    pairs = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    lever = np.zeros((count - 1, 2, 3))
    lever[:, 0, 0], lever[:, 1, 0] = 0.5 * EDGE, -0.5 * EDGE
    axes, full = np.broadcast_to(np.eye(3), (count - 1, 2, 3, 3)), np.ones(count)
    sides = np.tile([1, 3], (len(pairs), 1))
    assembly = Assembly(pairs, sides, lever, axes, same_width(0.0015 * full), 0.0 * full, 0.002)
    centres = np.zeros((count, 3))
    centres[:, 0] = EDGE * np.arange(count)
    return subject("row", assembly, Pose(centres, np.tile(np.eye(3), (count, 1, 1))))


def shaken(pose: Pose, shift: float, turn: float, seed: int) -> Pose:
    """Every hub shifted and turned at random: standard deviations in metres and radians per axis."""
    noise = np.random.default_rng(seed).normal(size=(len(pose.centres), 6))
    return pose.moved(noise * np.repeat([shift, turn], 3))


def turned(pose: Pose) -> Pose:
    """Return the pose after a rigid motion."""
    return pose.transform(Rotation.from_rotvec([2.0, -1.0, 0.4]).as_matrix(), np.array([3.0, -1.0, 2.0]))
