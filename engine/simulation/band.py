"""Distances between a piece and its target when the sheets differ from their nominal values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Tolerance:
    """Distances from the target at the lower and the upper end of one tolerance.

    name : "thickness", "width" or "stiffness"
    less, more : RMS distance in metres at the lower and at the upper end; None where no equilibrium was found
    words : phrase that names the tolerance, for example "with a sheet 5 % thicker or thinner"
    """

    name: str
    less: float | None
    more: float | None
    words: str

    @property
    def text(self) -> str:
        """Part of a sentence to users: the smaller and the larger distance, or that no equilibrium was found."""
        distances = sorted(one for one in (self.less, self.more) if one is not None)
        if len(distances) < 2:
            return f"no equilibrium found {self.words}"
        return f"{1e3 * distances[0]:.2g} to {1e3 * distances[1]:.2g} mm {self.words}"


@dataclass(frozen=True)
class ToleranceBand:
    """Distances of a piece from its target at the ends of every tolerance.

    tolerances : distances at the ends of each tolerance
    """

    tolerances: tuple[Tolerance, ...]

    @property
    def text(self) -> str:
        """Sentence to users. It leaves out the distance with nominal sheets, which is always shown before it."""
        return f"RMS with other sheets: {', '.join(one.text for one in self.tolerances)}."

    def report(self) -> dict[str, Any]:
        """Return the entry for the ``equilibrium`` block of report.json, with RMS distances in mm."""

        def to_mm(value: float | None) -> float | None:
            return None if value is None else 1e3 * value

        return {"text": self.text} | {one.name: [to_mm(one.less), to_mm(one.more)] for one in self.tolerances}
