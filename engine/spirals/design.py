"""The design: width and twist of the spiral in every quad (FlexMaps sections 5 and 7)."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..progress import SILENT, Progress
from ..surface.checking.finding import Finding
from .caps import Cap, left_out_arms, make_caps, stump_starts
from .clearance import slots
from .clearance.opening import open_gaps
from .clearance.room import ClearanceModel
from .constraints import NO_CONSTRAINTS, Constraints
from .contours import Outline, SlotRoots, Tips, arm_starts, draw_outlines, fit_edges
from .curves.spiral import LEFT, RIGHT, Arms, arms, edge_points, opposite_sides, same_width
from .drawing_cache import DrawingCache
from .rim import Rim
from .solid import (
    fewer_quads,
    no_spiral,
    refuse_many,
    set_solid,
    slot_roots,
    update_roots,
    without_room,
    without_spiral,
)
from .touching import nearest_quads
from .wider import enlarge_quads

__all__ = ["SpiralDesign", "design_from_curvature", "uniform_design"]

BATCH = 500  # spirals measured between two calls of progress: a tenth of a second
NO_ROOM = "There is no room for the arms of {} quads however thin and straight; make those quads more regular"


@dataclass(frozen=True, eq=False)
class SpiralDesign:
    """Widths and twists of one spiral per quad.

    flat : flat patches that the spirals lie in
    params : fabricable range, sheet thickness, chirality
    width : of every arm, metres; column k is the arm that ends at side k
    twist : winding angle from the tip to the centre, radians
    feet : feet in place of some arms at the border, so that the piece can stand
    painted : whether the user changed spirals by hand; a search then starts from this design only
    """

    flat: FlatPatches
    params: SpiralParams
    width: Float[np.ndarray, "quads 4"]
    twist: Float[np.ndarray, " quads"]
    feet: tuple[Cap, ...] = ()
    painted: bool = False
    drawn: DrawingCache = field(default_factory=DrawingCache, init=False, repr=False)

    def unlike(self, other: SpiralDesign) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the spirals that differ from another design of the same quads."""
        return (self.width != other.width).any(axis=1) | (self.twist != other.twist)

    def reshaped(self, other: SpiralDesign) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the quads with arms that differ from another design; arms blend into the arms at their joints."""
        return (unlike := self.unlike(other)) | unlike[opposite_sides(self.flat.layout.mesh)[0]].any(axis=1)

    def reusing(self, known: SpiralDesign) -> SpiralDesign:
        """Return this design after taking over the roots and arcs of those arms of another that are the same."""
        if "roots" in known.__dict__:
            quads = np.flatnonzero(self.reshaped(known))
            part = slot_roots(self.arms.subset(quads), self.params.fillet, self.solid[quads])
            self.__dict__["roots"] = update_roots(known.roots, quads, part)
            self.drawn.take_over(known.drawn, quads, self.flat.layout.patch_of[quads])
        return self

    @cached_property
    def arms(self) -> Arms:
        """The true shape of every arm."""
        return arms(self.flat, self.params, self.width, self.twist)

    @cached_property
    def roots(self) -> SlotRoots:
        """Roots of all slots."""
        return slot_roots(self.arms, self.params.fillet, self.solid)

    @cached_property
    def solid(self) -> Bool[np.ndarray, " quads"]:
        """Mask of the quads with a solid hub instead of a spiral."""
        return without_spiral(self.width, self.params)

    @cached_property
    def absent(self) -> Bool[np.ndarray, "quads 4"]:
        """Mask of the arms that are left out at the border or replaced by a foot."""
        mask = left_out_arms(self.flat.layout.mesh, self.params)
        mask.ravel()[[foot.arm for foot in self.feet]] = True
        return mask

    @cached_property
    def rim(self) -> Rim | None:
        """The strip along the open border, if there is one."""
        return Rim.from_flat(self.flat, self.params)

    @cached_property
    def begin(self) -> Float[np.ndarray, "quads 4"]:
        """Place t on every arm where it begins, from 0 at the joint to 1 at the centre; without connectors."""
        plain = arm_starts(self.flat.layout, self.arms, slots.min_slot_width(self.params))
        return np.where(self.absent, stump_starts(self.roots), plain)

    @cached_property
    def caps(self) -> tuple[Cap, ...]:
        """Ends of the ``absent`` arms: round ends and feet."""
        bare = self.absent.copy()
        bare.ravel()[[foot.arm for foot in self.feet]] = False
        return (*make_caps(self.arms, self.begin, bare, self.flat.layout.patch_of), *self.feet)

    def outlines(self, tolerance: float = 1e-5, tips: Tips | None = None, progress: Progress = SILENT) -> list[Outline]:
        """Draw the outline of every panel as arcs within ``tolerance`` metres; results without ``tips`` are cached."""
        if tips is None and tolerance in self.drawn.plain:
            return self.drawn.plain[tolerance][1]
        shapes, known = (self.flat.layout, self.arms, self.roots, self.begin), self.drawn.known(tolerance, tips)
        fitted = fit_edges(*shapes, tolerance, tips, progress.part(0.0, 0.7), *known)
        capped = {cap.arm: cap.across for cap in self.caps}
        rim = None if self.rim is None else (self.rim, self.params.fillet)
        drawn = draw_outlines(*shapes, fitted, tips, progress.part(0.7, 1.0), capped, rim)
        if tips is None:
            self.drawn.plain[tolerance] = fitted, drawn
        return drawn

    @cached_property
    def scale(self) -> Float[np.ndarray, " quads"]:
        """Diameter of every spiral, twice the mean distance from the centre to the joints, metres."""
        return 2.0 * self.arms.radius.mean(axis=1)

    @cached_property
    def area(self) -> Float[np.ndarray, " quads"]:
        """Area of every spiral's material with its part of the rim, but without fillets and feet, square metres."""
        share = np.linspace(0.0, 1.0, 33)
        begin = np.where(self.absent, self.begin, 0.0)[..., None]
        inner = np.roll(self.roots.right, 1, axis=1)[..., None]
        right = edge_points(self.arms, begin + (inner - begin) * share[::-1], RIGHT)[0]
        left = edge_points(self.arms, begin + (self.roots.left[..., None] - begin) * share, LEFT)[0]
        round_about = np.concatenate([right, left], axis=2).reshape(len(self.width), -1, 2) - self.arms.centre[:, None]
        following = np.roll(round_about, -1, axis=1)
        area = 0.5 * (round_about[..., 0] * following[..., 1] - round_about[..., 1] * following[..., 0]).sum(axis=1)
        area = area + (self.absent * 0.125 * np.pi * self.width**2).sum(axis=1)
        rim = self.rim
        if rim is not None:
            neck = rim.depth * self.arms.joint_width[rim.quad, rim.side]
            area += np.bincount(rim.quad, weights=rim.area + neck, minlength=len(area))
        return area

    @cached_property
    def thin(self) -> Int[np.ndarray, " n"]:
        """Quads too small for the smallest width, whose arms are thinner than the settings allow."""
        return np.flatnonzero((self.width < self.params.width_min * (1.0 - 1e-6)).any(axis=1) & ~self.solid)

    @property
    def findings(self) -> list[Finding]:
        """Warning about quads without a spiral, if any."""
        return no_spiral(np.flatnonzero(self.solid))

    @property
    def narrowest(self) -> tuple[float, float]:
        """Widths of the narrowest slot and of the narrowest piece of material, metres."""
        return self.measured()

    def measured(self, progress: Progress = SILENT) -> tuple[float, float]:
        """Measure ``min_slot_and_bridge`` between the true edges of the arms, at the first call only."""
        if self.drawn.narrowest is None:
            slot, bridge = np.inf, np.inf
            every, roots = np.arange(len(self.width)), self.roots
            for part in progress.batches(len(every), BATCH, "the narrowest places"):
                some = every[part]
                arms, ends = self.arms.subset(some), (roots.left[some], roots.right[some])
                own = slots.min_slot_and_bridge(arms, *ends, self.params.fillet, self.absent[some])
                slot, bridge = min(slot, own[0]), min(bridge, own[1])
            other = self._gaps(slot)[1]
            slot = min(slot, float(other.min(initial=np.inf)))
            self.drawn.narrowest = slot, bridge
        return self.drawn.narrowest

    def narrower(self, width: float) -> Int[np.ndarray, " n"]:
        """Return the quads with a slot narrower than ``width`` metres beside their arms, at the root or elsewhere."""
        if 2.0 * self.params.fillet < width * (1.0 - 1e-9):
            return np.arange(len(self.width))
        apart, lean = slots.slot_widths(self.arms, self.roots.left, self.roots.right, np.linspace(0.0, 0.97, 32))[:2]
        faces = (lean > slots.PARALLEL_COSINE) & ~slots.beside_absent(self.absent)[..., None]
        least = np.where(faces, apart, slots.NO_NEIGHBOUR).min(axis=(1, 2))
        quads, gap = self._gaps(width)
        np.minimum.at(least, quads, gap[:, None])
        return np.flatnonzero(least < 0.999 * width)

    def _gaps(self, below: float) -> tuple[Int[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
        """Return both quads and the width of all gaps below ``below`` between arms of different quads, metres."""
        arms, gap = ClearanceModel.gaps(self.flat, self.params, self.width, self.twist, below)
        cut = ~self.absent.ravel()[arms].any(axis=1)
        return arms[cut] // 4, gap[cut]


def uniform_design(
    flat: FlatPatches, params: SpiralParams, *, width: float | None = None, twist: float | None = None
) -> SpiralDesign:
    """Make a design of equal spirals; where a quad lacks room, arms become thinner and twists smaller.

    width : metres; default is the middle of the allowed range
    twist : radians; default is half of the largest
    Raises ``FlexMapsError`` with the faces that are far too small for the smallest width.
    """
    width = 0.5 * (params.width_min + params.width_max) if width is None else width
    twist = 0.5 * params.twist_max if twist is None else twist
    count = len(flat.corners)
    return make_fabricable(flat, params, np.full((count, 4), float(width)), np.full(count, float(twist)))


def design_from_curvature(
    flat: FlatPatches,
    params: SpiralParams,
    curvature: Float[np.ndarray, " quads"],
    progress: Progress = SILENT,
) -> SpiralDesign:
    """Make the curvature-adjusted start (FlexMaps section 7): higher curvature gives thinner arms and more twist.

    curvature : RMS curvature, 1/m
    Raises ``FlexMapsError`` with the faces that are far too small for the smallest width.
    """
    return design_from_spirals(flat, params, *curvature_adjusted(params, curvature), progress)


def design_from_spirals(
    flat: FlatPatches,
    params: SpiralParams,
    width: Float[np.ndarray, "quads 4"],
    twist: Float[np.ndarray, " quads"],
    progress: Progress = SILENT,
    *,
    constraints: Constraints = NO_CONSTRAINTS,
) -> SpiralDesign:
    """Make a start near given widths (metres) and twists (radians) that can be cut and meets the constraints.

    If quads have no room, move the flat points near them; the design then has its own flat patches.
    Raises ``FlexMapsError`` with the faces that are far too small for the smallest width.
    """
    width, twist, straight = width.copy(), twist.copy(), constraints.straight
    twist[straight] = 0.0
    mesh = flat.layout.mesh
    width[straight] = np.where(mesh.border[mesh.quad_edges[straight]], params.width_max, width[straight])
    width[constraints.wide] = params.width_max
    result: SpiralDesign | FlexMapsError
    try:
        result = make_fabricable(flat, params, width, twist, progress=progress.part(0.0, 0.5))
    except FlexMapsError as error:
        result = error
    tight = np.array(result.faces) if isinstance(result, FlexMapsError) else np.flatnonzero(result.solid)
    if len(tight):
        moved = enlarge_quads(flat, tight, progress.part(0.5, 0.6))
        with suppress(FlexMapsError):  # the error about the original patches is more helpful
            retry = make_fabricable(moved, params, width, twist, progress=progress.part(0.6, 1.0))
            result = retry if retry.solid.sum() < len(tight) else result
    if isinstance(result, SpiralDesign):
        return result
    raise result


def curvature_adjusted(
    params: SpiralParams, curvature: Float[np.ndarray, " quads"]
) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
    """Return widths (metres) and twists (radians) for an RMS curvature C (1/m), without checks whether they can be cut.

    Both are linear in c = C / C_max. C_max is the percentile ``params.curvature_top`` of the curvature, where the publication
    takes the maximum (100): a single sharp crease would leave c near 0 on the rest of the surface.
    """
    curvature = np.asarray(curvature, dtype=float)
    top = float(np.percentile(curvature, params.curvature_top))
    c = np.clip(curvature / top, 0.0, 1.0) if top > 0.0 else np.zeros_like(curvature)
    width = params.width_max - c * (params.width_max - params.width_min)
    return same_width(width), params.twist_min + c * (params.twist_max - params.twist_min)


def make_fabricable(
    flat: FlatPatches,
    params: SpiralParams,
    width: Float[np.ndarray, "quads 4"],
    twist: Float[np.ndarray, " quads"],
    *,
    prove: bool = True,
    free: Bool[np.ndarray, " quads"] | None = None,
    progress: Progress = SILENT,
) -> SpiralDesign:
    """Make a design near given widths and twists that can be cut, joints and neighbours included.

    Parameters
    ----------
    flat, params : flat patches, and settings of the spirals
    width, twist : metres, radians
    prove : draw the finished outlines and repair the few places that still touch
    free : spirals that may change; default is all
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError with the faces that are far too small for the smallest width.
    """
    free = np.ones(len(twist), dtype=bool) if free is None else free
    low, high = slots.width_range(flat, params)
    small = without_room(flat, params)
    refuse_many(np.flatnonzero(small & free), len(twist), slots.too_small(flat, params, np.flatnonzero(small)))
    if prove:  # quads with solid hubs may have room in these flat patches
        width = np.where((free & ~small & without_spiral(width, params))[:, None], low[:, None], width)
    most = np.where(free, high, np.inf)
    width, room = np.minimum(width, most[:, None]), ClearanceModel.from_flat(flat, params)
    twist = np.where(free, np.minimum(twist, params.twist_max), twist)
    width, twist = set_solid(params, width, twist, (small | without_spiral(width, params)) & free)
    shut = room.closed(width, twist) & free
    if shut.any():  # a good first guess for spirals with far too much twist
        twist = np.where(shut, slots.twist_bound(flat, params, width, progress.part(0.0, 0.2), twist), twist)
    spirals = open_gaps(room, low, width, twist, free & ~without_spiral(width, params), progress.part(0.2, 0.6))
    design = SpiralDesign(flat, params, *spirals)
    return resolve_contacts(design, progress.part(0.6, 1.0), free=free) if prove else design


def unfabricable_quads(design: SpiralDesign, quads: Bool[np.ndarray, " quads"] | None = None) -> Int[np.ndarray, " n"]:
    """Return the quads whose spiral cannot be cut: not finite, too thin, too wide, or with too much twist.

    quads : check only the slots beside these quads; default is all
    """
    low, high = slots.width_range(design.flat, design.params)
    finite = np.isfinite(design.width).all(axis=1) & np.isfinite(design.twist)
    width, twist = np.where(finite[:, None], design.width, low[:, None]), np.where(finite, design.twist, 0.0)
    slack = 1e-3  # for rounding, and for limits from iterations
    least, most = (1.0 - slack) * np.minimum(low, slots.MIN_WIDTH_SHARE * design.params.width_min), (1.0 + slack) * high
    fits = (width.min(axis=1) >= least) & (width.max(axis=1) <= most)
    fits &= (twist >= -slack) & (twist <= (1.0 + slack) * design.params.twist_max)
    # arms without room for connectors can be glued, and spirals outside the model's range can be cut
    room = ClearanceModel.from_flat(design.flat, replace(design.params, slot_seam=0.0)).by_gaps
    spirals = np.clip(width, 0.1 * low[:, None], high[:, None]), np.clip(twist, 0.0, None)
    terms = room.terms(*spirals, below=-slack, quads=quads)
    fits[terms.arms[:, [0, 2]] // 4] = False
    fits |= without_spiral(width, design.params) & (twist <= slack)
    return np.flatnonzero(~(finite & fits))


def resolve_contacts(
    design: SpiralDesign, progress: Progress = SILENT, rounds: int = 60, free: Bool[np.ndarray, " quads"] | None = None
) -> SpiralDesign:
    """Draw the outlines, and unwind the spirals around every place where outlines still touch; most designs have none.

    rounds : most repetitions
    free : spirals that may change; default is all
    Raises ``FlexMapsError`` with the faces where even straight and thin arms touch.
    """
    mate = opposite_sides(design.flat.layout.mesh)[0]
    thinnest = slots.MIN_WIDTH_SHARE * design.params.width_min
    free = np.ones(len(design.twist), dtype=bool) if free is None else free
    start, culprits = design, np.empty(0, dtype=np.int64)
    for turn in range(rounds):
        part = progress.part(turn / rounds, (turn + 1) / rounds)
        culprits, where = _culprits(design, part)
        if not len(culprits):
            return design
        # unwind first, neighbours too, because they determine the joints' direction; then thin the arms
        beside = np.union1d(culprits, mate[culprits])
        still = (design.twist == 0.0) | ~free
        straight = culprits[still[culprits] & still[mate[culprits]].all(axis=1) & (free & ~design.solid)[culprits]]
        beside = beside[free[beside]]
        twist, width = design.twist.copy(), design.width.copy()
        twist[beside] = np.where(twist[beside] < 0.3, 0.0, 0.75 * twist[beside])
        width[straight] = np.maximum(0.85 * width[straight], thinnest)
        if (twist == design.twist).all() and (width == design.width).all():
            # nothing can be unwound any further: the quad nearest to each place gets a solid hub
            worst = culprits if where is None else nearest_quads(design.flat, where, 1)
            given_up = np.zeros(len(twist), dtype=bool)
            given_up[worst] = True
            given_up &= free & ~design.solid
            if not given_up.any():
                break
            culprits = np.flatnonzero(given_up | design.solid)
            refuse_many(culprits, len(twist), NO_ROOM.format(len(culprits)))
            # restore the spirals that were unwound for these quads
            begun = set_solid(design.params, start.width, start.twist, given_up | design.solid)
            restored = make_fabricable(design.flat, design.params, *begun, prove=False, free=free, progress=part)
            width, twist = restored.width, restored.twist
        design = replace(design, twist=twist, width=width).reusing(design)
    raise FlexMapsError(NO_ROOM.format(len(culprits)), faces=culprits, quads=fewer_quads(len(design.twist)))


def _culprits(design: SpiralDesign, progress: Progress) -> tuple[Int[np.ndarray, " n"], np.ndarray | None]:
    """Return the quads whose slots have no root, else the quads where outlines touch and the places (as ``find_contacts``)."""
    progress(0.0, "roots of the slots")
    culprits = np.flatnonzero(design.roots.missed.any(axis=1))
    if len(culprits):
        return culprits, None
    where = design.drawn.contacts(design.outlines(progress=progress.part(0.0, 0.8)), progress.part(0.8, 1.0))
    return (nearest_quads(design.flat, where) if len(where) else culprits), where
