"""How far real sheets take a piece from its predicted shape, from best to worst."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Tolerance:
    """What one tolerance does to a piece.

    name : "thickness", "width" or "stiffness"; less, more : metres, RMS distances from the target at its ends, None without an equilibrium
    words : what differs, as a phrase
    """

    name: str
    less: float | None
    more: float | None
    words: str

    @property
    def text(self) -> str:
        """The phrase for people: from best to worst."""
        known = sorted(one for one in (self.less, self.more) if one is not None)
        if len(known) < 2:
            return f"no rest found {self.words}"
        return f"{1e3 * known[0]:.2g} to {1e3 * known[1]:.2g} mm {self.words}"


@dataclass(frozen=True)
class Band:
    """What real sheets do to a piece; rms : metres, its predicted distance from the target."""

    rms: float
    tolerances: tuple[Tolerance, ...]

    @property
    def text(self) -> str:
        """A sentence for people."""
        return f"RMS {1e3 * self.rms:.2g} mm from the target; {', '.join(one.text for one in self.tolerances)}."

    def report(self) -> dict[str, Any]:
        """For the ``equilibrium`` block of report.json, RMS distances in mm."""

        def shown(value: float | None) -> float | None:
            return None if value is None else 1e3 * value

        return {"text": self.text} | {one.name: [shown(one.less), shown(one.more)] for one in self.tolerances}
