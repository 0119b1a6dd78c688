"""Cache of recently used Cholesky factors, each of the Hessian at one equilibrium, its owner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Bool
from ..mechanics.loads import Springs
from ..mechanics.newton_system import NewtonSystem

MAX_FACTORS = 2  # number of factors: for a search's present point and for its trial point; more take more memory


@dataclass(eq=False)
class CachedFactor:
    """A linear system with its factor; owner : the equilibrium whose Hessian is factored, None before that."""

    system: NewtonSystem
    owner: object = None


@dataclass(eq=False)
class FactorCache:
    """Cache of factors with a common sparsity pattern; a new factor replaces the least recently used.

    A factor that was replaced is computed again on request, so no equilibrium gets the factor of another.

    pairs : (m, 2) int, bodies of every joint; fixed : (n, 6) bool, degrees of freedom that supports fix
    held : (n, 6) bool, increments that stay 0; springs : at the hubs; factors : factors, the least recently used first
    """

    pairs: np.ndarray
    fixed: Bool[np.ndarray, "spirals 6"]
    held: Bool[np.ndarray, "spirals 6"]
    springs: Springs | None = None
    factors: list[CachedFactor] = field(default_factory=list)

    def acquire(self) -> CachedFactor:
        """Return a cached system whose factor may be replaced; the caller factors it and sets its owner."""
        if len(self.factors) < MAX_FACTORS:
            factor = CachedFactor(NewtonSystem(self.pairs, self.held, springs=self.springs))
        else:
            factor = self.factors.pop(0)
        factor.owner = None
        self.factors.append(factor)
        return factor

    def system_of(self, owner: object, blocks: Callable[[], np.ndarray]) -> NewtonSystem:
        """Return the system with the factor of an owner's Hessian.

        Parameters
        ----------
        owner : an equilibrium, compared by identity
        blocks : computes the Hessian's blocks (m, 12, 12), one per joint; called if the factor is not in the cache

        Raises
        ------
        ValueError : the matrix is not positive definite
        """
        for factor in self.factors:
            if factor.owner is owner:
                self.factors.remove(factor)
                self.factors.append(factor)
                return factor.system
        factor = self.acquire()
        if not factor.system.factor(factor.system.values(blocks())):
            raise ValueError("derivatives belong to converged equilibria")
        factor.owner = owner
        return factor.system
