"""Toolpaths: lead-ins, by which the cutter enters a path, and holding tabs, which keep the part in its sheet.

Paths are closed curves with the material on their left. A lead-in begins in the waste, on the right of its path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Float
from ...params import CutParams
from ...progress import SILENT, Progress
from ...spirals.curves.arcs import Curve, arc_points
from .kerf import without_short_segments
from .order import CutGroup, order_cuts

CUTTER_PATH = "the way of the cutter"
_START_COUNT = 24  # number of nodes of a closed path at which a lead-in is tried
_LENGTH_SHARES = (1.0, 0.5)  # lengths of a lead-in tried in this order, as shares of the requested length
# A holding tab is a gap in the cut along an outline. The straight distance between the ends of the gap is required;
# where the outline bends, the gap has to be longer along the outline. Maximum length of half a gap along the outline,
# as a multiple of the required distance; larger values permit more places and longer gaps
MAX_HALF_TAB_AT_TIPS = 0.95  # used where the outline turns back before the gap is wide enough, as around narrow tips
MAX_HALF_TAB = 2.5  # used elsewhere, as in bays that open outwards; gaps do not overlap even if each is so long
_NARROW_PENALTY = 1e6  # penalty factor of places where the tab would be narrower than required, so that they come last
_HALVINGS = 20  # bisections for the length of a gap, which make it exact to a millionth
_ANGLES = np.radians([25.0, 45.0, 65.0, 90.0])  # angles in radians between a lead-in and its path, tried in order


@dataclass(frozen=True, eq=False)
class SheetCuts:
    """The cuts of one sheet, in the order of cutting.

    engraving : strokes of the labels
    inner_cuts, outer_cuts : cuts of holes and of outlines; with a lead-in or between two holding tabs a cut is open
    lead_ins_left_out : number of cuts that begin on their path because a lead-in has no room
    tab_count : number of holding tabs
    """

    engraving: tuple[Curve, ...]
    inner_cuts: tuple[Curve, ...]
    outer_cuts: tuple[Curve, ...]
    lead_ins_left_out: int
    tab_count: int


def plan_cuts(
    labels: list[Curve],
    holes: list[tuple[Curve, ...]],
    outlines: list[Curve],
    places: list[Float[np.ndarray, "_ 3"]],
    size: tuple[float, float],
    cut: CutParams,
    progress: Progress = SILENT,
) -> SheetCuts:
    """Plan the cuts of one sheet, with the requested holding tabs and lead-ins, in an order with little travel.

    Labels are engraved first, then all holes are cut, panel by panel, and then the outlines.

    Parameters
    ----------
    labels : strokes to engrave
    holes : closed paths of the cutter in every panel's holes
    outlines : closed path of the cutter around every panel
    places : (K, 3) for every outline, places for holding tabs: x and y in metres, and a penalty factor of at least 1; a
        place with factor 3 is preferred to one with factor 1 only if it is 3 times as far from the other tabs
    size : width and height of the sheet, metres
    cut : tabs and lead-ins
    progress : called with the fraction done; may cancel
    """
    pieces = [[o] for o in outlines]
    if cut.tabs:
        held = list(zip(outlines, places, strict=True))
        pieces = [_with_tabs(o, p, cut) for o, p in progress.part(0.0, 0.3).each(held, CUTTER_PATH)]
    tabs = sum(len(p) for p in pieces if not p[0].closed)
    whole = [(h, panel) for panel, some in enumerate(holes) for h in some]
    inner = [(without_short_segments(h), panel) for h, panel in progress.part(0.3, 0.32).each(whole, CUTTER_PATH)]
    pieces = [[without_short_segments(c) for c in some] for some in progress.part(0.32, 0.34).each(pieces, CUTTER_PATH)]
    missing = 0
    if cut.lead_in:
        led = [
            with_lead_in(h, cut.lead_in, _inside_test(h)) for h, _ in progress.part(0.34, 0.5).each(inner, CUTTER_PATH)
        ]
        free = _outside_test(outlines, size, progress.part(0.5, 0.55))
        out = [
            [with_lead_in(c, cut.lead_in, free) for c in p] for p in progress.part(0.55, 0.7).each(pieces, CUTTER_PATH)
        ]
        missing = sum(c is None for c in (*led, *(c for some in out for c in some)))
        inner = [(h if c is None else c, panel) for (h, panel), c in zip(inner, led, strict=True)]
        pieces = [[p if c is None else c for p, c in zip(*both, strict=True)] for both in zip(pieces, out, strict=True)]
    strokes = [CutGroup((c,), i, is_reversible=True) for i, c in enumerate(labels)]
    engraved, here = order_cuts(strokes, 0.0, progress.part(0.7, 0.8))
    first, here = order_cuts([CutGroup((h,), panel) for h, panel in inner], here, progress.part(0.8, 0.9))
    last, _ = order_cuts([CutGroup(tuple(p), i) for i, p in enumerate(pieces)], here, progress.part(0.9, 1.0))
    return SheetCuts(engraved, first, last, missing, tabs)


# -- lead-ins --------------------------------------------------------------------------------------------------------


def with_lead_in(curve: Curve, length: float, free: Any) -> Curve | None:
    """Return the curve as an open cut with a lead-in; None if there is no room for a lead-in.

    Parameters
    ----------
    curve : path of the cutter; a closed path may begin at any of its nodes
    length : length of the lead-in, metres; half of it where the whole length has no room
    free : function from shapely linestrings to whether each lies in the waste
    """
    import shapely

    points = curve.points @ np.array([1.0, 1.0j])
    # an open path begins at a holding tab: enter at a right angle, or the lead-in would cut into the tab
    angles = _ANGLES if curve.closed else _ANGLES[-1:]
    starts = (
        np.unique(np.linspace(0, len(points) - 1, _START_COUNT).astype(int)) if curve.closed else np.zeros(1, dtype=int)
    )
    following = points[(starts + 1) % len(points)]
    way = (following - points[starts]) * np.exp(-2j * np.arctan(curve.bulge[starts]))
    way = way / np.abs(way)
    for share in _LENGTH_SHARES:
        # a lead-in comes from behind the start of the path and from its right
        offset = share * length * -way[:, None] * np.exp(1j * angles)
        begin, end = points[starts][:, None] + offset, points[starts][:, None] + 0.02 * offset
        lines = np.stack([begin, end], axis=-1).reshape(-1, 2)
        found = np.flatnonzero(free(shapely.linestrings(np.stack([lines.real, lines.imag], axis=-1))))
        if not len(found):
            continue
        # take the smallest angle with which some lead-in has room, at the first node where it has
        best = int(found[np.argmin(found % len(angles))])
        start, lead = int(starts[best // len(angles)]), lines[best, 0]
        order = (np.arange(len(points) + curve.closed) + start) % len(points)
        run = np.concatenate([[[lead.real, lead.imag]], curve.points[order]])
        bulge = np.concatenate([[0.0], curve.bulge[order[:-1]], [0.0]])
        return Curve(run, bulge, closed=False)
    return None


def _inside_test(hole: Curve) -> Any:
    """Return a function that tests which lines lie inside a hole."""
    import shapely

    waste = shapely.Polygon(hole.sample(5e-6))
    shapely.prepare(waste)
    return lambda lines: shapely.contains_properly(waste, lines)


def _outside_test(outlines: list[Curve], size: tuple[float, float], progress: Progress) -> Any:
    """Return a function that tests which lines lie on the sheet and outside all outlines."""
    import shapely

    parts = shapely.STRtree([shapely.Polygon(o.sample(5e-6)) for o in progress.each(outlines, CUTTER_PATH)])
    sheet = shapely.box(0.0, 0.0, *size)

    def free(lines: np.ndarray) -> np.ndarray:
        found = shapely.within(lines, sheet)
        found[parts.query(lines, predicate="intersects")[0]] = False
        return found

    return free


# -- holding tabs ----------------------------------------------------------------------------------------------------


def _with_tabs(outline: Curve, places: np.ndarray, cut: CutParams) -> list[Curve]:
    """Return the open parts of an outline between holding tabs, or the whole outline if there are no places for tabs.

    Places far from other tabs and with a small penalty are best. Places where the outline turns back before the ends of
    the gap are as far apart as required, as around narrow tips, are used last.

    outline : closed path of the cutter
    places : (K, 3) x and y in metres, and a penalty factor of at least 1, see ``plan_cuts``
    cut : number and width of the tabs, and the kerf
    """
    gap, length = cut.tab_width + cut.kerf_outline, outline.length
    if not len(places):
        return [outline]
    at = _nearest_along(outline, places[:, :2])
    wide = _chord_across(outline, at, MAX_HALF_TAB * gap) >= gap
    liked = np.where(wide, 1.0, _NARROW_PENALTY) * places[:, 2]
    chosen: list[float] = []
    reach: dict[float, float] = {}
    for _ in range(cut.tabs):
        apart = np.array([[abs((a - c + 0.5 * length) % length - 0.5 * length) for c in chosen] for a in at])
        alone = apart.min(axis=1) if chosen else np.full(len(at), length)
        worth = np.where(alone > 2.0 * MAX_HALF_TAB * gap, alone / liked, -1.0)
        if worth.max() < 0.0:
            break
        best = int(np.argmax(worth))
        chosen.append(float(at[best]))
        reach[chosen[-1]] = MAX_HALF_TAB if wide[best] else MAX_HALF_TAB_AT_TIPS
    chosen.sort()
    halves = [_half_gap(outline, at, gap, reach[at]) for at in chosen]
    return [
        curve_between(outline, a + before, b - after)
        for (a, b), before, after in zip(
            zip(chosen, [*chosen[1:], chosen[0] + length], strict=True), halves, [*halves[1:], halves[0]], strict=True
        )
    ]


def _chord_across(outline: Curve, middle: np.ndarray, half: float) -> np.ndarray:
    """Return the straight distances (K,) between two points of a closed curve on either side of every place.

    middle : (K,) positions of the places along the curve, metres
    half : distance of the two points from the place along the curve, metres
    """
    line = outline.sample(1e-6)
    line = np.concatenate([line, line[:1]])
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    ends = [(middle + way) % outline.length * run[-1] / outline.length for way in (-half, half)]
    points = [np.stack([np.interp(e, run, line[:, k]) for k in range(2)], axis=1) for e in ends]
    return np.asarray(np.linalg.norm(points[1] - points[0], axis=1))


def _half_gap(outline: Curve, middle: float, gap: float, widest: float) -> float:
    """Return half of the length in metres, along the outline, of a gap whose ends are a straight ``gap`` metres apart.

    middle : position of the gap's middle along the outline, metres
    widest : maximum of the returned length, as a multiple of ``gap``
    """
    low, high = 0.5 * gap, widest * gap
    for _ in range(_HALVINGS):
        half = 0.5 * (low + high)
        part = curve_between(outline, middle - half, middle + half)
        low, high = (half, high) if np.linalg.norm(part.points[-1] - part.points[0]) < gap else (low, half)
    return high


def _nearest_along(curve: Curve, points: np.ndarray) -> np.ndarray:
    """Return the positions (K,) in metres along a closed curve that are nearest to points (K, 2)."""
    from scipy.spatial import cKDTree

    line = curve.sample(1e-6)
    line = np.concatenate([line, line[:1]])
    step = np.linalg.norm(np.diff(line, axis=0), axis=1)
    count = np.maximum(np.ceil(step / 1e-4).astype(int), 1)
    which = np.repeat(np.arange(len(step)), count)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)) / count[which]
    dense = line[which] + share[:, None] * np.diff(line, axis=0)[which]
    found = cKDTree(dense).query(points)[1]
    # chords are shorter than the curve by about a millionth, so scale to the length of the curve
    run = np.concatenate([[0.0], np.cumsum(step)])
    return (run[which[found]] + share[found] * step[which[found]]) * curve.length / run[-1]


def curve_between(curve: Curve, begin: float, end: float) -> Curve:
    """Return the open part of a closed curve between two positions in metres along it.

    Parameters
    ----------
    curve : closed curve
    begin, end : positions, begin < end; negative positions and positions beyond the curve's length wrap around
    """
    lengths = _segment_lengths(curve)
    run = np.concatenate([[0.0], np.cumsum(np.tile(lengths, 3))]) - lengths.sum()
    first, last = np.searchsorted(run, begin, side="right") - 1, np.searchsorted(run, end, side="left") - 1
    count, nodes, bulges = len(lengths), [], []
    for k in range(first, last + 1):
        a, b = curve.points[k % count], curve.points[(k + 1) % count]
        low, high = max(begin - run[k], 0.0) / lengths[k % count], min((end - run[k]) / lengths[k % count], 1.0)
        quarter = np.arctan(curve.bulge[k % count])
        nodes.append(_arc_point(a, b, quarter, low))
        bulges.append(np.tan((high - low) * quarter))
        if k == last:
            nodes.append(_arc_point(a, b, quarter, high))
    return Curve(np.array(nodes), np.array([*bulges, 0.0]), closed=False)


def _segment_lengths(curve: Curve) -> np.ndarray:
    """Return the length of every segment in metres."""
    chord = np.linalg.norm(np.roll(curve.points, -1, axis=0) - curve.points, axis=1)
    half = 2.0 * np.abs(np.arctan(curve.bulge))
    return chord * np.where(half > 1e-9, half / np.maximum(np.sin(half), 1e-300), 1.0)


def _arc_point(a: np.ndarray, b: np.ndarray, quarter: float, share: float) -> np.ndarray:
    """Return the point of an arc from ``a`` to ``b`` at ``share`` of its length; ``quarter`` is 1/4 of its angle."""
    return arc_points(a[None], b[None], np.tan(np.array([quarter])), np.array([[share]]))[0, 0]
