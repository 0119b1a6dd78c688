"""Snapshots of an optimisation, for display."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from ..arrays import Float
from ..simulation.simulate import Simulation, move_vertices
from ..spirals.design import SpiralDesign
from ..surface.mesh import QuadMesh
from .inverse import DesignPoint
from .task import Task


@dataclass(frozen=True, eq=False)
class OptimisationStep:
    """Snapshot of an optimisation after a step, for display.

    vertices : (V, 3) metres, the target's vertices moved with the hubs; width : (F, 4) metres; twist : (F,) radians
    distance : metres, RMS distance of the spirals' centres from the target; step : number of steps so far
    """

    vertices: Float[np.ndarray, "vertices 3"]
    width: Float[np.ndarray, "quads 4"]
    twist: Float[np.ndarray, " quads"]
    distance: float
    step: int

    @classmethod
    def from_point(cls, point: DesignPoint, design: SpiralDesign, target: QuadMesh, step: int) -> Self:
        """Return the snapshot of a point after ``step`` steps; align bodies that nothing holds with the target."""
        vertices = move_vertices(design, point.problem.target.align_pose(point.equilibrium.pose), target)
        return cls(vertices, *point.width_and_twist, point.distance_metres, step)

    @classmethod
    def from_simulation(cls, given: Simulation, task: Task) -> Self:
        """Return the snapshot of the given design, before the first step."""
        aim = task.build_target(given.assembly)
        distance = aim.unit_length * aim.relative_distance(given.equilibrium.pose)
        return cls(given.vertices, given.design.width, given.design.twist, distance, 0)
