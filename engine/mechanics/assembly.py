"""Spirals and the joints between them as numbers: what the elastic models of the whole object are built from.

A spiral is a rigid hub with four elastic arms (FlexMaps section 6.1). Two arms meet at a joint, rigidly. At rest every
hub lies in the plane of its own patch, so a joint across a seam has a rest state on each of its sides and the whole
needs no rest shape.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..spirals.design import SpiralDesign
from ..surface.mesh import QuadMesh
from .arm_bend import bend_point
from .rim import BACKWARDS, FORWARDS, NECK, RimJoints


@dataclass(frozen=True, eq=False)
class Pose:
    """Where n hubs are.

    centres : (n, 3) metres
    rotations : (n, 3, 3) from the flat frame of a hub's patch (x and y in its plane, z its outer normal) to space
    nodes : where the rim's nodes are, seen from their hubs; None where there are none, or nobody has looked for them yet
    """

    centres: Float[np.ndarray, "spirals 3"]
    rotations: Float[np.ndarray, "spirals 3 3"]
    nodes: Nodes | None = None

    def moved(self, step: np.ndarray) -> Pose:
        """Shifted by step[:, :3] metres and turned by the rotation vectors step[:, 3:] radians, in space, (n, 6).

        Nodes have further rows behind those of the hubs; without such rows they go with their hubs.
        """
        n = len(self.centres)
        moved = Pose(self.centres + step[:n, :3], Rotation.from_rotvec(step[:n, 3:]).as_matrix() @ self.rotations)
        if self.nodes is None or len(step) == n:
            return replace(moved, nodes=self.nodes)
        there = self.whole
        nodes = Pose(there.centres[n:], there.rotations[n:]).moved(step[n:])
        return replace(moved, nodes=Nodes.of(moved, self.nodes.hub, nodes))

    @cached_property
    def whole(self) -> Pose:
        """The hubs and behind them the nodes, as bodies alike."""
        if self.nodes is None:
            return self
        hub, frame = self.nodes.hub, self.rotations[self.nodes.hub]
        centres = self.centres[hub] + np.einsum("nij,nj->ni", frame, self.nodes.centres)
        return Pose(
            np.concatenate([self.centres, centres]), np.concatenate([self.rotations, frame @ self.nodes.rotations])
        )

    def placed(self, rotation: Float[np.ndarray, "3 3"], shift: np.ndarray) -> Pose:
        """The whole turned by rotation (3, 3) and then shifted by (3,) metres."""
        return Pose(self.centres @ rotation.T + shift, rotation @ self.rotations, self.nodes)

    def part(self, hubs: Int[np.ndarray, " some"]) -> Pose:
        """Only these hubs (k,) int."""
        return Pose(self.centres[hubs], self.rotations[hubs], None if self.nodes is None else self.nodes.part(hubs))

    def aligned(self, centres: Float[np.ndarray, "spirals 3"]) -> Pose:
        """The whole moved rigidly so that its centres lie as near as possible to ``centres`` (n, 3) metres (Procrustes)."""
        rotation = nearest_rotation((self.centres - self.centres.mean(axis=0)).T @ (centres - centres.mean(axis=0)))
        return self.placed(rotation, centres.mean(axis=0) - rotation @ self.centres.mean(axis=0))


@dataclass(frozen=True, eq=False)
class Nodes:
    """Where nodes of a rim are, seen from their hubs.

    hub : (b,) int; centres : (b, 3) metres and rotations : (b, 3, 3), in the frames of the hubs
    """

    hub: Int[np.ndarray, " nodes"]
    centres: Float[np.ndarray, "nodes 3"]
    rotations: Float[np.ndarray, "nodes 3 3"]

    @classmethod
    def of(cls, pose: Pose, hub: np.ndarray, there: Pose) -> Nodes:
        """Nodes that are ``there`` in space."""
        back = np.swapaxes(pose.rotations[hub], 1, 2)
        return cls(hub, np.einsum("nij,nj->ni", back, there.centres - pose.centres[hub]), back @ there.rotations)

    @classmethod
    def resting(cls, hub: np.ndarray, offset: Float[np.ndarray, "nodes 3"]) -> Nodes:
        """Nodes as they lie in the flat sheet, at ways (b, 3) metres from their hubs."""
        return cls(hub, offset, np.broadcast_to(np.eye(3), (len(hub), 3, 3)))

    def part(self, hubs: Int[np.ndarray, " some"]) -> Nodes:
        """Those of some hubs, which are numbered anew in this order."""
        number = np.full(max(int(self.hub.max(initial=-1)), int(np.max(hubs, initial=-1))) + 1, -1)
        number[hubs] = np.arange(len(hubs))
        kept = number[self.hub] >= 0
        return Nodes(number[self.hub[kept]], self.centres[kept], self.rotations[kept])


def nearest_rotation(covariance: np.ndarray) -> Float[np.ndarray, "... 3 3"]:
    """(..., 3, 3) the rotation R with the largest trace of R covariance: R p fits q best if covariance = sum of p q^T."""
    u, _, vt = np.linalg.svd(covariance)
    flip = np.linalg.det(u) * np.linalg.det(vt)
    u = u.copy()
    u[..., :, 2] *= flip[..., None]
    return np.swapaxes(u @ vt, -1, -2)


@dataclass(frozen=True)
class Cut:
    """How the arms of an assembly are cut, as in the settings: blend, the share of t over which an arm is blended that hardly
    turns; fillet, metres.
    """

    blend: float
    fillet: float


@dataclass(frozen=True, eq=False)
class Assembly:
    """n spirals and m joints at rest.

    pairs : (m, 2) int, the two spirals of every joint; sides : (m, 2) int, which of their arms meet there
    lever : (m, 2, 3) metres, from the centre of spiral pairs[e, k] to the joint, in the flat frame of its patch
    axes : (m, 2, 3, 3) columns: across the shared edge from the first spiral to the second, along the edge, normal; in the
        flat frame of the patch of spiral pairs[e, k]. The rest directions of both sides coincide at the joint.
    width : (n, 4) metres of every spiral's arms; twist : (n,) radians
    thickness : metres, of the sheet
    clockwise : sense of rotation of the arms, from the tips inwards
    cut : how the arms are cut; None for pure spirals with the fillets of the stiffness table
    grain : radians, from the x axes of the flat patches to the sheet's grain; nothing to sheets without one
    rim : the nodes of the rim and their joints; None without one
    nodes : how many of the spirals, the last ones, are nodes of the rim instead; then its joints are the last ones (see ``whole``)
    """

    pairs: Int[np.ndarray, "joints 2"]
    sides: Int[np.ndarray, "joints 2"]
    lever: Float[np.ndarray, "joints 2 3"]
    axes: Float[np.ndarray, "joints 2 3 3"]
    width: Float[np.ndarray, "spirals 4"]
    twist: Float[np.ndarray, " spirals"]
    thickness: float
    clockwise: bool = False
    cut: Cut | None = None
    grain: float = 0.0
    rim: RimJoints | None = None
    nodes: int = 0

    @property
    def size(self) -> int:
        """Number of spirals."""
        return len(self.width)

    @property
    def spirals(self) -> int:
        """Number of spirals that are none of the rim's nodes."""
        return self.size - self.nodes

    @property
    def inner(self) -> int:
        """Number of joints that are none of the rim's."""
        return len(self.pairs) - (self.nodes + len(self.rim.pairs) if self.nodes and self.rim is not None else 0)

    @property
    def ties(self) -> slice:
        """The joints between arms at the border and the rim's nodes."""
        return slice(self.inner, self.inner + self.nodes)

    @cached_property
    def owners(self) -> Int[np.ndarray, "joints 2"]:
        """``pairs`` with the hubs of the nodes in their place."""
        if not self.nodes or self.rim is None:
            return self.pairs
        node = np.clip(self.pairs - self.spirals, 0, None)
        return np.where(self.pairs >= self.spirals, self.rim.hub[node], self.pairs)

    @cached_property
    def whole(self) -> Assembly:
        """With the rim's nodes as spirals and its joints as joints; the same where there is no rim."""
        rim = self.rim
        if rim is None or self.nodes:
            return self
        n, count, strips = self.size, len(rim.hub), len(rim.pairs)
        own = np.full((count, 4), rim.width)
        own[:, NECK] = self.width[rim.hub, rim.side]
        tied = np.stack([rim.hub, n + np.arange(count)], axis=1)
        sides = np.stack([rim.side, np.full(count, NECK)], axis=1)
        return replace(
            self,
            pairs=np.concatenate([self.pairs, tied, n + rim.pairs]),
            sides=np.concatenate([self.sides, sides, np.broadcast_to([FORWARDS, BACKWARDS], (strips, 2))]),
            lever=np.concatenate([self.lever, rim.lever, rim.strip_lever]),
            axes=np.concatenate([self.axes, rim.axes, rim.strip_axes]),
            width=np.concatenate([self.width, own]),
            twist=np.concatenate([self.twist, np.zeros(count)]),
            nodes=count,
        )

    @property
    def plain(self) -> Assembly:
        """``whole`` without the rim's nodes and joints, and without the rim."""
        m, n = self.inner, self.spirals
        parts = {name: getattr(self, name)[:m] for name in ("pairs", "sides", "lever", "axes")}
        return replace(self, **parts, width=self.width[:n], twist=self.twist[:n], rim=None, nodes=0)

    @property
    def without_strips(self) -> Assembly:
        """``whole`` without the joints between the rim's nodes."""
        whole = self.whole
        if whole.rim is None:
            return whole
        parts = {name: getattr(whole, name)[: whole.ties.stop] for name in ("pairs", "sides", "lever", "axes")}
        return replace(whole, **parts, rim=whole.rim.without_strips)

    @cached_property
    def arm_width(self) -> Float[np.ndarray, "joints 2"]:
        """(m, 2) metres, of both arms of every joint."""
        return self.width[self.pairs, self.sides]

    @cached_property
    def radius(self) -> Float[np.ndarray, "joints 2"]:
        """(m, 2) metres, from the centre to the joint."""
        return np.linalg.norm(self.lever, axis=2)

    @cached_property
    def radial(self) -> Float[np.ndarray, "joints 2 3 3"]:
        """(m, 2, 3, 3) columns: along every arm's radius outwards, to its left, normal; in the joint's axes."""
        out = np.einsum("ekji,ekj->eki", self.axes, self.lever) / self.radius[..., None]
        normal = np.broadcast_to([0.0, 0.0, 1.0], out.shape)
        return np.stack([out, np.cross(normal, out), normal], axis=3)

    @cached_property
    def arm_axes(self) -> Float[np.ndarray, "joints 2 6 6"]:
        """(m, 2, 6, 6): takes shifts and turns, or forces and moments, from every arm's own axes to the joint's.

        Arms that wind clockwise have their second axis to the right: the mirror image of the others.
        """
        out = np.zeros((*self.pairs.shape, 6, 6))
        out[..., :3, :3] = out[..., 3:, 3:] = self.radial
        return out * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0]) if self.clockwise else out

    @property
    def to_grain(self) -> Float[np.ndarray, "joints 2"]:
        """(m, 2) radians from every arm's radius to the grain, to the side to which the arms wind inwards."""
        return (self.grain - np.arctan2(self.lever[..., 1], self.lever[..., 0])) * (-1.0 if self.clockwise else 1.0)

    @cached_property
    def left(self) -> Float[np.ndarray, "joints 2 3"]:
        """(m, 2, 3) metres, the levers turned a quarter in the sheet, to the side to which the arms wind inwards."""
        return np.cross([0.0, 0.0, 1.0], self.lever) * (-1.0 if self.clockwise else 1.0)

    @cached_property
    def bend(self) -> tuple[Float[np.ndarray, "joints 2 2"], Float[np.ndarray, "joints 2 2"]]:
        """Bend points of both arms of every joint, and their derivatives by the twists (see ``arm_bend``)."""
        value, slope = (found[self.pairs] for found in bend_point(self.twist))
        if self.nodes:
            # necks are so stiff that the arm beyond turns alone
            ties = self.ties
            value[ties, 0], slope[ties, 0] = bend_point(self.twist[self.pairs[ties, 0]], 1.0)
            value[ties, 1], slope[ties, 1], slope[ties.stop :] = [1.0, 0.0], 0.0, 0.0
        return value, slope

    def part(self, hubs: np.ndarray, joints: Int[np.ndarray, " j"]) -> Assembly:
        """Some spirals (k,) int, numbered anew in this order, and some of the joints (j,) int between them."""
        number = np.full(self.size, -1)
        number[hubs] = np.arange(len(hubs))
        return replace(
            self,
            pairs=number[self.pairs[joints]],
            sides=self.sides[joints],
            lever=self.lever[joints],
            axes=self.axes[joints],
            width=self.width[hubs],
            twist=self.twist[hubs],
            rim=None if self.rim is None else self.rim.part(hubs),
        )

    def redesigned(self, width: np.ndarray, twist: np.ndarray) -> Assembly:
        """The same joints with other spirals: widths (n, 4) metres and twists (n,) radians."""
        return replace(self, width=width, twist=twist)

    def reshaped(self, lever: np.ndarray, axes: Float[np.ndarray, "joints 2 3 3"]) -> Assembly:
        """The same spirals on another rest geometry: levers (m, 2, 3) metres and axes (m, 2, 3, 3)."""
        return replace(self, lever=lever, axes=axes)


def of_design(design: SpiralDesign) -> Assembly:
    """The assembly of a design: one joint for every edge between two quads, within patches and across seams alike.

    Quads that share an edge with no other are spirals without a joint. Raises FlexMapsError with the faces if all are.
    """
    mesh, corners = design.flat.layout.mesh, design.flat.corners
    inner = ~mesh.border
    pairs = mesh.edge_quads[inner]
    if not len(pairs):
        every = np.arange(len(mesh.quads))
        raise FlexMapsError(
            "No quad is joined to another one, so there is nothing that could bend; join some", faces=every
        )
    lever, axes = rest_joints(mesh, corners)
    p = design.params
    cut, sides = Cut(p.blend, p.fillet), mesh.edge_sides[inner]
    rim = None if design.rim is None else RimJoints.of(design.rim, corners.mean(axis=1))
    return Assembly(pairs, sides, lever, axes, design.width, design.twist, p.thickness, p.clockwise, cut, p.grain, rim)


def rest_joints(mesh: QuadMesh, corners: Float[np.ndarray, "quads 4 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Levers (m, 2, 3) and axes (m, 2, 3, 3) of the joints between flat quads with these corners (F, 4, 2), metres."""
    inner = ~mesh.border
    pairs, sides = mesh.edge_quads[inner], mesh.edge_sides[inner]
    centre, ends = corners.mean(axis=1), np.roll(corners, -1, axis=1)
    start, end = corners[pairs, sides], ends[pairs, sides]
    lever = np.zeros((*pairs.shape, 3))
    lever[..., :2] = 0.5 * (start + end) - centre[pairs]
    along = np.zeros_like(lever)
    along[..., :2] = (end - start) / np.linalg.norm(end - start, axis=2, keepdims=True)
    along[:, 1] *= -1.0  # both copies of the edge are run through in the direction of the first
    normal = np.broadcast_to([0.0, 0.0, 1.0], along.shape)
    axes = np.stack([np.cross(along, normal), along, normal], axis=3)
    return lever, axes


def target_pose(mesh: QuadMesh, corners: Float[np.ndarray, "quads 4 2"]) -> Pose:
    """The hubs on a surface: the middle of every quad, and the rotation that brings its flat corners nearest to it.

    corners : (F, 4, 2) metres, flat
    """
    points = mesh.vertices[mesh.quads]
    flat = np.zeros_like(points)
    flat[..., :2] = corners - corners.mean(axis=1, keepdims=True)
    centres = points.mean(axis=1)
    return Pose(centres, nearest_rotation(np.einsum("fki,fkj->fij", flat, points - centres[:, None])))
