"""Round the integer unknowns of a seamless map so that its energy is small and nearby points stay apart."""

from __future__ import annotations

import numpy as np

from ...arrays import Float, Int
from .separation import MapConstraints

# Unknowns at most this far from integers are rounded together, before the others are solved again. Larger: faster, with
# a larger energy.
SURE = 0.02
FAR = 3.0  # largest change of an integer that separates a pair of points; larger: more pairs can be separated, slower
# Largest number of branch-and-bound nodes of the integer solver. A limit on nodes, not seconds, makes results repeatable.
# Larger: slower, more pairs of points separated.
NODES = 10
LONGEST = 10.0  # time limit of the solver on a busy machine, seconds; results that reach it are not repeatable
# Relative gap between the integer solver's solution and its bound on the optimum, at which it ends. Larger: faster, with
# a larger energy, which the steps of single integers lower afterwards.
GAP = 0.1
STEPS = 200  # largest number of final steps, which change one integer by 1 each; never reached


def round_unknowns(
    matrix: Float[np.ndarray, "whole whole"], right: Float[np.ndarray, " whole"], constraints: MapConstraints
) -> Int[np.ndarray, " whole"]:
    """Round the unknowns of a quadratic energy to integers.

    First the unknowns nearest to integers are rounded and the remaining unknowns solved again, repeatedly (Bommes et al.
    2009, section 3). Then pairs of points that violate ``constraints`` are separated. Last, single integers change by 1
    where that lowers the energy.

    Parameters
    ----------
    matrix, right : M and r of the energy 1/2 x^T M x - r^T x
    constraints : constraints that keep pairs of points apart
    """
    result = _round_greedily(matrix, right)
    result = _round_with_constraints(matrix, constraints, result)
    for _ in range(STEPS):
        slope = matrix @ result - right
        gain = np.abs(slope) - 0.5 * np.diag(matrix)
        step = -np.sign(slope)
        if len(constraints.lower_bounds):
            value = (constraints.rows @ result)[:, None]
            gain[
                (value + constraints.rows * step < np.minimum(constraints.lower_bounds[:, None], value)).any(axis=0)
            ] = 0.0
        if not len(result) or gain.max() <= 1e-12:
            break
        k = int(gain.argmax())
        result[k] += step[k]
    return result.astype(np.int64)


def _round_greedily(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Round one unknown after another, the nearest to an integer first; solve for the remaining unknowns each time.

    matrix, right : M and r of the energy 1/2 x^T M x - r^T x
    """
    result, left = np.zeros(len(right)), np.arange(len(right))
    while len(left):
        held = np.setdiff1d(np.arange(len(right)), left)
        best = np.linalg.solve(matrix[np.ix_(left, left)], right[left] - matrix[np.ix_(left, held)] @ result[held])
        off = np.abs(best - np.round(best))
        sure = off <= max(off.min(), SURE)
        result[left[sure]] = np.round(best[sure])
        left = left[~sure]
    return result


def _round_with_constraints(matrix: np.ndarray, constraints: MapConstraints, result: np.ndarray) -> np.ndarray:
    """Return the integers nearest to ``result`` that satisfy ``constraints``; ``result`` itself if the solver finds none.

    Changes of the integers are weighted by the root of the diagonal of ``matrix``, the energy's second derivatives.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    if constraints.are_satisfied(result):
        return result
    size = len(result)
    eye = np.eye(size)
    # variables: integers x, then their distances d from ``result``, with d >= x - result and d >= result - x
    beside = np.block([[eye, -eye], [eye, eye]])
    found = milp(
        np.concatenate([np.zeros(size), np.sqrt(np.diag(matrix))]),
        integrality=np.concatenate([np.ones(size), np.zeros(size)]),
        bounds=Bounds(
            np.concatenate([result - FAR, np.zeros(size)]), np.concatenate([result + FAR, np.full(size, FAR)])
        ),
        constraints=[
            LinearConstraint(
                np.hstack([constraints.rows, np.zeros_like(constraints.rows)]), constraints.lower_bounds, np.inf
            ),
            LinearConstraint(
                beside,
                np.concatenate([np.full(size, -np.inf), result]),
                np.concatenate([result, np.full(size, np.inf)]),
            ),
        ],
        options={"node_limit": NODES, "time_limit": LONGEST, "mip_rel_gap": GAP},
    )
    return result if found.x is None else np.round(found.x[:size])
