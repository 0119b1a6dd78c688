"""One flat panel as it is cut: outline, holes, engraved strokes, and where it may be held."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...arrays import Float
from ...spirals.arcs import Curve


@dataclass(frozen=True, eq=False)
class Panel:
    """One flat panel, in its patch's frame or, from ``CutSheets.on_sheet``, in its sheet's.

    number : what is engraved on it, from 1 in the order in which panels are joined; patch : index of its patch in the layout; 0 and -1 for other parts
    outline : counter-clockwise; holes : clockwise; labels : open single strokes; area : square metres of material
    kind : panel, key for the loose key of a joint, base for a plate that the piece stands on
    holds : where a holding tab may be: x and y in metres, and how little it is liked there
    on_hubs : the legible labels that stand on hubs; beside : strokes of labels in the waste round the panel
    piece, mark : of several pieces on common sheets the one that it belongs to, and that one's letter
    """

    number: int
    patch: int
    outline: Curve
    holes: tuple[Curve, ...]
    labels: tuple[Curve, ...]
    area: float
    holds: Float[np.ndarray, "places 3"] = field(default_factory=lambda: np.empty((0, 3)))
    kind: str = "panel"
    piece: int = 0
    mark: str = ""
    on_hubs: tuple[Curve, ...] = ()
    beside: tuple[Curve, ...] = ()

    def moved(self, rotation: float, shift: Float[np.ndarray, " 2"]) -> Panel:
        """Turned by ``rotation`` radians about the origin, then shifted, in metres."""
        return replace(
            self,
            outline=self.outline.moved(rotation, shift),
            holes=tuple(c.moved(rotation, shift) for c in self.holes),
            labels=tuple(c.moved(rotation, shift) for c in self.labels),
            on_hubs=tuple(c.moved(rotation, shift) for c in self.on_hubs),
            beside=tuple(c.moved(rotation, shift) for c in self.beside),
            holds=np.column_stack([_moved(self.holds[:, :2], rotation, shift), self.holds[:, 2]]),
        )


def _moved(points: np.ndarray, rotation: float, shift: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(rotation), np.sin(rotation)
    return points @ np.array([[cos, sin], [-sin, cos]]) + shift
