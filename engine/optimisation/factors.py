"""Cholesky factors of the equilibria that were asked for last, each of them its owner's alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Bool
from ..mechanics.newton_system import NewtonSystem

MOST = 2  # factors at a time: of the point that steps go out from, and of the one that is tried


@dataclass(eq=False)
class Factor:
    """A linear system, and the object whose factor it holds; None while it changes."""

    system: NewtonSystem
    owner: object = None


@dataclass(eq=False)
class Factors:
    """Linear systems that share a pattern; a new factor takes the place of the one that was not used for longest.

    Whoever has lost its factor that way factors again, so that nobody ever solves with the factor of another one.

    pairs : (m, 2) int; fixed : (n, 6) bool, what supports hold; held : (n, 6) bool, increments that stay zero; kept : in the order in which they were last used
    """

    pairs: np.ndarray
    fixed: Bool[np.ndarray, "spirals 6"]
    held: Bool[np.ndarray, "spirals 6"]
    kept: list[Factor] = field(default_factory=list)

    def free(self) -> Factor:
        """A system for one more factor, without an owner until one is noted."""
        factor = Factor(NewtonSystem(self.pairs, self.held)) if len(self.kept) < MOST else self.kept.pop(0)
        factor.owner = None
        self.kept.append(factor)
        return factor

    def of(self, owner: object, blocks: Callable[[], np.ndarray]) -> NewtonSystem:
        """The system with the factor of an owner, whose matrix has the joints' blocks (m, 12, 12).

        Raises ValueError where that is not positive definite.
        """
        for factor in self.kept:
            if factor.owner is owner:
                self.kept.remove(factor)
                self.kept.append(factor)
                return factor.system
        factor = self.free()
        if not factor.system.factor(factor.system.values(blocks())):
            raise ValueError("derivatives belong to converged equilibria")
        factor.owner = owner
        return factor.system
