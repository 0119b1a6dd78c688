"""Find and repair faces that touch along their borders without being joined: doubled border vertices and T-junctions.

A T-junction is a border vertex inside the border edge of another face: the surface looks closed but is open there.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ...arrays import Bool, Int
from ...components import components
from ..mesh import PolygonMesh
from ..welding import WELD_SHARE, merge_labelled, short_edge_length, weld_clusters
from .finding import with_count
from .t_junctions import BESIDE, TJunctions, t_junctions
from .topology import Sides, bodies, border_sides, non_manifold_vertices, orientation_faults, repeated_faces, sides_of

# Largest number of quads that the repair of T-junctions may add, as a share of the present quads; with more, the mesh
# needs a remesh instead. Larger: more meshes are repaired, some with many narrow quads.
MORE = 0.1


def border_twins(mesh: PolygonMesh, sides: Sides) -> Int[np.ndarray, " vertices"]:
    """Return for every vertex the first border vertex at the same place, or its own index.

    Parameters
    ----------
    mesh : unchecked mesh
    sides : sides of that mesh
    """
    rim = border_sides(sides)
    ends = np.unique(np.concatenate([mesh.corners[rim], sides.end_vertex[rim]]))
    return (
        weld_clusters(mesh, ends, WELD_SHARE * short_edge_length(mesh)) if len(ends) else np.arange(len(mesh.vertices))
    )


def sew(mesh: PolygonMesh) -> PolygonMesh:
    """Return a mesh with doubled border vertices joined and T-junctions repaired; its ``repairs`` list what was done."""
    if not len(mesh.sizes) or not np.isfinite(mesh.vertices[mesh.corners]).all():
        return mesh
    mesh = _join_doubled(_without_duplicates(mesh))
    sides = sides_of(mesh)
    found = t_junctions(mesh, sides)
    if not len(found.vertex):
        return mesh
    quads = _split_strips(mesh, sides, found)
    more = 0 if quads is None else len(quads.sizes) - len(mesh.sizes)
    place = "({:.4g}, {:.4g}, {:.4g})".format(*mesh.vertices[found.vertex[0]])
    named = with_count(len(found.vertex), "T-junction", "T-junctions")
    if quads is None:
        text = f"{named}, the first at {place}, in the unit of the file: the edge was split there, and the mesh needs a Quad remesh"
        return replace(_insert_vertices(mesh, found), repairs=(*mesh.repairs, ("t-junction", text)))
    text = f"{named}, the first at {place}, in the unit of the file: the cut was carried on to the border, which took {more} more quads"
    return replace(quads, repairs=(*mesh.repairs, ("t-junction", text)))


def _without_duplicates(mesh: PolygonMesh) -> PolygonMesh:
    """Return a mesh without bodies that coincide with earlier bodies, even if the faces of the two bodies differ."""
    one = replace(mesh, corners=position_labels(mesh)[mesh.corners])
    again = np.zeros(len(mesh.sizes), bool)
    again[repeated_faces(one)] = True
    body = bodies(sides_of(mesh), len(mesh.sizes))
    gone = (np.bincount(body, ~again) == 0)[body] | _duplicate_shells(one, body)
    if not gone.any() or gone.all():
        return mesh
    text = f"{2 * int(gone.sum())} faces lie on each other, as of a shell that is there twice: the second of each two is left out"
    # vertices without a face stay, because the finding "loose-vertices" reports them
    loose = np.setdiff1d(np.arange(len(mesh.vertices)), mesh.corners)
    left = mesh.subset(~gone)
    used = np.union1d(np.unique(left.corners), loose)
    corners = np.searchsorted(used, left.corners)
    cured = (*mesh.repairs, ("doubled-faces", text))
    return replace(left, vertices=mesh.vertices[used], corners=corners, repairs=cured)


def _duplicate_shells(mesh: PolygonMesh, body: Int[np.ndarray, " faces"]) -> Bool[np.ndarray, " faces"]:
    """Return a mask of the faces of bodies that have the vertices and the area of an earlier body.

    Such bodies coincide although their faces differ, as when a file holds a shell in quads and again in triangles.
    """
    middle = mesh.centres
    sides = sides_of(mesh)
    p, q, m = mesh.vertices[mesh.corners], mesh.vertices[sides.end_vertex], middle[sides.face]
    area = np.bincount(body[sides.face], 0.5 * np.linalg.norm(np.cross(p - m, q - m), axis=1))
    corners = np.unique(np.stack([body[sides.face], mesh.corners]), axis=1)
    known: dict[bytes, list[int]] = {}
    again = np.zeros(len(area), bool)
    for k, vertices in enumerate(np.split(corners[1], np.cumsum(np.bincount(corners[0]))[:-1])):
        alike = known.setdefault(vertices.tobytes(), [])
        again[k] = any(abs(area[k] - area[j]) <= BESIDE * area[j] for j in alike)
        alike.append(k)
    return again[body]


def _join_doubled(mesh: PolygonMesh) -> PolygonMesh:
    """Return a mesh with doubled border vertices joined, with consistent orientation; unchanged if that adds faults."""
    label = border_twins(mesh, sides_of(mesh))
    count = int((label != np.arange(len(label))).sum())
    one = join_if_sound(mesh, label)
    if one is None:
        return mesh
    text = f"{with_count(count, 'doubled vertex was', 'doubled vertices were')} joined with others, as Merge by Distance does in Blender"
    return replace(one, repairs=(*mesh.repairs, ("doubled-vertices", text)))


def join_if_sound(mesh: PolygonMesh, label: Int[np.ndarray, " vertices"]) -> PolygonMesh | None:
    """Join vertices of equal label and make the orientation consistent; None if nothing is joined or faults arise.

    Parameters
    ----------
    mesh : unchecked mesh
    label : for every vertex the index of the vertex with which it is joined, or its own index
    """
    if (label == np.arange(len(label))).all():
        return None
    one = merge_labelled(mesh, label)
    sides = sides_of(one)
    turned = orientation_faults(sides, bodies(sides, len(one.sizes)))[0]
    if len(turned) and not len(orientation_faults(sides_of(mesh), bodies(sides_of(mesh), len(mesh.sizes)))[0]):
        pieces = np.split(one.corners, np.cumsum(one.sizes)[:-1])
        for face in turned.tolist():
            pieces[face] = pieces[face][::-1]
        one = replace(one, corners=np.concatenate(pieces))
    return one if _adds_no_fault(mesh, one) else None


def _adds_no_fault(before: PolygonMesh, after: PolygonMesh) -> bool:
    """Return whether joining vertices of the mesh ``before``, which gave the mesh ``after``, added no fault.

    Faults are edges of three faces, inconsistent orientation, non-manifold vertices, and faces that coincide; the last
    are not even allowed if they were there before.
    """

    def faults(mesh: PolygonMesh) -> tuple[int, ...]:
        sides = sides_of(mesh)
        turned, one_sided, _ = orientation_faults(sides, bodies(sides, len(mesh.sizes)))
        found = turned, one_sided, non_manifold_vertices(mesh, sides), coincident_faces(mesh)
        return int((np.bincount(sides.edge) > 2).sum()), *map(len, found)

    return all(new <= old for new, old in zip(faults(after), faults(before), strict=True)) and not faults(after)[-1]


def coincident_faces(mesh: PolygonMesh) -> Int[np.ndarray, " faces"]:
    """Return the faces, ascending, whose corners have the positions of another face's corners."""
    label = position_labels(mesh)
    one = replace(mesh, corners=label[mesh.corners])
    return np.union1d(repeated_faces(one), repeated_faces(one, later=False))


def position_labels(mesh: PolygonMesh) -> Int[np.ndarray, " vertices"]:
    """Return for every vertex the index of the first vertex at its position."""
    used = np.unique(mesh.corners)
    return weld_clusters(mesh, used, WELD_SHARE * short_edge_length(mesh))


def _insert_vertices(mesh: PolygonMesh, found: TJunctions) -> PolygonMesh:
    """Return a mesh with the vertices of T-junctions inserted as corners into the faces on whose edges they lie."""
    order = np.lexsort((found.share, found.side))
    after = found.side[order] + 1
    sizes = mesh.sizes + np.bincount(mesh.face_of[found.side], minlength=len(mesh.sizes))
    return replace(mesh, corners=np.insert(mesh.corners, after, found.vertex[order]), sizes=sizes)


def _split_strips(mesh: PolygonMesh, sides: Sides, found: TJunctions) -> PolygonMesh | None:
    """Split strips of quads lengthwise, from the T-junctions to the border; None if impossible or too many quads arise.

    A split must go on to the border: a face at which it ended would have five sides, which quads cannot replace.
    """
    if not (mesh.sizes == 4).all() or np.bincount(sides.edge).max() > 2:
        return None
    strips = _strips(sides)
    if strips is None:
        return None
    strip, turned = strips
    cuts: dict[int, list[float]] = {}  # positions of the cuts by strip, 0 to 1 in the direction of its edges
    at: dict[tuple[int, int], int] = {}  # vertex of every cut on an edge, by edge and number of the cut
    for side in np.unique(found.side).tolist():
        own = np.flatnonzero(found.side == side)
        back = bool(turned[sides.edge[side]]) != bool(not sides.forward[side])
        shares = np.where(back, 1.0 - found.share[own], found.share[own])
        order = np.argsort(shares)
        edge = int(sides.edge[side])
        known = cuts.setdefault(int(strip[edge]), shares[order].tolist())
        if len(known) != len(own):
            return None
        at |= {(edge, k): int(found.vertex[own[j]]) for k, j in enumerate(order.tolist())}
    number = np.array([len(cuts.get(int(s), ())) for s in strip[sides.edge].reshape(-1, 4)[:, :2].ravel()]).reshape(
        -1, 2
    )
    if ((number + 1).prod(axis=1) - 1).sum() > MORE * len(mesh.sizes):
        return None
    return _split_quads(mesh, sides, strip, turned, cuts, at)


def _strips(sides: Sides) -> tuple[np.ndarray, np.ndarray] | None:
    """Number the strips of quads that are connected over opposite sides.

    Returns
    -------
    number of the strip that every edge crosses, and a mask of the edges directed against the first edge of their strip;
    None if a strip is a Moebius strip
    """
    n, edge = len(sides.edges), sides.edge.reshape(-1, 4)
    forward = sides.forward.reshape(-1, 4)
    first, second = edge[:, :2].ravel(), edge[:, 2:].ravel()
    # the opposite sides of a quad run in opposite directions, so if both run forward, their edges have opposite directions
    against = (forward[:, :2] == forward[:, 2:]).ravel()
    a = np.concatenate([first, first + n])
    b = np.concatenate([np.where(against, second + n, second), np.where(against, second, second + n)])
    cover = components(2 * n, a, b)
    if (cover[:n] == cover[n:]).any():
        return None
    strip = np.minimum(cover[:n], cover[n:])
    return strip, cover[:n] != strip


def _split_quads(
    mesh: PolygonMesh,
    sides: Sides,
    strip: np.ndarray,
    turned: np.ndarray,
    cuts: dict[int, list[float]],
    at: dict[tuple[int, int], int],
) -> PolygonMesh:
    """Divide every quad into the grid of quads that the cuts along its two strips make.

    Parameters
    ----------
    strip, turned : result of ``_strips``
    cuts : positions of the cuts by strip, 0 to 1 in the direction of the strip's edges
    at : vertices of the cuts by edge and number of the cut; new vertices are added in place
    """
    points = [np.asarray(mesh.vertices, float)]
    count, rows = len(mesh.vertices), []

    def add_vertex(point: np.ndarray) -> int:
        """Add a vertex and return its index."""
        nonlocal count
        points.append(point[None])
        count += 1
        return count - 1

    def side_vertices(side: int, back: bool) -> list[int]:
        """Return the vertices on a side from its start to its end, or in reverse if ``back``."""
        edge = int(sides.edge[side])
        shares = cuts.get(int(strip[edge]), [])
        low, high = mesh.vertices[sides.edges[edge]]
        inner = []
        for k, share in enumerate(shares):
            t = 1.0 - share if turned[edge] else share
            if (edge, k) not in at:
                at[edge, k] = add_vertex((1.0 - t) * low + t * high)
            inner.append(at[edge, k])
        if bool(turned[edge]) == bool(sides.forward[side]):
            inner.reverse()
        found = [int(mesh.corners[side]), *inner, int(sides.end_vertex[side])]
        return found[::-1] if back else found

    for face in range(len(mesh.sizes)):
        south, east, north, west = (side_vertices(4 * face + k, k >= 2) for k in range(4))
        grid = [south]
        for j in range(1, len(east) - 1):
            t = j / (len(east) - 1)
            middle = []
            for i in range(1, len(south) - 1):
                low, high = (np.concatenate(points)[one] for one in (south[i], north[i]))
                middle.append(add_vertex((1.0 - t) * low + t * high))
            grid.append([west[j], *middle, east[j]])
        grid.append(north)
        for low_row, high_row in pairwise(grid):
            rows += [(low_row[i], low_row[i + 1], high_row[i + 1], high_row[i]) for i in range(len(low_row) - 1)]
    corners = np.array(rows, np.int64)
    return replace(
        mesh, vertices=np.concatenate(points), corners=corners.ravel(), sizes=np.full(len(corners), 4, np.int64)
    )
