"""Prove that a flat patch is injective: no flipped triangle, no handle and a simple outline together suffice."""

from __future__ import annotations

import numpy as np

from ...arrays import Bool, Complex, Int
from ..layout import loops_of_sides

# Largest result of ``isthmus_width``: wider isthmuses do not count. A rectangle 1.5 times as long as wide has this value.
# It must exceed every limit with which a width is compared.
MAX_ISTHMUS = 0.4
# Relative error bound of orientation tests (Shewchuk 1997). Larger: sides count as touching at a larger distance; smaller
# values would not cover the rounding error.
ROUNDING_TOL = 8.0 * np.finfo(float).eps


def has_simple_outline(
    points: Complex[np.ndarray, " vertices"],
    corners: Int[np.ndarray, "quads 4"],
    sides: Bool[np.ndarray, "quads 4"],
    patch: Int[np.ndarray, " quads"] | None = None,
) -> bool:
    """Return whether the outline of a patch neither crosses nor touches itself and exactly one loop is not a hole.

    Without flips, a flat patch covers every point of the plane as often as its loops wind round the point. If the loops
    are disjoint and one of them is counter-clockwise, this number is 0 or 1. Sides that are apart by less than the
    rounding error count as touching, so that True is a proof (Shewchuk 1997, first filter).

    Parameters
    ----------
    points : flat vertices, complex, metres
    corners : flat vertices of the quads
    sides : mask of the sides on the outline
    patch : patch of every quad, from 0, if there are several patches; each patch is checked by itself
    """
    start = corners[sides]
    end = np.roll(corners, -1, axis=1)[sides]
    a, b = points[start], points[end]
    slack = ROUNDING_TOL * float(np.abs(points).max(initial=0.0))
    x_low, x_high = np.minimum(a.real, b.real) - slack, np.maximum(a.real, b.real) + slack
    y_low, y_high = np.minimum(a.imag, b.imag) - slack, np.maximum(a.imag, b.imag) + slack
    near = (
        (x_low[:, None] <= x_high)
        & (x_high[:, None] >= x_low)
        & (y_low[:, None] <= y_high)
        & (y_high[:, None] >= y_low)
    )
    owner = np.zeros(len(a), dtype=int) if patch is None else patch[np.nonzero(sides)[0]]
    if patch is not None:
        near &= owner[:, None] == owner
    one, two = np.nonzero(np.triu(near, 1))
    # adjacent sides share a vertex and cannot cross elsewhere, unless one folds back onto the other
    follow = (end[one] == start[two]) | (end[two] == start[one])
    if _folds_back(a, b, start, end, one[follow], two[follow]):
        return False
    one, two = one[~follow], two[~follow]
    if not _has_one_outer_loop(a, b, start, end, owner):
        return False
    left = _orientation(a[one], b[one], a[two]) * _orientation(a[one], b[one], b[two])
    right = _orientation(a[two], b[two], a[one]) * _orientation(a[two], b[two], b[one])
    return not bool(((left <= 0) & (right <= 0)).any())


def _has_one_outer_loop(a: np.ndarray, b: np.ndarray, start: np.ndarray, end: np.ndarray, owner: np.ndarray) -> bool:
    """Return whether exactly one outline loop of every patch is counter-clockwise.

    a, b : points at the start and the end of every side on an outline
    start, end : flat vertices of these points
    owner : patch of every side
    """
    loop = loops_of_sides(start, end)
    first = np.unique(loop, return_index=True)[1]
    if len(first) == owner.max(initial=0) + 1:
        return True  # the only loop of a patch without flips is counter-clockwise
    origin = a[first][loop]
    area = np.bincount(loop, weights=((a - origin).conj() * (b - origin)).imag)
    return bool((np.bincount(owner[first], weights=area > 0) == 1).all())


def _folds_back(
    a: np.ndarray, b: np.ndarray, start: np.ndarray, end: np.ndarray, one: np.ndarray, two: np.ndarray
) -> bool:
    """Return whether, for any i, the adjacent sides ``one[i]`` and ``two[i]`` fold back onto each other.

    a, b : points at the start and the end of every side
    start, end : flat vertices of these points
    """
    swap = end[one] != start[two]
    first, second = np.where(swap, two, one), np.where(swap, one, two)
    turn = (b[second] - a[second]) * (b[first] - a[first]).conj()
    return bool(((turn.real < 0) & (_orientation(a[first], b[first], b[second]) == 0)).any())


def _orientation(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the orientation of triangles a, b, c: 1 counter-clockwise, -1 clockwise, 0 within the rounding error."""
    p, q = b - a, c - a
    one, two = p.real * q.imag, p.imag * q.real
    det = one - two
    # the differences p and q have rounding errors too, of a few units in the last digit of the coordinates
    scale = np.abs(a) + np.abs(b) + np.abs(c)
    slack = ROUNDING_TOL * (np.abs(one) + np.abs(two) + scale * (np.abs(p) + np.abs(q)))
    return np.where(det > slack, 1, np.where(det < -slack, -1, 0))


def isthmus_width(outline: Complex[np.ndarray, " points"], rim: Bool[np.ndarray, " points"] | None = None) -> float:
    """Return the relative width of the narrowest isthmus of a polygon, at most 0.4.

    An isthmus is a chord of the polygon; its relative width is its length over the shorter part of the outline between
    its ends. Only ends at least 0.08 of the outline apart count. A rectangle four times as long as wide has 0.2.

    Parameters
    ----------
    outline : points of the polygon, complex, counter-clockwise
    rim : mask of points on the border of the surface; chords between two such points are ignored, because there the
        surface itself is narrow
    """
    count = len(outline)
    after = np.roll(outline, -1)
    along = np.concatenate([[0.0], np.cumsum(np.abs(after - outline))])
    total = along[-1]
    step = max(1, count // 90)
    pick = np.arange(0, count, step)
    p, at = outline[pick], along[pick]
    arc = np.abs(at[None, :] - at[:, None])
    arc = np.minimum(arc, total - arc)
    ratio = np.where(arc > 0.08 * total, np.abs(p[None, :] - p[:, None]) / np.maximum(arc, 1e-300), 1.0)
    if rim is not None:
        ratio[rim[pick][:, None] & rim[pick]] = MAX_ISTHMUS
    i, j = np.nonzero(np.triu(ratio < MAX_ISTHMUS))
    # at both ends the chord must start into the polygon, between the adjacent sides
    forward, backward, chord = after[pick] - p, np.roll(outline, 1)[pick] - p, p[j] - p[i]
    inside = _is_between(forward[i], chord, backward[i]) & _is_between(forward[j], -chord, backward[j])
    return float(ratio[i, j][inside].min(initial=MAX_ISTHMUS))


def _is_between(first: np.ndarray, middle: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return whether ``middle`` lies counter-clockwise between ``first`` and ``last``, all plane vectors."""
    turn, one, two = _cross(first, last), _cross(first, middle) > 0, _cross(middle, last) > 0
    return np.where(turn > 0, one & two, one | two)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product of plane vectors, given as complex numbers."""
    return a.real * b.imag - a.imag * b.real
