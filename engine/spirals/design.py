"""The design: width and twist of the spiral in every quad (FlexMaps sections 5 and 7)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..arrays import Bool, Float, Int
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..progress import SILENT, Progress
from ..surface.checking.finding import Finding
from .caps import Cap, left_out_arms, make_caps, stump_starts
from .clearance import slots
from .clearance.clearance_model import ClearanceModel
from .contours import Outline, Tips, arm_starts, draw_outlines, fit_edges
from .curves.spiral import LEFT, RIGHT, Arms, edge_points, make_arms, opposite_sides
from .drawing_cache import DrawingCache
from .rim import Rim
from .roots import SlotRoots
from .solid_hubs import (
    mark_solid_hubs,
    slot_roots,
    solid_hub_findings,
    update_roots,
)

BATCH = 500  # number of spirals measured between two progress reports (0.1 s); larger batches delay a cancel


@dataclass(frozen=True, eq=False)
class SpiralDesign:
    """Widths and twists of one spiral per quad.

    flat : flat patches that the spirals lie in
    params : settings of the spirals: ranges of width and twist, sheet thickness, sense of rotation
    width : width of every arm, metres; column k is the arm that ends at side k
    twist : winding angle from the tip to the centre, radians
    feet : feet in place of some arms at the border, so that the piece can stand
    is_painted : whether the user changed spirals by hand; a search then starts from this design only
    cache : cache of drawings and measurements
    """

    flat: FlatPatches
    params: SpiralParams
    width: Float[np.ndarray, "quads 4"]
    twist: Float[np.ndarray, " quads"]
    feet: tuple[Cap, ...] = ()
    is_painted: bool = False
    cache: DrawingCache = field(default_factory=DrawingCache, init=False, repr=False)

    def changed_spirals(self, other: SpiralDesign) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the spirals that differ from another design of the same quads."""
        return (self.width != other.width).any(axis=1) | (self.twist != other.twist)

    def changed_arms(self, other: SpiralDesign) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the quads whose arms differ from another design's: changed spirals and their neighbours."""
        return (unlike := self.changed_spirals(other)) | unlike[opposite_sides(self.flat.layout.mesh)[0]].any(axis=1)

    def reuse_cache_of(self, other: SpiralDesign) -> SpiralDesign:
        """Copy the slot roots and fitted arcs of unchanged arms from another design's cache, and return this design."""
        if "roots" in other.__dict__:
            quads = np.flatnonzero(self.changed_arms(other))
            part = slot_roots(self.arms.subset(quads), self.params.fillet, self.has_solid_hub[quads])
            self.__dict__["roots"] = update_roots(other.roots, quads, part)
            self.cache.take_over(other.cache, quads, self.flat.layout.patch_of[quads])
        return self

    @cached_property
    def arms(self) -> Arms:
        """Shape parameters of every arm, including blends at the joints."""
        return make_arms(self.flat, self.params, self.width, self.twist)

    @cached_property
    def roots(self) -> SlotRoots:
        """Roots of all slots: the fillets at their inner ends."""
        return slot_roots(self.arms, self.params.fillet, self.has_solid_hub)

    @cached_property
    def has_solid_hub(self) -> Bool[np.ndarray, " quads"]:
        """Mask of the quads with a solid hub instead of a spiral."""
        return mark_solid_hubs(self.width, self.params)

    @cached_property
    def is_absent(self) -> Bool[np.ndarray, "quads 4"]:
        """Mask of the arms that are left out at the border or replaced by a foot."""
        mask = left_out_arms(self.flat.layout.mesh, self.params)
        mask.ravel()[[foot.arm for foot in self.feet]] = True
        return mask

    @cached_property
    def rim(self) -> Rim | None:
        """Rim along the open border; None if the settings ask for no rim."""
        return Rim.from_flat(self.flat, self.params)

    @cached_property
    def arm_starts(self) -> Float[np.ndarray, "quads 4"]:
        """Arm parameter t (0 at the joint, 1 at the centre) where every arm begins if there are no connectors."""
        plain = arm_starts(self.flat.layout, self.arms, slots.min_slot_width(self.params))
        return np.where(self.is_absent, stump_starts(self.roots), plain)

    @cached_property
    def caps(self) -> tuple[Cap, ...]:
        """Caps of the arms in ``is_absent``: round ends and feet."""
        bare = self.is_absent.copy()
        bare.ravel()[[foot.arm for foot in self.feet]] = False
        return (*make_caps(self.arms, self.arm_starts, bare, self.flat.layout.patch_of), *self.feet)

    def outlines(self, tolerance: float = 1e-5, tips: Tips | None = None, progress: Progress = SILENT) -> list[Outline]:
        """Return the outline of every panel, made of arcs; results without ``tips`` are cached.

        Parameters
        ----------
        tolerance : largest distance of the arcs from the exact edges, metres
        tips : ends of arms with connectors; default is plain ends
        progress : called with the fraction done; may cancel
        """
        if tips is None and tolerance in self.cache.by_tolerance:
            return self.cache.by_tolerance[tolerance][1]
        shapes, known = (
            (self.flat.layout, self.arms, self.roots, self.arm_starts),
            self.cache.cached_edges(tolerance, tips),
        )
        fitted = fit_edges(*shapes, tolerance, tips, progress.part(0.0, 0.7), *known)
        capped = {cap.arm: cap.end_curve for cap in self.caps}
        rim = None if self.rim is None else (self.rim, self.params.fillet)
        drawn = draw_outlines(*shapes, fitted, tips, progress.part(0.7, 1.0), capped, rim)
        if tips is None:
            self.cache.by_tolerance[tolerance] = fitted, drawn
        return drawn

    @cached_property
    def scale(self) -> Float[np.ndarray, " quads"]:
        """Diameter of every spiral, twice the mean distance from the centre to the joints, metres."""
        return 2.0 * self.arms.radius.mean(axis=1)

    @cached_property
    def area(self) -> Float[np.ndarray, " quads"]:
        """Area of every spiral's material, including its part of the rim but not fillets and feet, square metres."""
        share = np.linspace(0.0, 1.0, 33)
        begin = np.where(self.is_absent, self.arm_starts, 0.0)[..., None]
        inner = np.roll(self.roots.right, 1, axis=1)[..., None]
        right = edge_points(self.arms, begin + (inner - begin) * share[::-1], RIGHT)[0]
        left = edge_points(self.arms, begin + (self.roots.left[..., None] - begin) * share, LEFT)[0]
        round_about = np.concatenate([right, left], axis=2).reshape(len(self.width), -1, 2) - self.arms.centre[:, None]
        following = np.roll(round_about, -1, axis=1)
        area = 0.5 * (round_about[..., 0] * following[..., 1] - round_about[..., 1] * following[..., 0]).sum(axis=1)
        area = area + (self.is_absent * 0.125 * np.pi * self.width**2).sum(axis=1)
        rim = self.rim
        if rim is not None:
            neck = rim.depth * self.arms.joint_width[rim.quad, rim.side]
            area += np.bincount(rim.quad, weights=rim.area + neck, minlength=len(area))
        return area

    @cached_property
    def thin_quads(self) -> Int[np.ndarray, " n"]:
        """Quads that are too small for the smallest width, so that their arms are thinner than the settings allow."""
        return np.flatnonzero((self.width < self.params.width_min * (1.0 - 1e-6)).any(axis=1) & ~self.has_solid_hub)

    @property
    def findings(self) -> list[Finding]:
        """Warning about quads without a spiral, if any."""
        return solid_hub_findings(np.flatnonzero(self.has_solid_hub))

    @property
    def min_slot_and_bridge(self) -> tuple[float, float]:
        """Widths of the narrowest slot and of the narrowest piece of material, metres."""
        return self.measure_slot_and_bridge()

    def measure_slot_and_bridge(self, progress: Progress = SILENT) -> tuple[float, float]:
        """Return the widths of the narrowest slot and of the narrowest piece of material, metres (cached).

        Widths are measured between the edges of the arms of each quad, and slots also between arms of different quads.
        """
        if self.cache.min_slot_and_bridge is None:
            slot, bridge = np.inf, np.inf
            every, roots = np.arange(len(self.width)), self.roots
            for part in progress.batches(len(every), BATCH, "finding the narrowest places"):
                some = every[part]
                arms, ends = self.arms.subset(some), (roots.left[some], roots.right[some])
                own = slots.min_slot_and_bridge(arms, *ends, self.params.fillet, self.is_absent[some])
                slot, bridge = min(slot, own[0]), min(bridge, own[1])
            other = self._narrow_gaps(slot)[1]
            slot = min(slot, float(other.min(initial=np.inf)))
            self.cache.min_slot_and_bridge = slot, bridge
        return self.cache.min_slot_and_bridge

    def quads_with_narrow_slots(self, width: float) -> Int[np.ndarray, " n"]:
        """Return the quads beside whose arms a slot is narrower than ``width`` metres, at its root or elsewhere."""
        if 2.0 * self.params.fillet < width * (1.0 - 1e-9):
            return np.arange(len(self.width))
        apart, lean = slots.slot_widths(self.arms, self.roots.left, self.roots.right, np.linspace(0.0, 0.97, 32))[:2]
        faces = (lean > slots.PARALLEL_COSINE) & ~slots.is_beside_absent(self.is_absent)[..., None]
        least = np.where(faces, apart, slots.NO_NEIGHBOUR).min(axis=(1, 2))
        quads, gap = self._narrow_gaps(width)
        np.minimum.at(least, quads, gap[:, None])
        return np.flatnonzero(least < 0.999 * width)

    def _narrow_gaps(self, below: float) -> tuple[Int[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
        """Return the gaps below ``below`` metres between arms of different quads: both quads (k, 2), widths (k,)."""
        arms, gap = ClearanceModel.measure_gaps(self.flat, self.params, self.width, self.twist, below)
        cut = ~self.is_absent.ravel()[arms].any(axis=1)
        return arms[cut] // 4, gap[cut]
