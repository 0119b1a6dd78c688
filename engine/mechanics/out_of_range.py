"""Reports of spirals that are outside the range to which an elastic model was fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Int

# A value that exceeds a limit by less than this share of the limit is not reported, because of rounding errors and of
# the tolerance on twists in ``fabricable.unfabricable_quads``. Larger hides small excesses.
SLACK = 2e-3


@dataclass(frozen=True, eq=False)
class OutOfRange:
    """The spirals for which one quantity is outside a model's range.

    quantity : name of the quantity
    low, high : range of the model
    spirals : (k,) indices of the spirals, ascending
    worst : the value that is farthest outside the range
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
        spiral : (N,) index of the spiral that each value belongs to
        """
        apart = np.maximum(low * (1.0 - SLACK) - value, value - high * (1.0 + SLACK))
        outside = apart > 0.0
        if not outside.any():
            return []
        return [cls(quantity, low, high, np.unique(spiral[outside]), float(value[apart.argmax()]))]

    def __str__(self) -> str:
        return f"{self.quantity} {self.low:g} to {self.high:g}, here {self.worst:.3g}"
