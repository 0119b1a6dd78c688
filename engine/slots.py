"""Room for the cutter: the width of the slots between the arms, and how far a spiral may be wound before they close.

Width, twist and size of a spiral are coupled (FlexMaps section 5): consecutive arms of a regular spiral of diameter s lie
(pi / 4) s / sqrt(twist^2 + (s / 2r)^2) apart at the radius r, measured at right angles. Here the gap must leave the
smallest slot at every radius down to half of the tip's, so that there is a slot at all and its root has a place.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .flatten import FlatPatches
from .mesh import QuadMesh
from .params import SpiralParams
from .spiral import LEFT, RIGHT, Arms, arms, centre_line, edge, mates, width_at

DEPTH = 0.5  # the share of every arm, from its tip, over which the slot beside it must stay open
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


def gaps(arms: Arms) -> np.ndarray:
    """(F, 4) metres: narrowest gap between the outer part of arm k and the arm that faces it, less both half widths.

    Negative where the arms run through each other.
    """
    step = -1 if float(arms.wind.sum()) < 0.0 else 1  # the arm that faces the tip of arm k is k - 1, or k + 1 if clockwise
    opening = (step * (arms.angle - np.roll(arms.angle, step, axis=1)))[..., None] % (2.0 * math.pi)
    inner = _rolled(arms, step)
    t = np.broadcast_to(np.linspace(0.0, DEPTH, 12), (*arms.radius.shape, 12))
    p = centre_line(arms, t)[0]
    # the facing arm's parameter at the same angle; the nearest point is close to it
    level = t + opening / np.maximum(np.abs(arms.wind), 1e-9)[:, None, None]
    s = np.clip(level, 0.0, 1.0)
    for _ in range(5):
        q, d1, d2 = centre_line(inner, s)
        slope = ((q - p) * d1).sum(-1)
        bend = np.maximum((d1 * d1).sum(-1) + ((q - p) * d2).sum(-1), 0.25 * (d1 * d1).sum(-1))
        s = np.clip(s - np.clip(slope / bend, -0.1, 0.1), 0.0, 1.0)
    q = centre_line(inner, s)[0]
    gap = np.linalg.norm(p - q, axis=-1) - 0.5 * (width_at(arms, t)[0] + width_at(inner, s)[0])
    through = (level < 1.0) & (inner.radius[..., None] * (1.0 - level) > arms.radius[..., None] * (1.0 - t))
    return np.where(through, -np.abs(gap), gap).min(axis=-1)


def gaps_across(arms: Arms, mesh: QuadMesh, corners: np.ndarray) -> np.ndarray:
    """(F, 4) metres: narrowest gap between the outer part of arm k and the two arms beside its joint in the neighbour.

    In strongly sheared quads an arm leaves its quad for a while; both quads are laid side by side along their edge, also at
    cuts. ``CLEAR`` at the border.
    """
    quad, side = mates(mesh)
    border = quad == np.arange(len(quad))[:, None]
    along = np.roll(corners, -1, axis=1) - corners
    along = along / np.linalg.norm(along, axis=2, keepdims=True)
    frame = np.stack([along, np.stack([along[..., 1], -along[..., 0]], axis=-1)], axis=-2)  # (F, 4, axis, 2)
    middle = 0.5 * (corners + np.roll(corners, -1, axis=1))
    t = np.broadcast_to(np.linspace(0.0, 0.4, 8), (*arms.radius.shape, 8))
    s = np.broadcast_to(np.linspace(0.0, 0.9, 32), (*arms.radius.shape, 32))
    local = np.einsum("fkad,fknd->fkna", frame, centre_line(arms, t)[0] - middle[:, :, None])
    full = centre_line(arms, s)[0]
    half, half_full = 0.5 * width_at(arms, t)[0], 0.5 * width_at(arms, s)[0]
    gap = np.full(arms.radius.shape, CLEAR)
    for beside in (1, 3):
        other = (side + beside) % 4
        q = np.einsum("fkad,fknd->fkna", frame[quad, side], full[quad, other] - middle[quad, side][:, :, None])
        apart = np.linalg.norm(local[:, :, :, None] + q[:, :, None], axis=-1)  # the frames differ by half a turn
        apart -= half[..., None] + half_full[quad, other][:, :, None]
        gap = np.minimum(gap, apart.min(axis=(2, 3)))
    return np.where(border, CLEAR, gap)


def room(flat: FlatPatches) -> np.ndarray:
    """(F,) metres: the widest arms whose straight cross still leaves slots over the outer third of every quad."""
    shape = arms(flat, SpiralParams(), np.zeros(len(flat.corners)), np.zeros(len(flat.corners)))
    opening = np.diff(shape.angle, axis=1)
    # edges of two straight arms of width w meet at w (1 + cos) / (2 sin) from the centre
    reach = ((1.0 + np.abs(np.cos(opening))) / (2.0 * np.maximum(np.sin(opening), 1e-9))).max(axis=1)
    return (2.0 / 3.0) * shape.radius.min(axis=1) / reach


def twist_bound(flat: FlatPatches, params: SpiralParams, width: np.ndarray) -> np.ndarray:
    """(F,) radians: largest twist, up to the largest that is asked for, that leaves a slot in the real quad.

    ``width`` (F,) in metres. Judged for pure spirals, so that the bound of a quad does not hang on its neighbours.
    """
    slot = slot_needed(params)
    count = len(flat.corners)
    pure = arms(flat, replace(params, clockwise=False), width, np.zeros(count))
    low, high = np.zeros(count), np.full(count, params.twist_max)
    good = gaps(pure.unblended(high)).min(axis=1) >= slot
    low[good] = high[good]
    open_ = np.flatnonzero(~good)
    high = np.minimum(high, twist_limit(2.0 * pure.radius.max(axis=1), width, slot, DEPTH) + 0.1)
    for _ in range(14):
        middle = 0.5 * (low[open_] + high[open_])
        part = pure.of(open_)
        good = gaps(part.unblended(middle)).min(axis=1) >= slot
        low[open_] = np.where(good, middle, low[open_])
        high[open_] = np.where(good, high[open_], middle)
    return low


def _rolled(arms: Arms, step: int) -> Arms:
    """The same arms, with arm k - step in the place of arm k."""
    rolled = {name: np.roll(getattr(arms, name), step, axis=1) for name in ("radius", "angle", "joint_width", "pull", "share")}
    return replace(arms, **rolled)


def narrowest(arms: Arms, left: np.ndarray, right: np.ndarray, fillet: float) -> tuple[float, float]:
    """Narrowest slot and narrowest piece of material in metres, measured between the true edges of the arms.

    left, right : (F, 4) t where the left edge of arm k and the right edge of arm k + 1 end at the root of their slot.
    At its root a slot is as wide as its fillet's diameter.
    """
    share = np.linspace(0.0, 0.9, 24)
    own_right = np.roll(right, 1, axis=1)
    t = share * np.minimum(left, own_right)[..., None]
    bridge = _apart(arms, LEFT, t, arms, RIGHT, t, np.full((*left.shape, 1), 0.9999))[0].min()
    step = -1 if float(arms.wind.sum()) < 0.0 else 1
    opening = (step * (arms.angle - np.roll(arms.angle, step, axis=1)))[..., None] % (2.0 * math.pi)
    outer_end, inner_end = (own_right, np.roll(left, 1, axis=1)) if step > 0 else (left, np.roll(right, 0, axis=1))
    t = share * outer_end[..., None]
    s = np.minimum(t + opening / np.maximum(np.abs(arms.wind), 1e-9)[:, None, None], inner_end[..., None])
    side = RIGHT if step > 0 else LEFT
    apart, lean = _apart(arms, side, t, _rolled(arms, step), -side, s, inner_end[..., None])
    # where the edges part at a wide angle there is room; only slots whose sides run along each other can be narrow
    slot = float(np.where(lean > 0.7, apart, CLEAR).min())
    return (min(slot, 2.0 * fillet) if fillet > 0.0 else slot), float(bridge)


def _apart(
    one: Arms, side: float, t: np.ndarray, two: Arms, other: float, s: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of edge points at t from the nearest point, near s and up to ``end``, of the other edge; and how parallel they are."""
    p, dp = edge(one, t, side)
    for _ in range(8):
        q, dq = edge(two, s, other)
        move = ((q - p) * dq).sum(-1) / np.maximum((dq * dq).sum(-1), 1e-30)
        s = np.clip(s - np.clip(0.8 * move, -0.1, 0.1), 0.0, end)
    q, dq = edge(two, s, other)
    lean = np.abs((dp * dq).sum(-1)) / (np.linalg.norm(dp, axis=-1) * np.linalg.norm(dq, axis=-1))
    return np.linalg.norm(p - q, axis=-1), lean
