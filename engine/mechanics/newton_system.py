"""Sparse linear systems for an assembly's equilibrium, assembled from the joints' Hessians.

The increments (shift and turn of every hub) that supports hold are left out; the others are "free".
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ..arrays import Float, Num
from ..linalg import NotPositiveDefinite, SparseCholesky, SparsityPattern, negative_eigenvalues
from ..progress import SILENT, Progress
from .loads import Springs

# share of the diagonal that is added to a semi-definite matrix to make it definite; larger is more robust, less exact
SHIFT = 1e-9
# relative tolerance of eigenvalues at a minimum; it is small, because derivatives of eigenvalues need accurate modes
INVERSE_TOLERANCE = 1e-7
# Up to this number of free increments, eigenvalues are computed from dense matrices: Lanczos' method needs more
# unknowns than eigenvalues
MAX_DENSE_SIZE = 60


class NewtonSystem:
    """Linear systems in the free increments of n hubs, which share one sparsity pattern and symbolic factorisation.

    A matrix is stored as the entries (nnz,) of its lower triangle. A field is an array (n, 6): one number for every
    increment of every hub. In ``pairs`` the nodes of a rim may follow the n hubs. They are free; their rows in a field
    may be missing, then they are 0.

    pairs : (m, 2) indices of the spirals of every joint
    held : (n, 6) mask of the increments that are held at zero
    springs : at the hubs, whose stiffness is added to every matrix, or None
    """

    def __init__(self, pairs: np.ndarray, held: np.ndarray, backend: str | None = None, springs: Springs | None = None):
        more = max(int(pairs.max(initial=-1)) + 1 - len(held), 0)
        held = np.concatenate([held, np.zeros((more, 6), dtype=bool)]) if more else held
        self.held, self._pairs = held, pairs
        self.free = np.flatnonzero(~held.ravel())
        number = np.full(held.size, -1)
        number[self.free] = np.arange(len(self.free))
        of_joint = number[(pairs[:, :, None] * 6 + np.arange(6)).reshape(-1, 12)]
        rows, cols = np.broadcast_arrays(of_joint[:, :, None], of_joint[:, None, :])
        self._used = np.flatnonzero(((rows >= cols) & (cols >= 0)).ravel())
        self.pattern = SparsityPattern(rows.ravel()[self._used], cols.ravel()[self._used], len(self.free))
        self.cholesky = SparseCholesky(self.pattern, backend)
        self._springs: Float[np.ndarray, " free"] | None = None
        if springs is not None:
            stiffness = np.zeros(held.shape)
            stiffness[: len(springs.places), :3] = springs.stiffness
            self._springs = stiffness.ravel()[self.free]

    @cached_property
    def without_springs(self) -> NewtonSystem:
        """A system of the same joints and held increments, but without springs."""
        return self if self._springs is None else NewtonSystem(self._pairs, self.held)

    def values(self, blocks: np.ndarray) -> Num[np.ndarray, " nnz"]:
        """Return the entries (nnz,) of the matrix that is the sum of the joints' blocks (m, 12, 12) and the springs."""
        values = self.pattern.sum(blocks.ravel()[self._used])
        if self._springs is not None:
            values[self.pattern.indptr[:-1]] += self._springs
        return values

    def factor(self, values: np.ndarray) -> bool:
        """Factorise the matrix with the entries ``values`` (nnz,) for ``solve``.

        Returns False if the matrix is not positive definite.
        """
        return self.cholesky.attempt(values)

    def free_entries(self, field: np.ndarray) -> Float[np.ndarray, " free"]:
        """Return the numbers (free,) of a field (n, 6) at the free increments, in the order of the matrix's rows."""
        if len(field) < len(self.held):
            field = np.concatenate([field, np.zeros((len(self.held) - len(field), 6))])
        return field.ravel()[self.free]

    def expand(self, reduced: np.ndarray) -> Float[np.ndarray, "spirals 6"]:
        """Return the field (n, 6) with the numbers ``reduced`` (free,) at the free increments, 0 at the held ones."""
        out = np.zeros(self.held.size)
        out[self.free] = reduced
        return out.reshape(self.held.shape)

    def solve(self, field: np.ndarray) -> Float[np.ndarray, "spirals 6"]:
        """Solve with the last factorised matrix; the right-hand side ``field`` and the result are fields (n, 6)."""
        return self.expand(self.cholesky.solve(self.free_entries(field)))

    def make_definite(self, values: np.ndarray, share: float = SHIFT) -> np.ndarray:
        """Increase the diagonal of a positive semi-definite matrix a little, so that it becomes positive definite.

        Parameters
        ----------
        values : (nnz,) entries of the matrix
        share : the diagonal entries are increased by about this share of themselves

        Returns
        -------
        (nnz,) : entries of the new matrix
        """
        values, diagonal = values.copy(), self.pattern.indptr[:-1]
        values[diagonal] += share * values[diagonal] + 1e-3 * share * values[diagonal].max(initial=0.0)
        return values

    def count_negative(self, values: np.ndarray) -> int:
        """Count the negative eigenvalues of the matrix with the entries ``values`` (nnz,)."""
        try:
            return negative_eigenvalues(self.pattern, values)
        except NotPositiveDefinite:  # a pivot of the factorisation is exactly zero: shift the diagonal a little
            shifted, diagonal = values.copy(), self.pattern.indptr[:-1]
            shifted[diagonal] += SHIFT * np.abs(values[diagonal]).max(initial=1e-300)
            return negative_eigenvalues(self.pattern, shifted)

    def softest_modes(
        self,
        values: np.ndarray,
        metric: np.ndarray,
        count: int = 1,
        progress: Progress = SILENT,
        tolerance: float = 1e-3,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the modes in which the energy rises least, or falls most: eigenvectors of H v = lambda B v.

        B is first made positive definite. With B as metric the eigenvalues of H lie far apart, so that Lanczos' method
        needs few steps.

        Parameters
        ----------
        values : (nnz,) entries of H, the Hessian of the energy
        metric : (nnz,) entries of B, a positive semi-definite matrix such as the Hessian's convex part
        count : number of modes; fewer are returned if fewer increments are free
        progress : is updated and can cancel
        tolerance : relative error of lambda

        Returns
        -------
        (count, n, 6) : modes v, the one with the smallest lambda first
        (count,) : their lambda. Without free increments, the result is one mode of zeros with lambda 1
        """
        if not len(self.free):
            return np.zeros((1, *self.held.shape)), np.ones(1)
        metric = self.make_definite(metric)
        if len(self.free) <= MAX_DENSE_SIZE:
            return self._all_modes(values, metric, count)
        self.cholesky.factor(metric)
        size = (len(self.free),) * 2

        def solved(x: np.ndarray) -> np.ndarray:
            progress(0.0, "Finding how the shape moves most easily")
            return self.cholesky.solve(np.asarray(x).ravel())

        inverse = LinearOperator(size, matvec=solved, dtype=float)
        start = np.random.default_rng(0).normal(size=len(self.free))
        both = self.pattern.matrix(values), self.pattern.matrix(metric)
        try:
            rise, vectors = eigsh(both[0], count, both[1], Minv=inverse, which="SA", v0=start, tol=tolerance)
        except ArpackNoConvergence as error:
            rise, vectors = error.eigenvalues, error.eigenvectors
            if not len(rise):  # the eigenvalues are too close to each other to separate the modes: any mode will do
                rise, vectors = eigsh(both[0], 1, both[1], Minv=inverse, which="SA", v0=start, tol=0.5)
        return np.stack([self.expand(v) for v in vectors.T]), rise

    def softest_at_minimum(
        self, values: np.ndarray, metric: np.ndarray, count: int
    ) -> tuple[Float[np.ndarray, "count spirals 6"], Float[np.ndarray, " count"]]:
        """Find the modes v with the smallest lambda, H v = lambda B v, for a positive definite H; v . B v is 1.

        Lanczos' method is applied to the inverse of H, which needs few solves where modes are nearly unstable.

        Parameters
        ----------
        values : (nnz,) entries of H, which must be the last factorised matrix
        metric : (nnz,) entries of B
        count : number of modes

        Returns
        -------
        (count, n, 6) : modes v, the one with the smallest lambda first
        (count,) : their lambda
        """
        metric = self.make_definite(metric)
        if len(self.free) <= MAX_DENSE_SIZE:
            return self._all_modes(values, metric, count)
        size = (len(self.free),) * 2
        inverse = LinearOperator(size, matvec=lambda b: self.cholesky.solve(np.asarray(b).ravel()), dtype=float)
        start = np.random.default_rng(0).normal(size=len(self.free))
        both = self.pattern.matrix(metric), self.pattern.matrix(values)
        try:
            found, vectors = eigsh(both[0], count, both[1], Minv=inverse, which="LA", v0=start, tol=INVERSE_TOLERANCE)
        except ArpackNoConvergence as error:
            found, vectors = error.eigenvalues, error.eigenvectors
        order = np.argsort(-found)
        found, vectors = found[order], vectors[:, order]
        lengths = np.sqrt((vectors * (both[0] @ vectors)).sum(axis=0))
        return np.array([self.expand(v / one) for v, one in zip(vectors.T, lengths, strict=True)]), 1.0 / found

    def _all_modes(self, values: np.ndarray, metric: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Compute the result of ``softest_modes`` with dense matrices, for systems with few free increments."""
        a, b = (self.pattern.matrix(v).toarray() for v in (values, metric))
        rise, vectors = eigh(a, b, subset_by_index=(0, min(count, len(self.free)) - 1))
        return np.stack([self.expand(v) for v in vectors.T]), rise
