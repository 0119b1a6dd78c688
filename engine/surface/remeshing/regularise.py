"""Make the quads squarer without leaving the surface, before they are flattened.

Every quad pulls its corners towards the square that fits it best; every vertex goes to the mean of what its quads want
and back onto the surface (after Pietroni et al. 2015, Bouaziz et al. 2012). Vertices of the border and of sharp creases
stay on these lines, their corners stay where they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Bool, Float
from ...params import RegulariseParams
from ...progress import SILENT, Progress
from ..checking.geometry import breadth
from ..mesh import QuadMesh
from ..symmetry import symmetries
from .guide import Guide, distances, samples

MOMENTUM = 0.5  # share of the last move that goes on: twice as far in the same number of rounds
EVERY = 8  # rounds after which spoilt quads are looked for, for which a search tree is built: dearer than a round
MENDING = 36  # how often spoilt quads are mended at the end, in three stages of a third each
GOOD = 0.06  # a quad with no more square energy than this is fine, whatever it had before
WORSE = 1.4  # how many times its square energy another quad may get for the good of the others
DEVIATION = 0.25  # how far the new surface may leave a vertex or middle of the old one, relative to the quads there
WARP = 0.15  # how far corners may lie off their quad's plane, relative to its shortest side: more cannot be flattened
# a quad that bends further is pressed flat: of 17 surfaces that were remeshed to some 500 quads, all but Suzanne, a figure with fingers, a
# heart and a bent eight stay below 27 degrees, and a hyperbolic paraboloid of 36 quads below 19
BEND = np.radians(30.0)
SHORT = 0.3  # of the median edge: no edge becomes shorter than that
# median edges: quads broader than this have room enough, and square ones are worth more; cubespheres and saddles fall from .8 to .75
PLENTY = 0.4
ROUNDED = 1e-9  # by what share a figure may fall that only rounding has changed
SPARE = 0.99  # of what is measured before moves are made symmetric, which changes it by less
ROUNDS = 40  # in which moves round quads without room are made shorter before none is made
SHORTER = 0.7  # share of a move that is left after such a round; not measured
SHORTEST = 0.01  # a smaller share of a move is none; not measured
RISE = 0.2  # by which these shares differ within a quad at the most: at a sharper step its corners part; not measured
SYMMETRY = 0.01  # how far a mirrored vertex may be off, relative to the median edge


def square_energy(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, " quads"]:
    """How far quads are from a square of the same area: 0 for a square.

    Mean over the four corner triangles of (s1-1)^2 + (s2-1)^2 of the map from the square, as ``FlatPatches.square``, but
    in space.
    """
    along, against = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    cross = np.cross(along, against)
    # a corner that is turned over counts with its sign
    double = np.linalg.norm(cross, axis=2) * np.sign(np.einsum("fki,fi->fk", cross, normal))
    square = np.maximum(area, 1e-300)[:, None]
    squares = ((along**2).sum(axis=2) + (against**2).sum(axis=2)) / square
    sums = np.sqrt(np.maximum(squares + 2 * double / square, 0.0))
    return (squares - 2 * sums + 2).mean(axis=1)


def regularise(mesh: QuadMesh, params: RegulariseParams, progress: Progress = SILENT) -> QuadMesh:
    """The same quads, squarer: vertices moved along the surface, the border and the creases of ``mesh``.

    No quad is turned over or becomes much worse, the least room for a spiral does not fall, no edge becomes short, and no
    part of the surface is lost: where a move would do so it is taken back. Where that does not help, ``mesh`` itself comes back. ``params.boundary`` False lets border vertices slide freely over the
    surface. A symmetric mesh stays symmetric.
    """
    if params.iterations == 0:
        return mesh
    guide = Guide.of(mesh, params.boundary)
    points = before = mesh.vertices
    hold = _Hold(mesh, np.ones(len(mesh.quads)), np.zeros(len(points)))
    for done in range(params.iterations):
        progress(0.8 * done / params.iterations, "regularise")
        if done % EVERY == EVERY - 1:
            hold = hold.after(*_spoilt(mesh, points, 0.8), keep=0.8)
        wanted = points + hold.pull(points) + MOMENTUM * (points - before)
        points, before = guide.back(points, wanted), points
    progress(0.8, "regularise")
    points = _mended(points, hold, guide, progress.part(0.8, 0.9))
    progress(0.9, "regularise")
    points = _taken_back(mesh, _unwarped(mesh, points))
    points = _symmetric(mesh, points, progress.part(0.9, 1.0))
    better = square_energy(points[mesh.quads]).mean() < square_energy(mesh.vertices[mesh.quads]).mean()
    return mesh.moved(points) if better and not _tight(mesh, points, 1.0 + ROUNDED).any() else mesh


# -- one round -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Hold:
    """What stands against spoiling.

    weight : how much every quad's wish counts; more for quads that became worse
    anchor : how strongly a vertex is drawn to its first place, relative to its quads; more where surface is lost
    """

    mesh: QuadMesh
    weight: Float[np.ndarray, " quads"]
    anchor: Float[np.ndarray, " vertices"]

    def pull(self, points: np.ndarray) -> Float[np.ndarray, "vertices 3"]:
        """Metres: from every vertex to the mean of the corners that its quads want it to be, and its first place."""
        corners = points[self.mesh.quads]
        squares = best_squares(corners)
        # distances relative to the quad's size are what counts: without it large quads crush small neighbours
        area = np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
        weight = np.repeat(self.weight / np.maximum(area, 1e-3 * np.median(area)), 4)
        at, n = self.mesh.quads.ravel(), len(points)
        total = np.stack([np.bincount(at, weight * squares[..., k].ravel(), minlength=n) for k in range(3)], axis=1)
        wanted = total / np.maximum(np.bincount(at, weight, minlength=n), 1e-300)[:, None]
        share = (1.0 / (1.0 + self.anchor))[:, None]
        return share * (wanted - points) + (1.0 - share) * (self.mesh.vertices - points)

    def after(self, worse: Bool[np.ndarray, " quads"], away: Bool[np.ndarray, " quads"], keep: float = 1.0) -> _Hold:
        """Tighter where quads became ``worse`` or where the surface went ``away``; elsewhere ``keep`` of it."""
        weight = np.where(worse, np.minimum(2 * self.weight, 100.0), 1 + keep * (self.weight - 1))
        near = _corners_of(self.mesh, away)
        return replace(self, weight=weight, anchor=np.where(near, 2 * self.anchor + 0.2, keep * self.anchor))


def _corners_of(mesh: QuadMesh, quads: Bool[np.ndarray, " quads"]) -> Bool[np.ndarray, " vertices"]:
    """The vertices of some quads."""
    mask = np.zeros(len(mesh.vertices), dtype=bool)
    mask[mesh.quads[quads]] = True
    return mask


def best_squares(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, "quads 4 3"]:
    """The corners of the square nearest to every quad in the sense of least squares.

    The diagonals G = (d1, d2) of a square are orthogonal and equally long; the nearest such pair is
    s Q with the polar factor Q = G (G^T G)^-1/2 and s the mean singular value.
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


def _mended(points: np.ndarray, hold: _Hold, guide: Guide, progress: Progress) -> np.ndarray:
    """More rounds in which spoilt quads are held ever more tightly, until none is spoilt.

    What is spoilt even then goes back where it was, in a wider and wider round; in the worst case all of it.
    """
    mesh = guide.mesh
    back = np.zeros(len(points), dtype=bool)
    for done in range(MENDING):
        progress(done / MENDING, "regularise")
        worse, away = _spoilt(mesh, points)
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


def _unwarped(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """Press warped quads flat, where it must be off the surface, until no corner is further than WARP off its plane.

    A quad much more warped than that cannot be flattened within any useful distortion. Border vertices stay.
    """

    def allowed(corners: np.ndarray, off: np.ndarray) -> np.ndarray:
        return WARP * _sides(corners).min(axis=1)

    return _pressed(mesh, points, allowed)


def flatter(mesh: QuadMesh) -> QuadMesh:
    """Return the mesh with the quads that bend by more than BEND pressed flat; the mesh itself where there are none.

    A quad that bends so far spans a feature of the surface that is smaller than itself. Its vertices leave the surface by a share
    of an edge. Quads of smooth surfaces bend less and stay. Where a quad would lose its room or its shape, the moves round it are
    shorter, and it keeps a part of its bend. Border vertices stay.
    """
    if bends(mesh.vertices[mesh.quads]).max() <= BEND:
        return mesh

    def allowed(corners: np.ndarray, off: np.ndarray) -> np.ndarray:
        return np.abs(off) * BEND / np.maximum(bends(corners), 1e-300)

    return mesh.moved(_taken_back(mesh, _pressed(mesh, mesh.vertices, allowed)))


def bends(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, " quads"]:
    """Radians: the largest angle between the normals at two corners of a quad that share a side."""
    normals = np.cross(np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners)
    normals /= np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[..., None]
    return np.arccos(np.clip(np.einsum("fki,fki->fk", normals, np.roll(normals, -1, axis=1)), -1.0, 1.0)).max(axis=1)


def _pressed(mesh: QuadMesh, points: np.ndarray, allowed: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the points with quads pressed flat: of corners and how far they are off their quad's plane, ``allowed`` tells how far they may be."""
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    for _ in range(100):
        p = points[mesh.quads]
        normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        # all four corners are equally far from the plane, alternately above and below
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


def _taken_back(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """The moves, shorter round quads that they have left too little room, or that became much worse; none where that does not help."""
    share = np.ones(len(points))
    for _ in range(ROUNDS):
        moved = mesh.vertices + share[:, None] * (points - mesh.vertices)
        wrong = _tight(mesh, moved, SPARE) | _much_worse(mesh, moved)
        if not wrong.any():
            return moved
        share[_corners_of(mesh, wrong)] *= SHORTER
        share[share < SHORTEST] = 0.0
        for _ in range(round(1.0 / RISE)):
            least = share[mesh.quads].min(axis=1)
            np.minimum.at(share, mesh.quads, (least + RISE)[:, None])
    return mesh.vertices


def _tight(mesh: QuadMesh, points: np.ndarray, limit: float) -> Bool[np.ndarray, " quads"]:
    """Quads that became narrower than any was, or short at a side, at ``limit`` times what is measured."""
    before, after = mesh.vertices[mesh.quads], points[mesh.quads]
    edges, sides = _sides(before), _sides(after)
    # both as shares of the median edge, which brings the mesh back to its size; what has not moved is never to blame
    middle, now, room, least = np.median(edges), np.median(sides), breadth(before), breadth(after)
    narrow = (limit * least / now < min(room.min() / middle, PLENTY)) & (least < (1.0 - ROUNDED) * room)
    short = (limit * sides < SHORT * now) & (edges >= SHORT * middle) & (sides < (1.0 - ROUNDED) * edges)
    return narrow | short.any(axis=1)


def _much_worse(mesh: QuadMesh, points: np.ndarray) -> Bool[np.ndarray, " quads"]:
    """Quads whose square energy is beyond what it may come to."""
    before, after = square_energy(mesh.vertices[mesh.quads]), square_energy(points[mesh.quads])
    return after > np.maximum(GOOD, WORSE * before)


def _sides(corners: Float[np.ndarray, "quads 4 3"]) -> Float[np.ndarray, "quads 4"]:
    """The lengths of the sides of quads."""
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def _symmetric(mesh: QuadMesh, points: np.ndarray, progress: Progress) -> np.ndarray:
    """Moves averaged over the symmetries of ``mesh``: ties between nearest points break them by a hair."""
    moves = points - mesh.vertices
    group = symmetries(mesh, tolerance=SYMMETRY, progress=progress)
    total = moves + sum(moves[s.vertices] @ s.matrix for s in group)
    return mesh.vertices + total / (1 + len(group))


def _spoilt(
    mesh: QuadMesh, points: np.ndarray, limit: float = 1.0
) -> tuple[Bool[np.ndarray, " quads"], Bool[np.ndarray, " quads"]]:
    """Quads that became much worse, and quads that the new surface leaves, at ``limit`` times what is allowed."""
    before, after = square_energy(mesh.vertices[mesh.quads]), square_energy(points[mesh.quads])
    worse = after > np.maximum(GOOD * limit, (1 + (WORSE - 1) * limit) * before)
    distance = distances(mesh.moved(points), samples(mesh))
    at_corners, at_middle = np.split(distance, [len(points)])
    away = np.maximum(at_corners[mesh.quads].max(axis=1), at_middle) > DEVIATION * limit * np.sqrt(mesh.areas)
    return worse, away
