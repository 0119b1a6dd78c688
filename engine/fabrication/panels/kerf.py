"""Paths of the cutter that leave parts in their drawn size: curves offset by half of the kerf, and dogbones.

A beam or a mill removes half of its width on either side of its path, so the path runs at that distance from the
material. The offset of an arc is an arc about the same centre, so curves keep their nodes. Points are complex numbers
here.
"""

from __future__ import annotations

import numpy as np

from ...errors import FlexMapsError
from ...spirals.contours import Outline
from ...spirals.curves.arcs import Curve
from ...tolerances import DOUBLE_TOL

# corners at which a curve turns by less than this angle in radians count as smooth and get no arc when the curve is
# offset; larger leaves more corners without an arc
TANGENT_ANGLE = 2e-3
# metres; shorter segments are removed, because controllers stutter on them; if larger, what is removed would be visible
MIN_SEGMENT = 2e-5

Arc = tuple[complex, complex, float]  # start and end of a segment (complex, metres), and its bulge


def without_empty_segments(curve: Curve) -> Curve:
    """Return the curve without segments of zero length."""
    kept = np.linalg.norm(np.roll(curve.points, -1, axis=0) - curve.points, axis=1) > DOUBLE_TOL
    if not curve.closed:
        kept[-1] = True
    return curve if kept.all() else Curve(curve.points[kept], curve.bulge[kept], curve.closed)


def without_short_segments(curve: Curve) -> Curve:
    """Return the curve without segments shorter than ``MIN_SEGMENT``; the ends of an open curve stay.

    The neighbours of a short segment then end at the intersection of their lines or circles; if that is not near the
    segment, they end at its middle.
    """
    points, bulge = curve.points @ np.array([1.0, 1.0j]), curve.bulge.copy()
    while len(points) > 3:
        short = np.flatnonzero(np.abs(np.roll(points, -1) - points)[: None if curve.closed else -1] < MIN_SEGMENT)
        if not len(short):
            break
        i, count = int(short[0]), len(points)
        j, before, after = (i + 1) % count, i - 1, (i + 2) % count
        middle = 0.5 * (points[i] + points[j])
        if not curve.closed and (i == 0 or j == count - 1):
            middle = points[0 if i == 0 else -1]
        else:
            start, end = points[[before, j]], points[[i, after]]
            sides = bulge[[before, j]]
            one, two = ((complex(a), complex(b), float(k)) for a, b, k in zip(start, end, sides, strict=True))
            nearest = min(_crossings(one, two), key=lambda p: abs(p - middle), default=middle)
            if 0.0 < abs(nearest - middle) < MIN_SEGMENT:
                middle = nearest
                first, last = np.array([start[0], middle]), np.array([middle, end[1]])
                bulge[[before, j]] = _trimmed_bulges(start, end, sides, first, last)
        points[j] = middle
        # remove node i and with it the bulge of the short segment; node j keeps the bulge of the segment that begins
        # there
        points, bulge = np.delete(points, i), np.delete(bulge, i)
    return Curve(np.column_stack([points.real, points.imag]), bulge, curve.closed)


def offset_curve(curve: Curve, distance: float) -> Curve:
    """Return the offset of a curve by ``distance`` metres to the right, to the left if negative; arcs stay arcs.

    At corners where the offset segments move apart, an arc about the corner fills the gap. Where they overlap, they are
    trimmed at their intersection, and arcs with a radius smaller than the offset vanish.

    Parameters
    ----------
    curve : lines and arcs, metres
    distance : metres to the right of the curve's direction

    Raises
    ------
    FlexMapsError : the curve is too small, or adjacent segments do not meet after the offset
    """
    if distance == 0.0:
        return curve
    curve = without_empty_segments(curve)
    start, end, bulge = _segments(curve)
    before, after = _directions(start, end, bulge)
    begins, ends = start - 1j * distance * before, end - 1j * distance * after
    # keep the segments whose direction the offset does not reverse; it reverses arcs with a radius smaller than the
    # offset
    row = np.flatnonzero(((ends - begins) * (end - start).conj()).real > DOUBLE_TOL * np.abs(end - start))
    if len(row) < 1 + curve.closed:
        raise FlexMapsError(f"A curve is too small for an offset of {abs(distance) * 1e3:g} mm")
    ahead = np.roll(row, -1)
    turn = np.angle(before[ahead] * after[row].conj())
    adjacent = (row + 1) % len(bulge) == ahead
    smooth = adjacent & (np.abs(turn) < TANGENT_ANGLE)
    fill = adjacent & ~smooth & (turn * distance > 0.0)
    inner = np.arange(len(row)) < len(row) - (not curve.closed)
    first, last = begins.copy(), ends.copy()
    joined = row[smooth & inner], ahead[smooth & inner]
    last[joined[0]] = first[joined[1]] = 0.5 * (ends[joined[0]] + begins[joined[1]])
    for i, j in zip(row[~smooth & ~fill & inner].tolist(), ahead[~smooth & ~fill & inner].tolist()):
        last[i] = first[j] = _intersection((begins[i], ends[i], bulge[i]), (begins[j], ends[j], bulge[j]))
    kept = _trimmed_bulges(begins, ends, bulge, first, last)
    # every segment has a node at its start; before a corner that an arc fills, it has another at its end
    count = np.ones(len(row), dtype=int) + (fill & inner)
    place = np.cumsum(count) - count
    nodes, bulges = np.empty(int(count.sum()), dtype=complex), np.empty(int(count.sum()))
    nodes[place], bulges[place] = first[row], kept[row]
    corner = np.flatnonzero(fill & inner)
    nodes[place[corner] + 1], bulges[place[corner] + 1] = last[row[corner]], np.tan(0.25 * turn[corner])
    if not curve.closed:
        nodes, bulges = np.append(nodes, last[row[-1]]), np.append(bulges, 0.0)
    made = without_empty_segments(Curve(np.column_stack([nodes.real, nodes.imag]), bulges, curve.closed))
    passed = ((last - first) * (end - start).conj()).real[row] < 0.0  # segments that passed those opposite to them
    if curve.closed and (passed.all() or made.area * curve.area < 0.0):
        raise FlexMapsError(f"A curve is too small for an offset of {abs(distance) * 1e3:g} mm")
    return made


def _segments(curve: Curve) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the complex start and end (N,) and the bulge (N,) of every segment."""
    points = np.ascontiguousarray(curve.points).view(np.complex128)[:, 0]
    if curve.closed:
        return points, np.roll(points, -1), curve.bulge
    return points[:-1], points[1:], curve.bulge[:-1]


def _directions(start: np.ndarray, end: np.ndarray, bulge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the complex unit directions (N,) at the start and at the end of segments."""
    chord, turn = end - start, np.exp(2j * np.arctan(bulge))
    chord = chord / np.maximum(np.abs(chord), 1e-300)
    return chord / turn, chord * turn


def _arc_centres(start: np.ndarray, end: np.ndarray, bulge: np.ndarray) -> np.ndarray:
    """Return the complex centres (N,) of arcs; no bulge may be 0."""
    return 0.5 * (start + end) + 0.25j * (end - start) * (1.0 / bulge - bulge)


def _trimmed_bulges(
    start: np.ndarray, end: np.ndarray, bulge: np.ndarray, first: np.ndarray, last: np.ndarray
) -> np.ndarray:
    """Return the bulges (N,) of arcs after moving their ends along their circles to ``first`` and ``last`` (N,)."""
    round_ = np.abs(bulge) > 1e-9
    centre = _arc_centres(start, end, np.where(round_, bulge, 1.0))
    tiny = np.abs(start - centre) < DOUBLE_TOL
    centre = np.where(tiny, centre + 1.0, centre)
    change = np.angle((last - centre) / (end - centre)) - np.angle((first - centre) / (start - centre))
    return np.where(round_, np.tan(0.25 * (4.0 * np.arctan(bulge) + change)), bulge)


def _intersection(one: Arc, two: Arc) -> complex:
    """Return the intersection, nearest to where they should meet, of two segments extended to lines and circles.

    They should meet midway between the end of ``one`` and the start of ``two``.
    """
    near = 0.5 * (one[1] + two[0])
    if abs(one[1] - two[0]) < DOUBLE_TOL:
        return near
    found = _crossings(one, two)
    if not found:
        raise FlexMapsError(
            f"The cutter has no room near x {near.real * 1e3:.1f} mm, y {near.imag * 1e3:.1f} mm; "
            "make the kerf smaller or the corners rounder"
        )
    return min(found, key=lambda p: abs(p - near))


def _crossings(one: Arc, two: Arc) -> list[complex]:
    """Return the intersections of two segments extended to whole lines and circles."""
    flat = [abs(a[2]) < 1e-9 for a in (one, two)]
    if flat[0] and flat[1]:
        d, e = one[1] - one[0], two[1] - two[0]
        det = (d.conjugate() * e).imag
        if abs(det) < 1e-12 * abs(d) * abs(e):
            return []
        return [one[0] + d * ((two[0] - one[0]).conjugate() * e).imag / det]
    if flat[1]:
        one, two, flat = two, one, [True, False]
    centre = complex(_arc_centres(np.array(two[0]), np.array(two[1]), np.array(two[2])))
    radius = abs(two[0] - centre)
    if flat[0]:
        d = (one[1] - one[0]) / abs(one[1] - one[0])
        foot = one[0] + d * ((centre - one[0]) * d.conjugate()).real
    else:
        other = complex(_arc_centres(np.array(one[0]), np.array(one[1]), np.array(one[2])))
        apart = abs(other - centre)
        if apart < DOUBLE_TOL:
            return []
        x = (apart**2 + radius**2 - abs(one[0] - other) ** 2) / (2.0 * apart)
        foot, d = centre + x * (other - centre) / apart, 1j * (other - centre) / apart
    rest = radius**2 - abs(foot - centre) ** 2
    return [foot + d * s * rest**0.5 for s in (-1.0, 1.0)] if rest >= 0.0 else []


def cut_dogbones(curve: Curve, radius: float) -> Curve:
    """Cut dogbones into the inside corners of an open curve that are too sharp for a mill.

    A dogbone is a cut along a circle as large as the mill, so that nothing of the corner is left: it passes through the
    middle of the corner's arc. Where the corner is too narrow for the mill, a corridor as wide as the mill leads to it.

    Parameters
    ----------
    curve : open curve with material on its left, metres; inside corners are arcs between straight lines
    radius : radius of the mill, metres

    Raises
    ------
    FlexMapsError : the lines are too short for a dogbone
    """
    start, end, bulge = _segments(curve)
    tight = (bulge < 0.0) & (np.abs(end - start) * (1.0 + bulge**2) < 4.0 * radius * np.abs(bulge))
    nodes: list[complex] = []
    bulges: list[float] = []
    for k, narrow in enumerate(tight.tolist()):
        if narrow:
            opened, curved = _dogbone(start[k - 1 : k + 2], end[k - 1 : k + 2], float(bulge[k]), radius)
            nodes += opened[:-1]
            bulges += curved
        else:
            nodes.append(opened[-1] if k and tight[k - 1] else start[k])
            bulges.append(float(bulge[k]))
    made = np.array([*nodes, end[-1]])
    return Curve(np.column_stack([made.real, made.imag]), np.array([*bulges, 0.0]), closed=False)


def _dogbone(start: np.ndarray, end: np.ndarray, bulge: float, radius: float) -> tuple[list[complex], list[float]]:
    """Return nodes and bulges of the dogbone that replaces an arc between two straight lines.

    start, end : (3,) complex starts and ends of the line before, the arc, and the line after
    bulge : bulge of the arc
    radius : radius of the mill, metres
    """
    half = 0.5 * np.pi + 2.0 * np.arctan(bulge)  # half of the angle between the lines
    middle = 0.5 * (start[1] + end[1]) - 0.5j * (end[1] - start[1]) * bulge
    arc = complex(_arc_centres(start[1], end[1], np.array(bulge)))
    inwards = (arc - middle) / abs(arc - middle)
    corner = arc - inwards * abs(arc - middle) / np.sin(half)
    centre = middle + radius * inwards
    lines = [(start[0] - corner), (end[2] - corner)]
    if radius / np.tan(half) > abs(centre - corner):
        reach = radius / np.sin(half)
        enter, leave = (corner + reach * line / abs(line) for line in lines)
        # seen towards the corner, the path leads along the left side of the corridor and back along its right side,
        # because the material is on the left of the path
        made = [enter, centre - 1j * inwards * radius, centre + 1j * inwards * radius, leave]
        curved = [0.0, -1.0, 0.0]
    else:
        away = abs(centre - corner)
        reach = away * np.cos(half) + np.sqrt(radius**2 - (away * np.sin(half)) ** 2)
        enter, leave = (corner + reach * line / abs(line) for line in lines)
        made = [enter, leave]
        curved = [-float(np.tan(0.25 * (np.angle((enter - centre) / (leave - centre)) % (2.0 * np.pi))))]
    if reach > min(abs(line) for line in lines):
        raise FlexMapsError(f"A corner has no room for a mill of {2e3 * radius:.3g} mm; use a thinner one")
    return made, curved


def cut_paths(outline: Outline, outer: float, holes: float) -> Outline:
    """Return the paths of the cutter around a panel and in its holes: the panel's curves offset by half of the kerf.

    Parameters
    ----------
    outline : outer curve and holes that the finished panel should have, metres
    outer, holes : width of the kerf (not half of it) along the outer curve and in holes, metres
    """
    return Outline(
        offset_curve(without_empty_segments(outline.outer), 0.5 * outer),
        tuple(offset_curve(without_empty_segments(h), 0.5 * holes) for h in outline.holes),
    )
