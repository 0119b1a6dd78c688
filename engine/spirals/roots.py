"""Roots of the slots between consecutive arms of a quad: the fillets at which the slots end near the hub."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float
from .clearance.slots import PARALLEL_COSINE, is_clockwise, slot_widths
from .curves.spiral import LEFT, RIGHT, Arms, centre_line, edge_points

# Largest arm parameter t (0 at the joint, 1 at the quad's centre) at which a slot may end. The edges of a wide arm
# between thin arms can end beyond the centre, at up to 1.12; a smaller bound would miss such roots.
_LARGEST_T = 1.2
# largest start values of t for new searches where a root is wrong, first with the requested fillet, then with larger
# fillets; rarely needed
_RETRY_T = (0.95, 0.85, 0.75)
_RETRY_FILLETS = (1.5, 2.2, 3.3, 5.0)  # factors on the requested fillet in these searches; larger ones shorten the slot
# least fillet to which ``_RETRY_FILLETS`` apply, as a share of the smallest arm width, so that a requested fillet of 0
# is enlarged too; larger values shorten such slots
_SMALLEST_RETRY = 0.1


@dataclass(frozen=True, eq=False)
class SlotRoots:
    """Roots of all slots. Entry k belongs to the slot between arm k and arm k + 1.

    left : arm parameter t on the left edge of arm k where the fillet begins
    right : arm parameter t on the right edge of arm k + 1 where the fillet ends
    centre : centre of the fillet, metres
    fillet : radius of the fillet, metres; larger than requested where a slot is still wide beside the quad's centre
    is_missing : True where there is no room for a slot
    """

    left: Float[np.ndarray, "quads 4"]
    right: Float[np.ndarray, "quads 4"]
    centre: Float[np.ndarray, "quads 4 2"]
    fillet: Float[np.ndarray, "quads 4"]
    is_missing: Bool[np.ndarray, "quads 4"]


def find_roots(arms: Arms, fillet: float) -> SlotRoots:
    """Find the roots of all slots: the places where the fillet touches both edges.

    Newton's method follows each root while the twist grows from 0 (straight arms) to its full value. Where the
    method misses the first root, as it may in slots that hardly narrow, the slot is scanned from its mouth inwards.

    Parameters
    ----------
    arms : arms of all quads
    fillet : radius, metres
    """
    following = np.roll(np.arange(4), -1)
    opening = (arms.angle[:, following] - arms.angle) % (2.0 * np.pi)
    away = 0.5 * arms.width + fillet
    cosine, sine = np.cos(opening), np.maximum(np.sin(opening), 1e-3)
    left = 1.0 - (away[:, following] + away * cosine) / sine / arms.radius
    right = 1.0 - (away + away[:, following] * cosine) / sine / arms.radius[:, following]
    top = float(np.abs(arms.wind).max(initial=0.0))
    for part in np.linspace(0.0, 1.0, 2 + int(np.ceil(top / 0.4)))[1:]:
        left, right, _ = _newton(arms.without_blends(part * arms.wind), left, right, fillet, rounds=2)
    left, right, miss = _newton(arms, left, right, fillet, rounds=8)
    doubtful = ~(miss < 1e-9)
    # a root is wrong if its slot is narrower farther out: check all slots coarsely, and narrow slots finely
    near = np.flatnonzero((_slot_minimum(arms, left, right, np.linspace(0.1, 0.8, 6)) < 5.0 * fillet).any(axis=1))
    closer = _slot_minimum(arms.subset(near), left[near], right[near], np.linspace(0.0, 0.97, 72))
    doubtful[near] |= closer < 1.999 * fillet
    quads = np.flatnonzero(doubtful.any(axis=1))
    if len(quads):
        again = _scan_inwards(arms.subset(quads), fillet)
        for whole, part in zip((left, right, miss), again, strict=True):
            whole[quads] = np.where(doubtful[quads], part, whole[quads])
    radius = _enlarge_fillets(arms, left, right, miss, fillet)
    centre = edge_points(arms, left[..., None], LEFT, radius[..., None])[0][:, :, 0]
    missed = ~(miss < 1e-9) | (left < 0.02) | (right < 0.02)
    return SlotRoots(left, right, centre, radius, missed)


def _enlarge_fillets(
    arms: Arms, left: np.ndarray, right: np.ndarray, miss: np.ndarray, fillet: float
) -> Float[np.ndarray, "quads 4"]:
    """Return the fillet radii; enlarge fillets with wrong roots, where the slot is still wide beside the quad's centre.

    The roots of larger fillets, and their remaining distances, are written into ``left``, ``right`` and ``miss``.
    """
    radius, wrong = np.full(left.shape, fillet), _is_wrong(arms, left, right, miss)
    quads = np.flatnonzero(wrong.any(axis=1))
    if not len(quads):
        return radius
    least = max(fillet, _SMALLEST_RETRY * float(arms.width.min()))
    wider = np.array([fillet, *(x * least for x in _RETRY_FILLETS)]).repeat(len(_RETRY_T))
    first = np.tile(_RETRY_T, 1 + len(_RETRY_FILLETS))
    shape, some = (len(wider), len(quads), 4), arms.subset(np.tile(quads, len(wider)))  # solve all retries at once
    begin, end = (np.minimum(t[quads], first[:, None, None]).reshape(-1, 4) for t in (left, right))
    fillets = np.broadcast_to(wider[:, None, None], shape)
    roots = _newton(some, begin, end, fillets.reshape(-1, 4)[..., None], rounds=30, step=0.02)
    good = ~_is_wrong(some, *roots).reshape(shape)
    better, best = wrong[quads] & good.any(axis=0), good.argmax(axis=0)[None]
    for whole, every in zip((left, right, miss, radius), (*roots, fillets), strict=True):
        part = np.take_along_axis(every.reshape(shape), best, axis=0)[0]
        whole[quads] = np.where(better, part, whole[quads])
    return radius


def _is_wrong(arms: Arms, left: np.ndarray, right: np.ndarray, miss: np.ndarray) -> Bool[np.ndarray, "quads 4"]:
    """Return a mask of wrong roots: not converged, beyond the centre, or where an arm's edge runs backwards."""
    out = ~(miss < 1e-9) | (np.maximum(left, right) > 1.0)
    for way, t in ((LEFT, left), (RIGHT, np.roll(right, 1, axis=1))):
        t = np.minimum(t, 1.0)[..., None]
        back = (edge_points(arms, t, way)[1] * centre_line(arms, t)[1]).sum(axis=-1)[..., 0] < 0.0
        out |= back if way == LEFT else np.roll(back, -1, axis=1)
    return out


def _slot_minimum(arms: Arms, left: np.ndarray, right: np.ndarray, share: np.ndarray) -> Float[np.ndarray, "quads 4"]:
    """Return every slot's least width at shares (N,) of its length, where its edges are nearly parallel."""
    apart, lean = slot_widths(arms, left, right, share)[:2]
    return np.where(lean > PARALLEL_COSINE, apart, np.inf).min(axis=-1)


def _scan_inwards(arms: Arms, fillet: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find roots at the first narrow place from the mouth inwards.

    Return t on the left and on the right edge, and the remaining distance in metres as in ``_newton``, each (F, 4).
    """
    far = np.full(arms.radius.shape, 0.999)
    apart, lean, outer, inner = slot_widths(arms, far, far, np.linspace(0.0, 1.0, 129))
    # a column of True at the end stops every scan
    narrow = np.concatenate(
        [(apart < 2.0 * fillet) & (lean > PARALLEL_COSINE), np.ones((*far.shape, 1), dtype=bool)], axis=-1
    )
    first = np.clip(narrow.argmax(axis=-1) - 1, 0, outer.shape[-1] - 1)[..., None]
    outer, inner = np.take_along_axis(outer, first, axis=-1)[..., 0], np.take_along_axis(inner, first, axis=-1)[..., 0]
    # the outer arm of slot k is arm k + 1, or arm k if the spirals wind clockwise
    left, right = (outer, inner) if is_clockwise(arms) else (inner, outer)
    left, right, miss = _newton(arms, left, right, fillet, rounds=40, step=0.01)
    return left, right, np.where(narrow[..., 0], 1.0, miss)


def _newton(
    arms: Arms, left: np.ndarray, right: np.ndarray, fillet: float | np.ndarray, rounds: int, step: float = 0.08
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Improve ``left`` and ``right``, the t (F, 4) of every root, by Newton's method; steps are at most ``step``.

    Also return the remaining distance (F, 4) before the last iteration, metres: between the centres of two circles with
    the fillet's radius, each touching one of the two edges.
    """
    miss = np.empty(0)
    for _ in range(rounds):
        a, da = (x[:, :, 0] for x in edge_points(arms, left[..., None], LEFT, fillet))
        b, db = (
            np.roll(x[:, :, 0], -1, axis=1)
            for x in edge_points(arms, np.roll(right, 1, axis=1)[..., None], RIGHT, fillet)
        )
        gap = b - a
        miss = np.linalg.norm(gap, axis=-1)
        det = da[..., 1] * db[..., 0] - da[..., 0] * db[..., 1]
        det = np.where(np.abs(det) < 1e-20, 1e-20, det)
        # solve a + da x = b + db y for the steps x and y
        x = (gap[..., 1] * db[..., 0] - gap[..., 0] * db[..., 1]) / det
        y = (gap[..., 1] * da[..., 0] - gap[..., 0] * da[..., 1]) / det
        left = np.clip(left + np.clip(x, -step, step), 0.0, _LARGEST_T)
        right = np.clip(right + np.clip(y, -step, step), 0.0, _LARGEST_T)
    return left, right, miss
