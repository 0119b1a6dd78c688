"""The rim as a bendable mesh: one plate per node, with its neck and holes, reaching half way to the adjacent nodes.

Plates are triangulated in coordinates of the straightened strip: s along the strip's centre line from the node, y
outwards. In the elastic model a node has arms like a hub: one forwards and one backwards along the strip, and the neck.
The points of its plate follow these arms (``mechanics.arms.bent``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Float, Int
from ..mechanics.arms.bent import BentArms
from ..mechanics.rim_bodies import BACKWARDS, FORWARDS, NECK
from ..mechanics.vectors import matvec, to_space
from ..spirals.design import SpiralDesign
from ..spirals.rim import Rim
from ..triangulation import triangulate

MAX_EDGE = 0.002  # largest distance between points along an edge, metres; smaller: smoother, slower; chosen by eye
POINTS_PER_QUARTER = 6  # number of points on a quarter of a hole's circle; larger: smoother, slower; chosen by eye


@dataclass(frozen=True, eq=False)
class RimMesh:
    """Points of all plates on the mid-surface, and triangles between them; lengths in metres.

    rim : the rim; half_necks : half width of each node's neck, never 0
    node : node of every point; strip_points : s and y of every point
    arm : arm of the bent piece that every point follows, as 4 body + arm, bodies being the hubs and then the nodes
    t : parameter along that arm
    line, side : vectors in the flat panel from the node's centre to the arm's centre line, and from there to the point
    centre : position of every point's node in the flat panel
    quad : quad of every point
    triangles : triangles of the upper side, counter-clockwise
    walls : edges of the plates, with the material on the left
    """

    rim: Rim
    half_necks: Float[np.ndarray, " nodes"]
    node: Int[np.ndarray, " points"]
    strip_points: Float[np.ndarray, "points 2"]
    arm: Int[np.ndarray, " points"]
    t: Float[np.ndarray, " points"]
    line: Float[np.ndarray, "points 3"]
    side: Float[np.ndarray, "points 3"]
    centre: Float[np.ndarray, "points 3"]
    quad: Int[np.ndarray, " points"]
    triangles: Int[np.ndarray, "triangles 3"]
    walls: Int[np.ndarray, "walls 2"]

    @classmethod
    def from_design(cls, design: SpiralDesign) -> RimMesh | None:
        """Build the plates of a design's rim; None if it has no rim."""
        rim = design.rim
        if rim is None:
            return None
        necks = _half_neck_widths(design, rim)
        parts, first = [], 0
        for node in range(len(rim.quad)):
            points, triangles, walls = _triangulate_plate(rim, node, float(necks[node]))
            parts.append((np.full(len(points), node), points, first + triangles, first + walls))
            first += len(points)
        of, plane, triangles, walls = (np.concatenate(column) for column in zip(*parts, strict=True))
        arm, t, line, side = _arm_coordinates(rim, of, plane)
        arm += 4 * (len(design.width) + of)
        centre, quad = to_space(rim.centre)[of], rim.quad[of]
        return cls(rim, necks, of, plane, arm, t, line, side, centre, quad, triangles, walls)

    def with_necks_of(self, design: SpiralDesign) -> RimMesh:
        """Return a copy with necks as wide as the arms of another design that has this rim, and the same faces.

        Points on the strip's inner edge beside a neck move in proportion to make room.
        """
        necks = _half_neck_widths(design, self.rim)
        s, y = self.strip_points.T
        old, new, reach = self.half_necks[self.node], necks[self.node], self.rim.reach[self.node, (s < 0.0).astype(int)]
        way = np.abs(s)
        beyond = new + (way - old) * (reach - new) / np.maximum(reach - old, 1e-12)
        moved = np.where(way <= old, way * new / old, np.where(way < reach, beyond, way))
        inner = y < -0.5 * self.rim.width + 1e-9
        plane = np.column_stack([np.where(inner, np.sign(s) * moved, s), y])
        _, t, line, side = _arm_coordinates(self.rim, self.node, plane)
        return replace(self, half_necks=necks, strip_points=plane, t=t, line=line, side=side)

    def points_at_pose(self, arms: BentArms) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
        """Return the points on the mid-surface in space, metres, and the upward normals there."""
        place, turn = arms.at(self.arm, self.t, self.line)
        return place + matvec(turn, self.side), turn[:, :, 2]

    @property
    def flat_points(self) -> Float[np.ndarray, "points 3"]:
        """Points on the mid-surface of the flat panels, in the patches' frames, metres."""
        return self.centre + self.line + self.side

    def faces(self, base: int) -> tuple[list[np.ndarray], Int[np.ndarray, " faces"]]:
        """Return the faces above, below and at the edges, and the quad of every face.

        base : index of the first vertex; the upper and lower vertices of the points alternate
        """
        above = base + 2 * self.triangles
        a, b = base + 2 * self.walls.T
        walls = np.stack([a + 1, b + 1, b, a], axis=1)
        of = self.quad[self.triangles[:, 0]]
        return [above, above[:, ::-1] + 1, walls], np.concatenate([of, of, self.quad[self.walls[:, 0]]])


def _triangulate_plate(rim: Rim, node: int, half: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangulate the plate of a node, whose neck has the half width ``half``, metres.

    Returns
    -------
    points (n, 2): s and y; triangles; edges, as in ``RimMesh``
    """
    import shapely

    ahead, behind = rim.reach[node].tolist()
    wide = 0.5 * rim.width
    shape = shapely.box(-behind, -wide, ahead, wide).union(shapely.box(-half, -wide - rim.depth, half, -wide))
    # the ends of an open strip are round
    for k, (long, sign) in enumerate(((ahead, 1.0), (behind, -1.0))):
        if rim.overhang[node, k]:
            radius = max(min(wide, long - half), 0.0)
            rest = shapely.box(min(0.0, sign * (long - radius)), -wide, max(0.0, sign * (long - radius)), wide)
            tip = rest.buffer(radius, quad_segs=2 * POINTS_PER_QUARTER).intersection(
                shapely.box(-behind, -wide, ahead, wide)
            )
            shape = shape.intersection(
                tip.union(
                    shapely.box(-behind if sign > 0 else -half, -wide - rim.depth, half if sign > 0 else ahead, wide)
                )
            )
    holes = [
        shapely.Point(s, 0.0).buffer(0.5 * rim.hole_diameter, quad_segs=POINTS_PER_QUARTER)
        for s in _hole_positions(rim, node)
    ]
    shape = shape.difference(shapely.union_all(holes)).segmentize(MAX_EDGE)
    rings = [shape.exterior, *shape.interiors]
    points = np.concatenate([shapely.get_coordinates(ring)[:-1] for ring in rings])
    triangles = triangulate([shape], points)
    # the edges of the plate are the edges of only one triangle
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    known = {(a, b) for a, b in edges.tolist()}
    walls = np.array([(a, b) for a, b in edges.tolist() if (b, a) not in known])
    # y points to the right of s, so the plate is seen from below
    return points, triangles[:, ::-1], walls[:, ::-1]


def _hole_positions(rim: Rim, node: int) -> Float[np.ndarray, " holes"]:
    """Return the coordinate s of the centre of every hole that may reach into a node's plate, also beyond its ends."""
    found = []
    for sign, other in ((1.0, node), (-1.0, int(rim.previous_node[node]))):
        if other >= 0 and rim.hole_count[other]:
            count, long = int(rim.hole_count[other]), float(rim.length[other])
            found.append(sign * (np.arange(count) + 0.5) / count * long)
    for k, sign in ((0, 1.0), (1, -1.0)):
        if rim.end_hole_distances[node, k]:
            found.append(np.array([sign * rim.end_hole_distances[node, k]]))
    return np.concatenate(found) if found else np.empty(0)


def _half_neck_widths(design: SpiralDesign, rim: Rim) -> Float[np.ndarray, " nodes"]:
    """Return the half width of every neck, metres."""
    return 0.5 * design.arms.joint_width[rim.quad, rim.side]


def _arm_coordinates(
    rim: Rim, node: Int[np.ndarray, " n"], points: Float[np.ndarray, "n 2"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the arm that each point of a plate follows, and t, line and side, as in ``RimMesh``.

    node : node of every point
    points : s and y of every point
    """
    s, y = points.T
    ahead, behind = rim.reach[node].T
    middle, way = np.zeros(len(s), dtype=complex), np.zeros(len(s), dtype=complex)
    for back, where in ((False, s >= 0.0), (True, s < 0.0)):
        middle[where], way[where] = rim.vectors_along_strip(node[where], back, np.abs(s[where]))
    neck = y < -0.5 * rim.width - 1e-9
    arm = np.where(neck, NECK, np.where(s >= 0.0, FORWARDS, BACKWARDS))
    reach = np.where(neck, rim.depth + 0.5 * rim.width, np.where(s >= 0.0, ahead, behind))
    gone = np.where(neck, -y, np.abs(s))
    line = np.where(neck, y * rim.outwards[node], middle)
    side = np.where(neck, s * rim.along[node], -1j * way * y)
    return arm, 1.0 - np.clip(gone / reach, 0.0, 1.0), to_space(line), to_space(side)
