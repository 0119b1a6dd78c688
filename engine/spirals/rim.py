"""The rim: a strip along an open border that joins the tips of the arms there, with holes for a cord or rivets.

Every arm at the border has a node, where its middle line meets that of the strip. It crosses the border at right angles (its mate is its
own mirror image, see ``blends``) and goes straight on to the strip as its neck. Between two nodes the strip is a straight, an
arc and a straight; so it turns with the border and its corners are round. It depends on the flat patches and on the settings alone and
stays as it is while the spirals change.

At a cut the strip ends with its patch, on both sides of the seam with a gap between them. Lengths are metres; points of the plane are
complex numbers in the frame of their patch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Complex, Float, Int
from ..errors import FlexMapsError
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..surface.checking.finding import counted
from .arcs import Curve
from .slots import slot_needed
from .spiral import opposite_sides

# Largest slope against the border's normal, along the seam, at which the end of a strip still follows it: beyond 45 degrees a strip
# would end in a point
_SLANT = 1.0
_STRAIGHT = 1e-6  # radians below which two sides of the border count as one straight line


@dataclass(frozen=True, eq=False)
class Rim:
    """The strips of all patches by their B nodes, in the order of quads and sides.

    quad, side : the arm of every node; patch : its patch; following, before : the next node along the border counter-clockwise
        round the patch, and the one before; -1 at an end of a strip
    middle : of the border's side, where the arm ends; along : unit, direction of the side; the outward normal is -1j along
    depth : from the border to the strip, the length of the necks; width : of the strip
    straight : (B, 2) how far the strip goes straight on from the node, forwards and backwards, until it turns or ends
    turn : radians to the left between the node and the following one; radius : of that turn, 0 where there is none
    hole : diameter; holes : (B,) number of those between the node and the following one; spacing : about how far apart these are
    """

    quad: Int[np.ndarray, " nodes"]
    side: Int[np.ndarray, " nodes"]
    patch: Int[np.ndarray, " nodes"]
    following: Int[np.ndarray, " nodes"]
    before: Int[np.ndarray, " nodes"]
    middle: Complex[np.ndarray, " nodes"]
    along: Complex[np.ndarray, " nodes"]
    depth: float
    width: float
    straight: Float[np.ndarray, "nodes 2"]
    turn: Float[np.ndarray, " nodes"]
    radius: Float[np.ndarray, " nodes"]
    hole: float
    holes: Int[np.ndarray, " nodes"]
    spacing: float

    @classmethod
    def of(cls, flat: FlatPatches, params: SpiralParams) -> Rim | None:
        """The rim of flat patches, None where the settings ask for none or there is no border.

        Raises ``FlexMapsError`` with the faces where the border turns inwards so sharply that the strip has no room.
        """
        mesh = flat.layout.mesh
        quad, side = np.nonzero(mesh.border[mesh.quad_edges])
        if params.border != "rim" or not len(quad):
            return None
        z = flat.corners @ np.array([1.0, 1j])
        start, end = z[quad, side], z[quad, (side + 1) % 4]
        length = np.abs(end - start)
        following, seams = _walked(flat, quad, side)
        before = np.full(len(quad), -1)
        before[following[following >= 0]] = np.flatnonzero(following >= 0)
        depth = rim_depth(params)
        none = np.zeros(len(quad))
        rim = cls(
            quad, side, flat.layout.patch_of[quad], following, before, 0.5 * (start + end), (end - start) / length,
            depth, params.rim_width, np.zeros((len(quad), 2)), none, none, params.rim_hole,
            np.zeros(len(quad), dtype=int), params.rim_spacing,
        )  # fmt: skip
        return rim._turned(0.5 * length, params)._ended(0.5 * length, seams, params)._bored()

    @property
    def out(self) -> Complex[np.ndarray, " nodes"]:
        """Unit, the outward normals of the border's sides."""
        return -1j * self.along

    @property
    def centre(self) -> Complex[np.ndarray, " nodes"]:
        """Where the nodes are: in the middle of the strip."""
        return self.middle + (self.depth + 0.5 * self.width) * self.out

    @property
    def length(self) -> Float[np.ndarray, " nodes"]:
        """Along the middle of the strip from every node to the following one; 0 at an end."""
        there = np.where(self.following >= 0, self.straight[self.following, 1], 0.0)
        return np.where(self.following >= 0, self.straight[:, 0] + self.radius * np.abs(self.turn) + there, 0.0)

    @property
    def overhang(self) -> Float[np.ndarray, "nodes 2"]:
        """How far the strip goes beyond the node forwards and backwards where it ends; 0 elsewhere."""
        ends = np.stack([self.following < 0, self.before < 0], axis=1)
        return np.where(ends, self.straight, 0.0)

    def _turned(self, half: Float[np.ndarray, " nodes"], params: SpiralParams) -> Rim:
        """With its turns: as round as the sides' lengths allow, but never over the border."""
        i = np.flatnonzero(self.following >= 0)
        j = self.following[i]
        turn = np.angle(self.along[j] / self.along[i])
        reach = self.depth + 0.5 * self.width
        slope = np.tan(0.5 * turn)
        there, here = half[j] + reach * slope, half[i] + reach * slope  # from the nodes to where both straights meet
        room = np.minimum(here, there) - _clear(params)
        bends = np.abs(turn) > _STRAIGHT
        size = np.where(bends, np.abs(slope), 1.0)
        radius = np.where(bends, room / size, 0.0)
        # the inner edge of a turn outwards stays outside of the border's corner
        cosine = np.cos(0.5 * turn)
        outside = (reach / cosine - 0.5 * self.width) / np.maximum(1.0 / cosine - 1.0, 1e-12)
        radius = np.where(turn > 0.0, np.minimum(radius, outside), radius)
        tight = (bends & (radius < 0.5 * self.width + slot_needed(params))) | (room <= 0.0)
        if tight.any():
            raise FlexMapsError(
                f"The border turns so sharply at {counted(int(tight.sum()), 'place', 'places')} that a rim of {1e3 * self.width:g} mm has no room there; make it "
                "narrower or the object larger, smooth the border, or choose Stubs or Left out for it",
                faces=np.unique(self.quad[np.concatenate([i[tight], j[tight]])]),
            )
        straight, cut = self.straight.copy(), np.where(bends, radius * size, 0.0)
        straight[i, 0], straight[j, 1] = here - cut, there - cut
        turns, radii = self.turn.copy(), self.radius.copy()
        turns[i], radii[i] = np.where(bends, turn, 0.0), radius
        return replace(self, straight=straight, turn=turns, radius=radii)

    def _ended(self, half: np.ndarray, seams: Complex[np.ndarray, "nodes 2"], params: SpiralParams) -> Rim:
        """With its free ends, half of the gap before the seams (directions from the border inwards)."""
        straight, gap = self.straight.copy(), max(params.slot_seam, slot_needed(params))
        for k, ends in enumerate((self.following < 0, self.before < 0)):
            way = (1.0 if k == 0 else -1.0) * self.along
            inwards = -seams[:, k]
            slope = (inwards * np.conj(way)).real / np.maximum((inwards * np.conj(self.out)).real, 1e-9)
            lean = np.minimum(
                np.clip(slope, -_SLANT, _SLANT) * self.depth,
                np.clip(slope, -_SLANT, _SLANT) * (self.depth + self.width),
            )
            least = _clear(params)
            straight[:, k] = np.where(ends, np.maximum(half + lean - 0.5 * gap, least), straight[:, k])
        return replace(self, straight=straight)

    def _bored(self) -> Rim:
        """With as many holes between two nodes as come nearest to the spacing."""
        if self.hole == 0.0:
            return self
        length = self.length
        count = np.maximum(np.round(length / self.spacing), 1.0)
        return replace(self, holes=np.where(self.following >= 0, count, 0.0).astype(int))

    def place(self, node: Int[np.ndarray, " n"], way: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        """Points and directions of the strip's middle line, ``way`` beyond nodes towards the following ones."""
        first, turn, radius = self.straight[node, 0], self.turn[node], self.radius[node]
        bent = np.clip(way - first, 0.0, radius * np.abs(turn))
        angle = np.where(radius > 0.0, np.sign(turn) * bent / np.maximum(radius, 1e-12), 0.0)
        direction = self.along[node] * np.exp(1j * angle)
        # an arc of this angle has a chord half way between both directions
        chord = bent * np.sinc(0.5 * angle / np.pi) * self.along[node] * np.exp(0.5j * angle)
        rest = way - np.minimum(way, first) - bent
        return self.centre[node] + np.minimum(way, first) * self.along[node] + chord + rest * direction, direction

    @property
    def reach(self) -> Float[np.ndarray, "nodes 2"]:
        """How far the strip goes from every node forwards and backwards, half way to its neighbours or to its end."""
        half = 0.5 * self.radius * np.abs(self.turn)
        return self.straight + np.stack([half, np.where(self.before >= 0, half[self.before], 0.0)], axis=1)

    def half(
        self, node: Int[np.ndarray, " n"], back: bool, gone: Float[np.ndarray, " n"]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Points of the strip's middle line seen from nodes, so far from them forwards or backwards, and directions forwards."""
        if not back:
            place, way = self.place(node, gone)
            return place - self.centre[node], way
        before = self.before[node]
        place, way = self.place(before, self.length[before] - gone)
        ends = before < 0
        along = self.along[node]
        return np.where(ends, -gone * along, place - self.centre[node]), np.where(ends, along, way)

    @property
    def hole_ways(self) -> tuple[Int[np.ndarray, " holes"], Float[np.ndarray, " holes"]]:
        """The node of every hole between two nodes, and how far beyond it the hole lies."""
        node = np.repeat(np.arange(len(self.quad)), self.holes)
        rank = np.arange(len(node)) - np.repeat(np.cumsum(self.holes) - self.holes, self.holes)
        return node, (rank + 0.5) / np.maximum(self.holes[node], 1) * self.length[node]

    @property
    def end_bores(self) -> Float[np.ndarray, "nodes 2"]:
        """How far beyond the node the hole in a free end lies, forwards and backwards; 0 where there is none.

        As far from the end as from an edge, where the neck leaves room for it.
        """
        room = self.overhang > max(0.5 * self.width, self.hole) + 0.5 * self.width
        return np.where(room & (self.hole > 0.0), self.overhang - 0.5 * self.width, 0.0)

    @property
    def hole_places(self) -> tuple[Int[np.ndarray, " holes"], Complex[np.ndarray, " holes"]]:
        """The patch and the middle of every hole, those in free ends included."""
        node, way = self.hole_ways
        places, patches = [self.place(node, way)[0]], [self.patch[node]]
        for k, sign in ((0, 1.0), (1, -1.0)):
            some = np.flatnonzero(self.end_bores[:, k])
            places.append(self.centre[some] + sign * self.end_bores[some, k] * self.along[some])
            patches.append(self.patch[some])
        return np.concatenate(patches), np.concatenate(places)

    @property
    def area(self) -> Float[np.ndarray, " nodes"]:
        """Square metres of the strip of every node, half way to its neighbours; its neck is left out."""
        length, bore = self.length, self.holes * 0.25 * np.pi * self.hole**2
        own = 0.5 * (length + np.where(self.before >= 0, length[self.before], 0.0)) + self.overhang.sum(axis=1)
        less = 0.5 * (bore + np.where(self.before >= 0, bore[self.before], 0.0))
        # free ends are half round, and may have a hole
        ends, bored = (self.overhang > 0.0).sum(axis=1), (self.end_bores > 0.0).sum(axis=1)
        less += ends * (0.5 - 0.125 * np.pi) * self.width**2 + bored * 0.25 * np.pi * self.hole**2
        return own * self.width - less

    # -- outlines --------------------------------------------------------------------------------------------------

    def onward(self) -> dict[int, int]:
        """Of every slot 4 quad + corner that comes to the strip the one at which its outline leaves it."""
        first = self._first()
        leaves = np.where(self.before >= 0, self.before, first)
        to = 4 * self.quad[leaves] + (self.side[leaves] + 1) % 4
        return dict(zip((4 * self.quad + self.side).tolist(), to.tolist(), strict=True))

    def _first(self) -> Int[np.ndarray, " nodes"]:
        """The last node of the strip that begins at each node without one before; the node itself for others."""
        out = np.arange(len(self.quad))
        for i in np.flatnonzero(self.before < 0):
            at = i
            while self.following[at] >= 0:
                at = self.following[at]
            out[i] = at
        return out

    def link(self, node: int, half: Float[np.ndarray, " nodes"], fillet: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 2) and bulges from the right edge of a node's arm along the strip to the left edge of the arm before.

        half : half of the width of every arm at its tip. Where the strip begins at the node, round all of it to its last arm.
        """
        path = _Path(self.middle[node] - half[node] * self.along[node])
        inner = -0.5 * self.width
        self._neck(path, node, -1.0, half, fillet)
        at = int(self.before[node])
        if at < 0:
            self._round_end(path, node, 1, half, fillet)
            at = node
            while self.following[at] >= 0:
                self._segment(path, at, -inner, 1.0)
                at = int(self.following[at])
            self._round_end(path, at, 0, half, fillet)
        else:
            self._segment(path, at, inner, -1.0)
        self._neck(path, at, 1.0, half, fillet)
        return path.done()

    def _neck(self, path: _Path, node: int, sign: float, half: np.ndarray, fillet: float) -> None:
        """One side of a neck with its fillet: from the arm's right edge outwards, or to its left edge inwards."""
        foot = self.middle[node] + sign * half[node] * self.along[node]
        out, aside = self.out[node], sign * self.along[node]
        near, far = foot + (self.depth - fillet) * out, foot + self.depth * out + fillet * aside
        quarter = -np.tan(np.pi / 8.0)
        if sign < 0.0:
            path.to(near)
            path.to(far, quarter)
        else:
            path.to(far)
            path.to(near, quarter)
            path.to(foot)

    def _segment(self, path: _Path, node: int, aside: float, way: float) -> None:
        """The turn between a node and the following one at a distance outwards of the middle, forwards or backwards."""
        turn, there = float(self.turn[node]), int(self.following[node])
        if turn == 0.0:
            return
        begin = self.centre[node] + self.straight[node, 0] * self.along[node] + aside * self.out[node]
        end = self.centre[there] - self.straight[there, 1] * self.along[there] + aside * self.out[there]
        first, last = (begin, end) if way > 0.0 else (end, begin)
        path.to(first)
        path.to(last, way * np.tan(0.25 * turn))

    def _round_end(self, path: _Path, node: int, k: int, half: np.ndarray, fillet: float) -> None:
        """The free end beyond a node, from the strip's inner edge to the outer one where it begins (1), back where it ends (0)."""
        way = self.along[node] if k == 0 else -self.along[node]
        long, out, quarter = float(self.straight[node, k]), self.out[node], np.tan(np.pi / 8.0)
        round_ = max(min(0.5 * self.width, long - float(half[node]) - fillet), 0.0)
        tip, inner, outer = self.centre[node] + long * way, -0.5 * self.width, 0.5 * self.width
        edges = (inner, outer) if k == 1 else (outer, inner)
        for n, y in enumerate(edges):
            on_edge, on_end = tip + y * out - round_ * way, tip + (y - np.sign(y) * round_) * out
            for place, bulge in ((on_edge, 0.0), (on_end, quarter)) if n == 0 else ((on_end, 0.0), (on_edge, quarter)):
                path.to(place, bulge if round_ > 0.0 else 0.0)

    def closed(self) -> list[tuple[int, Curve]]:
        """The outer edges of the strips that go all the way round, with their patches, and all holes, clockwise."""
        found, seen = [], self._first() != np.arange(len(self.quad))
        ends = set(np.flatnonzero(self.before < 0).tolist())
        for i in ends:
            at = i
            while at >= 0:
                seen[at], at = True, int(self.following[at])
        for i in range(len(seen)):
            if seen[i]:
                continue
            path, at = _Path(self.centre[i] + 0.5 * self.width * self.out[i]), i
            while not seen[at]:
                seen[at] = True
                self._segment(path, at, 0.5 * self.width, 1.0)
                at = int(self.following[at])
            found.append((int(self.patch[i]), Curve(*path.done())))
        for patch, place in zip(*(x.tolist() for x in self.hole_places), strict=True):
            ends_of = np.array([[place.real - 0.5 * self.hole, place.imag], [place.real + 0.5 * self.hole, place.imag]])
            found.append((int(patch), Curve(ends_of, np.array([-1.0, -1.0]))))
        return found


def rim_depth(params: SpiralParams) -> float:
    """Metres from the border to the strip: a slot beside the widest arm has room there."""
    return 0.5 * params.width_max + slot_needed(params)


def _clear(params: SpiralParams) -> float:
    """Metres: how far on both sides of a node the strip goes straight on, so that a neck and its fillets meet it there."""
    return 1.02 * (0.5 * params.width_max + params.fillet)


class _Path:
    """A growing curve of arcs; points that fall together are kept once."""

    def __init__(self, start: complex):
        self.points, self.bulges = [complex(start)], [0.0]

    def to(self, place: complex, bulge: float = 0.0) -> None:
        """On to a place, straight or along an arc."""
        if abs(place - self.points[-1]) < 1e-9:
            return
        self.bulges[-1] = float(bulge)
        self.points.append(complex(place))
        self.bulges.append(0.0)

    def done(self) -> tuple[np.ndarray, np.ndarray]:
        points = np.array(self.points)
        return np.stack([points.real, points.imag], axis=1), np.array(self.bulges)


def _walked(flat: FlatPatches, quad: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, Complex[np.ndarray, "nodes 2"]]:
    """The node that follows each along the border of its patch, -1 at a cut; and the direction of the cut from there, else 0."""
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
