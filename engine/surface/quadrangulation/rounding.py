"""Find the best integers of a seamless map that keep nearby points apart."""

from __future__ import annotations

import numpy as np

from ...arrays import Float, Int
from .separation import PositiveSums

SURE = 0.02  # values this near to integers are rounded together
FAR = 3.0  # largest change of an integer when pairs are separated
# limit on the solver's nodes, not seconds, so that a mesh always gives the same map; of 83 maps of 24 meshes 65 took at
# most 7, the others over 40
NODES = 10
LONGEST = 10.0  # time limit of the solver, seconds, if the machine is busy
GAP = 0.1  # relative gap to the optimum that is good enough, since single steps follow
STEPS = 200  # largest number of single steps; far more than were ever taken


def round_unknowns(
    matrix: Float[np.ndarray, "whole whole"], right: Float[np.ndarray, " whole"], apart: PositiveSums
) -> Int[np.ndarray, " whole"]:
    """Round the unknowns of an energy to integers.

    First greedily, the surest first, solving for the rest (Bommes et al. 2009, section 3); then pairs that came
    together are separated; then single integers step wherever that lowers the energy.

    Parameters
    ----------
    matrix, right : energy 1/2 x^T M x - r^T x
    apart : constraints that keep pairs apart
    """
    result = _round_greedily(matrix, right)
    result = _separate(matrix, apart, result)
    for _ in range(STEPS):
        slope = matrix @ result - right
        gain = np.abs(slope) - 0.5 * np.diag(matrix)
        step = -np.sign(slope)
        if len(apart.least):
            value = (apart.rows @ result)[:, None]
            gain[(value + apart.rows * step < np.minimum(apart.least[:, None], value)).any(axis=0)] = 0.0
        if not len(result) or gain.max() <= 1e-12:
            break
        k = int(gain.argmax())
        result[k] += step[k]
    return result.astype(np.int64)


def _round_greedily(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Round one unknown after another, the surest first, solving for the others."""
    result, left = np.zeros(len(right)), np.arange(len(right))
    while len(left):
        held = np.setdiff1d(np.arange(len(right)), left)
        best = np.linalg.solve(matrix[np.ix_(left, left)], right[left] - matrix[np.ix_(left, held)] @ result[held])
        off = np.abs(best - np.round(best))
        sure = off <= max(off.min(), SURE)
        result[left[sure]] = np.round(best[sure])
        left = left[~sure]
    return result


def _separate(matrix: np.ndarray, apart: PositiveSums, result: np.ndarray) -> np.ndarray:
    """Return the nearest integers that keep all pairs apart, weighted by the energy's curvature; unchanged if the solver finds none."""
    from scipy.optimize import Bounds, LinearConstraint, milp

    if apart.hold(result):
        return result
    size = len(result)
    eye = np.eye(size)
    # variables: the integers, then their distances from the result: far >= number - result, far >= result - number
    beside = np.block([[eye, -eye], [eye, eye]])
    found = milp(
        np.concatenate([np.zeros(size), np.sqrt(np.diag(matrix))]),
        integrality=np.concatenate([np.ones(size), np.zeros(size)]),
        bounds=Bounds(
            np.concatenate([result - FAR, np.zeros(size)]), np.concatenate([result + FAR, np.full(size, FAR)])
        ),
        constraints=[
            LinearConstraint(np.hstack([apart.rows, np.zeros_like(apart.rows)]), apart.least, np.inf),
            LinearConstraint(
                beside,
                np.concatenate([np.full(size, -np.inf), result]),
                np.concatenate([result, np.full(size, np.inf)]),
            ),
        ],
        options={"node_limit": NODES, "time_limit": LONGEST, "mip_rel_gap": GAP},
    )
    return result if found.x is None else np.round(found.x[:size])
