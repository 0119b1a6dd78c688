"""Where connectors sit, and whether there is room for them: the joints at all cuts, and what is near every joint.

FreeSpace is judged with polygons. A tip must keep the smallest slot from every other arm and hub of its own flat panel, and
from those of the panel on the other side once both lie side by side. Where the arms beside a joint are near, as in
strongly wound spirals, there is more room a little way along the arm and to one side: the parting line moves there.
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
from ...spirals.contours import Tips
from ...spirals.design import SpiralDesign
from ...spirals.slots import slot_needed
from ...spirals.spiral import LEFT, RIGHT, edge
from .path import Halves, Throughs, complexes, pairs
from .shape import Size, sizes, tabs
from .tips import Attempt, Tip, ends_of, make_tips

# what is tried where the asked kind has no room
KINDS = {"dovetail": ("dovetail", "key", "tab"), "key": ("key", "tab"), "tab": ("tab",)}
SCALES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)  # sizes that are tried in turn, as shares of the asked one; not measured
STEP = 1e-5  # metres; the widths of arms are taken in these steps
BACKS = (0.0, 3e-4, 6e-4, 1e-3, 1.5e-3)  # metres that the faces of keys and tabs may stand back
_SHIFTS = 12  # steps to either side
_STEP = 0.55  # of a shift, in necks
_TRIES = 4  # shifts that are tried for every size before necks may lie beside their arms
_LOOK = 2e-4  # metres along the arm from one look to the next
_BUNDLE = 8  # lines of sight beside each other for which what is near is looked up once
_RAYS = 2500  # bundles that are followed together
_PIECES = 8  # parts of every arm, so that few lie near a place
_TOGETHER = 500  # quads whose arms are drawn together


@dataclass(frozen=True, eq=False)
class Joints:
    """All places where two arms meet across a cut, seam by seam along the seams.

    edge, seam, place : the edge of the mesh, its seam, and its place along that
    quad, side : both arms; the panel with the lower number first; inside : whether both arms belong to one panel
    """

    edge: Int[np.ndarray, " joints"]
    seam: Int[np.ndarray, " joints"]
    place: Int[np.ndarray, " joints"]
    quad: Int[np.ndarray, "joints 2"]
    side: Int[np.ndarray, "joints 2"]
    inside: Bool[np.ndarray, " joints"]


def joints(design: SpiralDesign) -> Joints:
    """The joints of a design."""
    layout = design.flat.layout
    none = [np.empty(0, dtype=np.int64)]
    edges = np.concatenate([*layout.seams, *none])
    seam = np.repeat(np.arange(len(layout.seams)), [len(s) for s in layout.seams])
    place = np.concatenate([*(np.arange(len(s)) for s in layout.seams), *none])
    quad, side = layout.mesh.edge_quads[edges], layout.mesh.edge_sides[edges]
    patch = layout.patch_of[quad]
    swap = patch[:, 0] > patch[:, 1]
    quad[swap], side[swap] = quad[swap][:, ::-1], side[swap][:, ::-1]
    return Joints(edges, seam, place, quad, side, patch[:, 0] == patch[:, 1])


@dataclass(frozen=True, eq=False)
class Openings:
    """How much room there is beside the arm through a joint.

    x : metres along the arm from the joint, towards the second half
    left, right : metres that the edges could be further out there; width : metres of the arm
    """

    x: Float[np.ndarray, " places"]
    left: Float[np.ndarray, " places"]
    right: Float[np.ndarray, " places"]
    width: Float[np.ndarray, " places"]

    def asides(self, s: Size, shifts: Float[np.ndarray, " shifts"], overhanging: bool) -> list[tuple[float, float]]:
        """Of all ``shifts`` where a connector of this size has room, and how far to the left it has to sit there.

        Its neck stays on the arm, unless it may be ``overhanging``: then it hangs on the widened end only.
        """
        reach = s.length + s.clearance + 0.4 * s.wall
        shifts = shifts[(shifts - reach >= self.x[0]) & (shifts + reach <= self.x[-1])]
        if not len(shifts):
            return []
        first, last = np.searchsorted(self.x, [shifts - reach, shifts + reach])
        extra = np.maximum(s.pad - self.width[(first + last) // 2], 0.0)
        window = first[:, None] + np.arange(int((last - first).max()))
        outside, window = window >= last[:, None], np.minimum(window, len(self.x) - 1)
        left, right = (np.where(outside, np.inf, e[window]).min(axis=1) for e in (self.left, self.right))
        low, high = 0.5 * extra - right, left - 0.5 * extra
        best = np.clip(0.0, low, np.maximum(low, high))
        most = 0.5 * extra if overhanging else np.minimum(0.5 * self.width[(first + last) // 2], 0.5 * extra)
        fits = (low <= high) & (np.abs(best) <= most + 1e-9)
        return list(zip(shifts[fits].tolist(), best[fits].tolist(), strict=True))


class FreeSpace:
    """What is known of a design before any connector is made."""

    def __init__(self, design: SpiralDesign, params: ConnectorParams, mill: float = 0.0, progress: Progress = SILENT):
        self.design, self.params, self.mill = design, params, mill
        self.joints = joints(design)
        self.slot = slot_needed(design.params)
        # steps finer than any cutter, so that many joints share few shapes
        width = design.arms.joint_width[self.joints.quad[:, 0], self.joints.side[:, 0]]
        self.width = np.floor(width / STEP + 1e-6) * STEP
        self._openings: dict[int, Openings] = {}
        self.bodies = self._bodies(progress)

    @cached_property
    def through(self) -> Throughs:
        """The arms through all joints, seen from their first halves."""
        quad, side = self.joints.quad, self.joints.side
        return Throughs(*(Halves.of(self.design, quad[:, k], side[:, k]) for k in range(2)))

    def sizes(self, joint: int, kind: str = "dovetail") -> tuple[Size, ...]:
        """The sizes that connectors of this joint may have, the largest first."""
        width = float(self.width[joint])
        if kind == "tab":
            return tabs(width, self.params, SCALES, self.mill)
        return sizes(width, self.params, SCALES, self.mill)

    def attempts(self, joint: int) -> Iterator[Attempt]:
        """What to try at a joint, the best first."""
        # heads and sockets take turns along a seam: pushed on one joint too far, panels do not fit
        first = int(self.joints.place[joint]) % 2
        # a key needs no room beyond the cut: it serves where both sides of a cut inside a panel lie close together
        inside = bool(self.joints.inside[joint])
        kinds = [k for k in KINDS[self.params.connector] if k in (self.params.connector, "tab") or inside]
        # in one panel a head must not reach across the cut to its own socket
        gap = abs(self.through.own.origin[joint] - self.through.other.origin[joint]) if inside else np.inf
        best = Attempt(self.params.connector, self.sizes(joint, self.params.connector)[0], first)
        if best.kind != "dovetail" or best.size.length <= gap:
            yield best  # as a rule there is room, and no need to look round
        self.look([joint])
        openings, steps = self._openings[joint], np.array(self._shifts(joint))
        for kind in kinds:
            for back in (0.0,) if kind == "dovetail" else BACKS:
                for overhanging, s in product((False, True), self.sizes(joint, kind)):
                    if kind == "dovetail" and s.length > gap:
                        continue
                    fitting = openings.asides(s, steps, overhanging)
                    for shift, aside in fitting if overhanging else fitting[:_TRIES]:
                        for male in (first, 1 - first) if kind == "dovetail" else (first,):
                            yield Attempt(kind, s, male, shift, aside, back)

    def _shifts(self, joint: int) -> list[float]:
        """Metres by which the parting line is moved, the smallest first."""
        step = self.sizes(joint)[-1].neck * _STEP
        return [step * n for n in sorted(range(-_SHIFTS, _SHIFTS + 1), key=lambda n: (abs(n), n))]

    def judged(
        self, which: Sequence[int], attempts: Sequence[Attempt]
    ) -> list[tuple[tuple[Tip, Tip], np.ndarray] | None]:
        """Both tips of every attempt at the joints ``which``, and their polygons (2, 2) as ``_apart`` gives them; ``None`` without room.

        Both tips must keep the smallest slot from all that is near, in their own panels and in the panels beyond once both lie
        side by side. The second tip is made only where the first one has room.
        """
        rows, left = np.array(which, dtype=int), np.arange(len(which))
        shift, aside = (np.array([getattr(a, n) for a in attempts]) for n in ("shift", "aside"))
        roles = [a.roles() for a in attempts]
        tips, placed = np.empty((len(rows), 2), dtype=object), np.empty((2, len(rows), 2), dtype=object)
        for half, (through, sign) in enumerate(((self.through, 1.0), (self.through.turned, -1.0))):
            if not len(left):
                break
            role, tried = ([x[k] for k in left.tolist()] for x in ([r[half] for r in roles], attempts))
            made = make_tips(through, rows[left], role, tried, sign * shift[left], sign * aside[left])
            left = left[[tip is not None for tip in made]]
            tips[left, half] = [tip for tip in made if tip is not None]
            placed[:, left, half] = self._apart(through, tips[left, half])
            for shapes in placed[:, :, half]:  # what is blocked in its own panel is looked for nowhere else
                left = left[self._free(through, rows[left], shapes[left])]
        left = left[[not self.joints.inside[rows[k]] or not self._touching(*tips[k]) for k in left.tolist()]]
        found: list[tuple[tuple[Tip, Tip], np.ndarray] | None] = [None] * len(rows)
        for k in left.tolist():
            found[k] = (tips[k, 0], tips[k, 1]), placed[:, k]
        return found

    # -- what is near --------------------------------------------------------------------------------------------------

    def _bodies(self, progress: Progress) -> _Bodies:
        """All arms and hubs."""
        patch_of, found = self.design.flat.layout.patch_of, []
        for part in progress.batches(len(patch_of), _TOGETHER, "what is near the joints"):
            found.append(self._pieces(np.arange(part.start, part.stop)))
        rings, arm, quad = (np.concatenate(x) for x in zip(*found, strict=True))
        return _Bodies(rings + self.pitch * patch_of[quad][:, None], arm)

    def _pieces(self, quads: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The arms of some quads in pieces, and their hubs: rings in their patches' frames, and the arm and quad of each."""
        arms, roots, count = self.design.arms.of(quads), self.design.roots, len(quads)
        t_left, t_right = roots.left[quads], np.roll(roots.right[quads], 1, axis=1)
        even = np.linspace(0.0, 1.0, 10 * _PIECES + 1)
        begin = np.where(self.design.absent, self.design.begin, 0.0)[quads][..., None]
        ends = ((LEFT, t_left), (RIGHT, t_right))
        drawn = [edge(arms, begin + even * (t[..., None] - begin), way)[0] for way, t in ends]
        left, right = (complexes(d).reshape(4 * count, -1) for d in drawn)
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
    def pitch(self) -> float:
        """Metres by which the frames of consecutive patches are moved apart, so that no two lie in the same place."""
        return 2.0 * float(np.ptp(self.design.flat.corners.reshape(-1, 2), axis=0).max())

    def _apart(self, through: Throughs, tips: np.ndarray) -> np.ndarray:
        """(2, n) the polygons of tips (n,) in their panels, and in the panels beyond, side by side; all panels apart."""
        import shapely

        polygons = np.array([tip.polygon for tip in tips])
        points, owner = shapely.get_coordinates(polygons, return_index=True)
        rows = np.array([tip.row for tip in tips], dtype=int)[owner]
        own, other = through.own, through.other
        there = complexes(points)
        local = (there - own.origin[rows]) / own.out[rows]
        mated = other.origin[rows] - other.out[rows] * local
        placed = there + self.pitch * own.patch[rows], mated + self.pitch * other.patch[rows]
        return np.stack([shapely.set_coordinates(polygons.copy(), pairs(p)) for p in placed])

    def look(self, which: Sequence[int]) -> None:
        """Find out how much room there is beside the arms through some joints, from both edges to either side."""
        rows = np.array([j for j in which if j not in self._openings], dtype=int)
        if not len(rows):
            return
        through = self.through.rows(rows)
        reach = np.array([max(self._shifts(j)) + 2.0 * self.sizes(j)[0].length for j in rows.tolist()])
        back, ahead = (np.minimum(reach, half.along(half.end)) for half in (through.own, through.other))
        steps = int(np.ceil(reach.max() / _LOOK))
        x = _LOOK * (np.arange(-(-(2 * steps + 1) // _BUNDLE) * _BUNDLE) - steps)
        there = (x >= -back[:, None]) & (x <= ahead[:, None])
        edges, ways = through.edges(through.tau(np.repeat(-x[None], len(rows), axis=0)))
        ways = ways * (1j * np.array([LEFT, RIGHT]))[:, None, None]
        # as far as the widest end that is tried could reach
        view = 1.02 * self.slot + np.array([self.sizes(j)[0].pad for j in rows.tolist()])
        view = np.repeat(np.tile(view, 2), len(x) // _BUNDLE)
        free = np.full(edges.shape, np.inf)
        own = np.stack([through.own.arm, through.other.arm], axis=1)
        own = np.repeat(np.tile(own, (2, 1)), len(x) // _BUNDLE, axis=0)
        for half, sign in ((through.own, 1.0), (through.other, -1.0)):
            out = sign * half.out[:, None]
            origin = half.origin[:, None] + out * edges + self.pitch * half.patch[:, None]
            seen = self.bodies.sight(origin.reshape(-1, _BUNDLE), (out * ways).reshape(-1, _BUNDLE), view, own)
            free = np.minimum(free, np.maximum(seen.reshape(free.shape) - 1.02 * self.slot, 0.0))
        width = np.abs(edges[0] - edges[1])
        for k, joint in enumerate(rows.tolist()):
            at = there[k]
            self._openings[joint] = Openings(x[at], free[0, k, at], free[1, k, at], width[k, at])

    def _free(self, through: Throughs, rows: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        """(n,) whether shapes (n,) keep the smallest slot from all but the arms through the joints ``rows`` (n,)."""
        own = np.stack([through.own.arm[rows], through.other.arm[rows]], axis=1)
        return ~self.bodies.near(shapes, own, 0.999 * self.slot)

    def _touching(self, one: Tip, two: Tip) -> bool:
        """Whether the tips at a cut inside a panel come nearer to each other's arms than the smallest slot."""
        import shapely

        near = ((one.polygon, two.rest), (two.polygon, one.rest), (one.polygon, two.polygon))
        return any(bool(shapely.dwithin(a, b, 0.999 * self.slot)) for a, b in near)

    def gathered(self, tips: list[Tip], plain: np.ndarray, tolerance: float) -> Tips:
        """All tips together as arcs; ``plain`` (F, 4) is where the other arms begin."""
        blank = np.zeros(plain.shape)
        made = Tips(np.zeros((2, *plain.shape)), blank, blank + 1e-3, plain.copy(), {})
        for tip, end in zip(tips, ends_of(tips, tolerance), strict=True):
            at, wide = divmod(tip.arm, 4), tip.wide
            made.extra[:, at[0], at[1]] = wide.left[0], wide.right[0]
            made.full[at], made.over[at] = wide.full[0], wide.over[0]
            made.begin[at] = max(tip.begin, 0.0)
            made.across[tip.arm] = end
        return made


class _Bodies:
    """Pieces of arms, and hubs, in the plane where all panels lie apart.

    rings : (P, K) complex, metres; arm : (P,) which arm a piece belongs to, 4 quad + side, -1 for hubs
    low, high : (P, 2) corners of the boxes round them
    """

    def __init__(self, rings: np.ndarray, arm: np.ndarray):
        import shapely

        self.rings, self.arm = rings, arm
        self.low, self.high = (
            np.stack([f(rings.real, axis=1), f(rings.imag, axis=1)], axis=1) for f in (np.min, np.max)
        )
        self.tree = shapely.STRtree(shapely.box(*self.low.T, *self.high.T))
        # polygons are made where they are asked for: most never are
        self._shapes, self._known = np.empty(len(rings), dtype=object), np.zeros(len(rings), dtype=bool)

    def _polygons(self, pieces: np.ndarray) -> np.ndarray:
        import shapely

        new = np.unique(pieces[~self._known[pieces]])
        self._shapes[new] = shapely.polygons(pairs(self.rings[new]))
        self._known[new] = True
        return self._shapes[pieces]

    def near(self, shapes: np.ndarray, without: np.ndarray, distance: float) -> np.ndarray:
        """(N,) whether a piece lies within ``distance`` metres of shapes (N,), but for those of the arms ``without`` (N, 2)."""
        import shapely

        bounds = shapely.bounds(shapes) + distance * np.array([-1.0, -1.0, 1.0, 1.0])
        shape, piece = self.tree.query(shapely.box(*bounds.T))
        other = (self.arm[piece][:, None] != without[shape]).all(axis=1)
        shape, piece = shape[other], piece[other]
        shapely.prepare(shapes)
        found = np.zeros(len(shapes), dtype=bool)
        found[shape[shapely.dwithin(shapes[shape], self._polygons(piece), distance)]] = True
        return found

    def sight(self, origin: np.ndarray, way: np.ndarray, view: np.ndarray, without: np.ndarray) -> np.ndarray:
        """(N, K) metres: how far one sees from points along unit directions, at most ``view`` (N,), before a piece is in the way.

        origin, way : (N, K) complex, those of a row near to each other; without : (N, 2) arms that a row looks through. 0
        inside a piece.
        """
        import shapely

        seen = np.repeat(view[:, None].astype(float), origin.shape[1], axis=1)
        for first in range(0, len(origin), _RAYS):
            part = slice(first, first + _RAYS)
            start, ends = origin[part], origin[part] + view[part, None] * way[part]
            low = np.minimum(start.real, ends.real), np.minimum(start.imag, ends.imag)
            high = np.maximum(start.real, ends.real), np.maximum(start.imag, ends.imag)
            around = shapely.box(*(x.min(axis=1) for x in low), *(x.max(axis=1) for x in high))
            row, piece = self.tree.query(around)
            other = (self.arm[piece][:, None] != without[part][row]).all(axis=1)
            row, piece = row[other], piece[other]
            meet = np.ones((len(row), origin.shape[1]), dtype=bool)
            for axis in range(2):
                meet &= (low[axis][row] <= self.high[piece, axis, None]) & (
                    high[axis][row] >= self.low[piece, axis, None]
                )
            pair, ray = np.nonzero(meet)
            row, piece = row[pair], piece[pair]
            ring = self.rings[piece]
            along, ahead = np.roll(ring, -1, axis=1) - ring, way[part][row, ray, None]
            to = ring - start[row, ray, None]
            cross = (ahead.conj() * along).imag
            with np.errstate(divide="ignore", invalid="ignore"):
                far, share = (to.conj() * along).imag / cross, (to.conj() * ahead).imag / cross
            hit = (far >= 0.0) & (share >= 0.0) & (share < 1.0)
            nearest = np.where(hit, far, np.inf).min(axis=1)
            # an odd number of walls ahead: the point lies inside
            nearest[hit.sum(axis=1) % 2 == 1] = 0.0
            np.minimum.at(seen, (first + row, ray), nearest)
        return seen
