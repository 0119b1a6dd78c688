"""The rim: a strip along an open border that joins the tips of the arms there, with holes for a cord or rivets.

Every arm at the border has a node, where its centre line meets the strip's centre line. The arm crosses the border at
right angles, because it is blended with its own mirror image (see ``blends``); the straight piece from the border to
the strip is its neck. Between two nodes the strip consists of a straight, an arc and a straight, so that it follows the
border with round corners. The rim depends only on the flat patches and the settings, not on the spirals.

At a cut the strip ends with its patch; the two ends at a seam leave a gap. Lengths are metres; points are complex
numbers in the frame of their patch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Complex, Float, Int
from ..errors import FlexMapsError
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..surface.checking.finding import with_count
from ..tolerances import SINGLE_TOL
from .clearance.slots import min_slot_width
from .curves.arc_path import ArcPath
from .curves.arcs import Curve
from .curves.spiral import opposite_sides

# largest slope (1: 45 degrees) of a strip's end, which follows the seam, against the border's normal; larger values
# make the end more pointed
_MAX_SLOPE = 1.0


@dataclass(frozen=True, eq=False)
class Rim:
    """Strips of all patches, as arrays over their B nodes (one per arm at the border), ordered by quad and side.

    quad, side, patch : arm and patch of every node
    next_node, previous_node : nodes after and before, counter-clockwise around the patch; -1 at a strip's end
    middle, along : middle of the border's side, where the arm ends, and the side's unit direction
    depth, width : distance from the border to the strip (length of the necks), and width of the strip
    straight : (B, 2) length of the straight parts of the strip after and before the node
    turn, radius : angle (radians to the left) and radius of the strip's arc to the next node; 0 if there is none
    hole_diameter, hole_spacing : diameter of the drilled holes and desired distance between two holes
    hole_count : (B,) number of holes up to the next node
    """

    quad: Int[np.ndarray, " nodes"]
    side: Int[np.ndarray, " nodes"]
    patch: Int[np.ndarray, " nodes"]
    next_node: Int[np.ndarray, " nodes"]
    previous_node: Int[np.ndarray, " nodes"]
    middle: Complex[np.ndarray, " nodes"]
    along: Complex[np.ndarray, " nodes"]
    depth: float
    width: float
    straight: Float[np.ndarray, "nodes 2"]
    turn: Float[np.ndarray, " nodes"]
    radius: Float[np.ndarray, " nodes"]
    hole_diameter: float
    hole_count: Int[np.ndarray, " nodes"]
    hole_spacing: float

    @classmethod
    def from_flat(cls, flat: FlatPatches, params: SpiralParams) -> Rim | None:
        """Make the rim of flat patches; None if the settings disable it or there is no border.

        Parameters
        ----------
        flat : flat patches
        params : widths of strip and arms, holes

        Raises
        ------
        FlexMapsError : with the faces where the border turns so sharply that the strip has no room
        """
        mesh = flat.layout.mesh
        quad, side = np.nonzero(mesh.border[mesh.quad_edges])
        if params.border != "rim" or not len(quad):
            return None
        z = flat.corners @ np.array([1.0, 1j])
        start, end = z[quad, side], z[quad, (side + 1) % 4]
        length = np.abs(end - start)
        following, seams = _follow_border(flat, quad, side)
        before = np.full(len(quad), -1)
        before[following[following >= 0]] = np.flatnonzero(following >= 0)
        depth = rim_depth(params)
        zeros = np.zeros(len(quad))
        rim = cls(
            quad, side, flat.layout.patch_of[quad], following, before, 0.5 * (start + end), (end - start) / length,
            depth, params.rim_width, np.zeros((len(quad), 2)), zeros, zeros, params.rim_hole,
            np.zeros(len(quad), dtype=int), params.rim_spacing,
        )  # fmt: skip
        return rim._with_turns(0.5 * length, params)._with_ends(0.5 * length, seams, params)._with_holes()

    @property
    def outwards(self) -> Complex[np.ndarray, " nodes"]:
        """Outward unit normals of the sides on the border."""
        return -1j * self.along

    @property
    def centre(self) -> Complex[np.ndarray, " nodes"]:
        """Positions of the nodes, on the strip's centre line."""
        return self.middle + (self.depth + 0.5 * self.width) * self.outwards

    @property
    def length(self) -> Float[np.ndarray, " nodes"]:
        """Length of the strip's centre line from every node to the following node; 0 at a strip's end."""
        there = np.where(self.next_node >= 0, self.straight[self.next_node, 1], 0.0)
        return np.where(self.next_node >= 0, self.straight[:, 0] + self.radius * np.abs(self.turn) + there, 0.0)

    @property
    def overhang(self) -> Float[np.ndarray, "nodes 2"]:
        """Length of the strip's free ends after and before every node; 0 where the strip continues."""
        ends = np.stack([self.next_node < 0, self.previous_node < 0], axis=1)
        return np.where(ends, self.straight, 0.0)

    def _with_turns(self, half: Float[np.ndarray, " nodes"], params: SpiralParams) -> Rim:
        """Return the rim with the largest arcs that fit its sides (half lengths ``half``) and stay off the border."""
        i = np.flatnonzero(self.next_node >= 0)
        j = self.next_node[i]
        turn = np.angle(self.along[j] / self.along[i])
        reach = self.depth + 0.5 * self.width
        slope = np.tan(0.5 * turn)
        there, here = half[j] + reach * slope, half[i] + reach * slope  # from the nodes to where both straights meet
        room = np.minimum(here, there) - _min_straight(params)
        bends = np.abs(turn) > SINGLE_TOL
        size = np.where(bends, np.abs(slope), 1.0)
        radius = np.where(bends, room / size, 0.0)
        # at a convex corner, the strip's inner edge must stay outside the border's corner
        cosine = np.cos(0.5 * turn)
        outside = (reach / cosine - 0.5 * self.width) / np.maximum(1.0 / cosine - 1.0, 1e-12)
        radius = np.where(turn > 0.0, np.minimum(radius, outside), radius)
        tight = (bends & (radius < 0.5 * self.width + min_slot_width(params))) | (room <= 0.0)
        if tight.any():
            raise FlexMapsError(
                f"The border turns so sharply at {with_count(int(tight.sum()), 'place', 'places')} that a rim of {1e3 * self.width:g} mm has no room there; make it "
                "narrower or the object larger, smooth the border, or choose Stubs or Left out for it",
                faces=np.unique(self.quad[np.concatenate([i[tight], j[tight]])]),
            )
        straight, cut = self.straight.copy(), np.where(bends, radius * size, 0.0)
        straight[i, 0], straight[j, 1] = here - cut, there - cut
        turns, radii = self.turn.copy(), self.radius.copy()
        turns[i], radii[i] = np.where(bends, turn, 0.0), radius
        return replace(self, straight=straight, turn=turns, radius=radii)

    def _with_ends(self, half: np.ndarray, seams: Complex[np.ndarray, "nodes 2"], params: SpiralParams) -> Rim:
        """Return the rim with free ends half a gap before the seams, whose unit directions inwards are ``seams``."""
        straight, gap = self.straight.copy(), max(params.slot_seam, min_slot_width(params))
        for k, ends in enumerate((self.next_node < 0, self.previous_node < 0)):
            way = (1.0 if k == 0 else -1.0) * self.along
            seam = -seams[:, k]
            slope = (seam * np.conj(way)).real / np.maximum((seam * np.conj(self.outwards)).real, 1e-9)
            slope = np.clip(slope, -_MAX_SLOPE, _MAX_SLOPE)
            lean = np.minimum(slope * self.depth, slope * (self.depth + self.width))
            least = _min_straight(params)
            straight[:, k] = np.where(ends, np.maximum(half + lean - 0.5 * gap, least), straight[:, k])
        return replace(self, straight=straight)

    def _with_holes(self) -> Rim:
        """Return the rim with holes: between two nodes, as many as bring their spacing nearest to the setting."""
        if self.hole_diameter == 0.0:
            return self
        length = self.length
        count = np.maximum(np.round(length / self.hole_spacing), 1.0)
        return replace(self, hole_count=np.where(self.next_node >= 0, count, 0.0).astype(int))

    def points_at(self, node: Int[np.ndarray, " n"], offset: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        """Return points on the strip's centre line, some distance after nodes, and the line's directions there.

        Parameters
        ----------
        node : indices of nodes
        offset : distance after each node along the strip's centre line, metres

        Returns
        -------
        Complex points, metres, and unit directions
        """
        first, turn, radius = self.straight[node, 0], self.turn[node], self.radius[node]
        bent = np.clip(offset - first, 0.0, radius * np.abs(turn))
        angle = np.where(radius > 0.0, np.sign(turn) * bent / np.maximum(radius, 1e-12), 0.0)
        direction = self.along[node] * np.exp(1j * angle)
        # the chord of an arc has the mean of the directions at both ends
        chord = bent * np.sinc(0.5 * angle / np.pi) * self.along[node] * np.exp(0.5j * angle)
        rest = offset - np.minimum(offset, first) - bent
        return self.centre[node] + np.minimum(offset, first) * self.along[node] + chord + rest * direction, direction

    @property
    def reach(self) -> Float[np.ndarray, "nodes 2"]:
        """Length of each node's part of the strip, after and before it: half the way to the next, or to the end."""
        half = 0.5 * self.radius * np.abs(self.turn)
        before = np.where(self.previous_node >= 0, half[self.previous_node], 0.0)
        return self.straight + np.stack([half, before], axis=1)

    def vectors_along_strip(
        self, node: Int[np.ndarray, " n"], backwards: bool, distance: Float[np.ndarray, " n"]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return vectors from nodes to points on the strip's centre line, and the forward directions at these points.

        Parameters
        ----------
        node : nodes to begin at
        backwards : whether to go before the nodes, not after them
        distance : distance along the strip, metres
        """
        if not backwards:
            place, way = self.points_at(node, distance)
            return place - self.centre[node], way
        before = self.previous_node[node]
        place, way = self.points_at(before, self.length[before] - distance)
        ends = before < 0
        along = self.along[node]
        return np.where(ends, -distance * along, place - self.centre[node]), np.where(ends, along, way)

    @property
    def hole_distances(self) -> tuple[Int[np.ndarray, " holes"], Float[np.ndarray, " holes"]]:
        """Node before each hole between two nodes, and the distance of the hole's centre from it along the strip."""
        node = np.repeat(np.arange(len(self.quad)), self.hole_count)
        rank = np.arange(len(node)) - np.repeat(np.cumsum(self.hole_count) - self.hole_count, self.hole_count)
        return node, (rank + 0.5) / np.maximum(self.hole_count[node], 1) * self.length[node]

    @property
    def end_hole_distances(self) -> Float[np.ndarray, "nodes 2"]:
        """Distances from every node to the centres of the holes in the free ends after and before it; 0 if none.

        A hole is as far from the end as from the strip's edges; ends too short for a hole beside the neck have none.
        """
        room = self.overhang > max(0.5 * self.width, self.hole_diameter) + 0.5 * self.width
        return np.where(room & (self.hole_diameter > 0.0), self.overhang - 0.5 * self.width, 0.0)

    @property
    def hole_centres(self) -> tuple[Int[np.ndarray, " holes"], Complex[np.ndarray, " holes"]]:
        """Patch and centre of every hole, including the holes in free ends."""
        node, way = self.hole_distances
        places, patches = [self.points_at(node, way)[0]], [self.patch[node]]
        for k, sign in ((0, 1.0), (1, -1.0)):
            some = np.flatnonzero(self.end_hole_distances[:, k])
            places.append(self.centre[some] + sign * self.end_hole_distances[some, k] * self.along[some])
            patches.append(self.patch[some])
        return np.concatenate(patches), np.concatenate(places)

    @property
    def area(self) -> Float[np.ndarray, " nodes"]:
        """Area of the strip that belongs to every node, without its neck, square metres."""
        length, bore = self.length, self.hole_count * 0.25 * np.pi * self.hole_diameter**2
        before = self.previous_node
        own = 0.5 * (length + np.where(before >= 0, length[before], 0.0)) + self.overhang.sum(axis=1)
        less = 0.5 * (bore + np.where(before >= 0, bore[before], 0.0))
        # free ends are half round, and may have a hole
        ends, bored = (self.overhang > 0.0).sum(axis=1), (self.end_hole_distances > 0.0).sum(axis=1)
        less += ends * (0.5 - 0.125 * np.pi) * self.width**2 + bored * 0.25 * np.pi * self.hole_diameter**2
        return own * self.width - less

    # -- outlines --------------------------------------------------------------------------------------------------

    def linked_slots(self) -> dict[int, int]:
        """Map every slot (4 quad + corner) whose outline reaches the strip to the slot where the outline leaves it."""
        first = self._last_nodes()
        leaves = np.where(self.previous_node >= 0, self.previous_node, first)
        to = 4 * self.quad[leaves] + (self.side[leaves] + 1) % 4
        return dict(zip((4 * self.quad + self.side).tolist(), to.tolist(), strict=True))

    def _last_nodes(self) -> Int[np.ndarray, " nodes"]:
        """Map the first node of every strip to its last node, and every other node to itself."""
        out = np.arange(len(self.quad))
        for i in np.flatnonzero(self.previous_node < 0):
            at = i
            while self.next_node[at] >= 0:
                at = self.next_node[at]
            out[i] = at
        return out

    def outline_at(self, node: int, half: Float[np.ndarray, " nodes"], fillet: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the part of the outline (points (n, 2), bulges) that begins at the right edge of a node's arm.

        The part ends at the left edge of the previous node's arm. If the node is the first of its strip, the part runs
        around the whole strip and ends at the last node's arm.

        Parameters
        ----------
        node : the node
        half : half of the width of the arm of every node at its tip, metres
        fillet : radius of the fillets between necks and strip, metres
        """
        path = ArcPath(self.middle[node] - half[node] * self.along[node])
        inner = -0.5 * self.width
        self._add_neck_side(path, node, -1.0, half, fillet)
        at = int(self.previous_node[node])
        if at < 0:
            self._add_end(path, node, 1, half, fillet)
            at = node
            while self.next_node[at] >= 0:
                self._add_arc(path, at, -inner, 1.0)
                at = int(self.next_node[at])
            self._add_end(path, at, 0, half, fillet)
        else:
            self._add_arc(path, at, inner, -1.0)
        self._add_neck_side(path, at, 1.0, half, fillet)
        return path.arrays()

    def _add_neck_side(self, path: ArcPath, node: int, sign: float, half: np.ndarray, fillet: float) -> None:
        """Add a neck's side with its fillet to the path: right side outwards (``sign`` -1) or left side inwards (1)."""
        foot = self.middle[node] + sign * half[node] * self.along[node]
        out, aside = self.outwards[node], sign * self.along[node]
        near, far = foot + (self.depth - fillet) * out, foot + self.depth * out + fillet * aside
        quarter = -np.tan(np.pi / 8.0)
        if sign < 0.0:
            path.add_segment(near)
            path.add_segment(far, quarter)
        else:
            path.add_segment(far)
            path.add_segment(near, quarter)
            path.add_segment(foot)

    def _add_arc(self, path: ArcPath, node: int, aside: float, way: float) -> None:
        """Add the arc from a node to the next (or back if ``way`` is -1), ``aside`` metres outside the centre line."""
        turn, there = float(self.turn[node]), int(self.next_node[node])
        if turn == 0.0:
            return
        begin = self.centre[node] + self.straight[node, 0] * self.along[node] + aside * self.outwards[node]
        end = self.centre[there] - self.straight[there, 1] * self.along[there] + aside * self.outwards[there]
        first, last = (begin, end) if way > 0.0 else (end, begin)
        path.add_segment(first)
        path.add_segment(last, way * np.tan(0.25 * turn))

    def _add_end(self, path: ArcPath, node: int, k: int, half: np.ndarray, fillet: float) -> None:
        """Add a strip's free start, from its inner to outer edge (``k`` 1), or end, from outer to inner edge (0)."""
        way = self.along[node] if k == 0 else -self.along[node]
        long, out, quarter = float(self.straight[node, k]), self.outwards[node], np.tan(np.pi / 8.0)
        round_ = max(min(0.5 * self.width, long - float(half[node]) - fillet), 0.0)
        tip, inner, outer = self.centre[node] + long * way, -0.5 * self.width, 0.5 * self.width
        edges = (inner, outer) if k == 1 else (outer, inner)
        for n, y in enumerate(edges):
            on_edge, on_end = tip + y * out - round_ * way, tip + (y - np.sign(y) * round_) * out
            for place, bulge in ((on_edge, 0.0), (on_end, quarter)) if n == 0 else ((on_end, 0.0), (on_edge, quarter)):
                path.add_segment(place, bulge if round_ > 0.0 else 0.0)

    def closed_curves(self) -> list[tuple[int, Curve]]:
        """Return, each with its patch, the outer edges of strips without ends, and all drilled holes (clockwise)."""
        curves, seen = [], self._last_nodes() != np.arange(len(self.quad))
        for at in np.flatnonzero(self.previous_node < 0).tolist():
            while at >= 0:
                seen[at], at = True, int(self.next_node[at])
        for i in range(len(seen)):
            if seen[i]:
                continue
            path, at = ArcPath(self.centre[i] + 0.5 * self.width * self.outwards[i]), i
            while not seen[at]:
                seen[at] = True
                self._add_arc(path, at, 0.5 * self.width, 1.0)
                at = int(self.next_node[at])
            curves.append((int(self.patch[i]), Curve(*path.arrays())))
        for patch, place in zip(*(x.tolist() for x in self.hole_centres), strict=True):
            radius = 0.5 * self.hole_diameter
            ends_of = np.array([[place.real - radius, place.imag], [place.real + radius, place.imag]])
            curves.append((int(patch), Curve(ends_of, np.array([-1.0, -1.0]))))
        return curves


def rim_depth(params: SpiralParams) -> float:
    """Return the distance from the border to the strip, metres, which leaves room for a slot beside the widest arm."""
    return 0.5 * params.width_max + min_slot_width(params)


def _min_straight(params: SpiralParams) -> float:
    """Return the least straight length of the strip on each side of a node, metres, for a neck with its fillets."""
    return 1.02 * (0.5 * params.width_max + params.fillet)


def _follow_border(
    flat: FlatPatches, quad: np.ndarray, side: np.ndarray
) -> tuple[np.ndarray, Complex[np.ndarray, "nodes 2"]]:
    """Return each node's next node (-1 at a cut), and the inward directions of cuts after and before it (else 0)."""
    layout = flat.layout
    mate, beyond = opposite_sides(layout.mesh)
    border = layout.mesh.border[layout.mesh.quad_edges]
    number = np.full(border.shape, -1)
    number[quad, side] = np.arange(len(quad))
    z = flat.corners @ np.array([1.0, 1j])
    following, seams = np.full(len(quad), -1), np.zeros((len(quad), 2), dtype=complex)
    for n, (f, k) in enumerate(zip(quad.tolist(), side.tolist(), strict=True)):
        for way in (1, -1):
            g, s = f, k
            while True:
                s = (s + way) % 4
                if border[g, s]:
                    if way > 0:
                        following[n] = number[g, s]
                    break
                if layout.outline_sides[g, s]:
                    ends = z[g, s], z[g, (s + 1) % 4]
                    cut = (ends[1] - ends[0]) * way
                    seams[n, 0 if way > 0 else 1] = cut / abs(cut)
                    break
                g, s = int(mate[g, s]), int(beyond[g, s])
    return following, seams
