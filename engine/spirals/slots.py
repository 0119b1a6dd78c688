"""Room for the cutter: the width of the slots between the arms, and how far a spiral may be wound before they close.

Width, twist and size of a spiral are coupled (FlexMaps section 5): consecutive arms of a regular spiral of diameter s lie
(pi / 4) s / sqrt(twist^2 + (s / 2r)^2) apart at the radius r, measured at right angles. Here the gap must leave the
smallest slot over the outer third of every arm, so that there is a slot at all and its root has a place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..patches.layout import PatchLayout
from ..progress import SILENT, Progress
from ..surface.mesh import QuadMesh
from .arcs import dot
from .spiral import (
    LEFT,
    RIGHT,
    Arms,
    arms,
    centre_line,
    edge,
    opposite_sides,
    widest_arms,
    widest_beside_slots,
    width_at,
)

# The share of every arm, from its tip, over which the slot beside it must stay open. Wound further, a thick spiral only
# loses slot at the hub: about here its arms are free over their greatest length.
DEPTH = 1.0 / 3.0
PARALLEL = 0.3  # cosine of the angle between two edges beyond which they do not bound a slot
_CLOSER = 3  # times that the search for the nearest points of two arms looks closer, by a third each
# A quad without room for the smallest width gets thinner arms, with a warning, down to this share of it; below, no design.
THINNEST = 0.5
CLEAR = 1.0  # metres; a gap where there is nothing that an arm could touch


def twist_limit(scale: np.ndarray, width: np.ndarray, slot: float, depth: float = 0.0) -> np.ndarray:
    """Largest twist in radians of a regular spiral whose slot is at least ``slot`` wide, in closed form.

    scale, width : metres, of any broadcasting shapes; ``depth`` is the share of the arm, from the tip, down to which the
    slot is that wide. 0 where not even a straight cross leaves that much.
    """
    pitch = 0.25 * math.pi * np.asarray(scale, dtype=float) / (np.asarray(width, dtype=float) + slot)
    return np.sqrt(np.maximum(pitch**2 - 1.0 / (1.0 - depth) ** 2, 0.0))


def slot_needed(params: SpiralParams) -> float:
    """Metres that every slot must be wide: the smallest slot, and room for the fillet at its root."""
    return max(params.slot_min, 2.0 * params.fillet)


def width_range(
    flat: FlatPatches, params: SpiralParams
) -> tuple[Float[np.ndarray, " quads"], Float[np.ndarray, " quads"]]:
    """Metres: the smallest and the largest width in every quad.

    Raises ``FlexMapsError`` with the faces that are far too small for the smallest width.
    """
    widest = widest_arms(flat, params)
    small = np.flatnonzero(widest < THINNEST * params.width_min)
    if len(small):
        need, least = params.width_min / widest[small].min(), widest[small].min() * 1e3
        remedy = (
            f"the object {need:.3g} times larger, or the smallest width {least:.2g} mm"
            if least > 0.0
            else "those quads larger"
        )
        raise FlexMapsError(
            f"{len(small)} quads are too small or too thin for arms {params.width_min * 1e3:g} mm wide; make {remedy}",
            faces=small,
        )
    # no wider than leaves a slot beside the outer thirds of straight arms, but for the smallest width
    wide = np.minimum(
        params.width_max, np.maximum(params.width_min, widest_beside_slots(flat, slot_needed(params), DEPTH))
    )
    high = np.minimum(wide, widest)
    return np.minimum(params.width_min, high), high


def gaps(arms: Arms) -> Float[np.ndarray, "quads 4"]:
    """Metres: narrowest gap between the outer part of arm k and the arm that faces it, less both half widths.

    Negative where the arms run through each other.
    """
    # the arm that faces the tip of arm k is k - 1, or k + 1 if clockwise
    step = -1 if clockwise(arms) else 1
    return _facing(arms, _rolled(arms, step), step)


def _facing(outer: Arms, inner: Arms, step: int) -> Float[np.ndarray, "quads k"]:
    """Metres: narrowest gap between the outer parts of arms and the arms that face them, ``step`` side on."""
    opening = (step * (outer.angle - inner.angle))[..., None] % (2.0 * math.pi)
    t = np.broadcast_to(np.linspace(0.0, DEPTH, 18), (*outer.radius.shape, 18))
    p = centre_line(outer, t)[0]
    # the facing arm's parameter at the same angle; the nearest point is close to it
    level = t + opening / np.maximum(np.abs(outer.wind), 1e-9)[:, None, None]
    s = np.clip(level, 0.0, 1.0)
    for _ in range(4):
        q, d1, d2 = centre_line(inner, s)
        off, speed2 = q - p, dot(d1, d1)
        bend = np.maximum(speed2 + dot(off, d2), 0.25 * speed2)
        s = np.clip(s - np.clip(dot(off, d1) / bend, -0.1, 0.1), 0.0, 1.0)
    off = centre_line(inner, s)[0] - p
    gap = np.sqrt(dot(off, off)) - 0.5 * (width_at(outer, t)[0] + width_at(inner, s)[0])
    through = (level < 1.0) & (inner.radius[..., None] * (1.0 - level) > outer.radius[..., None] * (1.0 - t))
    return _lowest(np.where(through, -np.abs(gap), gap))


def _lowest(samples: np.ndarray) -> np.ndarray:
    """The lowest value along the last axis, read between the samples by a parabola."""
    inner = np.clip(samples.argmin(axis=-1), 1, samples.shape[-1] - 2)[..., None]
    before, at, after = (np.take_along_axis(samples, inner + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = before + after - 2.0 * at
    dip = np.where(bend > 0.0, (after - before) ** 2 / (8.0 * np.where(bend > 0.0, bend, 1.0)), 0.0)
    # only a lowest point between its neighbours has a vertex there
    return np.minimum(samples.min(axis=-1), at - np.where((at <= before) & (at <= after), dip, 0.0))


def gaps_across(
    arms: Arms,
    mesh: QuadMesh,
    corners: Float[np.ndarray, "quads 4 2"],
    quads: Int[np.ndarray, " n"],
    enough: float = math.inf,
) -> Float[np.ndarray, "n 4"]:
    """Metres: narrowest gap between the outer part of arm k of the ``quads`` and the arms across its joint.

    Gaps that are surely wider than ``enough`` metres are not measured closely.
    In strongly sheared quads an arm leaves its quad for a while, and may meet the two arms beside its joint in the
    neighbour; both quads are laid side by side along their edge, also at cuts. ``CLEAR`` at the border.
    """
    mate, side = opposite_sides(mesh)
    own = np.repeat(quads, 4), np.tile(np.arange(4), len(quads))
    beyond = mate[own], side[own]
    one, gap = arms.one_by_one(*own), np.full(len(own[0]), CLEAR)
    for step in (1, 3):
        two = arms.one_by_one(beyond[0], (beyond[1] + step) % 4)
        # the frames of both quads differ by half a turn
        found = _least(
            one, lambda p, k: _in_side_frame(p, corners, (own[0][k], own[1][k])), np.linspace(0.0, 0.4, 8),
            two, lambda q, k: -_in_side_frame(q, corners, (beyond[0][k], beyond[1][k])), np.linspace(0.0, 0.9, 32), enough,
        )  # fmt: skip
        gap = np.minimum(gap, found)
    return np.where(beyond[0] == own[0], CLEAR, gap).reshape(-1, 4)


def gaps_round(
    arms: Arms, layout: PatchLayout, quads: Int[np.ndarray, " n"], enough: float = math.inf
) -> Float[np.ndarray, "n 4"]:
    """Metres: narrowest gap between the two arms at corner k of the ``quads`` and those opposite round the corner.

    Gaps that are surely wider than ``enough`` metres are not measured closely.
    In strongly distorted quads the arms of two quads that share no more than a vertex may meet. ``CLEAR`` where a cut or the
    border lies between them.
    """
    mate, side = opposite_sides(layout.mesh)
    joined = ~layout.outline_sides
    quad, corner = np.repeat(quads, 4), np.tile(np.arange(4), len(quads))
    gap, whole = np.full(len(quad), CLEAR), np.ones(len(quad), dtype=bool)
    t = np.linspace(0.0, 0.6, 13)
    at, to = quad, corner
    for step in range(1, 4):  # round the vertex, as far as nothing is cut
        whole = whole & joined[at, to]
        at, to = np.where(whole, mate[at, to], at), np.where(whole, (side[at, to] + 1) % 4, to)
        # the next quad is no concern of this, nor is the last one before the circle closes
        before = mate[at, to] == quad
        far = np.flatnonzero(whole & (step > 1) & ~before & (at != quad))
        for k, j in product((-1, 0), repeat=2) if len(far) else ():
            one = arms.one_by_one(quad[far], (corner[far] + k) % 4)
            two = arms.one_by_one(at[far], (to[far] + j) % 4)
            gap[far] = np.minimum(gap[far], _least(one, _as_it_is, t, two, _as_it_is, t, enough))
    return gap.reshape(-1, 4)


def _least(
    one: Arms, placed: Callable[[np.ndarray, np.ndarray], np.ndarray], t: np.ndarray,
    two: Arms, laid: Callable[[np.ndarray, np.ndarray], np.ndarray], s: np.ndarray, enough: float,
) -> Float[np.ndarray, " n"]:  # fmt: skip
    """Metres: narrowest gap between N single arms and N others at the parameters t and s and between them.

    ``placed`` and ``laid`` bring points (M, K, 2) of the arms with the numbers (M,) into one frame. Samples may lie a width
    apart, so the search goes on round the nearest two of them, but where the gap is surely wider than ``enough``.
    """
    rows, gap = np.arange(len(one.radius)), np.full(len(one.radius), CLEAR)
    for stride in (3, 1) if math.isfinite(enough) else (1,):
        at = [np.broadcast_to(x, (len(rows), len(x))) for x in (t[_strided(t, stride)], s[_strided(s, stride)])]
        found, near, nearest = _sampled(one, placed, two, laid, rows, at, enough)
        gap[rows] = found
        rows, one, two = rows[near], one.of(near), two.of(near)
    steps, ranges = [t[1] - t[0], s[1] - s[0]], ((t[0], t[-1]), (s[0], s[-1]))
    for _ in range(_CLOSER):
        if not len(rows):
            break
        for k in range(2):
            middle = np.take_along_axis(at[k][near], nearest[k][near, None], axis=1)
            at[k] = np.clip(middle + steps[k] * np.linspace(-1.0, 1.0, 7), *ranges[k])
            steps[k] /= 3.0
        found, near, nearest = _sampled(one, placed, two, laid, rows, at, enough)
        gap[rows] = np.minimum(gap[rows], found)
        rows, one, two = rows[near], one.of(near), two.of(near)
    return gap


def _strided(samples: np.ndarray, stride: int) -> np.ndarray:
    """Every ``stride``-th sample, and the last."""
    return np.unique(np.append(np.arange(0, len(samples), stride), len(samples) - 1))


def _sampled(
    one: Arms, placed: Callable[[np.ndarray, np.ndarray], np.ndarray],
    two: Arms, laid: Callable[[np.ndarray, np.ndarray], np.ndarray],
    rows: np.ndarray, at: list[np.ndarray], enough: float,
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """Narrowest gap (N,) metres of pairs of arms at samples ``at`` of both, which samples these are, and the numbers of the
    pairs that may come nearer than ``enough`` between samples."""
    p = placed(centre_line(one, at[0][:, None])[0][:, 0], rows)
    q = laid(centre_line(two, at[1][:, None])[0][:, 0], rows)
    half = [0.5 * width_at(a, x[:, None])[0][:, 0] for a, x in zip((one, two), at, strict=True)]
    apart = np.hypot(p[:, :, None, 0] - q[:, None, :, 0], p[:, :, None, 1] - q[:, None, :, 1])
    apart = (apart - half[0][:, :, None] - half[1][:, None]).reshape(len(p), p.shape[1] * q.shape[1])
    gap = apart.min(axis=1)
    # between two samples an arm is no nearer than half of their distance, along the arm, less
    near = np.flatnonzero(gap - _spacing(p) - _spacing(q) < enough)
    return gap, near, np.divmod(apart.argmin(axis=1), at[1].shape[1])


def _spacing(points: Float[np.ndarray, "m k 2"]) -> Float[np.ndarray, " m"]:
    """The largest distance of consecutive points: more than half of the arc between them."""
    return np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=1)


def _as_it_is(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return points


def _in_side_frame(
    points: Float[np.ndarray, "n m 2"],
    corners: Float[np.ndarray, "quads 4 2"],
    at: tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]],
) -> Float[np.ndarray, "n m 2"]:
    """Points in the frames of the sides ``at`` (quad, side): from the side's middle, along it and outwards."""
    quad, side = at
    a, b = corners[quad, side], corners[quad, (side + 1) % 4]
    along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    frame = np.stack([along, np.stack([along[:, 1], -along[:, 0]], axis=1)], axis=1)
    return (points - 0.5 * (a + b)[:, None]) @ frame.swapaxes(1, 2)


def twist_bound(
    flat: FlatPatches,
    params: SpiralParams,
    width: Float[np.ndarray, "quads 4"],
    progress: Progress = SILENT,
    most: Float[np.ndarray, " quads"] | None = None,
) -> Float[np.ndarray, " quads"]:
    """Radians: largest twist, up to the largest that is asked for, that leaves a slot in the real quad.

    ``width`` in metres; ``most`` radians where less than ``twist_max`` is asked for. Judged for pure spirals, so that the bound of a quad does not hang on its neighbours.
    """
    slot, count = slot_needed(params), len(flat.corners)
    pure = arms(flat, replace(params, clockwise=False), width, np.zeros(count))
    low, high = np.zeros(count), np.full(count, params.twist_max)
    # the middles of a quad's sides are symmetric about its centre: of arms alike, two of its slots tell of all four
    slots = 2 if (width == width[:, :1]).all() else 4
    tightest = 0.5 * (width + np.roll(width, -1, axis=1)).max(axis=1)
    if most is not None:
        high = np.minimum(high, most)

    def fits(quads: np.ndarray, twist: np.ndarray) -> np.ndarray:
        part = pure.of(quads).unblended(twist)
        every = np.arange(len(quads))
        zero = np.zeros_like(every)
        found = [
            _facing(part.one_by_one(every, (zero + k + 1) % 4), part.one_by_one(every, zero + k), 1)
            for k in range(slots)
        ]
        return np.min(found, axis=0)[:, 0] >= slot

    open_ = np.arange(count)
    good = fits(open_, high)
    low[good] = high[good]
    open_ = open_[~good]
    high = np.minimum(high, twist_limit(2.0 * pure.radius.max(axis=1), tightest, slot) + 0.1)
    for turn in range(12):
        progress(turn / 12, "room for the twist")
        middle = 0.5 * (low[open_] + high[open_])
        good = fits(open_, middle)
        low[open_] = np.where(good, middle, low[open_])
        high[open_] = np.where(good, high[open_], middle)
    return low


def _rolled(arms: Arms, step: int) -> Arms:
    """The same arms, with arm k - step in the place of arm k."""
    rolled = {
        name: np.roll(getattr(arms, name), step, axis=1)
        for name in ("radius", "angle", "width", "joint_width", "blend_slope", "share")
    }
    return replace(arms, **rolled)


def narrowest(
    arms: Arms, left: Float[np.ndarray, "quads 4"], right: Float[np.ndarray, "quads 4"], fillet: float
) -> tuple[float, float]:
    """Narrowest slot and narrowest piece of material in metres, measured between the true edges of the arms.

    left, right : t where the left edge of arm k and the right edge of arm k + 1 end at the root of their slot.
    At its root a slot is as wide as its fillet's diameter.
    """
    # the arm itself, up to its hub
    t = np.linspace(0.0, 0.9, 24) * np.minimum(left, np.roll(right, 1, axis=1))[..., None]
    bridge = _apart(arms, LEFT, t, arms, RIGHT, t, np.full((*left.shape, 1), 0.9999))[0].min()
    # a slot without fillet ends in a point: its width is that of its outer half
    apart, lean = slot_widths(arms, left, right, np.linspace(0.0, 0.97 if fillet > 0.0 else 0.5, 32))[:2]
    # where the edges part at a wide angle there is room; only slots whose sides run along each other can be narrow
    slot = float(np.where(lean > PARALLEL, apart, CLEAR).min())
    return (min(slot, 2.0 * fillet) if fillet > 0.0 else slot), float(bridge)


def clockwise(arms: Arms) -> bool:
    """Whether the spirals wind clockwise from their tips inwards; all of a design wind the same way."""
    return float(arms.wind.sum()) < 0.0


def slot_widths(
    arms: Arms, left: Float[np.ndarray, "quads 4"], right: Float[np.ndarray, "quads 4"], share: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Width of every slot, measured from the edge of its outer arm at the shares (N,) of the way from mouth to root.

    left, right : t where the edges of slot k end, on arm k and on arm k + 1. Returns, each (F, 4, N), the width in
    metres, as the diameter of the circle between the edges that touches the outer arm there, the cosine of the angle between both edges (negative in the open corner of two arms), and t on the outer and on the inner arm.
    """
    step = 1 if clockwise(arms) else -1
    other = _rolled(arms, -1)  # arm k + 1 in the place of arm k
    opening = ((other.angle - arms.angle) % (2.0 * math.pi))[..., None]
    turned = opening / np.maximum(np.abs(arms.wind), 1e-9)[:, None, None]
    outer, inner, ends = (arms, other, (left, right)) if step > 0 else (other, arms, (right, left))
    t = share * ends[0][..., None]
    s = np.minimum(t + turned, ends[1][..., None])
    apart, lean, s = _apart(
        outer, LEFT if step > 0 else RIGHT, t, inner, RIGHT if step > 0 else LEFT, s, ends[1][..., None]
    )
    # between edges that enclose the angle a, a circle that touches this point is 1 / cos^2(a / 2) times as wide
    return apart * 2.0 / np.maximum(1.0 + lean, 1e-3), lean, t, s


def _apart(
    one: Arms, side: float, t: np.ndarray, two: Arms, other: float, s: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance of edge points at t from the nearest point, near s and up to ``end``, of the other edge.

    And the cosine of the angle between the ways inwards along both edges there, and the parameter of the nearest point.
    """
    p, dp = edge(one, t, side)
    for _ in range(6):
        q, dq = edge(two, s, other)
        move = dot(q - p, dq) / np.maximum(dot(dq, dq), 1e-30)
        s = np.clip(s - np.clip(0.8 * move, -0.1, 0.1), 0.0, end)
    q, dq = edge(two, s, other)
    lean = dot(dp, dq) / np.sqrt(dot(dp, dp) * dot(dq, dq))
    return np.sqrt(dot(p - q, p - q)), lean, s
