"""Diagonal preconditioning: estimate a model's curvature along each coordinate, and choose units in which all curvatures are alike.

The objective's curvature along widths of stiff spirals is 1e12 times smaller than along flat vertices under strained arms. In units of
the box, 500 iterations of conjugate gradients brought a third of the decrease of a full step on a surface of 1296 quads; in these
units, 60 iterations bring nine tenths.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Float

FIRST_ROUNDS, LATER_ROUNDS = 5, 1  # refinements at the first design, and at each later one, where little has changed
PROBES = 2  # products with the matrix in a refinement; more are more exact and take longer
# Smallest curvature that counts, in objectives over the number of coordinates: with less, moving all coordinates across their range
# changes the objective by less than its value. Ten times more and ten times less do as well on three surfaces
MIN_CURVATURE = 1.0
MIN_SQUARE = 1e-12  # lower bound of squared scaled products, which limits the change in one refinement; less is noise
# Lower bound of an estimate: for coordinates without effect (kept spirals) it would reach 0 after fifty refinements
MIN_ESTIMATE = 1e-30
FIRST_ESTIMATE = 1e-3  # chosen by eye; has no effect after five refinements


class CurvatureEstimate:
    """Estimate of the curvatures, refined along a search from design to design.

    Stochastic equilibration: each refinement corrects the units by the norms of the scaled matrix's rows, estimated from products with
    vectors of random signs (Bradley 2010, Algorithms for the Equilibration of Matrices and Their Application to Limited-Memory
    Quasi-Newton Methods). In the limit all rows have equal norm. That serves conjugate gradients nearly as well as the diagonal, which
    would take one product per coordinate.
    """

    def __init__(self, size: int):
        self._estimate = np.full(size, FIRST_ESTIMATE)
        self._random = np.random.default_rng(size)
        self._rounds = FIRST_ROUNDS

    def refine(self, product: Callable[[np.ndarray], np.ndarray]) -> None:
        """Refine the estimate with a matrix, given by its product with a vector, that differs little from the last one."""
        for _ in range(self._rounds):
            unit = 1.0 / np.sqrt(self._estimate)
            squares = np.zeros_like(unit)
            for _ in range(PROBES):
                signs = self._random.choice([-1.0, 1.0], unit.size)
                squares += (unit * product(unit * signs)) ** 2 / PROBES
            self._estimate = np.maximum(self._estimate * np.sqrt(np.maximum(squares, MIN_SQUARE)), MIN_ESTIMATE)
        self._rounds = LATER_ROUNDS

    def units(self, value: float, damping: float) -> Float[np.ndarray, " coordinates"]:
        """Return units of the coordinates in which the damped model has about equal curvatures.

        Parameters
        ----------
        value : of the objective, which bounds the curvatures from below
        damping : weight of half the squared step
        """
        return 1.0 / np.sqrt(np.maximum(self._estimate, MIN_CURVATURE * value / self._estimate.size) + damping)
