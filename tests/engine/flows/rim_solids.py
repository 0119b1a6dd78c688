"""A strip of a rim with its hole, as a solid in scikit-fem and as the beams of the elastic model."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import scipy.sparse as sp
from flexmaps.engine.materials import Material
from flexmaps.engine.mechanics.arms.rim_beams import _beams
from flexmaps.engine.mechanics.rim_bodies import RimBeams
from scipy.sparse.linalg import splu

PIECES = 400  # of the beams, so many that their number counts for nothing
# elements of the solid: on a quarter of the hole, from there outwards, through the sheet
ROUND, RINGS, LAYERS = 6, 4, 1
ALONG = 4  # on each side of the square round the hole


def solid_compliance(length: float, width: float, hole: float, height: float, material: Material) -> np.ndarray:
    """(6, 6) SI: shift and turn of a strip's far end, kept plane, per wrench there; its near end is held. The hole is in its middle.

    Axes along the strip, across it in the sheet, normal to the sheet.
    """
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    points, quads = _plane(length, width, hole)
    levels = np.linspace(-0.5 * height, 0.5 * height, LAYERS + 1)
    count = len(points)
    nodes = np.concatenate([np.column_stack([points, np.full(count, z)]) for z in levels])
    below = np.concatenate([quads + k * count for k in range(LAYERS)])
    above = below + count
    # scikit-fem's order of the corners: x, y and z of each are 000, 100, 010, 001, 110, 101, 011, 111
    a, b, c, d = below.T
    e, f, g, h = above.T
    mesh = skfem.MeshHex(nodes.T, np.array([a, b, d, e, c, f, h, g]))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex2()), intorder=4)
    stiffness = linear_elasticity(*lame_parameters(material.youngs, material.poisson)).assemble(basis)
    place = basis.doflocs
    axis = np.zeros(basis.N, dtype=int)
    for i in range(3):
        axis[basis.get_dofs(elements=True).all(f"u^{i + 1}")] = i
    held, far = place[0] < 1e-9, place[0] > length - 1e-9
    free = ~(held | far)
    # a rigid end: its unknowns depend on the six of its centre
    arm = place[:, far] - np.array([length, 0.0, 0.0])[:, None]
    rigid = np.zeros((far.sum(), 6))
    for row, (i, r) in enumerate(zip(axis[far], arm.T, strict=True)):
        rigid[row, i] = 1.0
        rigid[row, 3:] = np.cross(np.eye(3), r)[:, i]
    rows = np.flatnonzero(free)
    spread = sp.csr_matrix((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(basis.N, len(rows)))
    tied = sp.lil_matrix((basis.N, 6))
    tied[np.flatnonzero(far)] = rigid
    every = sp.hstack([spread, tied.tocsr()]).tocsc()
    side = np.zeros((every.shape[1], 6))
    side[-6:] = np.eye(6)
    return splu((every.T @ stiffness @ every).tocsc()).solve(side)[-6:]


def _plane(length: float, width: float, hole: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 2) and quads (Q, 4): rings round the hole out to a square as wide as the strip, and rectangles on both sides of it."""
    half, middle = 0.5 * width, np.array([0.5 * length, 0.0])
    s = np.linspace(-1.0, 1.0, ROUND + 1)
    sides = [
        np.column_stack([np.ones_like(s), s]) @ np.array([[c, q], [-q, c]])
        for c, q in ((1, 0), (0, 1), (-1, 0), (0, -1))
    ]
    blocks = []
    if hole > 0.0:
        for square in sides:
            angle = np.arctan2(*(square[ROUND // 2][::-1])) + 0.25 * np.pi * s
            circle = 0.5 * hole * np.column_stack([np.cos(angle), np.sin(angle)])
            t = np.linspace(0.0, 1.0, RINGS + 1)[:, None, None] ** 1.5
            blocks.append(middle + circle * (1.0 - t) + half * square * t)
    else:
        x = half * s
        blocks.append(middle + np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1))
    y = half * s
    for begin, end in ((0.0, middle[0] - half), (middle[0] + half, length)):
        x = np.linspace(begin, end, ALONG + 1)
        blocks.append(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
    points, quads, first = [], [], 0
    for block in blocks:
        n, m = block.shape[:2]
        number = first + np.arange(n * m).reshape(n, m)
        quads.append(
            np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
        )
        points.append(block.reshape(-1, 2))
        first += n * m
    every, number = np.unique(np.concatenate(points).round(9), axis=0, return_inverse=True)
    return every, number.ravel()[np.concatenate(quads)]


class _Sheet:
    """The part of an assembly that ``_beams`` uses."""

    grain = 0.0

    def __init__(self, thickness: float, left: float):
        self.thickness, self.rim = thickness, SimpleNamespace(width=left)


def beam_compliance(length: float, width: float, hole: float, height: float, material: Material) -> np.ndarray:
    """(6, 6) SI: the same of the beams."""
    at = length * (np.arange(PIECES) + 0.5) / PIECES
    bore = 2.0 * np.sqrt(np.maximum(0.25 * hole**2 - (at - 0.5 * length) ** 2, 0.0))
    line = RimBeams.from_points(
        at[None] + 0j, np.ones((1, PIECES), complex), np.array([length + 0j]), np.full((1, PIECES), length / PIECES),
        np.full(1, width), bore[None],
    )  # fmt: skip
    return _beams(_Sheet(height, width - hole), line, material)[0]  # type: ignore[arg-type]
