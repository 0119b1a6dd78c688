"""Quads without room for a spiral: a solid hub, to which the four joints are joined straight.

The width says which they are: their arms are thinner than any spiral's may be. So the widths and twists that a piece is stored with are
enough, and every stage sees the same quads. The model takes them for straight thin arms, which are softer than what is cut.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..surface.checking.finding import Finding, counted, finding, named
from .contours import Hubs, hubs
from .slots import SOLID, THINNEST, width_range
from .spiral import LEFT, RIGHT, Arms, alike, arms, centre_line, edge

BELOW = 0.49  # share of the smallest width below which arms belong to a solid hub: between ``SOLID`` and ``THINNEST``
LARGEST_SHARE = 0.01  # of the quads that may stay without a spiral: more of them would make another piece
MOST = 20  # quads that may stay without a spiral, however many there are
DEEPEST = 0.4  # t at which a slot beside a solid hub ends at the latest: deeper ones make the joints' bars weak
ASLANT = (
    1.2  # times the slot: how far points of both edges at the same t are apart where the slot between them is that wide
)
STRAIGHT = 0.01  # radians by which the way round a hub's corner turns at least, so that its arc has a centre
LOOKS = 33  # places between the joint and there where slots are measured
FEWER = (
    0.6  # times the count: larger quads in the same shape leave out the parts that no quad has room in; not measured
)


def without_spiral(width: Float[np.ndarray, "quads 4"], params: SpiralParams) -> Bool[np.ndarray, " quads"]:
    """Which quads have a solid hub, by the widths of their arms in metres."""
    return (width < BELOW * params.width_min).all(axis=1)


@lru_cache(maxsize=4)  # a search asks for those of the same patches again and again
def hopeless(flat: FlatPatches, params: SpiralParams) -> Bool[np.ndarray, " quads"]:
    """Quads in which not even straight arms of the least width have slots."""
    low, high = width_range(flat, params)
    thinnest = np.minimum(low, THINNEST * params.width_min)
    straight = arms(flat, params, alike(thinnest), np.zeros(len(low)))
    return hubs(straight, params.fillet).missed.any(axis=1) | without_spiral(alike(high), params)


def solid(
    params: SpiralParams,
    width: Float[np.ndarray, "quads 4"],
    twist: Float[np.ndarray, " quads"],
    quads: Bool[np.ndarray, " quads"],
) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
    """Widths in metres and twists in radians with a solid hub in some quads."""
    return np.where(quads[:, None], SOLID * params.width_min, width), np.where(quads, 0.0, twist)


def fewer(count: int) -> int:
    """How many quads to remesh with instead of ``count`` that leave some without room."""
    return max(round(FEWER * count), 1)


def refuse_many(quads: Int[np.ndarray, " n"], count: int, why: str) -> None:
    """Raise ``FlexMapsError`` where more quads are without a spiral than a piece of ``count`` quads may have."""
    if len(quads) > min(MOST, int(LARGEST_SHARE * count)):
        raise FlexMapsError(why, faces=quads, quads=fewer(count))


def no_spiral(quads: Int[np.ndarray, " n"]) -> list[Finding]:
    """The warning that names the quads without a spiral, if there are any."""
    if not len(quads):
        return []
    text = f"{named(quads)} without room for a spiral: {counted(len(quads), 'it has a solid hub', 'they have solid hubs')} and will not bend; remesh, or move the vertices there"
    return [finding("no-spiral", text, quads, severity="warning")]


def with_solid(root: Hubs, arms: Arms, fillet: float, quads: Bool[np.ndarray, " quads"]) -> Hubs:
    """The roots of the slots, those beside solid hubs where the slots are still wide enough for the fillet (metres)."""
    some = np.flatnonzero(quads)
    if not len(some):
        return root
    part = arms.of(some)
    t = np.broadcast_to(np.linspace(0.0, DEEPEST, LOOKS), (len(some), 4, LOOKS))
    left = edge(part, t, LEFT)[0]
    right = np.roll(edge(part, t, RIGHT)[0], -1, axis=1)
    inwards = centre_line(part, t)[1]
    # seen from an arm, the next one lies on its left
    across = right - left
    beyond = inwards[..., 0] * -across[..., 1] + inwards[..., 1] * across[..., 0]
    apart = np.where(beyond > 0.0, np.linalg.norm(across, axis=-1), 0.0)
    wide = np.logical_and.accumulate(apart >= ASLANT * 2.0 * fillet, axis=-1)
    last = np.maximum(wide.sum(axis=-1) - 1, 1)
    missed = apart[..., 1] < 2.0 * fillet
    depth = DEEPEST * last / (LOOKS - 1)
    centre, radius = _arcs(part, depth)
    found = {"left": depth, "right": depth, "missed": missed, "centre": centre, "fillet": radius}
    made = {name: getattr(root, name).copy() for name in found}
    for name, values in found.items():
        made[name][some] = values
    return replace(root, **made)


def _arcs(arms: Arms, depth: Float[np.ndarray, "quads 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Centre and radius, metres, of the arcs that lead from the left edges at these t to the right edges of the next arms."""
    (p, inwards), (q, outwards) = (
        (x[:, :, 0] @ np.array([1.0, 1j]) for x in edge(arms, t[..., None], side))
        for t, side in ((depth, LEFT), (np.roll(depth, 1, axis=1), RIGHT))
    )
    q, outwards = np.roll(q, -1, axis=1), -np.roll(outwards, -1, axis=1)
    turn = np.angle(outwards / inwards)
    turn = np.minimum(np.where(turn > 0.5 * np.pi, turn - 2.0 * np.pi, turn), -STRAIGHT)
    half = 0.5 * (q - p)
    centre = 0.5 * (p + q) - 1j * half / np.tan(-0.5 * turn)
    return np.stack([centre.real, centre.imag], axis=-1), np.abs(half) / np.sin(-0.5 * turn)
