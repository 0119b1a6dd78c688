"""Curves made of circular arcs: length, area and points of such curves, and fits of smooth curves by biarcs.

A curve is a polyline with a bulge for every segment: the tangent of a quarter of the arc's angle, positive if the arc
turns left and 0 for a straight segment, as in DXF files.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from ...progress import SILENT, Progress


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve of straight segments and arcs.

    points : metres
    bulge : bulge of the segment from point i to point i + 1; the last bulge closes the curve (unused if it is open)
    closed : whether the curve returns to its first point
    """

    points: Float[np.ndarray, "n 2"]
    bulge: Float[np.ndarray, " n"]
    closed: bool = True

    def _segments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return start (S, 2), end (S, 2) and bulge (S,) of every segment."""
        if self.closed:
            return self.points, np.roll(self.points, -1, axis=0), self.bulge
        return self.points[:-1], self.points[1:], self.bulge[:-1]

    @property
    def length(self) -> float:
        """Length along the arcs, metres."""
        a, b, bulge = self._segments()
        chord, quarter = np.linalg.norm(b - a, axis=1), np.arctan(np.abs(bulge))
        # length of an arc = chord * half-angle / sin(half-angle)
        half = 2.0 * quarter
        return float((chord * np.where(half > 1e-9, half / np.maximum(np.sin(half), 1e-300), 1.0)).sum())

    @property
    def area(self) -> float:
        """Enclosed area, square metres; positive for a counter-clockwise curve."""
        a, b, bulge = self._segments()
        polygon = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
        chord2, angle = ((b - a) ** 2).sum(axis=1), 4.0 * np.arctan(bulge)
        # segment between chord and arc: r^2 (angle - sin angle) / 2, with r = chord / (2 sin(angle / 2))
        safe = np.where(np.abs(angle) > 1e-4, angle, 1.0)
        share = np.where(np.abs(angle) > 1e-4, (safe - np.sin(safe)) / (8.0 * np.sin(0.5 * safe) ** 2), angle / 12.0)
        return float(polygon + (chord2 * share).sum())

    def transform(self, rotation: float, shift: Float[np.ndarray, " 2"]) -> Curve:
        """Rotate the curve about the origin, then shift it.

        Parameters
        ----------
        rotation : radians, counter-clockwise
        shift : metres
        """
        cos, sin = np.cos(rotation), np.sin(rotation)
        return Curve(self.points @ np.array([[cos, sin], [-sin, cos]]) + shift, self.bulge, self.closed)

    def reversed(self) -> Curve:
        """Return the curve with its points in reverse order."""
        bulge = -self.bulge[::-1]
        return Curve(self.points[::-1], np.roll(bulge, -1), self.closed)

    def sample(self, tolerance: float = 1e-5) -> Float[np.ndarray, "m 2"]:
        """Return points on the curve (metres) whose chords deviate from the arcs by at most ``tolerance`` metres."""
        points = sample_arcs(*self._segments(), tolerance)[0]
        return points if self.closed else np.concatenate([points, self.points[-1:]])


def sample_arcs(
    a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"], bulge: Float[np.ndarray, " n"], tolerance: float
) -> tuple[Float[np.ndarray, "points 2"], Int[np.ndarray, " n"]]:
    """Sample arcs so that the chords between points deviate from the arcs by at most ``tolerance``.

    Parameters
    ----------
    a, b : (N, 2) start and end of every arc, metres
    bulge : (N,) as in ``Curve``
    tolerance : metres

    Returns
    -------
    points : (P, 2) metres, arc after arc, without the ends ``b``
    count : (N,) number of points on every arc
    """
    chord, angle = np.linalg.norm(b - a, axis=1), 4.0 * np.arctan(bulge)
    radius = 0.5 * chord / np.maximum(np.abs(np.sin(0.5 * angle)), 1e-12)
    step = 2.0 * np.arccos(np.clip(1.0 - tolerance / np.maximum(radius, 1e-12), 0.0, 1.0))
    count = np.maximum(np.ceil(np.abs(angle) / np.maximum(step, 1e-9)).astype(int), 1)
    count[np.abs(bulge) < 1e-12] = 1
    which = np.repeat(np.arange(len(a)), count)
    inner = (np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)) / count[which]
    return arc_points(a[which], b[which], bulge[which], inner[:, None])[:, 0], count


def arc_points(
    a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"], bulge: Float[np.ndarray, " n"], share: np.ndarray
) -> Float[np.ndarray, "n m 2"]:
    """Evaluate arcs at given shares of their angle.

    Parameters
    ----------
    a, b : (N, 2) start and end of every arc, metres
    bulge : (N,) as in ``Curve``
    share : (N, M) shares of the arc's angle, 0 at the start, 1 at the end

    Returns
    -------
    (N, M, 2) points, metres
    """
    half = 2.0 * np.arctan(bulge)[:, None]
    flat = np.abs(half) < 1e-9
    safe = np.where(flat, 1.0, half)
    # the chord to the point at share u has length |chord| sin(u half) / sin(half) and is turned by (u - 1) half
    scale = np.where(flat, share, np.sin(share * safe) / np.sin(safe))
    turn = (share - 1.0) * half
    chord = b - a
    x = scale * (np.cos(turn) * chord[:, :1] - np.sin(turn) * chord[:, 1:])
    y = scale * (np.sin(turn) * chord[:, :1] + np.cos(turn) * chord[:, 1:])
    return a[:, None] + np.stack([x, y], axis=-1)


def interpolate_biarcs(points: np.ndarray, tangents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate points and tangents of C curves by two arcs between successive points; arcs meet with equal tangents.

    Between points p0 and p1 with unit tangents t0 and t1, the two arcs meet halfway between p0 + d t0 and p1 - d t1,
    the corners of their tangents (Bolton 1975).

    Parameters
    ----------
    points : (C, K+1, 2)
    tangents : (C, K+1, 2) of any length

    Returns
    -------
    nodes : (C, 2K, 2) start points of all arcs, without the end points of the curves
    bulges : (C, 2K) bulges of the arcs, as in ``Curve``
    """
    tangents = tangents / np.sqrt(dot(tangents, tangents))[..., None]
    p0, p1, t0, t1 = points[:, :-1], points[:, 1:], tangents[:, :-1], tangents[:, 1:]
    v, t = p1 - p0, t0 + t1
    vv, vt, turn = dot(v, v), dot(v, t), 2.0 * (1.0 - dot(t0, t1))
    # d solves turn d^2 + 2 (v.t) d - v.v = 0; this form of the root is stable for parallel tangents
    d = vv / (vt + np.sqrt(vt * vt + turn * vv))
    joint = 0.5 * (p0 + p1 + d[..., None] * (t0 - t1))
    first = _bulge(t0, joint - p0)
    second = _bulge(p1 - joint, t1)
    nodes = np.stack([p0, joint], axis=2).reshape(len(points), -1, 2)
    return nodes, np.stack([first, second], axis=2).reshape(len(points), -1)


def _bulge(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the bulge of an arc with start tangent ``a`` and chord ``b``, or chord ``a`` and end tangent ``b``."""
    angle = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], dot(a, b))
    return np.tan(0.5 * angle)


@dataclass(frozen=True, eq=False)
class FittedArcs:
    """Many open curves of arcs, concatenated, without the end point of each curve's last arc.

    The caller adds that end point: in an outline, it is the first point of the part that follows.

    points : start points of the arcs, metres
    bulge : bulge of the arc that begins at each point, as in ``Curve``
    start : index of every curve's first point, followed by the number of all points
    """

    points: Float[np.ndarray, "n 2"]
    bulge: Float[np.ndarray, " n"]
    start: Int[np.ndarray, " starts"]

    def replace_curves(self, which: Int[np.ndarray, " k"], other: FittedArcs) -> FittedArcs:
        """Return the curves with some of them replaced.

        Parameters
        ----------
        which : indices of the curves to replace
        other : the new curves, in the order of ``which``
        """
        sizes = np.diff(self.start)
        rest = np.setdiff1d(np.arange(len(sizes)), which)
        sizes[which] = np.diff(other.start)
        start = np.concatenate([[0], np.cumsum(sizes)])
        points, bulge = np.empty((start[-1], 2)), np.empty(start[-1])
        for source, begins, curves in ((self, self.start[rest], rest), (other, other.start[:-1], which)):
            count = sizes[curves]
            along = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            there, here = np.repeat(begins, count) + along, np.repeat(start[curves], count) + along
            points[here], bulge[here] = source.points[there], source.bulge[there]
        return FittedArcs(points, bulge, start)


Evaluate = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
SPAN_COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 24, 32, 48, 64)  # numbers of biarcs that are tried for a curve, in turn


BATCH = 1500  # number of curves fitted at once (0.25 s, 40 MB); larger batches need more memory and delay a cancel


def fit_biarcs(
    evaluate: Evaluate, ends: Float[np.ndarray, "curves 2"], tolerance: float, progress: Progress = SILENT
) -> FittedArcs:
    """Fit C curves by as few biarcs as possible, each over one span of a curve.

    The spans of a curve are chosen so that their biarcs deviate about equally.

    Parameters
    ----------
    evaluate : function of curve indices (C',) and parameters (C', M); returns points and derivatives, each (C', M, 2)
    ends : (C, 2) parameters of the first and last point of every curve
    tolerance : largest distance of the arcs from the curves, metres; exceeded where 64 biarcs do not suffice
    progress : called with the fraction done; may cancel
    """
    parts = []
    for part in progress.batches(max(len(ends), 1), BATCH, "fitting arcs"):

        def evaluate_batch(which: np.ndarray, t: np.ndarray, first: int = part.start) -> tuple[np.ndarray, np.ndarray]:
            return evaluate(first + which, t)

        parts.append(_fit_batch(evaluate_batch, ends[part], tolerance))
    start = np.cumsum([0, *(len(p.points) for p in parts)])
    return FittedArcs(
        np.concatenate([p.points for p in parts]),
        np.concatenate([p.bulge for p in parts]),
        np.concatenate([[0], *(p.start[1:] + s for p, s in zip(parts, start))]),
    )


def _fit_batch(evaluate: Evaluate, ends: np.ndarray, tolerance: float) -> FittedArcs:
    """Fit curves by increasing numbers of biarcs, until all meet the tolerance or ``SPAN_COUNTS`` ends."""
    count = len(ends)
    even = np.linspace(0.0, 1.0, 49)
    sizes = np.zeros(count, dtype=np.int64)
    fits: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    every = np.arange(count)
    t = ends[:, :1] + even * (ends[:, 1:] - ends[:, :1])
    samples, tangents = evaluate(every, t)
    weight, need = _fitting_effort(samples, tangents * np.sign(ends[:, 1] - ends[:, 0])[:, None, None], tolerance)
    open_ = every
    for spans in SPAN_COUNTS:
        now = open_ if spans == SPAN_COUNTS[-1] else open_[need[open_] <= spans]
        if not len(now):
            continue
        # spans meet at every sixth point of ``marks``; at the five points between, the arcs are compared with the curve
        marks = _inverse_interpolate(weight[now], np.linspace(0.0, 1.0, 6 * spans + 1))
        p, d = evaluate(now, ends[now, :1] + marks * (ends[now, 1:] - ends[now, :1]))
        d = d[:, ::6] * np.sign(ends[now, 1] - ends[now, 0])[:, None, None]
        nodes, bulge = interpolate_biarcs(p[:, ::6], d)
        deviation = _largest_deviation(nodes, p[:, -1], bulge, p, spans)
        good = (deviation <= tolerance) | (spans == SPAN_COUNTS[-1])
        fits.append((now[good], nodes[good], bulge[good]))
        sizes[now[good]] = 2 * spans
        # deviations fall with the cube of the number of spans: skip numbers that would leave ten times the tolerance or
        # more
        need[now[~good]] = spans * np.cbrt(deviation[~good] / (10.0 * tolerance))
        open_ = np.setdiff1d(open_, now[good], assume_unique=True)
    start = np.concatenate([[0], np.cumsum(sizes)])
    points, bulges = np.empty((start[-1], 2)), np.empty(start[-1])
    for which, nodes, bulge in fits:
        place = start[which][:, None] + np.arange(nodes.shape[1])
        points[place], bulges[place] = nodes, bulge
    return FittedArcs(points, bulges, start)


def _fitting_effort(samples: np.ndarray, tangents: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the cumulative fitting effort up to every sample (C, M), from 0 to 1, and the estimated spans needed (C,).

    A biarc deviates from a curve by about |d curvature / ds| length^3 / 324 (s: arc length), so the
    number of spans per length should be proportional to the cube root of |d curvature / ds|.
    """
    move = np.diff(samples, axis=1)
    step = np.sqrt(dot(move, move))
    a, b = tangents[:, :-1], tangents[:, 1:]
    turn = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], dot(a, b))
    curvature = turn / np.maximum(step, 1e-15)
    change = np.abs(np.gradient(curvature, axis=1)) / np.maximum(step, 1e-15)
    change = np.maximum(change, np.roll(change, 1, axis=1) * 0.5)
    effort = np.cbrt(change) * step
    whole = effort.sum(axis=1, keepdims=True)
    # a small constant part keeps the ends of spans distinct on straight parts, which have no effort of their own
    effort = effort + (0.05 * whole + 1e-9) * step / np.maximum(step.sum(axis=1, keepdims=True), 1e-15)
    total = np.concatenate([np.zeros((len(step), 1)), np.cumsum(effort, axis=1)], axis=1)
    need = np.floor(0.8 * whole[:, 0] / np.cbrt(324.0 * tolerance))
    return total / total[:, -1:], np.clip(need, 1, SPAN_COUNTS[-1])


def _inverse_interpolate(
    weight: Float[np.ndarray, "curves m"], levels: Float[np.ndarray, " loops"]
) -> Float[np.ndarray, "curves loops"]:
    """Return the places in [0, 1] where each row of ``weight``, ascending and evenly sampled, reaches ``levels``."""
    count, cells = len(weight), weight.shape[1] - 1
    # add an offset to every row, so that all rows form one ascending sequence and a single search suffices
    row = 2.0 * np.arange(count)[:, None]
    place = np.searchsorted((weight + row).ravel(), (levels + row).ravel()).reshape(count, -1)
    cell = np.clip(place - 1 - np.arange(count)[:, None] * weight.shape[1], 0, cells - 1)
    lo, hi = np.take_along_axis(weight, cell, axis=1), np.take_along_axis(weight, cell + 1, axis=1)
    return np.clip((cell + (levels - lo) / np.maximum(hi - lo, 1e-15)) / cells, 0.0, 1.0)


def _largest_deviation(
    nodes: np.ndarray, last: np.ndarray, bulge: np.ndarray, true: np.ndarray, spans: int
) -> Float[np.ndarray, " curves"]:
    """Return the largest distance (C,) of the curves' points ``true`` (C, 6 spans + 1, 2) from the arcs, metres.

    The arcs begin at ``nodes`` with bulges ``bulge``; the last arc of every curve ends at ``last``.
    """
    ends = np.concatenate([nodes, last[:, None]], axis=1)
    shape = (len(nodes), spans, 2, 1)
    # points of a span are compared with both of its arcs; the nearer arc counts
    within = [true[:, i : i + 6 * spans - 5 : 6] for i in range(1, 6)]
    px, py = (np.stack([p[..., i] for p in within], axis=-1)[:, :, None] for i in range(2))  # (C, spans, 1, 5)
    (ax, ay), (cx, cy) = ((x[..., 0].reshape(shape), x[..., 1].reshape(shape)) for x in (nodes, np.diff(ends, axis=1)))
    size = np.maximum(np.sqrt(cx * cx + cy * cy), 1e-15)
    cx, cy, half = cx / size, cy / size, 0.5 * size
    dx, dy = px - ax, py - ay
    distance = _circle_distance(dx * cx + dy * cy - half, dy * cx - dx * cy, half, half * bulge.reshape(shape))
    return distance.min(axis=2).max(axis=(1, 2))


def _circle_distance(x: np.ndarray, y: np.ndarray, half: np.ndarray, sag: np.ndarray) -> np.ndarray:
    """Return the distance of (x, y) from the circle through (-half, 0), (0, -sag), (half, 0); sag 0 means a line."""
    # |power of the point| / (r + distance to the centre), with both parts multiplied by 2 sag, so that sag may be 0
    double, rest = 2.0 * sag, half * half - sag * sag
    power = (x * x + y * y - half * half) * double - 2.0 * y * rest
    twice = half * half + sag * sag  # 2 r |sag|
    to_x, to_y = double * x, double * y - rest
    return np.abs(power) / (twice + np.sqrt(to_x * to_x + to_y * to_y))


def dot(a: Float[np.ndarray, "... 2"], b: Float[np.ndarray, "... 2"]) -> np.ndarray:
    """Return the scalar products of vectors in the plane.

    Parameters
    ----------
    a, b : vectors of shapes that broadcast
    """
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]
