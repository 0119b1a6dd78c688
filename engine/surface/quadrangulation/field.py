"""Cross field that sets the directions of quads: two perpendicular lines in every triangle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from ...arrays import Bool, Float, Int
from ...components import components
from ...errors import FlexMapsError

# Weight of the alignment with curvature relative to smoothness, without a unit. Larger: quads follow the principal
# directions more closely, with more irregular vertices.
ALIGNMENT = 4.0
# Relative residual at which the conjugate gradients stop. Larger: faster, less exact: at 1e-5 crosses are off by 1e-3 rad.
TOLERANCE = 1e-6
# Number of rounds in which the cross field is smoothed, with steps that shrink over three decades. More: slower, but
# irregular points get nearer to their best places.
ROUNDS = 20


@dataclass(frozen=True, eq=False)
class Triangles:
    """A triangle mesh, manifold and consistently oriented.

    Side k of triangle f runs from its corner k to its corner (k+1) % 3 and has the number 3 f + k.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    corners: Int[np.ndarray, "triangles 3"]

    @cached_property
    def opposite(self) -> Int[np.ndarray, " sides"]:
        """For every side, the number of the neighbouring triangle's side on the same edge; -1 at the border.

        Raises
        ------
        FlexMapsError : more than two triangles share an edge, or two with opposite orientation
        """
        start, end = self.corners.ravel(), np.roll(self.corners, -1, axis=1).ravel()
        count = len(self.vertices)
        key, back = start.astype(np.int64) * count + end, end.astype(np.int64) * count + start
        order = np.argsort(key)
        twice = np.flatnonzero(np.diff(key[order]) == 0)
        if len(twice):
            raise FlexMapsError(
                "Edges are used twice in the same direction: quads can be laid only where every edge has one face on "
                "either side, all facing outward. Merge doubled vertices and recalculate the normals.",
                faces=np.unique(order[np.concatenate([twice, twice + 1])] // 3),
            )
        place = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
        return np.where(key[order[place]] == back, order[place], -1)

    @cached_property
    def frames(self) -> Float[np.ndarray, "triangles 3 3"]:
        """Unit vectors along side 0, perpendicular to it in the triangle, and along the normal.

        Raises
        ------
        FlexMapsError : a triangle has no area
        """
        p = self.vertices[self.corners]
        x = p[:, 1] - p[:, 0]
        z = np.cross(x, p[:, 2] - p[:, 0])
        flat = np.linalg.norm(z, axis=1) <= 1e-14 * (np.linalg.norm(x, axis=1) ** 2 + 1e-300)
        if flat.any():
            raise FlexMapsError("Faces without area have no directions: dissolve them.", faces=np.flatnonzero(flat))
        x /= np.linalg.norm(x, axis=1)[:, None]
        z /= np.linalg.norm(z, axis=1)[:, None]
        return np.stack([x, np.cross(z, x), z], axis=1)

    @cached_property
    def side_vectors(self) -> np.ndarray:
        """(triangles, 3) complex: every side as a vector in its triangle's frame, metres."""
        p = self.vertices[self.corners]
        along = np.einsum("fki,fji->fkj", np.roll(p, -1, axis=1) - p, self.frames[:, :2])
        return along[..., 0] + 1j * along[..., 1]

    @cached_property
    def areas(self) -> Float[np.ndarray, " triangles"]:
        """Area of every triangle, square metres."""
        return 0.5 * (self.side_vectors[:, 0].conj() * self.side_vectors[:, 1]).imag

    def feature_sides(self, fold: float) -> Bool[np.ndarray, " sides"]:
        """Return a mask of border sides and folds: sides where the normals differ by more than ``fold`` radians."""
        normal = self.frames[:, 2]
        here = np.arange(len(self.opposite)) // 3
        cosine = np.einsum("si,si->s", normal[here], normal[self.opposite // 3])
        return (self.opposite < 0) | (cosine < np.cos(fold))

    def long_feature_sides(self, fold: float, shortest: float) -> Bool[np.ndarray, " sides"]:
        """Return ``feature_sides`` without short folds.

        A fold is left out if the connected lines of which it is part, folds and border, are shorter than ``shortest``
        metres together.
        """

        lines = self.feature_sides(fold)
        side = np.flatnonzero(lines)
        ends = np.stack([self.corners.ravel(), np.roll(self.corners, -1, axis=1).ravel()], axis=1)[side]
        group = components(len(self.vertices), *ends.T)[ends[:, 0]]
        border = self.opposite[side] < 0
        length = np.bincount(group, np.abs(self.side_vectors.ravel()[side]) * np.where(border, 1.0, 0.5))
        lines[side[~border & (length[group] < shortest)]] = False
        return lines

    @cached_property
    def angles(self) -> Float[np.ndarray, "triangles 3"]:
        """Angle at every corner, radians."""
        return np.angle(-np.roll(self.side_vectors, 1, axis=1) / self.side_vectors)


@dataclass(frozen=True, eq=False)
class CrossField:
    """A cross (two perpendicular lines) in every triangle, at ``angles`` + k pi/2 to the triangle's side 0."""

    mesh: Triangles
    angles: Float[np.ndarray, " triangles"]  # radians

    @cached_property
    def side_rotations(self) -> Float[np.ndarray, " sides"]:
        """Rotation of the cross from a triangle to its neighbour across each side, radians, at most pi/4.

        At the border it is the rotation from the cross to the side.
        """
        mesh, other = self.mesh, self.mesh.opposite
        lean = (self.angles[:, None] - np.angle(mesh.side_vectors)).ravel()  # angle from the side to the cross
        # use the first triangle's result for both, so that they agree even where the rotation is exactly pi/4
        first = np.arange(len(other)) < other
        turn = np.where(other >= 0, lean[other], 0.0) - lean
        turn -= np.round(turn / (np.pi / 2)) * (np.pi / 2)
        return np.where(first | (other < 0), turn, -turn[other])

    @cached_property
    def indices(self) -> Int[np.ndarray, " vertices"]:
        """Index of the cross field at every vertex, in quarter turns: 1 where three quads meet instead of four, -1 for five.

        At the border, 1 is for one quad instead of two. The sum over all vertices is four times the Euler characteristic
        (Poincare-Hopf theorem; Ray et al. 2008, section 3).
        """
        mesh, count = self.mesh, len(self.mesh.vertices)
        start, end, rim = mesh.corners.ravel(), np.roll(mesh.corners, -1, axis=1).ravel(), mesh.opposite < 0
        total = np.full(count, 2 * np.pi)
        total[start[rim]] = np.pi
        total -= np.bincount(start, weights=mesh.angles.ravel(), minlength=count)
        total += np.bincount(end, weights=self.side_rotations, minlength=count)
        total -= np.bincount(start[rim], weights=self.side_rotations[rim], minlength=count)
        total[np.bincount(start, minlength=count) == 0] = 0.0
        return np.round(total / (np.pi / 2)).astype(np.int64)


def cross_field(
    mesh: Triangles, lines: Bool[np.ndarray, " sides"] | None = None, alignment: float = ALIGNMENT
) -> CrossField:
    """Return a smooth cross field that follows lines exactly and the principal directions approximately.

    A cross is represented by a unit complex number, the fourth power of a direction. The field minimises the squared
    differences across edges, plus squared differences from the crosses of the principal directions, weighted by area
    and by the squared difference of the principal curvatures (Knoeppel et al. 2013). Rounds of smoothing alternate with
    normalisation, which moves irregular points to their best places (Viertel and Osting 2019).

    Parameters
    ----------
    mesh : triangles, metres
    lines : mask of sides that the field follows exactly; the border by default
    alignment : weight of the principal directions, without a unit; 0 for the smoothest field

    Raises
    ------
    FlexMapsError : the mesh is not an oriented manifold, or a triangle has no area
    """
    smooth = _smoothness(mesh).tocsr()
    anisotropy = _anisotropy(mesh)
    size = np.abs(anisotropy)
    wanted = (anisotropy / np.maximum(size, 1e-300)) ** 2
    pull = alignment * mesh.areas * size**2
    fixed, value = _feature_crosses(mesh, mesh.feature_sides(np.pi) if lines is None else lines)
    free = np.flatnonzero(~fixed)
    cross = np.where(fixed, value, wanted)
    if not len(free):
        return CrossField(mesh, np.angle(cross) / 4)
    rows = smooth[free]
    inner = rows[:, free]
    pulled = (pull * wanted)[free] - rows[:, np.flatnonzero(fixed)] @ value[fixed]
    pull, areas, solver = pull[free], mesh.areas[free], None
    solved = cross[free]
    # start with large steps, which shape the large features of the field whatever the start, and end with small steps
    for step in np.geomspace(1.0, 1e-3, ROUNDS) * mesh.areas.sum():
        matrix = inner + diags_array(pull + areas / step)
        solver = solver or _DiagonalUpdateSolver(matrix)
        solved = solver.solve(matrix, pulled + areas / step * cross[free], solved)
        length = np.abs(solved)
        cross[free] = np.where(length > 1e-12, solved / np.maximum(length, 1e-12), 1.0)
    return CrossField(mesh, np.angle(cross) / 4)


class _DiagonalUpdateSolver:
    """Conjugate gradients for Hermitian matrices that differ only in their diagonals.

    The factors of the first matrix precondition all solves, because factoring every matrix takes two to eight times as long.
    """

    def __init__(self, first: csr_array):
        from scipy.sparse.linalg import LinearOperator, splu

        factors = splu(first.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        self._near = LinearOperator(first.shape, factors.solve, dtype=complex)

    def solve(self, matrix: csr_array, right: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return the solution x of ``matrix`` x = ``right``, iterated from ``start`` to the residual ``TOLERANCE``."""
        from scipy.sparse.linalg import cg

        return cg(matrix, right, x0=start, rtol=TOLERANCE, M=self._near)[0]


def _smoothness(mesh: Triangles) -> coo_array:
    """Return the Hermitian matrix (triangles, triangles) of the sum of squared differences of crosses across edges.

    The weight of an edge is its length divided by the distance of the triangles' centroids, which approximates the
    integral of the squared gradient.
    """
    side = np.flatnonzero(mesh.opposite >= 0)
    here, there = side // 3, mesh.opposite[side] // 3
    axis = mesh.side_vectors.ravel() / np.abs(mesh.side_vectors.ravel())
    transport = (-axis[mesh.opposite[side]] / axis[side]) ** 4
    weight = 1.5 * np.abs(mesh.side_vectors.ravel()[side]) ** 2 / (mesh.areas[here] + mesh.areas[there])
    count = len(mesh.corners)
    row, column = np.concatenate([here, there]), np.concatenate([here, here])
    return coo_array((np.concatenate([weight + 0j, -weight * transport]), (row, column)), shape=(count, count))


def _anisotropy(mesh: Triangles) -> np.ndarray:
    """Return the anisotropy of the curvature in every triangle, (triangles,) complex, 1/m.

    Its absolute value is half the difference of the principal curvatures; its argument is twice the angle from side 0
    to the direction of the larger curvature. The shape operator is fitted to the change of the vertex normals along the
    triangle's sides (Rusinkiewicz 2004).
    """
    normal = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(normal, mesh.corners[:, k], mesh.angles[:, k, None] * mesh.frames[:, 2])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    n = normal[mesh.corners]
    change = np.einsum("fki,fji->fkj", np.roll(n, -1, axis=1) - n, mesh.frames[:, :2])
    along = np.stack([mesh.side_vectors.real, mesh.side_vectors.imag], axis=2)
    x, y, zero = along[..., 0], along[..., 1], np.zeros_like(along[..., 0])
    matrix = np.concatenate([np.stack([x, y, zero], axis=2), np.stack([zero, x, y], axis=2)], axis=1)
    right = np.concatenate([change[..., 0], change[..., 1]], axis=1)
    normal_matrix = np.einsum("fka,fkb->fab", matrix, matrix)
    a, b, c = np.linalg.solve(normal_matrix, np.einsum("fka,fk->fa", matrix, right)[..., None])[..., 0].T
    return 0.5 * (a - c) + 1j * b


def _feature_crosses(mesh: Triangles, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mask of the triangles at lines, and crosses (fourth powers, complex) that follow these lines.

    lines : mask of the sides on lines
    """
    side = np.flatnonzero(lines)
    fixed, value = np.zeros(len(mesh.corners), dtype=bool), np.ones(len(mesh.corners), dtype=complex)
    fixed[side // 3] = True
    axis = mesh.side_vectors.ravel()[side]
    value[side // 3] = (axis / np.abs(axis)) ** 4
    return fixed, value
