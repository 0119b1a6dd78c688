"""Make quads squarer without leaving the surface, before they are flattened.

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
from .guide import Guide, distances, samples

MOMENTUM = 0.5  # share of the last move that is added to the next: twice as far in as many rounds
EVERY = 8  # rounds between checks for spoilt quads; a check builds a search tree, which costs more than a round
MENDING = 36  # rounds of repair at the end, in three stages of a third each
GOOD = 0.06  # square energy up to which a quad is good, whatever it had before
WORSE = 1.4  # largest factor by which a quad's square energy may grow so that others improve
DEVIATION = 0.25  # largest distance of old vertices and middles from the new surface, in sizes of the quads there
# largest distance of corners from their quad's plane, in lengths of its shortest side; more cannot be flattened
WARP = 0.15
# Radians: a quad that bends further is pressed flat. Of 17 surfaces remeshed to some 500 quads, all stay below 27
# degrees but Suzanne, a figure with fingers, a heart and a bent eight; a hyperbolic paraboloid of 36 quads stays below
# 19.
BEND = np.radians(30.0)
SHORT = 0.3  # smallest edge length, in median edges
# In median edges: quads broader than this have enough room, so squareness matters more; cubespheres and saddles fall
# from 0.8 to 0.75.
PLENTY = 0.4
SPARE = 0.99  # factor on measured breadths and lengths, in reserve for the symmetrisation, which changes them by less
ROUNDS = 40  # rounds of shortening moves round quads without room, before all moves are given up
# Factor on a move per such round: over ten surfaces 0.5 leaves some more quads bent, 0.85 some less in more rounds
SHORTER = 0.7
SHORTEST = 0.01  # a move shortened to less than this share is dropped: without it a bunny keeps 70 bent quads, not 19; 0.02 is as good
SYMMETRY = 0.01  # symmetry tolerance, in median edges


def square_energy(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, " quads"]:
    """Distance of quads from a square of the same area: 0 for a square.

    Mean over the four corner triangles of (s1-1)^2 + (s2-1)^2 of the map from the square, as ``FlatPatches.square``,
    but in space.
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
    """Return the same quads, squarer: vertices moved along the surface, border and creases of ``mesh``.

    No quad is turned over or becomes much worse, the least room for a spiral does not shrink, no edge becomes short,
    and no part of the surface is lost: moves that would do so are undone, in the worst case all of them. A symmetric
    mesh stays symmetric.

    Parameters
    ----------
    mesh : quads, metres
    params : ``iterations``; ``boundary`` False lets border vertices slide over the surface
    progress : called with the fraction done

    Returns
    -------
    the regularised mesh, or ``mesh`` itself if it is no better
    """
    if params.iterations == 0:
        return mesh
    guide = Guide.from_mesh(mesh, params.boundary)
    points, shortened = _settle(guide, params.iterations, progress.part(0.0, 0.45), with_room=False)
    if shortened:
        other, _ = _settle(guide, params.iterations, progress.part(0.45, 0.9), with_room=True)
        points = min(points, other, key=lambda one: _mean_energy(mesh, one))
    points = _symmetrise(mesh, points, progress.part(0.9, 1.0))
    better = _mean_energy(mesh, points) < _mean_energy(mesh, mesh.vertices)
    return mesh.moved(points) if better and not _tight_quads(mesh, points, 1.0 + DOUBLE_TOL).any() else mesh


def _settle(
    guide: Guide, rounds: int, progress: Progress, *, with_room: bool
) -> tuple[Float[np.ndarray, "vertices 3"], bool]:
    """Return squarer quads without flaws, and whether moves were shortened at the end, as quads had too little room or shape.

    With ``with_room``, quads with too little room are held from the start, so that those around can settle beside them;
    on some meshes that ends squarer, on others less square.
    """
    mesh = guide.mesh
    points = before = mesh.vertices
    hold = _Hold(mesh, np.ones(len(mesh.quads)), np.zeros(len(points)))
    for done in range(rounds):
        progress(0.9 * done / rounds, "regularise")
        if done % EVERY == EVERY - 1:
            worse, away = _spoilt_quads(mesh, points, 0.8)
            tight = _tight_quads(mesh, points, SPARE) if with_room else np.zeros_like(away)
            hold = hold.after(worse, away | tight, keep=0.8)
        wanted = points + hold.pull(points) + MOMENTUM * (points - before)
        points, before = guide.back(points, wanted), points
    points = _unwarp(mesh, _repair(points, hold, guide, progress.part(0.9, 1.0)))
    kept = _shorten_moves(mesh, points)
    return kept, bool(np.abs(kept - points).max() > DOUBLE_TOL * mesh.median_edge)


def _mean_energy(mesh: QuadMesh, points: np.ndarray) -> float:
    """Return the mean square energy of quads with their vertices at ``points``."""
    return float(square_energy(points[mesh.quads]).mean())


# -- one round -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Hold:
    """Weights that hold the mesh back from being spoilt.

    weight : of every quad's pull; larger for quads that became worse
    anchor : pull of a vertex to its original position, relative to its quads'; larger where surface or room is lost
    """

    mesh: QuadMesh
    weight: Float[np.ndarray, " quads"]
    anchor: Float[np.ndarray, " vertices"]

    def pull(self, points: np.ndarray) -> Float[np.ndarray, "vertices 3"]:
        """Return the moves, metres, to the mean of the quads' squares and the original positions, weighted."""
        corners = points[self.mesh.quads]
        squares = best_squares(corners)
        # weight distances relative to the quad's size, else large quads crush small neighbours
        area = np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
        weight = np.repeat(self.weight / np.maximum(area, 1e-3 * np.median(area)), 4)
        at, n = self.mesh.quads.ravel(), len(points)
        total = np.stack([np.bincount(at, weight * squares[..., k].ravel(), minlength=n) for k in range(3)], axis=1)
        wanted = total / np.maximum(np.bincount(at, weight, minlength=n), 1e-300)[:, None]
        share = (1.0 / (1.0 + self.anchor))[:, None]
        return share * (wanted - points) + (1.0 - share) * (self.mesh.vertices - points)

    def after(self, worse: Bool[np.ndarray, " quads"], away: Bool[np.ndarray, " quads"], keep: float = 1.0) -> _Hold:
        """Tighten where quads became ``worse``, or lost surface or room (``away``); keep the share ``keep`` of the weights elsewhere."""
        weight = np.where(worse, np.minimum(2 * self.weight, 100.0), 1 + keep * (self.weight - 1))
        near = _corners_of(self.mesh, away)
        return replace(self, weight=weight, anchor=np.where(near, 2 * self.anchor + 0.2, keep * self.anchor))


def _corners_of(mesh: QuadMesh, quads: Bool[np.ndarray, " quads"]) -> Bool[np.ndarray, " vertices"]:
    """Mask of the vertices of some quads."""
    mask = np.zeros(len(mesh.vertices), dtype=bool)
    mask[mesh.quads[quads]] = True
    return mask


def best_squares(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, "quads 4 3"]:
    """Corners of the least-squares square of every quad.

    The diagonals G = (d1, d2) of a square are orthogonal and equally long; the nearest such pair is s Q with the polar
    factor Q = G (G^T G)^-1/2 and s the mean singular value.
    """
    middle = corners.mean(axis=1)
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    a, b = np.einsum("fi,fi->f", first, first), np.einsum("fi,fi->f", second, second)
    c = np.einsum("fi,fi->f", first, second)
    root = np.sqrt(np.maximum(a * b - c * c, 0.0))  # s1 s2
    # for 2 x 2 matrices (G^T G)^-1/2 = [[b + root, -c], [-c, a + root]] / (root * (s1 + s2))
    factor = 0.25 / np.maximum(root, 1e-12 * (a + b) + 1e-300)  # half a diagonal of (s1 + s2) / 2 Q
    one = ((b + root)[:, None] * first - c[:, None] * second) * factor[:, None]
    two = ((a + root)[:, None] * second - c[:, None] * first) * factor[:, None]
    return np.stack([middle - one, middle - two, middle + one, middle + two], axis=1)


# -- guard -----------------------------------------------------------------------------------------------------------


def _repair(points: np.ndarray, hold: _Hold, guide: Guide, progress: Progress) -> np.ndarray:
    """Iterate further, holding spoilt quads ever more tightly, until none is spoilt.

    In the later rounds the vertices of spoilt quads return to their original positions, in growing neighbourhoods; if
    that does not help, all vertices do.
    """
    mesh = guide.mesh
    back = np.zeros(len(points), dtype=bool)
    for done in range(MENDING):
        progress(done / MENDING, "regularise")
        worse, away = _spoilt_quads(mesh, points)
        if not (worse | away).any():
            return points
        hold = hold.after(worse, away)
        if done >= MENDING // 3:
            back |= _corners_of(mesh, worse | away)
            if done >= 2 * MENDING // 3:
                back |= _corners_of(mesh, back[mesh.quads].any(axis=1))
            hold.anchor[back] = np.inf
            points = np.where(back[:, None], mesh.vertices, points)
        for _ in range(3):
            points = guide.back(points, points + hold.pull(points))
    return mesh.vertices


def _unwarp(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """Press warped quads flat, off the surface if need be, until no corner is farther than WARP from its plane.

    A quad warped much more cannot be flattened without too much distortion. Border vertices stay.
    """

    def allowed(corners: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Return the largest distance of corners from their quad's plane, metres."""
        return WARP * _sides(corners).min(axis=1)

    return _press_flat(mesh, points, allowed)


def flatter(mesh: QuadMesh) -> QuadMesh:
    """Press quads that bend by more than BEND flat; return the mesh itself if there are none.

    Such a quad spans a feature of the surface smaller than itself, so its vertices leave the surface by a share of an
    edge. Quads of smooth surfaces bend less and stay. If a quad would lose its room or its shape, the moves round it
    are shortened, and it keeps a part of its bend. Border vertices stay.
    """
    if bends(mesh.vertices[mesh.quads]).max() <= BEND:
        return mesh

    def allowed(corners: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Return the largest distance of corners from their quad's plane, metres."""
        return np.abs(off) * BEND / np.maximum(bends(corners), 1e-300)

    return mesh.moved(_shorten_moves(mesh, _press_flat(mesh, mesh.vertices, allowed)))


def bends(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, " quads"]:
    """Largest angle between the normals at two adjacent corners of every quad, radians."""
    normals = np.cross(np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners)
    normals /= np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[..., None]
    return np.arccos(np.clip(np.einsum("fki,fki->fk", normals, np.roll(normals, -1, axis=1)), -1.0, 1.0)).max(axis=1)


def _press_flat(
    mesh: QuadMesh, points: np.ndarray, allowed: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Press quads flat until no corner is farther from its quad's plane than allowed.

    allowed : function of corners (quads, 4, 3) and their signed distance (quads,) that returns the distance allowed,
        metres
    """
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    for _ in range(100):
        p = points[mesh.quads]
        normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        # relative to the plane through the middles the four corners are equally far, alternately above and below
        off = 0.25 * np.einsum("k,fki,fi->f", signs, p, normal)
        most = allowed(p, off)
        excess = np.sign(off) * np.maximum(np.abs(off) - 0.9 * most, 0.0) * (np.abs(off) > most)
        if not excess.any():
            break
        step = np.zeros_like(points)
        np.add.at(step, mesh.quads, -0.5 * excess[:, None, None] * signs[:, None] * normal[:, None, :])
        step[mesh.on_border] = 0.0
        points = points + step
    return points


def _shorten_moves(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """Shorten the moves round quads that lose too much room or shape; drop all moves if that does not help."""
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
    """Mask quads that became narrower than the narrowest was, or have a short side, at ``limit`` times the measured sizes."""
    before, after = mesh.vertices[mesh.quads], points[mesh.quads]
    edges, sides = _sides(before), _sides(after)
    # compare shares of the median edge, which scales the mesh back to its size; a quad that did not move is never at
    # fault
    middle, now, room, least = np.median(edges), np.median(sides), breadth(before), breadth(after)
    narrow = (limit * least / now < min(room.min() / middle, PLENTY)) & (least < (1.0 - DOUBLE_TOL) * room)
    short = (limit * sides < SHORT * now) & (edges >= SHORT * middle) & (sides < (1.0 - DOUBLE_TOL) * edges)
    return narrow | short.any(axis=1)


def _much_worse_quads(mesh: QuadMesh, points: np.ndarray) -> Bool[np.ndarray, " quads"]:
    """Mask quads whose square energy exceeds its limit."""
    before, after = square_energy(mesh.vertices[mesh.quads]), square_energy(points[mesh.quads])
    return after > np.maximum(GOOD, WORSE * before)


def _sides(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, "quads 4"]:
    """Lengths of the sides of quads."""
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def _symmetrise(mesh: QuadMesh, points: np.ndarray, progress: Progress) -> np.ndarray:
    """Average the moves over the symmetries of ``mesh``; ties between nearest points would otherwise break them slightly."""
    moves = points - mesh.vertices
    group = symmetries(mesh, tolerance=SYMMETRY, progress=progress)
    total = moves + sum(moves[s.vertices] @ s.matrix for s in group)
    return mesh.vertices + total / (1 + len(group))


def _spoilt_quads(
    mesh: QuadMesh, points: np.ndarray, limit: float = 1.0
) -> tuple[Bool[np.ndarray, " quads"], Bool[np.ndarray, " quads"]]:
    """Return masks of quads that became much worse, and of quads that the new surface leaves, at ``limit`` times the tolerances."""
    before, after = square_energy(mesh.vertices[mesh.quads]), square_energy(points[mesh.quads])
    worse = after > np.maximum(GOOD * limit, (1 + (WORSE - 1) * limit) * before)
    distance = distances(mesh.moved(points), samples(mesh))
    at_corners, at_middle = np.split(distance, [len(points)])
    away = np.maximum(at_corners[mesh.quads].max(axis=1), at_middle) > DEVIATION * limit * np.sqrt(mesh.areas)
    return worse, away
