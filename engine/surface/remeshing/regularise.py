"""Make the quads of a mesh squarer without leaving the surface, before the layout.

Every quad pulls its corners towards its best-fitting square; every vertex goes to the mean of these positions and is
projected back onto the surface (after Pietroni et al. 2015, Bouaziz et al. 2012). Vertices of the border and of sharp
creases stay on these lines, and their corners stay fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Bool, Float
from ...params import RegulariseParams
from ...progress import SILENT, Progress
from ...tolerances import DOUBLE_TOL
from ..checking.geometry import breadth
from ..mesh import QuadMesh
from ..symmetry import symmetries
from .guide import VertexConstraints, distances, sample_points

MOMENTUM = 0.5  # share of a vertex's last move that is added to its next move; larger: faster, up to overshooting
# Number of rounds between checks for spoilt quads (see ``_spoilt_quads``), as a check takes longer than a round. Larger:
# faster, later repair.
EVERY = 8
# Largest number of repair rounds at the end, in three stages of a third each, see ``_repair_spoilt_quads``. Larger: fewer
# vertices return to their original positions, slower.
MENDING = 36
# ``square_energy`` up to which a quad is accepted whatever its original energy. Larger: fewer moves are undone, and some
# quads get less square.
GOOD = 0.06
# Largest factor by which the ``square_energy`` of a quad above GOOD may grow. Larger: single quads get worse, and all
# quads squarer on average.
WORSE = 1.4
# Largest distance of original vertices and centroids from the regularised surface, in sizes of the quads there (root of
# the area). Larger: squarer quads, more detail of the surface is lost.
DEVIATION = 0.25
# Largest distance of corners from their quad's plane, in lengths of the quad's shortest side; quads warped more cannot
# be laid flat. Smaller: more quads leave the surface.
WARP = 0.15
# Quads that bend by more than this angle (see ``bend_angles``) are flattened, radians. Quads of smooth surfaces bend by
# less than 27 degrees. Smaller: more quads leave the surface.
BEND = np.radians(30.0)
SHORT = 0.3  # smallest edge length, in median edges, below which a quad's moves are undone; larger: more are undone
# Breadth of quads, in median edges, down to which quads may always become narrower. Larger: more room for spirals, less
# square quads.
PLENTY = 0.4
# Safety factor on measured breadths and lengths: the symmetrisation that follows changes them by less than 1 %. Smaller:
# more moves are undone.
SPARE = 0.99
# Largest number of rounds in which moves round narrow or distorted quads are shortened; after these, all moves are
# dropped. Larger: slower, more moves are kept.
ROUNDS = 40
SHORTER = 0.7  # factor by which a move is shortened in a round; larger: more of the move is kept, in more rounds
# Moves shortened to less than this share of their length are dropped, because traces of moves would keep quads bent.
# Larger: more moves are dropped.
SHORTEST = 0.01
SYMMETRY = 0.01  # symmetry tolerance, in median edges; larger: slightly asymmetric meshes become symmetric


def square_energy(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, " quads"]:
    """Return how much every quad differs from a square of its area; 0 for a square.

    This is the mean over the four corner triangles of (s1-1)^2 + (s2-1)^2, with s1 and s2 the singular values of the
    map from the square: the energy of ``FlatPatches.irregularity`` for quads in space.
    """
    along, against = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    cross = np.cross(along, against)
    # the area of a reflex corner is negative
    double = np.linalg.norm(cross, axis=2) * np.sign(np.einsum("fki,fi->fk", cross, normal))
    square = np.maximum(area, 1e-300)[:, None]
    squares = ((along**2).sum(axis=2) + (against**2).sum(axis=2)) / square
    sums = np.sqrt(np.maximum(squares + 2 * double / square, 0.0))
    return (squares - 2 * sums + 2).mean(axis=1)


def regularise(mesh: QuadMesh, params: RegulariseParams, progress: Progress = SILENT) -> QuadMesh:
    """Make quads squarer by moving vertices along the surface, border and creases of ``mesh``.

    No quad is turned over or becomes much less square, none becomes narrower than the narrowest was, no edge becomes
    short, and no part of the surface is lost: moves that would do so are undone, in the worst case all of them. A
    symmetric mesh stays symmetric.

    Parameters
    ----------
    mesh : quads, metres
    params : ``iterations``; with ``boundary`` False, border vertices slide freely over the surface
    progress : called with the fraction done

    Returns
    -------
    the regularised mesh, or ``mesh`` itself if it is no better
    """
    if params.iterations == 0:
        return mesh
    guide = VertexConstraints.from_mesh(mesh, params.boundary)
    points, shortened = _square_up(guide, params.iterations, progress.part(0.0, 0.45), with_room=False)
    if shortened:
        other, _ = _square_up(guide, params.iterations, progress.part(0.45, 0.9), with_room=True)
        points = min(points, other, key=lambda one: _mean_energy(mesh, one))
    points = _symmetrise(mesh, points, progress.part(0.9, 1.0))
    better = _mean_energy(mesh, points) < _mean_energy(mesh, mesh.vertices)
    return mesh.with_vertices(points) if better and not _tight_quads(mesh, points, 1.0 + DOUBLE_TOL).any() else mesh


def _square_up(
    guide: VertexConstraints, rounds: int, progress: Progress, *, with_room: bool
) -> tuple[Float[np.ndarray, "vertices 3"], bool]:
    """Iterate towards squarer quads, then undo moves that spoil quads.

    Parameters
    ----------
    guide : the mesh, with the lines on which vertices must stay
    rounds : number of iterations
    progress : called with the fraction done
    with_room : hold back quads that become too narrow from the start, so that quads around them adapt; the result is
        squarer on some meshes and less square on others

    Returns
    -------
    vertex positions, metres; whether moves were shortened at the end because quads were too narrow or distorted
    """
    mesh = guide.mesh
    points = before = mesh.vertices
    hold = _MoveWeights(mesh, np.ones(len(mesh.quads)), np.zeros(len(points)))
    for done in range(rounds):
        progress(0.9 * done / rounds, "making quads squarer")
        if done % EVERY == EVERY - 1:
            worse, away = _spoilt_quads(mesh, points, 0.8)
            tight = _tight_quads(mesh, points, SPARE) if with_room else np.zeros_like(away)
            hold = hold.for_next_round(worse, away | tight, keep=0.8)
        wanted = points + hold.moves(points) + MOMENTUM * (points - before)
        points, before = guide.move_towards(points, wanted), points
    points = _flatten_warped_quads(mesh, _repair_spoilt_quads(points, hold, guide, progress.part(0.9, 1.0)))
    kept = _shorten_moves(mesh, points)
    return kept, bool(np.abs(kept - points).max() > DOUBLE_TOL * mesh.median_edge)


def _mean_energy(mesh: QuadMesh, points: np.ndarray) -> float:
    """Return the mean of ``square_energy`` over the quads, with their vertices at ``points``."""
    return float(square_energy(points[mesh.quads]).mean())


# -- one round -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _MoveWeights:
    """Weights with which squares and original positions attract vertices in a round; they grow where quads get worse.

    weight : weight of every quad at its corners; larger for quads that became less square
    anchor : weight of every vertex's original position, where its quads together weigh 1; larger where parts of the
        surface or room for spirals would be lost
    """

    mesh: QuadMesh
    weight: Float[np.ndarray, " quads"]
    anchor: Float[np.ndarray, " vertices"]

    def moves(self, points: np.ndarray) -> Float[np.ndarray, "vertices 3"]:
        """Return every vertex's move to the weighted mean of its quads' squares and its original position, metres."""
        corners = points[self.mesh.quads]
        squares = best_squares(corners)
        # divide by the quads' areas, else large quads crush small neighbours
        area = np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
        weight = np.repeat(self.weight / np.maximum(area, 1e-3 * np.median(area)), 4)
        at, n = self.mesh.quads.ravel(), len(points)
        total = np.stack([np.bincount(at, weight * squares[..., k].ravel(), minlength=n) for k in range(3)], axis=1)
        wanted = total / np.maximum(np.bincount(at, weight, minlength=n), 1e-300)[:, None]
        share = (1.0 / (1.0 + self.anchor))[:, None]
        return share * (wanted - points) + (1.0 - share) * (self.mesh.vertices - points)

    def for_next_round(
        self, worse: Bool[np.ndarray, " quads"], away: Bool[np.ndarray, " quads"], keep: float = 1.0
    ) -> _MoveWeights:
        """Return the weights for the next rounds.

        worse : mask of quads that became much less square; their weights double
        away : mask of quads that are too narrow or too far from the surface; the anchors of their corners grow
        keep : factor for all other quads and vertices, on the anchor and on the part of the weight above 1
        """
        weight = np.where(worse, np.minimum(2 * self.weight, 100.0), 1 + keep * (self.weight - 1))
        near = _corners_of(self.mesh, away)
        return replace(self, weight=weight, anchor=np.where(near, 2 * self.anchor + 0.2, keep * self.anchor))


def _corners_of(mesh: QuadMesh, quads: Bool[np.ndarray, " quads"]) -> Bool[np.ndarray, " vertices"]:
    """Return a mask of the vertices of masked quads."""
    mask = np.zeros(len(mesh.vertices), dtype=bool)
    mask[mesh.quads[quads]] = True
    return mask


def best_squares(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, "quads 4 3"]:
    """Return the corners of the square that fits every quad best, by least squares.

    The diagonals G = (d1, d2) of a square are orthogonal and equally long; the nearest such pair is s Q with the polar
    factor Q = G (G^T G)^-1/2 and s the mean singular value.
    """
    middle = corners.mean(axis=1)
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    a, b = np.einsum("fi,fi->f", first, first), np.einsum("fi,fi->f", second, second)
    c = np.einsum("fi,fi->f", first, second)
    root = np.sqrt(np.maximum(a * b - c * c, 0.0))  # s1 s2
    # for 2 x 2 matrices (G^T G)^-1/2 = [[b + root, -c], [-c, a + root]] / (root * (s1 + s2))
    factor = 0.25 / np.maximum(root, 1e-12 * (a + b) + 1e-300)  # half a diagonal: 1/2 s / (root (s1 + s2))
    one = ((b + root)[:, None] * first - c[:, None] * second) * factor[:, None]
    two = ((a + root)[:, None] * second - c[:, None] * first) * factor[:, None]
    return np.stack([middle - one, middle - two, middle + one, middle + two], axis=1)


# -- guard -----------------------------------------------------------------------------------------------------------


def _repair_spoilt_quads(
    points: np.ndarray, hold: _MoveWeights, guide: VertexConstraints, progress: Progress
) -> np.ndarray:
    """Iterate further, with growing weights at spoilt quads, until no quad is spoilt (see ``_spoilt_quads``).

    In the second stage the vertices of spoilt quads return to their original positions, in the third also their
    neighbours, ring by ring; if that does not help, all vertices return.
    """
    mesh = guide.mesh
    back = np.zeros(len(points), dtype=bool)
    for done in range(MENDING):
        progress(done / MENDING, "making quads squarer")
        worse, away = _spoilt_quads(mesh, points)
        if not (worse | away).any():
            return points
        hold = hold.for_next_round(worse, away)
        if done >= MENDING // 3:
            back |= _corners_of(mesh, worse | away)
            if done >= 2 * MENDING // 3:
                back |= _corners_of(mesh, back[mesh.quads].any(axis=1))
            hold.anchor[back] = np.inf
            points = np.where(back[:, None], mesh.vertices, points)
        for _ in range(3):
            points = guide.move_towards(points, points + hold.moves(points))
    return mesh.vertices


def _flatten_warped_quads(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """Return positions with warped quads flattened: no corner is farther from its quad's plane than the limit ``WARP``.

    Vertices may leave the surface; border vertices do not move.
    """

    def max_offset(corners: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Return the largest allowed distance of every quad's corners from its plane, metres."""
        return WARP * _side_lengths(corners).min(axis=1)

    return _flatten_quads(mesh, points, max_offset)


def flatten_bent_quads(mesh: QuadMesh) -> QuadMesh:
    """Return a mesh with quads that bend by more than ``BEND`` flattened; the mesh itself if there are none.

    Such a quad spans a feature of the surface smaller than itself, so its vertices leave the surface by a share of an
    edge. Quads of smooth surfaces bend less and are not changed. If a quad would become too narrow or distorted, the
    moves round the quad are shortened, and it keeps a part of its bend. Border vertices do not move.
    """
    if bend_angles(mesh.vertices[mesh.quads]).max() <= BEND:
        return mesh

    def max_offset(corners: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Return the largest allowed distance of every quad's corners from its plane, metres."""
        return np.abs(off) * BEND / np.maximum(bend_angles(corners), 1e-300)

    return mesh.with_vertices(_shorten_moves(mesh, _flatten_quads(mesh, mesh.vertices, max_offset)))


def bend_angles(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, " quads"]:
    """Return the bend of every quad: the largest angle between the normals at two adjacent corners, radians."""
    normals = np.cross(np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners)
    normals /= np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[..., None]
    return np.arccos(np.clip(np.einsum("fki,fki->fk", normals, np.roll(normals, -1, axis=1)), -1.0, 1.0)).max(axis=1)


def _flatten_quads(
    mesh: QuadMesh, points: np.ndarray, max_offset: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return positions at which no corner is farther from its quad's plane than allowed; border vertices do not move.

    max_offset : function of the corners (quads, 4, 3) and of the signed distance of every quad's first corner from its
        plane (quads,), metres; returns the largest allowed distance for every quad (quads,)
    """
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    for _ in range(100):
        p = points[mesh.quads]
        normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        # all four corners are equally far from the plane through the sides' midpoints, alternately above and below
        off = 0.25 * np.einsum("k,fki,fi->f", signs, p, normal)
        most = max_offset(p, off)
        excess = np.sign(off) * np.maximum(np.abs(off) - 0.9 * most, 0.0) * (np.abs(off) > most)
        if not excess.any():
            break
        step = np.zeros_like(points)
        np.add.at(step, mesh.quads, -0.5 * excess[:, None, None] * signs[:, None] * normal[:, None, :])
        step[mesh.on_border] = 0.0
        points = points + step
    return points


def _shorten_moves(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """Return positions with shorter moves of vertices at quads that became too narrow or distorted.

    If that does not help, all vertices return to their original positions.

    points : moved vertex positions, metres
    """
    share = np.ones(len(points))
    for _ in range(ROUNDS):
        moved = mesh.vertices + share[:, None] * (points - mesh.vertices)
        wrong = _tight_quads(mesh, moved, SPARE) | _much_worse_quads(mesh, moved)
        if not wrong.any():
            return moved
        share[_corners_of(mesh, wrong)] *= SHORTER
        share[share < SHORTEST] = 0.0
    return mesh.vertices


def _tight_quads(mesh: QuadMesh, points: np.ndarray, limit: float) -> Bool[np.ndarray, " quads"]:
    """Return a mask of quads that became narrower than allowed, or got a side shorter than ``SHORT``.

    The smallest breadth allowed is ``PLENTY``, or the breadth of the narrowest original quad if that is smaller.

    points : new vertex positions, metres
    limit : factor on the new breadths and lengths before they are compared
    """
    before, after = mesh.vertices[mesh.quads], points[mesh.quads]
    edges, sides = _side_lengths(before), _side_lengths(after)
    # compare lengths as shares of the median edge, by which the mesh is scaled in the end; a quad is masked only if it
    # became narrower or its side shorter
    middle, now, room, least = np.median(edges), np.median(sides), breadth(before), breadth(after)
    narrow = (limit * least / now < min(room.min() / middle, PLENTY)) & (least < (1.0 - DOUBLE_TOL) * room)
    short = (limit * sides < SHORT * now) & (edges >= SHORT * middle) & (sides < (1.0 - DOUBLE_TOL) * edges)
    return narrow | short.any(axis=1)


def _much_worse_quads(mesh: QuadMesh, points: np.ndarray) -> Bool[np.ndarray, " quads"]:
    """Return a mask of quads whose ``square_energy`` exceeds both ``GOOD`` and ``WORSE`` times its original value."""
    before, after = square_energy(mesh.vertices[mesh.quads]), square_energy(points[mesh.quads])
    return after > np.maximum(GOOD, WORSE * before)


def _side_lengths(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, "quads 4"]:
    """Return the lengths of the sides of quads, in the unit of the corners."""
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def _symmetrise(mesh: QuadMesh, points: np.ndarray, progress: Progress) -> np.ndarray:
    """Return positions with the moves averaged over the mesh's symmetries.

    The moves break symmetries slightly where two points of the surface are equally near to a vertex.

    points : moved vertex positions, metres
    """
    moves = points - mesh.vertices
    group = symmetries(mesh, tolerance=SYMMETRY, progress=progress)
    total = moves + sum(moves[s.vertices] @ s.matrix for s in group)
    return mesh.vertices + total / (1 + len(group))


def _spoilt_quads(
    mesh: QuadMesh, points: np.ndarray, limit: float = 1.0
) -> tuple[Bool[np.ndarray, " quads"], Bool[np.ndarray, " quads"]]:
    """Return masks of spoilt quads: quads that became much less square, and quads from which the surface moved away.

    A quad is in the second mask if one of its original corners or its original centroid is farther from the new surface
    than the limit ``DEVIATION``.

    points : new vertex positions, metres
    limit : factor on the tolerances; smaller is stricter
    """
    before, after = square_energy(mesh.vertices[mesh.quads]), square_energy(points[mesh.quads])
    worse = after > np.maximum(GOOD * limit, (1 + (WORSE - 1) * limit) * before)
    distance = distances(mesh.with_vertices(points), sample_points(mesh))
    at_corners, at_middle = np.split(distance, [len(points)])
    away = np.maximum(at_corners[mesh.quads].max(axis=1), at_middle) > DEVIATION * limit * np.sqrt(mesh.areas)
    return worse, away
