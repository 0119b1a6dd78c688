"""Write labels that would be too small on their panels into the waste beside them, each with a tick to its panel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Float
from ..params import SheetParams
from ..progress import SILENT, Progress
from ..spirals.curves.arcs import Curve
from .nesting.packing import Packing
from .panels.labels import LEGIBLE_HEIGHT, SmallLabel
from .panels.lettering import straight_text, text_length
from .panels.panel import Panel

BESIDE = "labels beside panels"
_DIRECTIONS = 16  # number of directions around a labelled point in which free space is searched; more find more places
_REACH = 5.0  # maximum distance of letters from the labelled point, in letter heights; longer ticks cross other ticks
_STEPS = 12  # number of distances tried up to ``_REACH``; more find nearer places and take longer
_MIN_TICK = 0.5  # minimum length of a tick in letter heights; a shorter one looks like a hyphen
# maximum distance in metres along the tick from the outline of the panel to the labelled point inside it; the point may
# be the end of an arm behind a connector, and connectors are about this long
_MAX_DEPTH = 0.004
_LINE_POINTS = 16  # an outline is split for the search tree into lines of so many points; more make fewer, longer lines
_BATCH = 32  # candidate boxes tested together, nearest first; fewer or more take longer
# maximum distance in metres between the outlines and their polylines in the search tree; larger is faster
_TOLERANCE = 2e-5


def labels_beside(
    panels: Sequence[Panel],
    packing: Packing,
    small: Sequence[SmallLabel],
    of_panel: Sequence[int],
    params: SheetParams,
    progress: Progress = SILENT,
) -> list[tuple[Curve, ...]]:
    """Return the strokes of every small label beside its panel, in the panel's frame.

    Letters keep half of the panels' spacing from every panel and do not overlap each other.

    Parameters
    ----------
    panels, packing : the panels, and where they lie on the sheets
    small : labels to write
    of_panel : index into ``panels`` for each label
    params : spacing and height of the letters
    progress : called with the fraction done; may cancel

    Returns
    -------
    list of tuples of curves, one tuple per label; empty for labels without room
    """
    found: list[tuple[Curve, ...]] = [()] * len(small)
    sheet_of = packing.sheet[np.asarray(of_panel, dtype=int)] if len(small) else np.zeros(0, dtype=int)
    done = 0
    for sheet in np.unique(sheet_of).tolist():
        own = np.flatnonzero(sheet_of == sheet).tolist()
        share = progress.part(done / len(small), (done + len(own)) / len(small))
        waste, done = _FreeWaste(panels, packing, sheet, params, share), done + len(own)
        for k in share.each(own, BESIDE):
            found[k] = waste.write_label(small[k], of_panel[k])
    return found


class _FreeWaste:
    """Free space of one sheet, outside its panels and the labels written so far."""

    def __init__(self, panels: Sequence[Panel], packing: Packing, sheet: int, params: SheetParams, progress: Progress):
        import shapely

        self.packing, self.height = packing, min(LEGIBLE_HEIGHT, params.label_height)
        self.clearance = 0.5 * params.spacing
        pieces, outlines = [], []
        for k in progress.part(0.0, 0.0).each(np.flatnonzero(packing.sheet == sheet).tolist(), BESIDE):
            ring = panels[k].outline.transform(float(packing.rotation[k]), packing.shift[k]).sample(_TOLERANCE)
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
        self.sheet = whole.buffer(-self.clearance)
        shapely.prepare(self.sheet)
        self.marks: list[Any] = []  # boxes of the letters, and ticks

    def write_label(self, label: SmallLabel, panel: int) -> tuple[Curve, ...]:
        """Write a label at the nearest free place beside its panel and return its strokes; empty without room."""
        boxes, places = self._candidates(label, panel)
        for first in range(0, len(boxes), _BATCH):  # most labels fit into one of the first boxes
            some = slice(first, first + _BATCH)
            free = self._are_free(boxes[some])
            strokes = self._write_in_first_free_box(label, panel, boxes[some][free], places[some][free])
            if strokes:
                return strokes
        return ()

    def _candidates(self, label: SmallLabel, panel: int) -> tuple[np.ndarray, np.ndarray]:
        """Return candidate boxes for the letters of a label, nearest first, and the labelled point next to each box.

        A box (n, 4) is its centre and its half sizes; boxes and points (n, 2) are in metres on the sheet.
        """
        turn = self.packing.rotation[panel]
        frame = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        places = label.places @ frame + self.packing.shift[panel]
        half = 0.5 * self.height * np.array([text_length(label.text), 1.0])
        angle = 2.0 * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)
        way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        # search outwards from the labelled point, beginning with the distance at which the box's edge touches it
        out = np.min(half / np.maximum(np.abs(way), 1e-9), axis=1)
        steps = np.linspace(self.clearance, _REACH * self.height, _STEPS * (self.clearance < _REACH * self.height))
        offset = (out + steps[:, None])[..., None] * way
        centres = (places[:, None] + offset[:, None]).reshape(-1, 2)
        of = np.broadcast_to(places[None, :, None], (len(steps), len(places), _DIRECTIONS, 2)).reshape(-1, 2)
        return np.concatenate([centres, np.broadcast_to(half, centres.shape)], axis=1), of

    def _are_free(self, boxes: Float[np.ndarray, "boxes 4"]) -> np.ndarray:
        """Return a mask (n,) of the boxes that lie inside the sheet and keep their distance from all panels."""
        import shapely

        low, high = boxes[:, :2] - boxes[:, 2:], boxes[:, :2] + boxes[:, 2:]
        free: np.ndarray = shapely.contains_properly(self.sheet, shapely.box(*low.T, *high.T))
        inside = np.flatnonzero(free)
        grown = shapely.box(*(low[inside] - self.clearance).T, *(high[inside] + self.clearance).T)
        free[inside[np.unique(self.tree.query(grown, predicate="intersects")[0])]] = False
        inside = np.flatnonzero(free)
        free[inside[np.unique(self.panels.query(shapely.points(boxes[inside, :2]), predicate="intersects")[0])]] = False
        return free

    def _write_in_first_free_box(
        self, label: SmallLabel, panel: int, boxes: np.ndarray, places: np.ndarray
    ) -> tuple[Curve, ...]:
        """Write the label into the first box that, with its tick, overlaps no other label; return the strokes.

        boxes : (n, 4) candidate boxes that are free of panels
        places : (n, 2) labelled point next to each box
        """
        import shapely

        for box, place in zip(boxes, places, strict=True):
            tick = self._make_tick(box, place)
            if tick is None:
                continue
            half = box[2:] + 0.25 * self.height
            marks = [shapely.box(*(box[:2] - half), *(box[:2] + half)), shapely.LineString(tick)]
            if len(self.marks) and any(shapely.intersects(self.marks, one).any() for one in marks):
                continue
            self.marks += marks
            strokes = [*straight_text(label.text, self.height, box[:2], np.array([1.0, 0.0])), tick]
            turn, shift = float(self.packing.rotation[panel]), self.packing.shift[panel]
            back = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            return tuple(Curve((s - shift) @ back, np.zeros(len(s)), closed=False) for s in strokes)
        return ()

    def _make_tick(self, box: np.ndarray, place: np.ndarray) -> np.ndarray | None:
        """Return the tick from the letters in ``box`` towards the labelled point ``place``, as two points.

        The tick ends before the first outline on its way, at a third of the distance that letters keep from panels.
        Return None if it would be too short, or if the labelled point lies too far behind the outline (``_MAX_DEPTH``).
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
        end = float(first) - 0.33 * self.clearance
        if end < begin + _MIN_TICK * self.height or far - first > _MAX_DEPTH:
            return None
        return np.stack([box[:2] + begin * way, box[:2] + end * way])
