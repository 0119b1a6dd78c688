"""Independent reference for our solid elements: the same problem in scikit-fem, with its own mesh, elements and Newton solver."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.sparse import block_array, csc_array
from scipy.sparse.linalg import splu


def cross_energy(force: float, nodes: np.ndarray, start: np.ndarray) -> float:
    """Energy of a cross, 6 long and 1 wide and high, held in the mean at +x and pulled along z at -x, by scikit-fem.

    Its Newton iteration starts near our displacements ``start`` at ``nodes``, and goes on to an equilibrium of its own.
    """
    import skfem

    edges = np.concatenate([np.linspace(-3, -0.5, 5), [0.0], np.linspace(0.5, 3, 5)])
    mesh = skfem.MeshHex.init_tensor(edges, edges, np.linspace(-0.5, 0.5, 3))
    middle = np.abs(mesh.p[:, mesh.t].mean(1))
    mesh = mesh.restrict(np.flatnonzero((middle[0] < 0.5) | (middle[1] < 0.5)))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex2()), intorder=4)
    face = skfem.FacetBasis(mesh, basis.elem, facets=mesh.facets_satisfying(lambda x: x[0] < -3 + 1e-9), intorder=4)
    load = skfem.LinearForm(lambda v, _: force * v[2]).assemble(face)
    held = skfem.FacetBasis(mesh, basis.elem, facets=mesh.facets_satisfying(lambda x: x[0] > 3 - 1e-9), intorder=4)
    means = [skfem.LinearForm(lambda v, w, i=i: v[i]).assemble(held) for i in range(3)] + [
        skfem.LinearForm(lambda v, w: w.x[1] * v[2] - w.x[2] * v[1]).assemble(held),
        skfem.LinearForm(lambda v, w: w.x[2] * v[0]).assemble(held),
        skfem.LinearForm(lambda v, w: w.x[1] * v[0]).assemble(held),
    ]
    hold = csc_array(np.array(means))
    tangent, inner, energy = _forms()
    u = _interpolated(basis, nodes, start)
    multipliers = np.zeros(6)
    for _ in range(8):
        state = basis.interpolate(u)
        residual = load - inner.assemble(basis, state=state) - hold.T @ multipliers
        border = block_array([[tangent.assemble(basis, state=state), hold.T], [hold, None]]).tocsc()
        step = splu(border).solve(np.concatenate([residual, -hold @ u]))
        du, multipliers = step[: basis.N], multipliers + step[basis.N :]
        u += du
        if np.abs(du).max() < 1e-4:
            break
    else:
        raise AssertionError("scikit-fem's side did not converge")
    return float(energy.assemble(basis, state=basis.interpolate(u)))


def _forms() -> tuple[Any, Any, Any]:
    """Tangent, inner forces and energy of the material of Saint Venant and Kirchhoff, Young's modulus 1, Poisson's ratio 0.3."""
    import skfem
    from skfem.helpers import ddot, grad, identity, mul, trace, transpose

    lame, shear = 0.3 / (1.3 * 0.4), 0.5 / 1.3

    def stress(e):
        return 2 * shear * e + lame * identity(e) * trace(e)

    def strain(h):
        return 0.5 * (h + transpose(h) + mul(transpose(h), h))

    @skfem.BilinearForm
    def tangent(u, v, w):
        h = grad(w["state"])
        f = h + identity(h)
        du, dv = (0.5 * (mul(transpose(f), grad(x)) + mul(transpose(grad(x)), f)) for x in (u, v))
        return ddot(stress(du), dv) + ddot(mul(grad(u), stress(strain(h))), grad(v))

    @skfem.LinearForm
    def inner(v, w):
        h = grad(w["state"])
        return ddot(mul(h + identity(h), stress(strain(h))), grad(v))

    @skfem.Functional
    def energy(w):
        e = strain(grad(w["state"]))
        return 0.5 * ddot(stress(e), e)

    return tangent, inner, energy


def _interpolated(basis: Any, nodes: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Our displacements at the peer's nodes."""
    near = NearestNDInterpolator(nodes, nodes + start)
    u = basis.zeros()
    for i in range(3):
        own = basis.get_dofs(elements=True).all(f"u^{i + 1}")
        place = basis.doflocs[:, own].T
        smooth = LinearNDInterpolator(nodes, start)(place)
        u[own] = np.where(np.isnan(smooth), near(place) - place, smooth)[:, i]
    return u


def pair_motion(solid: Any, centres: np.ndarray, force: np.ndarray, poisson: float) -> np.ndarray:
    """The mean motion of the second hub of a flat pair of spirals under a small force, the first one held in the mean.

    By scikit-fem, with quadratic hexahedra between the nodes of a ``DesignSolid`` that stand round these centres.
    """
    import skfem
    from skfem.helpers import ddot, eye, sym_grad, trace

    hexes, hub = _cells(solid, centres)
    points, corners = np.unique(hexes.reshape(-1, 3).round(7), axis=0, return_inverse=True)
    mesh = skfem.MeshHex(points.T, corners.reshape(-1, 8).T)
    element = skfem.ElementVector(skfem.ElementHex2())
    basis = skfem.Basis(mesh, element, intorder=4)
    lame, shear = poisson / ((1 + poisson) * (1 - 2 * poisson)), 0.5 / (1 + poisson)

    @skfem.BilinearForm
    def stiffness(u, v, w):
        e = sym_grad(u)
        return ddot(2 * shear * e + lame * eye(trace(e), 3), sym_grad(v))

    def means(own: np.ndarray, centre: np.ndarray) -> np.ndarray:
        part = skfem.Basis(mesh, element, elements=np.flatnonzero(own), intorder=4)
        shifts = [skfem.LinearForm(lambda v, w, i=i: v[i]).assemble(part) for i in range(3)]
        r = [lambda w, i=i: w.x[i] - centre[i] for i in range(3)]
        turns = [
            skfem.LinearForm(lambda v, w, i=i, j=j: r[i](w) * v[j] - r[j](w) * v[i]).assemble(part)
            for i, j in ((1, 2), (2, 0), (0, 1))
        ]
        volume = skfem.Functional(lambda w: 1.0 + 0.0 * w.x[0]).assemble(part)
        return np.array([*shifts, *turns]) / volume

    held, pulled = means(hub == 0, centres[0]), means(hub == 1, centres[1])[:3]
    border = block_array([[stiffness.assemble(basis), csc_array(held.T)], [csc_array(held), None]]).tocsc()
    u = splu(border).solve(np.concatenate([force @ pulled, np.zeros(6)]))[: basis.N]
    return pulled @ u


def _cells(solid: Any, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the small hexahedra between the nodes of all elements, in scikit-fem's order, and whose hub they belong to."""
    n, out, hub = solid.mesh.numbering, [], []
    elements = np.concatenate([n.hub, n.arms.reshape(-1, 4, 16)]).reshape(-1, 4, 4, 4)
    for spiral, (nodes, centre) in enumerate(zip(solid.mesh.nodes, centres)):
        place = (nodes + centre)[elements]
        # MeshHex runs through x last of its eight corners
        at = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)]
        for i, j, k in np.ndindex(3, 3, 3):
            out.append(np.stack([place[:, i + a, j + b, k + c] for a, b, c in at], axis=1))
            own = np.arange(len(elements)) < len(n.hub)
            hub.append(np.where(own, spiral, -1))
    return np.concatenate(out), np.concatenate(hub)
