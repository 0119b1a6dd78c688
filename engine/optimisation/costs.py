"""Summands of the objective that depend on the design variables only, not on the equilibrium."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Float
from ..mechanics.assembly import Assembly
from .design_space import DesignSpace


class Cost(Protocol):
    """A summand of the objective, with its derivatives with respect to the design variables."""

    @property
    def value(self) -> float: ...

    @property
    def gradient(self) -> np.ndarray:
        """Gradient (coordinates,) of the cost with respect to all design variables."""

    def hessian_product(self, change: np.ndarray) -> np.ndarray:
        """Multiply the Hessian, or its positive semidefinite part, by a change of the design variables."""


def joint_differences(assembly: Assembly, space: DesignSpace, size: int) -> csr_array:
    """Return the matrix (2 m, size) that maps design variables to differences across the joints.

    The first m rows give the difference between the widths of a joint's arms, the last m the difference between the
    twists of its spirals, both as design variables in [0, 1].

    Parameters
    ----------
    assembly, space : gives the joints, and the design variables of the widths and twists
    size : number of all design variables
    """
    each = space.coordinates_per_spiral
    column = np.concatenate([assembly.sides % space.n_groups, np.full_like(assembly.sides, each - 1)])
    column += each * np.tile(assembly.pairs, (2, 1))
    row = np.repeat(np.arange(len(column)), 2)
    sign = np.tile([1.0, -1.0], len(column))
    return csr_array((sign, (row, column.ravel())), shape=(len(column), size))


@dataclass(frozen=True, eq=False)
class Roughness:
    """Penalty on differences between joined spirals: half the sum of their squares, as a mean over the joints.

    apart : matrix of ``joint_differences``; weight : of the penalty in the objective; x : the design variables
    free : 0 for design variables of fixed spirals, else 1
    """

    apart: csr_array
    weight: float
    x: Float[np.ndarray, " coordinates"]
    free: Float[np.ndarray, " coordinates"]

    @classmethod
    def from_space(cls, assembly: Assembly, space: DesignSpace, weight: float, x: np.ndarray) -> Roughness:
        """Return the penalty with this weight at design variables x; flat vertices, at its end, have no effect."""
        free = np.ones(len(x))
        free[: space.coordinates_per_spiral * assembly.size] = np.repeat(
            space.free_spirals.astype(float), space.coordinates_per_spiral
        )
        return cls(joint_differences(assembly, space, len(x)), weight, x, free)

    @property
    def value(self) -> float:
        return self._scale * 0.5 * float(((self.apart @ self.x) ** 2).sum())

    @cached_property
    def gradient(self) -> Float[np.ndarray, " coordinates"]:
        return self.free * self._gram_product(self.x)

    def hessian_product(self, change: np.ndarray) -> np.ndarray:
        return self.free * self._gram_product(self.free * change)

    @property
    def _scale(self) -> float:
        return 2.0 * self.weight / self.apart.shape[0]

    def _gram_product(self, change: np.ndarray) -> np.ndarray:
        """Return the product of the Hessian with a change of all design variables, including those of fixed spirals."""
        return self._scale * (self.apart.T @ (self.apart @ change))
