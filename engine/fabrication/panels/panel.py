"""One flat panel ready to cut: outline, holes, engraved strokes, and places for holding tabs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...arrays import Float
from ...spirals.curves.arcs import Curve


@dataclass(frozen=True, eq=False)
class Panel:
    """One flat panel in its patch's frame or, from ``CutSheets.panels_on_sheet``, in its sheet's frame.

    number : engraved number, from 1 in the order of assembly; 0 for plates and keys
    patch : index of its patch in the layout; -1 for plates and keys
    outline, holes : closed curves, the outline counter-clockwise and the holes clockwise
    labels : open strokes to engrave on the material
    area : area of the material, m2
    kind : "panel", "key" (loose key of a joint) or "base" (plate that the piece stands on)
    tab_places : places for holding tabs: x and y in metres, and a penalty factor, see ``plan_cuts``
    hub_labels : those of ``labels`` that lie on hubs and are large enough to read
    waste_labels : strokes of labels to engrave in the waste beside the panel; not part of ``labels``
    piece, mark : index and letter of the piece, if several pieces share sheets
    """

    number: int
    patch: int
    outline: Curve
    holes: tuple[Curve, ...]
    labels: tuple[Curve, ...]
    area: float
    tab_places: Float[np.ndarray, "places 3"] = field(default_factory=lambda: np.empty((0, 3)))
    kind: str = "panel"
    piece: int = 0
    mark: str = ""
    hub_labels: tuple[Curve, ...] = ()
    waste_labels: tuple[Curve, ...] = ()

    def transform(self, rotation: float, shift: Float[np.ndarray, " 2"]) -> Panel:
        """Return the panel turned by ``rotation`` radians about the origin, then shifted by ``shift`` metres.

        Parameters
        ----------
        rotation : radians, counter-clockwise
        shift : metres
        """
        return replace(
            self,
            outline=self.outline.transform(rotation, shift),
            holes=tuple(c.transform(rotation, shift) for c in self.holes),
            labels=tuple(c.transform(rotation, shift) for c in self.labels),
            hub_labels=tuple(c.transform(rotation, shift) for c in self.hub_labels),
            waste_labels=tuple(c.transform(rotation, shift) for c in self.waste_labels),
            tab_places=np.column_stack(
                [_transform_points(self.tab_places[:, :2], rotation, shift), self.tab_places[:, 2]]
            ),
        )


def _transform_points(points: np.ndarray, rotation: float, shift: np.ndarray) -> np.ndarray:
    """Return points turned by ``rotation`` radians, then shifted."""
    cos, sin = np.cos(rotation), np.sin(rotation)
    return points @ np.array([[cos, sin], [-sin, cos]]) + shift
