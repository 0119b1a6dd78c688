"""As-rigid-as-possible flattening of a patch in complex numbers (Liu et al. 2008), without any SVD.

Local steps, which find the nearest rotation of every corner triangle, alternate with global steps, which solve a linear
system for the flat points. The module ``triangles`` defines the coefficients a and b of a triangle's map to the plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from ...arrays import Complex, Float, Int
from ...surface.mesh import QuadMesh
from ..loops import NEXT, PREVIOUS
from .triangles import corner_triangles, quad_energy

# Numbers added to the diagonal of a Laplacian that is not positive definite, as shares of its largest entry; tried in
# turn. Larger shifts make the matrix definite more reliably, and the flat points less exact.
DIAGONAL_SHIFTS = (1e-12, 1e-9, 1e-6)
# A flattening is given up if its weighted mean energy, lowered further by this many times its decrease within the last
# round, would still exceed the limit. Larger values give up fewer patches that would succeed, and save less time.
FURTHER_DECREASE = 4.0


@dataclass(frozen=True, eq=False)
class FlatPatch:
    """A patch laid flat.

    points : positions of the flat vertices, complex, metres
    rotation : rotation nearest to the map of every corner triangle, unit complex numbers; flattening a merged patch
        starts from it
    energy : distortion E of every quad
    flip_count : number of corner triangles that are not positively oriented
    """

    points: Complex[np.ndarray, " vertices"]
    rotation: Complex[np.ndarray, "quads 4"]
    energy: Float[np.ndarray, " quads"]
    flip_count: int

    @property
    def max_energy(self) -> float:
        """Largest distortion E of any quad."""
        return float(self.energy.max())


class PatchProblem:
    """Linear systems for flattening one or several patches: analysed once, then solved for changing weights of quads.

    mesh : the surface
    quads : (q,) int, quads of the patch or patches
    corners : (q, 4) int, flat vertex of every corner, numbered 0..n-1 among these quads
    tick : called before every factorisation and every solve; may raise an exception to cancel
    sizes : number of quads of each patch, if ``quads`` lists several patches, one after another
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
        self.triangles = corner_triangles(mesh).subset(quads)
        self._towards = self.triangles.along.conj(), self.triangles.against.conj()
        self._around = corners[:, NEXT], corners[:, PREVIOUS]
        self.count = int(corners.max()) + 1
        self._analyse()

    def _analyse(self) -> None:
        """Order the vertices for a small bandwidth, and compute where every entry of the matrix is stored."""
        n, c = self.count, self.corners
        rows, cols = np.repeat(c, 4, axis=1).ravel(), np.tile(c, (1, 4)).ravel()
        # rows of the graph's matrix may have duplicate entries, because the ordering only needs the adjacency
        corner_order = np.argsort(c.ravel(), kind="stable")
        indices = c[corner_order // 4].ravel()
        starts = np.concatenate([[0], np.cumsum(4 * np.bincount(c.ravel(), minlength=n))])
        graph = csr_array((np.ones(len(indices), dtype=np.int8), indices, starts), shape=(n, n))
        order = reverse_cuthill_mckee(graph, symmetric_mode=True)
        self.place = np.empty(n, dtype=np.int64)
        self.place[order] = np.arange(n)
        i, j = self.place[rows], self.place[cols]
        self._lower = np.flatnonzero(i >= j)
        self.band = int((i - j).max())
        # Fortran layout of LAPACK's lower band storage: entry (i, j) at [i - j, j]
        self._slot = (j * (self.band + 1) + i - j)[self._lower]
        self._flat_corners = c.ravel()
        self._pinned = np.zeros(1, dtype=int)
        if len(self.sizes) > 1:
            self._pinned = np.full(len(self.sizes), n)
            np.minimum.at(self._pinned, np.repeat(self.patch_of, 4), self.place[self._flat_corners])

    def factor(
        self, weights: Float[np.ndarray, " quads"], springs: SideSprings | None = None
    ) -> Float[np.ndarray, "band vertices"]:
        """Return the banded Cholesky factor of the weighted Laplacian.

        One vertex of every patch is held at the origin, which fixes the translation and nothing else.

        Parameters
        ----------
        weights : weights of the quads' energies
        springs : additional springs between flat vertices

        Returns
        -------
        Lower band in LAPACK's storage, for ``global_step``; all NaN if no diagonal shift makes the matrix definite
        """
        self.tick()
        values = (weights[:, None, None] * self.triangles.stiffness).take(self._lower)
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
        band[self._pinned * (self.band + 1)] *= 2.0
        band = band.reshape(self.band + 1, self.count, order="F")
        # quads without area do not determine their corners; a tiny diagonal shift makes the matrix definite
        for shift in (0.0, *DIAGONAL_SHIFTS):
            held = band.copy(order="F")
            if shift:
                held[0] += shift * np.nan_to_num(band[0]).max()
            factor, info = dpbtrf(held, lower=1, overwrite_ab=1)
            if info == 0:
                return factor
        return np.full_like(band, np.nan)

    def map_coefficients(
        self, points: Complex[np.ndarray, " vertices"]
    ) -> tuple[Complex[np.ndarray, "quads 4"], Complex[np.ndarray, "quads 4"]]:
        """Return the coefficients a and b of every corner triangle's map to the plane, u = a z + b conj(z)."""
        u, after, before = (points.take(corners) for corners in (self.corners, *self._around))
        d, before = after - u, u - before
        t = self.triangles
        return t.along * d + t.against * before, t.along_bar * d + t.against_bar * before

    def global_step(
        self,
        factor: Float[np.ndarray, "band vertices"],
        weights: Float[np.ndarray, " quads"],
        rotation: Complex[np.ndarray, "quads 4"],
        springs: SideSprings | None = None,
    ) -> Complex[np.ndarray, " vertices"]:
        """Return the flat points whose triangles fit given rotations best, in the weighted least-squares sense.

        Parameters
        ----------
        factor : result of ``factor`` for these weights and springs
        weights : weights of the quads' energies
        rotation : rotations of the corner triangles, unit complex numbers
        springs : springs that pull sides to desired vectors
        """
        self.tick()
        along, against = self._towards
        s = self.triangles.area * weights[:, None] * rotation
        pull = along * s + (against * s).take(NEXT, axis=1)
        force = (pull.take(PREVIOUS, axis=1) - pull).ravel()
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
        points = np.empty(self.count, dtype=complex)
        points.real, points.imag = solution[:, 0].take(self.place), solution[:, 1].take(self.place)
        return points

    @cached_property
    def _joint_rotations(self) -> Complex[np.ndarray, " joints"]:
        """For every joint, the rotation of its second quad that makes the common side parallel in both quads.

        Unit complex numbers, for the quads as they lie in ``triangles.flat``.
        """
        fa, ka, fb, kb = self.joints
        flat = self.triangles.flat
        turn = (flat[fa, (ka + 1) % 4] - flat[fa, ka]) * (flat[fb, kb] - flat[fb, (kb + 1) % 4]).conj()
        size = np.abs(turn)
        return np.where(size > 0, turn, 1.0) / np.where(size > 0, size, 1.0)

    def propagate_rotations(self) -> Complex[np.ndarray, "quads 4"]:
        """Return initial rotations of the corner triangles, propagated from every patch's middle quad over uncut sides."""
        q = len(self.quads)
        if q == len(self.sizes):
            return np.ones((q, 4), dtype=complex)
        fa, _, fb, _ = self.joints
        # an extra root node, linked to the middle quad of every patch
        middle = self._middle_quads()
        ends = np.concatenate([fa, np.full(len(middle), q)]), np.concatenate([fb, middle])
        graph = coo_array((np.ones(len(ends[0])), ends), shape=(q + 1, q + 1))
        order, before = breadth_first_order(graph.tocsr(), q, directed=False)
        step = {(q, start): 1.0 + 0j for start in middle.tolist()}
        for a, b, t in zip(fa.tolist(), fb.tolist(), self._joint_rotations.tolist(), strict=True):
            step[a, b], step[b, a] = t, t.conjugate()
        values: list[complex] = [1.0 + 0j] * (q + 1)
        for quad in order[1:].tolist():
            parent = int(before[quad])
            values[quad] = values[parent] * step[parent, quad]
        return np.repeat(np.array(values[:q])[:, None], 4, axis=1)

    def _middle_quads(self) -> Int[np.ndarray, " patches"]:
        """Return the quad (local number) nearest to the centre of every patch."""
        centre = self.mesh.centroids[self.quads]
        first = np.cumsum(self.sizes) - self.sizes
        mean = np.add.reduceat(centre, first, axis=0) / self.sizes[:, None]
        away = ((centre - mean[self.patch_of]) ** 2).sum(axis=1)
        return np.lexsort((away, self.patch_of))[first]

    def max_energies(self, energy: Float[np.ndarray, " quads"]) -> Float[np.ndarray, " patches"]:
        """Return the largest energy in every patch."""
        return np.maximum.reduceat(energy, np.cumsum(self.sizes) - self.sizes)

    def smoothest_rotations(self) -> Complex[np.ndarray, "quads 4"]:
        """Return the initial rotations of the corner triangles that fit all uncut sides best.

        They are the lowest eigenvector of the connection Laplacian (Singer & Wu 2012), found by inverse iteration;
        slower and better than ``propagate_rotations``.
        """
        q = len(self.quads)
        fa, _, fb, _ = self.joints
        degree = np.bincount(fa, minlength=q) + np.bincount(fb, minlength=q)
        everyone = np.arange(q)
        rows, cols = np.concatenate([everyone, fa, fb]), np.concatenate([everyone, fb, fa])
        values = np.concatenate([degree + 1e-6, -self._joint_rotations.conj(), -self._joint_rotations])
        solver = splu(csc_array((values, (rows, cols)), shape=(q, q)))
        vector = self.propagate_rotations()[:, 0]
        for _ in range(20):
            vector = solver.solve(vector)
            vector /= np.abs(vector).max()
        vector = vector / np.maximum(np.abs(vector), 1e-12)
        return np.repeat(vector[:, None], 4, axis=1)

    @cached_property
    def joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Uncut sides between two quads, each once: a quad, its side, the quad across, that quad's side.

        Quads are local numbers, sides 0 to 3.
        """
        c = self.corners
        key = np.minimum(c, c[:, NEXT]) * self.count + np.maximum(c, c[:, NEXT])
        flat_key = key.ravel()
        order = np.argsort(flat_key, kind="stable")
        same = np.flatnonzero(flat_key[order][1:] == flat_key[order][:-1])
        one, two = order[same], order[same + 1]
        return one // 4, one % 4, two // 4, two % 4

    def flat_patch(self, points: Complex[np.ndarray, " vertices"]) -> FlatPatch:
        """Return the flat patch with its vertices at ``points``; its energies are infinite if a point is not finite."""
        if not np.isfinite(points).all():
            turns, energy = np.ones(self.corners.shape, dtype=complex), np.full(len(self.corners), np.inf)
            return FlatPatch(points, turns, energy, self.corners.size)
        a, b = self.map_coefficients(points)
        size_a, size_b = np.abs(a), np.abs(b)
        rotation = a / np.maximum(size_a, 1e-300)
        flips = size_a.size - np.count_nonzero(size_b < size_a)
        return FlatPatch(points, rotation, quad_energy(self.triangles, size_a, size_b), flips)


@dataclass(frozen=True, eq=False)
class SideSprings:
    """Springs (soft constraints) on the vectors of sides along the outline.

    ends : flat vertices at the start and the end of each side
    vectors : desired vectors from start to end, complex, metres
    stiffness : weights of the springs' energies, on the same scale as the weights of the quads' energies
    """

    ends: Int[np.ndarray, "springs 2"]
    vectors: Complex[np.ndarray, " springs"]
    stiffness: Float[np.ndarray, " springs"]


def solve_local_global(
    problem: PatchProblem,
    rotation: Complex[np.ndarray, "quads 4"] | None = None,
    *,
    rounds: int = 30,
    tolerance: float = 2e-4,
    give_up_above: float = np.inf,
) -> FlatPatch:
    """Alternate nearest rotations and linear solves until the flat points converge (Liu et al. 2008).

    Parameters
    ----------
    problem : linear systems of the patch
    rotation : initial rotations of the corner triangles, unit complex numbers; by default propagated over the patch
    rounds : largest number of rounds
    tolerance : stop when the largest energy changes by less than this share in a round
    give_up_above : return early when the largest energy will clearly stay above this value
    """
    if rotation is None:
        rotation = problem.propagate_rotations()
    weights = np.ones(len(problem.quads))
    factor = problem.factor(weights)
    before = np.inf
    patch = problem.flat_patch(problem.global_step(factor, weights, rotation))
    for turn in range(rounds):
        worst = patch.max_energy
        change = before - worst
        if abs(change) < tolerance * worst:
            break
        # the energy falls geometrically: all further rounds together lower it by at most 12 times the last change
        if turn >= 4 and worst - 12.0 * max(change, 0.0) > give_up_above:
            break
        before = worst
        patch = problem.flat_patch(problem.global_step(factor, weights, patch.rotation))
    return patch


def minimise_max_energy(
    problem: PatchProblem,
    patch: FlatPatch,
    *,
    rounds: int = 15,
    inner: int = 2,
    target: float = 0.0,
    give_up_above: float = np.inf,
) -> FlatPatch:
    """Lower the largest energy by giving quads with high energy more weight, round by round; return the best patch.

    Parameters
    ----------
    problem : linear systems of the patch
    patch : flat patch to start from
    rounds : largest number of changes of the weights
    inner : number of solves between two changes of the weights
    target : stop when the largest energy is at most this and no triangle is flipped
    give_up_above : return early when the largest energy is estimated to stay above this value
    """
    weights = np.ones(len(problem.quads))
    best = patch
    for _ in range(rounds):
        if best.max_energy <= target and best.flip_count == 0:
            break
        share = patch.energy / max(patch.energy.max(), 1e-300)
        weights *= 0.15 + share
        weights /= weights.mean()
        np.maximum(weights, 1e-4, out=weights)
        factor = problem.factor(weights)
        shares, means = weights * problem.triangles.quad_areas, list[float]()
        shares /= shares.sum()
        for _ in range(inner):
            patch = problem.flat_patch(problem.global_step(factor, weights, patch.rotation))
            means.append(float(shares @ patch.energy))
        if (patch.flip_count, patch.max_energy) < (best.flip_count, best.max_energy):
            best = patch
        # Stop if the limit is out of reach. The minimum of the weighted mean energy bounds the largest energy from
        # below (weak duality); the decrease of that mean in this round estimates how much it can still decrease.
        if best.max_energy > give_up_above and means[-1] - FURTHER_DECREASE * (means[0] - means[-1]) > give_up_above:
            break
    return best
