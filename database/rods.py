"""What the coarse models see of a deformed spiral: energies per unit of every one of their parameters.

All three models are linear in their parameters, V = features . parameters, so that fitting them is least squares.
Lengths in arm widths, Young's modulus 1; n samples of four arms.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..engine.arrays import Float
from ..engine.mechanics.arms.stiffness import ENTRIES, IN_PLANE, OUT_OF_PLANE

HUB = 4  # place of the hub behind the four tips


def _arm_frames(rest_tips: Float[np.ndarray, "4 3"]) -> Float[np.ndarray, "4 3 3"]:
    """Columns: outwards along every arm's chord, to its left, normal."""
    out = rest_tips / np.linalg.norm(rest_tips, axis=1, keepdims=True)
    normal = np.broadcast_to([0.0, 0.0, 1.0], out.shape)
    return np.stack([out, np.cross(normal, out), normal], axis=2)


def chord_features(
    centres: Float[np.ndarray, "n 5 3"], rotations: Float[np.ndarray, "n 5 3 3"], rest_tips: Float[np.ndarray, "4 3"]
) -> Float[np.ndarray, "n 4"]:
    """Energy per unit of k_s, k_b0, k_b1, k_t of the edges from the hub to the tips (FlexMaps 6.1, eq. 1-4).

    centres, rotations : of tips 0-3 and the hub
    """
    edge = centres[:, :HUB] - centres[:, HUB:]
    length = np.linalg.norm(edge, axis=2)
    rest = np.linalg.norm(rest_tips, axis=1)
    t2 = edge / length[..., None]
    rigid = np.einsum("nij,kjl->nkil", rotations[:, HUB], _arm_frames(rest_tips))
    t1, b1, n1 = rigid[..., 0], rigid[..., 1], rigid[..., 2]
    curvature = 2.0 * np.cross(t1, t2) / (1.0 + (t1 * t2).sum(-1))[..., None]
    # the tip's own normal, as close to it as the edge allows, gives the roll; transport along the turn is free of it
    carried = _transport(n1, t1, t2)
    tip = np.einsum("nkij,j->nki", rotations[:, :HUB], [0.0, 0.0, 1.0])
    n2 = tip - (tip * t2).sum(-1)[..., None] * t2
    n2 /= np.linalg.norm(n2, axis=-1)[..., None]
    b2 = np.cross(n2, t2)
    roll = np.arctan2((np.cross(carried, n2) * t2).sum(-1), (carried * n2).sum(-1))
    kappa_n = 0.5 * (curvature * (n1 + n2)).sum(-1)
    kappa_b = -0.5 * (curvature * (b1 + b2)).sum(-1)
    stretch = length / rest - 1.0
    per_arm = 0.5 * np.stack([rest * stretch**2, kappa_n**2 / rest, kappa_b**2 / rest, roll**2 / rest], axis=-1)
    return per_arm.sum(axis=1)


def _transport(v: np.ndarray, t1: np.ndarray, t2: np.ndarray) -> np.ndarray:
    """Parallel transport of v by the smallest rotation from t1 to t2."""
    axis = np.cross(t1, t2)
    cosine = (t1 * t2).sum(-1)[..., None]
    return v * cosine + np.cross(axis, v) + axis * (axis * v).sum(-1)[..., None] / (1.0 + cosine)


def arm_motions(
    centres: Float[np.ndarray, "n 5 3"],
    rotations: Float[np.ndarray, "n 5 3 3"],
    rest_tips: Float[np.ndarray, "4 3"],
    share: float = 0.5,
) -> Float[np.ndarray, "n 4 6"]:
    """Motion of every tip relative to the rigidly moved hub, in the arm's axes: shift, rotation vector.

    The shift is measured in the frame half way between hub and tip and then referred to the hub: measured in the hub's
    own frame, a slender arm that bends would seem to be pressed together. ``share`` is that part of the way.
    """
    frames = _arm_frames(rest_tips)
    hub = rotations[:, HUB]
    turn = np.einsum("nji,nkjl->nkil", hub, rotations[:, :HUB])
    vector = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec()
    back = Rotation.from_rotvec(-share * vector).as_matrix().reshape(turn.shape)
    vector = vector.reshape(*turn.shape[:2], 3)
    seen = np.einsum("nji,nkj->nki", hub, centres[:, :HUB] - centres[:, HUB:])
    shift = np.einsum("nkij,nkj->nki", back, seen) - rest_tips + share * np.cross(vector, rest_tips)
    return np.concatenate([np.einsum("kij,nki->nkj", frames, shift), np.einsum("kij,nki->nkj", frames, vector)], axis=2)


def joint_wrenches(
    wrenches: Float[np.ndarray, "n 3 6"], rotations: Float[np.ndarray, "n 5 3 3"], rest_tips: Float[np.ndarray, "4 3"]
) -> Float[np.ndarray, "3*n 6"]:
    """Loads of tips 1-3, given in fixed axes, in their arms' axes, which turn with the hub; rotations of tips 0-3 and hub."""
    parts = wrenches.reshape(-1, 3, 2, 3)
    turned = np.einsum("nji,nkpj->nkpi", rotations[:, HUB], parts)
    return np.einsum("kij,nkpi->nkpj", _arm_frames(rest_tips)[1:], turned).reshape(-1, 6)


def stiffness_features(motions: Float[np.ndarray, "n 4 6"]) -> Float[np.ndarray, "n 12"]:
    """Energy per unit of the twelve entries of the tip stiffness, summed over the arms."""
    out = []
    for rows in (IN_PLANE, OUT_OF_PLANE):
        for i, j in ENTRIES:
            out.append((motions[..., rows[i]] * motions[..., rows[j]]).sum(1) * (0.5 if i == j else 1.0))
    return np.stack(out, axis=1)


def stiffness_parameters(compliance: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, " 12"]:
    """Entries of the inverse of a tip compliance, in the order of ``stiffness_features``."""
    out = []
    for rows in (IN_PLANE, OUT_OF_PLANE):
        inverse = np.linalg.inv(compliance[np.ix_(rows, rows)])
        out += [inverse[i, j] for i, j in ENTRIES]
    return np.array(out)


def pair_features(
    wrenches: Float[np.ndarray, "loads 6"], compliance: Float[np.ndarray, "6 6"], scale: float
) -> tuple[Float[np.ndarray, "loads 4"], Float[np.ndarray, " loads"]]:
    """Two arms in series between two hubs: features of the four parameters, and exact energies.

    wrenches : at the joint in the first arm's axes; compliance : of one arm. The second arm is the first
    one turned by half a turn about the joint; small motions. The edge runs from hub to hub, its length is the scale,
    every end bends over half of it and the twist of both ends is shared (FlexMaps 6.1, spiral assembly).
    """
    half_turn = np.diag([-1.0, -1.0, 1.0, -1.0, -1.0, 1.0])
    radius = 0.5 * scale
    first = wrenches @ compliance
    second = (-wrenches @ half_turn) @ compliance
    energy = 0.5 * (np.einsum("mi,mi->m", wrenches, first) - np.einsum("mi,mi->m", wrenches @ half_turn, second))
    # motion of the second hub: the joint's motion, less the second arm's own motion against its hub
    turn = first[:, 3:] - second[:, 3:] @ half_turn[3:, 3:]
    lever = np.array([radius, 0.0, 0.0])
    shift = first[:, :3] - second[:, :3] @ half_turn[:3, :3] + np.cross(turn, lever)
    slope_z, slope_y = shift[:, 1] / scale, -shift[:, 2] / scale
    stretch = scale * (shift[:, 0] / scale) ** 2
    in_plane = (slope_z**2 + (turn[:, 2] - slope_z) ** 2) / radius
    out_of_plane = (slope_y**2 + (turn[:, 1] - slope_y) ** 2) / radius
    return 0.5 * np.stack([stretch, in_plane, out_of_plane, turn[:, 0] ** 2 / scale], axis=1), energy
