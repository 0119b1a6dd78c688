"""Barriers that keep flat patches nearly isometric, with seams that fit, while a search moves their vertices.

Two measures have limits: the distortion of every quad, as in ``flatten``, and the squared difference in length between
the two sides of every cut edge. The log barrier -log(1 - measure / limit) is infinite at the limit, and about measure /
limit far below it, so that flat shapes are distorted no more than the match needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Complex, Float, Int
from ..patches.flattening.flatten import FlatPatches, seam_mismatch
from ..patches.flattening.triangles import CornerTriangles, corner_triangles
from ..patches.layout import PatchLayout
from ..patches.loops import NEXT, PREVIOUS

# If a measure exceeds its limit from the start, its limit becomes this multiple of its first value. Larger: more
# distortion
EXCEEDED_BY = 1.02


@dataclass(frozen=True, eq=False)
class FlatLimits:
    """Limits of the flat shapes.

    layout : the patches; energy : (F,) largest distortion of every quad
    seam : (C,) largest difference in length between the sides of every cut edge, as a share of its length on the
        surface
    """

    layout: PatchLayout
    energy: Float[np.ndarray, " quads"]
    seam: Float[np.ndarray, " cuts"]

    @classmethod
    def relaxed_to(cls, flat: FlatPatches, energy: float, seam: float) -> FlatLimits:
        """Return the limits ``energy`` and ``seam``, relaxed where flat patches already violate them.

        Parameters
        ----------
        flat : the patches
        energy : largest distortion of a quad
        seam : largest difference in length between both sides of a cut edge, as a share of its length
        """
        return cls(
            flat.layout,
            np.maximum(energy, EXCEEDED_BY * flat.energy),
            np.maximum(seam, EXCEEDED_BY * seam_mismatch(flat)),
        )

    @cached_property
    def triangles(self) -> CornerTriangles:
        return corner_triangles(self.layout.mesh)

    @cached_property
    def share(self) -> Float[np.ndarray, "quads 4"]:
        """Weights (F, 4) of the corner triangles in their quad, by area; they sum up to 2."""
        area = self.triangles.area
        return 2.0 * area / area.sum(axis=1, keepdims=True)

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Flat vertices (C, 2) at the start and (C, 2) at the end of both sides of every cut edge."""
        mesh, cut = self.layout.mesh, self.layout.cut
        quad, side = mesh.edge_quads[cut], mesh.edge_sides[cut]
        return self.layout.flat_corners[quad, side], self.layout.flat_corners[quad, NEXT[side]]

    @cached_property
    def surface(self) -> Float[np.ndarray, " cuts"]:
        """Lengths of the cut edges on the surface, metres."""
        return self.layout.mesh.edge_lengths[self.layout.cut]


@dataclass(frozen=True, eq=False)
class FlatCost:
    """Mean of the barriers over all quads plus their mean over all cut edges.

    limits : of the flat shapes; points : (P,) flat vertices, metres, as complex numbers
    """

    limits: FlatLimits
    points: Complex[np.ndarray, " points"]

    @classmethod
    def from_points(cls, limits: FlatLimits, points: Float[np.ndarray, "points 2"]) -> FlatCost:
        """Return the cost of points (P, 2) metres."""
        return cls(limits, points[:, 0] + 1j * points[:, 1])

    @cached_property
    def maps(self) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients a and b (F, 4) of the affine map z -> a z + b conj(z) of every corner triangle to the plane."""
        return self._maps(self.points)

    @cached_property
    def energy(self) -> Float[np.ndarray, " quads"]:
        """Distortion (ARAP energy) of every quad."""
        a, b = self.maps
        return (self.limits.share * ((np.abs(a) - 1.0) ** 2 + np.abs(b) ** 2)).sum(axis=1)

    @cached_property
    def apart(self) -> Float[np.ndarray, " cuts"]:
        """Difference in length between the two sides of every cut edge, as a share of its length on the surface."""
        start, end = self.limits.ends
        length = np.abs(self.points[end] - self.points[start])
        return (length[:, 0] - length[:, 1]) / self.limits.surface

    @cached_property
    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """Slack of the limits of quads (F,) and cut edges (C,), as shares of the limits; negative beyond the limits."""
        return 1.0 - self.energy / self.limits.energy, 1.0 - (self.apart / self.limits.seam) ** 2

    @property
    def inside(self) -> bool:
        return all(bool((part > 0.0).all()) for part in self.left)

    @cached_property
    def value(self) -> float:
        """Value of the barriers; infinite at the limits and beyond."""
        if not self.inside:
            return np.inf
        return -sum(float(np.log(part).mean()) for part in self.left if len(part))

    @cached_property
    def gradient(self) -> Float[np.ndarray, "points 2"]:
        """Gradient (P, 2) of the value with respect to the points, per metre."""
        a, b = self.maps
        inner = self._strains_back(np.abs(a) - 1.0, b, self._slopes[0])
        return inner + self._apart_back(self._slopes[1] * self.apart)

    @cached_property
    def hessian(self) -> csr_array:
        """Gauss-Newton Hessian (2 P, 2 P), without second derivatives of the strains; order: point, then x and y."""
        (linear_clearances, gaps), (a, b), t = self._slopes, self.maps, self.limits.triangles
        n, w = len(a), self.limits.share
        # d, before: (8, 4) derivatives of both edges of the corner triangles with respect to the quad's 8 coordinates
        unit = np.zeros((8, 4), dtype=complex)
        unit[np.arange(8), np.arange(8) // 2] = np.tile([1.0, 1.0j], 4)
        d = unit[:, NEXT] - unit
        before = d[:, PREVIOUS]
        da = t.along[:, None] * d + t.against[:, None] * before
        db = t.along_bar[:, None] * d + t.against_bar[:, None] * before
        stretch = (a.conj()[:, None] * da).real / np.abs(a)[:, None]
        slope = (w[:, None] * ((np.abs(a) - 1.0)[:, None] * stretch + (b.conj()[:, None] * db).real)).sum(axis=2)
        # the last column adds the second derivative of the logarithm, which is its slope squared
        root = np.sqrt(linear_clearances[:, None] * w)[:, None]
        steeper = np.sqrt(n) * linear_clearances[:, None, None] * slope[:, :, None]
        factor = np.concatenate([root * stretch, root * db.real, root * db.imag, steeper], axis=2)
        corner, (start, end) = self.limits.layout.flat_corners, self.limits.ends
        along = self._directions * np.array([1.0, -1.0])[:, None] / self.limits.surface[:, None, None]
        weight = np.sqrt(gaps + len(gaps) * (gaps * self.apart) ** 2)
        apart = weight[:, None] * np.concatenate([along, -along], axis=1).reshape(-1, 8)
        size = 2 * len(self.points)
        quads = _assemble(factor @ factor.swapaxes(1, 2), corner, size)
        return quads + _assemble(apart[:, :, None] * apart[:, None], np.concatenate([end, start], axis=1), size)

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Twice the derivatives of the value with respect to ``energy`` (F,), and to the squares of ``apart`` (C,)."""
        room, gap = self.left
        by_gap = 2.0 / (max(len(gap), 1) * gap * self.limits.seam**2)
        return 2.0 / (len(room) * room * self.limits.energy), by_gap

    def _maps(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, t = points[self.limits.layout.flat_corners], self.limits.triangles
        d = u[:, NEXT] - u
        before = d[:, PREVIOUS]
        return t.along * d + t.against * before, t.along_bar * d + t.against_bar * before

    def _strains_back(self, stretch: np.ndarray, shear: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return the vjp (P, 2) of |a| and b of the corner triangles (see ``maps``) with respect to the points.

        stretch, shear : (F, 4) cotangents of |a| and b, times the triangles' weights and ``weight`` (F,) of their quad
        """
        t, a, w = self.limits.triangles, self.maps[0], weight[:, None] * self.limits.share
        pa, pb = w * stretch * a / np.abs(a), w * shear
        pull = t.along.conj() * pa + t.along_bar.conj() * pb
        pull += (t.against.conj() * pa + t.against_bar.conj() * pb)[:, NEXT]
        return self._sum_at_points(self.limits.layout.flat_corners, pull[:, PREVIOUS] - pull)

    def _apart_back(self, apart: np.ndarray) -> np.ndarray:
        """Return the vjp (P, 2) of the property ``apart`` with respect to the points; apart : (C,) cotangents."""
        start, end = self.limits.ends
        pull = self._directions @ np.array([1.0, 1.0j]) * (apart / self.limits.surface)[:, None] * [1.0, -1.0]
        return self._sum_at_points(end, pull) - self._sum_at_points(start, pull)

    @cached_property
    def _directions(self) -> Float[np.ndarray, "cuts 2 2"]:
        """Unit vectors (C, 2, 2) along both sides of every cut edge."""
        start, end = self.limits.ends
        along = self.points[end] - self.points[start]
        along = along / np.abs(along)
        return np.stack([along.real, along.imag], axis=2)

    def _sum_at_points(self, vertices: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """Add ``pull[i]`` (complex) to the point ``vertices[i]``, for all i; return x and y (P, 2) of the sums."""
        of, count = vertices.ravel(), len(self.points)
        parts = (np.bincount(of, part.ravel(), count) for part in (pull.real, pull.imag))
        return np.stack(list(parts), axis=1)


def _assemble(blocks: Float[np.ndarray, "n 8 8"], points: Int[np.ndarray, "n 4"], size: int) -> csr_array:
    """Assemble a matrix (size, size) from blocks, each for x and y of four points."""
    index = (2 * points[:, :, None] + np.arange(2)).reshape(-1, 8)
    row, column = np.broadcast_arrays(index[:, :, None], index[:, None])
    return csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(size, size))
