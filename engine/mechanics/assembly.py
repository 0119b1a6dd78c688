"""Spirals and the joints between them as arrays: the input of the elastic models.

A spiral is a rigid hub with four elastic arms (FlexMaps section 6.1). Two arms meet rigidly at a joint. At rest every
hub lies in the plane of its own flat patch. For a joint across a seam, the rest position is stored in both patches, so
no common rest shape is needed.
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
from .rim_bodies import BACKWARDS, FORWARDS, NECK, RimJoints
from .vectors import nearest_rotation


@dataclass(frozen=True, eq=False)
class Pose:
    """Positions and rotations of n hubs.

    centres : (n, 3) metres
    rotations : (n, 3, 3) from the flat frame of a hub's patch (x and y in its plane, z its outer normal) to space
    nodes : poses of the rim's nodes relative to their hubs; None without a rim, or before they are computed
    """

    centres: Float[np.ndarray, "spirals 3"]
    rotations: Float[np.ndarray, "spirals 3 3"]
    nodes: RimNodes | None = None

    def moved(self, step: np.ndarray) -> Pose:
        """Return the pose after the increments ``step``.

        step : (n, 6) shift (3, metres) and rotation vector (3, radians) of every hub, in space. Rows for the rim's
            nodes may follow; without them the nodes move with their hubs
        """
        n = len(self.centres)
        moved = Pose(self.centres + step[:n, :3], Rotation.from_rotvec(step[:n, 3:]).as_matrix() @ self.rotations)
        if self.nodes is None or len(step) == n:
            return replace(moved, nodes=self.nodes)
        there = self.whole
        nodes = Pose(there.centres[n:], there.rotations[n:]).moved(step[n:])
        return replace(moved, nodes=RimNodes.from_poses(moved, self.nodes.hub, nodes))

    @cached_property
    def whole(self) -> Pose:
        """The pose of hubs and nodes: the rim's nodes are appended to the arrays of the hubs, in space."""
        if self.nodes is None:
            return self
        hub, frame = self.nodes.hub, self.rotations[self.nodes.hub]
        centres = self.centres[hub] + np.einsum("nij,nj->ni", frame, self.nodes.centres)
        turns = frame @ self.nodes.rotations
        return Pose(np.concatenate([self.centres, centres]), np.concatenate([self.rotations, turns]))

    def transform(self, rotation: Float[np.ndarray, "3 3"], shift: np.ndarray) -> Pose:
        """Return the pose after a rigid motion of the whole piece.

        Parameters
        ----------
        rotation : (3, 3) rotation about the origin, first
        shift : (3,) then a shift, metres
        """
        return Pose(self.centres @ rotation.T + shift, rotation @ self.rotations, self.nodes)

    def part(self, hubs: Int[np.ndarray, " some"]) -> Pose:
        """Return the poses of the k hubs with the indices ``hubs``, with their rim nodes."""
        return Pose(self.centres[hubs], self.rotations[hubs], None if self.nodes is None else self.nodes.part(hubs))

    def with_part(self, hubs: Int[np.ndarray, " some"], part: Pose) -> Pose:
        """Return a copy in which k hubs have new poses; the rim's nodes move with their hubs.

        Parameters
        ----------
        hubs : (k,) indices of the hubs
        part : their new poses
        """
        centres, rotations = self.centres.copy(), self.rotations.copy()
        centres[hubs], rotations[hubs] = part.centres, part.rotations
        return replace(self, centres=centres, rotations=rotations)

    def aligned_to(self, centres: Float[np.ndarray, "spirals 3"]) -> Pose:
        """Return the pose after the rigid motion that brings its centres closest to ``centres`` (Procrustes).

        centres : (n, 3) metres
        """
        rotation = nearest_rotation((self.centres - self.centres.mean(axis=0)).T @ (centres - centres.mean(axis=0)))
        return self.transform(rotation, centres.mean(axis=0) - rotation @ self.centres.mean(axis=0))


@dataclass(frozen=True, eq=False)
class RimNodes:
    """Poses of a rim's b nodes relative to their hubs.

    hub : (b,) index of every node's hub
    centres : (b, 3) metres, in the frames of the hubs
    rotations : (b, 3, 3) relative to the hubs
    """

    hub: Int[np.ndarray, " nodes"]
    centres: Float[np.ndarray, "nodes 3"]
    rotations: Float[np.ndarray, "nodes 3 3"]

    @classmethod
    def from_poses(cls, pose: Pose, hub: np.ndarray, there: Pose) -> RimNodes:
        """Convert poses of nodes in space to poses relative to their hubs.

        Parameters
        ----------
        pose : of the hubs
        hub : (b,) index of every node's hub
        there : poses of the nodes in space
        """
        back = np.swapaxes(pose.rotations[hub], 1, 2)
        return cls(hub, np.einsum("nij,nj->ni", back, there.centres - pose.centres[hub]), back @ there.rotations)

    @classmethod
    def at_rest(cls, hub: np.ndarray, offset: Float[np.ndarray, "nodes 3"]) -> RimNodes:
        """Return the nodes at rest, in the flat sheet.

        Parameters
        ----------
        hub, offset : (b,) index of every node's hub, and (b, 3) vectors from the hubs to the nodes, metres
        """
        return cls(hub, offset, np.broadcast_to(np.eye(3), (len(hub), 3, 3)))

    def part(self, hubs: Int[np.ndarray, " some"]) -> RimNodes:
        """Return the nodes of the hubs with the indices ``hubs``; ``hub`` of the result is a position in ``hubs``."""
        number = np.full(max(int(self.hub.max(initial=-1)), int(np.max(hubs, initial=-1))) + 1, -1)
        number[hubs] = np.arange(len(hubs))
        kept = number[self.hub] >= 0
        return RimNodes(number[self.hub[kept]], self.centres[kept], self.rotations[kept])


@dataclass(frozen=True)
class CutSettings:
    """Settings of how arms are cut.

    blend : length of the shortest blends, in t
    fillet : radius of the fillets at the hubs, metres
    """

    blend: float
    fillet: float


@dataclass(frozen=True, eq=False)
class Assembly:
    """n spirals and m joints at rest.

    pairs : (m, 2) indices of the two spirals of every joint
    sides : (m, 2) indices (0 to 3) of the arms of these spirals that meet at the joint
    lever : (m, 2, 3) vectors from the centres of both spirals to the joint, metres, each in the flat frame of its
        spiral's patch
    axes : (m, 2, 3, 3) axes of the joint as columns: across the shared edge from the first spiral to the second, along
        the edge, normal. They are given in the flat frames of both spirals' patches; in the joined piece they coincide
    width : (n, 4) widths of every spiral's arms, metres
    twist : (n,) radians
    thickness : of the sheet, metres
    clockwise : True if the arms turn clockwise from the tips inwards
    cut : how the arms are cut; None for pure spirals with the fillets of the stiffness table
    grain : angle from the x axes of the flat patches to the sheet's grain, radians; unused for sheets without a grain
    rim : nodes of the rim and their joints; None without a rim
    nodes : number of rim nodes in the arrays. ``whole`` appends the nodes to the spirals and the rim's joints to the
        joints; before that, it is 0
    """

    pairs: Int[np.ndarray, "joints 2"]
    sides: Int[np.ndarray, "joints 2"]
    lever: Float[np.ndarray, "joints 2 3"]
    axes: Float[np.ndarray, "joints 2 3 3"]
    width: Float[np.ndarray, "spirals 4"]
    twist: Float[np.ndarray, " spirals"]
    thickness: float
    clockwise: bool = False
    cut: CutSettings | None = None
    grain: float = 0.0
    rim: RimJoints | None = None
    nodes: int = 0

    @property
    def size(self) -> int:
        """Number of bodies: the spirals and the rim's nodes that are appended to them."""
        return len(self.width)

    @property
    def spirals(self) -> int:
        """Number of spirals; the rim's nodes are not counted."""
        return self.size - self.nodes

    @property
    def n_inner_joints(self) -> int:
        """Number of joints outside the rim."""
        return len(self.pairs) - (self.nodes + len(self.rim.pairs) if self.nodes and self.rim is not None else 0)

    @property
    def tie_joints(self) -> slice:
        """Slice of the joints between an arm at the border and the neck of a rim's node."""
        return slice(self.n_inner_joints, self.n_inner_joints + self.nodes)

    @cached_property
    def hub_pairs(self) -> Int[np.ndarray, "joints 2"]:
        """``pairs`` with the indices of rim nodes replaced by those of the hubs to which their necks lead."""
        if not self.nodes or self.rim is None:
            return self.pairs
        node = np.clip(self.pairs - self.spirals, 0, None)
        return np.where(self.pairs >= self.spirals, self.rim.hub[node], self.pairs)

    @cached_property
    def whole(self) -> Assembly:
        """The assembly with the rim's nodes appended to the spirals and the rim's joints to the joints.

        An assembly without a rim is returned unchanged. The appended joints are first the ``tie_joints``, then those
        between neighbouring nodes (the strips).
        """
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
    def without_rim(self) -> Assembly:
        """The assembly without its rim: the inverse of ``whole``, but with ``rim`` None."""
        m, n = self.n_inner_joints, self.spirals
        parts = {name: getattr(self, name)[:m] for name in ("pairs", "sides", "lever", "axes")}
        return replace(self, **parts, width=self.width[:n], twist=self.twist[:n], rim=None, nodes=0)

    @property
    def without_strips(self) -> Assembly:
        """``whole`` without the strips, which are the joints between two rim nodes."""
        whole = self.whole
        if whole.rim is None:
            return whole
        parts = {name: getattr(whole, name)[: whole.tie_joints.stop] for name in ("pairs", "sides", "lever", "axes")}
        return replace(whole, **parts, rim=whole.rim.without_strips)

    @cached_property
    def arm_width(self) -> Float[np.ndarray, "joints 2"]:
        """Widths (m, 2) of both arms of every joint, metres."""
        return self.width[self.pairs, self.sides]

    @cached_property
    def radius(self) -> Float[np.ndarray, "joints 2"]:
        """Distances (m, 2) from the centres of both spirals to the joint, metres."""
        return np.linalg.norm(self.lever, axis=2)

    @cached_property
    def radial(self) -> Float[np.ndarray, "joints 2 3 3"]:
        """Unit vectors of both arms of every joint, as columns (m, 2, 3, 3), in the joint's axes.

        Column 0 points along the arm's radius outwards, column 1 to its left, column 2 along the normal.
        """
        out = np.einsum("ekji,ekj->eki", self.axes, self.lever) / self.radius[..., None]
        normal = np.broadcast_to([0.0, 0.0, 1.0], out.shape)
        return np.stack([out, np.cross(normal, out), normal], axis=3)

    @cached_property
    def arm_axes(self) -> Float[np.ndarray, "joints 2 6 6"]:
        """Matrices (m, 2, 6, 6) that rotate motions or wrenches from the own axes of both arms to the joint's axes.

        The own axes are the columns of ``radial``. For arms that wind clockwise the second axis points to the right,
        and turns and moments have the signs of the mirror image.
        """
        out = np.zeros((*self.pairs.shape, 6, 6))
        out[..., :3, :3] = out[..., 3:, 3:] = self.radial
        return out * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0]) if self.clockwise else out

    @property
    def grain_angles(self) -> Float[np.ndarray, "joints 2"]:
        """Angles (m, 2) from the arms' radii to the grain, radians, positive to the side to which arms wind inwards."""
        return (self.grain - np.arctan2(self.lever[..., 1], self.lever[..., 0])) * (-1.0 if self.clockwise else 1.0)

    @cached_property
    def lever_normals(self) -> Float[np.ndarray, "joints 2 3"]:
        """The vectors ``lever`` rotated by a right angle in the sheet, to the side to which the arms wind inwards."""
        return np.cross([0.0, 0.0, 1.0], self.lever) * (-1.0 if self.clockwise else 1.0)

    @cached_property
    def bend_points(self) -> tuple[Float[np.ndarray, "joints 2 2"], Float[np.ndarray, "joints 2 2"]]:
        """Bend points (m, 2, 2) of both arms of every joint, and their derivatives by the twists, as ``bend_point``."""
        value, slope = (found[self.pairs] for found in bend_point(self.twist))
        if self.nodes:
            # in a joint between an arm and a rim's neck only the arm bends, because necks are very stiff: share is 1
            ties = self.tie_joints
            value[ties, 0], slope[ties, 0] = bend_point(self.twist[self.pairs[ties, 0]], 1.0)
            value[ties, 1], slope[ties, 1], slope[ties.stop :] = [1.0, 0.0], 0.0, 0.0
        return value, slope

    def part(self, hubs: np.ndarray, joints: Int[np.ndarray, " j"]) -> Assembly:
        """Return the assembly of k spirals and of j joints between them.

        Parameters
        ----------
        hubs : (k,) indices of the spirals; they get the new indices 0 to k - 1 in this order
        joints : (j,) indices of the joints
        """
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

    def with_spirals(self, width: np.ndarray, twist: np.ndarray) -> Assembly:
        """Return a copy with other spirals.

        Parameters
        ----------
        width, twist : (n, 4) widths of the arms, metres, and (n,) twists, radians
        """
        return replace(self, width=width, twist=twist)


def assembly_from_design(design: SpiralDesign) -> Assembly:
    """Build the assembly of a design: one joint per edge between two quads, within patches and across seams.

    A quad that shares no edge becomes a spiral without a joint. Raises FlexMapsError, with all quads as its ``faces``,
    if no two quads share an edge.
    """
    mesh, corners = design.flat.layout.mesh, design.flat.corners
    inner = ~mesh.border
    pairs = mesh.edge_quads[inner]
    if not len(pairs):
        every = np.arange(len(mesh.quads))
        raise FlexMapsError("No quad is joined to another quad, so nothing can bend; join some quads", faces=every)
    lever, axes = rest_joints(mesh, corners)
    p = design.params
    cut, sides = CutSettings(p.blend, p.fillet), mesh.edge_sides[inner]
    rim = None if design.rim is None else RimJoints.from_rim(design.rim, corners.mean(axis=1))
    return Assembly(pairs, sides, lever, axes, design.width, design.twist, p.thickness, p.clockwise, cut, p.grain, rim)


def rest_joints(mesh: QuadMesh, corners: Float[np.ndarray, "quads 4 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Return levers and axes of the joints between flat quads.

    Parameters
    ----------
    mesh : the quads; it has a joint on each of its edges between two quads, in the order of the edges
    corners : (F, 4, 2) corners of the flat quads, metres

    Returns
    -------
    (m, 2, 3) and (m, 2, 3, 3) : ``lever`` and ``axes`` of ``Assembly``
    """
    inner = ~mesh.border
    pairs, sides = mesh.edge_quads[inner], mesh.edge_sides[inner]
    centre, ends = corners.mean(axis=1), np.roll(corners, -1, axis=1)
    start, end = corners[pairs, sides], ends[pairs, sides]
    lever = np.zeros((*pairs.shape, 3))
    lever[..., :2] = 0.5 * (start + end) - centre[pairs]
    along = np.zeros_like(lever)
    along[..., :2] = (end - start) / np.linalg.norm(end - start, axis=2, keepdims=True)
    # the sides of both quads run along their common edge in opposite directions; both axes follow the first quad's side
    along[:, 1] *= -1.0
    normal = np.broadcast_to([0.0, 0.0, 1.0], along.shape)
    axes = np.stack([np.cross(along, normal), along, normal], axis=3)
    return lever, axes


def target_pose(mesh: QuadMesh, corners: Float[np.ndarray, "quads 4 2"]) -> Pose:
    """Return the pose of hubs on a surface.

    Each hub lies at the mean of its quad's corners and is rotated so that the flat quad fits these corners best.

    Parameters
    ----------
    mesh : the surface
    corners : (F, 4, 2) corners of the flat quads, metres
    """
    points = mesh.vertices[mesh.quads]
    flat = np.zeros_like(points)
    flat[..., :2] = corners - corners.mean(axis=1, keepdims=True)
    centres = points.mean(axis=1)
    return Pose(centres, nearest_rotation(np.einsum("fki,fkj->fij", flat, points - centres[:, None])))
