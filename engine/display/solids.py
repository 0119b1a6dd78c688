"""The flat panels as solids for display: every arm is a bar between its true edges, every hub a small plate.

They are built arm by arm, because triangulating a sheet with thousands of holes would take minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Float, Int
from ..fabrication.connectors.tips import Tip
from ..spirals.caps import Cap
from ..spirals.curves.spiral import LEFT, RIGHT, Arms, edge_points, opposite_sides
from ..spirals.design import SpiralDesign
from ..spirals.roots import SlotRoots
from ..triangulation import triangulate
from .rim_mesh import RimMesh

DEGREES_PER_STEP = 9.5  # twist per straight step of an arm, degrees; larger: fewer faces, arms with visible corners
# Largest number of faces of all arms; for more spirals the steps are longer. Larger: smoother arms, slower.
MAX_FACES = 2_000_000
DRAWING_TOLERANCE = 5e-5  # tolerance of the outlines of panels and plates in pictures, metres; larger: coarser, faster


@dataclass(frozen=True, eq=False)
class ArmVertices:
    """Indices of the vertices of arms, on the lower and the upper side, or on the upper side only.

    edges : vertices of the arms' edges, in the order of ``_flat_edges``; -1 where there is none
    end_vertices : vertices of caps and connectors apart from the arms' edges
    arm : arm of each vertex in ``end_vertices``, 4 quad + side
    """

    edges: Int[np.ndarray, "sides quads 4 2 steps"]
    end_vertices: Int[np.ndarray, "sides points"]
    arm: Int[np.ndarray, " points"]


@dataclass(frozen=True, eq=False)
class PolygonSolid:
    """Polygon mesh of the panels.

    vertices : positions, metres
    corners, sizes : vertex of every face corner; number of corners of every face
    quad_of : quad of every face
    seam_of : seam of the connector to which the face belongs; -1 for other faces
    is_one_sided : whether the mesh has only the upper side
    arm_vertices : indices of the arms' vertices; None for meshes without arms
    rim_mesh : plates of the rim, whose vertices come last; None without a rim
    """

    vertices: Float[np.ndarray, "vertices 3"]
    corners: Int[np.ndarray, " corners"]
    sizes: Int[np.ndarray, " faces"]
    quad_of: Int[np.ndarray, " faces"]
    seam_of: Int[np.ndarray, " faces"]
    is_one_sided: bool = False
    arm_vertices: ArmVertices | None = None
    rim_mesh: RimMesh | None = None


def make_light_solids(
    design: SpiralDesign,
    centres: np.ndarray,
    tips: Sequence[Tip | Cap] = (),
    max_faces: int = 100_000,
    max_twist: float | None = None,
) -> PolygonSolid:
    """Build all panels like ``make_solids``, but large designs with only the upper side and longer steps.

    Such meshes are fast to redraw.

    Parameters
    ----------
    design, centres, tips : see ``make_solids``
    max_faces : approximate largest number of faces
    max_twist : largest twist for which the number of steps must suffice, radians; by default the design's largest
    """
    count, steps = len(design.width), _count_steps(design, DEGREES_PER_STEP, max_twist)
    if count * 16 * steps <= max_faces:
        return make_solids(design, centres, tips, max_twist=max_twist)
    tips = (*tips, *design.caps)
    steps = max(min(steps, max_faces // (4 * count)), 5)
    flat = _flat_edges(design, centres, steps, tips)
    index = np.arange(8 * count * steps).reshape(count, 4, 2, steps)
    heads = _EndTriangles.from_tips(design, centres, tips, index)
    level = np.concatenate([flat.reshape(-1, 2), heads.points])
    points = np.column_stack([level, np.full(len(level), design.params.thickness)])
    left, right = index[:, :, 0], index[:, :, 1]
    loops = np.stack([left[..., :-1], left[..., 1:], right[..., 1:], right[..., :-1]], axis=-1).reshape(-1, 4)
    plates = np.stack([right[..., -1], left[..., -1]], axis=-1).reshape(count, 8)
    corners = np.concatenate([loops.ravel(), plates.ravel(), heads.triangles.ravel()])
    sizes = np.repeat([4, 8, 3], [len(loops), count, len(heads.triangles)])
    quad_of = np.concatenate([np.concatenate([loops[:, 0], plates[:, 0]]) // (8 * steps), heads.arm // 4])
    where = ArmVertices(index[None], index.size + np.arange(len(heads.points))[None], heads.point_arm)
    made = PolygonSolid(
        points,
        corners,
        sizes,
        quad_of,
        _seams_of_faces(design, heads.arm, len(sizes)),
        is_one_sided=True,
        arm_vertices=where,
    )
    return _with_rim(made, design, centres)


def make_solids(
    design: SpiralDesign,
    centres: np.ndarray,
    tips: Sequence[Tip | Cap] = (),
    degrees_per_step: float = DEGREES_PER_STEP,
    max_twist: float | None = None,
) -> PolygonSolid:
    """Build all panels as closed bodies from z = 0 up to the sheet's thickness; every edge has exactly two faces.

    For 3D printing, ``engine/fabrication/writers/panel_solids.py`` builds solids from the true outlines instead.

    Parameters
    ----------
    design : spirals
    centres : (N, 2) positions of the patches' origins, metres
    tips : ends of arms with connectors, with their true outlines
    degrees_per_step : twist per straight step of an arm; longer where there would be more than ``MAX_FACES`` faces
    max_twist : largest twist for which the number of steps must suffice, radians; by default the design's largest
    """
    layout, tips = design.flat.layout, (*tips, *design.caps)
    steps = min(_count_steps(design, degrees_per_step, max_twist), max(MAX_FACES // (16 * len(design.width)), 5))
    flat = _flat_edges(design, centres, steps, tips)
    index = np.arange(flat.size // 2).reshape(flat.shape[:-1])
    heads = _EndTriangles.from_tips(design, centres, tips, index)
    level = np.concatenate([flat.reshape(-1, 2), heads.points])
    bottom = np.column_stack([level, np.zeros(len(level))])
    top, up = bottom + np.array([0.0, 0.0, design.params.thickness]), len(bottom)
    cut = layout.cut[layout.mesh.quad_edges] | layout.mesh.border[layout.mesh.quad_edges]
    blunt = cut.copy()
    blunt.ravel()[[tip.arm for tip in tips]] = False
    loops, plates = _faces(index, blunt, up)
    caps = np.concatenate([heads.triangles + up, heads.triangles[:, ::-1]])
    walls = np.column_stack([heads.walls, heads.walls[:, ::-1] + up])
    corners = np.concatenate([loops.ravel(), plates.ravel(), caps.ravel(), walls.ravel()])
    sizes = np.repeat([4, 8, 3, 4], [len(loops), len(plates), len(caps), len(walls)])
    arm = np.concatenate([heads.arm, heads.arm, heads.wall_arm])
    quad_of = np.concatenate([np.concatenate([loops[:, 0], plates[:, 0]]) % up // (8 * steps), arm // 4])
    same = np.concatenate([_shared_vertices(index, cut, design), np.arange(index.size, up)])
    corners = np.concatenate([same, same + up])[corners]
    used = np.zeros(2 * up, dtype=bool)
    used[corners] = True
    number = np.cumsum(used) - 1
    points = np.concatenate([bottom, top])[used]
    edges, own = np.stack([same[index], same[index] + up]), np.arange(index.size, up)
    where = ArmVertices(np.where(used[edges], number[edges], -1), number[np.stack([own, own + up])], heads.point_arm)
    made = PolygonSolid(
        points, number[corners], sizes, quad_of, _seams_of_faces(design, arm, len(sizes)), arm_vertices=where
    )
    return _with_rim(made, design, centres)


def _with_rim(made: PolygonSolid, design: SpiralDesign, centres: np.ndarray) -> PolygonSolid:
    """Return the panels with the plates of the design's rim; unchanged if the design has no rim."""
    strip = RimMesh.from_design(design)
    if strip is None:
        return made
    count = len(made.vertices)
    if made.is_one_sided:
        faces, quad_of = [count + strip.triangles], strip.quad[strip.triangles[:, 0]]
    else:
        faces, quad_of = strip.faces(count)
    sizes = np.concatenate([np.full(len(f), f.shape[1]) for f in faces])
    return replace(
        made,
        vertices=np.concatenate([made.vertices, rim_vertices(strip, design, centres, made.is_one_sided)]),
        corners=np.concatenate([made.corners, *(f.ravel() for f in faces)]),
        sizes=np.concatenate([made.sizes, sizes]),
        quad_of=np.concatenate([made.quad_of, quad_of]),
        seam_of=np.concatenate([made.seam_of, np.full(len(sizes), -1)]),
        rim_mesh=strip,
    )


def rim_vertices(
    strip: RimMesh, design: SpiralDesign, centres: np.ndarray, flat: bool
) -> Float[np.ndarray, "points 3"]:
    """Return the vertices of a rim's plates in the flat panels, metres.

    Parameters
    ----------
    strip, design : the rim's plates, and the spirals
    centres : (N, 2) positions of the patches' origins, metres
    flat : whether to return only the upper vertices; otherwise upper and lower vertices alternate
    """
    moved = centres[design.flat.layout.patch_of[strip.quad]]
    above = strip.flat_points + np.c_[moved, np.full(len(moved), design.params.thickness)]
    return above if flat else np.stack([above, above * [1.0, 1.0, 0.0]], axis=1).reshape(-1, 3)


def _seams_of_faces(design: SpiralDesign, arm: np.ndarray, count: int) -> np.ndarray:
    """Return the seam of each of ``count`` faces; -1 for all but the last faces, which are at the ends of arms.

    arm : arm (4 quad + side) of each of these last faces
    """
    layout = design.flat.layout
    seam = np.full(count, -1, dtype=np.int64)
    if len(arm):
        seam[-len(arm) :] = layout.seam_of[layout.mesh.quad_edges.ravel()[arm]]
    return seam


@dataclass(frozen=True, eq=False)
class _EndTriangles:
    """Connectors and caps at arms' ends, triangulated in the plane; arms have the numbers 4 quad + side.

    points, point_arm : (n, 2) positions of points that are not on an arm's edge, metres; arm of each. Their numbers
        follow those of the arms' vertices.
    triangles, arm : (T, 3) counter-clockwise; arm of each
    walls, wall_arm : (W, 2) sides of the outlines, without the side that an end shares with its arm; arm of each
    """

    points: np.ndarray
    triangles: np.ndarray
    arm: np.ndarray
    walls: np.ndarray
    wall_arm: np.ndarray
    point_arm: np.ndarray

    @classmethod
    def from_tips(
        cls, design: SpiralDesign, centres: np.ndarray, tips: Sequence[Tip | Cap], index: np.ndarray
    ) -> _EndTriangles:
        """Triangulate the ends of arms.

        centres : positions of the patches' origins, metres
        index : numbers of the arms' vertices, ordered as in ``_flat_edges``
        """
        import shapely

        points, triangles, walls = [np.empty((0, 2))], [np.empty((0, 3), dtype=int)], [np.empty((0, 2), dtype=int)]
        count = index.size
        for tip in tips:
            ring = shapely.get_coordinates(tip.polygon)[:-1]
            # the outline begins at the arm's right edge and ends at its left edge
            ends_ = index.reshape(-1, *index.shape[2:])[tip.arm, ::-1, 0]
            number = np.concatenate([ends_[:1], count + np.arange(len(ring) - 2), ends_[1:]])
            points.append(ring[1:-1] + centres[tip.patch])
            triangles.append(number[triangulate([tip.polygon], ring)])
            walls.append(np.column_stack([number[:-1], number[1:]]))
            count += len(ring) - 2
        arms = np.array([t.arm for t in tips], dtype=int)
        return cls(
            np.concatenate(points),
            np.concatenate(triangles),
            np.repeat(arms, [len(t) for t in triangles[1:]]),
            np.concatenate(walls),
            np.repeat(arms, [len(w) for w in walls[1:]]),
            np.repeat(arms, [len(p) for p in points[1:]]),
        )


def _count_steps(design: SpiralDesign, degrees_per_step: float, wound: float | None = None) -> int:
    """Return the number of points along an arm's edge: 5, and one for every ``degrees_per_step`` of twist.

    wound : twist, radians; by default the design's largest
    """
    most = design.twist.max(initial=0.0) if wound is None else wound
    return 5 + int(np.ceil(np.degrees(most) / degrees_per_step))


def _flat_edges(design: SpiralDesign, centres: np.ndarray, steps: int, tips: Sequence[Tip | Cap]) -> np.ndarray:
    """Return the left and right edge of every arm, from its joint or tip to the hub, (F, 4, 2, steps, 2), metres."""
    begin = design.arm_starts.copy()
    begin.ravel()[[tip.arm for tip in tips]] = [tip.inner_end for tip in tips]
    return (
        arm_edges(design.arms, design.roots, begin, steps) + centres[design.flat.layout.patch_of][:, None, None, None]
    )


def arm_edges(arms: Arms, root: SlotRoots, begin: Float[np.ndarray, "quads 4"], steps: int) -> np.ndarray:
    """Return the left and right edge of every arm from parameter ``begin`` to its root, in its patch's frame.

    Parameters
    ----------
    arms, root : arms of the quads; ends of the slots between them
    begin : parameter t at which each arm's edges begin
    steps : number of points per edge

    Returns
    -------
    (F, 4, 2, steps, 2) points, metres
    """
    share, first = np.linspace(0.0, 1.0, steps), begin[..., None]
    left = edge_points(arms, first + (root.left[..., None] - first) * share, LEFT)[0]
    right = edge_points(arms, first + (np.roll(root.right, 1, axis=1)[..., None] - first) * share, RIGHT)[0]
    return np.stack([left, right], axis=2)


def _shared_vertices(index: np.ndarray, blunt: np.ndarray, design: SpiralDesign) -> np.ndarray:
    """Return for every lower vertex the vertex that replaces it: two arms share the end points of edges at a joint.

    index : numbers of the arms' vertices, ordered as in ``_flat_edges``
    blunt : (F, 4) mask of the arms without such a joint
    """
    same = np.arange(index.size)
    quad, side = opposite_sides(design.flat.layout.mesh)
    own = np.arange(len(index))[:, None]
    second = ~blunt & (own > quad)
    ends = index[..., 0]
    # the left edge of an arm, seen from its joint, is the right edge of the arm that it meets
    for mine, theirs in ((0, 1), (1, 0)):
        same[ends[:, :, mine][second]] = ends[quad, side, theirs][second]
    return same


def _faces(index: np.ndarray, blunt: np.ndarray, up: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the faces of the arms (n, 4) and of the hubs' plates (2 F, 8).

    index : (F, 4, 2, steps) lower vertices; the index of the upper vertex is larger by ``up``
    blunt : (F, 4) mask of the arms that end bluntly at a cut, where the bar gets an end face
    """
    l0, l1, r0, r1 = index[:, :, 0, :-1], index[:, :, 0, 1:], index[:, :, 1, :-1], index[:, :, 1, 1:]
    # counter-clockwise round the hub, an arm's right edge (seen from its joint) comes before its left edge
    plate = np.stack([index[:, :, 1, -1], index[:, :, 0, -1]], axis=-1).reshape(len(index), 8)
    after = np.roll(index[:, :, 1, -1], -1, axis=1)
    ends = index[:, :, :, 0][blunt]
    loops = [
        np.stack([l0, l1, r1, r0], axis=-1) + up,
        np.stack([r0, r1, l1, l0], axis=-1),
        np.stack([l1, l0, l0 + up, l1 + up], axis=-1)[..., ::-1],
        np.stack([r0, r1, r1 + up, r0 + up], axis=-1)[..., ::-1],
        np.stack([index[:, :, 0, -1], after, after + up, index[:, :, 0, -1] + up], axis=-1),
        np.stack([ends[:, 0], ends[:, 1], ends[:, 1] + up, ends[:, 0] + up], axis=-1)[..., ::-1],
    ]
    return np.concatenate([x.reshape(-1, 4) for x in loops]), np.concatenate([plate + up, plate[:, ::-1]])
