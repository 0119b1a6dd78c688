"""Write labels that do not fit on their panels in legible letters in the waste beside them, with a tick to the panel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Float
from ..params import SheetParams
from ..progress import SILENT, Progress
from ..spirals.curves.arcs import Curve
from .nesting.packing import Packing
from .panels.labels import LEGIBLE, SmallLabel
from .panels.lettering import length, straight
from .panels.panel import Panel

BESIDE = "labels beside panels"
_WAYS = 16  # directions around a labelled point in which free space is searched
_REACH = 5.0  # maximum distance from the labelled point, in letter heights; ticks that are longer cross other ticks
_STEPS = 12  # distances tried up to ``_REACH``
_MIN_TICK = 0.5  # minimum length of a tick in letter heights; a shorter one looks like a hyphen
# maximum distance in metres from the labelled point to the outline along the tick; connectors extend so far
_MAX_DEPTH = 0.004
_LINE_POINTS = 16  # points of an outline per line in the search tree
_BATCH = 32  # boxes tested together, the nearest first; 16 or 64 take longer
_TOLERANCE = 2e-5  # maximum distance in metres of the lines in the search tree from the outlines


def labels_beside(
    panels: Sequence[Panel],
    packing: Packing,
    small: Sequence[SmallLabel],
    of_panel: Sequence[int],
    params: SheetParams,
    progress: Progress = SILENT,
) -> list[tuple[Curve, ...]]:
    """Return the strokes of every small label beside its panel, in that panel's frame; none where there is no room.

    Letters keep half of the panels' spacing from every panel and do not overlap each other.

    Parameters
    ----------
    panels, packing : the panels, and where they lie on the sheets
    small : labels to write
    of_panel : index into ``panels`` for each label
    params : spacing and height of the letters
    progress : receives the share done

    Returns
    -------
    list of tuples of curves, one tuple per label; empty without room
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
    """Free space of one sheet: outside of its panels and of the labels written so far."""

    def __init__(self, panels: Sequence[Panel], packing: Packing, sheet: int, params: SheetParams, progress: Progress):
        import shapely

        self.packing, self.height = packing, min(LEGIBLE, params.label_height)
        self.clear = 0.5 * params.spacing
        pieces, outlines = [], []
        for k in progress.part(0.0, 0.0).each(np.flatnonzero(packing.sheet == sheet).tolist(), BESIDE):
            ring = panels[k].outline.moved(float(packing.rotation[k]), packing.shift[k]).sampled(_TOLERANCE)
            outlines.append(ring)
            closed = np.concatenate([ring, ring[:1]])
            pieces += [closed[i : i + _LINE_POINTS + 1] for i in range(0, len(ring), _LINE_POINTS)]
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
        self.marks: list[Any] = []  # boxes of the letters, and ticks

    def room(self, label: SmallLabel, panel: int) -> tuple[Curve, ...]:
        """Write a label at the first free place beside its panel and return its strokes; none without room."""
        boxes, places = self._candidates(label, panel)
        for first in range(0, len(boxes), _BATCH):  # most labels fit into one of the first boxes
            some = slice(first, first + _BATCH)
            free = self._free(boxes[some])
            strokes = self._write(label, panel, boxes[some][free], places[some][free])
            if strokes:
                return strokes
        return ()

    def _candidates(self, label: SmallLabel, panel: int) -> tuple[np.ndarray, np.ndarray]:
        """Return boxes for the letters around the labelled points, nearest first, and the labelled point of each.

        Boxes are centres and half sizes (n, 4), points (n, 2), all in metres on the sheet.
        """
        turn = self.packing.rotation[panel]
        frame = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        places = label.places @ frame + self.packing.shift[panel]
        half = 0.5 * self.height * np.array([length(label.text), 1.0])
        angle = 2.0 * np.pi / _WAYS * np.arange(_WAYS)
        way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        # from the distance at which the box touches the point, outwards
        out = np.min(half / np.maximum(np.abs(way), 1e-9), axis=1)
        steps = np.linspace(self.clear, _REACH * self.height, _STEPS * (self.clear < _REACH * self.height))
        offset = (out + steps[:, None])[..., None] * way
        centres = (places[:, None] + offset[:, None]).reshape(-1, 2)
        of = np.broadcast_to(places[None, :, None], (len(steps), len(places), _WAYS, 2)).reshape(-1, 2)
        return np.concatenate([centres, np.broadcast_to(half, centres.shape)], axis=1), of

    def _free(self, boxes: Float[np.ndarray, "boxes 4"]) -> np.ndarray:
        """Return whether boxes lie inside the sheet and clear of all panels."""
        import shapely

        low, high = boxes[:, :2] - boxes[:, 2:], boxes[:, :2] + boxes[:, 2:]
        free: np.ndarray = shapely.contains_properly(self.sheet, shapely.box(*low.T, *high.T))
        inside = np.flatnonzero(free)
        grown = shapely.box(*(low[inside] - self.clear).T, *(high[inside] + self.clear).T)
        free[inside[np.unique(self.tree.query(grown, predicate="intersects")[0])]] = False
        inside = np.flatnonzero(free)
        free[inside[np.unique(self.panels.query(shapely.points(boxes[inside, :2]), predicate="intersects")[0])]] = False
        return free

    def _write(self, label: SmallLabel, panel: int, boxes: np.ndarray, places: np.ndarray) -> tuple[Curve, ...]:
        """Write the label into the first box without letters whose line to its point is free; return the strokes."""
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
        """Return a stroke from the letters towards a labelled point, or None if another outline is in the way.

        The stroke ends a third of the clearance before the outline.
        """
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
        if end < begin + _MIN_TICK * self.height or far - first > _MAX_DEPTH:
            return None
        return np.stack([box[:2] + begin * way, box[:2] + end * way])
