"""Room for the cutter: the width of the slots between the arms, and how far a spiral may be wound before they close.

Width, twist and size of a spiral are coupled (FlexMaps section 5): consecutive arms of a regular spiral of diameter s lie
(pi / 4) s / sqrt(twist^2 + (s / 2r)^2) apart at the radius r, measured at right angles. Here the gap must leave the
smallest slot over the outer third of every arm, so that there is a slot at all and its root has a place.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..arrays import Bool, Float, Int
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..progress import SILENT, Progress
from ..surface.checking.finding import counted
from .arcs import dot
from .spiral import (
    LEFT,
    RIGHT,
    Arms,
    arms,
    centre_line,
    edge,
    widest_arms,
    widest_beside_slots,
    width_at,
)

# The share of every arm, from its tip, over which the slot beside it must stay open. Wound further, a thick spiral only
# loses slot at the hub: about here its arms are free over their greatest length.
DEPTH = 1.0 / 3.0
PARALLEL = 0.3  # cosine of the angle between two edges beyond which they do not bound a slot
# A quad without room for the smallest width gets thinner arms, with a warning, down to this share of it; below, a solid hub.
THINNEST = 0.5
# Share of the smallest width that the arms at a solid hub have; less than ``THINNEST`` by more than single precision rounds off
SOLID = 0.48
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
    """Metres: the smallest and the largest width in every quad; that of a solid hub where no spiral has room."""
    widest = widest_arms(flat, params)
    small = widest < THINNEST * params.width_min
    # no wider than leaves a slot beside the outer thirds of straight arms, but for the smallest width
    wide = np.minimum(
        params.width_max, np.maximum(params.width_min, widest_beside_slots(flat, slot_needed(params), DEPTH))
    )
    high = np.where(small, SOLID * params.width_min, np.minimum(wide, widest))
    return np.minimum(params.width_min, high), high


def too_small(flat: FlatPatches, params: SpiralParams, quads: Int[np.ndarray, " n"]) -> str:
    """What is wrong with quads that are far too small for the smallest width, and what to do."""
    widest = widest_arms(flat, params)[quads].min(initial=params.width_min)
    remedy = (
        f"the object {params.width_min / widest:.3g} times larger, or the smallest width {widest * 1e3:.2g} mm"
        if widest > 0.0
        else "those quads larger"
    )
    return f"{counted(len(quads), 'quad is', 'quads are')} too small or too thin for arms {params.width_min * 1e3:g} mm wide; make {remedy}"


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


def beside(absent: Bool[np.ndarray, "quads 4"]) -> Bool[np.ndarray, "quads 4"]:
    """Of arms that are not cut, the slots k between arm k and arm k + 1 that are no slots without them."""
    return absent | np.roll(absent, -1, axis=1)


def narrowest(
    arms: Arms,
    left: Float[np.ndarray, "quads 4"],
    right: Float[np.ndarray, "quads 4"],
    fillet: float,
    absent: Bool[np.ndarray, "quads 4"] | None = None,
) -> tuple[float, float]:
    """Narrowest slot and narrowest piece of material in metres, measured between the true edges of the arms.

    left, right : t where the left edge of arm k and the right edge of arm k + 1 end at the root of their slot.
    At its root a slot is as wide as its fillet's diameter. ``absent`` arms are not cut.
    """
    absent = np.zeros(left.shape, dtype=bool) if absent is None else absent
    # the arm itself, up to its hub
    t = np.linspace(0.0, 0.9, 24) * np.minimum(left, np.roll(right, 1, axis=1))[..., None]
    bridge = _apart(arms, LEFT, t, arms, RIGHT, t, np.full((*left.shape, 1), 0.9999))[0]
    bridge = np.where(absent[..., None], CLEAR, bridge).min()
    # a slot without fillet ends in a point: its width is that of its outer half
    apart, lean = slot_widths(arms, left, right, np.linspace(0.0, 0.97 if fillet > 0.0 else 0.5, 32))[:2]
    # where the edges part at a wide angle there is room; only slots whose sides run along each other can be narrow
    slot = float(np.where((lean > PARALLEL) & ~beside(absent)[..., None], apart, CLEAR).min())
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
