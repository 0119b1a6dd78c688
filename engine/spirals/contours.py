"""Outlines of the panels: one closed curve of arcs around every panel and one around every hole (FlexMaps section 5).

Outlines need no union of polygons. Between two consecutive arms of a quad lies a slot, one per corner of the quad. Its
curve runs from the joint of one arm along the arm's left edge to the hub, around a fillet, and out along the right edge of
the other arm. At a joint the curve continues in the neighbouring quad; at a cut it crosses the arm's end. So the slots of
all quads form closed chains: one around every inner flat vertex, and one around the panel. The fillet is the slot's root.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..patches.joining import panel_numbers
from ..patches.layout import PatchLayout
from ..progress import SILENT, Progress
from ..surface.mesh import QuadMesh
from .clearance.slots import PARALLEL_COSINE, is_clockwise, slot_widths
from .curves.arcs import Curve, FittedArcs, fit_biarcs
from .curves.spiral import LEFT, RIGHT, Arms, centre_line, edge_points, opposite_sides, widening
from .rim import Rim

# Largest t at which a slot may end. The edges of a wide arm between thin ones can end beyond the centre: in 1 of 100
# spirals with widths between 1 and 2 mm in quads of 60 and 120 degrees, at most at 1.12.
_LARGEST_T = 1.2
# Retries for wrong roots: start from these t, first with the requested fillet, then with larger ones. Of 30,000 spirals
# with widths of 1 or 2 mm some 20 need that.
_RETRY_T = (0.95, 0.85, 0.75)
_RETRY_FILLETS = (1.5, 2.2, 3.3, 5.0)  # factors on the requested fillet
# the factors apply to at least this share of the smallest arm width, so that retries work if the requested fillet is 0
_SMALLEST_RETRY = 0.1


@dataclass(frozen=True, eq=False)
class SlotRoots:
    """Roots of all slots. Entry k belongs to the slot between arm k and arm k + 1.

    left : t on the left edge of arm k where the fillet begins
    right : t on the right edge of arm k + 1 where the fillet ends
    centre : centre of the fillet, metres
    fillet : radius of the fillet, metres; larger than requested where a slot is still wide beside the quad's centre
    missed : True where there is no room for a slot
    """

    left: Float[np.ndarray, "quads 4"]
    right: Float[np.ndarray, "quads 4"]
    centre: Float[np.ndarray, "quads 4 2"]
    fillet: Float[np.ndarray, "quads 4"]
    missed: Bool[np.ndarray, "quads 4"]


def find_roots(arms: Arms, fillet: float) -> SlotRoots:
    """Find the roots of all slots: the places where a fillet with radius ``fillet`` (metres) touches both edges.

    Newton's method follows each root from straight arms (twist 0) to the full twist. If it misses the first such place,
    as it may in slots that hardly narrow, scan the slot from its mouth inwards.
    """
    following = np.roll(np.arange(4), -1)
    opening = (arms.angle[:, following] - arms.angle) % (2.0 * np.pi)
    away = 0.5 * arms.width + fillet
    cosine, sine = np.cos(opening), np.maximum(np.sin(opening), 1e-3)
    left = 1.0 - (away[:, following] + away * cosine) / sine / arms.radius
    right = 1.0 - (away + away[:, following] * cosine) / sine / arms.radius[:, following]
    top = float(np.abs(arms.wind).max(initial=0.0))
    for part in np.linspace(0.0, 1.0, 2 + int(np.ceil(top / 0.4)))[1:]:
        left, right, _ = _newton(arms.unblended(part * arms.wind), left, right, fillet, rounds=2)
    left, right, miss = _newton(arms, left, right, fillet, rounds=8)
    doubtful = ~(miss < 1e-9)
    # a slot narrower than at its root means a wrong root: check all slots coarsely, and the narrow ones finely
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
    """Return fillet radii, larger where the root is wrong, because the slot is still wide beside the centre.

    Write the roots and distances of these fillets into ``left``, ``right`` and ``miss``.
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
    """Return a mask of the roots that were missed, lie beyond the centre, or lie where an edge turns back."""
    out = ~(miss < 1e-9) | (np.maximum(left, right) > 1.0)
    for way, t in ((LEFT, left), (RIGHT, np.roll(right, 1, axis=1))):
        t = np.minimum(t, 1.0)[..., None]
        back = (edge_points(arms, t, way)[1] * centre_line(arms, t)[1]).sum(axis=-1)[..., 0] < 0.0
        out |= back if way == LEFT else np.roll(back, -1, axis=1)
    return out


def _slot_minimum(arms: Arms, left: np.ndarray, right: np.ndarray, share: np.ndarray) -> Float[np.ndarray, "quads 4"]:
    """Return the least width of every slot in metres, over the shares (N,) of its length where its sides are nearly parallel."""
    apart, lean = slot_widths(arms, left, right, share)[:2]
    return np.where(lean > PARALLEL_COSINE, apart, np.inf).min(axis=-1)


def _scan_inwards(arms: Arms, fillet: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the first narrow place from the mouth inwards; return left t, right t and remaining distance, each (F, 4)."""
    far = np.full(arms.radius.shape, 0.999)
    apart, lean, outer, inner = slot_widths(arms, far, far, np.linspace(0.0, 1.0, 129))
    # the added last column ends every scan
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
    """Improve both t (F, 4) of every root; also return the distance (F, 4) in metres before the last iteration."""
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
        # a + da x = b + db y
        x = (gap[..., 1] * db[..., 0] - gap[..., 0] * db[..., 1]) / det
        y = (gap[..., 1] * da[..., 0] - gap[..., 0] * da[..., 1]) / det
        left = np.clip(left + np.clip(x, -step, step), 0.0, _LARGEST_T)
        right = np.clip(right + np.clip(y, -step, step), 0.0, _LARGEST_T)
    return left, right, miss


@dataclass(frozen=True, eq=False)
class Outline:
    """Curves of one panel in its patch's frame: outer curve counter-clockwise, holes clockwise; material on the left."""

    outer: Curve
    holes: tuple[Curve, ...]


@dataclass(frozen=True, eq=False)
class Tips:
    """Ends of arms with connectors or other shapes instead of a plain cut; arm 4 f + k is arm k of quad f.

    extra : outward offset of the left and the right edges at the tips, metres
    full, over : t up to which the offset is complete, and t from which it is 0
    begin : t where the edges begin
    across : curve from the right to the left edge of every such arm, in its patch's frame, by the arm's number
    """

    extra: Float[np.ndarray, "2 quads 4"]
    full: Float[np.ndarray, "quads 4"]
    over: Float[np.ndarray, "quads 4"]
    begin: Float[np.ndarray, "quads 4"]
    across: dict[int, Curve]

    def wider(self, which: Int[np.ndarray, " n"], t: Float[np.ndarray, "n m"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the additional width at t, and its derivative, of the edges ``which``: left edges first, then right ones."""
        arm = which % self.full.size
        return widening(
            2.0 * self.extra.ravel()[which][:, None],
            self.full.ravel()[arm][:, None],
            self.over.ravel()[arm][:, None],
            t,
        )


def arm_starts(layout: PatchLayout, arms: Arms, slot: float) -> Float[np.ndarray, "quads 4"]:
    """Return the t where every arm begins: 0, or slightly more at cuts inside a patch.

    At a cut inside a patch, two arm ends face each other in one panel, and need a gap of at least ``slot`` metres.
    """
    quad, side = opposite_sides(layout.mesh)
    inside = (
        layout.outline_sides
        & (quad != np.arange(len(quad))[:, None])
        & (layout.patch_of[quad] == layout.patch_of[:, None])
    )
    begin = np.zeros(inside.shape)
    if not inside.any():
        return begin
    speed = centre_line(arms, begin[..., None])[1][:, :, 0]
    own = np.stack([edge_points(arms, begin[..., None], way)[0][:, :, 0] for way in (RIGHT, LEFT)], axis=2)
    own, facing = own[inside], own[quad, side][inside]
    apart = np.minimum(_from_segment(own, facing), _from_segment(facing, own))
    begin[inside] = 0.5 * np.maximum(1.02 * slot - apart, 0.0) / np.linalg.norm(speed, axis=-1)[inside]
    return np.maximum(begin, np.where(inside, begin[quad, side], 0.0))


def _from_segment(points: Float[np.ndarray, "n k 2"], segment: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, " n"]:
    """Return the smallest distance of points from segments."""
    a, along = segment[:, :1], segment[:, 1:] - segment[:, :1]
    share = np.clip(((points - a) * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    return np.linalg.norm(points - a - share[..., None] * along, axis=-1).min(axis=1)


def fit_edges(
    layout: PatchLayout,
    arms: Arms,
    root: SlotRoots,
    plain: Float[np.ndarray, "quads 4"],
    tolerance: float,
    tips: Tips | None = None,
    progress: Progress = SILENT,
    known: FittedArcs | None = None,
    again: Int[np.ndarray, " some"] | None = None,
) -> FittedArcs:
    """Fit arcs to both edges of every arm, within ``tolerance`` metres.

    Curve 4 f + k is the left edge of arm k, inwards; curve 4 F + 4 f + k is its right edge, outwards. Arms without a tip
    begin at the t ``plain``. ``known`` is an earlier result; if given, only the arms ``again`` are fitted.

    Raises ``FlexMapsError`` with the faces of spirals that have no room in their quads.
    """
    tight = np.flatnonzero(root.missed.any(axis=1))
    if len(tight):
        raise FlexMapsError(
            f"{len(tight)} of {len(arms.centre)} spirals do not fit their quads; make the quads larger, the arms thinner or the twist smaller",
            faces=tight,
        )
    begin = plain if tips is None else tips.begin
    count = arms.radius.size
    left = np.stack([begin.ravel(), root.left.ravel()], axis=1)
    right = np.stack([np.roll(root.right, 1, axis=1).ravel(), begin.ravel()], axis=1)
    new = np.arange(2 * count)
    if known is not None and again is not None:
        new = np.concatenate([again, count + again])
    each = arms.one_by_one(*np.divmod(new % count, 4))
    side = np.where(new < count, LEFT, RIGHT)[:, None, None]

    def evaluate(which: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        added = None if tips is None else tips.wider(new[which], t)
        wider = None if added is None else (added[0][:, None], added[1][:, None])
        point, tangent = edge_points(each.subset(which), t[:, None], side[which], wider=wider)
        return point[:, 0], tangent[:, 0]

    fitted = fit_biarcs(evaluate, np.concatenate([left, right])[new], tolerance, progress)
    return fitted if known is None else known.replaced(new, fitted)


def draw_outlines(
    layout: PatchLayout,
    arms: Arms,
    root: SlotRoots,
    plain: Float[np.ndarray, "quads 4"],
    fitted: FittedArcs,
    tips: Tips | None = None,
    progress: Progress = SILENT,
    caps: Mapping[int, Curve] = {},
    rim: tuple[Rim, float] | None = None,
) -> list[Outline]:
    """Assemble one outline per patch from the ``fit_edges`` of all arms, with ``tips`` at the cuts or plain ends at the t ``plain``.

    ``caps`` are end curves of other arms, as in ``Tips.across``; ``rim`` is the rim with the fillet of its necks in metres.

    Raises ``FlexMapsError`` with the faces of a patch that overlaps itself.
    """
    mesh, joined, patch_of = layout.mesh, ~layout.outline_sides, layout.patch_of
    begin = plain if tips is None else tips.begin
    chains = _chains(mesh, joined, {} if rim is None else rim[0].onward())
    across = {**caps, **({} if tips is None else tips.across), **({} if rim is None else _links(arms, *rim))}
    pieces = _pieces(arms, root, begin, fitted, joined, across, progress.part(0.0, 0.4))
    outer: dict[int, Curve] = {}
    holes: dict[int, list[Curve]] = {}
    curves: list[tuple[int, Curve]] = []
    for number, chain in enumerate(chains):
        if number % 500 == 0:
            progress(0.4 + 0.6 * number / len(chains), "closing the outlines")
        points = np.concatenate([pieces[c][0] for c in chain])
        bulge = np.concatenate([pieces[c][1] for c in chain])
        curves.append((int(patch_of[chain[0] // 4]), Curve(points, bulge)))
    for patch, curve in (*curves, *([] if rim is None else rim[0].closed())):
        if curve.area > 0.0:
            if patch in outer:
                raise FlexMapsError(
                    f"Panel {panel_numbers(layout)[patch]} overlaps itself once its spirals are drawn; cut it in two",
                    faces=np.flatnonzero(patch_of == patch),
                )
            outer[patch] = curve
        else:
            holes.setdefault(patch, []).append(curve)
    return [Outline(outer[p], tuple(holes.get(p, ()))) for p in range(int(patch_of.max()) + 1)]


def _pieces(
    arms: Arms,
    root: SlotRoots,
    begin: np.ndarray,
    fitted: FittedArcs,
    joined: np.ndarray,
    across: dict[int, Curve],
    progress: Progress,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the curve (points, bulges) around every slot (quad, corner): inwards along arm corner - 1, outwards along arm corner.

    If side ``corner`` is cut, the end of arm ``corner`` follows.
    """
    t_left, t_right = root.left[..., None], np.roll(root.right, 1, axis=1)[..., None]
    p_left, d_left = (x[:, :, 0] for x in edge_points(arms, t_left, LEFT))
    _, d_right = (np.roll(x[:, :, 0], -1, axis=1) for x in edge_points(arms, t_right, RIGHT))
    # from inwards on the left edge to outwards on the right edge of the next arm: always a turn to the right
    turn = np.arctan2(d_left[..., 0] * -d_right[..., 1] + d_left[..., 1] * d_right[..., 0], -(d_left * d_right).sum(-1))
    turn = np.where(turn > 0.5 * np.pi, turn - 2.0 * np.pi, np.minimum(turn, 0.0))
    bulge = np.tan(0.25 * turn)
    end = edge_points(arms, begin[..., None], RIGHT)[0][:, :, 0]
    start, count = fitted.start, arms.radius.size
    pieces = []
    for f in range(len(arms.centre)):
        if f % 100 == 0:
            progress(f / len(arms.centre), "drawing the slots")
        for j in range(4):
            k = (j - 1) % 4
            a, b = 4 * f + k, count + 4 * f + j
            left, right = slice(start[a], start[a + 1]), slice(start[b], start[b + 1])
            points, bulges = [fitted.points[left]], [fitted.bulge[left]]
            if root.fillet[f, k] > 0.0:
                points.append(p_left[f, k][None])
                bulges.append(bulge[f, k : k + 1])
            points.append(fitted.points[right])
            bulges.append(fitted.bulge[right])
            if 4 * f + j in across:
                points.append(across[4 * f + j].points[:-1])
                bulges.append(across[4 * f + j].bulge[:-1])
            elif not joined[f, j]:
                points.append(end[f, j][None])
                bulges.append(np.zeros(1))
            pieces.append((np.concatenate(points), np.concatenate(bulges)))
    return pieces


def _links(arms: Arms, rim: Rim, fillet: float) -> dict[int, Curve]:
    """Return the outlines' curves along the rim; the keys are the arms whose right edges they start from."""
    half = 0.5 * arms.joint_width[rim.quad, rim.side]
    number = (4 * rim.quad + rim.side).tolist()
    return {arm: Curve(*rim.link(n, half, fillet), closed=False) for n, arm in enumerate(number)}


def _chains(mesh: QuadMesh, joined: np.ndarray, onward: Mapping[int, int]) -> list[list[int]]:
    """Return closed chains of slots 4 quad + corner: across a joined side into the neighbour, at a cut to the quad's next slot.

    ``onward`` maps slots to other successors, at the rim.
    """
    quad, side = opposite_sides(mesh)
    own = 4 * np.arange(len(mesh.quads))[:, None] + (np.arange(4) + 1) % 4
    # corner j starts side j; the neighbour's side runs the other way, so the same vertex is its corner side + 1
    following = np.where(joined, 4 * quad + (side + 1) % 4, own).ravel().tolist()
    for slot, after in onward.items():
        following[slot] = after
    seen = [False] * len(following)
    chains = []
    for first in range(len(following)):
        if seen[first]:
            continue
        chain, at = [], first
        while not seen[at]:
            seen[at] = True
            chain.append(at)
            at = following[at]
        chains.append(chain)
    return chains
