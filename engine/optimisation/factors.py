"""Cache of the Cholesky factors that were used last, each kept for the equilibrium that owns it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Bool
from ..mechanics.loads import Springs
from ..mechanics.newton_system import NewtonSystem

MAX_FACTORS = 2  # for the present point of a search and for the trial point; each takes memory


@dataclass(eq=False)
class Factor:
    """A linear system; owner : the object whose factor it holds, None if nobody's yet."""

    system: NewtonSystem
    owner: object = None


@dataclass(eq=False)
class Factors:
    """Cache of factors with one sparsity pattern; a new factor replaces the least recently used.

    An owner whose factor was replaced gets it computed again, so no owner ever solves with another's factor.

    pairs : (m, 2) int, bodies of every joint; fixed : (n, 6) bool, components that supports hold
    held : (n, 6) bool, increments that stay 0; springs : at the hubs; kept : factors, the least recently used first
    """

    pairs: np.ndarray
    fixed: Bool[np.ndarray, "spirals 6"]
    held: Bool[np.ndarray, "spirals 6"]
    springs: Springs | None = None
    kept: list[Factor] = field(default_factory=list)

    def free(self) -> Factor:
        """Return a system to factor anew; the caller sets its owner."""
        if len(self.kept) < MAX_FACTORS:
            factor = Factor(NewtonSystem(self.pairs, self.held, springs=self.springs))
        else:
            factor = self.kept.pop(0)
        factor.owner = None
        self.kept.append(factor)
        return factor

    def system_of(self, owner: object, blocks: Callable[[], np.ndarray]) -> NewtonSystem:
        """Return the system with the factor of an owner.

        Parameters
        ----------
        owner : an equilibrium, recognised by identity
        blocks : computes the blocks (m, 12, 12) of the owner's matrix, a joint each; called where the factor was replaced

        Raises
        ------
        ValueError : the matrix is not positive definite
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
