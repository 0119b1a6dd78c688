"""The shape of every arm in an assembled piece: which way each of its sections has gone and how it is turned.

The hubs are rigid and stand where a pose has them. Both arms of a joint are one elastic beam from hub to hub: they carry
the same wrench, and their tips meet in one frame. The arm's sections bend, twist, stretch and shear as the wrench asks
(Castigliano's beam, as in ``beams``), with the wrench's moments taken along the flat arm; its kinematics are those of
finite turns. So arms that wind round their hub turn all along their way, and nothing but the small stretch of the beam
changes their length. Young's modulus has no part in it: only the poses count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Bool, Float, Int
from ...materials import Material
from ...progress import SILENT, Progress
from ...spirals.design import SpiralDesign
from ...spirals.spiral import centre_line, width_at
from ..assembly import Pose, rest_joints
from ..vectors import exponential, rotation_vector, skew, times
from .bent_rim import RimPieces, rim_pieces
from .pieces import POISSON, STATIONS, Grain, answers

ROUNDS = 12  # of Newton's method; what is left then is spread along the arms
# where Newton's method ends, relative to the size of a spiral: one step more is taken, and the rest is spread
CLOSE = 1e-6
BATCH = 400  # joints at a time, so that they stay in the processor's cache
BENDING = "Bending the arms"  # what the progress says
_LARGEST = 0.5  # radians that a joint turns at most in one round


@dataclass(frozen=True, eq=False)
class BentArms:
    """The deformation of A = 4 F arms; arm 4 f + k is arm k of quad f. Stations go from the hub, 0, to the tip, S.

    Behind them come those of the rim's nodes, four for each, see ``mechanics.rim``.

    A point of the flat arm, P in the frame of its patch, that lies at right angles to the centre line c at t goes to
    x(t) + D(t) (P - c(t)).

    hub : (A,) t where the arm leaves its rigid hub; it is 0 at the tip
    flat : (A, S + 1, 3) metres, the flat centre line, seen from the hub's centre
    place : (A, S + 1, 3) metres, x in space; turn : (A, S + 1, 3, 3), D
    bend : (A, S, 3) radians, by how much D turns over every piece, in the flat frame
    stretch : (A, S, 3) metres, what the way of x over every piece is longer than that of c, in the flat frame turned half way
    wrench : (A, 6) force and moment at the tip in the joint's axes, for a Young's modulus of 1 Pa
    """

    hub: Float[np.ndarray, " arms"]
    flat: Float[np.ndarray, "arms _ 3"]
    place: Float[np.ndarray, "arms _ 3"]
    turn: Float[np.ndarray, "arms _ 3 3"]
    bend: Float[np.ndarray, "arms stations 3"]
    stretch: Float[np.ndarray, "arms stations 3"]
    wrench: Float[np.ndarray, "arms 6"]

    def at(
        self, arm: np.ndarray, t: Float[np.ndarray, " nodes"], flat: Float[np.ndarray, "nodes 3"]
    ) -> tuple[np.ndarray, np.ndarray]:
        """x (N, 3) metres and D (N, 3, 3) of arms (N,) at t (N,), where the flat centre lines are at ``flat`` (N, 3)."""
        count = self.bend.shape[1]
        hub = np.maximum(self.hub[arm], 1e-9)  # spirals that are wound too far for their settings are hub to the tip
        way = np.clip(1.0 - t / hub, 0.0, 1.0) * count
        piece = np.minimum(way.astype(int), count - 1)
        share = way - piece
        half = exponential(0.5 * share[:, None] * self.bend[arm, piece])
        turn = self.turn[arm, piece] @ half
        chord = flat - self.flat[arm, piece] + share[:, None] * self.stretch[arm, piece]
        # the hub's own part is rigid
        chord = np.where((t >= self.hub[arm])[:, None], flat - self.flat[arm, 0], chord)
        return self.place[arm, piece] + times(turn, chord), turn @ half

    def first(self, count: int) -> BentArms:
        """The first arms alone."""
        return BentArms(*(getattr(self, name)[:count] for name in self.__dataclass_fields__))

    @property
    def tips(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (A, 3) and turns (A, 3, 3) of the tips."""
        return self.place[:, -1], self.turn[:, -1]


@dataclass(frozen=True, eq=False)
class _Pieces:
    """What the arms are, piece by piece: ``hub`` and ``flat`` as in ``BentArms``, and how they answer to a wrench.

    answer : (A, S, 6, 6) bend and stretch of every piece per wrench at the tip, in the joint's axes
    """

    hub: np.ndarray
    flat: np.ndarray
    answer: Float[np.ndarray, "arms stations 6 6"]


def flat_centre(
    design: SpiralDesign, quad: np.ndarray, side: np.ndarray, t: Float[np.ndarray, "nodes _"]
) -> Float[np.ndarray, "nodes _ 3"]:
    """(N, M, 3) metres: centre lines of single arms (N,) at t (N, M), seen from their hubs' centres."""
    out = np.zeros((*t.shape, 3))
    shape = design.arms.one_by_one(quad, side)
    out[..., :2] = centre_line(shape, t[:, None])[0][:, 0] - shape.centre[:, None]
    return out


def hub_ends(design: SpiralDesign) -> Float[np.ndarray, "quads 4"]:
    """(F, 4) t where every arm leaves its hub: before both of its slots have ended, so that the hub is rigid."""
    root = design.roots
    return 0.985 * np.minimum(root.left, np.roll(root.right, 1, axis=1))


def bent(
    design: SpiralDesign,
    pose: Pose,
    *,
    closed: Bool[np.ndarray, " joints"] | None = None,
    wrench: Float[np.ndarray, "arms 6"] | None = None,
    material: Material | None = None,
    progress: Progress = SILENT,
) -> BentArms:
    """The arms of a design whose hubs stand in a pose.

    closed : (m,) bool, the joints, in the order of the inner edges, whose tips meet; all if not given
    wrench : (A, 6) as in ``BentArms``, at the tips of the others, and where the search for those of the joints begins;
        none if not given
    material : its Poisson's ratio and its grain count; else ``POISSON``
    """
    progress(0.0, BENDING)
    return Bender.of(design, material).bent(pose, closed, wrench, progress=progress.part(0.2, 1.0))


@dataclass(frozen=True, eq=False)
class Bender:
    """What bending the arms of a design has in common for all poses.

    arm : (m, 2) int, the arms of every joint; axes : (A, 3, 3) of the arms' joints in the flat frames of their patches
    size : metres, of a spiral; rim : the joints of the rim, if there is one
    """

    pieces: _Pieces
    arm: Int[np.ndarray, "joints 2"]
    axes: Float[np.ndarray, "arms 3 3"]
    size: float
    rim: RimPieces | None = None

    @classmethod
    def of(cls, design: SpiralDesign, material: Material | None = None) -> Bender:
        mesh = design.flat.layout.mesh
        inner = np.flatnonzero(~mesh.border)
        arm = 4 * mesh.edge_quads[inner] + mesh.edge_sides[inner]
        axes = np.broadcast_to(np.eye(3), (4 * len(mesh.quads), 3, 3)).copy()
        axes[arm] = rest_joints(mesh, design.flat.corners)[1]
        size = float(np.median(design.scale))
        if design.rim is None:
            return cls(_pieces(design, axes, material), arm, axes, size)
        rim = rim_pieces(design, material)
        axes = np.concatenate([axes, np.broadcast_to(np.eye(3), (4 * rim.nodes, 3, 3))])
        axes[rim.arm] = rim.axes
        own = _pieces(design, axes[: 4 * len(mesh.quads)], material)
        more = rim.answer @ _both(axes[4 * len(mesh.quads) :])[:, None]
        parts = zip((own.hub, own.flat, own.answer), (np.ones(len(more)), rim.flat, more), strict=True)
        return cls(_Pieces(*(np.concatenate(pair) for pair in parts)), arm, axes, size, rim)

    def bent(
        self,
        pose: Pose,
        closed: np.ndarray | None = None,
        wrench: np.ndarray | None = None,
        only: Bool[np.ndarray, " quads"] | None = None,
        close: float = CLOSE,
        progress: Progress = SILENT,
    ) -> BentArms:
        """As the function ``bent``; the search for the closed joints' wrenches begins with those given.

        only : (F,) bool, quads whose arms are asked for; of the others' arms nothing but zeros comes back
        close : how near it brings the tips, relative to the size of a spiral, before the rest is spread along the arms
        """
        load = np.zeros((len(self.axes), 6))
        if wrench is not None:
            load[: len(wrench)] = wrench
        both = self.arm if closed is None else self.arm[closed]
        some = np.arange(len(load))
        if self.rim is not None:
            both = np.concatenate([both, self.rim.arm])
            pose = self.rim.settled(pose).whole
            only = None if only is None else np.concatenate([only, only[self.rim.hub]])
        if only is not None:
            both = both[only[both // 4].any(axis=1)]
            some = np.union1d(some[np.repeat(only, 4)], both)
        # some hundred joints at a time stay in the processor's cache
        for batch in progress.part(0.0, 0.6).batches(len(both), BATCH, BENDING):
            _close(self.pieces, pose, self.axes, load, both[batch], close * self.size)
        progress(0.6, BENDING)
        shaped = _shaped(self.pieces, pose, load, some)
        progress(0.8, BENDING)
        return _met(shaped, both, self.axes, some)


def _close(pieces: _Pieces, pose: Pose, axes: np.ndarray, load: np.ndarray, joint: np.ndarray, close: float) -> None:
    """Find the wrenches (A, 6) that bring the tips of joints (m, 2), arms in pairs, as near to each other as ``close`` metres."""
    for _ in range(ROUNDS):
        some = joint.ravel()
        tip, turn, yielding = _tips(pieces, some, pose, load[some])
        step, miss = _newton(tip, turn @ axes[some], yielding)
        load[joint[:, 0]] += step
        load[joint[:, 1]] -= step
        joint = joint[miss > close]
        if not len(joint):
            break


def _pieces(design: SpiralDesign, axes: Float[np.ndarray, "arms 3 3"], material: Material | None) -> _Pieces:
    """All arms in pieces that are equally long in t; axes (A, 3, 3) of their joints in the flat frames of their patches."""
    count = design.arms.radius.shape
    hub = hub_ends(design)
    step = np.linspace(1.0, 0.0, 2 * STATIONS + 1)
    t = hub[..., None] * step
    points, speed, _ = centre_line(design.arms, t)
    flat = np.zeros((*count, STATIONS + 1, 3))
    flat[..., :2] = points[:, :, ::2] - design.arms.centre[:, None, None]
    middle = np.zeros((*count, STATIONS, 3))
    middle[..., :2] = points[:, :, 1::2] - design.arms.centre[:, None, None]
    velocity = speed[:, :, 1::2]
    pace = np.linalg.norm(velocity, axis=-1)
    length = pace * (hub / STATIONS)[..., None]
    tangent = np.zeros_like(middle)
    tangent[..., :2] = -velocity / pace[..., None]  # outwards, from the hub to the tip
    width = width_at(design.arms, t[:, :, 1::2])[0]
    known = None if material is None else material.orthotropy
    grain = None if material is None or known is None else Grain(known, design.params.grain, material.youngs)
    answer = answers(
        (flat[:, :, -1:] - middle).reshape(-1, STATIONS, 3),
        tangent.reshape(-1, STATIONS, 3),
        length.reshape(-1, STATIONS),
        width.reshape(-1, STATIONS),
        design.params.thickness,
        POISSON if material is None else material.poisson,
        grain,
    )
    return _Pieces(hub.ravel(), flat.reshape(-1, STATIONS + 1, 3), answer @ _both(axes)[:, None])


def _both(axes: Float[np.ndarray, "arms 3 3"]) -> Float[np.ndarray, "arms 6 6"]:
    """Axes for forces and for moments."""
    turned = np.zeros((len(axes), 6, 6))
    turned[:, :3, :3] = turned[:, 3:, 3:] = axes
    return turned


def _run(
    flat: np.ndarray, rotations: np.ndarray, centres: np.ndarray, bend: np.ndarray, stretch: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n, S + 1, 3) and turns (n, S + 1, 3, 3) of the stations, and turns half way between them (n, S, 3, 3)."""
    half = exponential(0.5 * bend)
    whole = half @ half
    turn = np.empty((len(flat), STATIONS + 1, 3, 3))
    turn[:, 0] = rotations
    for k in range(STATIONS):
        np.matmul(turn[:, k], whole[:, k], out=turn[:, k + 1])
    middle = turn[:, :-1] @ half
    place = np.empty_like(flat)
    place[:, 0] = centres + times(rotations, flat[:, 0])
    place[:, 1:] = place[:, :1] + np.cumsum(times(middle, np.diff(flat, axis=1) + stretch), axis=1)
    return place, turn, middle


def _tips(pieces: _Pieces, arm: np.ndarray, pose: Pose, load: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n, 3) and turns (n, 3, 3) of the tips of some arms (n,), and how they yield to their wrench (n, 6, 6), in space."""
    answer, flat = pieces.answer[arm], pieces.flat[arm]
    strain = (answer @ load[:, None, :, None])[..., 0]
    place, turn, middle = _run(flat, pose.rotations[arm // 4], pose.centres[arm // 4], strain[..., :3], strain[..., 3:])
    turning, going = middle @ answer[:, :, :3], middle @ answer[:, :, 3:]
    lever = place[:, -1:] - 0.5 * (place[:, 1:] + place[:, :-1])
    # what a turn of a piece shifts at the tip: turn x lever
    shift = (going - skew(lever) @ turning).sum(axis=1)
    return place[:, -1], turn[:, -1], np.concatenate([shift, turning.sum(axis=1)], axis=1)


def _newton(tip: np.ndarray, frame: np.ndarray, yielding: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What to add to the wrench (m, 6) of the first arms, for tips (2 m, ...) in pairs, and what still misses (m,)."""
    apart = rotation_vector(np.swapaxes(frame[::2], 1, 2) @ frame[1::2])
    middle = frame[::2] @ exponential(0.5 * apart)
    miss = np.concatenate([tip[1::2] - tip[::2], times(middle, apart)], axis=1)
    large = np.linalg.norm(apart, axis=1)
    share = np.minimum(1.0, _LARGEST / np.maximum(large, 1e-12))
    # the arms' stiffness spans decades: lengths in tips' own units keep the solution exact
    both = yielding[::2] + yielding[1::2]
    unit = np.sqrt(np.abs(np.einsum("mii->mi", both)))
    rigid = unit == 0.0  # arms that are hub to the tip: no wrench moves them
    unit = np.where(rigid, 1.0, unit)
    both = both / (unit[:, :, None] * unit[:, None]) + rigid[:, None] * np.eye(6)
    step = np.where(rigid, 0.0, np.linalg.solve(both, (miss / unit)[..., None])[..., 0] / unit)
    return share[:, None] * step, np.linalg.norm(miss[:, :3], axis=1) + np.linalg.norm(miss[:, 3:], axis=1) * 1e-3


def _shaped(pieces: _Pieces, pose: Pose, load: np.ndarray, some: Int[np.ndarray, " arms"]) -> BentArms:
    """Arms ``some`` (n,) under loads (A, 6); zeros for the others."""
    strain = (pieces.answer[some] @ load[some, None, :, None])[..., 0]
    bend, stretch = np.ascontiguousarray(strain[..., :3]), np.ascontiguousarray(strain[..., 3:])
    place, turn, _ = _run(pieces.flat[some], pose.rotations[some // 4], pose.centres[some // 4], bend, stretch)
    place, turn, bend, stretch = (_spread(values, some, len(load)) for values in (place, turn, bend, stretch))
    return BentArms(pieces.hub, pieces.flat, place, turn, bend, stretch, load)


def _spread(values: np.ndarray, some: np.ndarray, count: int) -> np.ndarray:
    if len(some) == count:
        return values
    out = np.zeros((count, *values.shape[1:]))
    out[some] = values
    return out


def _met(arms: BentArms, joint: np.ndarray, axes: np.ndarray, some: np.ndarray) -> BentArms:
    """The same with tips that meet to the last digit, joints (m, 2): what is left is spread evenly along both arms.

    So joints that no beam can close, of poses that are torn apart, are closed as well.
    """
    place, turn = arms.place.copy(), arms.turn.copy()
    tip, frame = place[:, -1], turn[:, -1] @ axes
    first, second = joint.T
    apart = rotation_vector(np.swapaxes(frame[first], 1, 2) @ frame[second])
    middle, meeting = frame[first] @ exponential(0.5 * apart), 0.5 * (tip[first] + tip[second])
    share = np.linspace(0.0, 1.0, STATIONS + 1)[None, :, None]
    for which in (first, second):
        left = rotation_vector(middle @ np.swapaxes(frame[which], 1, 2))
        twisted = exponential(share * left[:, None])
        away = place[which] - tip[which][:, None]
        place[which] += share * (meeting - tip[which])[:, None] + times(twisted, away) - away
        turn[which] = twisted @ turn[which]
        place[which, -1] = meeting
        turn[which, -1] = middle @ np.swapaxes(axes[which], 1, 2)
    own = turn[some]
    between = np.swapaxes(own[:, :-1], 2, 3) @ own[:, 1:]
    bend = rotation_vector(between.reshape(-1, 3, 3)).reshape(-1, STATIONS, 3)
    half = own[:, :-1] @ exponential(0.5 * bend)
    stretch = times(np.swapaxes(half, 2, 3), np.diff(place[some], axis=1)) - np.diff(arms.flat[some], axis=1)
    count = len(turn)
    return replace(arms, place=place, turn=turn, bend=_spread(bend, some, count), stretch=_spread(stretch, some, count))
