"""Solid hubs: quads without room for a spiral, whose hub reaches to straight bars at the four joints.

Such a quad is marked by widths below the smallest width of any spiral, so that widths and twists alone describe a
design. The elastic model treats its bars as straight thin arms, which are softer than the cut shape.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..surface.checking.finding import Finding, list_faces, make_finding
from .clearance.slots import MIN_WIDTH_SHARE, SOLID_WIDTH_SHARE, width_range
from .curves.spiral import LEFT, RIGHT, Arms, centre_line, edge_points, make_arms, same_width
from .roots import SlotRoots, find_roots

# arm width, as a share of the smallest width of the settings, below which a quad has a solid hub; it must lie between
# ``SOLID_WIDTH_SHARE`` and ``MIN_WIDTH_SHARE``
SOLID_WIDTH_LIMIT = 0.49
# largest share of quads with a solid hub; designs with more are refused, because the piece would hardly take the
# target's shape
MAX_SOLID_SHARE = 0.01
MAX_SOLID_HUBS = 20  # largest number of quads with a solid hub; designs with more are refused
MAX_ROOT_T = 0.4  # largest arm parameter t at the root of a slot beside a solid hub; larger values weaken the bars
# safety factor on the distance between both edges of a slot at equal t, which crosses the slot obliquely and so exceeds
# its width; larger is safer and makes slots shorter
OBLIQUE_FACTOR = 1.2
MIN_TURN = 0.01  # least angle of the arc around a hub's corner, radians; smaller values permit larger radii
SAMPLES = 33  # number of t up to ``MAX_ROOT_T`` where slots are measured; more samples find the root more exactly
# proposed number of quads for a new mesh, as a share of the present number; fewer, larger quads may pass over parts
# that are too small for any spiral; not measured
FEWER_QUADS_SHARE = 0.6


def mark_solid_hubs(width: Float[np.ndarray, "quads 4"], params: SpiralParams) -> Bool[np.ndarray, " quads"]:
    """Return a mask of the quads with a solid hub instead of a spiral, which very small arm widths mark.

    Parameters
    ----------
    width : (F, 4) arm widths, metres; all four below ``SOLID_WIDTH_LIMIT`` of the smallest width mean a solid hub
    params : settings with the smallest width
    """
    return (width < SOLID_WIDTH_LIMIT * params.width_min).all(axis=1)


@lru_cache(maxsize=4)  # a search calls this often with the same patches
def mark_too_small(flat: FlatPatches, params: SpiralParams) -> Bool[np.ndarray, " quads"]:
    """Return a mask of the quads where even straight arms, half as wide as the smallest width, leave no slots."""
    low, high = width_range(flat, params)
    thinnest = np.minimum(low, MIN_WIDTH_SHARE * params.width_min)
    straight = make_arms(flat, params, same_width(thinnest), np.zeros(len(low)))
    return find_roots(straight, params.fillet).is_missing.any(axis=1) | mark_solid_hubs(same_width(high), params)


def with_solid_hubs(
    params: SpiralParams,
    width: Float[np.ndarray, "quads 4"],
    twist: Float[np.ndarray, " quads"],
    quads: Bool[np.ndarray, " quads"],
) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
    """Return a copy of widths (F, 4), metres, and twists (F,), radians, that marks quads (mask) as solid hubs."""
    return np.where(quads[:, None], SOLID_WIDTH_SHARE * params.width_min, width), np.where(quads, 0.0, twist)


def suggest_quad_count(count: int) -> int:
    """Return the number of quads to remesh with if some of ``count`` quads have no room for a spiral."""
    return max(round(FEWER_QUADS_SHARE * count), 1)


def refuse_many_solid_hubs(quads: Int[np.ndarray, " n"], count: int, why: str) -> None:
    """Raise ``FlexMapsError`` if more than ``MAX_SOLID_SHARE`` or ``MAX_SOLID_HUBS`` quads have no room for a spiral.

    Parameters
    ----------
    quads : quads without room
    count : number of all quads
    why : message of the error
    """
    if len(quads) > min(MAX_SOLID_HUBS, int(MAX_SOLID_SHARE * count)):
        raise FlexMapsError(why, faces=quads, quads=suggest_quad_count(count))


def solid_hub_findings(quads: Int[np.ndarray, " n"]) -> list[Finding]:
    """Return the warning about quads without a spiral, if any."""
    if not len(quads):
        return []
    text = f"{list_faces(quads, 'has', 'have')} no room for a spiral and {'gets a solid hub' if len(quads) == 1 else 'get solid hubs'}, which will not bend: make the piece larger, or use fewer quads"
    return [make_finding("no-spiral", text, quads, severity="warning")]


def slot_roots(arms: Arms, fillet: float, solid: Bool[np.ndarray, " quads"]) -> SlotRoots:
    """Return the roots of all slots of some quads.

    Parameters
    ----------
    arms : arms of these quads
    fillet : radius at the roots, metres
    solid : mask of the quads with a solid hub
    """
    return with_solid_hub_roots(find_roots(arms, fillet), arms, fillet, solid)


def update_roots(root: SlotRoots, quads: Int[np.ndarray, " some"], part: SlotRoots) -> SlotRoots:
    """Return a copy of the slot roots in which ``part`` replaces the entries of the quads with indices ``quads``."""
    found = replace(root, **{name: getattr(root, name).copy() for name in root.__dataclass_fields__})
    for name in root.__dataclass_fields__:
        getattr(found, name)[quads] = getattr(part, name)
    return found


def with_solid_hub_roots(root: SlotRoots, arms: Arms, fillet: float, quads: Bool[np.ndarray, " quads"]) -> SlotRoots:
    """Return slot roots in which slots beside solid hubs end at the deepest place wide enough for the fillet.

    Parameters
    ----------
    root : roots of all slots
    arms : arms of all quads
    fillet : radius at the roots, metres
    quads : mask of the quads with a solid hub
    """
    some = np.flatnonzero(quads)
    if not len(some):
        return root
    part = arms.subset(some)
    t = np.broadcast_to(np.linspace(0.0, MAX_ROOT_T, SAMPLES), (len(some), 4, SAMPLES))
    left = edge_points(part, t, LEFT)[0]
    right = np.roll(edge_points(part, t, RIGHT)[0], -1, axis=1)
    inwards = centre_line(part, t)[1]
    # seen from the centre outwards, the next arm lies on an arm's left; elsewhere both edges have crossed
    across = right - left
    beyond = inwards[..., 0] * -across[..., 1] + inwards[..., 1] * across[..., 0]
    apart = np.where(beyond > 0.0, np.linalg.norm(across, axis=-1), 0.0)
    wide = np.logical_and.accumulate(apart >= OBLIQUE_FACTOR * 2.0 * fillet, axis=-1)
    last = np.maximum(wide.sum(axis=-1) - 1, 1)
    missed = apart[..., 1] < 2.0 * fillet
    depth = MAX_ROOT_T * last / (SAMPLES - 1)
    centre, radius = _corner_arcs(part, depth)
    changes = {"left": depth, "right": depth, "is_missing": missed, "centre": centre, "fillet": radius}
    fields = {name: getattr(root, name).copy() for name in changes}
    for name, values in changes.items():
        fields[name][some] = values
    return replace(root, **fields)


def _corner_arcs(arms: Arms, depth: Float[np.ndarray, "quads 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Return centres and radii (metres) of the arcs around hub corners, from left edges to the next arms' right edges.

    depth : arm parameter t where the arcs begin and end
    """
    (p, inwards), (q, outwards) = (
        (x[:, :, 0] @ np.array([1.0, 1j]) for x in edge_points(arms, t[..., None], side))
        for t, side in ((depth, LEFT), (np.roll(depth, 1, axis=1), RIGHT))
    )
    q, outwards = np.roll(q, -1, axis=1), -np.roll(outwards, -1, axis=1)
    turn = np.angle(outwards / inwards)
    turn = np.minimum(np.where(turn > 0.5 * np.pi, turn - 2.0 * np.pi, turn), -MIN_TURN)
    half = 0.5 * (q - p)
    centre = 0.5 * (p + q) - 1j * half / np.tan(-0.5 * turn)
    return np.stack([centre.real, centre.imag], axis=-1), np.abs(half) / np.sin(-0.5 * turn)
