"""Linear buckling: a quick estimate of the load factor at which a piece snaps.

K0 is the tangent stiffness without loads, including the stresses of the assembled piece; K1 is its derivative by the
load factor (Brendel and Ramm 1980; Bathe and Dvorkin 1983). The estimate is the lowest factor for which K0 + factor K1
is singular. It assumes a straight load path, so it may be too high or too low if a piece deforms much before it snaps.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csc_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ...mechanics.newton_system import MAX_DENSE_SIZE
from .load_path import PathFollower, PathPoint, load_stiffness

# step of the finite difference of the tangent stiffness, radians or quad edges; larger: less exact, smaller: more
# rounding error
DIFFERENCE_STEP = 1e-4
EIGENVALUE_TOL = 1e-6  # relative tolerance of the eigenvalue solver; larger: faster, less exact critical factor


def linear_buckling(follower: PathFollower, rest: PathPoint) -> float | None:
    """Return the lowest positive critical load factor by linear buckling; None if there is none.

    Parameters
    ----------
    follower : model and load
    rest : equilibrium without load
    """
    model, system = follower.model, follower.system
    if not len(system.free) or not follower.action.acts or not np.isfinite(rest.rises) or rest.rises <= 0.0:
        return None
    there = model.expand(model.moved(rest.state, DIFFERENCE_STEP * rest.way))
    here = model.expand(rest.state)
    base = system.values(here.hessian)
    change = (system.values(there.hessian) - base) / (DIFFERENCE_STEP * rest.rises)
    slope = system.pattern.matrix(change)
    if follower.action.follows:
        turned = load_stiffness(system, follower.action, rest.pose, 1.0)
        slope = (slope + 0.5 * (turned + turned.T)).tocsc()
    return _lowest_factor(follower, base, slope)


def _lowest_factor(follower: PathFollower, base: np.ndarray, slope: csc_array) -> float | None:
    """Return the lowest positive factor f for which base + f slope is singular; None if there is none.

    base : values of the tangent stiffness without loads, in the pattern of ``follower.system``
    slope : derivative of the tangent stiffness by the load factor
    """
    system = follower.system
    whole = system.pattern.matrix(base)
    if not system.factor(base):
        return None
    if len(system.free) <= MAX_DENSE_SIZE:
        inverse = eigh(-slope.toarray(), whole.toarray(), eigvals_only=True)[-1]
    else:
        solve = LinearOperator(whole.shape, matvec=lambda x: system.cholesky.solve(np.asarray(x).ravel()), dtype=float)
        start = np.random.default_rng(0).normal(size=whole.shape[0])
        try:
            inverse = eigsh(
                -slope, 1, whole, Minv=solve, which="LA", v0=start, tol=EIGENVALUE_TOL, return_eigenvectors=False
            )[0]
        except ArpackNoConvergence:
            return None
    return float(1.0 / inverse) if inverse > 0.0 else None
