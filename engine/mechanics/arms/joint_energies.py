"""Energies of joints and their derivatives by the pose."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ..vectors import matvec
from .curving import add_second_order, contract_with_wrench
from .joint_motion import JointMotion, SpatialMotion, first_order, second_order


def correct_strains(strains: np.ndarray, curving: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the corrected strains (m, 6) and their derivatives (m or 1, 6, 6) by the strains.

    curving : second-order term D (m, 6, 6, 6); with None the strains are returned as they are
    """
    return (strains, np.eye(6)[None]) if curving is None else add_second_order(strains, curving)


def expand_joints(
    motion: JointMotion, stiffness: np.ndarray, curving: np.ndarray | None, predicted: Float[np.ndarray, "joints 6"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the energies (m,) of joints, with their derivatives by the increments of both hubs (6 each) in space.

    Four arrays: energies, gradients (m, 12), Hessians (m, 12, 12), and the convex parts of the Hessians.

    Parameters
    ----------
    motion : of the joints, measured between the bend points
    stiffness, curving : of the joints, as in ``ArmModel``
    predicted : (m, 6) strains; the wrench at these strains weights the second derivatives of the strains in the Hessian
    """
    base = motion.middle
    strains, slope = correct_strains(motion.vector, curving)
    across = np.swapaxes(slope, 1, 2)
    inner = matvec(stiffness, strains)
    per_joint = 0.5 * np.einsum("mi,mi->m", inner, strains)
    ahead = matvec(stiffness, strains + matvec(slope, predicted - motion.vector))
    at = SpatialMotion.from_joints(motion)
    jacobian = first_order(at)
    back = np.swapaxes(jacobian, 1, 2)
    spread = np.zeros((len(base), 6, 6))
    spread[:, :3, :3] = spread[:, 3:, 3:] = base
    gradient = matvec(back, matvec(spread, matvec(across, inner)))
    weight = matvec(spread, matvec(across, ahead))
    if curving is None:
        convex = back @ (spread @ stiffness @ np.swapaxes(spread, 1, 2) @ jacobian)
        return per_joint, gradient, convex + second_order(at, weight[:, :3], weight[:, 3:]), convex
    turned = np.swapaxes(spread, 1, 2) @ jacobian
    back = np.swapaxes(turned, 1, 2)
    convex = back @ (across @ stiffness @ slope) @ turned
    bent = back @ (2.0 * contract_with_wrench(ahead, curving)) @ turned
    return per_joint, gradient, convex + bent + second_order(at, weight[:, :3], weight[:, 3:]), convex
