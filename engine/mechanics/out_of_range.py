"""Spirals outside the range that an elastic model was fitted to; it treats them as the nearest spirals inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Int

# Share of a limit by which a value may exceed it unreported: covers rounding and the tolerance on twists of
# ``fabricable.unfabricable_quads``. Larger hides small excesses.
SLACK = 2e-3


@dataclass(frozen=True, eq=False)
class OutOfRange:
    """Spirals for which one quantity lies outside a model's range.

    quantity : its name; low, high : the range; spirals : (k,) int, ascending; worst : the value farthest outside it
    """

    quantity: str
    low: float
    high: float
    spirals: Int[np.ndarray, " some"]
    worst: float

    @classmethod
    def outside_range(
        cls, quantity: str, value: np.ndarray, low: float, high: float, spiral: np.ndarray
    ) -> list[OutOfRange]:
        """Return a list with one entry if any value lies outside the range, else an empty list.

        Parameters
        ----------
        quantity : name for the message
        value : (N,) values of the quantity
        low, high : range of the model
        spiral : (N,) int, the spiral that each value belongs to
        """
        apart = np.maximum(low * (1.0 - SLACK) - value, value - high * (1.0 + SLACK))
        outside = apart > 0.0
        if not outside.any():
            return []
        return [cls(quantity, low, high, np.unique(spiral[outside]), float(value[apart.argmax()]))]

    def __str__(self) -> str:
        return f"{self.quantity} {self.low:g} to {self.high:g}, here {self.worst:.3g}"
