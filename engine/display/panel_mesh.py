"""The panels as a bendable mesh: every arm is a bar with its true rectangular cross-sections, every hub a plate.

The faces are made once per design; the vertices follow from the bent arms of any pose (``mechanics.arms.bent``). The
mesh is built section by section, because triangulating a sheet with thousands of holes would take minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bool, Float, Int
from ..fabrication.connectors.tips import Tip
from ..mechanics.arms.bent import BentArms, hub_edge_of_design
from ..mechanics.assembly import Pose
from ..mechanics.vectors import matvec
from ..progress import SILENT, Progress
from ..spirals.caps import Cap
from ..spirals.curves.spiral import LEFT, RIGHT, centre_line, edge_points, opposite_sides
from ..spirals.design import SpiralDesign
from ..triangulation import triangulate
from .rim_mesh import RimMesh

DRAWING_ARMS = "Drawing the arms"  # text of the progress


@dataclass(frozen=True)
class Detail:
    """Resolution of the panels.

    min_pieces : number of pieces of an arm without twist
    degrees_per_piece : degrees of twist per additional piece
    fillet_points : number of points on the fillet between two arms at the hub
    """

    min_pieces: int
    degrees_per_piece: float
    fillet_points: int


# chosen by eye: COARSE for thousands of spirals in the window, FINE for renderings
DETAILS = {"COARSE": Detail(4, 40.0, 0), "MEDIUM": Detail(6, 20.0, 0), "FINE": Detail(10, 9.0, 2)}


@dataclass(frozen=True, eq=False)
class PanelMesh:
    """Cross-sections of the arms, points of the hubs, and the faces between them; lengths in metres, in the flat panel.

    arm, t : number 4 quad + side of the arm, and parameter along it, of every section
    line : vector from the hub's centre to the middle of every section
    sides : vectors from the section's middle to its left and right edge
    fillet_quad, fillet : quad and position, from the hub's centre, of points on the fillets between two arms
    arm_ends : connectors and caps at arms' ends
    kept_vertices : vertices that are not replaced by shared ones, among 4 per section (left and right above, left and
        right below) and 2 per point of a fillet or connector (above, below)
    corners, sizes, quad_of : vertex of every face corner; number of corners and quad of every face
    vertex_quad, section : quad and section of every vertex
    rim_mesh : plates of the piece's rim, whose vertices come last; None without a rim
    """

    design: SpiralDesign
    arm: Int[np.ndarray, " sections"]
    t: Float[np.ndarray, " sections"]
    line: Float[np.ndarray, "sections 3"]
    sides: Float[np.ndarray, "sections 2 3"]
    fillet_quad: Int[np.ndarray, " rims"]
    fillet: Float[np.ndarray, "rims 3"]
    arm_ends: ArmEnds
    kept_vertices: Int[np.ndarray, " own"]
    corners: Int[np.ndarray, " corners"]
    sizes: Int[np.ndarray, " faces"]
    quad_of: Int[np.ndarray, " faces"]
    vertex_quad: Int[np.ndarray, " vertices"]
    section: Int[np.ndarray, " vertices"]
    rim_mesh: RimMesh | None = None

    @property
    def triangle_count(self) -> int:
        """Number of triangles, if all faces were triangulated."""
        return int((self.sizes - 2).sum())

    def vertices_at_pose(
        self, arms: BentArms, pose: Pose, only: Bool[np.ndarray, " quads"] | None = None
    ) -> np.ndarray:
        """Return the vertices in space, (V, 3) metres.

        Parameters
        ----------
        arms, pose : bent arms; pose of the hubs
        only : mask of the quads whose vertices are needed; other vertices are undefined
        """
        wanted = np.ones(len(self.design.width), bool) if only is None else only
        rows, rims, points = wanted[self.arm // 4], wanted[self.fillet_quad], wanted[self.arm_ends.arm // 4]
        place, turn = arms.at(self.arm[rows], self.t[rows], self.line[rows])
        edges, up = np.zeros((len(self.arm), 2, 3)), np.zeros((len(self.arm), 3))
        edges[rows], up[rows] = place[:, None] + self.sides[rows] @ np.swapaxes(turn, 1, 2), turn[:, :, 2]
        alone, alone_up = np.zeros((2, len(self.fillet_quad) + len(self.arm_ends.arm), 3))
        rim_quad, heads, later = self.fillet_quad[rims], self.arm_ends, len(self.fillet_quad) + np.flatnonzero(points)
        alone[: len(rims)][rims] = pose.centres[rim_quad] + matvec(pose.rotations[rim_quad], self.fillet[rims])
        alone_up[: len(rims)][rims] = pose.rotations[rim_quad, :, 2]
        head, head_turn = arms.at(heads.arm[points], heads.t[points], heads.line[points])
        alone[later], alone_up[later] = head + matvec(head_turn, heads.side[points]), head_turn[:, :, 2]
        made = self._thicken(edges, up, alone, alone_up)
        return (
            made
            if self.rim_mesh is None
            else np.concatenate([made, self._rim_vertices(*self.rim_mesh.points_at_pose(arms))])
        )

    def flat_vertices(self, centres: Float[np.ndarray, "patches 2"]) -> Float[np.ndarray, "vertices 3"]:
        """Return the vertices of the flat panels, metres, with patch origins at ``centres``, mid-plane at z = 0."""
        shape = np.zeros((len(self.design.width), 3))
        shape[:, :2] = self.design.arms.centre + centres[self.design.flat.layout.patch_of]
        up = np.array([0.0, 0.0, 1.0])
        edges = (shape[self.arm // 4] + self.line)[:, None] + self.sides
        heads = shape[self.arm_ends.arm // 4] + self.arm_ends.line + self.arm_ends.side
        made = self._thicken(edges, up, np.concatenate([shape[self.fillet_quad] + self.fillet, heads]), up)
        if self.rim_mesh is None:
            return made
        moved = centres[self.design.flat.layout.patch_of[self.rim_mesh.quad]]
        return np.concatenate(
            [made, self._rim_vertices(self.rim_mesh.flat_points + np.c_[moved, np.zeros(len(moved))], up)]
        )

    def _rim_vertices(self, points: np.ndarray, up: np.ndarray) -> Float[np.ndarray, "vertices 3"]:
        """Return points of the mid-surface moved by half the thickness along ``up`` and against it, in turn."""
        lift = 0.5 * self.design.params.thickness * np.broadcast_to(up, points.shape)
        return np.stack([points + lift, points - lift], axis=1).reshape(-1, 3)

    def _thicken(self, edges: np.ndarray, up: np.ndarray, rim: np.ndarray, rim_up: np.ndarray) -> np.ndarray:
        """Return the kept vertices, half the thickness above and below the mid-surface. ``edges``, ``rim``: points on
        sections, and on fillets and connectors; ``up``, ``rim_up``: normals there."""
        half = 0.5 * self.design.params.thickness
        lift, rim_lift = half * np.broadcast_to(up, (len(edges), 3)), half * np.broadcast_to(rim_up, rim.shape)
        sections = np.concatenate([edges + lift[:, None], edges - lift[:, None]], axis=1).reshape(-1, 3)
        points = np.stack([rim + rim_lift, rim - rim_lift], axis=1).reshape(-1, 3)
        return np.concatenate([sections, points])[self.kept_vertices]


def make_panel_mesh(
    design: SpiralDesign, detail: Detail, tips: Sequence[Tip | Cap] = (), progress: Progress = SILENT
) -> PanelMesh:
    """Build the panels of a design; every patch becomes a closed body.

    Parameters
    ----------
    design : spirals
    detail : resolution
    tips : ends of arms with connectors, with their true outlines; other arms end bluntly at cuts
    progress : called with the fraction done
    """
    progress(0.0, DRAWING_ARMS)
    count = len(design.width)
    turn = np.degrees(design.twist) / detail.degrees_per_piece
    pieces = np.repeat(detail.min_pieces + np.ceil(turn).astype(int), 4)
    # the slots on the two sides of an arm end at different places; the root between these places needs sections too
    behind = np.abs(design.roots.left - np.roll(design.roots.right, 1, axis=1))
    rows = pieces + 2 + (turn[:, None] * behind).astype(int).ravel()
    first = np.cumsum(rows) - rows
    arm = np.repeat(np.arange(4 * count), rows)
    begin, headed = np.zeros(4 * count), np.zeros(4 * count, dtype=bool)
    tips = (*tips, *design.caps)
    ends = [tip.arm for tip in tips]
    begin[ends], headed[ends] = [tip.inner_end for tip in tips], True
    t, line, sides = _sections(design, arm, np.arange(len(arm)) - first[arm], pieces, rows, begin)
    rim_quad, rim = _fillet_points(design, detail.fillet_points)
    first, last = first.reshape(count, 4), (first + rows - 1).reshape(count, 4)
    faces, quad_of = _faces(design, arm, first, last, rim.shape[2], headed)
    heads = ArmEnds.from_tips(design, tips, progress.part(0.3, 0.8))
    progress(0.8, DRAWING_ARMS)
    more, more_of = heads.faces(first.ravel(), 4 * len(arm) + 2 * rim_quad.size)
    faces, quad_of = [*faces, *more], np.concatenate([quad_of, more_of])
    points = 4 * len(arm) + 2 * (rim_quad.size + len(heads.arm))
    same = _shared_vertices(design, first, points)
    used = np.flatnonzero(same == np.arange(points))
    index = np.empty(points, dtype=np.int64)
    index[used] = np.arange(len(used))
    index = index[same]
    corners = np.concatenate([f.ravel() for f in faces])
    sizes = np.concatenate([np.full(len(f), f.shape[1]) for f in faces])
    alone = rim_quad.size + len(heads.arm)
    section = np.concatenate([np.repeat(np.arange(len(arm)), 4), len(arm) + np.repeat(np.arange(alone), 2)])
    vertex_quad = np.concatenate(
        [np.repeat(arm // 4, 4), np.repeat(np.concatenate([rim_quad.ravel(), heads.arm // 4]), 2)]
    )
    made = PanelMesh(
        design, arm, t, line, sides, rim_quad.ravel(), rim.reshape(-1, 3), heads,
        used, index[corners], sizes, quad_of, vertex_quad[used], section[used],
    )  # fmt: skip
    return _with_rim(made, RimMesh.from_design(design))


def _with_rim(made: PanelMesh, strip: RimMesh | None) -> PanelMesh:
    """Return the panels with the plates of the rim; unchanged if ``strip`` is None."""
    if strip is None:
        return made
    faces, quad_of = strip.faces(len(made.kept_vertices))
    beyond = int(made.section.max()) + 1
    return replace(
        made,
        rim_mesh=strip,
        corners=np.concatenate([made.corners, *(f.ravel() for f in faces)]),
        sizes=np.concatenate([made.sizes, *(np.full(len(f), f.shape[1]) for f in faces)]),
        quad_of=np.concatenate([made.quad_of, quad_of]),
        vertex_quad=np.concatenate([made.vertex_quad, np.repeat(strip.quad, 2)]),
        section=np.concatenate([made.section, beyond + np.repeat(np.arange(len(strip.quad)), 2)]),
    )


def _sections(
    design: SpiralDesign, arm: np.ndarray, row: np.ndarray, pieces: np.ndarray, rows: np.ndarray, begin: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the sections of all arms, from tips to roots: R sections, A arms.

    arm, row : (R,) arm of every section, and index of the section within the arm
    pieces, rows : (A,) numbers of pieces and of sections of every arm; the first ``pieces`` + 1 sections are
        perpendicular to the arm, further sections belong to its root, which is rigid with the hub
    begin : (A,) parameter of the arms' tips
    Returns parameters (R,), middles (R, 3) from the hub's centre, and edges (R, 2, 3) from the middles.
    """
    quad, side = np.divmod(arm, 4)
    hub, root = hub_edge_of_design(design).ravel()[arm], design.roots
    share = np.minimum(row / pieces[arm], 1.0)
    # sections are denser towards the tip, where the arm blends into the joint
    t = begin[arm] + (hub - begin[arm]) * share * (2.0 + share) / 3.0
    shape = design.arms.one_by_one(quad, side)
    beyond = np.maximum(row - pieces[arm], 0) / (rows - 1 - pieces)[arm]
    centre = centre_line(shape, t[:, None, None])[0][:, 0, 0]
    line, sides = np.zeros((len(t), 3)), np.zeros((len(t), 2, 3))
    line[:, :2] = centre - shape.centre
    for k, (way, end) in enumerate(((LEFT, root.left), (RIGHT, np.roll(root.right, 1, axis=1)))):
        at = t + beyond * (end.ravel()[arm] - t)
        sides[:, k, :2] = edge_points(shape, at[:, None, None], way)[0][:, 0, 0] - centre
    return t, line, sides


def _fillet_points(design: SpiralDesign, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points on the fillet after every arm: quads (F, 4, points), positions (F, 4, points, 3) from the hub."""
    root, count = design.roots, len(design.width)
    quad = np.broadcast_to(np.arange(count)[:, None, None], (count, 4, points))
    place = np.zeros((count, 4, points, 3))
    if not points:
        return quad, place
    left = edge_points(design.arms, root.left[..., None], LEFT)[0][:, :, 0] - root.centre
    right = np.roll(edge_points(design.arms, np.roll(root.right, 1, axis=1)[..., None], RIGHT)[0][:, :, 0], -1, axis=1)
    right -= root.centre
    begin = np.arctan2(left[..., 1], left[..., 0])
    # the fillet always runs clockwise round its centre
    turn = -((begin - np.arctan2(right[..., 1], right[..., 0])) % (2.0 * np.pi))
    turn = np.where(turn < -1.5 * np.pi, 0.0, turn)
    angle = begin[..., None] + turn[..., None] * (np.arange(1, points + 1) / (points + 1))
    place[..., 0], place[..., 1] = root.fillet[..., None] * np.cos(angle), root.fillet[..., None] * np.sin(angle)
    place[..., :2] += (root.centre - design.arms.centre[:, None])[:, :, None]
    return quad, place


def _faces(
    design: SpiralDesign, arm: np.ndarray, first: np.ndarray, last: np.ndarray, fillet: int, headed: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return arrays of faces (n, corners), and the quad of every face.

    arm : (R,) arm of every section
    first, last : (F, 4) index of the section at the tip and at the root of every arm
    fillet : number of points per fillet
    headed : (A,) mask of the arms that end in a connector or cap
    """
    layout, count = design.flat.layout, len(first)
    outer = np.ones(len(arm), bool)
    outer[last] = False
    a = 4 * np.flatnonzero(outer)[:, None]
    b, left, right, low = a + 4, 0, 1, 2
    bars = [
        np.hstack([a + left, b + left, b + right, a + right]),
        np.hstack([a + right + low, b + right + low, b + left + low, a + left + low]),
        np.hstack([b + left, a + left, a + left + low, b + left + low]),
        np.hstack([a + right, b + right, b + right + low, a + right + low]),
    ]
    blunt = layout.cut[layout.mesh.quad_edges] | layout.mesh.border[layout.mesh.quad_edges]
    blunt &= ~headed.reshape(blunt.shape)
    ends = 4 * first[blunt][:, None]
    caps = np.hstack([ends + left, ends + right, ends + right + low, ends + left + low])
    rim = 4 * len(arm) + 2 * np.arange(4 * count * fillet).reshape(count, 4, fillet)
    corner = np.concatenate([4 * last[..., None] + left, rim], axis=2)
    below = np.concatenate([4 * last[..., None] + left + low, rim + 1], axis=2)
    # round the hub: right and left edge of every arm's root, then the fillet
    top = np.concatenate([4 * last[..., None] + right, corner], axis=2).reshape(count, -1)
    bottom = np.concatenate([4 * last[..., None] + right + low, below], axis=2).reshape(count, -1)
    onward = np.concatenate([corner[..., 1:], np.roll(4 * last + right, -1, axis=1)[..., None]], axis=2)
    onward_low = np.concatenate([below[..., 1:], np.roll(4 * last + right + low, -1, axis=1)[..., None]], axis=2)
    walls = np.stack([below, onward_low, onward, corner], axis=-1).reshape(-1, 4)
    quad = np.repeat(np.arange(count), 4 * (fillet + 1))
    of_bars = np.tile(arm[outer] // 4, 4)
    of_caps = np.nonzero(blunt)[0]
    quad_of = np.concatenate([of_bars, of_caps, quad, np.arange(count), np.arange(count)])
    return [*bars, caps, walls, top, bottom[:, ::-1]], quad_of


@dataclass(frozen=True, eq=False)
class ArmEnds:
    """Connectors and caps at arms' ends: their points, without the two that they share with the arm, and triangles.

    arm, t : arm of every point, as 4 quad + side, and parameter of the arm's nearest section
    line, side : vectors in the flat panel from the hub's centre to the section's middle, and from there to the point, m
    ends : arms with a connector or cap; starts : index of the first point of each, then the number of points
    triangles : counter-clockwise; indices of points, or -1 and -2 for the end of the arm's right and left edge
    end_of : index into ``ends`` for every triangle
    """

    arm: Int[np.ndarray, " points"]
    t: Float[np.ndarray, " points"]
    line: Float[np.ndarray, "points 3"]
    side: Float[np.ndarray, "points 3"]
    ends: Int[np.ndarray, " ends"]
    starts: Int[np.ndarray, " starts"]
    triangles: Int[np.ndarray, "triangles 3"]
    end_of: Int[np.ndarray, " triangles"]

    @classmethod
    def from_tips(cls, design: SpiralDesign, tips: Sequence[Tip | Cap], progress: Progress = SILENT) -> ArmEnds:
        """Triangulate the connectors and caps of a design."""
        import shapely

        rings = [shapely.get_coordinates(tip.polygon)[:-1] for tip in tips]
        ends = np.array([tip.arm for tip in tips], dtype=int)
        count = np.array([len(ring) - 2 for ring in rings], dtype=int)
        starts = np.concatenate([[0], np.cumsum(count)])
        triangles, of = [np.empty((0, 3), dtype=int)], [np.empty(0, dtype=int)]
        for k, (ring, tip) in enumerate(progress.each(list(zip(rings, tips, strict=True)), DRAWING_ARMS)):
            number = np.concatenate([[-1], starts[k] + np.arange(count[k]), [-2]])
            found = triangulate([tip.polygon], ring)
            triangles.append(number[found])
            of.append(np.full(len(found), k))
        arm = np.repeat(ends, count)
        points = np.concatenate([np.empty((0, 2)), *(ring[1:-1] for ring in rings)])
        return cls(
            arm,
            *_arm_coordinates(design, arm, points, tips, count),
            ends,
            starts,
            np.concatenate(triangles),
            np.concatenate(of),
        )

    def faces(self, first: np.ndarray, base: int) -> tuple[list[np.ndarray], np.ndarray]:
        """Return faces above, below and at the edges, and the quad of every face.

        first : (A,) first section of every arm
        base : index of the connectors' first vertex
        """
        # upper right and left vertices of the arm's end
        known = np.stack([4 * first[self.ends] + 1, 4 * first[self.ends]], axis=1)

        def vertex(number: np.ndarray, of: np.ndarray, low: int) -> np.ndarray:
            """Return the upper (``low`` 0) or lower (1) vertices of points; -1 and -2 are the arm's edges."""
            side = known[of[:, None], np.where(number == -1, 0, 1)] + 2 * low
            return np.where(number < 0, side, base + 2 * number + low)

        top, bottom = (vertex(self.triangles, self.end_of, low) for low in (0, 1))
        runs = [
            np.concatenate([[-1], np.arange(a, b), [-2]])
            for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)
        ]
        walls = np.concatenate([np.empty((0, 2), dtype=int), *(np.stack([r[:-1], r[1:]], axis=1) for r in runs)])
        of = np.repeat(np.arange(len(runs)), [len(r) - 1 for r in runs])
        sides = np.concatenate([vertex(walls, of, 1), vertex(walls, of, 0)[:, ::-1]], axis=1)
        quad_of = np.concatenate([self.ends[self.end_of], self.ends[self.end_of], self.ends[of]]) // 4
        return [top, bottom[:, ::-1], sides], quad_of


def _arm_coordinates(
    design: SpiralDesign, arm: np.ndarray, points: np.ndarray, tips: Sequence[Tip | Cap], count: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ``t``, ``line`` and ``side`` of ``ArmEnds`` for points (H, 2) of ``arm`` (H,), ``count`` for each tip.

    Points beyond an arm's tip get the parameter of the tip and so move rigidly with it.
    """
    shape = design.arms.one_by_one(*np.divmod(arm, 4))
    tip, speed, _ = (x[:, 0, 0] for x in centre_line(shape, np.zeros((len(arm), 1, 1))))
    over = np.repeat([tip.inner_end for tip in tips], count)
    t = np.clip(((points - tip) * speed).sum(axis=1) / np.maximum((speed**2).sum(axis=1), 1e-30), 0.0, over)
    line, side = np.zeros((len(arm), 3)), np.zeros((len(arm), 3))
    centre = centre_line(shape, t[:, None, None])[0][:, 0, 0]
    line[:, :2], side[:, :2] = centre - shape.centre, points - centre
    return t, line, side


def _shared_vertices(design: SpiralDesign, first: np.ndarray, points: int) -> np.ndarray:
    """Return the vertex that replaces each of ``points`` vertices: two arms of a patch share the section at a joint."""
    layout, same = design.flat.layout, np.arange(points)
    quad, side = opposite_sides(layout.mesh)
    blunt = layout.cut[layout.mesh.quad_edges] | layout.mesh.border[layout.mesh.quad_edges]
    second = ~blunt & (np.arange(len(first))[:, None] > quad)
    mine, theirs = 4 * first[second], 4 * first[quad, side][second]
    # the left edge of an arm, seen from its hub, is the right edge of the arm that it meets
    for own, other in ((0, 1), (1, 0), (2, 3), (3, 2)):
        same[mine + own] = theirs + other
    return same
