"""Narrow gaps between arms and sharp inner edges of their blends, with derivatives by the arms' numbers.

A gap lies between a point of one arm and the nearest point of another, less half of both widths. The points stand at fixed
parameters of the one arm, the nearest ones are found by Newton's method: there the distance is least, so its derivative is that at
fixed parameters (envelope theorem).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Complex, Float, Int
from .blends import ANGLE, OWN_WIND, RADIUS
from .lines import Lines, bent
from .pairs import BESIDE, DEPTHS, ROUND, Pairs
from .spiral import widths

# Where gaps are measured: at so many t on the first arm of a pair
_PLACES = 13
_COARSE = 25  # points of the second arm among which the nearest is looked for where nothing tells where it is
# Newton's steps to the nearest points: to find out which gaps are narrow, and to know those to the last digit, mostly in 4
_FIRST, _LAST = 2, 40
# Gaps may be narrower between two such places than at either, by so much of the widths of both arms: at most 0.01 was seen
_BETWEEN = 0.05
# Newton's steps for both places at once, mostly 5, after which they are looked for one after the other
_TOGETHER_STEPS = 12
_CLOSE = 1e-10  # t that the last step is shorter than
_FARTHEST = 0.15  # t that one such step goes at most
# u of the blended end, t = share u, where its inner edge is looked at: round its sharpest turn, and at both ends
_TURNS = np.array([0.0, 0.1, 0.17, 0.24, 0.31, 0.4, 0.8])


@dataclass(frozen=True, eq=False)
class Narrow:
    """Gaps of pairs of arms.

    pair : their numbers; t, s : places on the first and on the second arm
    side : -1 where the first arm lies on the wrong side of the second, else 1
    gap : metres, negative where arms run through each other
    """

    pair: Int[np.ndarray, " k"]
    t: Float[np.ndarray, " k"]
    s: Float[np.ndarray, " k"]
    side: Float[np.ndarray, " k"]
    gap: Float[np.ndarray, " k"]

    def of(self, some: np.ndarray) -> Narrow:
        """Some of the gaps."""
        return Narrow(*(getattr(self, name)[some] for name in self.__dataclass_fields__))

    def both(self, pairs: Pairs) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """The arms of the pairs and the places on them."""
        return (pairs.one[self.pair], self.t), (pairs.two[self.pair], self.s)


def narrow(
    lines: Lines, pairs: Pairs, below: Float[np.ndarray, " n"], clockwise: bool, *, least: bool = False
) -> Narrow:
    """The gaps less than ``below`` metres, (n,) for every pair.

    least : only the narrowest place of every pair, which is found sooner; all of them where arms run through each other
    """
    which, t, s = _near(lines, pairs, below)
    beside = pairs.kind[which] == BESIDE
    s[beside] = _beside(lines, pairs, which[beside], t[beside], clockwise)
    s, gap, less = _nearest(lines, pairs, which, t, s, _FIRST)
    between = _BETWEEN * (lines.width[pairs.one[which]] + lines.width[pairs.two[which]])
    some = np.flatnonzero(gap - 2.0 * less < below[which] + between)
    which, t, s, gap, less = which[some], t[some], s[some], gap[some], less[some]
    if least and not _through(lines, pairs, which, t, clockwise).any():
        known = np.full(len(below), np.inf)
        np.minimum.at(known, which, gap)
        # places that may turn out to be the narrowest of their pair
        some = np.flatnonzero(gap - 2.0 * less <= known[which])
        found = _narrowest_of_pairs(lines, pairs, which[some], t[some], s[some])
        return found.of(found.gap < below[found.pair])
    s, gap, _ = _nearest(lines, pairs, which, t, s, _LAST)
    # and at the very narrowest place of every pair
    lowest = _lowest(which, gap)
    narrowest = _narrowest(lines, pairs, which[lowest], t[lowest], s[lowest])
    both = zip((which, t, s, gap), (which[lowest], *narrowest), strict=True)
    which, t, s, gap = (np.concatenate(x) for x in both)
    side = np.where(_through(lines, pairs, which, t, clockwise), -1.0, 1.0)
    some = np.flatnonzero((gap < below[which]) | (side < 0.0))
    found = Narrow(which, t, s, side, gap).of(some)
    if not (found.side < 0.0).any():
        return found
    # on the wrong side of the other arm, the distance of the centre lines counts against it
    half = [0.5 * widths(lines.width[a], lines.end.width[a], lines.end.share[a], x)[0] for a, x in found.both(pairs)]
    return replace(found, gap=found.side * (found.gap + half[0] + half[1]) - half[0] - half[1])


def _narrowest_of_pairs(lines: Lines, pairs: Pairs, which: np.ndarray, t: np.ndarray, s: np.ndarray) -> Narrow:
    """The narrowest gap of every pair that has places here, near to the narrowest of these."""
    s, gap, _ = _nearest(lines, pairs, which, t, s, _LAST)
    lowest = _lowest(which, gap)
    which = which[lowest]
    t, s, gap = _at_once(lines, pairs, which, t[lowest], s[lowest], gap[lowest])
    return Narrow(which, t, s, np.ones(len(which)), gap)


def _lowest(which: Int[np.ndarray, " n"], gap: Float[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
    """Return where the gap of every pair is least."""
    order = np.lexsort((gap, which))
    return order[np.flatnonzero(np.diff(which[order], prepend=-1))]


def _opening(lines: Lines, one: np.ndarray, two: np.ndarray, clockwise: bool) -> np.ndarray:
    """Radians from the second arm to the first, against the sense in which they wind."""
    return ((-1.0 if clockwise else 1.0) * (lines.angle[one] - lines.angle[two])) % (2.0 * np.pi)


def _beside(lines: Lines, pairs: Pairs, which: np.ndarray, t: np.ndarray, clockwise: bool) -> np.ndarray:
    """About where the facing arm of a quad is nearest: where it passes at the same angle."""
    one, two = pairs.one[which], pairs.two[which]
    opening = _opening(lines, one, two, clockwise)
    level = t + opening / np.maximum(np.abs(lines.wind[one]), 1e-9)
    # of straight arms the foot of the perpendicular
    foot = lines.radius[one] / lines.radius[two] * np.maximum(np.cos(opening), 0.0)
    return np.clip(np.minimum(level, 1.0 - foot * (1.0 - t)), 0.0, 1.0)


def _through(lines: Lines, pairs: Pairs, which: np.ndarray, t: np.ndarray, clockwise: bool) -> np.ndarray:
    """Where the facing arm of a quad passes outside of the arm that it faces."""
    one, two = pairs.one[which], pairs.two[which]
    level = t + _opening(lines, one, two, clockwise) / np.maximum(np.abs(lines.wind[one]), 1e-9)
    beyond = lines.radius[two] * (1.0 - level) > lines.radius[one] * (1.0 - t)
    return (pairs.kind[which] == BESIDE) & (level < 1.0) & beyond


def _near(lines: Lines, pairs: Pairs, below: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of pairs that may be near, and about where the second arm is nearest."""
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for kind in np.unique(pairs.kind):
        here = np.flatnonzero(pairs.kind == kind)
        t, s = np.linspace(0.0, DEPTHS[kind, 0], _PLACES), np.linspace(0.0, DEPTHS[kind, 1], _COARSE)
        # every arm is drawn once
        arms, back = np.unique([pairs.one[here], pairs.two[here]], return_inverse=True)
        one, two = back.reshape(2, -1)
        p, q = _drawn(lines, arms, t), _drawn(lines, arms, s)
        widest = np.maximum(lines.width[arms], lines.end.width[arms])
        enough = below[here] + 0.5 * (widest[one] + widest[two])
        # between two points that are a step apart an arm may be nearer by what half of the step takes off
        enough = enough**2 + 0.3 * (np.abs(np.diff(q, axis=0)).max(axis=0) ** 2)[two]
        if kind == ROUND:  # which lie in one plane as they are
            kept = np.maximum(_parted(p, q, one, two), 0.0) ** 2 < enough
            here, one, two, enough = here[kept], one[kept], two[kept], enough[kept]
        for first in range(0, len(here), _TOGETHER):
            part = slice(first, first + _TOGETHER)
            some = here[part]
            # the pairs come last: long runs of plain sums
            there = pairs.turn[some] * q[:, two[part]] + pairs.shift[some]
            apart = _squares(p[:, one[part]], there)
            place, row = np.nonzero(apart.min(axis=1) < enough[part])
            found.append((some[row], t[place], s[apart[place, :, row].argmin(axis=1)]))
    if not found:
        return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
    return tuple(np.concatenate(x) for x in zip(*found, strict=True))  # type: ignore[return-value]


_WAYS = np.exp(0.25j * np.pi * np.arange(4))  # across which arms are looked at for lines that part them
_TOGETHER = 100  # pairs whose points are compared at once, so that they stay in the processor's cache


def _squares(p: Complex[np.ndarray, "i n"], q: Complex[np.ndarray, "j n"]) -> Float[np.ndarray, "i j n"]:
    """Squared distances of all points in a column of p from all in that of q."""
    out, aside = (x.copy()[:, None] - y.copy() for x, y in ((p.real, q.real), (p.imag, q.imag)))
    np.square(out, out=out)
    np.square(aside, out=aside)
    out += aside
    return out


def _parted(p: np.ndarray, q: np.ndarray, one: np.ndarray, two: np.ndarray) -> Float[np.ndarray, " n"]:
    """Metres between two lines that part the points p of arms ``one`` from the points q of arms ``two``; negative where none do."""
    far = np.full(len(one), -np.inf)
    for way in _WAYS:
        first, second = ((x * np.conj(way)).real for x in (p, q))
        far = np.maximum(far, first.min(axis=0)[one] - second.max(axis=0)[two])
        far = np.maximum(far, second.min(axis=0)[two] - first.max(axis=0)[one])
    return far


def _drawn(lines: Lines, arms: np.ndarray, t: Float[np.ndarray, " m"]) -> Complex[np.ndarray, "m n"]:
    """Points of arms (N,) at evenly spaced t from 0 on, (M, N)."""
    centre, slope, share = lines.centre[arms], lines.end.slope[arms], lines.end.share[arms]
    spoke = lines.radius[arms] * np.exp(1j * lines.angle[arms])
    further, longest = np.exp(1j * lines.wind[arms] * t[1]), share.max()
    out = np.empty((len(t), len(arms)), dtype=complex)
    # one place after the other, so that what is worked on stays in the processor's cache
    for row, place in zip(out, t, strict=True):
        np.multiply(1.0 - place, spoke, out=row)
        row += centre
        if place < longest:
            row += slope * bent(share, place)
        spoke *= further
    return out


def _nearest(
    lines: Lines, pairs: Pairs, which: np.ndarray, t: np.ndarray, s: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where on the second arm the gap to the places t of the first is least, the gap in metres, and about how much less the next
    step would make it."""
    one, two, kind = pairs.one[which], pairs.two[which], pairs.kind[which]
    p, _, _, half = lines.at(one, t)[:4]
    # seen from the second arm
    p, last = (p - pairs.shift[which]) * np.conj(pairs.turn[which]), DEPTHS[kind, 1]
    gap = less = before = np.zeros(len(s))
    farthest = np.full(len(s), _FARTHEST)
    for step in range(steps + 1):
        q, d1, d2, h, h1, h2 = lines.at(two, s)
        off = q - p
        apart = np.maximum(np.abs(off), 1e-12)
        gap = apart - h - half
        slope = (off.real * d1.real + off.imag * d1.imag) / apart
        bend = (d1.real**2 + d1.imag**2 + off.real * d2.real + off.imag * d2.imag - slope**2) / apart - h2
        slope -= h1
        bend = np.maximum(bend, 0.25 * (d1.real**2 + d1.imag**2) / apart)
        wanted = -slope / bend
        # a step back is at most half as long as the one before it
        farthest = np.where(wanted * before < 0.0, 0.5 * np.abs(before), farthest)
        move = before = np.clip(s + np.clip(wanted, -farthest, farthest), 0.0, last) - s
        less = np.abs(slope * move)
        if step == steps or (np.abs(move) < _CLOSE).all():
            break
        s = s + move
    return s, gap, less


def _narrowest(
    lines: Lines, pairs: Pairs, which: np.ndarray, t: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where between the places beside t gaps are least, on either arm, and how wide they are there: by Newton's method along the
    first arm, within the bracket that the slope leaves."""
    depth = DEPTHS[pairs.kind[which], 0]
    step = depth / (_PLACES - 1)
    low, high = np.maximum(t - step, 0.0), np.minimum(t + step, depth)
    t, gap, moving = t.copy(), np.zeros(len(t)), np.arange(len(t))
    s = s.copy()
    for _ in range(_LAST):
        now = which[moving], t[moving]
        s[moving], gap[moving], _ = _nearest(lines, pairs, *now, s[moving], _LAST)
        slope, bend = _along(lines, pairs, *now, s[moving])
        low[moving] = np.where(slope < 0.0, now[1], low[moving])
        high[moving] = np.where(slope > 0.0, now[1], high[moving])
        to = now[1] - slope / np.where(bend > 0.0, bend, 1e-300)
        within = (to > low[moving]) & (to < high[moving]) | (slope == 0.0)
        t[moving] = np.where(within, to, 0.5 * (low[moving] + high[moving]))
        moving = moving[np.abs(t[moving] - now[1]) > _CLOSE]
        if not len(moving):
            break
    return t, s, gap


def _at_once(
    lines: Lines, pairs: Pairs, which: np.ndarray, t: np.ndarray, s: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As ``_narrowest``, by Newton's method for the places on both arms at once; known : gaps at t, which are no narrower."""
    kind = pairs.kind[which]
    last, step = DEPTHS[kind, 1], DEPTHS[kind, 0] / (_PLACES - 1)
    low, high = np.maximum(t - step, 0.0), np.minimum(t + step, DEPTHS[kind, 0])
    out = t.copy(), s.copy(), known.copy()
    moving, before, far = np.arange(len(t)), np.zeros(len(t)), 2.0 * step
    for _ in range(_TOGETHER_STEPS):
        at, there = out[0][moving], out[1][moving]
        gap, (by_t, by_s), (own, cross, other) = _bends(lines, pairs, which[moving], at, there)
        held = ((there <= 0.0) & (by_s > 0.0)) | ((there >= last[moving]) & (by_s < 0.0))
        share = np.where(held, 0.0, cross / other)
        slope, bend = by_t - np.where(held, 0.0, share * by_s), own - share * cross
        wanted = np.where(bend > 0.0, -slope / np.where(bend > 0.0, bend, 1.0), -np.sign(slope) * step[moving])
        # a step back is at most half as long as the one before it
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
    # what has not come to rest in a few steps, or only where the gap is wider, is looked for along the first arm
    lost = out[2] > known + 1e-12
    lost[moving] = True
    if lost.any():
        found = _narrowest(lines, pairs, which[lost], t[lost], s[lost])
        for whole, part in zip(out, found, strict=True):
            whole[lost] = part
    return out


def _along(
    lines: Lines, pairs: Pairs, which: np.ndarray, t: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivative of gaps by t on the first arm, while the nearest points on the second follow."""
    _, (by_t, _), (own, cross, other) = _bends(lines, pairs, which, t, s)
    # an end of the second arm stays where it is
    free = (s > 0.0) & (s < DEPTHS[pairs.kind[which], 1])
    return by_t, own - np.where(free, cross**2 / np.maximum(other, 1e-12), 0.0)


def _bends(
    lines: Lines, pairs: Pairs, which: np.ndarray, t: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Gaps in metres, their first derivatives by t and by s, and their second ones by t twice, by both and by s twice.

    The last is kept above a quarter of what it would be far away, so that steps towards the nearest point go the right way.
    """
    turn = pairs.turn[which]
    p, p1, p2, half, half1, half2 = lines.at(pairs.one[which], t)
    q, q1, q2, h, h1, h2 = lines.at(pairs.two[which], s)
    off, q1, q2 = turn * q + pairs.shift[which] - p, turn * q1, turn * q2
    apart = np.maximum(np.abs(off), 1e-12)
    off /= apart
    along, there = (off * np.conj(p1)).real, (off * np.conj(q1)).real
    pace, size = (p1 * np.conj(p1)).real, (q1 * np.conj(q1)).real
    own = (pace - along**2) / apart - (off * np.conj(p2)).real - half2
    other = np.maximum((size - there**2) / apart + (off * np.conj(q2)).real - h2, 0.25 * size / apart)
    cross = -((p1 * np.conj(q1)).real - along * there) / apart
    return apart - h - half, (-along - half1, there - h1), (own, cross, other)


def gap_slopes(lines: Lines, pairs: Pairs, gaps: Narrow) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of gaps by the numbers of the first and of the second arm, (K, lines.COUNT) each, and by the nearest point of
    the second, and where that lies (both complex, in the first arm's frame)."""
    (one, t), (two, s) = gaps.both(pairs)
    turn = pairs.turn[gaps.pair]
    place = turn * lines.points(two, s) + pairs.shift[gaps.pair]
    off = place - lines.points(one, t)
    way = gaps.side * off / np.maximum(np.abs(off), 1e-12)
    point, half = lines.pull(one, t, way)
    there, width = lines.pull(two, s, way * np.conj(turn))
    return -point - half, there - width, way, place


def sharp(
    lines: Lines, arms: Int[np.ndarray, " n"], below: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Where in their blends arms keep less than ``below``, (n,), of the radius of curvature on their inner edge: the arm, u, the share."""
    end = lines.end
    i = np.broadcast_to(arms[:, None], (len(arms), len(_TURNS)))
    u = np.broadcast_to(_TURNS, i.shape)
    _, d1, d2, half = lines.at(i, end.share[i] * u)[:4]
    left = 1.0 - half * np.abs((np.conj(d1) * d2).imag) / np.abs(d1) ** 3
    some = left < below[:, None]
    return i[some], u[some], left[some]


def sharp_slopes(lines: Lines, i: Int[np.ndarray, " k"], u: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k numbers"]:
    """Derivatives of the share of ``sharp`` by the numbers of the arms' ends."""
    end, uu = lines.end, u * u
    share, slope, wind = end.share[i], end.slope[i], lines.wind[i]
    t = share * u
    _, d1, d2, half = lines.at(i, t)[:4]
    turn = np.exp(1j * (lines.angle[i] + wind * t))
    r = lines.radius[i] * (1.0 - t)
    q1, q2 = 1.0 + uu * (-18.0 + u * (32.0 - 15.0 * u)), u * (-36.0 + u * (96.0 - 60.0 * u))
    first, second = slope * q1, slope * q2 / share
    pure = d1 - first, d2 - second
    third = (3.0 * wind**2 * lines.radius[i] - 1j * wind**3 * r) * turn
    moves = [q1[:, None] * end.slope_by[i], (q2 / share)[:, None] * end.slope_by[i]]
    # with the share, t moves at the same u
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
    joint = 1.0 + uu * u * (-10.0 + u * (15.0 - 6.0 * u))
    # the width at the same u does not hang on the share
    wide = 0.5 * joint[:, None] * end.width_by[i]
    wide[:, 0] += 0.5 * (1.0 - joint)
    return -np.sign(bent)[:, None] * (half[:, None] * change + wide * (bent / size**3)[:, None])
