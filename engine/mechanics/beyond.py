"""Spirals outside of what an elastic model was fitted to: they count as their nearest neighbours in it, and are named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Int

SLACK = 2e-3  # relative: rounding, and what ``design.outside`` leaves a twist


@dataclass(frozen=True, eq=False)
class Beyond:
    """Some spirals of which one quantity lies outside a model's range.

    quantity : its name; low, high : the range; spirals : (k,) int, ascending; worst : the value that is farthest outside
    """

    quantity: str
    low: float
    high: float
    spirals: Int[np.ndarray, " some"]
    worst: float

    @classmethod
    def of(cls, quantity: str, value: np.ndarray, low: float, high: float, spiral: np.ndarray) -> list[Beyond]:
        """None or one, of values (N,) that belong to spirals (N,) int."""
        apart = np.maximum(low * (1.0 - SLACK) - value, value - high * (1.0 + SLACK))
        outside = apart > 0.0
        if not outside.any():
            return []
        return [cls(quantity, low, high, np.unique(spiral[outside]), float(value[apart.argmax()]))]

    def __str__(self) -> str:
        return f"{self.quantity} {self.low:g} to {self.high:g}, here {self.worst:.3g}"
