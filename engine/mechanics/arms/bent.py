"""The shape of every arm in an assembled piece: position and rotation of its cross-sections.

The hubs are rigid, at the positions and rotations of a pose. Both arms of a joint form one elastic beam from hub to
hub: they carry equal and opposite wrenches, and their tips coincide. The sections bend, twist, stretch and shear under
the wrench (Castigliano's beam, as in ``beams``). Moments are computed on the flat arm, positions with finite rotations,
so that the length of an arm changes only by the small stretch of the beam. Young's modulus has no influence: the pose
alone determines the shape.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Bool, Columns, Float, Int
from ...materials import Material
from ...progress import SILENT, Progress
from ...spirals.curves.spiral import centre_line, opposite_sides, width_at
from ...spirals.design import SpiralDesign
from ..assembly import Pose, rest_joints
from ..vectors import matvec, rotation_matrix, rotation_vector, skew
from .bent_rim import RimPieces, rim_pieces
from .pieces import POISSON, STATIONS, Grain, piece_flexibilities
from .stacked import BATCH
from .tip_closing import newton_step

# Largest number of Newton iterations that bring the two tips of a joint together; the gap that remains is spread along
# both arms. More are slower and more exact
ROUNDS = 12
# Gap between the two tips of a joint, relative to the size of a spiral, below which only one more Newton step follows.
# The gap that then remains is spread along the arms. Larger is faster and less exact (at this value: 0.3 nanometres).
TIP_TOLERANCE = 1e-4
BENDING = "Bending the arms"  # message that the progress bar shows


@dataclass(frozen=True, eq=False)
class BentArms(Columns):
    """The deformation of A arms, at stations 0 (where the arm leaves its hub) to S (the tip).

    Arm 4 f + k is arm k of quad f. After the arms of all quads follow those of the rim's nodes, four per node (see
    ``mechanics.rim_bodies``). A section is given by t: 0 at the tip, 1 at the hub's centre. A point P of the flat arm
    in the section at the point c(t) of the centre line moves to x(t) + D(t) (P - c(t)). P and c are in the frame of the
    flat patch, x in space.

    hub : (A,) t where the arm leaves its rigid hub
    flat : (A, S + 1, 3) metres, the flat centre line c, relative to the hub's centre
    place : (A, S + 1, 3) metres, positions x
    turn : (A, S + 1, 3, 3), rotations D
    bend : (A, S, 3) radians, rotation vector between the D of one station and of the next, in the frame of the patch
    stretch : (A, S, 3) metres, vector between the x of one station and of the next, rotated back by the mean D of both,
        minus the vector between their c
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
        """Return position and rotation of N sections, each on any arm.

        Parameters
        ----------
        arm, t : (N,) index of the arm and position of the section on it, 0 at the tip
        flat : (N, 3) metres, points c of the flat centre lines at ``t``

        Returns
        -------
        (N, 3) metres and (N, 3, 3) : x and D, as in ``BentArms``
        """
        count = self.bend.shape[1]
        # ``hub`` is 0 for arms with so much twist that no slot is left: they are rigid up to the tip
        hub = np.maximum(self.hub[arm], 1e-9)
        way = np.clip(1.0 - t / hub, 0.0, 1.0) * count
        piece = np.minimum(way.astype(int), count - 1)
        share = way - piece
        half = rotation_matrix(0.5 * share[:, None] * self.bend[arm, piece])
        turn = self.turn[arm, piece] @ half
        chord = flat - self.flat[arm, piece] + share[:, None] * self.stretch[arm, piece]
        # a section within the hub (t above that of the hub's edge) moves rigidly with the hub
        chord = np.where((t >= self.hub[arm])[:, None], flat - self.flat[arm, 0], chord)
        return self.place[arm, piece] + matvec(turn, chord), turn @ half

    @property
    def tips(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (A, 3) and rotations (A, 3, 3) of the tips."""
        return self.place[:, -1], self.turn[:, -1]


@dataclass(frozen=True, eq=False)
class _ArmPieces:
    """The flat arms divided into S pieces each: ``hub`` and ``flat`` as in ``BentArms``.

    answer : (A, S, 6, 6) derivatives of every piece's bend and stretch, as in ``BentArms``, with respect to the force
        and moment at the arm's tip in the joint's axes
    """

    hub: np.ndarray
    flat: np.ndarray
    answer: Float[np.ndarray, "arms stations 6 6"]


def flat_centre(
    design: SpiralDesign, quad: np.ndarray, side: np.ndarray, t: Float[np.ndarray, "nodes _"]
) -> Float[np.ndarray, "nodes _ 3"]:
    """Return points (N, M, 3) of the centre lines of flat arms, relative to their hubs' centres, in the patch's frame, metres.

    Parameters
    ----------
    design : the design that has the arms
    quad, side : (N,) the arms: quad, and side of the quad to which the arm leads
    t : (N, M) positions on the arms, from 0 at the tip to 1 at the hub's centre
    """
    out = np.zeros((*t.shape, 3))
    shape = design.arms.one_by_one(quad, side)
    out[..., :2] = centre_line(shape, t[:, None])[0][:, 0] - shape.centre[:, None]
    return out


def hub_edge_of_design(design: SpiralDesign) -> Float[np.ndarray, "quads 4"]:
    """Return t (F, 4) where every arm leaves its rigid hub: a little outside the end of the shorter slot beside it."""
    root = design.roots
    return 0.985 * np.minimum(root.left, np.roll(root.right, 1, axis=1))


def bend_arms(
    design: SpiralDesign,
    pose: Pose,
    *,
    closed: Bool[np.ndarray, " joints"] | None = None,
    wrench: Float[np.ndarray, "arms 6"] | None = None,
    material: Material | None = None,
    progress: Progress = SILENT,
) -> BentArms:
    """Bend the arms of a design whose hubs stand in a pose.

    Parameters
    ----------
    design, pose : the spirals, and where their hubs are
    closed : (m,) mask of the joints whose two tips must meet; default all. A joint's index is that of its edge among
        the edges between two quads
    wrench : (A, 6) as in ``BentArms``, default 0. At ``closed`` joints the search for the equilibrium starts with it;
        at the tips of other arms it is the constant load
    material : gives Poisson's ratio and the grain; by default ``POISSON`` and no grain
    progress : is updated and can cancel
    """
    progress(0.0, BENDING)
    return Bender.from_design(design, material).bend(pose, closed, wrench, progress=progress.part(0.2, 1.0))


@dataclass(frozen=True, eq=False)
class Bender:
    """Bends the arms of one design; built once for many poses.

    pieces : the flat arms in pieces
    arm : (m, 2) indices of both arms of every joint
    axes : (A, 3, 3) axes of every arm's joint as columns, in the frame of the arm's flat patch
    size : metres, median scale of the spirals
    rim : joints and arms of the rim, if the design has one
    """

    pieces: _ArmPieces
    arm: Int[np.ndarray, "joints 2"]
    axes: Float[np.ndarray, "arms 3 3"]
    size: float
    rim: RimPieces | None = None

    @classmethod
    def from_design(
        cls, design: SpiralDesign, material: Material | None = None, only: Bool[np.ndarray, " quads"] | None = None
    ) -> Bender:
        """Divide the arms of a design into ``STATIONS`` pieces each.

        Parameters
        ----------
        design : the spirals
        material : as in the function ``bend_arms``
        only : (F,) mask of the quads that may be passed to ``bend`` as ``only``; default all
        """
        mesh = design.flat.layout.mesh
        inner = np.flatnonzero(~mesh.border)
        arm = 4 * mesh.edge_quads[inner] + mesh.edge_sides[inner]
        axes = np.broadcast_to(np.eye(3), (4 * len(mesh.quads), 3, 3)).copy()
        axes[arm] = rest_joints(mesh, design.flat.corners)[1]
        size = float(np.median(design.scale))
        if design.rim is None:
            return cls(_divide(design, axes, material, only), arm, axes, size)
        rim = rim_pieces(design, material)
        axes = np.concatenate([axes, np.broadcast_to(np.eye(3), (4 * rim.nodes, 3, 3))])
        axes[rim.arm] = rim.axes
        own = _divide(design, axes[: 4 * len(mesh.quads)], material, only)
        more = rim.answer @ _block_axes(axes[4 * len(mesh.quads) :])[:, None]
        parts = zip((own.hub, own.flat, own.answer), (np.ones(len(more)), rim.flat, more), strict=True)
        return cls(_ArmPieces(*(np.concatenate(pair) for pair in parts)), arm, axes, size, rim)

    def bend(
        self,
        pose: Pose,
        closed: np.ndarray | None = None,
        wrench: np.ndarray | None = None,
        only: Bool[np.ndarray, " quads"] | None = None,
        tolerance: float = TIP_TOLERANCE,
        progress: Progress = SILENT,
    ) -> BentArms:
        """Bend the arms for one pose.

        Parameters
        ----------
        pose, closed, wrench, progress : as in the function ``bend_arms``
        only : (F,) mask of quads; only their arms and the arms joined to these are bent, all other arms have zeros in
            the result; default all quads
        tolerance : gap between the tips of a joint, over ``size``, that ends the search, as ``TIP_TOLERANCE``
        """
        load = np.zeros((len(self.axes), 6))
        if wrench is not None:
            load[: len(wrench)] = wrench
        both = self.arm if closed is None else self.arm[closed]
        some = np.arange(len(load))
        if self.rim is not None:
            both = np.concatenate([both, self.rim.arm])
            pose = self.rim.with_nodes(pose).whole
            only = None if only is None else np.concatenate([only, only[self.rim.hub]])
        if only is not None:
            both = both[only[both // 4].any(axis=1)]
            some = np.union1d(some[np.repeat(only, 4)], both)
        for batch in progress.part(0.0, 0.6).batches(len(both), BATCH, BENDING):
            _close_joints(self.pieces, pose, self.axes, load, both[batch], tolerance * self.size)
        progress(0.6, BENDING)
        shaped = _bend(self.pieces, pose, load, some)
        progress(0.8, BENDING)
        return _join_tips(shaped, both, self.axes, some)


def _close_joints(
    pieces: _ArmPieces, pose: Pose, axes: np.ndarray, load: np.ndarray, joint: np.ndarray, tolerance: float
) -> None:
    """Change the tip wrenches ``load`` (A, 6) in place, so that both tips of the joints ``joint`` (m, 2) meet.

    axes : (A, 3, 3) as in ``Bender``; tolerance : gap between two tips that ends the search, metres
    """
    for _ in range(ROUNDS):
        some = joint.ravel()
        tip, turn, yielding = _tip_states(pieces, some, pose, load[some])
        step, miss = newton_step(tip, turn @ axes[some], yielding)
        load[joint[:, 0]] += step
        load[joint[:, 1]] -= step
        joint = joint[miss > tolerance]
        if not len(joint):
            break


def _divide(
    design: SpiralDesign,
    axes: Float[np.ndarray, "arms 3 3"],
    material: Material | None,
    only: Bool[np.ndarray, " quads"] | None = None,
) -> _ArmPieces:
    """Divide arms into ``STATIONS`` pieces of equal length in t.

    axes : (A, 3, 3) as in ``Bender``
    only : (F,) mask of quads; only their arms and the arms joined to these are divided, all others have zeros
    """
    mates = opposite_sides(design.flat.layout.mesh)[0]
    quads = np.arange(len(mates)) if only is None else np.flatnonzero(only | only[mates].any(axis=1))
    arms, hub = design.arms.subset(quads), hub_edge_of_design(design)[quads]
    step = np.linspace(1.0, 0.0, 2 * STATIONS + 1)
    t = hub[..., None] * step
    points, speed, _ = centre_line(arms, t)
    flat = np.zeros((*hub.shape, STATIONS + 1, 3))
    flat[..., :2] = points[:, :, ::2] - arms.centre[:, None, None]
    middle = np.zeros((*hub.shape, STATIONS, 3))
    middle[..., :2] = points[:, :, 1::2] - arms.centre[:, None, None]
    velocity = speed[:, :, 1::2]
    pace = np.linalg.norm(velocity, axis=-1)
    length = pace * (hub / STATIONS)[..., None]
    tangent = np.zeros_like(middle)
    tangent[..., :2] = -velocity / pace[..., None]  # the tangent points from the hub to the tip, where t falls
    width = width_at(arms, t[:, :, 1::2])[0]
    known = None if material is None else material.orthotropy
    grain = None if material is None or known is None else Grain(known, design.params.grain, material.youngs)
    answer = piece_flexibilities(
        (flat[:, :, -1:] - middle).reshape(-1, STATIONS, 3),
        tangent.reshape(-1, STATIONS, 3),
        length.reshape(-1, STATIONS),
        width.reshape(-1, STATIONS),
        design.params.thickness,
        POISSON if material is None else material.poisson,
        grain,
    )
    some = (4 * quads[:, None] + np.arange(4)).ravel()
    parts = hub.ravel(), flat.reshape(-1, STATIONS + 1, 3), answer @ _block_axes(axes[some])[:, None]
    return _ArmPieces(*(_scatter(values, some, len(axes)) for values in parts))


def _block_axes(axes: Float[np.ndarray, "arms 3 3"]) -> Float[np.ndarray, "arms 6 6"]:
    """Return matrices (A, 6, 6) that rotate wrenches by ``axes``: in both diagonal blocks, for forces and moments."""
    turned = np.zeros((len(axes), 6, 6))
    turned[:, :3, :3] = turned[:, 3:, 3:] = axes
    return turned


def _integrate(
    flat: np.ndarray, rotations: np.ndarray, centres: np.ndarray, bend: np.ndarray, stretch: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrate the bends and stretches of the pieces of n arms from the hubs to the tips.

    flat, bend, stretch : as in ``BentArms``; rotations, centres : (n, 3, 3) and (n, 3), of the arms' hubs

    Returns positions (n, S + 1, 3) and rotations (n, S + 1, 3, 3) of the stations, and rotations (n, S, 3, 3) in the
    middles of the pieces.
    """
    half = rotation_matrix(0.5 * bend)
    whole = half @ half
    turn = np.empty((len(flat), STATIONS + 1, 3, 3))
    turn[:, 0] = rotations
    for k in range(STATIONS):
        np.matmul(turn[:, k], whole[:, k], out=turn[:, k + 1])
    middle = turn[:, :-1] @ half
    place = np.empty_like(flat)
    place[:, 0] = centres + matvec(rotations, flat[:, 0])
    place[:, 1:] = place[:, :1] + np.cumsum(matvec(middle, np.diff(flat, axis=1) + stretch), axis=1)
    return place, turn, middle


def _tip_states(
    pieces: _ArmPieces, arm: np.ndarray, pose: Pose, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions (n, 3), rotations (n, 3, 3) and compliances (n, 6, 6) of the tips of the arms ``arm`` (n,).

    A compliance maps a wrench in the joint's axes to the tip's shift and rotation vector in space.
    load : (n, 6) wrenches at the tips, in the joints' axes
    """
    answer, flat = pieces.answer[arm], pieces.flat[arm]
    strain = (answer @ load[:, None, :, None])[..., 0]
    place, turn, middle = _integrate(
        flat, pose.rotations[arm // 4], pose.centres[arm // 4], strain[..., :3], strain[..., 3:]
    )
    turning, going = middle @ answer[:, :, :3], middle @ answer[:, :, 3:]
    lever = place[:, -1:] - 0.5 * (place[:, 1:] + place[:, :-1])
    # if a piece bends by the rotation vector r, the tip shifts by r x lever
    shift = (going - skew(lever) @ turning).sum(axis=1)
    return place[:, -1], turn[:, -1], np.concatenate([shift, turning.sum(axis=1)], axis=1)


def _bend(pieces: _ArmPieces, pose: Pose, load: np.ndarray, some: Int[np.ndarray, " arms"]) -> BentArms:
    """Bend the arms with indices ``some`` (n,) under tip wrenches ``load`` (A, 6); zeros for the other arms."""
    strain = (pieces.answer[some] @ load[some, None, :, None])[..., 0]
    bend, stretch = np.ascontiguousarray(strain[..., :3]), np.ascontiguousarray(strain[..., 3:])
    place, turn, _ = _integrate(pieces.flat[some], pose.rotations[some // 4], pose.centres[some // 4], bend, stretch)
    place, turn, bend, stretch = (_scatter(values, some, len(load)) for values in (place, turn, bend, stretch))
    return BentArms(pieces.hub, pieces.flat, place, turn, bend, stretch, load)


def _scatter(values: np.ndarray, some: np.ndarray, count: int) -> np.ndarray:
    """Return an array of all ``count`` arms with ``values`` (n, ...) at the indices ``some`` (n,), zero elsewhere."""
    if len(some) == count:
        return values
    out = np.zeros((count, *values.shape[1:]))
    out[some] = values
    return out


def _join_tips(arms: BentArms, joint: np.ndarray, axes: np.ndarray, some: np.ndarray) -> BentArms:
    """Make the tips at joints meet exactly: spread the remaining gap evenly along both arms.

    This also closes joints whose hubs are too far apart for the beams to meet.

    joint : (m, 2) both arms of the joints; axes : (A, 3, 3) as in ``Bender``
    some : (n,) indices of the arms that are bent; bend and stretch of the others become zero
    """
    place, turn = arms.place.copy(), arms.turn.copy()
    tip, frame = place[:, -1], turn[:, -1] @ axes
    first, second = joint.T
    apart = rotation_vector(np.swapaxes(frame[first], 1, 2) @ frame[second])
    middle, meeting = frame[first] @ rotation_matrix(0.5 * apart), 0.5 * (tip[first] + tip[second])
    share = np.linspace(0.0, 1.0, STATIONS + 1)[None, :, None]
    for which in (first, second):
        left = rotation_vector(middle @ np.swapaxes(frame[which], 1, 2))
        twisted = rotation_matrix(share * left[:, None])
        away = place[which] - tip[which][:, None]
        place[which] += share * (meeting - tip[which])[:, None] + matvec(twisted, away) - away
        turn[which] = twisted @ turn[which]
        place[which, -1] = meeting
        turn[which, -1] = middle @ np.swapaxes(axes[which], 1, 2)
    own = turn[some]
    between = np.swapaxes(own[:, :-1], 2, 3) @ own[:, 1:]
    bend = rotation_vector(between.reshape(-1, 3, 3)).reshape(-1, STATIONS, 3)
    half = own[:, :-1] @ rotation_matrix(0.5 * bend)
    stretch = matvec(np.swapaxes(half, 2, 3), np.diff(place[some], axis=1)) - np.diff(arms.flat[some], axis=1)
    count = len(turn)
    return replace(
        arms, place=place, turn=turn, bend=_scatter(bend, some, count), stretch=_scatter(stretch, some, count)
    )
