"""Film of the hubs alone: their motion during the assembly, for renderers that bend the arms themselves (``skin``)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from ...arrays import Float, Int
from ...materials import Material
from ...mechanics.assembly import Pose
from ...mechanics.vectors import nearest_rotation
from ...params import SimulateParams
from ...progress import SILENT, Progress
from ...spirals.design import SpiralDesign
from .assembly_film import CLOSING_TIME, FilmTracks, record_tracks
from .unfinished_pieces import find_stages, stages_without_equilibria


@dataclass(frozen=True, eq=False)
class HubActors:
    """Hubs as objects of a film, by three points each: the centre, and one ``reach`` along each in-plane axis."""

    design: SpiralDesign

    @property
    def reach(self) -> float:
        """Distance from the centre to the points on the axes, metres: about as far as the joints.

        So the points represent the whole panel when it is kept above the table.
        """
        return 0.5 * self.design.flat.layout.mesh.median_edge

    @property
    def vertex_quad(self) -> Int[np.ndarray, " points"]:
        return np.repeat(np.arange(len(self.design.width)), 3)

    def at_pose(
        self, pose: Pose, closed: np.ndarray, wrench: np.ndarray, only: np.ndarray, close: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the points of hubs in a pose, and the wrenches unchanged; arguments as for ``Actors.at_pose``."""
        axes = np.swapaxes(pose.rotations[:, :, :2], 1, 2) * self.reach
        points = np.concatenate([pose.centres[:, None], pose.centres[:, None] + axes], axis=1)
        return points.reshape(-1, 3), wrench

    def poses(self, shapes: Float[np.ndarray, "shapes points 3"]) -> tuple[np.ndarray, np.ndarray]:
        """Return centres (shapes, n, 3) and rotations (shapes, n, 3, 3) of n hubs from their points."""
        points = shapes.reshape(len(shapes), -1, 3, 3)
        x, y = (points[:, :, k] - points[:, :, 0] for k in (1, 2))
        axes = np.stack([x, y, np.cross(x, y) / self.reach], axis=-1)
        return points[:, :, 0], nearest_rotation(np.swapaxes(axes, -1, -2))


def make_hub_film(
    hubs: HubActors,
    pose: Pose,
    table: Float[np.ndarray, "patches 3"],
    material: Material,
    params: SimulateParams,
    progress: Progress = SILENT,
    *,
    resting: bool,
) -> FilmTracks:
    """Return the film of the hubs.

    Parameters
    ----------
    hubs : the hubs of a design
    pose : final pose of the hubs
    table : initial position of every patch's origin, metres
    material, params : material, elastic model and solver for the equilibria of unfinished pieces
    progress : called with the fraction done; may cancel
    resting : whether to compute equilibria of unfinished pieces; if False, every panel arrives in its final shape

    Raises
    ------
    FlexMapsError : a spiral is outside the elastic model's range
    """
    design, part = hubs.design, progress.part(0.0, 0.75)
    found = find_stages(design, pose, material, params, part) if resting else stages_without_equilibria(design, pose)
    return record_tracks(design, pose, table, found, hubs, progress.part(0.75, 1.0))


def closing_times(design: SpiralDesign, shots: FilmTracks) -> Float[np.ndarray, "joints 2"]:
    """Return (m, 2) the times, in steps, at which every inner joint begins to close and is closed.

    Joints inside a panel are closed from the beginning: their times are negative.

    Parameters
    ----------
    design : the spirals
    shots : film of their hubs
    """
    mesh, patch = design.flat.layout.mesh, design.flat.layout.patch_of
    inner = ~mesh.border
    out = np.full((int(inner.sum()), 2), np.inf)
    sides = patch[mesh.edge_quads[inner]]
    out[(sides[:, 0] == sides[:, 1]) & ~design.flat.layout.cut[inner]] = [-1.0, -0.5]
    number = 0
    for _, group in groupby(shots.stages.all, key=lambda stage: stage.step):
        own = list(group)
        for stage in own:
            end = float(shots.stage_times[number])
            new = stage.closed & np.isinf(out[:, 0])
            out[new] = [end - CLOSING_TIME / len(own), end]
            number += 1
    return out
