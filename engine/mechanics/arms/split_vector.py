"""Vectors as pairs of a complex number, their part in the plane of a flat arm, and a real number, their normal part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Complex, Float


@dataclass(frozen=True, eq=False)
class SplitVector:
    """Vectors of any shape, split into two parts.

    flat : part in the plane of the flat arms, complex
    off : part along the normal of the sheet
    """

    flat: Complex[np.ndarray, "*n"]
    off: Float[np.ndarray, "*n"]

    @classmethod
    def from_vectors(cls, vector: Float[np.ndarray, "*n 3"]) -> SplitVector:
        """Split vectors (..., 3) whose third component is along the normal."""
        return cls(vector[..., 0] + 1j * vector[..., 1], vector[..., 2])

    @property
    def space(self) -> Float[np.ndarray, "*n 3"]:
        """The vectors as one array (..., 3): two components in the plane, then the one along the normal."""
        return np.stack([self.flat.real, self.flat.imag, self.off], axis=-1)

    def __getitem__(self, index: Any) -> SplitVector:
        return SplitVector(self.flat[index], self.off[index])

    def sums(self) -> SplitVector:
        """Return the sums (n, pieces + 1) of vectors (n, pieces) over the pieces from the hub to every station."""
        return SplitVector(_cumulative(self.flat), _cumulative(self.off))


def _cumulative(steps: np.ndarray) -> np.ndarray:
    """Return the sums (n, pieces + 1) of the first 0, 1, 2, ... columns of ``steps`` (n, pieces)."""
    out = np.zeros((len(steps), steps.shape[1] + 1), dtype=steps.dtype)
    np.cumsum(steps, axis=1, out=out[:, 1:])
    return out
