"""Find parts of a surface that coincide, intersect or lie close behind each other, in O(n log n).

code                severity  meaning
doubled-vertices    error     separate border vertices at one place: the surface is open there
t-junction          error     a border vertex inside a border edge of another face
doubled-faces       error     a body that coincides with another body
cuts-itself         warning   a body that intersects itself
bodies-cross        warning   bodies that intersect each other
double-skin         warning   inner and outer skin of a thin closed shell
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from ...arrays import Bool, Float, Int
from ...tolerances import SINGLE_TOL
from ..mesh import PolygonMesh
from ..welding import WELD_SHARE, short_edge_length
from .finding import Finding, list_faces, make_finding, with_count
from .sewing import border_twins, coincident_faces, join_if_sound, position_labels
from .t_junctions import t_junctions
from .topology import Sides, bodies, sides_of

# Largest distance between the inner and the outer skin of a thin shell, in median edges. Larger: opposite walls of a
# hollow body count as skins.
SKIN = 0.75
OPPOSITE = -0.7  # largest cosine between the normals of two skins; larger: less parallel faces count as skins
# A closed body is a thin shell if more than this share of its faces have another skin behind them. Larger: shells with
# thick parts are not recognised.
SKINS = 0.6
# Smallest overlap of two coplanar triangles that is reported, as a share of the smaller triangle's area. Smaller:
# triangles that only touch are reported.
ON_EACH_OTHER = 0.01


def overlap_findings(mesh: PolygonMesh) -> list[Finding]:
    """Return all findings of the module's table, for a mesh in metres; none if a corner is not finite."""
    if not len(mesh.sizes) or not np.isfinite(mesh.vertices[mesh.corners]).all():
        return []
    sides = sides_of(mesh)
    body = bodies(sides, len(mesh.sizes))
    found = _coincidence_findings(mesh, body)
    if not found:
        found = [*_open_seam_findings(mesh, sides), *_intersection_findings(mesh, body)]
    return found + _double_skin_findings(mesh, sides, body)


def _format_position(point: Float[np.ndarray, " 3"]) -> str:
    """Return a position (metres) as text in mm."""
    return "({:.4g}, {:.4g}, {:.4g}) mm".format(*(1e3 * point))


def _coincidence_findings(mesh: PolygonMesh, body: Int[np.ndarray, " faces"]) -> list[Finding]:
    """Report faces that coincide with faces of another body, or of their own body, which then intersects itself."""
    lying = coincident_faces(mesh)
    if not len(lying):
        return []
    place = position_labels(mesh)
    several = np.zeros(len(mesh.sizes), bool)
    first: dict[tuple[int, ...], int] = {}
    pieces = np.split(place[mesh.corners], np.cumsum(mesh.sizes)[:-1])
    for face in lying.tolist():
        key = tuple(sorted(pieces[face].tolist()))
        other = first.setdefault(key, face)
        several[[face, other]] |= body[face] != body[other]
    found = []
    twice, own = lying[several[lying]], lying[~several[lying]]
    if len(twice):
        text = f"{list_faces(twice, 'lies', 'lie')} on faces of another shell, as of a shell that is there twice: delete one of the two"
        found.append(make_finding("doubled-faces", text, twice))
    if len(own):
        spot = _format_position(mesh.vertices[pieces[int(own[0])]].mean(axis=0))
        text = f"The surface cuts itself: {list_faces(own)} lie on each other, at {spot}: delete one of each two, or move them apart"
        found.append(make_finding("cuts-itself", text, own, severity="warning"))
    return found


def _open_seam_findings(mesh: PolygonMesh, sides: Sides) -> list[Finding]:
    """Report doubled border vertices and T-junctions."""
    found = []
    label = border_twins(mesh, sides)
    # if joining would add faults, the parts of the surface only touch, and that is allowed
    if join_if_sound(mesh, label) is not None:
        on = np.flatnonzero(np.bincount(label, minlength=len(label))[label] > 1)
        faces = np.unique(sides.face[np.isin(mesh.corners, on)])
        text = f"{with_count(len(on), 'vertex of the border lies', 'vertices of the border lie')} in one place with others, the first at {_format_position(mesh.vertices[on[0]])}, so that the surface is open there: merge them (Merge by Distance)"
        found.append(make_finding("doubled-vertices", text, faces))
    at = t_junctions(mesh, sides)
    if len(at.vertex):
        faces = np.unique(sides.face[at.side])
        many = with_count(len(at.vertex), "T-junction: a vertex lies", "T-junctions: vertices lie")
        text = f"{many} inside the edge of a neighbour, the first at {_format_position(mesh.vertices[at.vertex[0]])}, so that the surface is open there: use Quad remesh, or give the neighbour that vertex too (Knife)"
        found.append(make_finding("t-junction", text, faces, np.unique(sides.edge[at.side])))
    return found


def _double_skin_findings(mesh: PolygonMesh, sides: Sides, body: Int[np.ndarray, " faces"]) -> list[Finding]:
    """Report thin closed shells: closed bodies in which most faces have an opposite face close behind them."""
    uses = np.bincount(sides.edge, minlength=len(sides.edges))
    closed = np.ones(int(body.max()) + 1, bool)
    closed[body[sides.face[uses[sides.edge] == 1]]] = False
    if not closed.any():
        return []
    p, middle = mesh.vertices, mesh.centres
    across = np.cross(p[mesh.corners] - middle[sides.face], p[sides.end_vertex] - middle[sides.face])
    normal = np.add.reduceat(across, mesh.starts, axis=0)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    edge = float(np.median(np.linalg.norm(p[sides.edges[:, 1]] - p[sides.edges[:, 0]], axis=1)))
    pairs = cKDTree(middle).query_pairs(SKIN * edge, output_type="ndarray")
    a, b = pairs.T
    opposite = np.einsum("ni,ni->n", normal[a], normal[b]) < OPPOSITE
    a, b = a[opposite & (body[a] == body[b])], b[opposite & (body[a] == body[b])]
    has = np.zeros(len(mesh.sizes), bool)
    has[a] = has[b] = True
    share = np.bincount(body, has) / np.bincount(body)
    faces = np.flatnonzero((closed & (share > SKINS))[body])
    if not len(faces):
        return []
    gap = 1e3 * float(np.median(np.linalg.norm(middle[a] - middle[b], axis=1)))
    text = f"{list_faces(faces)} form the two skins of a thin closed shell, {gap:.2g} mm apart, and each skin would get panels of its own: delete the inner skin and the rim (Keep the outer skin)"
    return [make_finding("double-skin", text, faces, severity="warning")]


def _intersection_findings(mesh: PolygonMesh, body: Int[np.ndarray, " faces"]) -> list[Finding]:
    """Report faces that intersect faces of their own body or of other bodies."""
    pairs, points = intersecting_faces(mesh)
    apart = body[pairs[:, 0]] != body[pairs[:, 1]]
    found = []
    if not apart.all():
        faces, spot = np.unique(pairs[~apart]), _format_position(points[~apart][0])
        text = f"The surface cuts itself: {list_faces(faces)} go through others, at {spot}, which sheets cannot do: move these parts apart"
        found.append(make_finding("cuts-itself", text, faces, severity="warning"))
    if apart.any():
        faces, spot = np.unique(pairs[apart]), _format_position(points[apart][0])
        text = f"Bodies go through each other: {list_faces(faces)}, at {spot}. Each body is made by itself; to put them together, move them apart, or join them with the modifier Boolean"
        found.append(make_finding("bodies-cross", text, faces, severity="warning"))
    return found


def intersecting_faces(mesh: PolygonMesh) -> tuple[Int[np.ndarray, "pairs 2"], Float[np.ndarray, "pairs 3"]]:
    """Return pairs of intersecting faces without a common corner, and a point of each intersection.

    A pair may be listed more than once.
    """
    from shapely import STRtree, box

    face, rows = fan_triangulate(mesh)
    p = mesh.vertices[rows]
    low, high = p.min(axis=1), p.max(axis=1)
    x, y, z = np.argsort(-np.ptp(mesh.vertices[mesh.corners], axis=0))
    boxes = box(low[:, x], low[:, y], high[:, x], high[:, y])
    a, b = STRtree(boxes).query(boxes)
    kept = (face[a] != face[b]) & (low[a, z] <= high[b, z]) & (low[b, z] <= high[a, z])
    a, b = a[kept], b[kept]
    beside = _neighbours(mesh)
    apart = ~np.isin(face[a] * len(mesh.sizes) + face[b], beside)
    a, b = a[apart], b[apart]
    hit = np.zeros(len(a), bool)
    points = np.zeros((len(a), 3))
    for k in range(3):  # testing the edges of the first triangle is enough, as each pair is listed in both orders
        own, where = _intersect_segments(p[a, k], p[a, (k + 1) % 3], p[b])
        points[own & ~hit] = where[own & ~hit]
        hit |= own
    level = np.flatnonzero(~hit & (a < b))
    level = level[_coplanar_overlap(p[a[level]], p[b[level]], WELD_SHARE * short_edge_length(mesh))]
    points[level], hit[level] = p[b[level]].mean(axis=1), True
    along = _crossing_along_edges(mesh)
    pairs = np.concatenate([np.stack([face[a[hit]], face[b[hit]]], axis=1), along])
    return pairs, np.concatenate([points[hit], mesh.vertices[mesh.corners[mesh.starts[along[:, 0]]]]])


def _crossing_along_edges(mesh: PolygonMesh) -> Int[np.ndarray, "pairs 2"]:
    """Return pairs of faces of surface parts that cross along an edge: coincident edges that have two faces each."""
    sides = sides_of(mesh)
    place = sides_of(replace(mesh, corners=position_labels(mesh)[mesh.corners])).edge
    inner = np.flatnonzero(np.bincount(sides.edge)[sides.edge] == 2)
    order = inner[np.lexsort([sides.edge[inner], place[inner]])]
    following = np.roll(order, -2)  # the two sides of an edge stand next to each other in ``order``
    beside = (place[order] == place[following]) & (sides.edge[order] != sides.edge[following])
    found: Int[np.ndarray, "pairs 2"] = np.stack([sides.face[order[beside]], sides.face[following[beside]]], axis=1)
    return found


def _neighbours(mesh: PolygonMesh) -> Int[np.ndarray, " pairs"]:
    """Return all pairs of faces that share the position of a corner, encoded as first * number of faces + second."""
    of_place = csr_array((np.ones(len(mesh.corners)), (mesh.face_of, position_labels(mesh)[mesh.corners])))
    first, second = (of_place @ of_place.T).nonzero()
    found: Int[np.ndarray, " pairs"] = first.astype(np.int64) * len(mesh.sizes) + second
    return found


def fan_triangulate(mesh: PolygonMesh) -> tuple[Int[np.ndarray, " triangles"], Int[np.ndarray, "triangles 3"]]:
    """Split every face into triangles about its first corner; return the face of each triangle, and its vertices."""
    face = np.repeat(np.arange(len(mesh.sizes)), mesh.sizes - 2)
    within = np.arange(len(face)) - np.repeat(np.cumsum(mesh.sizes - 2) - (mesh.sizes - 2), mesh.sizes - 2)
    first = mesh.starts[face]
    return face, np.stack(
        [mesh.corners[first], mesh.corners[first + within + 1], mesh.corners[first + within + 2]], axis=1
    )


def _coplanar_overlap(
    one: Float[np.ndarray, "pairs 3 3"], other: Float[np.ndarray, "pairs 3 3"], near: float
) -> Bool[np.ndarray, " pairs"]:
    """Return for every pair of triangles ``one[i]``, ``other[i]`` whether they are coplanar and overlap.

    near : largest distance of the second triangle's corners from the first triangle's plane, metres
    """
    import shapely

    normal = np.cross(one[:, 1] - one[:, 0], one[:, 2] - one[:, 0])
    size = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(size, 1e-300)[:, None]
    off = np.abs(np.einsum("nki,ni->nk", other - one[:, :1], normal)).max(axis=1)
    found = (off <= near) & (size > 0.0)
    flat = np.flatnonzero(found)
    across = one[flat, 1] - one[flat, 0]
    across /= np.linalg.norm(across, axis=1)[:, None]
    axes = np.stack([across, np.cross(normal[flat], across)], axis=2)
    first, second = (shapely.polygons((x[flat] - one[flat, :1]) @ axes) for x in (one, other))
    common = shapely.area(shapely.intersection(first, second))
    found[flat] = common > ON_EACH_OTHER * np.minimum(shapely.area(first), shapely.area(second))
    return found


def _intersect_segments(
    start: Float[np.ndarray, "pairs 3"], end: Float[np.ndarray, "pairs 3"], triangle: Float[np.ndarray, "pairs 3 3"]
) -> tuple[Bool[np.ndarray, " pairs"], Float[np.ndarray, "pairs 3"]]:
    """Return for pairs of a segment and a triangle whether the segment goes through the triangle, and where.

    Method of Moeller and Trumbore (1997). The second result is meaningless where the first is False.
    """
    way, one, two = end - start, triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]
    across = np.cross(way, two)
    size = np.einsum("ni,ni->n", one, across)
    level = np.abs(size) <= 1e-12 * np.linalg.norm(way, axis=1) * np.linalg.norm(one, axis=1) * np.linalg.norm(
        two, axis=1
    )
    inverse = 1.0 / np.where(level, 1.0, size)
    off = start - triangle[:, 0]
    u = np.einsum("ni,ni->n", off, across) * inverse
    turn = np.cross(off, one)
    v = np.einsum("ni,ni->n", way, turn) * inverse
    t = np.einsum("ni,ni->n", two, turn) * inverse
    # The intersection must lie inside the segment, and in the triangle or on its border. The border counts, because
    # symmetric parts cross exactly at edges; the segment's ends do not, because there parts only touch.
    inside = (
        ~level
        & (u > -SINGLE_TOL)
        & (v > -SINGLE_TOL)
        & (u + v < 1 + SINGLE_TOL)
        & (t > SINGLE_TOL)
        & (t < 1 - SINGLE_TOL)
    )
    return inside, start + t[:, None] * way
