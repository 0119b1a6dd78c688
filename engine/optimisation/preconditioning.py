"""Diagonal preconditioning: estimate the curvature along each design variable, and choose units that make them equal.

The objective's curvature along widths of stiff spirals is 1e12 times smaller than along flat vertices under strained
arms, so conjugate gradients need several times as many iterations without preconditioning (docs/tuning.md).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Float

# Number of refinements of the estimate at the first design, and at each later design, where the curvature has changed
# little. More: slower, more accurate
FIRST_ROUNDS, LATER_ROUNDS = 5, 1
PROBES = 2  # products with the matrix in a refinement; more: more accurate, slower
# Smallest curvature, in objective values over the number of design variables: with less curvature, moving all variables
# across their whole range would change the objective by less than its value. Has little influence (docs/tuning.md)
MIN_CURVATURE = 1.0
# Lower bound of the squares of scaled products, which limits the change of an estimate in one refinement. Smaller
# squares are rounding noise
MIN_SQUARE = 1e-12
# Lower bound of an estimate, which would reach 0 after fifty refinements for design variables of fixed spirals
MIN_ESTIMATE = 1e-30
FIRST_ESTIMATE = 1e-3  # initial curvature of all design variables, by eye; has no effect after five refinements


class CurvatureEstimate:
    """Estimate of the curvature along every design variable, refined from design to design of a search.

    Stochastic equilibration: each refinement corrects the units by the norms of the scaled matrix's rows, estimated
    from products with vectors of random signs (Bradley 2010, Algorithms for the Equilibration of Matrices and Their
    Application to Limited-Memory Quasi-Newton Methods). In the limit all rows have equal norm. This preconditions
    nearly as well as the diagonal, which would take one product per design variable.
    """

    def __init__(self, size: int):
        self._estimate = np.full(size, FIRST_ESTIMATE)
        self._random = np.random.default_rng(size)
        self._rounds = FIRST_ROUNDS

    def refine(self, product: Callable[[np.ndarray], np.ndarray]) -> None:
        """Refine the estimate at a new design, which differs little from the last.

        product : multiplies the model's matrix by a vector
        """
        for _ in range(self._rounds):
            unit = 1.0 / np.sqrt(self._estimate)
            squares = np.zeros_like(unit)
            for _ in range(PROBES):
                signs = self._random.choice([-1.0, 1.0], unit.size)
                squares += (unit * product(unit * signs)) ** 2 / PROBES
            self._estimate = np.maximum(self._estimate * np.sqrt(np.maximum(squares, MIN_SQUARE)), MIN_ESTIMATE)
        self._rounds = LATER_ROUNDS

    def units(self, value: float, damping: float) -> Float[np.ndarray, " coordinates"]:
        """Return units of the design variables in which the damped model has about equal curvatures.

        Parameters
        ----------
        value : of the objective, which bounds the curvatures from below
        damping : weight of half the squared step
        """
        return 1.0 / np.sqrt(np.maximum(self._estimate, MIN_CURVATURE * value / self._estimate.size) + damping)
