"""Labels that the material has no room for, in letters of a legible height in the waste beside their panels, with a tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Float
from ..params import SheetParams
from ..progress import SILENT, Progress
from ..spirals.arcs import Curve
from .nesting.packing import Packing
from .panels.labels import LEGIBLE, SmallLabel
from .panels.lettering import length, straight
from .panels.panel import Panel

BESIDE = "labels beside panels"
_WAYS = 16  # directions round a place in which room is looked for
_REACH = 5.0  # letter heights from the place at most; farther off a tick crosses other ticks
_STEPS = 12  # distances up to there
_SHORT = 0.5  # letter heights that a tick is long at least, or it looks like a hyphen
_NEAR = 0.004  # metres between a place and where its tick meets the outline; connectors reach as far
_PIECE = 16  # points of an outline that are one line of the search tree
_TOGETHER = 32  # boxes that are looked at together, the nearest first; with 16 or 64 it takes longer
_TOLERANCE = 2e-5  # metres between outlines and the lines of the search tree


def labels_beside(
    panels: Sequence[Panel],
    packing: Packing,
    small: Sequence[SmallLabel],
    of_panel: Sequence[int],
    params: SheetParams,
    progress: Progress = SILENT,
) -> list[tuple[Curve, ...]]:
    """Return the strokes of every small label beside its panel, in that panel's frame; none where there is no room.

    Letters stay away from every panel by half of the panels' spacing, and off each other.

    Parameters
    ----------
    of_panel : the place in ``panels`` of every label's panel
    """
    found: list[tuple[Curve, ...]] = [()] * len(small)
    sheet_of = packing.sheet[np.asarray(of_panel, dtype=int)] if len(small) else np.zeros(0, dtype=int)
    done = 0
    for sheet in np.unique(sheet_of).tolist():
        own = np.flatnonzero(sheet_of == sheet).tolist()
        share = progress.part(done / len(small), (done + len(own)) / len(small))
        waste, done = _Waste(panels, packing, sheet, params, share), done + len(own)
        for k in share.each(own, BESIDE):
            found[k] = waste.room(small[k], of_panel[k])
    return found


class _Waste:
    """What is left of one sheet between panels and labels."""

    def __init__(self, panels: Sequence[Panel], packing: Packing, sheet: int, params: SheetParams, progress: Progress):
        import shapely

        self.packing, self.height = packing, min(LEGIBLE, params.label_height)
        self.clear = 0.5 * params.spacing
        pieces, outlines = [], []
        for k in progress.part(0.0, 0.0).each(np.flatnonzero(packing.sheet == sheet).tolist(), BESIDE):
            ring = panels[k].outline.moved(float(packing.rotation[k]), packing.shift[k]).sampled(_TOLERANCE)
            outlines.append(ring)
            closed = np.concatenate([ring, ring[:1]])
            pieces += [closed[i : i + _PIECE + 1] for i in range(0, len(ring), _PIECE)]
        owner = np.repeat(np.arange(len(pieces)), [len(one) for one in pieces])
        self.tree = shapely.STRtree(shapely.linestrings(np.concatenate(pieces), indices=owner))
        owner = np.repeat(np.arange(len(outlines)), [len(one) for one in outlines])
        rings = shapely.linearrings(np.concatenate(outlines), indices=owner)
        self.panels = shapely.STRtree(shapely.polygons(rings))
        whole = (
            packing.remnants[sheet].polygon
            if sheet < len(packing.remnants)
            else shapely.box(0, 0, *packing.sizes[sheet])
        )
        self.sheet = whole.buffer(-self.clear)
        shapely.prepare(self.sheet)
        self.marks: list[Any] = []  # letters, as boxes, and ticks

    def room(self, label: SmallLabel, panel: int) -> tuple[Curve, ...]:
        """The strokes of a label, with the place of its panel; none where there is no room."""
        boxes, places = self._candidates(label, panel)
        for first in range(0, len(boxes), _TOGETHER):  # most find room among the first
            some = slice(first, first + _TOGETHER)
            free = self._free(boxes[some])
            strokes = self._written(label, panel, boxes[some][free], places[some][free])
            if strokes:
                return strokes
        return ()

    def _candidates(self, label: SmallLabel, panel: int) -> tuple[np.ndarray, np.ndarray]:
        """Centres and half sizes (n, 4) of boxes for letters round the places, the nearest first, and the place of each (n, 2)."""
        turn = self.packing.rotation[panel]
        frame = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        places = label.places @ frame + self.packing.shift[panel]
        half = 0.5 * self.height * np.array([length(label.text), 1.0])
        angle = 2.0 * np.pi / _WAYS * np.arange(_WAYS)
        way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        # as far as the box's edge from its middle that way, and on
        out = np.min(half / np.maximum(np.abs(way), 1e-9), axis=1)
        steps = np.linspace(self.clear, _REACH * self.height, _STEPS * (self.clear < _REACH * self.height))
        offset = (out + steps[:, None])[..., None] * way
        centres = (places[:, None] + offset[:, None]).reshape(-1, 2)
        of = np.broadcast_to(places[None, :, None], (len(steps), len(places), _WAYS, 2)).reshape(-1, 2)
        return np.concatenate([centres, np.broadcast_to(half, centres.shape)], axis=1), of

    def _free(self, boxes: Float[np.ndarray, "boxes 4"]) -> np.ndarray:
        """Whether boxes lie in the sheet and off all panels."""
        import shapely

        low, high = boxes[:, :2] - boxes[:, 2:], boxes[:, :2] + boxes[:, 2:]
        free: np.ndarray = shapely.contains_properly(self.sheet, shapely.box(*low.T, *high.T))
        inside = np.flatnonzero(free)
        grown = shapely.box(*(low[inside] - self.clear).T, *(high[inside] + self.clear).T)
        free[inside[np.unique(self.tree.query(grown, predicate="intersects")[0])]] = False
        inside = np.flatnonzero(free)
        free[inside[np.unique(self.panels.query(shapely.points(boxes[inside, :2]), predicate="intersects")[0])]] = False
        return free

    def _written(self, label: SmallLabel, panel: int, boxes: np.ndarray, places: np.ndarray) -> tuple[Curve, ...]:
        """The strokes in the first of some boxes that is free of letters and has a clear way to its place."""
        import shapely

        for box, place in zip(boxes, places, strict=True):
            tick = self._tick(box, place)
            if tick is None:
                continue
            half = box[2:] + 0.25 * self.height
            marks = [shapely.box(*(box[:2] - half), *(box[:2] + half)), shapely.LineString(tick)]
            if len(self.marks) and any(shapely.intersects(self.marks, one).any() for one in marks):
                continue
            self.marks += marks
            strokes = [*straight(label.text, self.height, box[:2], np.array([1.0, 0.0])), tick]
            turn, shift = float(self.packing.rotation[panel]), self.packing.shift[panel]
            back = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            return tuple(Curve((s - shift) @ back, np.zeros(len(s)), closed=False) for s in strokes)
        return ()

    def _tick(self, box: np.ndarray, place: np.ndarray) -> np.ndarray | None:
        """A stroke from the letters towards a place, up to a third of the clearance before the outline; None if another is in its way."""
        import shapely

        way = place - box[:2]
        far = float(np.linalg.norm(way))
        way = way / far
        begin = float(np.min(box[2:] / np.maximum(np.abs(way), 1e-9))) + 0.2 * self.height
        line = shapely.LineString([box[:2], place + 1e-3 * way])
        near = self.tree.geometries[self.tree.query(line, predicate="intersects")]
        first = min(
            (shapely.distance(shapely.Point(box[:2]), shapely.intersection(one, line)) for one in near), default=far
        )
        end = float(first) - 0.33 * self.clear
        if end < begin + _SHORT * self.height or far - first > _NEAR:
            return None
        return np.stack([box[:2] + begin * way, box[:2] + end * way])
