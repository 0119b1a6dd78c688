"""Test pieces for load paths: a column, an arch and a dome of few spirals; and their load paths with solid models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flexmaps.database.design_mesh import UNIT
from flexmaps.database.design_solid import DesignSolid
from flexmaps.database.validation_cases import MATERIAL, SIDE, cells, grid_mesh, sheet, shell
from flexmaps.engine.extras.structure.actions import Action
from flexmaps.engine.extras.structure.load_path import LoadPath, PathFollower, follow_path
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.equilibrium import Equilibrium, solve
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.params import SimulateParams
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.mesh import QuadMesh

PARAMS = SimulateParams(tolerance=1e-9)  # tighter than usual, so that no figure depends on it


@dataclass(frozen=True, eq=False)
class Pushed:
    """A piece that is held at some hubs and pushed down by one newton in all, shared by those in its ``middle``."""

    name: str
    design: SpiralDesign
    model: ArmModel
    loads: Loads
    middle: list[int]
    rest: Equilibrium

    @classmethod
    def of(cls, name: str, design: SpiralDesign, held: np.ndarray, middle: list[int]) -> Pushed:
        mesh = design.flat.layout.mesh
        model, loads = (
            ArmModel.from_assembly(assembly_from_design(design), MATERIAL),
            Loads.for_spirals(len(mesh.quads), supports=held),
        )
        return cls(
            name, design, model, loads, middle, solve(model, target_pose(mesh, design.flat.corners), loads, PARAMS)
        )

    @property
    def action(self) -> Action:
        action = Action.none(len(self.design.width))
        action.force[self.middle, 2] = -1.0 / len(self.middle)
        return action

    @property
    def follower(self) -> PathFollower:
        system = NewtonSystem(self.model.pairs, self.loads.held_increments(self.model.pairs, self.rest.pose.centres))
        return PathFollower(self.model, system, self.action, PARAMS.tolerance)

    def path(self, most: float, marks: tuple[float, ...] = ()) -> LoadPath:
        return follow_path(self.follower, self.rest.pose, most=most, marks=marks)

    def fall(self, pose: Pose) -> float:
        """Metres, of the middle from its rest."""
        return float((self.rest.pose.centres - pose.centres)[self.middle, 2].mean())

    @property
    def lowered(self) -> Loads:
        """Supports that hold the middle's height too."""
        fixed = self.loads.fixed.copy()
        fixed[self.middle, 2] = True
        return Loads(fixed, np.zeros((len(fixed), 3)))

    def at_fall(self, start: Pose, fall: float) -> Pose:
        """The pose with the middle held so far below its rest, from one nearby."""
        step = np.zeros((len(self.design.width), 6))
        step[self.middle, 2] = self.rest.pose.centres[self.middle, 2] - fall - start.centres[self.middle, 2]
        return solve(self.model, start.moved(step), self.lowered, PARAMS).pose


def arch(half: float = 0.93) -> Pushed:
    """Two rows of nine spirals, bent to an arc of twice this angle, clamped at both ends and pushed in the middle."""
    columns, rows = 9, 2
    points, quads = grid_mesh(columns, rows)
    angle, radius = (points[:, 0] / columns - 0.5) * 2.0 * half, columns / (2.0 * half)
    mesh = QuadMesh(SIDE * np.column_stack([radius * np.sin(angle), points[:, 1], radius * np.cos(angle)]), quads)
    design = shell(mesh, np.zeros(len(mesh.edges), bool), 1.5, 150.0)
    ends = np.array([row * columns + column for row in range(rows) for column in (0, columns - 1)])
    return Pushed.of("arch 2 x 9", design, ends, [row * columns + columns // 2 for row in range(rows)])


def dome(count: int = 8, height: float = 0.15, width: float = 1.5, twist: float = 120.0) -> Pushed:
    """A cap over a square, of four panels that meet at its top, clamped along its border and pushed at the four hubs there.

    height : of a quad's side, how much it curves; width, twist : mm and degrees
    """
    points, quads = grid_mesh(count, count)
    x, y = (points - 0.5 * count).T
    mesh = QuadMesh(SIDE * np.column_stack([x, y, height * (0.5 * count**2 - x * x - y * y)]), quads)
    flat = [np.abs(mesh.vertices[mesh.edges][..., k]).max(axis=1) < 1e-9 for k in (0, 1)]
    design = shell(mesh, flat[0] | flat[1], width, twist)
    column, row = cells(count, count).T
    border = (column == 0) | (column == count - 1) | (row == 0) | (row == count - 1)
    top = np.isin(column, (count // 2 - 1, count // 2)) & np.isin(row, (count // 2 - 1, count // 2))
    return Pushed.of(f"dome {count} x {count}", design, np.flatnonzero(border), np.flatnonzero(top).tolist())


def by_solid(piece: Pushed, falls: np.ndarray) -> np.ndarray:
    """Newtons with which the middle of a piece's solid is pushed at these falls (k,) metres, rising; not a number where none was found."""
    loads = piece.lowered
    held = np.flatnonzero(loads.fixed.any(axis=1))
    solid = DesignSolid(piece.design, MATERIAL.poisson, held.tolist())
    none, pose, out = np.zeros_like(solid.mesh.nodes), piece.rest.pose, []
    at = np.isin(held, piece.middle)
    for fall in falls:
        pose = piece.at_fall(pose, float(fall))
        found = solid.solve(solid.guess(pose), pose, none, loads.fixed[held])
        force = -float(found.reactions[at, 2].sum()) * MATERIAL.youngs * UNIT**2
        out.append(force if found.converged else np.nan)
    return np.array(out)


def turned_pair(width: float, twist: float, axis: tuple[float, float, float], angles: tuple[float, ...]) -> list[float]:
    """Return the relative error of the model's energy of two joined spirals against the solid, for these rotations of the second.

    width, twist : mm and degrees; axis : across the joint, along it, normal; angles : radians, rising. The second one may shift.
    """
    design = sheet(2, 1, width, twist)
    model, fixed = ArmModel.from_assembly(assembly_from_design(design), MATERIAL), np.ones((2, 6), dtype=bool)
    fixed[1, :3] = False
    solid, loads = DesignSolid(design, MATERIAL.poisson, [0, 1]), Loads(fixed, np.zeros((2, 3)))
    pose, last, off = target_pose(design.flat.layout.mesh, design.flat.corners), 0.0, []
    for angle in angles:
        step = np.zeros((2, 6))
        step[1, 3:], last = (angle - last) * np.array(axis), angle
        pose = solve(model, pose.moved(step), loads, PARAMS).pose
        found = solid.solve(solid.guess(pose), pose, np.zeros_like(solid.mesh.nodes), fixed)
        energy = found.energy * MATERIAL.youngs * UNIT**3 if found.converged else np.nan
        off.append(model.energy(model.start(pose)) / energy - 1.0)
    return off
