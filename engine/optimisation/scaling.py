"""How strongly a quadratic model bends along each of its coordinates, to choose units in which it bends alike along all of them.

Along widths of stiff spirals the objective bends 1e12 times less than along flat vertices under strained arms. In units of the box,
500 rounds of conjugate gradients brought a third of the fall of a whole step on a surface of 1296 quads; in the units found
here, 60 rounds bring nine tenths.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Float

FIRST, LATER = 5, 1  # refinements at the first design, and at every one that follows, where little has changed
PROBES = 2  # products a refinement
# Of the objective over the number of coordinates: what bends less counts as bent so much, as going from end to end along all of
# those coordinates would change less than there is to gain. Ten times more and ten times less do as well on three surfaces
LEAST = 1.0
QUIETEST = 1e-12  # largest fall of an estimate in one refinement, squared: no product is that small but by rounding
# Below which no estimate falls: coordinates that change nothing, of spirals that are kept, would reach 0 after fifty refinements
SMALLEST = 1e-30
START = 1e-3  # by eye; five refinements forget it


class Bending:
    """The estimate, which goes along with a search from design to design.

    Stochastic equilibration: each refinement corrects the units by the sizes of the matrix's rows in them, which products with
    vectors of random signs tell (Bradley 2010, Algorithms for the Equilibration of Matrices and Their Application to
    Limited-Memory Quasi-Newton Methods). In the end all rows are alike in size. That serves conjugate gradients nearly as well as
    the diagonal, which would take a product a coordinate.
    """

    def __init__(self, size: int):
        self._found = np.full(size, START)
        self._random = np.random.default_rng(size)
        self._rounds = FIRST

    def refine(self, product: Callable[[np.ndarray], np.ndarray]) -> None:
        """Learn from a matrix, given by its product with a vector (coordinates,), that differs little from the last one."""
        for _ in range(self._rounds):
            unit = 1.0 / np.sqrt(self._found)
            squares = np.zeros_like(unit)
            for _ in range(PROBES):
                signs = self._random.choice([-1.0, 1.0], unit.size)
                squares += (unit * product(unit * signs)) ** 2 / PROBES
            self._found = np.maximum(self._found * np.sqrt(np.maximum(squares, QUIETEST)), SMALLEST)
        self._rounds = LATER

    def units(self, value: float, damping: float) -> Float[np.ndarray, " coordinates"]:
        """Units of the coordinates in which an objective of this value and its damping bend alike along all of them."""
        return 1.0 / np.sqrt(np.maximum(self._found, LEAST * value / self._found.size) + damping)
