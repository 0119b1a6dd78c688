"""Linear buckling: the quick answer to how far a load may rise.

The tangent stiffness at rest, K0, with the stresses that the piece has there already, and how it changes with the load's factor to
first order, K1 (Brendel and Ramm 1980; Bathe and Dvorkin 1983): the lowest factor at which K0 + factor K1 has no inverse. It takes the
path of the load to be straight, so that it is a guess, too high or too low, where a piece gives way much before it snaps.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csc_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ..mechanics.newton_system import DENSE
from .path import Follower, Point, following

NEAR = 1e-4  # radians or edges of the step over which the tangent's change is measured: errors of 1e-4 and of rounding, 1e-9
CLOSE = 1e-6  # of the lowest factor: how near its eigenvalue is found


def linear_buckling(follower: Follower, rest: Point) -> float | None:
    """The lowest positive critical factor to first order, at a point without load; None where there is none."""
    model, system = follower.model, follower.system
    if not len(system.free) or not follower.action.acts or not np.isfinite(rest.rises) or rest.rises <= 0.0:
        return None
    there = model.expand(model.moved(rest.state, NEAR * rest.way))
    here = model.expand(rest.state)
    base = system.values(here.hessian)
    change = (system.values(there.hessian) - base) / (NEAR * rest.rises)
    slope = system.pattern.matrix(change)
    if follower.action.follows:
        turned = following(system, follower.action, rest.pose, 1.0)
        slope = (slope + 0.5 * (turned + turned.T)).tocsc()
    return _lowest(follower, base, slope)


def _lowest(follower: Follower, base: np.ndarray, slope: csc_array) -> float | None:
    """The lowest positive factor f for which base + f slope is singular."""
    system = follower.system
    whole = system.pattern.matrix(base)
    if not system.factor(base):
        return None
    if len(system.free) <= DENSE:
        inverse = eigh(-slope.toarray(), whole.toarray(), eigvals_only=True)[-1]
    else:
        solve = LinearOperator(whole.shape, matvec=lambda x: system.cholesky.solve(np.asarray(x).ravel()), dtype=float)
        start = np.random.default_rng(0).normal(size=whole.shape[0])
        try:
            inverse = eigsh(-slope, 1, whole, Minv=solve, which="LA", v0=start, tol=CLOSE, return_eigenvectors=False)[0]
        except ArpackNoConvergence:
            return None
    return float(1.0 / inverse) if inverse > 0.0 else None
