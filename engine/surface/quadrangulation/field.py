"""The field of crosses that quads are to follow: one cross of two perpendicular lines in every triangle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from ...arrays import Bool, Float, Int
from ...errors import FlexMapsError

# alignment to curvature beside smoothness, both free of units: over 18 meshes of many kinds 4 lowers the angle to the
# principal curvatures in 15 against 0 and hardly adds irregular points; 16 adds a third on smooth shells
ALIGNMENT = 4.0
# Relative residual at which the solution for the crosses is accepted. Ten times as much turns crosses by up to 1e-3 rad and moves no
# irregular point of an ellipsoid
TOLERANCE = 1e-6
ROUNDS = 20  # of smoothing, over three decades of distance squared; a sphere has its eight irregular points after these


@dataclass(frozen=True, eq=False)
class Triangles:
    """A triangle mesh, manifold and consistently oriented.

    Side k of triangle f runs from its corner k to its corner (k+1) % 3 and has the number 3 f + k.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    corners: Int[np.ndarray, "triangles 3"]

    @cached_property
    def opposite(self) -> Int[np.ndarray, " sides"]:
        """The same edge's side in the neighbouring triangle, -1 at the border.

        Raises FlexMapsError where more than two triangles share an edge, or two that are oriented unlike.
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
        """Unit: along side 0, across it in the triangle, and the normal.

        Raises FlexMapsError where a triangle has no area.
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
    def sides(self) -> np.ndarray:
        """(triangles, 3) complex: every side in its triangle's frame, metres."""
        p = self.vertices[self.corners]
        along = np.einsum("fki,fji->fkj", np.roll(p, -1, axis=1) - p, self.frames[:, :2])
        return along[..., 0] + 1j * along[..., 1]

    @cached_property
    def areas(self) -> Float[np.ndarray, " triangles"]:
        """Square metres."""
        return 0.5 * (self.sides[:, 0].conj() * self.sides[:, 1]).imag

    def lines(self, fold: float) -> Bool[np.ndarray, " sides"]:
        """The sides at the border, and those over which the surface turns by more than ``fold`` radians."""
        normal = self.frames[:, 2]
        here = np.arange(len(self.opposite)) // 3
        cosine = np.einsum("si,si->s", normal[here], normal[self.opposite // 3])
        return (self.opposite < 0) | (cosine < np.cos(fold))

    def long_lines(self, fold: float, shortest: float) -> Bool[np.ndarray, " sides"]:
        """The border, and the folds that hang together over at least ``shortest`` metres."""
        from scipy.sparse.csgraph import connected_components

        lines = self.lines(fold)
        side = np.flatnonzero(lines)
        ends = np.stack([self.corners.ravel(), np.roll(self.corners, -1, axis=1).ravel()], axis=1)[side]
        count = len(self.vertices)
        graph = csr_array((np.ones(len(side)), (ends[:, 0], ends[:, 1])), shape=(count, count))
        group = connected_components(graph, directed=False)[1][ends[:, 0]]
        border = self.opposite[side] < 0
        length = np.bincount(group, np.abs(self.sides.ravel()[side]) * np.where(border, 1.0, 0.5))
        lines[side[~border & (length[group] < shortest)]] = False
        return lines

    @cached_property
    def angles(self) -> Float[np.ndarray, "triangles 3"]:
        """Radians at every corner."""
        return np.angle(-np.roll(self.sides, 1, axis=1) / self.sides)


@dataclass(frozen=True, eq=False)
class CrossField:
    """A cross in every triangle: its lines run at ``angles`` + k pi/2 from the triangle's side 0."""

    mesh: Triangles
    angles: Float[np.ndarray, " triangles"]  # radians

    @property
    def directions(self) -> Float[np.ndarray, "triangles 3"]:
        """Unit vectors along one of the cross's lines."""
        x, y = self.mesh.frames[:, 0], self.mesh.frames[:, 1]
        return np.cos(self.angles)[:, None] * x + np.sin(self.angles)[:, None] * y

    @cached_property
    def turns(self) -> Float[np.ndarray, " sides"]:
        """Radians, at most pi/4: how far the cross turns from a triangle to its neighbour over each side; at the
        border, from the cross to the side."""
        mesh, other = self.mesh, self.mesh.opposite
        lean = (self.angles[:, None] - np.angle(mesh.sides)).ravel()  # of the cross against the side
        # both triangles take the same rounding, so that what is left over where it is just pi/4 cancels
        first = np.arange(len(other)) < other
        turn = np.where(other >= 0, lean[other], 0.0) - lean
        turn -= np.round(turn / (np.pi / 2)) * (np.pi / 2)
        return np.where(first | (other < 0), turn, -turn[other])

    @cached_property
    def indices(self) -> Int[np.ndarray, " vertices"]:
        """Quarters by which the cross turns round every vertex: 1 where three quads will meet instead of four, -1 where
        five; at the border 1 where one quad instead of two. Their sum is four times the Euler characteristic (Poincare
        and Hopf; Ray et al. 2008, section 3)."""
        mesh, count = self.mesh, len(self.mesh.vertices)
        start, end, rim = mesh.corners.ravel(), np.roll(mesh.corners, -1, axis=1).ravel(), mesh.opposite < 0
        total = np.full(count, 2 * np.pi)
        total[start[rim]] = np.pi
        total -= np.bincount(start, weights=mesh.angles.ravel(), minlength=count)
        total += np.bincount(end, weights=self.turns, minlength=count)
        total -= np.bincount(start[rim], weights=self.turns[rim], minlength=count)
        total[np.bincount(start, minlength=count) == 0] = 0.0
        return np.round(total / (np.pi / 2)).astype(np.int64)


def cross_field(
    mesh: Triangles, lines: Bool[np.ndarray, " sides"] | None = None, alignment: float = ALIGNMENT
) -> CrossField:
    """The smoothest field that runs along some lines, and along the principal curvatures where these differ.

    Crosses are unit complex numbers, the fourth power of a direction; the sum of their squared differences over edges and
    from the curvature's cross, this weighted by area and by the squared difference of the curvatures, is least (Knoeppel
    et al. 2013). Lengths are set to one between rounds of smoothing, which moves irregular points to where the field
    wants them (Viertel and Osting 2019).

    lines : sides that are followed exactly; the border where none are given
    alignment : weight of the curvature, no unit; 0 for the smoothest field

    Raises FlexMapsError where the mesh is no oriented manifold or a triangle has no area.
    """
    smooth = _smoothness(mesh).tocsr()
    anisotropy = _anisotropy(mesh)
    size = np.abs(anisotropy)
    wanted = (anisotropy / np.maximum(size, 1e-300)) ** 2
    pull = alignment * mesh.areas * size**2
    fixed, value = _followed(mesh, mesh.lines(np.pi) if lines is None else lines)
    free = np.flatnonzero(~fixed)
    cross = np.where(fixed, value, wanted)
    if not len(free):
        return CrossField(mesh, np.angle(cross) / 4)
    rows = smooth[free]
    inner = rows[:, free]
    pulled = (pull * wanted)[free] - rows[:, np.flatnonzero(fixed)] @ value[fixed]
    pull, areas, solver = pull[free], mesh.areas[free], None
    solved = cross[free]
    # first nearly without memory, which finds the field's large features wherever it began, then ever more local
    for step in np.geomspace(1.0, 1e-3, ROUNDS) * mesh.areas.sum():
        matrix = inner + diags_array(pull + areas / step)
        solver = solver or _Solver(matrix)
        solved = solver.solve(matrix, pulled + areas / step * cross[free], solved)
        length = np.abs(solved)
        cross[free] = np.where(length > 1e-12, solved / np.maximum(length, 1e-12), 1.0)
    return CrossField(mesh, np.angle(cross) / 4)


class _Solver:
    """Conjugate gradients for Hermitian matrices that differ by their diagonals, preconditioned by the factors of the first.

    Factors of every matrix take two to eight times as long, on six of Blender's own objects with 192 to 15,744 triangles.
    """

    def __init__(self, first: csr_array):
        from scipy.sparse.linalg import LinearOperator, splu

        factors = splu(first.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        self._near = LinearOperator(first.shape, factors.solve, dtype=complex)

    def solve(self, matrix: csr_array, right: np.ndarray, start: np.ndarray) -> np.ndarray:
        """The solution to ``TOLERANCE``, or as near as the iterations come."""
        from scipy.sparse.linalg import cg

        return cg(matrix, right, x0=start, rtol=TOLERANCE, M=self._near)[0]


def _smoothness(mesh: Triangles) -> coo_array:
    """Hermitian, triangles by triangles: crosses' squared differences over all inner edges, every edge counting by its
    length over the distance of the triangles' middles, as the integral of the squared gradient does."""
    side = np.flatnonzero(mesh.opposite >= 0)
    here, there = side // 3, mesh.opposite[side] // 3
    axis = mesh.sides.ravel() / np.abs(mesh.sides.ravel())
    transport = (-axis[mesh.opposite[side]] / axis[side]) ** 4
    weight = 1.5 * np.abs(mesh.sides.ravel()[side]) ** 2 / (mesh.areas[here] + mesh.areas[there])
    count = len(mesh.corners)
    row, column = np.concatenate([here, there]), np.concatenate([here, here])
    return coo_array((np.concatenate([weight + 0j, -weight * transport]), (row, column)), shape=(count, count))


def _anisotropy(mesh: Triangles) -> np.ndarray:
    """(triangles,) complex, 1/m: half the difference of the principal curvatures, at twice the angle of the larger.

    The shape operator of every triangle from the change of the vertices' normals along its sides (Rusinkiewicz 2004)."""
    normal = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(normal, mesh.corners[:, k], mesh.angles[:, k, None] * mesh.frames[:, 2])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    n = normal[mesh.corners]
    change = np.einsum("fki,fji->fkj", np.roll(n, -1, axis=1) - n, mesh.frames[:, :2])
    along = np.stack([mesh.sides.real, mesh.sides.imag], axis=2)
    x, y, zero = along[..., 0], along[..., 1], np.zeros_like(along[..., 0])
    matrix = np.concatenate([np.stack([x, y, zero], axis=2), np.stack([zero, x, y], axis=2)], axis=1)
    right = np.concatenate([change[..., 0], change[..., 1]], axis=1)
    normal_matrix = np.einsum("fka,fkb->fab", matrix, matrix)
    a, b, c = np.linalg.solve(normal_matrix, np.einsum("fka,fk->fa", matrix, right)[..., None])[..., 0].T
    return 0.5 * (a - c) + 1j * b


def _followed(mesh: Triangles, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which triangles have such a side, and the cross along it."""
    side = np.flatnonzero(lines)
    fixed, value = np.zeros(len(mesh.corners), dtype=bool), np.ones(len(mesh.corners), dtype=complex)
    fixed[side // 3] = True
    axis = mesh.sides.ravel()[side]
    value[side // 3] = (axis / np.abs(axis)) ** 4
    return fixed, value
