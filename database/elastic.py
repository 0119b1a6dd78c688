"""St. Venant-Kirchhoff solids in cubic hexahedra: energy, forces and tangent of all elements at once.

Young's modulus is 1. Gauss-Lobatto points are used along an element, where they coincide with its nodes and make most
of the tangent sparse, and 4 x 4 Gauss points in its section, where torsion needs the full order.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from ..engine.arrays import Float, Int
from ..engine.errors import FlexMapsError
from ..engine.materials import Orthotropy
from .solid import LOBATTO_WEIGHTS, derivative_matrix, lagrange

ALONG = 4  # nodes, and stations of the quadrature, along an element
SECTION = 16  # nodes and points of an element's section, 4 by 4
THROUGH = 0.3  # Poisson's ratio from the sheet's plane through it; of wood 0.3 to 0.7 (Wood Handbook, Forest Products Laboratory)
STATION_PAIRS = [(p, r) for p in range(ALONG) for r in range(p + 1)]  # the pairs of stations that a tangent couples


def _section_basis() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Weights of the section's 16 points, and values and both derivatives (points, nodes) of its shape functions there."""
    x, w = np.polynomial.legendre.leggauss(4)
    value, slope = lagrange(0.5 * (x + 1.0))
    weights = np.outer(0.5 * w, 0.5 * w).ravel()
    return weights, np.kron(value, value), np.kron(slope, value), np.kron(value, slope)


class Elements:
    """The elements of a solid at rest, and what their tangents are made from.

    rest : (E, 4, 16, 3) rest positions of the nodes, in arm widths: station along, node of the section
    poisson : Poisson's ratio in (0, 0.45)
    stiffness : (6, 6) of an anisotropic solid, in the order of ``VOIGT``, per the modulus that is the unit; then the ratio plays
        no part
    """

    def __init__(
        self,
        nodes: np.ndarray,
        elements: np.ndarray,
        poisson: float,
        stiffness: Float[np.ndarray, "6 6"] | None = None,
    ):
        if not 0.0 < poisson < 0.45:
            raise FlexMapsError(f"Poisson's ratio is {poisson:g}; it must lie between 0 and 0.45")
        self.index = elements.reshape(-1, ALONG, SECTION)
        self.poisson = poisson
        self.lame = poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
        self.shear = 0.5 / (1.0 + poisson)
        self.anisotropic = stiffness
        self.rest = nodes[self.index]
        self._d = derivative_matrix()
        weights, self._n, self._n1, self._n2 = _section_basis()
        jacobian = self._slopes(self.rest)
        det = np.linalg.det(jacobian)
        if det.min() <= 0:
            raise FlexMapsError("The mesh of a spiral is folded; use less twist or a smaller width")
        # jacobian[i, d] = dX_i / dxi_d, so its inverse is [d, I] = dxi_d / dX_I
        self.inverse = np.linalg.inv(jacobian)
        self.weight = det * (LOBATTO_WEIGHTS[:, None] * weights)
        self.metric = np.einsum("emqdI,emqfI->emqdf", self.inverse, self.inverse)

    def _slopes(self, field: Float[np.ndarray, "elements 4 16 3"]) -> Float[np.ndarray, "elements 4 16 3 3"]:
        """Derivative of component i of a nodal field by local direction d."""
        return self._at(field, self._n, self._n1, self._n2)

    def _at(self, field: np.ndarray, n: np.ndarray, n1: np.ndarray, n2: np.ndarray) -> np.ndarray:
        flat = np.swapaxes(field, 2, 3)  # (E, p, i, s)
        out = np.empty((*field.shape[:2], len(n), 3, 3))
        out[..., 0] = np.einsum("mp,epiq->emqi", self._d, flat @ n.T)
        out[..., 1] = np.swapaxes(flat @ n1.T, 2, 3)
        out[..., 2] = np.swapaxes(flat @ n2.T, 2, 3)
        return out

    @cached_property
    def node_volumes(self) -> Float[np.ndarray, "elements 4 16"]:
        """Integral of every node's shape function over its element."""
        return self.weight @ self._n

    def gradients(self, displacement: Float[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "elements 4 16 3 3"]:
        """Deformation gradient F of nodal displacements."""
        return np.eye(3) + self._slopes(displacement[self.index]) @ self.inverse

    def strain(self, f: Float[np.ndarray, "*points 3 3"]) -> Float[np.ndarray, "*points 3 3"]:
        """Green strain of deformation gradients."""
        return 0.5 * (np.swapaxes(f, -1, -2) @ f - np.eye(3))

    def stress(self, strain: Float[np.ndarray, "*points 3 3"]) -> Float[np.ndarray, "*points 3 3"]:
        """Second Piola-Kirchhoff stress of (linearised or full) Green strains, per Young's modulus."""
        if self.anisotropic is not None:
            return _matrix(_vector(strain) @ self.anisotropic)
        trace = np.trace(strain, axis1=-2, axis2=-1)
        return 2.0 * self.shear * strain + self.lame * trace[..., None, None] * np.eye(3)

    def energy(self, strain: Float[np.ndarray, "elements 4 16 3 3"]) -> float:
        """Elastic energy, in Young's modulus times cubed arm width."""
        if self.anisotropic is not None:
            return 0.5 * float((self.weight * np.einsum("...ij,...ij->...", strain, self.stress(strain))).sum())
        trace = np.trace(strain, axis1=-2, axis2=-1)
        density = self.shear * np.einsum("...ij,...ij->...", strain, strain) + 0.5 * self.lame * trace**2
        return float((self.weight * density).sum())

    def forces(self, f: np.ndarray, stress: np.ndarray) -> Float[np.ndarray, "elements 4 16 3"]:
        """Derivative of the energy by the nodal positions."""
        # first Piola-Kirchhoff stress by local direction: w P_iI dxi_d/dX_I
        p = self.weight[..., None, None] * (f @ stress @ np.swapaxes(self.inverse, -1, -2))
        by_point = np.swapaxes(p, 2, 4)  # (E, m, d, i, q)
        out = (self._d.T @ by_point[:, :, 0].reshape(len(p), ALONG, -1)).reshape(*p.shape[:2], 3, -1) @ self._n
        out += by_point[:, :, 1] @ self._n1
        out += by_point[:, :, 2] @ self._n2
        return np.swapaxes(out, 2, 3)

    @cached_property
    def _products(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Products of two section functions at the points, flattened over both nodes.

        along-along (16, 256); across-across (16 * 4, 256) for the direction pairs 11, 12, 21, 22; along-across
        (16 * 2, 256) for directions 1, 2 of the second function.
        """
        n, n1, n2 = self._n, self._n1, self._n2

        def pairs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return (a[:, :, None] * b[:, None, :]).reshape(SECTION, -1)

        inner = np.stack([pairs(n1, n1), pairs(n1, n2), pairs(n2, n1), pairs(n2, n2)], axis=1)
        mixed = np.stack([pairs(n, n1), pairs(n, n2)], axis=1)
        return pairs(n, n), inner.reshape(-1, SECTION**2), mixed.reshape(-1, SECTION**2)

    def _moduli(self, f: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """(E, 4, d, e, i, j, 16): weighted elasticity of the pair of local directions d, e and components i, j.

        w [lambda f_d f_e^T + mu (F F^T (g_d . g_e) + f_e f_d^T) + I (g_d . S g_e)], with g_d = dxi_d/dX and f_d = F g_d.
        """
        if self.anisotropic is not None:
            return self._anisotropic_moduli(f, stress)
        e = len(f)

        # the points go last, so that what follows is long runs of plain products
        def last(x: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(np.moveaxis(x, 2, -1))

        hat = last(f @ np.swapaxes(self.inverse, -1, -2))  # (E, m, i, d, q)
        left = last((self.weight * self.shear)[..., None, None] * (f @ np.swapaxes(f, -1, -2)))
        geometric = last(self.weight[..., None, None] * (self.inverse @ stress @ np.swapaxes(self.inverse, -1, -2)))
        metric, weight = last(self.metric), self.weight
        lame, shear = self.lame * weight, self.shear * weight
        out = np.empty((e, ALONG, 3, 3, 3, 3, SECTION))
        for d in range(3):
            for g in range(d + 1):
                for i in range(3):
                    for j in range(3):
                        value = lame * hat[:, :, i, d] * hat[:, :, j, g]
                        value += shear * hat[:, :, i, g] * hat[:, :, j, d]
                        value += left[:, :, i, j] * metric[:, :, d, g]
                        if i == j:
                            value += geometric[:, :, d, g]
                        out[:, :, d, g, i, j] = value
                        if d != g:  # the energy's second derivatives are symmetric
                            out[:, :, g, d, j, i] = value
        return out

    def _anisotropic_moduli(self, f: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """``_moduli`` for any elasticity C: w [f_i,I g_d,J C_IJKL g_e,L f_j,K + I (g_d . S g_e)]."""
        # how the strain changes with the slope of component i along the local direction d
        change = np.einsum("emqiI,emqdJ->emqdiIJ", f, self.inverse)
        rows = _vector(0.5 * (change + np.swapaxes(change, -1, -2))).reshape(*f.shape[:3], 9, 6)
        out = (rows @ self.anisotropic @ np.swapaxes(rows, -1, -2)).reshape(*f.shape[:3], 3, 3, 3, 3)
        geometric = self.inverse @ stress @ np.swapaxes(self.inverse, -1, -2)
        for i in range(3):
            out[..., :, i, :, i] += geometric
        out *= self.weight[..., None, None, None, None]
        # (E, m, q, d, i, e, j) to (E, m, d, e, i, j, q)
        return np.ascontiguousarray(out.transpose(0, 1, 3, 5, 4, 6, 2))

    def tangents(self, f: np.ndarray, stress: np.ndarray) -> Float[np.ndarray, "elements 10 3 3 16 16"]:
        """Second derivative of the energy by the nodal positions, per pair in STATION_PAIRS.

        Entry [e, k, i, j, s, s'] couples component i of node (p, s) and component j of node (p', s') for the pair k of
        stations p >= p'; the other pairs follow from symmetry.
        """
        c = self._moduli(f, stress)
        count = len(f)
        plain, inner, mixed = self._products
        along = c[:, :, 0, 0].reshape(-1, SECTION) @ plain
        section = np.moveaxis(c[:, :, 1:, 1:], (2, 3), (-2, -1)).reshape(-1, 4 * SECTION) @ inner
        cross = np.moveaxis(c[:, :, 0, 1:], 2, -1).reshape(-1, 2 * SECTION) @ mixed
        shape = (count, ALONG, 3, 3, SECTION, SECTION)
        cross = cross.reshape(shape)
        back = cross.transpose(0, 1, 3, 2, 5, 4)
        stack = np.concatenate([along.reshape(shape), section.reshape(shape), cross, back], axis=1)
        return (self._mixing @ stack.reshape(count, 4 * ALONG, -1)).reshape(count, -1, 3, 3, SECTION, SECTION)

    @cached_property
    def _mixing(self) -> Float[np.ndarray, "10 16"]:
        """How the four kinds of section matrices at the four stations make up the pairs of stations."""
        d = self._d
        out = np.zeros((len(STATION_PAIRS), 4, ALONG))
        for k, (p, r) in enumerate(STATION_PAIRS):
            out[k, 0] = d[:, p] * d[:, r]
            out[k, 1, p] = float(p == r)
            out[k, 2, r] = d[r, p]
            out[k, 3, p] = d[p, r]
        return out.reshape(len(STATION_PAIRS), 4 * ALONG)

    @cached_property
    def _fine_section(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shape functions and their derivatives at 8 x 8 even points of the section, which reach its surface."""
        value, slope = lagrange((np.arange(8) + 0.5) / 8)
        return np.kron(value, value), np.kron(slope, value), np.kron(value, slope)

    def peak_strain(self, displacement: np.ndarray, share: float = 0.99, only: np.ndarray | None = None) -> float:
        """The largest principal Green strain (in magnitude) that ``share`` of the volume stays below.

        ``only`` : (M,) int, the elements whose volume counts; all by default
        """
        chosen = slice(None) if only is None else only
        n, n1, n2 = self._fine_section
        f = np.eye(3) + self._at(displacement[self.index[chosen]], n, n1, n2) @ self._fine_inverse[chosen]
        size = largest_principal(self.strain(f))
        order = np.argsort(size, axis=None)
        reached = np.cumsum(self._fine_weight[chosen].ravel()[order])
        return float(size.ravel()[order][np.searchsorted(reached, share * reached[-1])])

    @cached_property
    def _fine_jacobian(self) -> np.ndarray:
        return self._at(self.rest, *self._fine_section)

    @cached_property
    def _fine_inverse(self) -> np.ndarray:
        return np.linalg.inv(self._fine_jacobian)

    @cached_property
    def _fine_weight(self) -> np.ndarray:
        return np.linalg.det(self._fine_jacobian) * LOBATTO_WEIGHTS[:, None] / 64.0


# places of a symmetric matrix in its vector: the engineering strains of 23, 13 and 12 are twice the matrix's
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def _vector(strain: Float[np.ndarray, "*points 3 3"]) -> Float[np.ndarray, "*points 6"]:
    """Engineering strains of symmetric matrices."""
    return np.stack([strain[..., i, j] * (1.0 if i == j else 2.0) for i, j in VOIGT], axis=-1)


def _matrix(stress: Float[np.ndarray, "*points 6"]) -> Float[np.ndarray, "*points 3 3"]:
    """Symmetric matrices of stresses in the order of ``VOIGT``."""
    out = np.empty((*stress.shape[:-1], 3, 3))
    for k, (i, j) in enumerate(VOIGT):
        out[..., i, j] = out[..., j, i] = stress[..., k]
    return out


def orthotropic(known: Orthotropy, unit: float, angle: float) -> Float[np.ndarray, "6 6"]:
    """Stiffness, per ``unit`` Pa, of a sheet in its flat frame, x and y in the sheet, whose grain lies ``angle`` radians from x.

    Through the sheet, where arms carry next to nothing, it is taken as soft as across the grain, with a Poisson's ratio of
    ``THROUGH`` to both sides.
    """
    soft = np.zeros((6, 6))
    soft[np.arange(6), np.arange(6)] = 1.0 / np.array(
        [known.along, known.across, known.across, known.shear_across, known.shear_along, known.shear]
    )
    soft[0, 1] = soft[1, 0] = -known.poisson / known.along
    soft[0, 2] = soft[2, 0] = -THROUGH / known.along
    soft[1, 2] = soft[2, 1] = -THROUGH / known.across
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    # stresses in the grain's axes from those in the flat frame, and strains back
    inward = np.array([_vector_of(turn.T @ _unit(k) @ turn) for k in range(6)]).T
    return np.linalg.inv(inward.T @ soft @ inward) / unit


def _unit(k: int) -> Float[np.ndarray, "3 3"]:
    """The stress whose k-th number is 1."""
    return _matrix(np.eye(6)[k])


def _vector_of(stress: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 6"]:
    return np.array([stress[i, j] for i, j in VOIGT])


def largest_principal(strain: Float[np.ndarray, "*points 3 3"]) -> Float[np.ndarray, "*points"]:
    """Largest eigenvalue in magnitude of symmetric matrices, by the trigonometric formula."""
    flat = np.ascontiguousarray(np.moveaxis(strain.reshape(-1, 9), 1, 0))  # long runs of plain products
    xx, xy, xz, _, yy, yz, _, _, zz = flat
    mean = (xx + yy + zz) / 3.0
    a, b, c = xx - mean, yy - mean, zz - mean
    size = np.sqrt(np.maximum((a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0, 1e-100))
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    angle = np.arccos(np.clip(determinant / (2.0 * size**3), -1.0, 1.0)) / 3.0
    high, low = mean + 2.0 * size * np.cos(angle), mean + 2.0 * size * np.cos(angle + 2.0 * np.pi / 3.0)
    return np.maximum(np.abs(high), np.abs(low)).reshape(strain.shape[:-2])


def tangent_entries(dofs: Int[np.ndarray, "elements 4 16 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (E, pairs, 3, 3, 16, 16) of what ``Elements.tangents`` returns."""
    pairs = np.array(STATION_PAIRS)
    rows, cols = (dofs[:, pairs[:, end]].transpose(0, 1, 3, 2) for end in (0, 1))
    shape = (len(dofs), len(pairs), 3, 3, SECTION, SECTION)
    rows = np.broadcast_to(rows[:, :, :, None, :, None], shape)
    return rows, np.broadcast_to(cols[:, :, None, :, None, :], shape)


def lower_entries(dofs: Int[np.ndarray, "elements 4 16 3"]) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """The same in a row, for a ``SparsityPattern``: a pair of different stations stands for both triangles, so it goes to the lower
    one; equal stations hold both.
    """
    rows, cols = tangent_entries(dofs)
    pairs = np.array(STATION_PAIRS)
    both = (pairs[:, 0] != pairs[:, 1])[None, :, None, None, None, None]
    high, low = np.maximum(rows, cols), np.minimum(rows, cols)
    return np.where(both, high, rows).ravel(), np.where(both, low, cols).ravel()
