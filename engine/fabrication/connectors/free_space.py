"""Positions of connectors: the joints at all cuts, and the free space around every joint.

Free space is measured with polygons. A tip must keep the width of the smallest slot as distance from every other arm
and hub, both in its own flat panel and in the panel across the joint once the two are joined. Where arms run close
beside a joint, as in strongly wound spirals, there is more room a little farther along the arm and to one side; the
parting line, where the two arms meet, is moved there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from ...arrays import Bool, Float, Int
from ...params import ConnectorParams
from ...progress import SILENT, Progress
from ...spirals.clearance.slots import min_slot_width
from ...spirals.contours import Tips
from ...spirals.curves.spiral import LEFT, RIGHT, edge_points
from ...spirals.design import SpiralDesign
from .joined_arms import JoinedArms, JointArms, to_complex, to_points
from .obstacles import Obstacles
from .shape import ConnectorSize, connector_sizes, tab_sizes
from .tips import ConnectorCandidate, Tip, end_curves, make_tips

# kinds of connectors to try, in this order, by the requested kind
KINDS = {"dovetail": ("dovetail", "key", "tab"), "key": ("key", "tab"), "tab": ("tab",)}
# sizes to try, in this order, as shares of the requested size; finer steps find larger connectors and take longer
SCALES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
WIDTH_STEP = 1e-5  # metres; arm widths are rounded down to multiples of it; larger: fewer shapes to compute, less exact
# distances in metres to try, in this order, between the parting line and the ends of both arms of a key or tab
SETBACKS = (0.0, 3e-4, 6e-4, 1e-3, 1.5e-3)
_SHIFTS = 12  # number of shifts of the parting line tried in either direction along the arms; more take longer
# distance between consecutive shifts of the parting line, in neck widths of the smallest connector; larger steps miss
# more places
_STEP = 0.55
# number of shifts with enough free space that are tried per size, as long as the neck must lie on the arm; all are
# tried where it may overhang. More take longer
_SHIFTS_TRIED = 4
# free space is measured along rays from the edges of the arms; distance between adjacent rays along the arm, metres;
# smaller is more exact and slower
_RAY_STEP = 2e-4
_BUNDLE = 8  # number of adjacent rays that share one search for nearby pieces of arms; more find too many pieces
_PIECES = 8  # pieces into which an arm is split; more make tighter bounding boxes and a larger search tree
_QUADS_AT_ONCE = 500  # quads whose arms are sampled together; more take more memory


@dataclass(frozen=True, eq=False)
class CutJoints:
    """All joints at cuts, in the order of the seams and along each seam.

    edge : index of the mesh edge
    seam, place : index of the seam, and of the joint along the seam
    quad, side : quad and side of each of the joint's two arms; the arm of the patch with the lower index comes first
    is_within_panel : whether both arms belong to the same panel
    """

    edge: Int[np.ndarray, " joints"]
    seam: Int[np.ndarray, " joints"]
    place: Int[np.ndarray, " joints"]
    quad: Int[np.ndarray, "joints 2"]
    side: Int[np.ndarray, "joints 2"]
    is_within_panel: Bool[np.ndarray, " joints"]


def joints_at_cuts(design: SpiralDesign) -> CutJoints:
    """Return all joints of a design that lie at cuts."""
    layout = design.flat.layout
    none = [np.empty(0, dtype=np.int64)]
    edges = np.concatenate([*layout.seams, *none])
    seam = np.repeat(np.arange(len(layout.seams)), [len(s) for s in layout.seams])
    place = np.concatenate([*(np.arange(len(s)) for s in layout.seams), *none])
    quad, side = layout.mesh.edge_quads[edges], layout.mesh.edge_sides[edges]
    patch = layout.patch_of[quad]
    swap = patch[:, 0] > patch[:, 1]
    quad[swap], side[swap] = quad[swap][:, ::-1], side[swap][:, ::-1]
    return CutJoints(edges, seam, place, quad, side, patch[:, 0] == patch[:, 1])


@dataclass(frozen=True, eq=False)
class FreeWidths:
    """Free space on both sides of the two arms of a joint, at places along them.

    x : metres along the arms from the joint, positive on the second arm
    left, right : metres by which the left and the right edge of the arm could move outwards at each place
    width : width of the arm at each place, metres
    """

    x: Float[np.ndarray, " places"]
    left: Float[np.ndarray, " places"]
    right: Float[np.ndarray, " places"]
    width: Float[np.ndarray, " places"]

    def fitting_positions(
        self, s: ConnectorSize, shifts: Float[np.ndarray, " shifts"], may_overhang: bool
    ) -> list[tuple[float, float]]:
        """Return the positions at which a connector of size ``s`` has room, as pairs (shift, lateral offset) in metres.

        The shift along the arm is one of ``shifts`` (metres); the lateral offset is to the left of the arm's centre
        line. The neck stays on the arm unless ``may_overhang``; then it may lie beside the arm, on the arm's widened
        end.
        """
        reach = s.length + s.clearance + 0.4 * s.wall
        shifts = shifts[(shifts - reach >= self.x[0]) & (shifts + reach <= self.x[-1])]
        if not len(shifts):
            return []
        first, last = np.searchsorted(self.x, [shifts - reach, shifts + reach])
        extra = np.maximum(s.pad_width - self.width[(first + last) // 2], 0.0)
        window = first[:, None] + np.arange(int((last - first).max()))
        outside, window = window >= last[:, None], np.minimum(window, len(self.x) - 1)
        left, right = (np.where(outside, np.inf, e[window]).min(axis=1) for e in (self.left, self.right))
        low, high = 0.5 * extra - right, left - 0.5 * extra
        best = np.clip(0.0, low, np.maximum(low, high))
        most = 0.5 * extra if may_overhang else np.minimum(0.5 * self.width[(first + last) // 2], 0.5 * extra)
        fits = (low <= high) & (np.abs(best) <= most + 1e-9)
        return list(zip(shifts[fits].tolist(), best[fits].tolist(), strict=True))


class FreeSpace:
    """Finder of room for connectors: the joints of a design and everything near them that tips must avoid."""

    def __init__(self, design: SpiralDesign, params: ConnectorParams, mill: float = 0.0, progress: Progress = SILENT):
        self.design, self.params, self.mill = design, params, mill
        self.joints = joints_at_cuts(design)
        self.slot = min_slot_width(design.params)
        # round the widths, more finely than any cutter can cut, so that many joints share few cached shapes
        width = design.arms.joint_width[self.joints.quad[:, 0], self.joints.side[:, 0]]
        self.width = np.floor(width / WIDTH_STEP + 1e-6) * WIDTH_STEP
        self._free_widths: dict[int, FreeWidths] = {}
        self.obstacles = self._make_obstacles(progress)

    @cached_property
    def joined_arms(self) -> JoinedArms:
        """Both arms of every joint; ``own`` is the arm that comes first in ``joints``."""
        quad, side = self.joints.quad, self.joints.side
        return JoinedArms(*(JointArms.from_arms(self.design, quad[:, k], side[:, k]) for k in range(2)))

    def connector_sizes(self, joint: int, kind: str = "dovetail") -> tuple[ConnectorSize, ...]:
        """Return the sizes that connectors of kind ``kind`` at joint ``joint`` may have, largest first."""
        width = float(self.width[joint])
        if kind == "tab":
            return tab_sizes(width, self.params, SCALES, self.mill)
        return connector_sizes(width, self.params, SCALES, self.mill)

    def candidates(self, joint: int) -> Iterator[ConnectorCandidate]:
        """Yield candidate connectors for a joint, best first.

        They are ordered by kind, by setback, by size with the largest first, and by whether the neck overhangs its arm.
        """
        # heads and sockets alternate along a seam, so that panels joined with an offset of one joint do not fit
        first = int(self.joints.place[joint]) % 2
        # try keys at cuts inside a panel even if dovetails are requested: both sides of such a cut may lie so close
        # together that a dovetail's head, which protrudes from its arm, has no room in the flat panel
        inside = bool(self.joints.is_within_panel[joint])
        kinds = [k for k in KINDS[self.params.connector] if k in (self.params.connector, "tab") or inside]
        # at a cut inside a panel, a head longer than the flat distance between the two arms would overlap its own
        # socket
        gap = abs(self.joined_arms.own.origin[joint] - self.joined_arms.other.origin[joint]) if inside else np.inf
        best = ConnectorCandidate(self.params.connector, self.connector_sizes(joint, self.params.connector)[0], first)
        if best.kind != "dovetail" or best.size.length <= gap:
            yield best  # usually fits; measuring the free space before would be wasted
        self.measure_free_widths([joint])
        openings, steps = self._free_widths[joint], np.array(self._shifts(joint))
        for kind in kinds:
            for back in (0.0,) if kind == "dovetail" else SETBACKS:
                for s, overhanging in product(self.connector_sizes(joint, kind), (False, True)):
                    if kind == "dovetail" and s.length > gap:
                        continue
                    fitting = openings.fitting_positions(s, steps, overhanging)
                    for shift, aside in fitting if overhanging else fitting[:_SHIFTS_TRIED]:
                        for male in (first, 1 - first) if kind == "dovetail" else (first,):
                            yield ConnectorCandidate(kind, s, male, shift, aside, back)

    def _shifts(self, joint: int) -> list[float]:
        """Return the shifts of the parting line to try, in metres to either side of the joint, the nearest first."""
        step = self.connector_sizes(joint)[-1].neck * _STEP
        return [step * n for n in sorted(range(-_SHIFTS, _SHIFTS + 1), key=lambda n: (abs(n), n))]

    def fit_tips(
        self, joints: Sequence[int], candidates: Sequence[ConnectorCandidate]
    ) -> list[tuple[tuple[Tip, Tip], np.ndarray] | None]:
        """Return for every candidate its two tips and their polygons (2, 2); None where they have no room.

        Both tips must keep the width of the smallest slot from everything near, in their own panels and, once joined,
        in the panels across. The second tip is made only where the first has room. Row 0 of the polygons lies in the
        tips' own panels, row 1 in the panels across, see ``_place_in_common_plane``; there is one column for each tip.

        Parameters
        ----------
        joints : index of the joint of every candidate
        candidates : candidate connectors
        """
        rows, left = np.array(joints, dtype=int), np.arange(len(joints))
        shift, aside = (np.array([getattr(a, n) for a in candidates]) for n in ("shift", "lateral_offset"))
        roles = [a.roles() for a in candidates]
        tips, placed = np.empty((len(rows), 2), dtype=object), np.empty((2, len(rows), 2), dtype=object)
        for half, (through, sign) in enumerate(((self.joined_arms, 1.0), (self.joined_arms.from_other_side, -1.0))):
            if not len(left):
                break
            role, tried = ([x[k] for k in left.tolist()] for x in ([r[half] for r in roles], candidates))
            made = make_tips(through, rows[left], role, tried, sign * shift[left], sign * aside[left])
            left = left[[tip is not None for tip in made]]
            tips[left, half] = [tip for tip in made if tip is not None]
            placed[:, left, half] = self._place_in_common_plane(through, tips[left, half])
            for shapes in placed[:, :, half]:  # tips that are blocked in their own panel are not tested further
                left = left[self._keep_clear(through, rows[left], shapes[left])]
        left = left[
            [not self.joints.is_within_panel[rows[k]] or not self._are_too_close(*tips[k]) for k in left.tolist()]
        ]
        found: list[tuple[tuple[Tip, Tip], np.ndarray] | None] = [None] * len(rows)
        for k in left.tolist():
            found[k] = (tips[k, 0], tips[k, 1]), placed[:, k]
        return found

    # -- obstacles near the joints -------------------------------------------------------------------------------------

    def _make_obstacles(self, progress: Progress) -> Obstacles:
        """Return all hubs, and all arms split into pieces, in a common plane where panels do not overlap."""
        patch_of, found = self.design.flat.layout.patch_of, []
        for part in progress.batches(len(patch_of), _QUADS_AT_ONCE, "looking for what is near the joints"):
            found.append(self._pieces(np.arange(part.start, part.stop)))
        rings, arm, quad = (np.concatenate(x) for x in zip(*found, strict=True))
        return Obstacles(rings + self.patch_spacing * patch_of[quad][:, None], arm)

    def _pieces(self, quads: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the pieces of the arms of some quads, and the hubs, each as a closed ring of K points.

        Returns
        -------
        rings : (P, K) complex points in the patches' frames, metres
        arm : (P,) arm to which each ring belongs, 4 quad + side; -1 for hubs
        quad : (P,) quad to which each ring belongs
        """
        arms, roots, count = self.design.arms.subset(quads), self.design.roots, len(quads)
        t_left, t_right = roots.left[quads], np.roll(roots.right[quads], 1, axis=1)
        even = np.linspace(0.0, 1.0, 10 * _PIECES + 1)
        begin = np.where(self.design.is_absent, self.design.arm_starts, 0.0)[quads][..., None]
        ends = ((LEFT, t_left), (RIGHT, t_right))
        drawn = [edge_points(arms, begin + even * (t[..., None] - begin), way)[0] for way, t in ends]
        left, right = (to_complex(d).reshape(4 * count, -1) for d in drawn)
        pieces = [
            np.concatenate([left[:, k : k + 11], right[:, k : k + 11][:, ::-1]], axis=1)
            for k in range(0, 10 * _PIECES, 10)
        ]
        hub = np.stack([right[:, -1], left[:, -1]], axis=1).reshape(count, 8)
        hub = np.concatenate([hub, np.repeat(hub[:, -1:], pieces[0].shape[1] - 8, axis=1)], axis=1)
        own = (4 * quads[:, None] + np.arange(4)).ravel()
        arm = np.concatenate([np.tile(own, _PIECES), np.full(count, -1)])
        return np.concatenate([*pieces, hub]), arm, np.concatenate([np.tile(own // 4, _PIECES), quads])

    @cached_property
    def patch_spacing(self) -> float:
        """Distance in metres, along x, between the origins of consecutive patches in the common plane.

        It is so large that patches do not overlap.
        """
        return 2.0 * float(np.ptp(self.design.flat.corners.reshape(-1, 2), axis=0).max())

    def _place_in_common_plane(self, joined_arms: JoinedArms, tips: np.ndarray) -> np.ndarray:
        """Return the polygons (2, n) of ``tips`` (n,) in the common plane where panels do not overlap.

        Row 0 lies in the tips' own panels, row 1 in the panels across, where the tips are once the joints are
        assembled. The tips are those of the arms ``joined_arms.own``.
        """
        import shapely

        polygons = np.array([tip.polygon for tip in tips])
        points, owner = shapely.get_coordinates(polygons, return_index=True)
        rows = np.array([tip.row for tip in tips], dtype=int)[owner]
        own, other = joined_arms.own, joined_arms.other
        there = to_complex(points)
        local = (there - own.origin[rows]) / own.outwards[rows]
        mated = other.origin[rows] - other.outwards[rows] * local
        placed = there + self.patch_spacing * own.patch[rows], mated + self.patch_spacing * other.patch[rows]
        return np.stack([shapely.set_coordinates(polygons.copy(), to_points(p)) for p in placed])

    def measure_free_widths(self, joints: Sequence[int]) -> None:
        """Measure and store the free space on both sides of the arms of these joints, given by index."""
        rows = np.array([j for j in joints if j not in self._free_widths], dtype=int)
        if not len(rows):
            return
        through = self.joined_arms.subset(rows)
        reach = np.array([max(self._shifts(j)) + 2.0 * self.connector_sizes(j)[0].length for j in rows.tolist()])
        back, ahead = (np.minimum(reach, half.arc_lengths(half.t_max)) for half in (through.own, through.other))
        steps = int(np.ceil(reach.max() / _RAY_STEP))
        x = _RAY_STEP * (np.arange(-(-(2 * steps + 1) // _BUNDLE) * _BUNDLE) - steps)
        there = (x >= -back[:, None]) & (x <= ahead[:, None])
        edges, directions = through.edge_points(through.tau_at(np.repeat(-x[None], len(rows), axis=0)))
        directions = directions * (1j * np.array([LEFT, RIGHT]))[:, None, None]
        # measure as far as the edge of the widest tip could lie from the arm, plus the width of a slot
        view = 1.02 * self.slot + np.array([self.connector_sizes(j)[0].pad_width for j in rows.tolist()])
        view = np.repeat(np.tile(view, 2), len(x) // _BUNDLE)
        free = np.full(edges.shape, np.inf)
        own = np.stack([through.own.arm, through.other.arm], axis=1)
        own = np.repeat(np.tile(own, (2, 1)), len(x) // _BUNDLE, axis=0)
        for half, sign in ((through.own, 1.0), (through.other, -1.0)):
            out = sign * half.outwards[:, None]
            origin = half.origin[:, None] + out * edges + self.patch_spacing * half.patch[:, None]
            seen = self.obstacles.cast_rays(
                origin.reshape(-1, _BUNDLE), (out * directions).reshape(-1, _BUNDLE), view, own
            )
            free = np.minimum(free, np.maximum(seen.reshape(free.shape) - 1.02 * self.slot, 0.0))
        width = np.abs(edges[0] - edges[1])
        for k, joint in enumerate(rows.tolist()):
            at = there[k]
            self._free_widths[joint] = FreeWidths(x[at], free[0, k, at], free[1, k, at], width[k, at])

    def _keep_clear(self, joined_arms: JoinedArms, rows: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        """Return a mask (n,) of the polygons ``shapes`` that keep a slot's width from all other arms and from all hubs.

        joined_arms, rows : polygon k belongs to the joint in row ``rows[k]`` of ``joined_arms``, both arms of which are
            ignored
        """
        own = np.stack([joined_arms.own.arm[rows], joined_arms.other.arm[rows]], axis=1)
        return ~self.obstacles.are_near(shapes, own, 0.999 * self.slot)

    def _are_too_close(self, one: Tip, two: Tip) -> bool:
        """Return whether two tips of one panel come closer than a slot's width to each other or each other's arms."""
        import shapely

        near = ((one.polygon, two.arm_without_tip), (two.polygon, one.arm_without_tip), (one.polygon, two.polygon))
        return any(bool(shapely.dwithin(a, b, 0.999 * self.slot)) for a, b in near)

    def tips_as_arcs(self, tips: list[Tip], plain: np.ndarray, tolerance: float) -> Tips:
        """Return the ends of all arms, for drawing the outlines: ``tips``, and plain ends on arms without a connector.

        Parameters
        ----------
        tips : tips with connectors
        plain : (F, 4) value of t at which an arm without a connector begins
        tolerance : largest distance in metres between the tips and the arcs that represent them
        """
        blank = np.zeros(plain.shape)
        made = Tips(np.zeros((2, *plain.shape)), blank, blank + 1e-3, plain.copy(), {})
        for tip, end in zip(tips, end_curves(tips, tolerance), strict=True):
            at, wide = divmod(tip.arm, 4), tip.widening
            made.edge_offset[:, at[0], at[1]] = wide.left[0], wide.right[0]
            made.taper_start[at], made.taper_end[at] = wide.taper_start[0], wide.taper_end[0]
            made.begin[at] = max(tip.begin, 0.0)
            made.end_curves[tip.arm] = end
        return made
