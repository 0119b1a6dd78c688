"""The frame: a closed ring of planks under the feet instead of a whole plate, joined by dovetails.

The ring visits the slots along a short closed path that does not cross itself. It is the union of the convex hulls of
consecutive slots, with a margin. It is cut between slots where it has turned far enough, or where a plank would be
larger than the sheet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...params import SheetParams
from ...spirals.curves.arcs import Curve
from ...tolerances import DOUBLE_TOL
from ..nesting.packing import find_fitting_rotation
from .corners import CORNER_RADIUS, round_corners

# maximum change of direction along a plank, radians; larger: fewer, wider planks; by eye
MAX_PLANK_TURN = np.radians(75.0)
# width of a dovetail at its neck and at its head, and its depth, as shares of the plank's width; by eye
NECK_SHARE, HEAD_SHARE, DEPTH_SHARE = 0.3, 0.42, 0.25
# maximum width of the ring at a cut, as a multiple of its width in straight parts; a wider place is a corner, where a
# cut would run along the ring
MAX_CUT_WIDTH_RATIO = 1.4
# minimum size of a dovetail, as a share of the size that suits the width of the ring; larger permits fewer cuts between
# close feet; by eye
MIN_DOVETAIL_SHARE = 0.4
CHORDS_PER_QUARTER = 12  # chords per quarter circle in the buffer around slots; arcs replace its corners later
SIMPLIFY_TOLERANCE = 1e-5  # tolerance in metres with which the buffer around slots is simplified
OVERLAP = 1e-7  # metres by which shapes to be subtracted extend beyond an edge, so that no slivers are left
MIN_SLOTS = 3  # minimum number of slots for a ring


def make_planks(
    slots: Float[np.ndarray, "slots 4 2"], margin: float, clearance: float, wall: float, sheet: SheetParams
) -> list[tuple[Curve, np.ndarray]]:
    """Return for every plank its outline, counter-clockwise in metres, and the indices of the slots in it.

    Parameters
    ----------
    slots : corners of every slot, metres
    margin : material around the slots, metres
    clearance : gap around a dovetail, metres
    wall : minimum distance between a slot and a dovetail, metres
    sheet : size of the sheets

    Raises
    ------
    FlexMapsError : the slots do not form a ring, or the ring cannot be divided into planks
    """
    import shapely

    if len(slots) < MIN_SLOTS:
        raise FlexMapsError(
            f"A frame goes round at least {MIN_SLOTS} feet; support more spirals, or choose a plate or feet"
        )
    order = shortest_closed_path(slots.mean(axis=1))
    slots = slots[order]
    links = shapely.convex_hull(shapely.multipoints(np.concatenate([slots, np.roll(slots, -1, axis=0)], axis=1)))
    ring = shapely.union_all(shapely.buffer(links, margin, quad_segs=CHORDS_PER_QUARTER)).simplify(SIMPLIFY_TOLERANCE)
    inner = [shapely.Polygon(hole) for hole in ring.interiors]
    if not inner:
        raise FlexMapsError(
            "The feet stand so near to each other that a frame under them has no hole; choose a plate, or a narrower edge"
        )
    # keep only the largest hole, and fill slivers between the hulls
    ring = shapely.Polygon(ring.exterior, [max(inner, key=lambda one: one.area).exterior])
    parts = _choose_cuts(slots, ring, margin, wall, sheet)
    if len(parts) < 2:
        raise FlexMapsError(
            "The feet stand too near to each other to cut a frame between them; choose a plate, or feet"
        )
    return _cut_into_planks(slots, ring, parts, order, clearance, margin)


def shortest_closed_path(points: Float[np.ndarray, "n 2"]) -> np.ndarray:
    """Return the order of points on a short closed path, counter-clockwise, that does not cross itself.

    The path is found by 2-opt (Croes 1958), which starts with the order of the points' directions from their mean.
    """
    seen = points - points.mean(axis=0)
    order = np.argsort(np.arctan2(seen[:, 1], seen[:, 0]))
    count = len(order)
    shorter = True
    while shorter:
        shorter = False
        for i in range(count - 1):
            for j in range(i + 2, count - (i == 0)):
                a, b, c, d = points[order[[i, i + 1, j, (j + 1) % count]]]
                gain = np.linalg.norm(a - b) + np.linalg.norm(c - d) - np.linalg.norm(a - c) - np.linalg.norm(b - d)
                if gain > DOUBLE_TOL:
                    order[i + 1 : j + 1] = order[i + 1 : j + 1][::-1].copy()
                    shorter = True
    p = points[order]
    area = 0.5 * (p[:, 0] * np.roll(p[:, 1], -1) - p[:, 1] * np.roll(p[:, 0], -1)).sum()
    return order if area > 0.0 else order[::-1].copy()


@dataclass(frozen=True, eq=False)
class _RingCut:
    """A place where the ring may be cut.

    after : index of the slot after which the cut lies
    middle, direction : centre of the cut (metres), and unit direction of the ring there
    width : width of the ring midway between the slots on both sides of the cut, metres
    dovetail_scale : width of a ring to which the dovetail's dimensions would fit, metres: at most ``width``, smaller
        where the slots are close together
    """

    after: int
    middle: Float[np.ndarray, " 2"]
    direction: Float[np.ndarray, " 2"]
    width: float
    dovetail_scale: float

    @property
    def left_normal(self) -> Float[np.ndarray, " 2"]:
        """Unit vector to the left of the ring's direction."""
        return np.array([-self.direction[1], self.direction[0]])

    def tongue(self, behind: float) -> Any:
        """Return the shapely polygon of the dovetail's tongue, from ``behind`` metres before the cut to its head."""
        import shapely

        neck, head, deep = (
            0.5 * NECK_SHARE * self.dovetail_scale,
            0.5 * HEAD_SHARE * self.dovetail_scale,
            DEPTH_SHARE * self.dovetail_scale,
        )
        rows = [(-behind, -neck), (0.0, -neck), (deep, -head), (deep, head), (0.0, neck), (-behind, neck)]
        return shapely.Polygon([self.middle + u * self.direction + v * self.left_normal for u, v in rows])


def _cut_between(slots: np.ndarray, k: int, ring: Any, margin: float, wall: float) -> _RingCut | None:
    """Return the cut of the ring between slot ``k`` and the next slot; None if there is no room for a dovetail.

    margin : width of the ring around the slots, metres
    wall : minimum distance between a slot and a dovetail, metres
    """
    import shapely

    pair = shapely.polygons(slots[[k, (k + 1) % len(slots)]])
    line = shapely.shortest_line(*pair)
    one, two = shapely.get_coordinates(line)
    gap = float(np.linalg.norm(two - one))
    middles = slots[[k, (k + 1) % len(slots)]].mean(axis=1)
    way = middles[1] - middles[0]
    way /= max(float(np.linalg.norm(way)), 1e-12)
    middle, aside = 0.5 * (one + two), np.array([-way[1], way[0]])
    reach = 4.0 * (margin + float(np.ptp(slots[k], axis=0).max())) * aside

    def across(point: np.ndarray) -> np.ndarray:
        lines = shapely.get_parts(shapely.LineString([point - reach, point + reach]).intersection(ring))
        near = [shapely.get_coordinates(one) for one in lines if one.distance(shapely.Point(point)) < 1e-9]
        return near[0] if near else np.zeros((2, 2))

    width, room = float(np.linalg.norm(np.ptp(across(middle), axis=0))), gap - 2.0 * wall
    size = min(width, room / DEPTH_SHARE)
    # width that the ring would have here if it did not turn
    usual = 2.0 * margin + float(np.ptp(slots[[k, (k + 1) % len(slots)]] @ aside, axis=1).max())
    if not 0.0 < width < MAX_CUT_WIDTH_RATIO * usual or size < MIN_DOVETAIL_SHARE * width:
        return None
    # the dovetail extends only ahead of the cut, so the cut is moved towards the slot behind it
    ends = across(middle - 0.5 * DEPTH_SHARE * size * way)
    there = float(np.linalg.norm(np.ptp(ends, axis=0)))
    if not 0.0 < there < MAX_CUT_WIDTH_RATIO * usual:
        return None
    middle = ends.mean(axis=0)
    return _RingCut(k, middle, way, width, size)


def _choose_cuts(slots: np.ndarray, ring: Any, margin: float, wall: float, sheet: SheetParams) -> list[_RingCut]:
    """Return as few cuts of the ring as possible such that planks are slender and fit on the sheet."""
    import shapely

    count, size = len(slots), (sheet.sheet_width, sheet.sheet_height)
    open_ = {k: found for k in range(count) if (found := _cut_between(slots, k, ring, margin, wall)) is not None}
    if len(open_) < 2:
        return []
    way = np.roll(slots.mean(axis=1), -1, axis=0) - slots.mean(axis=1)
    angle = np.arctan2(way[:, 1], way[:, 0])
    turns = np.abs((np.roll(angle, -1) - angle + np.pi) % (2.0 * np.pi) - np.pi)
    places = sorted(open_)
    # begin where the ring turns most, so that the corners of the ring become ends of planks
    start = max(places, key=lambda k: turns[k] + turns[k - 1])
    places = [k for k in places if k > start] + [k + count for k in places if k <= start]
    parts: list[_RingCut] = []
    since = start

    def fits(first: int, last: int) -> bool:
        rows = np.arange(first + 1, last + 1) % count
        if turns[rows[:-1]].sum() > MAX_PLANK_TURN:
            return False
        ends = open_[first % count], open_[last % count]
        points = np.concatenate([slots[rows].reshape(-1, 2), [end.middle for end in ends]])
        around = shapely.convex_hull(shapely.multipoints(points)).buffer(margin + DEPTH_SHARE * ends[1].dovetail_scale)
        around = shapely.get_coordinates(around)
        return find_fitting_rotation(around, size, sheet.margin, sheet.rotation) is not None

    for here, after in zip(places, [*places[1:], None], strict=True):
        if after is None or not fits(since, after):
            parts.append(open_[here % count])
            since = here
    return parts


def _cut_into_planks(
    slots: np.ndarray, ring: Any, cuts: list[_RingCut], order: np.ndarray, clearance: float, margin: float
) -> list[tuple[Curve, np.ndarray]]:
    """Cut the ring into planks, each with a dovetail at its end and a socket at its beginning.

    Parameters
    ----------
    slots, order : corners of the slots in their order along the ring, and the index of each slot before this ordering
    ring, cuts : shapely polygon of the ring, and where it is cut
    clearance : gap around a dovetail, metres
    margin : radius of the ring's own corners, metres

    Returns
    -------
    For every plank its outline, and the indices, before the ordering, of the slots in it
    """
    import shapely

    count = len(slots)
    tongues = [cut.tongue(2.0 * clearance + OVERLAP) for cut in cuts]
    sockets = [tongue.buffer(clearance, join_style="mitre") for tongue in tongues]
    gates = [_gap_at_cut(cut, ring, clearance) for cut in cuts]
    parts = shapely.get_parts(ring.difference(shapely.union_all(gates)))
    found = []
    for n, cut in enumerate(cuts):
        before, last = cuts[n - 1].after, cut.after
        rows = np.arange(before + 1, last + 1 + (count if last <= before else 0)) % count
        own = [part for part in parts if part.covers(shapely.Point(slots[rows[0]].mean(axis=0)))]
        if len(parts) != len(cuts) or len(own) != 1:
            raise FlexMapsError(
                "The feet stand such that a frame between them would touch itself; choose a plate, or feet"
            )
        body = shapely.union_all([own[0], tongues[n]]).difference(sockets[n - 1])
        body = max(shapely.get_parts(body), key=lambda one: one.area)
        corners = shapely.get_coordinates(shapely.orient_polygons(body).exterior.simplify(1e-7))[:-1]
        cutting = shapely.union_all([tongues[n], gates[n], sockets[n - 1], gates[n - 1]])
        sharp = shapely.distance(shapely.points(corners), cutting) < CORNER_RADIUS
        found.append((round_corners(corners, _corner_radii(corners, sharp, margin)), order[rows]))
    return found


def _gap_at_cut(cut: _RingCut, ring: Any, clearance: float) -> Any:
    """Return the gap between two planks as a polygon: a strip across the ring, as wide as the clearance."""
    import shapely

    reach = 4.0 * cut.width * cut.left_normal
    strip = shapely.LineString([cut.middle - reach, cut.middle + reach]).buffer(0.5 * clearance, cap_style="flat")
    inside = min(shapely.get_parts(strip.intersection(ring)), key=lambda one: one.distance(shapely.Point(cut.middle)))
    return inside.buffer(OVERLAP, join_style="mitre")


def _corner_radii(corners: np.ndarray, sharp: np.ndarray, margin: float) -> np.ndarray:
    """Return the radius in metres with which every corner is rounded.

    It is ``CORNER_RADIUS`` where the mask ``sharp`` is True, elsewhere ``margin``, and less where sides are short.
    """
    ahead = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    sides, turn = np.minimum(ahead, np.roll(ahead, 1)), np.roll(corners, -1, axis=0) - corners
    angle = np.arctan2(turn[:, 1], turn[:, 0])
    angle = np.abs((angle - np.roll(angle, 1) + np.pi) % (2.0 * np.pi) - np.pi)
    # an arc shortens both sides by its radius times the tangent of half the turn
    most = 0.45 * sides / np.maximum(np.tan(0.5 * np.minimum(angle, 3.0)), 1e-6)
    return np.minimum(np.where(sharp, CORNER_RADIUS, margin), most)
