"""Outlines of the panels: one closed curve of arcs around every panel and one around every hole (FlexMaps section 5).

Outlines need no union of polygons. Between two consecutive arms of a quad lies a slot, one per corner of the quad. The
slot's curve runs from the joint of one arm along the arm's left edge to the hub, around a fillet, and out along the
right edge of the other arm. At a joint the curve continues in the neighbouring quad; at a cut it crosses the arm's end.
So the slots of all quads form closed chains: one around every inner flat vertex, and one around the panel. The fillet
at a slot's inner end is called the slot's root.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..patches.joining import panel_numbers
from ..patches.layout import PatchLayout
from ..progress import SILENT, Progress
from ..surface.checking.finding import with_count
from ..surface.mesh import QuadMesh
from .curves.arcs import Curve, FittedArcs, fit_biarcs
from .curves.spiral import LEFT, RIGHT, Arms, centre_line, edge_points, opposite_sides, taper_width
from .rim import Rim
from .roots import SlotRoots


@dataclass(frozen=True, eq=False)
class Outline:
    """Curves of one panel in its patch's frame, metres: the outer curve counter-clockwise, holes clockwise."""

    outer: Curve
    holes: tuple[Curve, ...]


@dataclass(frozen=True, eq=False)
class Tips:
    """Ends of arms with connectors or other shapes instead of a plain cut; arm 4 f + k is arm k of quad f.

    The arm parameter t runs from 0 at the joint to 1 at the quad's centre.

    edge_offset : outward offset of the left and the right edges at the tips, metres
    taper_start, taper_end : t up to which the offset has its full value, and t from which it is 0
    begin : t where the edges begin
    end_curves : curve of each shaped end, from right to left edge, in the patch's frame, metres; key: arm number
    """

    edge_offset: Float[np.ndarray, "2 quads 4"]
    taper_start: Float[np.ndarray, "quads 4"]
    taper_end: Float[np.ndarray, "quads 4"]
    begin: Float[np.ndarray, "quads 4"]
    end_curves: dict[int, Curve]

    def added_width(self, which: Int[np.ndarray, " n"], t: Float[np.ndarray, "n m"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the additional width of arms at t, twice the offset of an edge (metres), and its derivative by t.

        Parameters
        ----------
        which : numbers of the edges: left edges of all arms first, then right edges
        t : places on every edge
        """
        arm = which % self.taper_start.size
        return taper_width(
            2.0 * self.edge_offset.ravel()[which][:, None],
            self.taper_start.ravel()[arm][:, None],
            self.taper_end.ravel()[arm][:, None],
            t,
        )


def arm_starts(layout: PatchLayout, arms: Arms, slot: float) -> Float[np.ndarray, "quads 4"]:
    """Return the arm parameter t where every arm begins: 0, or slightly more at cuts inside a patch.

    At a cut inside a patch, two arm ends face each other in one panel, and need a gap.

    Parameters
    ----------
    layout : mesh and cuts
    arms : arms of all quads
    slot : least width of the gap, metres
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
    apart = np.minimum(_distance_from_segment(own, facing), _distance_from_segment(facing, own))
    begin[inside] = 0.5 * np.maximum(1.02 * slot - apart, 0.0) / np.linalg.norm(speed, axis=-1)[inside]
    return np.maximum(begin, np.where(inside, begin[quad, side], 0.0))


def _distance_from_segment(
    points: Float[np.ndarray, "n k 2"], segment: Float[np.ndarray, "n 2 2"]
) -> Float[np.ndarray, " n"]:
    """Return the smallest distance (n,) of k points from their segment, in each of n groups."""
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
    cached: FittedArcs | None = None,
    refit: Int[np.ndarray, " some"] | None = None,
) -> FittedArcs:
    """Fit arcs to both edges of every arm, within ``tolerance`` metres.

    Curve 4 f + k is the left edge of arm k of quad f, inwards; curve 4 F + 4 f + k is its right edge, outwards.

    Parameters
    ----------
    layout, arms, root : mesh and cuts, arms of all quads, roots of their slots
    plain : arm parameter t where the edges begin if there are no ``tips``
    tolerance : largest distance of the arcs from the exact edges, metres
    tips : shaped ends of arms, with their own beginnings
    progress : called with the fraction done; may cancel
    cached : an earlier result for the same arms; default is none, and all arms are fitted
    refit : numbers of the arms in ``cached`` that are fitted again

    Raises
    ------
    FlexMapsError : with the faces of spirals that have no room in their quads
    """
    tight = np.flatnonzero(root.is_missing.any(axis=1))
    if len(tight):
        raise FlexMapsError(
            f"{with_count(len(tight), 'spiral does not fit its quad', 'spirals do not fit their quads')}; make the quads larger, the arms thinner or the twist smaller",
            faces=tight,
        )
    begin = plain if tips is None else tips.begin
    count = arms.radius.size
    left = np.stack([begin.ravel(), root.left.ravel()], axis=1)
    right = np.stack([np.roll(root.right, 1, axis=1).ravel(), begin.ravel()], axis=1)
    new = np.arange(2 * count)
    if cached is not None and refit is not None:
        new = np.concatenate([refit, count + refit])
    each = arms.one_by_one(*np.divmod(new % count, 4))
    side = np.where(new < count, LEFT, RIGHT)[:, None, None]

    def evaluate(which: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        added = None if tips is None else tips.added_width(new[which], t)
        wider = None if added is None else (added[0][:, None], added[1][:, None])
        point, tangent = edge_points(each.subset(which), t[:, None], side[which], added_width=wider)
        return point[:, 0], tangent[:, 0]

    fitted = fit_biarcs(evaluate, np.concatenate([left, right])[new], tolerance, progress)
    return fitted if cached is None else cached.replace_curves(new, fitted)


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
    """Assemble one outline per patch from the fitted edges of all arms.

    Parameters
    ----------
    layout, arms, root : mesh and cuts, arms of all quads, roots of their slots
    plain : arm parameter t where arms begin if there are no ``tips``
    fitted : result of ``fit_edges``
    tips : shaped ends of arms at the cuts; default is plain ends
    progress : called with the fraction done; may cancel
    caps : end curves of arms without a joint, as in ``Tips.end_curves``
    rim : the rim, and the fillet of its necks in metres

    Raises
    ------
    FlexMapsError : with the faces of a patch that overlaps itself
    """
    mesh, joined, patch_of = layout.mesh, ~layout.outline_sides, layout.patch_of
    begin = plain if tips is None else tips.begin
    chains = _slot_chains(mesh, joined, {} if rim is None else rim[0].linked_slots())
    across = {**caps, **({} if tips is None else tips.end_curves), **({} if rim is None else _rim_links(arms, *rim))}
    pieces = _slot_curves(arms, root, begin, fitted, joined, across, progress.part(0.0, 0.4))
    outer: dict[int, Curve] = {}
    holes: dict[int, list[Curve]] = {}
    curves: list[tuple[int, Curve]] = []
    for number, chain in enumerate(chains):
        if number % 500 == 0:
            progress(0.4 + 0.6 * number / len(chains), "closing the outlines")
        points = np.concatenate([pieces[c][0] for c in chain])
        bulge = np.concatenate([pieces[c][1] for c in chain])
        curves.append((int(patch_of[chain[0] // 4]), Curve(points, bulge)))
    for patch, curve in (*curves, *([] if rim is None else rim[0].closed_curves())):
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


def _slot_curves(
    arms: Arms,
    root: SlotRoots,
    begin: np.ndarray,
    fitted: FittedArcs,
    joined: np.ndarray,
    across: dict[int, Curve],
    progress: Progress,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the curve (points, bulges) around the slot at every corner of every quad.

    At corner j, the curve runs inwards along arm j - 1, outwards along arm j, and across the end of arm j at a cut.
    """
    t_left, t_right = root.left[..., None], np.roll(root.right, 1, axis=1)[..., None]
    p_left, d_left = (x[:, :, 0] for x in edge_points(arms, t_left, LEFT))
    _, d_right = (np.roll(x[:, :, 0], -1, axis=1) for x in edge_points(arms, t_right, RIGHT))
    # the fillet turns from the inward direction of a left edge to the outward direction of the next arm's right edge,
    # always to the right
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


def _rim_links(arms: Arms, rim: Rim, fillet: float) -> dict[int, Curve]:
    """Return the parts of outlines along the rim; key: the arm (4 quad + side) whose right edge precedes the part."""
    half = 0.5 * arms.joint_width[rim.quad, rim.side]
    number = (4 * rim.quad + rim.side).tolist()
    return {arm: Curve(*rim.outline_at(n, half, fillet), closed=False) for n, arm in enumerate(number)}


def _slot_chains(mesh: QuadMesh, joined: np.ndarray, onward: Mapping[int, int]) -> list[list[int]]:
    """Return the closed chains of slots, numbered 4 quad + corner, that the outlines follow.

    At a joined side (mask ``joined``) a chain continues with the neighbour's slot, at a cut with the next slot of the
    quad, and at the rim with the slot in ``onward``.
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
