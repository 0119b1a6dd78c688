"""Slots between the arms: their width, and the largest twist that leaves them open for the cutter.

Width, twist and size of a spiral are coupled (FlexMaps section 5): at the distance r from the centre of a regular
spiral of diameter s, the centre lines of consecutive arms are (pi / 4) s / sqrt(twist^2 + (s / 2r)^2) apart, at right
angles to them. The gap must be at least the smallest slot over the outer third of every arm, so that a slot exists and
has room for its root, the fillet at its inner end.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...arrays import Bool, Float, Int
from ...params import SpiralParams
from ...patches.flattening.flatten import FlatPatches
from ...progress import SILENT, Progress
from ...surface.checking.finding import with_count
from ..curves.arcs import dot
from ..curves.spiral import (
    LEFT,
    RIGHT,
    Arms,
    centre_line,
    edge_points,
    make_arms,
    widest_arms,
    widest_beside_slots,
    width_at,
)

# share of every arm, from its tip, over which the slot beside it must be open. With more twist, slots of thick spirals
# close from the hub outwards; a larger share allows less twist; at about 1/3 the free length of the arms is greatest
OPEN_SHARE = 1.0 / 3.0
# least cosine of the angle between two edges that bound a slot; a larger value ignores more of a slot's open end
PARALLEL_COSINE = 0.3
# least arm width in quads that have no room for the smallest width, as a share of that width; larger values give solid
# hubs to more quads
MIN_WIDTH_SHARE = 0.5
# stored arm width at a solid hub, as a share of the smallest width; it must stay below ``MIN_WIDTH_SHARE``, which
# spirals may have, even in single precision
SOLID_WIDTH_SHARE = 0.48
# number of places on the outer part of an arm where gaps are measured for the largest twist; a parabola interpolates
# between them, so that more places are only slower
GAP_PLACES = 6
NO_NEIGHBOUR = 1.0  # value that stands for the width of a slot without a neighbouring arm, metres; larger than any slot


def twist_limit(scale: np.ndarray, width: np.ndarray, slot: float, depth: float = 0.0) -> np.ndarray:
    """Return the largest twist of a regular spiral whose slots are at least ``slot`` wide, in closed form.

    Parameters
    ----------
    scale, width : diameter of the spiral and width of its arms, metres; the shapes broadcast
    slot : least width of the slots, metres
    depth : share of the arms, from the tip, over which slots must be that wide

    Returns
    -------
    largest twist, radians; 0 where even straight arms leave too little room
    """
    pitch = 0.25 * math.pi * np.asarray(scale, dtype=float) / (np.asarray(width, dtype=float) + slot)
    return np.sqrt(np.maximum(pitch**2 - 1.0 / (1.0 - depth) ** 2, 0.0))


def min_slot_width(params: SpiralParams) -> float:
    """Return the least width of slots in metres: the larger of ``slot_min`` and the diameter of the fillet."""
    return max(params.slot_min, 2.0 * params.fillet)


def width_range(
    flat: FlatPatches, params: SpiralParams
) -> tuple[Float[np.ndarray, " quads"], Float[np.ndarray, " quads"]]:
    """Return the smallest and the largest arm width (F,) of every quad, metres.

    In quads without room for a spiral, smallest and largest width are the width that marks a solid hub.

    Parameters
    ----------
    flat : flat patches
    params : range of widths, slots and fillets
    """
    widest = widest_arms(flat, params)
    small = widest < MIN_WIDTH_SHARE * params.width_min
    # straight arms must leave slots beside their outer thirds, unless they have the smallest width
    wide = np.minimum(
        params.width_max, np.maximum(params.width_min, widest_beside_slots(flat, min_slot_width(params), OPEN_SHARE))
    )
    high = np.where(small, SOLID_WIDTH_SHARE * params.width_min, np.minimum(wide, widest))
    return np.minimum(params.width_min, high), high


def too_small_message(flat: FlatPatches, params: SpiralParams, quads: Int[np.ndarray, " n"]) -> str:
    """Return the error message for quads that are far too small for the smallest width.

    Parameters
    ----------
    flat, params : flat quads, and the smallest width that they have no room for
    quads : the quads that are too small
    """
    widest = widest_arms(flat, params)[quads].min(initial=params.width_min)
    remedy = (
        f"the object {params.width_min / widest:.3g} times larger, or the smallest width {widest * 1e3:.2g} mm"
        if widest > 0.0
        else "those quads larger"
    )
    return f"{with_count(len(quads), 'quad is', 'quads are')} too small or too thin for arms {params.width_min * 1e3:g} mm wide; make {remedy}"


def _facing_gap(outer: Arms, inner: Arms, step: int) -> Float[np.ndarray, "quads k"]:
    """Return, for every arm of ``outer``, the narrowest gap between its outer part and its facing arm, metres.

    inner : the facing arms, in the order of ``outer``
    step : 1 if the facing arm comes before the outer arm in counter-clockwise order, -1 if it comes after
    """
    opening = (step * (outer.angle - inner.angle))[..., None] % (2.0 * math.pi)
    t = np.broadcast_to(np.linspace(0.0, OPEN_SHARE, GAP_PLACES), (*outer.radius.shape, GAP_PLACES))
    p = centre_line(outer, t)[0]
    # parameter of the facing arm's point at the same polar angle, which is close to the nearest point
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
    return _interpolated_minimum(np.where(through, -np.abs(gap), gap))


def _interpolated_minimum(samples: np.ndarray) -> np.ndarray:
    """Return the lowest value along the last axis, with parabolic interpolation between the samples."""
    inner = np.clip(samples.argmin(axis=-1), 1, samples.shape[-1] - 2)[..., None]
    before, at, after = (np.take_along_axis(samples, inner + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = before + after - 2.0 * at
    dip = np.where(bend > 0.0, (after - before) ** 2 / (8.0 * np.where(bend > 0.0, bend, 1.0)), 0.0)
    # the parabola has its vertex between the neighbours only if the sample is lower than both
    return np.minimum(samples.min(axis=-1), at - np.where((at <= before) & (at <= after), dip, 0.0))


def twist_bound(
    flat: FlatPatches,
    params: SpiralParams,
    width: Float[np.ndarray, "quads 4"],
    progress: Progress = SILENT,
    most: Float[np.ndarray, " quads"] | None = None,
) -> Float[np.ndarray, " quads"]:
    """Return the largest twist (radians) that leaves slots open in the actual, irregular quads, by bisection.

    Slots are measured without blends, so that the bound of a quad does not depend on its neighbours.

    Parameters
    ----------
    flat : flat patches
    params : slots, fillets and largest twist
    width : (F, 4) widths of the arms, metres
    progress : called with the fraction done; may cancel
    most : (F,) upper limit in radians; default is ``params.twist_max``
    """
    slot, count = min_slot_width(params), len(flat.corners)
    pure = make_arms(flat, replace(params, clockwise=False), width, np.zeros(count))
    low, high = np.zeros(count), np.full(count, params.twist_max)
    # the middles of a quad's sides are symmetric about its centre: with equal arms, two of the four slots suffice
    slots = 2 if (width == width[:, :1]).all() else 4
    tightest = 0.5 * (width + np.roll(width, -1, axis=1)).max(axis=1)
    if most is not None:
        high = np.minimum(high, most)

    def fits(quads: np.ndarray, twist: np.ndarray) -> np.ndarray:
        part = pure.subset(quads).without_blends(twist)
        every = np.arange(len(quads))
        zero = np.zeros_like(every)
        gaps = [
            _facing_gap(part.one_by_one(every, (zero + k + 1) % 4), part.one_by_one(every, zero + k), 1)
            for k in range(slots)
        ]
        return np.min(gaps, axis=0)[:, 0] >= slot

    open_ = np.arange(count)
    good = fits(open_, high)
    low[good] = high[good]
    open_ = open_[~good]
    high = np.minimum(high, twist_limit(2.0 * pure.radius.max(axis=1), tightest, slot) + 0.1)
    for turn in range(12):
        progress(turn / 12, "making room for the twist")
        middle = 0.5 * (low[open_] + high[open_])
        good = fits(open_, middle)
        low[open_] = np.where(good, middle, low[open_])
        high[open_] = np.where(good, high[open_], middle)
    return low


def _renumber_arms(arms: Arms, step: int) -> Arms:
    """Renumber the arms of every quad, so that arm k - step becomes arm k."""
    fields = {
        name: np.roll(getattr(arms, name), step, axis=1)
        for name in ("radius", "angle", "width", "joint_width", "blend_slope", "share")
    }
    return replace(arms, **fields)


def is_beside_absent(absent: Bool[np.ndarray, "quads 4"]) -> Bool[np.ndarray, "quads 4"]:
    """Return a mask of the slots beside absent arms; slot k lies between arm k and arm k + 1."""
    return absent | np.roll(absent, -1, axis=1)


def min_slot_and_bridge(
    arms: Arms,
    left: Float[np.ndarray, "quads 4"],
    right: Float[np.ndarray, "quads 4"],
    fillet: float,
    absent: Bool[np.ndarray, "quads 4"] | None = None,
) -> tuple[float, float]:
    """Return the widths of the narrowest slot and of the narrowest place of an arm between its own edges, metres.

    Parameters
    ----------
    arms : arms of all quads
    left, right : arm parameters t where the left edge of arm k and the right edge of arm k + 1 end, at slot k's root
    fillet : radius at the roots, metres; at its root a slot is as wide as the fillet's diameter
    absent : (F, 4) mask of the arms that are not cut
    """
    absent = np.zeros(left.shape, dtype=bool) if absent is None else absent
    # width of the arms, from their left to their right edge, up to the hub
    t = np.linspace(0.0, 0.9, 24) * np.minimum(left, np.roll(right, 1, axis=1))[..., None]
    bridge = _distance_to_edge(arms, LEFT, t, arms, RIGHT, t, np.full((*left.shape, 1), 0.9999))[0]
    bridge = np.where(absent[..., None], NO_NEIGHBOUR, bridge).min()
    # a slot without fillet ends in a point: measure its outer half only
    apart, lean = slot_widths(arms, left, right, np.linspace(0.0, 0.97 if fillet > 0.0 else 0.5, 32))[:2]
    # edges that enclose a wide angle do not bound a slot
    slot = float(np.where((lean > PARALLEL_COSINE) & ~is_beside_absent(absent)[..., None], apart, NO_NEIGHBOUR).min())
    return (min(slot, 2.0 * fillet) if fillet > 0.0 else slot), float(bridge)


def is_clockwise(arms: Arms) -> bool:
    """Return whether the spirals wind clockwise from their tips inwards; all spirals of a design wind the same way."""
    return float(arms.wind.sum()) < 0.0


def slot_widths(
    arms: Arms, left: Float[np.ndarray, "quads 4"], right: Float[np.ndarray, "quads 4"], share: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Measure the width of every slot from points on the edge of its outer arm.

    Parameters
    ----------
    arms : arms of all quads
    left, right : arm parameters t where the edges of slot k end, on arm k and on arm k + 1
    share : (N,) places of the points, 0 at the slot's mouth, 1 at its root

    Returns
    -------
    width : (F, 4, N) diameter of the circle that touches both edges, the outer arm's edge at the point, metres
    lean : (F, 4, N) cosine of the angle between both edges, negative in the open corner of two arms
    outer, inner : (F, 4, N) arm parameters t of the facing points on the outer and on the inner arm
    """
    step = 1 if is_clockwise(arms) else -1
    other = _renumber_arms(arms, -1)
    opening = ((other.angle - arms.angle) % (2.0 * math.pi))[..., None]
    turned = opening / np.maximum(np.abs(arms.wind), 1e-9)[:, None, None]
    outer, inner, ends = (arms, other, (left, right)) if step > 0 else (other, arms, (right, left))
    t = share * ends[0][..., None]
    s = np.minimum(t + turned, ends[1][..., None])
    apart, lean, s = _distance_to_edge(
        outer, LEFT if step > 0 else RIGHT, t, inner, RIGHT if step > 0 else LEFT, s, ends[1][..., None]
    )
    # between edges at the angle a, the touching circle's diameter is the distance of the edges times 1 / cos^2(a / 2)
    return apart * 2.0 / np.maximum(1.0 + lean, 1e-3), lean, t, s


def _distance_to_edge(
    one: Arms, side: float, t: np.ndarray, two: Arms, other: float, s: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the points on an edge of arms ``two`` that are nearest to the points at t on an edge of arms ``one``.

    ``side`` and ``other``, LEFT or RIGHT, choose the edges of ``one`` and of ``two``. The search starts at ``s`` and
    does not go beyond ``end``. Return the distances (metres), the cosines of the angles between the inward directions
    of both edges, and the parameters of the nearest points.
    """
    p, dp = edge_points(one, t, side)
    for _ in range(6):
        q, dq = edge_points(two, s, other)
        move = dot(q - p, dq) / np.maximum(dot(dq, dq), 1e-30)
        s = np.clip(s - np.clip(0.8 * move, -0.1, 0.1), 0.0, end)
    q, dq = edge_points(two, s, other)
    lean = dot(dp, dq) / np.sqrt(dot(dp, dp) * dot(dq, dq))
    return np.sqrt(dot(p - q, p - q)), lean, s
