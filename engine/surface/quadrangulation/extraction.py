"""Extract the quads of the integer grid from a seamless map, robustly as Ebke et al. 2013.

A cell is a unit square of the grid; a piece is the part of a cell in one triangle. Pieces that meet across a side of
two triangles belong to one quad; pieces that meet across a grid line belong to neighbouring quads. The map's coordinates
are rounded to multiples of 1/65536 first and stored as integers, so that every comparison and every transition from
triangle to triangle is exact. Ebke et al. trace grid lines instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from ...components import components
from ...errors import FlexMapsError
from ..mesh import PolygonMesh
from .field import Triangles

FAR = 8000.0  # largest coordinate of the map, in quads; products of larger coordinates could overflow 64-bit integers
UNIT = 1 << 16  # integer steps per quad to which coordinates are rounded; larger: finer, but FAR must become smaller
# Largest number of cells that n triangles (or sides) may touch together: MOST n + LEAST. More than any useful map needs;
# larger values need more memory.
MOST, LEAST = 100, 1_000_000
CORNER = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # corners of a cell; side k runs from corner k to corner k + 1
STEP = np.array([[0, -1], [1, 0], [0, 1], [-1, 0]])  # offset to the cell across side k
# matrix of the rotation by -q quarter turns, for q = 0 to 3
TURNED = np.array([[[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]]])


@dataclass(frozen=True, eq=False)
class _CellPieces:
    """Pieces (parts of a cell in one triangle), sorted by triangle and cell.

    face : triangle of every piece
    cell : lower left corner of every piece's cell, in quads
    low, span : smallest coordinates of all cells, and number of cells along the longer side of their bounding box
    """

    face: Int[np.ndarray, " pieces"]
    cell: Int[np.ndarray, "pieces 2"]
    low: Int[np.ndarray, " 2"]
    span: int

    @staticmethod
    def sort_keys(face: np.ndarray, cell: np.ndarray, low: np.ndarray, span: int) -> np.ndarray:
        """Return a sortable number for each pair of a triangle and a cell; -1 for cells outside the bounding box.

        low, span : bounding box of the cells, as in the fields
        """
        at = cell - low
        inside = ((at >= 0) & (at < span)).all(axis=1)
        return np.where(inside, (face * span + at[:, 0]) * span + at[:, 1], -1)

    def index_of(self, face: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """Return the index of the piece of each cell in each triangle; -1 if there is none."""
        mine = self.sort_keys(self.face, self.cell, self.low, self.span)
        asked = self.sort_keys(face, cell, self.low, self.span)
        at = np.minimum(np.searchsorted(mine, asked), len(mine) - 1)
        return np.where(mine[at] == asked, at, -1)


def extract_quads(
    mesh: Triangles, jump: Int[np.ndarray, " sides"], uv: Float[np.ndarray, "triangles 3 2"]
) -> PolygonMesh:
    """Return the quads into which the integer grid divides a mapped surface.

    Parameters
    ----------
    mesh : triangles
    jump : for every side, quarter turns from the direction of u in its triangle to that in the neighbouring triangle
    uv : coordinates of every triangle's corners in the map, in quads. At a common side, a rotation by -jump quarter turns
        and an integer shift turn them into the neighbour's coordinates, with errors far below 1/65536

    Raises
    ------
    FlexMapsError : the map is stretched too much or folds, or the quads have another topology than the surface
    """
    if not np.isfinite(uv).all() or np.abs(uv).max() > FAR:
        raise FlexMapsError("The map is stretched too much")
    p = np.round(uv * UNIT).astype(np.int64)
    area = _cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    pieces = _cut_into_cells(p, area)
    merged, turns, glued = _adjacent_pieces(mesh, jump, p, area, pieces)
    quad, turn = _merge_pieces(len(pieces.face), merged, turns)
    sides = _matching_sides(quad, turn, glued)
    keep = _covered_quads(quad, pieces, p, area)
    result = _build_mesh(mesh, p, area, pieces, quad, turn, sides, keep)
    if not len(result.sizes):
        raise FlexMapsError("The map is smaller than a quad")
    if not _has_same_topology(mesh, result.corners.reshape(-1, 4)):
        raise FlexMapsError("The map folds over itself and tears the surface")
    return result


def _has_same_topology(mesh: Triangles, rows: np.ndarray) -> bool:
    """Return whether quads (rows of four vertices) are an oriented manifold with the triangles' Euler characteristic."""
    import igl

    triangles = np.concatenate([rows[:, [0, 1, 2]], rows[:, [0, 2, 3]]])
    directed = np.stack([rows.ravel(), np.roll(rows, -1, axis=1).ravel()], axis=1)
    return (
        len(np.unique(directed, axis=0)) == len(directed)
        and bool(np.all(igl.is_vertex_manifold(triangles)))
        and igl.euler_characteristic(triangles) == igl.euler_characteristic(mesh.corners)
    )


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products of plane vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _bounding_cells(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all cells that touch the bounding boxes of polygons: index of the polygon, and cell, for every such pair.

    p : corners of the polygons in integer steps, (n, k, 2)
    """
    low = np.floor_divide(p.min(axis=1), UNIT) - 1
    size = np.floor_divide(p.max(axis=1), UNIT) - low + 1
    number = size.prod(axis=1)
    if number.sum() > MOST * len(p) + LEAST:
        raise FlexMapsError("The map is stretched too much")
    which = np.repeat(np.arange(len(p)), number)
    k = np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number)
    return which, low[which] + np.stack([k % size[which, 0], k // size[which, 0]], axis=1)


def _intersects_boxes(points: np.ndarray, low: np.ndarray, high: np.ndarray, outward: np.ndarray | None) -> np.ndarray:
    """Return whether the interiors of convex polygons and boxes intersect, that is, no axis separates them.

    points : polygons or line segments, (n, k, 2)
    low, high : lower left and upper right corner of each box, (n, 2)
    outward : sign of each polygon's area, (n,); None for line segments
    """
    least, most = points.min(axis=1), points.max(axis=1)
    apart = ((most <= low) | (least >= high)).any(axis=1)
    box = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)], axis=1)
    count = points.shape[1]
    for k in range(count if count > 2 else 1):
        a, b = points[:, k], points[:, (k + 1) % count]
        side = _cross((b - a)[:, None], box - a[:, None])
        if outward is None:
            apart |= (side <= 0).all(axis=1) | (side >= 0).all(axis=1)
        else:
            apart |= (side * outward[:, None] <= 0).all(axis=1)
    return ~apart


def _cut_into_cells(p: np.ndarray, area: np.ndarray) -> _CellPieces:
    """Cut the triangles into pieces along the grid.

    p : coordinates of the triangles' corners in the map, in integer steps, (triangles, 3, 2)
    area : twice the signed area of every triangle in the map
    """
    solid = np.flatnonzero(area != 0)
    which, cell = _bounding_cells(p[solid])
    face = solid[which]
    meets = _intersects_boxes(p[face], cell * UNIT, (cell + 1) * UNIT, np.sign(area[face]))
    face, cell = face[meets], cell[meets]
    if not len(face):
        raise FlexMapsError("The map has no area")
    low = cell.min(axis=0)
    span = int((cell.max(axis=0) - low).max()) + 1
    order = np.argsort(_CellPieces.sort_keys(face, cell, low, span))
    return _CellPieces(face[order], cell[order], low, span)


def _adjacent_pieces(
    mesh: Triangles, jump: np.ndarray, p: np.ndarray, area: np.ndarray, pieces: _CellPieces
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find adjacent pieces; see ``extract_quads`` and ``_cut_into_cells`` for the arguments.

    Returns
    -------
    pairs of pieces of one cell that meet across a side of two triangles; quarter turns from the corner numbers of the
    first piece to those of the second; rows (piece, side, piece, side) of pieces that meet across a grid line
    """
    other = mesh.opposite
    glued = []
    for k in (1, 2):  # pieces of one triangle that meet across the right or the upper side of a cell
        there = pieces.index_of(pieces.face, pieces.cell + STEP[k])
        have = np.flatnonzero(there >= 0)
        low = (pieces.cell[have] + CORNER[[0, 1, 3][k]]) * UNIT
        high = (pieces.cell[have] + 1) * UNIT
        face = pieces.face[have]
        meets = _intersects_boxes(p[face], low, high, np.sign(area[face]))
        have = have[meets]
        glued.append(np.stack([have, np.full(len(have), k), there[have], np.full(len(have), k + 2) % 4], axis=1))
    sides = np.flatnonzero((other >= 0) & (np.arange(len(other)) < other))
    a, b = p.reshape(-1, 2)[sides], np.roll(p, -1, axis=1).reshape(-1, 2)[sides]
    here, there, q = sides // 3, other[sides] // 3, jump[sides]
    shift = np.roll(p, -1, axis=1).reshape(-1, 2)[other[sides]] - _rotate(a, q)
    back = p.reshape(-1, 2)[other[sides]] - _rotate(b, q)
    if (shift != back).any() or (shift % UNIT).any():
        raise FlexMapsError("The grid of quads does not fit together across its cuts; try another number of quads")
    which, cell = _bounding_cells(np.stack([a, b], axis=1))
    ends = np.stack([a, b], axis=1)[which]
    inside = _intersects_boxes(ends, cell * UNIT, (cell + 1) * UNIT, None)
    mine = pieces.index_of(here[which], cell)
    far = pieces.index_of(there[which], _rotate_cells(cell, q[which], shift[which]))
    good = inside & (mine >= 0) & (far >= 0)
    merged, turns = np.stack([mine, far], axis=1)[good], q[which][good]
    # a triangle's side on a grid line separates the cells on its left and right
    for axis in (0, 1):
        on = (a[:, axis] == b[:, axis]) & (a[:, axis] % UNIT == 0) & (a[:, 1 - axis] != b[:, 1 - axis])
        at = np.flatnonzero(on[which])
        s = which[at]
        line = a[s, axis] // UNIT
        along = np.stack([a[s, 1 - axis], b[s, 1 - axis]], axis=1)
        span = cell[at][:, 1 - axis] * UNIT
        hit = (along.min(axis=1) < span + UNIT) & (along.max(axis=1) > span)
        # the triangle lies left of its side, or right if it is flipped
        up = np.sign(along[:, 1] - along[:, 0]) * np.sign(area[here[s]]) * (-1 if axis == 0 else 1)
        first = np.where(up > 0, line, line - 1)
        hit &= cell[at][:, axis] == first
        at, s, up = at[hit], s[hit], up[hit]
        over = np.where(up > 0, 3 if axis == 0 else 0, 1 if axis == 0 else 2)
        next_cell = cell[at] + STEP[over]
        one, two = (
            pieces.index_of(here[s], cell[at]),
            pieces.index_of(there[s], _rotate_cells(next_cell, q[s], shift[s])),
        )
        good = (one >= 0) & (two >= 0)
        glued.append(np.stack([one, over, two, (over + 2 - q[s]) % 4], axis=1)[good])
    return merged, turns, np.concatenate(glued)


def _rotate(points: np.ndarray, quarters: np.ndarray) -> np.ndarray:
    """Rotate points (n, 2) about the origin by ``-quarters`` quarter turns each."""
    return np.einsum("nij,nj->ni", TURNED[quarters % 4], points)


def _rotate_cells(cell: np.ndarray, quarters: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return cells in the coordinates of a neighbouring triangle: rotate by ``-quarters`` quarter turns, then shift.

    shift : shift of the coordinates, in integer steps, multiples of UNIT, (n, 2)
    """
    return (_rotate(2 * cell + 1, quarters) - 1) // 2 + shift // UNIT


def _merge_pieces(count: int, merged: np.ndarray, turns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the quad of every piece, and the quarter turns from the piece's corner numbers to those of its quad.

    count : number of pieces
    merged, turns : pairs of pieces of one quad, and quarter turns between them, see ``_adjacent_pieces``
    """
    quad = components(count, *merged.T)
    turn, known = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    known[np.unique(quad, return_index=True)[1]] = True
    a, b = np.concatenate([merged, merged[:, ::-1]]).T
    t = np.concatenate([turns, -turns])
    while not known.all():
        new = known[a] & ~known[b]
        turn[b[new]] = turn[a[new]] + t[new]
        known[b[new]] = True
    if ((turn[a] + t - turn[b]) % 4).any():
        raise FlexMapsError("An irregular point lies inside a quad")
    return quad, turn % 4


def _matching_sides(quad: np.ndarray, turn: np.ndarray, glued: np.ndarray) -> np.ndarray:
    """Return every pair of quad sides that coincide, once; side k of quad q has the number 4 q + k.

    quad, turn : quad of every piece, and quarter turns of its corner numbers, see ``_merge_pieces``
    glued : rows (piece, side, piece, side) of pieces that meet across a grid line
    """
    one = 4 * quad[glued[:, 0]] + (glued[:, 1] + turn[glued[:, 0]]) % 4
    two = 4 * quad[glued[:, 2]] + (glued[:, 3] + turn[glued[:, 2]]) % 4
    return np.unique(np.sort(np.stack([one, two], axis=1), axis=1), axis=0)


def _covered_quads(quad: np.ndarray, pieces: _CellPieces, p: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return a mask of quads to keep, those that cover more than half a cell.

    Pieces of flipped triangles count negative, so that where the map folds over itself the pieces of a cell cancel out.
    """
    import shapely

    keep = np.ones(quad.max() + 1, dtype=bool)
    doubtful = np.unique(quad[area[pieces.face] < 0])
    at = np.flatnonzero(np.isin(quad, doubtful))
    if not len(at):
        return keep
    triangles = shapely.polygons(p[pieces.face[at]].astype(float))
    low, high = pieces.cell[at] * float(UNIT), (pieces.cell[at] + 1) * float(UNIT)
    parts = shapely.area(shapely.intersection(triangles, shapely.box(*low.T, *high.T))) / float(UNIT) ** 2
    net = np.bincount(quad[at], weights=parts * np.sign(area[pieces.face[at]]), minlength=len(keep))
    keep[doubtful] = net[doubtful] > 0.5
    return keep


def _build_mesh(
    mesh: Triangles,
    p: np.ndarray,
    area: np.ndarray,
    pieces: _CellPieces,
    quad: np.ndarray,
    turn: np.ndarray,
    sides: np.ndarray,
    keep: np.ndarray,
) -> PolygonMesh:
    """Build the quad mesh: merge coincident corners of quads and place them on the surface.

    mesh, p, area, pieces : see ``_cut_into_cells``
    quad, turn : quad of every piece, and quarter turns of its corner numbers, see ``_merge_pieces``
    sides : pairs of coincident quad sides
    keep : mask of quads to keep
    """
    sides = sides[keep[sides[:, 0] // 4] & keep[sides[:, 1] // 4]]
    if len(np.unique(sides)) != sides.size:
        raise FlexMapsError("The map folds over itself")
    one, two = sides.T
    after = lambda side: side - side % 4 + (side + 1) % 4  # noqa: E731
    a, b = np.concatenate([one, after(one)]), np.concatenate([after(two), two])
    count = 4 * len(keep)
    vertex = components(count, a, b)
    places, known = np.zeros((count, 3)), np.zeros(count, dtype=bool)
    for k in range(4):
        point = (pieces.cell + CORNER[k]) * UNIT
        corners = p[pieces.face]
        weight = np.stack(
            [_cross(corners[:, (j + 1) % 3] - point, corners[:, (j + 2) % 3] - point) for j in range(3)], axis=1
        )
        inside = (weight >= 0).all(axis=1) & (area[pieces.face] > 0)
        at = np.flatnonzero(inside)
        share = weight[at] / area[pieces.face[at]][:, None]
        v = vertex[4 * quad[at] + (k + turn[at]) % 4]
        places[v] = np.einsum("nk,nki->ni", share, mesh.vertices[mesh.corners[pieces.face[at]]])
        known[v] = True
    rows = vertex.reshape(-1, 4)[keep]
    if not known[rows].all():
        raise FlexMapsError("The map folds over itself at a corner of a quad")
    used, rows = np.unique(rows, return_inverse=True)
    rows = rows.reshape(-1, 4)
    return PolygonMesh(places[used], rows.ravel().astype(np.int64), np.full(len(rows), 4))
