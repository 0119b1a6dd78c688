"""Distances between a piece and its target if thickness, width or stiffness differ from their nominal values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ToleranceEffect:
    """Distances from the target if one quantity is at the lower or at the upper end of its tolerance.

    name : the quantity: "thickness", "width" or "stiffness"
    rms_low, rms_high : RMS distance at the lower and at the upper end, metres; None if no equilibrium was found there
    phrase : names the tolerance in messages, for example "with a sheet 5 % thicker or thinner"
    """

    name: str
    rms_low: float | None
    rms_high: float | None
    phrase: str

    @property
    def text(self) -> str:
        """Part of a message to users: the smaller and the larger distance, or that no equilibrium was found."""
        distances = sorted(one for one in (self.rms_low, self.rms_high) if one is not None)
        if len(distances) < 2:
            return f"no equilibrium found {self.phrase}"
        return f"{1e3 * distances[0]:.2g} to {1e3 * distances[1]:.2g} mm {self.phrase}"


@dataclass(frozen=True)
class ToleranceBand:
    """Distances of a piece from its target at the ends of the tolerances of several quantities."""

    tolerances: tuple[ToleranceEffect, ...]

    @property
    def text(self) -> str:
        """Message to users, without the distance for nominal sheets, which is always shown before it."""
        return f"RMS with other sheets: {', '.join(one.text for one in self.tolerances)}."

    def report(self) -> dict[str, Any]:
        """Return the entry ``band`` of the block ``equilibrium`` in report.json, with RMS distances in mm."""

        def to_mm(value: float | None) -> float | None:
            return None if value is None else 1e3 * value

        return {"text": self.text} | {one.name: [to_mm(one.rms_low), to_mm(one.rms_high)] for one in self.tolerances}
