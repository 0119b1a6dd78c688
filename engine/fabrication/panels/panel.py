"""One flat panel ready to cut: outline, holes, engraved strokes, and places for holding tabs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...arrays import Float
from ...spirals.curves.arcs import Curve


@dataclass(frozen=True, eq=False)
class Panel:
    """One flat panel in its patch's frame or, from ``CutSheets.on_sheet``, in its sheet's frame.

    number : engraved number, from 1 in the order of assembly; 0 for plates and keys
    patch : index in the layout; -1 for plates and keys
    outline, holes : closed curves, the outline counter-clockwise and the holes clockwise
    labels : open strokes to engrave
    area : of the material, m2
    kind : "panel", "key" (loose key of a joint) or "base" (plate that the piece stands on)
    holds : places for holding tabs: x and y in metres, and a penalty factor of at least 1
    on_hubs : strokes of the legible labels on hubs
    beside : strokes of labels in the waste beside the panel
    piece, mark : index and letter of the piece, if several pieces share sheets
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
        """Return the panel turned by ``rotation`` radians about the origin, then shifted by ``shift`` metres.

        Parameters
        ----------
        rotation : radians, counter-clockwise
        shift : metres
        """
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
    """Return points turned by ``rotation`` radians, then shifted."""
    cos, sin = np.cos(rotation), np.sin(rotation)
    return points @ np.array([[cos, sin], [-sin, cos]]) + shift
