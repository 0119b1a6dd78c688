"""The whole numbers of a seamless map: the best there are that keep apart what has to stay apart."""

from __future__ import annotations

import numpy as np

from ...arrays import Float, Int
from .separation import Apart

SURE = 0.02  # numbers that are as near to whole ones as this are rounded together
FAR = 3.0  # whole numbers move no farther
NODES = 10  # of the solver's tree, and not seconds, so that one mesh gives one map; of 83 maps of 24 meshes 65 took 7 at most, the others over 40
LONGEST = 10.0  # seconds of the solver, however busy the machine is
GAP = 0.1  # of the optimum, which is good enough: what follows takes the best steps of one
STEPS = 200  # of one; far more than were ever taken


def rounded(
    matrix: Float[np.ndarray, "whole whole"], right: Float[np.ndarray, " whole"], apart: Apart
) -> Int[np.ndarray, " whole"]:
    """Those of the best map found: rounded one after another, the surest first, the rest following (Bommes et al. 2009,
    section 3); then stepped apart where pairs have come together; then one by one wherever that lowers the energy."""
    result = _greedy(matrix, right)
    result = _separated(matrix, right, apart, result)
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


def _greedy(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    result, left = np.zeros(len(right)), np.arange(len(right))
    while len(left):
        held = np.setdiff1d(np.arange(len(right)), left)
        best = np.linalg.solve(matrix[np.ix_(left, left)], right[left] - matrix[np.ix_(left, held)] @ result[held])
        off = np.abs(best - np.round(best))
        sure = off <= max(off.min(), SURE)
        result[left[sure]] = np.round(best[sure])
        left = left[~sure]
    return result


def _separated(matrix: np.ndarray, right: np.ndarray, apart: Apart, result: np.ndarray) -> np.ndarray:
    """The nearest whole numbers that keep all pairs apart, distances weighed by the energy's curvature; the same ones where
    the solver finds none in time."""
    from scipy.optimize import Bounds, LinearConstraint, milp

    if apart.hold(result):
        return result
    size = len(result)
    eye = np.eye(size)
    # numbers, then how far each is from the result: far >= number - result, far >= result - number
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
