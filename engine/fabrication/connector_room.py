"""Where connectors sit, and whether there is room for them: the joints at all cuts, and what is near every joint.

Room is judged with polygons. A tip must keep the smallest slot from every other arm and hub of its own flat panel, and
from those of the panel on the other side once both lie side by side. Where the arms beside a joint are near, as in
strongly wound spirals, there is more room a little way along the arm and to one side: the parting line moves there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from ..params import ConnectorParams
from ..spirals.contours import Tips
from ..spirals.design import SpiralDesign
from ..spirals.slots import slot_needed
from ..spirals.spiral import LEFT, RIGHT, edge
from .connector_path import Attempt, Half, Through, Tip, Widening, complexes, make_tip, pairs
from .connector_shape import Size, size, tabs
from .rays import first_hit

# what is tried where the asked kind has no room
KINDS = {"dovetail": ("dovetail", "key", "tab"), "key": ("key", "tab"), "tab": ("tab",)}
SCALES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
BACKS = (0.0, 3e-4, 6e-4, 1e-3, 1.5e-3)  # metres that the faces of keys and tabs may stand back
_SHIFTS = 12  # steps to either side
_STEP = 0.55  # of a shift, in necks
_TRIES = 4  # shifts that are tried for every size before necks may lie beside their arms
_VIEW = 5e-3  # metres; how far to look beside an arm
_LOOK = 1e-4  # metres along the arm from one look to the next


@dataclass(frozen=True, eq=False)
class Joints:
    """All places where two arms meet across a cut; m of them, seam by seam along the seams.

    edge, seam, place : (m,) int, the edge of the mesh, its seam, and its place along that
    quad, side : (m, 2) int, both arms; the panel with the lower number first
    inside : (m,) bool, whether both arms belong to one panel
    """

    edge: np.ndarray
    seam: np.ndarray
    place: np.ndarray
    quad: np.ndarray
    side: np.ndarray
    inside: np.ndarray


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

    x : (n,) metres along the arm from the joint, towards the second half
    left, right : (n,) metres that the edges could be further out there; width : (n,) metres of the arm
    """

    x: np.ndarray
    left: np.ndarray
    right: np.ndarray
    width: np.ndarray

    def aside(self, s: Size, shift: float, beside: bool) -> float | None:
        """How far to the left a connector of this size has to sit at ``shift``, at the least; ``None`` where it has no room.

        Its neck stays on the arm, unless it may lie ``beside`` it: then it hangs on the widened end only.
        """
        reach = s.length + s.clearance + 0.4 * s.wall
        if shift - reach < self.x[0] or shift + reach > self.x[-1]:
            return None
        first, last = np.searchsorted(self.x, [shift - reach, shift + reach])
        width = float(self.width[(first + last) // 2])
        extra = max(s.pad - width, 0.0)
        low, high = 0.5 * extra - float(self.right[first:last].min()), float(self.left[first:last].min()) - 0.5 * extra
        if low > high:
            return None
        best = min(max(0.0, low), high)
        return best if abs(best) <= (0.5 * extra if beside else min(0.5 * width, 0.5 * extra)) + 1e-9 else None


class Room:
    """What is known of a design before any connector is made."""

    def __init__(self, design: SpiralDesign, params: ConnectorParams, mill: float = 0.0):
        self.design, self.params, self.mill = design, params, mill
        self.joints = joints(design)
        self.slot = slot_needed(design.params)

    def through(self, joint: int) -> Through:
        """The arm through a joint, seen from its first half."""
        j = self.joints
        halves = (Half.of(self.design, int(q), int(k)) for q, k in zip(j.quad[joint], j.side[joint], strict=True))
        return Through(*halves)

    def sizes(self, through: Through, kind: str = "dovetail") -> list[Size]:
        """The sizes that connectors of this arm may have, the largest first."""
        width = float(through.own.arms.joint_width[0, 0])
        if kind == "tab":
            return tabs(width, self.params, SCALES, self.mill)
        return list(dict.fromkeys(size(width, self.params, scale, self.mill) for scale in SCALES))

    def attempts(self, joint: int, through: Through, near: Any) -> Iterator[Attempt]:
        """What to try at a joint, the best first."""
        # heads and sockets take turns along a seam: pushed on one joint too far, panels do not fit
        first = int(self.joints.place[joint]) % 2
        # a key needs no room beyond the cut: it serves where both sides of a cut inside a panel lie close together
        inside = bool(self.joints.inside[joint])
        kinds = [k for k in KINDS[self.params.connector] if k in (self.params.connector, "tab") or inside]
        sizes = {kind: self.sizes(through, kind) for kind in kinds}
        # in one panel a head must not reach across the cut to its own socket
        gap = abs(through.own.origin - through.other.origin) if inside else np.inf
        best = Attempt(self.params.connector, sizes[self.params.connector][0], first)
        if best.kind != "dovetail" or best.size.length <= gap:
            yield best  # as a rule there is room, and no need to look round
        smallest = self.sizes(through)[-1]
        steps = [smallest.neck * _STEP * n for n in sorted(range(-_SHIFTS, _SHIFTS + 1), key=lambda n: (abs(n), n))]
        openings = self._openings(through, steps[-1] + 2.0 * self.sizes(through)[0].length, near)
        for kind in sizes:
            for back in (0.0,) if kind == "dovetail" else BACKS:
                for beside, s in product((False, True), sizes[kind]):
                    if kind == "dovetail" and s.length > gap:
                        continue
                    fitting = [(x, e) for x in steps if (e := openings.aside(s, x, beside)) is not None]
                    for shift, aside in fitting if beside else fitting[:_TRIES]:
                        for male in (first, 1 - first) if kind == "dovetail" else (first,):
                            yield Attempt(kind, s, male, shift, aside, back)

    def tips(self, through: Through, a: Attempt) -> tuple[Tip, Tip] | None:
        """Both tips of a joint; ``None`` where an arm is too short for them."""
        one = make_tip(through, a.roles()[0], a, a.shift, a.aside)
        two = make_tip(through.turned, a.roles()[1], a, -a.shift, -a.aside) if one else None
        return None if one is None or two is None else (one, two)

    # -- what is near --------------------------------------------------------------------------------------------------

    @cached_property
    def bodies(self) -> list[tuple[Any, np.ndarray]]:
        """Of every patch a tree of the polygons of its arms and hubs, and which arm each is, -1 for hubs."""
        import shapely

        arms, roots = self.design.arms, self.design.roots
        patch_of = self.design.flat.layout.patch_of
        count = len(arms.centre)
        even = np.linspace(0.0, 1.0, 81)
        left = edge(arms, even * roots.left[..., None], LEFT)[0]
        right = edge(arms, even[::-1] * np.roll(roots.right, 1, axis=1)[..., None], RIGHT)[0]
        shapes = shapely.polygons(np.concatenate([left, right], axis=2).reshape(4 * count, -1, 2))
        hub = np.stack([right[:, :, 0], left[:, :, -1]], axis=2).reshape(count, 8, 2)
        every = np.concatenate([shapes, shapely.polygons(hub)])
        which = np.concatenate([np.arange(4 * count), np.full(count, -1)])
        owner = np.concatenate([np.repeat(patch_of, 4), patch_of])
        patches = [np.flatnonzero(owner == p) for p in range(len(self.design.flat.layout.patches))]
        return [(shapely.STRtree(every[rows]), which[rows]) for rows in patches]

    def apart(self, shapes: np.ndarray, patch: np.ndarray) -> np.ndarray:
        """Shapes (n,) in the frames of patches (n,), moved so that no two patches lie in the same place."""
        import shapely

        corners = self.design.flat.corners
        pitch = 2.0 * (np.ptp(corners.reshape(-1, 2), axis=0).max() + _VIEW)
        points, owner = shapely.get_coordinates(shapes, return_index=True)
        points[:, 0] += pitch * patch[owner]
        return shapely.set_coordinates(shapes.copy(), points)

    def near(self, through: Through) -> Any:
        """Polygons of all arms and hubs near a joint but its own two, in the frame of its first half, both panels side by side."""
        import shapely

        found = []
        reach = 4.0 * self.sizes(through)[0].pad
        for half, sign in ((through.own, 1.0), (through.other, -1.0)):
            tree, which = self.bodies[half.patch]
            rows = tree.query(shapely.Point(half.origin.real, half.origin.imag).buffer(reach))
            rows = rows[~np.isin(which[rows], [through.own.arm, through.other.arm])]
            found.append(shapely.transform(tree.geometries[rows], _into(half, sign)))
        return np.concatenate(found)

    def _openings(self, through: Through, reach: float, near: Any) -> Openings:
        """Look from both edges of the arm to either side, as far as ``reach`` metres along it from the joint."""
        back = min(reach, float(np.interp(through.own.end, through.own.t, through.own.length)))
        ahead = min(reach, float(np.interp(through.other.end, through.other.t, through.other.length)))
        x = np.linspace(-back, ahead, 2 + int((back + ahead) / _LOOK))
        tau = np.array([through.tau(-d) for d in x])
        edges, ways = through.edges(tau, Widening(0.0, 0.0, 0.0, 0.0))
        look = ways * (1j * np.array([[LEFT], [RIGHT]]))
        free = np.maximum(_sight(edges.ravel(), look.ravel(), near) - 1.02 * self.slot, 0.0).reshape(2, -1)
        return Openings(x, free[0], free[1], np.abs(edges[0] - edges[1]))

    def free(self, joint: int, tips: tuple[Tip, Tip], near: Any) -> bool:
        """Whether both tips keep the smallest slot from all that is near, side by side and, in one panel, flat."""
        import shapely

        slot = 0.999 * self.slot
        for tip, sign in zip(tips, (1.0, -1.0), strict=True):
            if shapely.dwithin(near, shapely.transform(tip.polygon, _into(tip.through.own, sign)), slot).any():
                return False
        if not self.joints.inside[joint]:
            return True
        for tip, partner in (tips, tips[::-1]):
            tree, which = self.bodies[tip.patch]
            flat = which[tree.query(tip.polygon, predicate="dwithin", distance=slot)]
            if not np.isin(flat, [tip.arm, partner.arm]).all() or shapely.dwithin(tip.polygon, partner.rest, slot):
                return False
        return not shapely.dwithin(tips[0].polygon, tips[1].polygon, slot)

    def gathered(self, tips: list[Tip], plain: np.ndarray, tolerance: float) -> Tips:
        """All tips together as arcs; ``plain`` (F, 4) is where the other arms begin."""
        blank = np.zeros(plain.shape)
        made = Tips(np.zeros((2, *plain.shape)), blank, blank + 1e-3, plain.copy(), {})
        for tip in tips:
            at = divmod(tip.arm, 4)
            made.extra[:, at[0], at[1]] = tip.wide.left, tip.wide.right
            made.full[at], made.over[at] = tip.wide.full, tip.wide.over
            made.begin[at] = max(tip.begin, 0.0)
            made.across[tip.arm] = tip.end(tolerance)
        return made


def _into(half: Half, sign: float) -> Any:
    """A function for shapely from a patch's frame to that of a joint's first half."""
    return lambda points: pairs(sign * half.local(complexes(points)))


def _sight(origin: np.ndarray, way: np.ndarray, near: Any) -> np.ndarray:
    """(N,) metres: how far one sees from points along unit directions, both (N,) complex, before a polygon is in the way.

    At most ``_VIEW``; 0 inside a polygon.
    """
    import shapely

    rings, owner = shapely.get_coordinates(shapely.get_exterior_ring(near), return_index=True)
    same = owner[1:] == owner[:-1]
    corner = complexes(rings)
    seen = first_hit(origin, way, _VIEW, corner[:-1][same], np.diff(corner)[same])
    seen[shapely.STRtree(near).query(shapely.points(pairs(origin)), predicate="within")[0]] = 0.0
    return seen
