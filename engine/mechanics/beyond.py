"""Spirals outside the range that an elastic model was fitted to; the model treats them as the nearest spirals inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Int

SLACK = 2e-3  # relative tolerance: covers rounding and the tolerance of ``fabricable.unfabricable_quads`` on twists


@dataclass(frozen=True, eq=False)
class Beyond:
    """Spirals with one quantity outside a model's range.

    quantity : its name; low, high : the range; spirals : (k,) int, ascending; worst : the value farthest outside
    """

    quantity: str
    low: float
    high: float
    spirals: Int[np.ndarray, " some"]
    worst: float

    @classmethod
    def outside_range(
        cls, quantity: str, value: np.ndarray, low: float, high: float, spiral: np.ndarray
    ) -> list[Beyond]:
        """List with one entry if any value (N,), each of a spiral (N,) int, lies outside the range; else empty.

        Parameters
        ----------
        quantity : name for the message
        value : (N,)
        low, high : range of the model
        spiral : (N,) spiral of every value
        """
        apart = np.maximum(low * (1.0 - SLACK) - value, value - high * (1.0 + SLACK))
        outside = apart > 0.0
        if not outside.any():
            return []
        return [cls(quantity, low, high, np.unique(spiral[outside]), float(value[apart.argmax()]))]

    def __str__(self) -> str:
        return f"{self.quantity} {self.low:g} to {self.high:g}, here {self.worst:.3g}"
