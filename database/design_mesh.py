"""Structured solid meshes of the spirals of a design as they would be cut: blended joints, true fillets, real quads.

Every arm is a row of pieces from its root to its joint, every hub four quarters that meet at its centre; both are cubic
hexahedra with nodes at the Gauss-Lobatto points. All spirals of a design have the same pieces and so one numbering of their
nodes. A plane point is a complex number, and u = 1 - t runs from the centre of a quad to the joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..engine.arrays import Complex, Float, Int
from ..engine.errors import FlexMapsError
from ..engine.spirals.curves.spiral import LEFT, RIGHT, Arms, centre_line, edge_points, width_at
from ..engine.spirals.design import SpiralDesign
from .rim_mesh import plane_nodes
from .solid import ARMS, LOBATTO, lagrange

UNIT = 1e-3  # metres, of the lengths in a mesh
LEVELS = len(LOBATTO)  # nodes through the sheet
BESIDE = 0.3  # arm widths from the outer fillet of a root to its first section; as in ``solid``
# shares of an element's side at which its second node may stand: there a fillet ends, as far as the element bears it
ARC_END = (0.22, 0.4)
BENT = 0.1  # least Jacobian of a hub's quarter over its mean, below which that node gives way; folds are at 0
GIVES_WAY = (0.25, 0.28, 0.32, 0.36, 0.4)  # places that are tried for it then; by trial with optimised designs
SAMPLES = 400  # points at which the length and the turning of a centre line are taken


@dataclass(frozen=True)
class Resolution:
    """How fine a design is meshed.

    length : longest piece of an arm, in its widths; turn : most radians that its centre line may turn within a piece
    root : share of both that holds at the hub; blend : least pieces of a blended end; across : elements across an arm
    """

    length: float = 2.5
    turn: float = 0.7
    root: float = 0.5
    blend: int = 2
    across: int = 1


@dataclass(frozen=True, eq=False)
class Numbering:
    """The nodes of one spiral: those of the hub, then those of the arms from behind their roots to their joints.

    pieces : of every arm; across : elements across an arm
    """

    pieces: int
    across: int

    @property
    def side(self) -> int:
        """Nodes across an arm."""
        return 3 * self.across + 1

    @cached_property
    def quarters(self) -> Int[np.ndarray, "4 side side"]:
        """Plane nodes of the hub's quarters, outwards along the spoke on the right by counter-clockwise."""
        own = (self.side - 1) * self.side
        out = np.zeros((ARMS, self.side, self.side), dtype=np.int64)
        for k in range(ARMS):
            out[k, 1:] = 1 + k * own + np.arange(own).reshape(-1, self.side)
        for k in range(ARMS):
            out[k, 0, 1:] = out[(k + 1) % ARMS, 1:, 0]
        return out

    @cached_property
    def plane(self) -> Int[np.ndarray, "4 stations side"]:
        """Plane nodes of the arms' sections."""
        first, rows = self.quarters.max() + 1, 3 * self.pieces
        behind = first + np.arange(ARMS * rows * self.side).reshape(ARMS, rows, self.side)
        return np.concatenate([self.quarters[:, -1:], behind], axis=1)

    @cached_property
    def hub_size(self) -> int:
        """Number of the hub's nodes."""
        return LEVELS * int(self.quarters.max() + 1)

    @cached_property
    def size(self) -> int:
        """Number of nodes of a spiral."""
        return LEVELS * int(self.plane.max() + 1)

    @cached_property
    def sections(self) -> Int[np.ndarray, "4 stations section"]:
        """Nodes of every arm from its root to its joint; of a section from the right to the left, through the sheet upwards."""
        return _through(self.plane)

    @cached_property
    def hub(self) -> Int[np.ndarray, "elements 4 16"]:
        """Nodes of the hub's elements, by station outwards and node of the section."""
        n = self.across
        blocks = [
            self.quarters[k, 3 * i : 3 * i + 4, 3 * j : 3 * j + 4]
            for k in range(ARMS)
            for i in range(n)
            for j in range(n)
        ]
        return _through(np.array(blocks))

    @cached_property
    def arms(self) -> Int[np.ndarray, "4 pieces across 4 16"]:
        """Nodes of the arms' elements, by station and node of the section."""
        stations = 3 * np.arange(self.pieces)[:, None] + np.arange(4)
        of_piece = self.plane[:, stations]  # (4, pieces, 4, side)
        return np.stack([_through(of_piece[..., 3 * j : 3 * j + 4]) for j in range(self.across)], axis=2)


def _through(plane: Int[np.ndarray, "*rows across"]) -> Int[np.ndarray, "*rows nodes"]:
    """Nodes across and through the sheet, in a row, of plane nodes."""
    return (LEVELS * plane[..., None] + np.arange(LEVELS)).reshape(*plane.shape[:-1], -1)


@dataclass(frozen=True, eq=False)
class DesignMesh:
    """The solids of all spirals of a design, and behind them of its rim's nodes, each in the frame of its patch with the centre of
    its quad, or its own, at the origin.

    nodes : ``UNIT``; the sheet lies on both sides of z = 0
    """

    numbering: Numbering
    nodes: Float[np.ndarray, "spirals nodes 3"]


def make_mesh(design: SpiralDesign, resolution: Resolution) -> DesignMesh:
    """Mesh the spirals of a design.

    Raises FlexMapsError with the faces of spirals that cannot be cut or meshed, and where spirals wind clockwise.
    """
    missed = np.flatnonzero(design.roots.is_missing.any(axis=1))
    if len(missed):
        raise FlexMapsError(f"{len(missed)} spirals cannot be cut", faces=missed)
    if design.params.clockwise:
        raise FlexMapsError("Solids are made of spirals that wind counter-clockwise; their mirror images behave alike")
    rails = _Rails(design)
    stations = rails.stations(resolution)
    share = _nodes(resolution.across)
    u = (stations[..., :-1, None] + np.diff(stations)[..., None] * LOBATTO[:3]).reshape(*stations.shape[:2], -1)
    u = np.concatenate([u, stations[..., -1:]], axis=2)
    lag = rails.lag(u)
    outwards = u + lag
    begin, reach = outwards[..., 0], outwards[..., 3] - outwards[..., 0]
    outwards[..., :4] = _past_fillet(begin, reach, rails.arc[1], LOBATTO)
    right, left = rails.right(outwards)[..., None], rails.left(u - lag)[..., None]
    arms = right * (1.0 - share) + left * share
    hub = _hub(rails, share)
    numbering = Numbering(stations.shape[-1] - 1, resolution.across)
    plane = np.zeros((len(hub), numbering.size // LEVELS), dtype=complex)
    plane[:, numbering.quarters] = hub
    plane[:, numbering.plane[:, 1:]] = arms[:, :, 1:]
    if design.rim is not None:
        at = np.append((np.arange(numbering.pieces)[:, None] + LOBATTO[:3]).ravel() / numbering.pieces, 1.0)
        rim = plane_nodes(design, numbering.quarters, numbering.plane, at, share)
        plane, hub = np.concatenate([plane, rim]), np.zeros(len(plane) + len(rim))
    elements = plane[:, np.concatenate([numbering.hub, numbering.arms.reshape(-1, 4, 16)])[..., ::LEVELS] // LEVELS]
    folded = np.flatnonzero((_roundness(elements) <= 0.0).any(axis=1))
    if len(folded):
        raise FlexMapsError(
            f"The solids of {len(folded)} spirals would be folded; make their arms more alike", faces=folded
        )
    nodes = np.zeros((len(hub), numbering.size, 3))
    nodes[..., 0], nodes[..., 1] = np.repeat(plane.real, LEVELS, axis=1), np.repeat(plane.imag, LEVELS, axis=1)
    nodes[..., 2] = np.tile(design.params.thickness * (LOBATTO - 0.5), plane.shape[1])
    return DesignMesh(numbering, nodes / UNIT)


def _nodes(elements: int) -> Float[np.ndarray, " nodes"]:
    """Places in [0, 1] of the nodes of even elements in a row."""
    return np.append(((np.arange(elements)[:, None] + LOBATTO[:3]) / elements).ravel(), 1.0)


class _Rails:
    """Both sides of every arm as functions of u, continued round the fillets to the corners of the hub.

    corner : of the hub, between arm k and arm k + 1; middle : of its fillet
    first : u up to which the right side goes round its fillet
    """

    def __init__(self, design: SpiralDesign):
        roots = design.roots
        self.shape: Arms = design.arms
        self.centre = _number(self.shape.centre)[:, None]
        self.ends = 1.0 - roots.left, np.roll(1.0 - roots.right, 1, axis=1)  # of every arm, left and right
        self.middle = _number(roots.centre) - self.centre
        contact = (
            self._edge(self.ends[0][..., None], LEFT)[..., 0],
            np.roll(self._edge(self.ends[1][..., None], RIGHT)[..., 0], -1, axis=1),
        )
        spokes = [p - self.middle for p in contact]
        inwards = sum(s / np.abs(s) for s in spokes)
        self.corner = self.middle + roots.fillet * inwards / np.abs(inwards)
        start = self.corner - self.middle
        # of every slot, from the hub's corner to the left edge of its first arm, and to the right edge of its second
        self.angle = [np.angle(s / start) for s in spokes]
        beside = np.abs(self.angle[0]), np.roll(np.abs(self.angle[1]), 1, axis=1)
        speed = [self._speed(u[..., None])[..., 0] for u in self.ends]
        fillets = roots.fillet, np.roll(roots.fillet, 1, axis=1)
        self.arc = [r * a / s for r, a, s in zip(fillets, beside, speed)]
        outer = np.maximum(*self.ends)
        width = width_at(self.shape, 1.0 - outer[..., None])[0][..., 0]
        self.left_start = outer + np.minimum(BESIDE * width / speed[1], 0.4 * (1.0 - outer))
        self.right_start = self.ends[1] - self.arc[1]
        self.start = 0.5 * (self.left_start + self.right_start)
        self.skew = 0.5 * (self.right_start - self.left_start)
        # the first section is skewed; the skew fades as fast as both sides can still run outwards
        self.power = np.clip(0.6 * (1.0 - self.start) / np.maximum(np.abs(self.skew), 1e-12), 1.0, 4.0)

    def _edge(self, u: np.ndarray, side: float) -> Complex[np.ndarray, "spirals 4 points"]:
        return _number(edge_points(self.shape, 1.0 - u, side)[0]) - self.centre[..., None]

    def _speed(self, u: np.ndarray) -> Float[np.ndarray, "spirals 4 points"]:
        return np.linalg.norm(centre_line(self.shape, 1.0 - u)[1], axis=-1)

    def lag(self, u: Float[np.ndarray, "spirals 4 points"]) -> Float[np.ndarray, "spirals 4 points"]:
        """How much further out a section at u lies on the right than in the middle."""
        share = np.clip((1.0 - u) / (1.0 - self.start[..., None]), 0.0, 1.0)
        return self.skew[..., None] * share ** self.power[..., None]

    def left(self, u: Float[np.ndarray, "spirals 4 points"]) -> Complex[np.ndarray, "spirals 4 points"]:
        end, arc = self.ends[0][..., None], self.arc[0][..., None]
        return self._side(u, end, arc, LEFT, self.corner, self.middle, self.angle[0])

    def right(self, u: Float[np.ndarray, "spirals 4 points"]) -> Complex[np.ndarray, "spirals 4 points"]:
        end, arc = self.ends[1][..., None], self.arc[1][..., None]
        slot = (np.roll(x, 1, axis=1) for x in (self.corner, self.middle, self.angle[1]))
        return self._side(u, end, arc, RIGHT, *slot)

    def _side(
        self,
        u: np.ndarray,
        end: np.ndarray,
        arc: np.ndarray,
        side: float,
        corner: np.ndarray,
        middle: np.ndarray,
        angle: np.ndarray,
    ) -> Complex[np.ndarray, "spirals 4 points"]:
        share = np.clip(1.0 - (end - u) / arc, 0.0, 1.0)
        turned = (corner - middle)[..., None] * np.exp(1j * angle[..., None] * share)
        return np.where(u >= end, self._edge(np.maximum(u, end), side), middle[..., None] + turned)

    def stations(self, resolution: Resolution) -> Float[np.ndarray, "spirals 4 boundaries"]:
        """u of the boundaries of the pieces, even in length and turn together, finer at the hub and in the blended end."""
        u = self.start[..., None] + (1.0 - self.start[..., None]) * np.linspace(0.0, 1.0, SAMPLES)
        step = np.diff(u)
        velocity = _number(centre_line(self.shape, 1.0 - u)[1])
        speed = np.abs(velocity)
        turning = np.abs(np.gradient(np.unwrap(np.angle(velocity), axis=-1), axis=-1)) / np.gradient(u, axis=-1)
        length = resolution.length * width_at(self.shape, 1.0 - u)[0]
        grade = resolution.root + (1.0 - resolution.root) * np.minimum(_sums(speed, step) / length, 1.0)
        density = np.maximum(speed / length, turning / resolution.turn) / grade
        share = self.shape.share[..., None]
        density = np.maximum(density, np.where(u >= 1.0 - share, resolution.blend / share, 0.0))
        count = _sums(density, step)
        pieces = max(2, int(np.ceil(count[..., -1].max())))
        out = np.empty((*self.start.shape, pieces + 1))
        for f, k in np.ndindex(self.start.shape):
            out[f, k] = np.interp(np.linspace(0.0, count[f, k, -1], pieces + 1), count[f, k], u[f, k])
        return out


def _sums(values: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Integrals up to every sample, by trapezia."""
    parts = 0.5 * (values[..., 1:] + values[..., :-1]) * step
    return np.concatenate([np.zeros_like(values[..., :1]), np.cumsum(parts, axis=-1)], axis=-1)


def _hub(rails: _Rails, share: Float[np.ndarray, " nodes"]) -> Complex[np.ndarray, "spirals 4 nodes nodes"]:
    """Nodes of the hubs' quarters; where one would be badly bent, its outer side's second node gives way."""
    begin = rails.ends[0] - rails.arc[0]
    reach = rails.left_start - begin
    out = _quarters(rails, begin, reach, rails.arc[0], share)
    least = _roundness(out)
    for at in GIVES_WAY:
        other = _quarters(rails, begin, reach, at * reach, share)
        found = _roundness(other)
        better = (least < BENT) & (found > least)
        out = np.where(better[..., None, None], other, out)
        least = np.where(better, found, least)
    return out


def _roundness(quarters: Complex[np.ndarray, "spirals blocks nodes nodes"]) -> Float[np.ndarray, "spirals blocks"]:
    """Least Jacobian of blocks of elements over their mean; an element folds where it is negative."""
    places = np.linspace(0.0, 1.0, 9)
    value, slope = lagrange(places)
    pieces = quarters.shape[-1] // 3
    least, total = np.full(quarters.shape[:2], np.inf), np.zeros(quarters.shape[:2])
    for i, j in np.ndindex(pieces, pieces):
        block = quarters[:, :, 3 * i : 3 * i + 4, 3 * j : 3 * j + 4]
        jacobian = ((slope @ block @ value.T).conj() * (value @ block @ slope.T)).imag
        least, total = np.minimum(least, jacobian.min(axis=(2, 3))), total + jacobian.mean(axis=(2, 3))
    return least * pieces**2 / total


def _quarters(
    rails: _Rails, begin: np.ndarray, reach: np.ndarray, arc: np.ndarray, share: Float[np.ndarray, " nodes"]
) -> Complex[np.ndarray, "spirals 4 nodes nodes"]:
    """Coons patches between the middle of the hub's corners, the corner on the right of arm k, the left end of its first
    section and the corner on its left; the side between the last two begins at u = ``begin`` and passes ``arc`` further on at
    its second node.
    """
    middle = rails.corner.mean(axis=1)[:, None]
    top = rails.left(_past_fillet(begin, reach, arc, share)) - middle[..., None]
    spoke = _spokes(rails.corner - middle, rails.middle - middle, share)
    right = np.roll(spoke, 1, axis=1)
    left_corner, right_corner, left = spoke[..., -1:, None], right[..., -1:, None], top[..., -1:, None]
    across, along = share[None, :], share[:, None]
    outer = right_corner * (1.0 - across) + left * across
    bilinear = (1.0 - across) * right_corner * along + across * (left_corner * (1.0 - along) + left * along)
    sides = (1.0 - across) * right[..., None] + across * top[..., None]
    return middle[..., None, None] + sides + (1.0 - along) * spoke[..., None, :] + along * outer - bilinear


def _past_fillet(begin: np.ndarray, reach: np.ndarray, arc: np.ndarray, share: np.ndarray) -> np.ndarray:
    """u at shares of the way from ``begin``, on the parabola through both ends that passes the fillet's end at the second node."""
    at, x = np.clip(arc / reach, *ARC_END), LOBATTO[1]
    square = ((at - x) / (x * (x - 1.0)))[..., None]
    return begin[..., None] + reach[..., None] * (share + square * share * (share - 1.0))


def _spokes(corner: np.ndarray, fillet: np.ndarray, t: np.ndarray) -> Complex[np.ndarray, "spirals 4 nodes"]:
    """Lines from the middle, 0, to the hub's corners, which they meet half way between straight and square to the fillet."""
    inwards = fillet - corner
    arrival = np.abs(corner) * 0.5 * (inwards / np.abs(inwards) + corner / np.abs(corner))
    corner, arrival = corner[..., None], arrival[..., None]
    return corner * (3 * t**2 - 2 * t**3) + corner * (t - 2 * t**2 + t**3) + arrival * (t**3 - t**2)


def _number(pairs: np.ndarray) -> np.ndarray:
    return pairs[..., 0] + 1j * pairs[..., 1]
