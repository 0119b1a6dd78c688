"""The step of Newton's method with which ``bent`` brings the two tips of every joint together."""

from __future__ import annotations

import numpy as np

from ..vectors import matvec, rotation_matrix, rotation_vector

# A Newton step turns the two tips of a joint towards each other by at most this, radians. Larger needs fewer iterations
# but may diverge
_MAX_TURN = 0.5


def newton_step(tip: np.ndarray, frame: np.ndarray, yielding: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Newton step (m, 6) of the wrenches at joints, and the gaps (m,) between their tips, metres.

    The step is added to the wrench at the joint's first arm, and subtracted from that at its second arm. To the
    distance of the two tips, 1 mm per radian of the rotation between them is added.

    tip, frame, yielding : (2 m, ...) positions, joints' axes in space and compliances of the tips, two rows per joint
    """
    apart = rotation_vector(np.swapaxes(frame[::2], 1, 2) @ frame[1::2])
    middle = frame[::2] @ rotation_matrix(0.5 * apart)
    miss = np.concatenate([tip[1::2] - tip[::2], matvec(middle, apart)], axis=1)
    large = np.linalg.norm(apart, axis=1)
    share = np.minimum(1.0, _MAX_TURN / np.maximum(large, 1e-12))
    # the equations are scaled by the diagonal, because the arms' stiffnesses span decades
    both = yielding[::2] + yielding[1::2]
    unit = np.sqrt(np.abs(np.einsum("mii->mi", both)))
    rigid = unit == 0.0  # both arms are part of their rigid hubs up to the tip: no wrench moves their tips
    unit = np.where(rigid, 1.0, unit)
    both = both / (unit[:, :, None] * unit[:, None]) + rigid[:, None] * np.eye(6)
    step = np.where(rigid, 0.0, np.linalg.solve(both, (miss / unit)[..., None])[..., 0] / unit)
    return share[:, None] * step, np.linalg.norm(miss[:, :3], axis=1) + np.linalg.norm(miss[:, 3:], axis=1) * 1e-3
