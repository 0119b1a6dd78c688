"""Corner triangles of quads and the energy of laying them flat (Liu et al. 2008), in complex form.

A corner triangle consists of a corner of a quad and both adjacent corners; the four corner triangles belong to both
triangulations of the quad. A triangle is first laid into the plane without distortion; the map u = a z + b conj(z) with
complex coefficients a and b takes its points z from there to the flat patch. The singular values of the map are
|a| + |b| and |a| - |b|, its determinant is |a|^2 - |b|^2, and the rotation nearest to it is a / |a|.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ...arrays import Columns, Complex, Float
from ...surface.mesh import QuadMesh
from ..loops import NEXT, PREVIOUS


@dataclass(frozen=True, eq=False)
class CornerTriangles(Columns):
    """The four corner triangles of every quad, each laid into the plane without distortion.

    along, against : factors (1/m) of a = along * d[k] + against * d[k-1], with d[k] the flat side k, a complex number
    along_bar, against_bar : factors (1/m) of b = along_bar * d[k] + against_bar * d[k-1]
    area : area of every triangle, square metres
    flat : corners of every quad projected to its plane, complex, metres
    stiffness : matrix of sum(area (|a|^2 + |b|^2)) as a quadratic form of the quad's flat corners; no unit
    """

    along: Complex[np.ndarray, "quads 4"]
    against: Complex[np.ndarray, "quads 4"]
    along_bar: Complex[np.ndarray, "quads 4"]
    against_bar: Complex[np.ndarray, "quads 4"]
    area: Float[np.ndarray, "quads 4"]
    flat: Complex[np.ndarray, "quads 4"]
    stiffness: Float[np.ndarray, "quads 4 4"]

    @cached_property
    def quad_areas(self) -> Float[np.ndarray, " quads"]:
        """Sum of the areas of each quad's corner triangles, square metres; at least 1e-300, to avoid dividing by 0."""
        return np.maximum(self.area.sum(axis=1), 1e-300)


@lru_cache(maxsize=4)
def corner_triangles(mesh: QuadMesh) -> CornerTriangles:
    """Return the corner triangles of every quad of a mesh (Liu et al. 2008, section 3, in complex form)."""
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
    """Build the corner triangles of quads.

    forward, backward : vectors from every corner to the next and the previous corner, metres
    flat : corners of every quad projected to its plane, complex, metres
    """
    length_f, _length_b = np.linalg.norm(forward, axis=2), np.linalg.norm(backward, axis=2)
    double_area = np.linalg.norm(np.cross(forward, backward), axis=2)
    inner = np.einsum("fki,fki->fk", forward, backward)
    z1 = length_f.astype(complex)
    z0 = (inner + 1j * double_area) / np.where(length_f > 0, length_f, 1.0)
    # rotate each triangle to fit the projection of its quad best, so that a common rotation suits all four triangles
    w1, w0 = flat[:, NEXT] - flat, flat[:, PREVIOUS] - flat
    turn = w1 * z1.conj() + w0 * z0.conj()
    size = np.abs(turn)
    turn = np.where(size > 0, turn / np.where(size > 0, size, 1.0), 1.0)
    z1, z0 = z1 * turn, z0 * turn
    d = z1 * z0.conj() - z1.conj() * z0
    # a triangle without area has no map and no weight
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
    tri: CornerTriangles, a: Float[np.ndarray, "quads 4"], b: Float[np.ndarray, "quads 4"]
) -> Float[np.ndarray, " quads"]:
    """Return the distortion E of every quad: area-weighted mean of (s1-1)^2 + (s2-1)^2 over its corner triangles.

    Parameters
    ----------
    tri : corner triangles
    a, b : absolute values of the coefficients a and b of every corner triangle's map
    """
    energy = 2.0 * ((a - 1.0) ** 2 + b**2)
    return (tri.area * energy).sum(axis=1) / tri.quad_areas


def square_energy(corners: Complex[np.ndarray, "quads 4"]) -> Float[np.ndarray, " quads"]:
    """Return the irregularity of flat quads: ``quad_energy`` of the map from a square of equal area; 0 for a square."""
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
