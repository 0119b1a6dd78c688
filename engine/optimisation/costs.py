"""What a design costs beside its mismatch, whatever its equilibrium: functions of the coordinates alone."""

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
    """A share of the objective with its derivatives by the coordinates."""

    @property
    def value(self) -> float: ...

    @property
    def gradient(self) -> np.ndarray:
        """By every coordinate."""

    def product(self, change: np.ndarray) -> np.ndarray:
        """Of its Hessian, or of a positive semidefinite part of it, with a change of the coordinates."""


def differences(assembly: Assembly, space: DesignSpace, size: int) -> csr_array:
    """(2 m, size) from coordinates to how much the widths of the arms that meet, and the twists of their spirals, differ."""
    each = space.each
    column = np.concatenate([assembly.sides % space.groups, np.full_like(assembly.sides, each - 1)])
    column += each * np.tile(assembly.pairs, (2, 1))
    row = np.repeat(np.arange(len(column)), 2)
    sign = np.tile([1.0, -1.0], len(column))
    return csr_array((sign, (row, column.ravel())), shape=(len(column), size))


@dataclass(frozen=True, eq=False)
class Roughness:
    """How much spirals that are joined differ: the mean over the joints of half of the squares.

    apart : ``differences``; weight : in the objective; x : the coordinates; free : 0 for those that must stay, else 1
    """

    apart: csr_array
    weight: float
    x: Float[np.ndarray, " coordinates"]
    free: Float[np.ndarray, " coordinates"]

    @property
    def value(self) -> float:
        return self._scale * 0.5 * float(((self.apart @ self.x) ** 2).sum())

    @cached_property
    def gradient(self) -> Float[np.ndarray, " coordinates"]:
        return self.free * self._back(self.x)

    def product(self, change: np.ndarray) -> np.ndarray:
        return self.free * self._back(self.free * change)

    @property
    def _scale(self) -> float:
        return 2.0 * self.weight / self.apart.shape[0]

    def _back(self, change: np.ndarray) -> np.ndarray:
        return self._scale * (self.apart.T @ (self.apart @ change))
