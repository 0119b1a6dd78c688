"""Narrow gaps between arms, and sharp inner edges of blends, with derivatives with respect to the arms' parameters.

A gap is the distance from a point on one arm's centre line to the nearest point on another arm's centre line, less
half the width of each arm. The points lie at fixed arm parameters t (0 at the joint, 1 at the quad's centre) of the
first arm; Newton's method finds the nearest point, at s, on the second arm. Because the distance is least there, its
derivative needs no derivative of the nearest point (envelope theorem).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Columns, Complex, Float, Int
from ..curves import arm_formulas
from ..curves.arm_curves import ArmCurves, blend_offset
from ..curves.blends import ANGLE, OWN_WIND, RADIUS
from ..curves.spiral import arm_widths
from .arm_pairs import DEPTHS, ROUND, SAME_QUAD, ArmPairs

_PLACES = 13  # number of places t on the first arm where gaps are measured; more find narrower gaps and take longer
_COARSE = 25  # number of points on the second arm; Newton's method starts at the nearest one; more points are slower
# largest number of Newton steps to a nearest point: in a first estimate, and in an exact search (mostly 4 suffice)
_FIRST, _LAST = 2, 40
# margin on the limit, for gaps narrowest between two places, as a share of both widths' sum; larger is safer and slower
_BETWEEN = 0.05
# largest number of Newton steps for t and s together (mostly 5 suffice); then a slower, safe search takes over
_JOINT_STEPS = 12
_CLOSE = 1e-10  # convergence tolerance on a step in t; larger is faster and less exact
_FARTHEST = 0.15  # longest Newton step, in t; longer steps may overshoot
# places u = t / (length of the blend) where the inner edge's curvature is measured: around its sharpest turn and near
# both ends; more find sharper places and take longer
_BLEND_PLACES = np.array([0.0, 0.1, 0.17, 0.24, 0.31, 0.4, 0.8])


@dataclass(frozen=True, eq=False)
class NarrowGaps(Columns):
    """Narrow gaps between pairs of arms.

    pair : index of the gap's pair in ``ArmPairs``
    t, s : arm parameters of the nearest points on the first and on the second arm
    sign : -1 where the arms have passed through each other, so that they lie in the wrong order, else 1
    gap : width of the gap, metres; negative where arms overlap
    """

    pair: Int[np.ndarray, " k"]
    t: Float[np.ndarray, " k"]
    s: Float[np.ndarray, " k"]
    sign: Float[np.ndarray, " k"]
    gap: Float[np.ndarray, " k"]

    def arms_and_places(self, pairs: ArmPairs) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Return the first arms with their t, and the second arms with their s."""
        return (pairs.one[self.pair], self.t), (pairs.two[self.pair], self.s)


def find_narrow_gaps(
    lines: ArmCurves, pairs: ArmPairs, below: Float[np.ndarray, " n"], clockwise: bool, *, narrowest_only: bool = False
) -> NarrowGaps:
    """Return the gaps between pairs of arms that are narrower than ``below`` (n,), a limit for every pair, metres.

    narrowest_only : return only the narrowest place of every pair (faster); if any arms cross, return all places
    """
    which, t, s = _near_places(lines, pairs, below)
    beside = pairs.kind[which] == SAME_QUAD
    s[beside] = _facing_places(lines, pairs, which[beside], t[beside], clockwise)
    s, gap, less = _nearest(lines, pairs, which, t, s, _FIRST)
    between = _BETWEEN * (lines.width[pairs.one[which]] + lines.width[pairs.two[which]])
    some = np.flatnonzero(gap - 2.0 * less < below[which] + between)
    which, t, s, gap, less = which[some], t[some], s[some], gap[some], less[some]
    if narrowest_only and not _passes_outside(lines, pairs, which, t, clockwise).any():
        smallest = np.full(len(below), np.inf)
        np.minimum.at(smallest, which, gap)
        # keep only places that may turn out to be the narrowest of their pair
        some = np.flatnonzero(gap - 2.0 * less <= smallest[which])
        gaps = _narrowest_gaps(lines, pairs, which[some], t[some], s[some])
        return gaps.subset(gaps.gap < below[gaps.pair])
    s, gap, _ = _nearest(lines, pairs, which, t, s, _LAST)
    # add the exact narrowest place of every pair
    lowest = _narrowest_rows(which, gap)
    narrowest = _narrowest(lines, pairs, which[lowest], t[lowest], s[lowest])
    both = zip((which, t, s, gap), (which[lowest], *narrowest), strict=True)
    which, t, s, gap = (np.concatenate(x) for x in both)
    side = np.where(_passes_outside(lines, pairs, which, t, clockwise), -1.0, 1.0)
    some = np.flatnonzero((gap < below[which]) | (side < 0.0))
    gaps = NarrowGaps(which, t, s, side, gap).subset(some)
    if not (gaps.sign < 0.0).any():
        return gaps
    # count the distance between centre lines as negative where arms have passed through each other
    end = lines.blends
    half = [0.5 * arm_widths(lines.width[a], end.width[a], end.share[a], x)[0] for a, x in gaps.arms_and_places(pairs)]
    return replace(gaps, gap=gaps.sign * (gaps.gap + half[0] + half[1]) - half[0] - half[1])


def _narrowest_gaps(lines: ArmCurves, pairs: ArmPairs, which: np.ndarray, t: np.ndarray, s: np.ndarray) -> NarrowGaps:
    """Return the narrowest gap of every pair in ``which``; the search starts at the pair's place t of least gap."""
    s, gap, _ = _nearest(lines, pairs, which, t, s, _LAST)
    lowest = _narrowest_rows(which, gap)
    which = which[lowest]
    t, s, gap = _narrowest_jointly(lines, pairs, which, t[lowest], s[lowest], gap[lowest])
    return NarrowGaps(which, t, s, np.ones(len(which)), gap)


def _narrowest_rows(which: Int[np.ndarray, " n"], gap: Float[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
    """Return the index of the least gap of every pair; ``which`` holds the pairs of the gaps."""
    order = np.lexsort((gap, which))
    return order[np.flatnonzero(np.diff(which[order], prepend=-1))]


def _angle_between_tips(lines: ArmCurves, one: np.ndarray, two: np.ndarray, clockwise: bool) -> np.ndarray:
    """Return the angle from the second arm's tip to the first arm's tip, in the sense of inward winding, radians."""
    return ((-1.0 if clockwise else 1.0) * (lines.angle[one] - lines.angle[two])) % (2.0 * np.pi)


def _facing_places(lines: ArmCurves, pairs: ArmPairs, which: np.ndarray, t: np.ndarray, clockwise: bool) -> np.ndarray:
    """Estimate s of the nearest point to t on the facing arm of the same quad: the point at the same polar angle."""
    one, two = pairs.one[which], pairs.two[which]
    opening = _angle_between_tips(lines, one, two, clockwise)
    level = t + opening / np.maximum(np.abs(lines.wind[one]), 1e-9)
    # bound for arms with little twist: the foot of the perpendicular on a straight arm
    foot = lines.radius[one] / lines.radius[two] * np.maximum(np.cos(opening), 0.0)
    return np.clip(np.minimum(level, 1.0 - foot * (1.0 - t)), 0.0, 1.0)


def _passes_outside(lines: ArmCurves, pairs: ArmPairs, which: np.ndarray, t: np.ndarray, clockwise: bool) -> np.ndarray:
    """Return a mask of the places where the quad's facing arm lies outside the first arm, so that both have crossed."""
    one, two = pairs.one[which], pairs.two[which]
    level = t + _angle_between_tips(lines, one, two, clockwise) / np.maximum(np.abs(lines.wind[one]), 1e-9)
    beyond = lines.radius[two] * (1.0 - level) > lines.radius[one] * (1.0 - t)
    return (pairs.kind[which] == SAME_QUAD) & (level < 1.0) & beyond


def _near_places(lines: ArmCurves, pairs: ArmPairs, below: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pair, t and approximate s of all places where gaps may be narrower than ``below`` (broad phase)."""
    places: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for kind in np.unique(pairs.kind):
        here = np.flatnonzero(pairs.kind == kind)
        t, s = np.linspace(0.0, DEPTHS[kind, 0], _PLACES), np.linspace(0.0, DEPTHS[kind, 1], _COARSE)
        # sample every arm only once, though it is in several pairs
        arms, back = np.unique([pairs.one[here], pairs.two[here]], return_inverse=True)
        one, two = back.reshape(2, -1)
        p, q = _sample(lines, arms, t), _sample(lines, arms, s)
        widest = np.maximum(lines.width[arms], lines.blends.width[arms])
        enough = below[here] + 0.5 * (widest[one] + widest[two])
        # between two samples the arm may be nearer than at the samples, by up to half of the distance between them
        enough = enough**2 + 0.3 * (np.abs(np.diff(q, axis=0)).max(axis=0) ** 2)[two]
        if kind == ROUND:  # both arms of these pairs lie in one frame, so that separating lines can rule pairs out
            kept = np.maximum(_separation(p, q, one, two), 0.0) ** 2 < enough
            here, one, two, enough = here[kept], one[kept], two[kept], enough[kept]
        for first in range(0, len(here), _BATCH):
            part = slice(first, first + _BATCH)
            some = here[part]
            # pairs along the last axis, so that numpy sums long contiguous runs
            there = pairs.turn[some] * q[:, two[part]] + pairs.shift[some]
            apart = _squared_distances(p[:, one[part]], there)
            place, row = np.nonzero(apart.min(axis=1) < enough[part])
            places.append((some[row], t[place], s[apart[place, :, row].argmin(axis=1)]))
    if not places:
        return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
    return tuple(np.concatenate(x) for x in zip(*places, strict=True))  # type: ignore[return-value]


_NORMALS = np.exp(0.25j * np.pi * np.arange(4))  # unit normals of the separating lines that are tried; complex
_BATCH = 100  # number of pairs whose points are compared at once; more exceed the processor's cache


def _squared_distances(p: Complex[np.ndarray, "i n"], q: Complex[np.ndarray, "j n"]) -> Float[np.ndarray, "i j n"]:
    """Return the squared distances of all points in every column of p from all points in the same column of q."""
    out, aside = (x.copy()[:, None] - y.copy() for x, y in ((p.real, q.real), (p.imag, q.imag)))
    np.square(out, out=out)
    np.square(aside, out=aside)
    out += aside
    return out


def _separation(p: np.ndarray, q: np.ndarray, one: np.ndarray, two: np.ndarray) -> Float[np.ndarray, " n"]:
    """Return the width of a strip between points p of arms ``one`` and q of arms ``two``; negative if none is found."""
    far = np.full(len(one), -np.inf)
    for normal in _NORMALS:
        first, second = ((x * np.conj(normal)).real for x in (p, q))
        far = np.maximum(far, first.min(axis=0)[one] - second.max(axis=0)[two])
        far = np.maximum(far, second.min(axis=0)[two] - first.max(axis=0)[one])
    return far


def _sample(lines: ArmCurves, arms: np.ndarray, t: Float[np.ndarray, " m"]) -> Complex[np.ndarray, "m n"]:
    """Return points (M, N) of arms (N,) at t (M,), which must start at 0 and be evenly spaced."""
    centre, slope, share = lines.centre[arms], lines.blends.slope[arms], lines.blends.share[arms]
    spoke = lines.radius[arms] * np.exp(1j * lines.angle[arms])
    further, longest = np.exp(1j * lines.wind[arms] * t[1]), share.max()
    out = np.empty((len(t), len(arms)), dtype=complex)
    # one t at a time, so that the arrays stay in the processor's cache
    for row, place in zip(out, t, strict=True):
        np.multiply(1.0 - place, spoke, out=row)
        row += centre
        if place < longest:
            row += slope * blend_offset(share, place)
        spoke *= further
    return out


def _nearest(
    lines: ArmCurves, pairs: ArmPairs, which: np.ndarray, t: np.ndarray, s: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the s on the second arm nearest to t on the first arm, in at most ``steps`` Newton steps from ``s``.

    Return s, the gap in metres, and an estimate of the gap's decrease in one more step, metres.
    """
    one, two, kind = pairs.one[which], pairs.two[which], pairs.kind[which]
    p, _, _, half = lines.evaluate(one, t)[:4]
    # transform to the frame of the second arm
    p, last = (p - pairs.shift[which]) * np.conj(pairs.turn[which]), DEPTHS[kind, 1]
    gap = less = before = np.zeros(len(s))
    farthest = np.full(len(s), _FARTHEST)
    for step in range(steps + 1):
        q, d1, d2, h, h1, h2 = lines.evaluate(two, s)
        off = q - p
        apart = np.maximum(np.abs(off), 1e-12)
        gap = apart - h - half
        slope = (off.real * d1.real + off.imag * d1.imag) / apart
        bend = (d1.real**2 + d1.imag**2 + off.real * d2.real + off.imag * d2.imag - slope**2) / apart - h2
        slope -= h1
        bend = np.maximum(bend, 0.25 * (d1.real**2 + d1.imag**2) / apart)
        wanted = -slope / bend
        # after a change of direction, halve the longest step, so that steps do not oscillate
        farthest = np.where(wanted * before < 0.0, 0.5 * np.abs(before), farthest)
        move = before = np.clip(s + np.clip(wanted, -farthest, farthest), 0.0, last) - s
        less = np.abs(slope * move)
        if step == steps or (np.abs(move) < _CLOSE).all():
            break
        s = s + move
    return s, gap, less


def _narrowest(
    lines: ArmCurves, pairs: ArmPairs, which: np.ndarray, t: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the narrowest gap between the sampled places before and after t on the first arm.

    The search is Newton's method, safeguarded by a bracket. Return t, s and the gap in metres.
    """
    depth = DEPTHS[pairs.kind[which], 0]
    step = depth / (_PLACES - 1)
    low, high = np.maximum(t - step, 0.0), np.minimum(t + step, depth)
    t, gap, moving = t.copy(), np.zeros(len(t)), np.arange(len(t))
    s = s.copy()
    for _ in range(_LAST):
        now = which[moving], t[moving]
        s[moving], gap[moving], _ = _nearest(lines, pairs, *now, s[moving], _LAST)
        slope, bend = _derivatives_along_arm(lines, pairs, *now, s[moving])
        low[moving] = np.where(slope < 0.0, now[1], low[moving])
        high[moving] = np.where(slope > 0.0, now[1], high[moving])
        to = now[1] - slope / np.where(bend > 0.0, bend, 1e-300)
        within = (to > low[moving]) & (to < high[moving]) | (slope == 0.0)
        t[moving] = np.where(within, to, 0.5 * (low[moving] + high[moving]))
        moving = moving[np.abs(t[moving] - now[1]) > _CLOSE]
        if not len(moving):
            break
    return t, s, gap


def _narrowest_jointly(
    lines: ArmCurves, pairs: ArmPairs, which: np.ndarray, t: np.ndarray, s: np.ndarray, bounds: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the results of ``_narrowest`` faster, by Newton's method for t and s together.

    bounds : gaps at the start values t, metres, which the result must not exceed
    """
    kind = pairs.kind[which]
    last, step = DEPTHS[kind, 1], DEPTHS[kind, 0] / (_PLACES - 1)
    low, high = np.maximum(t - step, 0.0), np.minimum(t + step, DEPTHS[kind, 0])
    out = t.copy(), s.copy(), bounds.copy()
    moving, before, far = np.arange(len(t)), np.zeros(len(t)), 2.0 * step
    for _ in range(_JOINT_STEPS):
        at, there = out[0][moving], out[1][moving]
        gap, (by_t, by_s), (own, cross, other) = _gap_derivatives(lines, pairs, which[moving], at, there)
        held = ((there <= 0.0) & (by_s > 0.0)) | ((there >= last[moving]) & (by_s < 0.0))
        share = np.where(held, 0.0, cross / other)
        slope, bend = by_t - np.where(held, 0.0, share * by_s), own - share * cross
        wanted = np.where(bend > 0.0, -slope / np.where(bend > 0.0, bend, 1.0), -np.sign(slope) * step[moving])
        # after a change of direction, halve the longest step, so that steps do not oscillate
        far[moving] = np.where(wanted * before[moving] < 0.0, 0.5 * np.abs(before[moving]), far[moving])
        to = np.clip(at + np.clip(wanted, -far[moving], far[moving]), low[moving], high[moving])
        before[moving] = to - at
        follow = np.where(held, 0.0, np.clip(-by_s / other - share * before[moving], -_FARTHEST, _FARTHEST))
        out[0][moving], out[1][moving] = to, np.clip(there + follow, 0.0, last[moving])
        out[2][moving] = gap
        moved = np.maximum(np.abs(before[moving]), np.abs(out[1][moving] - there))
        moving = moving[moved > _CLOSE]
        if not len(moving):
            break
    # use the safeguarded search where Newton's method did not converge, or converged to a wider gap
    lost = out[2] > bounds + 1e-12
    lost[moving] = True
    if lost.any():
        again = _narrowest(lines, pairs, which[lost], t[lost], s[lost])
        for whole, part in zip(out, again, strict=True):
            whole[lost] = part
    return out


def _derivatives_along_arm(
    lines: ArmCurves, pairs: ArmPairs, which: np.ndarray, t: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and second derivatives of gaps by t, while s stays at the nearest point on the second arm."""
    _, (by_t, _), (own, cross, other) = _gap_derivatives(lines, pairs, which, t, s)
    # a nearest point at an end of the second arm stays there when t changes
    free = (s > 0.0) & (s < DEPTHS[pairs.kind[which], 1])
    return by_t, own - np.where(free, cross**2 / np.maximum(other, 1e-12), 0.0)


def _gap_derivatives(
    lines: ArmCurves, pairs: ArmPairs, which: np.ndarray, t: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return gaps in metres, their first derivatives (by t, by s) and their second derivatives (tt, ts, ss).

    The second derivative by s is kept above a quarter of its value for straight arms, so that Newton steps descend.
    """
    turn = pairs.turn[which]
    p, p1, p2, half, half1, half2 = lines.evaluate(pairs.one[which], t)
    q, q1, q2, h, h1, h2 = lines.evaluate(pairs.two[which], s)
    off, q1, q2 = turn * q + pairs.shift[which] - p, turn * q1, turn * q2
    apart = np.maximum(np.abs(off), 1e-12)
    off /= apart
    along, there = (off * np.conj(p1)).real, (off * np.conj(q1)).real
    pace, size = (p1 * np.conj(p1)).real, (q1 * np.conj(q1)).real
    own = (pace - along**2) / apart - (off * np.conj(p2)).real - half2
    other = np.maximum((size - there**2) / apart + (off * np.conj(q2)).real - h2, 0.25 * size / apart)
    cross = -((p1 * np.conj(q1)).real - along * there) / apart
    return apart - h - half, (-along - half1, there - h1), (own, cross, other)


def gap_slopes(
    lines: ArmCurves, pairs: ArmPairs, gaps: NarrowGaps
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the derivatives of K gaps by both arms' parameters and by the nearest points, and these points.

    The first two results, (K, N_ARM_PARAMETERS), belong to the first and to the second arms' parameters. The nearest
    points lie on the second arms; they and the derivatives by them are complex, (K,), in the first arm's frame, metres.
    """
    (one, t), (two, s) = gaps.arms_and_places(pairs)
    turn = pairs.turn[gaps.pair]
    place = turn * lines.points(two, s) + pairs.shift[gaps.pair]
    off = place - lines.points(one, t)
    way = gaps.sign * off / np.maximum(np.abs(off), 1e-12)
    point, half = lines.point_and_width_vjp(one, t, way)
    there, width = lines.point_and_width_vjp(two, s, way * np.conj(turn))
    return -point - half, there - width, way, place


def find_sharp_edges(
    lines: ArmCurves, arms: Int[np.ndarray, " n"], below: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Find the places in blends where the inner edge is sharp.

    An edge is sharp if its radius of curvature is less than the centre line's radius of curvature times ``below`` (n,).
    Return the arm, u = t / (length of the blend) and the ratio of both radii of every such place.
    """
    end = lines.blends
    i = np.broadcast_to(arms[:, None], (len(arms), len(_BLEND_PLACES)))
    u = np.broadcast_to(_BLEND_PLACES, i.shape)
    _, d1, d2, half = lines.evaluate(i, end.share[i] * u)[:4]
    left = 1.0 - half * np.abs((np.conj(d1) * d2).imag) / np.abs(d1) ** 3
    some = left < below[:, None]
    return i[some], u[some], left[some]


def sharp_edge_slopes(
    lines: ArmCurves, i: Int[np.ndarray, " k"], u: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "k numbers"]:
    """Return the derivatives of ``find_sharp_edges``'s ratios at arms i and places u by the blends' parameters."""
    end = lines.blends
    share, slope, wind = end.share[i], end.slope[i], lines.wind[i]
    t = share * u
    _, d1, d2, half = lines.evaluate(i, t)[:4]
    turn = arm_formulas.spiral_directions(lines.angle[i], wind, t)
    r = lines.radius[i] * (1.0 - t)
    q1, q2 = arm_formulas.blend_quintic_slope(u), arm_formulas.blend_quintic_curvature(u)
    first, second = slope * q1, slope * q2 / share
    pure = d1 - first, d2 - second
    third = (3.0 * wind**2 * lines.radius[i] - 1j * wind**3 * r) * turn
    moves = [q1[:, None] * end.slope_by[i], (q2 / share)[:, None] * end.slope_by[i]]
    # at a fixed u, t changes with the length of the blend
    moves[0] += (pure[1] * u)[:, None] * end.share_by[i]
    moves[1] += (third * u - second / share)[:, None] * end.share_by[i]
    for k in range(2):
        moves[k][:, RADIUS] += pure[k] / lines.radius[i]
        moves[k][:, ANGLE] += 1j * pure[k]
    moves[0][:, OWN_WIND] += 1j * t * pure[0] + 1j * r * turn
    moves[1][:, OWN_WIND] += 1j * t * pure[1] + (-2.0 * wind * r - 2j * lines.radius[i]) * turn
    size = np.abs(d1)
    bent = (np.conj(d1) * d2).imag
    change = (np.conj(moves[0]) * d2[:, None] + np.conj(d1)[:, None] * moves[1]).imag / (size**3)[:, None]
    change -= (3.0 * bent / size**5)[:, None] * (np.conj(d1)[:, None] * moves[0]).real
    joint = arm_formulas.fade_out(u)
    # at a fixed u, the width does not depend on the length of the blend
    wide = 0.5 * joint[:, None] * end.width_by[i]
    wide[:, 0] += 0.5 * (1.0 - joint)
    return -np.sign(bent)[:, None] * (half[:, None] * change + wide * (bent / size**3)[:, None])
