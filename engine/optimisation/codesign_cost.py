"""What flat patches may be when they move for the sake of the match: nearly isometric, with seams that still fit.

Two measures are kept below limits by barriers: the distortion of every quad as in ``flatten`` and how much the lengths of
both sides of every cut edge differ. -log(1 - measure / limit) is the measure itself while it is small and infinite at the
limit, so that flat shapes stay as true as the match lets them.
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

SLACK = 1.02  # how far quads and seams that are beyond the limit may go above what they were


@dataclass(frozen=True, eq=False)
class FlatLimits:
    """layout : the patches; energy : (F,) largest distortions; seam : (C,) largest differences of both sides of cut edges, as
    shares of their lengths on the surface
    """

    layout: PatchLayout
    energy: Float[np.ndarray, " quads"]
    seam: Float[np.ndarray, " cuts"]

    @classmethod
    def of(cls, flat: FlatPatches, energy: float, seam: float) -> FlatLimits:
        """Limits for all, or what the patches had before where that was more."""
        return cls(flat.layout, np.maximum(energy, SLACK * flat.energy), np.maximum(seam, SLACK * seam_mismatch(flat)))

    @cached_property
    def triangles(self) -> CornerTriangles:
        return corner_triangles(self.layout.mesh)

    @cached_property
    def share(self) -> Float[np.ndarray, "quads 4"]:
        """(F, 4): twice the area of the corner triangles over that of their quad."""
        area = self.triangles.area
        return 2.0 * area / area.sum(axis=1, keepdims=True)

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """(C, 2) and (C, 2): flat vertices at the start and at the end of both sides of every cut edge."""
        mesh, cut = self.layout.mesh, self.layout.cut
        quad, side = mesh.edge_quads[cut], mesh.edge_sides[cut]
        return self.layout.flat_corners[quad, side], self.layout.flat_corners[quad, NEXT[side]]

    @cached_property
    def surface(self) -> Float[np.ndarray, " cuts"]:
        """(C,) metres: the cut edges on the surface."""
        return self.layout.mesh.edge_lengths[self.layout.cut]


@dataclass(frozen=True, eq=False)
class FlatCost:
    """Barriers of flat points (P,), complex metres: the mean over all quads and the mean over all cut edges."""

    limits: FlatLimits
    points: Complex[np.ndarray, " points"]

    @classmethod
    def of(cls, limits: FlatLimits, points: Float[np.ndarray, "points 2"]) -> FlatCost:
        """Of points (P, 2) metres."""
        return cls(limits, points[:, 0] + 1j * points[:, 1])

    @cached_property
    def maps(self) -> tuple[np.ndarray, np.ndarray]:
        """a and b (F, 4) of every corner triangle, as in ``arap``."""
        return self._maps(self.points)

    @cached_property
    def energy(self) -> Float[np.ndarray, " quads"]:
        """(F,) distortion."""
        a, b = self.maps
        return (self.limits.share * ((np.abs(a) - 1.0) ** 2 + np.abs(b) ** 2)).sum(axis=1)

    @cached_property
    def apart(self) -> Float[np.ndarray, " cuts"]:
        """(C,) difference of both sides, as a share."""
        start, end = self.limits.ends
        length = np.abs(self.points[end] - self.points[start])
        return (length[:, 0] - length[:, 1]) / self.limits.surface

    @cached_property
    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """(F,) and (C,): shares of the limits that are left; negative beyond them."""
        return 1.0 - self.energy / self.limits.energy, 1.0 - (self.apart / self.limits.seam) ** 2

    @property
    def inside(self) -> bool:
        return all(bool((part > 0.0).all()) for part in self.left)

    @cached_property
    def value(self) -> float:
        """Infinite at the limits and beyond."""
        if not self.inside:
            return np.inf
        return -sum(float(np.log(part).mean()) for part in self.left if len(part))

    @cached_property
    def gradient(self) -> Float[np.ndarray, "points 2"]:
        """(P, 2) per metre."""
        a, b = self.maps
        inner = self._strains_back(np.abs(a) - 1.0, b, self._slopes[0])
        return inner + self._apart_back(self._slopes[1] * self.apart)

    @cached_property
    def hessian(self) -> csr_array:
        """(2 P, 2 P) the Hessian without the curvature of the strains themselves, by x and y of every point in turn."""
        (rooms, gaps), (a, b), t = self._slopes, self.maps, self.limits.triangles
        n, w = len(a), self.limits.share
        # each quad has 8 coordinates; d, before: (8, 4) what the two edges of the corner triangles change by
        unit = np.zeros((8, 4), dtype=complex)
        unit[np.arange(8), np.arange(8) // 2] = np.tile([1.0, 1.0j], 4)
        d = unit[:, NEXT] - unit
        before = d[:, PREVIOUS]
        da = t.along[:, None] * d + t.against[:, None] * before
        db = t.along_bar[:, None] * d + t.against_bar[:, None] * before
        stretch = (a.conj()[:, None] * da).real / np.abs(a)[:, None]
        slope = (w[:, None] * ((np.abs(a) - 1.0)[:, None] * stretch + (b.conj()[:, None] * db).real)).sum(axis=2)
        # the last column is the barriers' own curvature: the square of their slope
        root = np.sqrt(rooms[:, None] * w)[:, None]
        steeper = np.sqrt(n) * rooms[:, None, None] * slope[:, :, None]
        factor = np.concatenate([root * stretch, root * db.real, root * db.imag, steeper], axis=2)
        corner, (start, end) = self.limits.layout.flat_corners, self.limits.ends
        along = self._directions * np.array([1.0, -1.0])[:, None] / self.limits.surface[:, None, None]
        weight = np.sqrt(gaps + len(gaps) * (gaps * self.apart) ** 2)
        apart = weight[:, None] * np.concatenate([along, -along], axis=1).reshape(-1, 8)
        size = 2 * len(self.points)
        quads = _spread(factor @ factor.swapaxes(1, 2), corner, size)
        return quads + _spread(apart[:, :, None] * apart[:, None], np.concatenate([end, start], axis=1), size)

    def product(self, change: np.ndarray) -> Float[np.ndarray, "points 2"]:
        """(P, 2) product of ``hessian`` with (P, 2)."""
        return (self.hessian @ change.ravel()).reshape(-1, 2)

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Twice the derivatives of the value by the distortions (F,) and by the squared differences (C,)."""
        room, gap = self.left
        by_gap = 2.0 / (max(len(gap), 1) * gap * self.limits.seam**2)
        return 2.0 / (len(room) * room * self.limits.energy), by_gap

    def _maps(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, t = points[self.limits.layout.flat_corners], self.limits.triangles
        d = u[:, NEXT] - u
        before = d[:, PREVIOUS]
        return t.along * d + t.against * before, t.along_bar * d + t.against_bar * before

    def _strains_back(self, stretch: np.ndarray, shear: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """The gradient by the points of changes of |a| and b, of quantities weighted by (F,) and the triangles' shares."""
        t, a, w = self.limits.triangles, self.maps[0], weight[:, None] * self.limits.share
        pa, pb = w * stretch * a / np.abs(a), w * shear
        pull = t.along.conj() * pa + t.along_bar.conj() * pb
        pull += (t.against.conj() * pa + t.against_bar.conj() * pb)[:, NEXT]
        return self._summed(self.limits.layout.flat_corners, pull[:, PREVIOUS] - pull)

    def _apart_back(self, apart: np.ndarray) -> np.ndarray:
        start, end = self.limits.ends
        pull = self._directions @ np.array([1.0, 1.0j]) * (apart / self.limits.surface)[:, None] * [1.0, -1.0]
        return self._summed(end, pull) - self._summed(start, pull)

    @cached_property
    def _directions(self) -> Float[np.ndarray, "cuts 2 2"]:
        """(C, 2, 2) unit vectors along both sides of every cut edge."""
        start, end = self.limits.ends
        along = self.points[end] - self.points[start]
        along = along / np.abs(along)
        return np.stack([along.real, along.imag], axis=2)

    def _summed(self, vertices: np.ndarray, pull: np.ndarray) -> np.ndarray:
        of, count = vertices.ravel(), len(self.points)
        parts = (np.bincount(of, part.ravel(), count) for part in (pull.real, pull.imag))
        return np.stack(list(parts), axis=1)


def _spread(blocks: Float[np.ndarray, "n 8 8"], points: Int[np.ndarray, "n 4"], size: int) -> csr_array:
    """Return the sum of blocks by x and y of four points each as a matrix (size, size)."""
    index = (2 * points[:, :, None] + np.arange(2)).reshape(-1, 8)
    row, column = np.broadcast_arrays(index[:, :, None], index[:, None])
    return csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(size, size))
