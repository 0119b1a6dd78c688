"""Film of the assembly: panels fly from the table to their places and are joined seam by seam.

A step of the film adds one panel, in the order of ``joining.assembly_steps``. After every few joints the joined panels
are in a stage (``unfinished_pieces``): their equilibrium, floating and without weight. Between two stages hubs turn
evenly, and closed joints stay closed (``pose_blend``). Arms are bent by ``mechanics.arms.bent``; those at a seam that
is being closed gradually take up their final wrench, so that their tips meet when the seam is closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ...arrays import Float, Int
from ...display.panel_mesh import Detail, PanelMesh, make_panel_mesh
from ...fabrication.connectors.tips import Tip
from ...materials import Material
from ...mechanics.arms.bent import TIP_TOLERANCE, Bender
from ...mechanics.assembly import Pose, rest_joints
from ...mechanics.vectors import matvec, nearest_rotation, rotation_vector
from ...params import SimulateParams
from ...patches.joining import assembly_steps
from ...progress import SILENT, Progress
from ...spirals.design import SpiralDesign
from .flight import flight_path, lowest_height
from .pose_blend import PoseBlend, part_means
from .unfinished_pieces import AssemblyStages, UnfinishedPiece, find_stages, flat_panel_pose

# durations of a panel's flight and of its joining, in steps of the film; the next panel flies during joining
FLIGHT_TIME, CLOSING_TIME = 0.6, 0.9
# distance of a panel from its final place when its flight ends, share of the piece's size; larger: more visible joining
HOVER_DISTANCE = 0.15
# panels whose hubs move less than this keep their stored shape; quad edges or radians. Larger: fewer shapes
SHAPE_TOLERANCE = 0.05
# largest deviation from linear motion between shapes, quad edges (smaller: smoother); most shapes of a panel per stage
PATH_TOLERANCE, MAX_SHAPES = 0.05, 8
# largest gap of joined tips between two stages, quad edges, before it is spread along the arms; smaller: slower
TIP_GAP = 1e-3


@dataclass(frozen=True, eq=False)
class PanelTrack:
    """Motion of one panel: its shape and the position of its frame over time; times are in steps of the film.

    vertices : indices of the panel's vertices in the film's mesh
    shapes : vertex positions in the panel's own frame, metres
    shape_times, which : times, and the index into ``shapes`` at each
    times, turns, places : times, and the rotation and position (metres) of the panel's own frame at each
    """

    patch: int
    vertices: Int[np.ndarray, " vertices"]
    shapes: Float[np.ndarray, "shapes vertices 3"]
    shape_times: Float[np.ndarray, " changes"]
    which: Int[np.ndarray, " changes"]
    times: Float[np.ndarray, " times"]
    turns: Float[np.ndarray, "times 3 3"]
    places: Float[np.ndarray, "times 3"]


class Actors(Protocol):
    """Interface of objects in a film: points whose positions follow from the poses of the hubs.

    vertex_quad : the quad to which each point belongs
    """

    @property
    def vertex_quad(self) -> np.ndarray: ...

    def at_pose(
        self, pose: Pose, closed: np.ndarray, wrench: np.ndarray, only: np.ndarray, close: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return points (V, 3), metres, and wrenches (A, 6) of the arms in a pose; arguments as for ``Bender.bend``."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Objects of a film: panels with thickness and bending arms."""

    panels: PanelMesh
    bender: Bender

    @property
    def vertex_quad(self) -> np.ndarray:
        return self.panels.vertex_quad

    def at_pose(
        self, pose: Pose, closed: np.ndarray, wrench: np.ndarray, only: np.ndarray, close: float
    ) -> tuple[np.ndarray, np.ndarray]:
        arms = self.bender.bend(pose, closed, wrench, only, close)
        return self.panels.vertices_at_pose(arms, pose, only), arms.wrench


@dataclass(frozen=True, eq=False)
class FilmTracks:
    """Tracks of all panels.

    tracks : one per panel, in the order of joining
    length : duration, in steps
    stages, stage_times : the unfinished pieces, and the time at which each is reached, in steps
    """

    tracks: tuple[PanelTrack, ...]
    length: float
    stages: AssemblyStages
    stage_times: Float[np.ndarray, " stages"]


@dataclass(frozen=True, eq=False)
class Film(FilmTracks):
    """Tracks of all panels, and the mesh ``panels`` whose vertices they move."""

    panels: PanelMesh


def make_film(
    design: SpiralDesign,
    pose: Pose,
    table: Float[np.ndarray, "patches 3"],
    detail: Detail,
    material: Material,
    params: SimulateParams,
    progress: Progress = SILENT,
    tips: Sequence[Tip] = (),
) -> Film:
    """Return the film of an assembly that ends in a given pose.

    Parameters
    ----------
    design, pose : spirals and panels, and the pose of all hubs at the end
    table : initial position of every patch's origin, metres; panels lie parallel to the xy plane
    detail, tips : detail of the drawn panels, and arm ends with connectors
    material, params : material, and elastic model and solver as in the simulation
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : a spiral is outside the elastic model's range
    """
    found = find_stages(design, pose, material, params, progress.part(0.0, 0.5))
    panels = make_panel_mesh(design, detail, tips)
    bodies = Bodies(panels, Bender.from_design(design))
    shots = record_tracks(design, pose, table, found, bodies, progress.part(0.5, 1.0))
    return Film(shots.tracks, shots.length, shots.stages, shots.stage_times, panels)


def record_tracks(
    design: SpiralDesign,
    pose: Pose,
    table: Float[np.ndarray, "patches 3"],
    found: AssemblyStages,
    actors: Actors,
    progress: Progress = SILENT,
) -> FilmTracks:
    """Return the tracks of ``actors`` from the table through all stages.

    Parameters
    ----------
    design, pose : spirals, and the final pose of their hubs
    table : initial position of the origin of every patch, metres
    found : stages of the assembly, see ``unfinished_pieces``
    actors : objects whose points are moved
    progress : called with the fraction done; may cancel
    """
    order = assembly_steps(design.flat.layout)
    shot = _TrackRecorder(design, actors, table, float(np.linalg.norm(np.ptp(pose.centres, axis=0))))
    for number, step in enumerate(order):
        own = [stage for stage in found.all if stage.step == number]
        shot.fly(number, step.panel, own[0])
        shot.join(number + FLIGHT_TIME, own, progress.part(number / len(order), (number + 1) / len(order)))
    tracks = tuple(shot.reels[step.panel].track() for step in order)
    return FilmTracks(tracks, len(order) - 1 + FLIGHT_TIME + CLOSING_TIME, found, np.array(shot.stage_times))


Moment = tuple[float, np.ndarray, np.ndarray]
"""A time, and the turns (N, 3, 3) and places (N, 3) metres of all panels then."""


@dataclass(eq=False)
class _TrackBuilder:
    """A ``PanelTrack`` under construction."""

    patch: int
    vertices: np.ndarray
    shapes: list[np.ndarray] = field(default_factory=list)
    shape_times: list[float] = field(default_factory=list)
    which: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    turns: list[np.ndarray] = field(default_factory=list)
    places: list[np.ndarray] = field(default_factory=list)

    def bend(self, before: float, time: float, shape: np.ndarray) -> None:
        """Add a shape at ``time``; the panel keeps its last shape until ``before`` and then changes linearly."""
        if self.shapes and self.shape_times[-1] < before - 1e-9:
            self.shape_times.append(before)
            self.which.append(self.which[-1])
        self.shape_times.append(time)
        self.which.append(len(self.shapes))
        self.shapes.append(shape)

    def move(self, time: float, turn: np.ndarray, place: np.ndarray) -> None:
        """Add rotation and position at a time."""
        self.times.append(time)
        self.turns.append(turn)
        self.places.append(place)

    def shape(self, time: float) -> np.ndarray:
        """Return the linearly interpolated shape (n, 3), metres, at a time."""
        after = int(np.searchsorted(self.shape_times, time))
        if after in (0, len(self.shape_times)):
            return self.shapes[self.which[min(after, len(self.which) - 1)]]
        begin, end = self.shape_times[after - 1 : after + 1]
        first, last = (self.shapes[k] for k in self.which[after - 1 : after + 1])
        return first if first is last else first + (time - begin) / (end - begin) * (last - first)

    def track(self) -> PanelTrack:
        """Return the finished track."""
        arrays = (self.shapes, self.shape_times, self.which, self.times, self.turns, self.places)
        return PanelTrack(self.patch, self.vertices, *(np.array(values) for values in arrays))


class _TrackRecorder:
    """State of the film while it is made: the present pose of all hubs, and the last recorded shape of every panel."""

    def __init__(self, design: SpiralDesign, actors: Actors, table: np.ndarray, size: float):
        self.design, self.actors, self.size = design, actors, size
        mesh, self.patch = design.flat.layout.mesh, design.flat.layout.patch_of
        count, inner = len(self.patch), ~mesh.border
        self.edge = mesh.median_edge
        self.pairs, self.lever = mesh.edge_quads[inner], rest_joints(mesh, design.flat.corners)[0]
        flat = np.c_[design.arms.centre, np.zeros(count)]
        self.middle = part_means(flat, self.patch)
        self.table, self.ground = table + self.middle, float(table[:, 2].min()) - 0.5 * design.params.thickness
        self.pose = Pose(flat - self.middle[self.patch], np.broadcast_to(np.eye(3), (count, 3, 3)).copy())
        # in the beginning all panels are flat: only joints inside a panel are closed, and no arm is bent
        self.inside = self.patch[self.pairs[:, 0]] == self.patch[self.pairs[:, 1]]
        self.inside &= ~design.flat.layout.cut[inner]
        self.closed = np.zeros(len(self.pairs), bool)
        self.wrench = np.zeros((4 * count, 6))
        flat_shape, _ = actors.at_pose(self.pose, self.inside, self.wrench, np.ones(count, bool), TIP_TOLERANCE)
        owner = self.patch[actors.vertex_quad]
        self.reels = [_TrackBuilder(p, np.flatnonzero(owner == p)) for p in range(len(table))]
        self.flat_shapes = [flat_shape[reel.vertices] for reel in self.reels]
        # last recorded pose of every hub in the frame of its panel
        self.seen = Pose(self.pose.centres.copy(), self.pose.rotations.copy())
        # motion across joints when the panel on either side was last recorded
        self.over = np.zeros((len(self.pairs), 2, 6))
        self.stage_times: list[float] = []
        self.lift = 0.0

    def fly(self, number: int, panel: int, first: UnfinishedPiece) -> None:
        """Record the flight of a flat panel in step ``number``, from the table to near its place in stage ``first``."""
        hubs = np.flatnonzero(self.patch == panel)
        there = self._with_stage(first)
        dock = flat_panel_pose(self.design, hubs, there)
        turn, place = dock.rotations[0], dock.centres.mean(axis=0)
        alone = len(hubs) == len(first.hubs)
        if alone:
            self.lift = 0.0
        wanted = place + (0.0 if alone else HOVER_DISTANCE * self.size) * turn[:, 2]
        wanted[2] += self.lift
        reel = self.reels[panel]
        start, shape = self.table[panel], self.flat_shapes[panel]
        shares, turns, places = flight_path(start, wanted, turn, self.size, shape, self.ground)
        reel.bend(0.0, number, self.flat_shapes[panel])
        for one in zip(number + FLIGHT_TIME * shares, turns, places, strict=True):
            reel.move(*one)
        off = places[-1] - place - [0.0, 0.0, self.lift]
        self.pose.centres[hubs], self.pose.rotations[hubs] = dock.centres + off, dock.rotations
        self.closed |= self.inside & (self.patch[self.pairs[:, 0]] == panel)
        for p in np.unique(self.patch[first.hubs]).tolist():
            if p != panel:  # panels that are already joined stand still during the flight
                held = self.reels[p]
                held.move(number + FLIGHT_TIME, held.turns[-1], held.places[-1])

    def join(self, start: float, stages: list[UnfinishedPiece], progress: Progress) -> None:
        """Move through the stages of a step, from the time ``start``, at even intervals."""
        long = CLOSING_TIME / len(stages)
        for k, stage in enumerate(stages):
            self._go_to_stage(start + k * long, long, stage, progress.part(k / len(stages), (k + 1) / len(stages)))
            self.stage_times.append(start + (k + 1) * long)

    def _go_to_stage(self, begin: float, long: float, stage: UnfinishedPiece, progress: Progress) -> None:
        """Record the motion from the present pose to a stage, beginning at time ``begin``, during ``long`` steps."""
        end = self._with_stage(stage)
        blend = PoseBlend.between(self.pose, end, self.pairs[self.closed], self.lever[self.closed])
        bending = self._bent_panels(end, stage)
        counts, ways = self._pieces(blend)
        count = int(max(counts[bending].max(initial=1), ways[np.unique(self.patch[stage.hubs])].max()))
        last, wrench = self.actors.at_pose(end, stage.closed, self.wrench, np.isin(self.patch, bending), TIP_TOLERANCE)
        moments: list[Moment] = []
        for k in range(1, count + 1):
            progress((k - 1) / count, "Bending the panels")
            share = k / count
            here = end if k == count else blend.at(share)
            moments.append((begin + share * long, *self._frames(here)))
            some = bending[k * counts[bending] % count == 0]
            if len(some):
                points = last
                if k < count:
                    load = (1.0 - share) * self.wrench + share * wrench
                    points, _ = self.actors.at_pose(here, self.closed, load, np.isin(self.patch, some), TIP_GAP)
                _, turns, places = moments[-1]
                for reel in (self.reels[p] for p in some.tolist()):
                    shape = (points[reel.vertices] - places[reel.patch]) @ turns[reel.patch]
                    reel.bend(begin, begin + share * long, shape)
        self._move(moments, np.unique(self.patch[stage.hubs]).tolist(), stage.whole)
        self._remember(end, bending)
        self.pose, self.closed, self.wrench = end, self.closed | stage.closed, wrench

    def _with_stage(self, stage: UnfinishedPiece) -> Pose:
        """Return the present pose of all hubs, with the hubs of a stage moved to the stage's pose."""
        out = Pose(self.pose.centres.copy(), self.pose.rotations.copy())
        out.centres[stage.hubs], out.rotations[stage.hubs] = stage.pose.centres, stage.pose.rotations
        return out

    def _pieces(self, blend: PoseBlend) -> tuple[np.ndarray, np.ndarray]:
        """Return how many linear pieces approximate each panel's bending, and how many its motion: (N,) powers of two.

        As points move on evenly curved paths, n pieces deviate from the path 1 / n^2 as much as one piece.
        """
        poses = (blend.start, blend.at(0.5), blend.end)
        bending = np.zeros(len(self.reels))
        np.maximum.at(bending, self.patch, _deviation_from_line(*(self._points(pose) for pose in poses)).max(axis=1))
        places = _deviation_from_line(*(self._frames(pose)[1] for pose in poses))
        shapes, ways = (
            2 ** np.ceil(0.5 * np.log2(np.maximum(stray / (PATH_TOLERANCE * self.edge), 1.0))).astype(int)
            for stray in (bending, places)
        )
        return np.minimum(shapes, MAX_SHAPES), np.minimum(ways, 2 * MAX_SHAPES)

    def _points(self, pose: Pose) -> np.ndarray:
        """Return (F, 2, 3) two points of every hub, near its joints, in the frame of its panel, metres."""
        seen = self._relative_to_panels(pose)
        return seen.centres[:, None] + 0.5 * self.edge * np.swapaxes(seen.rotations[:, :, :2], 1, 2)

    def _bent_panels(self, end: Pose, stage: UnfinishedPiece) -> np.ndarray:
        """Return the panels of a stage whose shape has changed since they were last recorded."""
        there = np.unique(self.patch[stage.hubs])
        if stage.whole:
            return there
        seen = self._relative_to_panels(end)
        apart = np.linalg.norm(seen.centres - self.seen.centres, axis=1) / self.edge
        turned = np.linalg.norm(rotation_vector(seen.rotations @ np.swapaxes(self.seen.rotations, 1, 2)), axis=1)
        other = self.patch[np.maximum(apart, turned) > SHAPE_TOLERANCE]
        moved = np.abs(self._across_joints(end)[:, None] - self.over).max(axis=2) > SHAPE_TOLERANCE
        moved[stage.closed & ~self.closed] = True
        moved[~stage.closed] = False
        return np.intersect1d(there, np.concatenate([other, self.patch[self.pairs][moved]]))

    def _move(self, moments: list[Moment], panels: list[int], stands: bool) -> None:
        """Record the positions of panels at several moments, lifted so that none goes below the table.

        stands : whether the piece stands on the table at the last moment, unlifted
        """
        for time, turns, places in moments:
            low = min(float(places[p, 2] + lowest_height(self.reels[p].shape(time), turns[p])) for p in panels)
            # add a small margin, because shapes between the recorded moments are interpolated
            self.lift = max(0.0, self.ground + PATH_TOLERANCE * self.edge - low)
            if stands and time == moments[-1][0]:
                self.lift = 0.0
            for p in panels:
                self.reels[p].move(time, turns[p], places[p] + [0.0, 0.0, self.lift])

    def _remember(self, end: Pose, bending: np.ndarray) -> None:
        """Store a pose as the last recorded pose of the panels ``bending`` (their indices)."""
        quads = np.isin(self.patch, bending)
        seen, over = self._relative_to_panels(end), self._across_joints(end)
        self.seen.centres[quads], self.seen.rotations[quads] = seen.centres[quads], seen.rotations[quads]
        self.over = np.where(quads[self.pairs][..., None], over[:, None], self.over)

    def _frames(self, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Return the rotations (N, 3, 3) and positions (N, 3), metres, that fit the recorded panels to a pose.

        Axes of hubs are fitted as well as centres, so that hubs in a row define an orientation too.
        """
        places = part_means(pose.centres, self.patch)
        spread = self.seen.centres[:, :, None] * (pose.centres - places[self.patch])[:, None]
        spread += (0.5 * self.edge) ** 2 * self.seen.rotations @ np.swapaxes(pose.rotations, 1, 2)
        return nearest_rotation(part_means(spread.reshape(-1, 9), self.patch).reshape(-1, 3, 3)), places

    def _relative_to_panels(self, pose: Pose) -> Pose:
        """Return the pose of every hub in the frame of its panel."""
        turns, places = self._frames(pose)
        back = np.swapaxes(turns, 1, 2)[self.patch]
        return Pose(matvec(back, pose.centres - places[self.patch]), back @ pose.rotations)

    def _across_joints(self, pose: Pose) -> np.ndarray:
        """Return (m, 6) the relative motion at every joint: translation, quad edges, and rotation, radians."""
        first, second = pose.rotations[self.pairs[:, 0]], pose.rotations[self.pairs[:, 1]]
        back, centres = np.swapaxes(first, 1, 2), pose.centres[self.pairs]
        return np.hstack([matvec(back, centres[:, 1] - centres[:, 0]) / self.edge, rotation_vector(back @ second)])


def _deviation_from_line(start: np.ndarray, half: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the distances, metres, of points ``half`` from the midpoints of ``start`` and ``end``."""
    return np.linalg.norm(half - 0.5 * (start + end), axis=-1)
