"""As-rigid-as-possible flattening of one patch, in 2D complex algebra (Liu et al. 2008), without any SVD.

The map of a corner triangle to the plane is u = a z + b conj(z) with complex a and b; its singular values are
|a| + |b| and |a| - |b|, its determinant |a|^2 - |b|^2, and the nearest rotation is a / |a|. Every quad has four corner
triangles, which are both of its triangulations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from ...surface.mesh import QuadMesh
from ..loops import NEXT

if TYPE_CHECKING:
    from jaxtyping import Complex, Float, Int

SHIFTS = (1e-12, 1e-9, 1e-6)  # added to a Laplacian that has no Cholesky factor, as a share of its largest entry
PREVIOUS = np.array([3, 0, 1, 2])  # the corner before each of a quad


@dataclass(frozen=True, eq=False)
class CornerTriangles:
    """The four corner triangles of every quad, each laid into the plane without distortion.

    along, against : 1/m: a = along * d[k] + against * d[k-1] with d[k] the flat side k as a complex number
    along_bar, against_bar : 1/m: the same for b
    area : square metres
    flat : metres, the corners of every quad projected to its plane
    stiffness : square metres times 1/m^2: the quadratic form of sum(area (|a|^2 + |b|^2)) over a quad's corners
    """

    along: Complex[np.ndarray, "quads 4"]
    against: Complex[np.ndarray, "quads 4"]
    along_bar: Complex[np.ndarray, "quads 4"]
    against_bar: Complex[np.ndarray, "quads 4"]
    area: Float[np.ndarray, "quads 4"]
    flat: Complex[np.ndarray, "quads 4"]
    stiffness: Float[np.ndarray, "quads 4 4"]

    def pick(self, quads: np.ndarray) -> CornerTriangles:
        """Those of some quads only."""
        return CornerTriangles(
            self.along[quads],
            self.against[quads],
            self.along_bar[quads],
            self.against_bar[quads],
            self.area[quads],
            self.flat[quads],
            self.stiffness[quads],
        )


@lru_cache(maxsize=4)
def corner_triangles(mesh: QuadMesh) -> CornerTriangles:
    """The corner triangles of every quad of a mesh (Liu et al. 2008, section 3, in complex form)."""
    p = mesh.vertices[mesh.quads]
    normal = mesh.normals
    x_axis = p[:, 2] - p[:, 0]
    x_axis = x_axis - normal * np.einsum("fi,fi->f", x_axis, normal)[:, None]
    x_axis /= np.maximum(np.linalg.norm(x_axis, axis=1), 1e-300)[:, None]
    y_axis = np.cross(normal, x_axis)
    centred = p - p.mean(axis=1, keepdims=True)
    flat = np.einsum("fki,fi->fk", centred, x_axis) + 1j * np.einsum("fki,fi->fk", centred, y_axis)
    forward, backward = p[:, NEXT] - p, p[:, PREVIOUS] - p
    return _triangles(forward, backward, flat)


def _triangles(
    forward: Float[np.ndarray, "quads 4 3"],
    backward: Float[np.ndarray, "quads 4 3"],
    flat: Complex[np.ndarray, "quads 4"],
) -> CornerTriangles:
    """From the two sides at every corner, metres, and the projected corners."""
    length_f, _length_b = np.linalg.norm(forward, axis=2), np.linalg.norm(backward, axis=2)
    double_area = np.linalg.norm(np.cross(forward, backward), axis=2)
    inner = np.einsum("fki,fki->fk", forward, backward)
    z1 = length_f.astype(complex)
    z0 = (inner + 1j * double_area) / np.where(length_f > 0, length_f, 1.0)
    # turn each triangle to lie best on the projection of its quad, so that one rotation fits all four
    w1, w0 = flat[:, NEXT] - flat, flat[:, PREVIOUS] - flat
    turn = w1 * z1.conj() + w0 * z0.conj()
    size = np.abs(turn)
    turn = np.where(size > 0, turn / np.where(size > 0, size, 1.0), 1.0)
    z1, z0 = z1 * turn, z0 * turn
    d = z1 * z0.conj() - z1.conj() * z0
    # a triangle without area has no map of its own, and no weight
    inverse = np.where(np.abs(d) > 0, 1.0, 0.0) / np.where(np.abs(d) > 0, d, 1.0)
    # u1 = a z1 + b conj(z1) with u1 = d[k]; u0 = a z0 + b conj(z0) with u0 = -d[k-1]
    along, against = z0.conj() * inverse, z1.conj() * inverse
    along_bar, against_bar = -z0 * inverse, -z1 * inverse
    area = 0.5 * double_area
    stiffness = np.zeros((len(flat), 4, 4))
    for k in range(4):
        for first, second in ((along, against), (along_bar, against_bar)):
            row = np.zeros((len(flat), 4), dtype=complex)
            row[:, NEXT[k]] += first[:, k]
            row[:, k] += second[:, k] - first[:, k]
            row[:, PREVIOUS[k]] -= second[:, k]
            stiffness += area[:, k, None, None] * (row.conj()[:, :, None] * row[:, None, :]).real
    return CornerTriangles(along, against, along_bar, against_bar, area, flat, stiffness)


def quad_energy(
    tri: CornerTriangles, a: Complex[np.ndarray, "quads 4"], b: Complex[np.ndarray, "quads 4"]
) -> Float[np.ndarray, " quads"]:
    """E of every quad from the a and b of its corners: area-weighted mean of (s1-1)^2 + (s2-1)^2."""
    energy = 2.0 * ((np.abs(a) - 1.0) ** 2 + np.abs(b) ** 2)
    return (tri.area * energy).sum(axis=1) / np.maximum(tri.area.sum(axis=1), 1e-300)


def square_energy(corners: Complex[np.ndarray, "quads 4"]) -> Float[np.ndarray, " quads"]:
    """How far flat quads are from a square of the same area: the measure of ``quad_energy`` from it."""
    d = corners[:, NEXT] - corners
    diagonal_a, diagonal_b = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    side = np.sqrt(np.maximum(0.5 * (diagonal_a.conj() * diagonal_b).imag, 1e-300))[:, None]
    # a unit square's corner k: z1 = i^k, z0 = i^(k+1)
    unit = 1j ** np.arange(4)
    z1, z0 = unit[None, :] * side, 1j * unit[None, :] * side
    det = z1 * z0.conj() - z1.conj() * z0
    u1, u0 = d, -d[:, PREVIOUS]
    a = (u1 * z0.conj() - u0 * z1.conj()) / det
    b = (z1 * u0 - z0 * u1) / det
    return 2.0 * ((np.abs(a) - 1.0) ** 2 + np.abs(b) ** 2).mean(axis=1)


@dataclass(frozen=True, eq=False)
class FlatPatch:
    """One patch in the plane.

    points : metres, as complex numbers
    rotation : complex numbers of length 1, the nearest rotation of every corner triangle: where merged patches start
    energy : E of every quad
    flips : number of corner triangles that are not positively oriented
    """

    points: Complex[np.ndarray, " vertices"]
    rotation: Complex[np.ndarray, "quads 4"]
    energy: Float[np.ndarray, " quads"]
    flips: int

    @property
    def worst(self) -> float:
        return float(self.energy.max())


class PatchProblem:
    """The flattening of one patch, or of several side by side: its sparsity is analysed once, then solved with changing weights.

    mesh : the surface
    quads : (q,) int, the quads of the patch
    corners : (q, 4) int, the local flat vertex of every corner, 0..n-1
    tick : called at every solve, so that long ones can be stopped
    sizes : how many quads each of several patches has, one patch after the other
    """

    def __init__(
        self,
        mesh: QuadMesh,
        quads: np.ndarray,
        corners: np.ndarray,
        tick: Callable[[], None] = lambda: None,
        sizes: Sequence[int] = (),
    ):
        self.mesh, self.quads, self.corners, self.tick = mesh, quads, corners, tick
        self.sizes = np.array(sizes or [len(quads)])
        self.patch_of = np.repeat(np.arange(len(self.sizes)), self.sizes)
        self.tri = corner_triangles(mesh).pick(quads)
        self.count = int(corners.max()) + 1
        self._analyse()

    def _analyse(self) -> None:
        n, c = self.count, self.corners
        rows, cols = np.repeat(c, 4, axis=1).ravel(), np.tile(c, (1, 4)).ravel()
        # straight into compressed rows, doubled entries and all: the order only needs to know who is whose neighbour
        corner_order = np.argsort(c.ravel(), kind="stable")
        indices = c[corner_order // 4].ravel()
        starts = np.concatenate([[0], np.cumsum(4 * np.bincount(c.ravel(), minlength=n))])
        graph = csr_array((np.ones(len(indices), dtype=np.int8), indices, starts), shape=(n, n))
        order = reverse_cuthill_mckee(graph, symmetric_mode=True)
        self.place = np.empty(n, dtype=np.int64)
        self.place[order] = np.arange(n)
        i, j = self.place[rows], self.place[cols]
        self._lower = i >= j
        self.band = int((i - j).max())
        # Fortran layout of LAPACK's lower band storage: entry (i, j) at [i - j, j]
        self._slot = (j * (self.band + 1) + i - j)[self._lower]
        self._flat_corners = c.ravel()
        self._held = np.zeros(1, dtype=int)
        if len(self.sizes) > 1:
            self._held = np.full(len(self.sizes), n)
            np.minimum.at(self._held, np.repeat(self.patch_of, 4), self.place[self._flat_corners])

    def factor(
        self, weights: Float[np.ndarray, " quads"], springs: Springs | None = None
    ) -> Float[np.ndarray, "band vertices"]:
        """Banded Cholesky factor of the weighted Laplacian; one vertex a patch is held, which changes nothing else."""
        self.tick()
        values = (weights[:, None, None] * self.tri.stiffness).reshape(-1)[self._lower]
        slots = self._slot
        size = (self.band + 1) * self.count
        if springs is not None:
            i, j = self.place[springs.ends].T
            stiff = springs.stiffness
            width = self.band + 1
            low, high = np.minimum(i, j), np.maximum(i, j)
            slots = np.concatenate([slots, i * width, j * width, low * width + high - low])
            values = np.concatenate([values, stiff, stiff, -stiff])
        band = np.bincount(slots, weights=values, minlength=size)
        band[self._held * (self.band + 1)] *= 2.0
        band = band.reshape(self.band + 1, self.count, order="F")
        # quads without area leave their corners where they like: hold them by next to nothing
        for shift in (0.0, *SHIFTS):
            held = band.copy(order="F")
            held[0] += shift * np.nan_to_num(band[0]).max()
            factor, info = dpbtrf(held, lower=1, overwrite_ab=1)
            if info == 0:
                return factor
        return np.full_like(band, np.nan)

    def maps(
        self, points: Complex[np.ndarray, " vertices"]
    ) -> tuple[Complex[np.ndarray, "quads 4"], Complex[np.ndarray, "quads 4"]]:
        """a and b of every corner triangle."""
        u = points[self.corners]
        d = u[:, NEXT] - u
        before = d[:, PREVIOUS]
        t = self.tri
        return t.along * d + t.against * before, t.along_bar * d + t.against_bar * before

    def global_step(
        self,
        factor: Float[np.ndarray, "band vertices"],
        weights: Float[np.ndarray, " quads"],
        rotation: Complex[np.ndarray, "quads 4"],
        springs: Springs | None = None,
    ) -> Complex[np.ndarray, " vertices"]:
        """The points that fit the rotations best."""
        self.tick()
        t = self.tri
        s = t.area * weights[:, None] * rotation
        pull = t.along.conj() * s + (t.against.conj() * s)[:, NEXT]
        force = (pull[:, PREVIOUS] - pull).ravel()
        f = self._flat_corners
        rhs = np.empty((self.count, 2), order="F")
        real = np.bincount(f, weights=force.real, minlength=self.count)
        imag = np.bincount(f, weights=force.imag, minlength=self.count)
        if springs is not None:
            wanted = springs.stiffness * springs.vectors
            i, j = springs.ends.T
            for part, vector in ((real, wanted.real), (imag, wanted.imag)):
                part += np.bincount(j, weights=vector, minlength=self.count)
                part -= np.bincount(i, weights=vector, minlength=self.count)
        rhs[self.place, 0], rhs[self.place, 1] = real, imag
        solution, _ = dpbtrs(factor, rhs, lower=1, overwrite_b=1)
        return solution[self.place, 0] + 1j * solution[self.place, 1]

    @cached_property
    def _turns(self) -> Complex[np.ndarray, " joints"]:
        """Complex numbers of length 1: the turn over every joint that makes both sides of it parallel."""
        fa, ka, fb, kb = self.joints
        flat = self.tri.flat
        turn = (flat[fa, (ka + 1) % 4] - flat[fa, ka]) * (flat[fb, kb] - flat[fb, (kb + 1) % 4]).conj()
        size = np.abs(turn)
        return np.where(size > 0, turn, 1.0) / np.where(size > 0, size, 1.0)

    def unfolded(self) -> Complex[np.ndarray, "quads 4"]:
        """Rotations to start from, carried from every patch's middle quad outwards over uncut sides."""
        q = len(self.quads)
        if q == len(self.sizes):
            return np.ones((q, 4), dtype=complex)
        fa, _, fb, _ = self.joints
        # a root beside the quads, from which one step leads to the middle of every patch
        middle = self._middle()
        ends = np.concatenate([fa, np.full(len(middle), q)]), np.concatenate([fb, middle])
        graph = coo_array((np.ones(len(ends[0])), ends), shape=(q + 1, q + 1))
        order, before = breadth_first_order(graph.tocsr(), q, directed=False)
        step = {(q, start): 1.0 + 0j for start in middle.tolist()}
        for a, b, t in zip(fa.tolist(), fb.tolist(), self._turns.tolist(), strict=True):
            step[a, b], step[b, a] = t, t.conjugate()
        values: list[complex] = [1.0 + 0j] * (q + 1)
        for quad in order[1:].tolist():
            parent = int(before[quad])
            values[quad] = values[parent] * step[parent, quad]
        return np.repeat(np.array(values[:q])[:, None], 4, axis=1)

    def _middle(self) -> Int[np.ndarray, " patches"]:
        """Of every patch the quad that is nearest to its centre."""
        centre = self.mesh.centroids[self.quads]
        first = np.cumsum(self.sizes) - self.sizes
        mean = np.add.reduceat(centre, first, axis=0) / self.sizes[:, None]
        away = ((centre - mean[self.patch_of]) ** 2).sum(axis=1)
        return np.lexsort((away, self.patch_of))[first]

    def worst(self, energy: Float[np.ndarray, " quads"]) -> Float[np.ndarray, " patches"]:
        """The largest of the energies in every patch."""
        return np.maximum.reduceat(energy, np.cumsum(self.sizes) - self.sizes)

    def smoothest(self) -> Complex[np.ndarray, "quads 4"]:
        """Rotations that fit all uncut sides together best, where carrying them along paths misleads.

        The lowest eigenvector of the connection Laplacian (Singer & Wu 2012), by inverse iteration.
        """
        q = len(self.quads)
        fa, _, fb, _ = self.joints
        degree = np.bincount(fa, minlength=q) + np.bincount(fb, minlength=q)
        everyone = np.arange(q)
        rows, cols = np.concatenate([everyone, fa, fb]), np.concatenate([everyone, fb, fa])
        values = np.concatenate([degree + 1e-6, -self._turns.conj(), -self._turns])
        solver = splu(csc_array((values, (rows, cols)), shape=(q, q)))
        vector = self.unfolded()[:, 0]
        for _ in range(20):
            vector = solver.solve(vector)
            vector /= np.abs(vector).max()
        vector = vector / np.maximum(np.abs(vector), 1e-12)
        return np.repeat(vector[:, None], 4, axis=1)

    @cached_property
    def joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Uncut sides inside the patch: quad, side, other quad, its side (local quad numbers)."""
        c = self.corners
        key = np.minimum(c, c[:, NEXT]) * self.count + np.maximum(c, c[:, NEXT])
        flat_key = key.ravel()
        order = np.argsort(flat_key, kind="stable")
        same = np.flatnonzero(flat_key[order][1:] == flat_key[order][:-1])
        one, two = order[same], order[same + 1]
        return one // 4, one % 4, two // 4, two % 4

    def patch(self, points: Complex[np.ndarray, " vertices"]) -> FlatPatch:
        """The patch with its vertices at points; where those are no numbers it is the worst there is."""
        if not np.isfinite(points).all():
            turns, energy = np.ones(self.corners.shape, dtype=complex), np.full(len(self.corners), np.inf)
            return FlatPatch(points, turns, energy, self.corners.size)
        a, b = self.maps(points)
        size_a, size_b = np.abs(a), np.abs(b)
        rotation = a / np.maximum(size_a, 1e-300)
        return FlatPatch(points, rotation, quad_energy(self.tri, a, b), int((~(size_b < size_a)).sum()))


@dataclass(frozen=True, eq=False)
class Springs:
    """Soft wanted side vectors along the outline, metres, from flat vertex to flat vertex."""

    ends: Int[np.ndarray, "springs 2"]
    vectors: Complex[np.ndarray, " springs"]
    stiffness: Float[np.ndarray, " springs"]


def settle(
    problem: PatchProblem,
    rotation: Complex[np.ndarray, "quads 4"] | None = None,
    *,
    rounds: int = 30,
    tolerance: float = 2e-4,
    hopeless: float = np.inf,
) -> FlatPatch:
    """Alternate nearest rotations and linear solves until the points rest (Liu et al. 2008).

    rotation : to start from; carried over the patch where it is not given
    tolerance : stop when the worst energy changes by less than this share in a round
    hopeless : give up early when the worst energy stays above this
    """
    if rotation is None:
        rotation = problem.unfolded()
    weights = np.ones(len(problem.quads))
    factor = problem.factor(weights)
    before = np.inf
    patch = problem.patch(problem.global_step(factor, weights, rotation))
    for turn in range(rounds):
        worst = patch.worst
        change = before - worst
        if abs(change) < tolerance * worst:
            break
        # the energy falls geometrically: beyond this many more rounds it would not come under the bar
        if turn >= 4 and worst - 12.0 * max(change, 0.0) > hopeless:
            break
        before = worst
        patch = problem.patch(problem.global_step(factor, weights, patch.rotation))
    return patch


def minimax(
    problem: PatchProblem, patch: FlatPatch, *, rounds: int = 15, inner: int = 2, target: float = 0.0
) -> FlatPatch:
    """Lower the worst energy by weighing bad quads more, round by round; the best patch seen is returned.

    target : stop as soon as the worst energy is below this
    """
    weights = np.ones(len(problem.quads))
    best = patch
    for _ in range(rounds):
        if best.worst <= target and best.flips == 0:
            break
        share = patch.energy / max(patch.energy.max(), 1e-300)
        weights *= 0.15 + share
        weights /= weights.mean()
        np.maximum(weights, 1e-4, out=weights)
        factor = problem.factor(weights)
        for _ in range(inner):
            patch = problem.patch(problem.global_step(factor, weights, patch.rotation))
        if (patch.flips, patch.worst) < (best.flips, best.worst):
            best = patch
    return best
