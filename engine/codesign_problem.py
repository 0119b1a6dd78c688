"""Inverse design in which the flat rest shape of the patches moves too, in the same terms as ``inverse``.

The coordinates are stacked: a row for every spiral as in ``DesignSpace``, then a row for every flat vertex, 1/2 where it
was, 0 and 1 at the ends of its range. So they are a box again and every optimiser takes them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, vstack

from .assembly import Assembly, Pose, rest_joints
from .codesign_geometry import geometry_by_points, gradient_by_geometry
from .elastic import summed
from .equilibrium import solve
from .flatten import FlatPatches
from .inverse import Point, Problem, _shifts
from .progress import SILENT, Progress


@dataclass(frozen=True, eq=False)
class FlatRange:
    """Where the flat vertices may go, and what it costs.

    flat : the patches as they were; reach : (P,) metres, range of every vertex along x and along y
    strain : (r, 2 P) per metre; half the square of its product with the displacements is the cost
    """

    flat: FlatPatches
    reach: np.ndarray
    strain: csr_array

    @classmethod
    def of(cls, flat: FlatPatches, limit: float, reach: float, stiffness: float, seam: float) -> FlatRange:
        """limit : largest distortion; reach : share of an edge; stiffness : weight of what quads are strained; seam : of what
        the sides of seams come to differ."""
        layout, corners = flat.layout, flat.corners
        length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).mean(axis=1)
        nearest = np.full(len(flat.points), np.inf)
        np.minimum.at(nearest, layout.flat_corners, length[:, None])
        # quads that are near to the limit already are held the tighter
        room = np.clip(1.0 - flat.energy / limit, 0.05, 1.0)
        strain = _quad_strains(flat, np.sqrt(stiffness / (len(room) * room)) / length)
        cut = int(layout.cut.sum())
        if cut:
            strain = vstack([strain, np.sqrt(seam / cut) * _seam_strains(flat)])
        return cls(flat, reach * nearest, strain.tocsr())

    def points(self, x: np.ndarray) -> np.ndarray:
        """(P, 2) metres of coordinates (P, 2)."""
        return self.flat.points + self.shift(x - 0.5)

    def shift(self, change: np.ndarray) -> np.ndarray:
        """(P, 2) metres that a change of the coordinates (P, 2) moves the vertices; its own transpose."""
        return 2.0 * self.reach[:, None] * change


def _quad_strains(flat: FlatPatches, weight: np.ndarray) -> csr_array:
    """(8 F, 2 P): how the sides of the quads change beyond a turn of the whole quad, times (F,)."""
    corners, count = flat.corners, len(flat.corners)
    sides = (np.roll(corners, -1, axis=1) - corners).reshape(count, 8)
    turned = np.stack([-sides[:, 1::2], sides[:, ::2]], axis=2).reshape(count, 8)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    differ = np.kron(np.roll(np.eye(4), 1, axis=1) - np.eye(4), np.eye(2))
    blocks = weight[:, None, None] * (differ - turned[:, :, None] * (turned @ differ)[:, None])
    columns = (2 * flat.layout.flat_corners[..., None] + np.arange(2)).reshape(count, 1, 8)
    rows = np.arange(8 * count).reshape(count, 8, 1)
    rows, columns = np.broadcast_arrays(rows, columns)
    shape = (8 * count, flat.points.size)
    return coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsr()


def _seam_strains(flat: FlatPatches) -> csr_array:
    """(C, 2 P): how the lengths of both sides of every cut edge come to differ, as a share of its length on the surface."""
    mesh, cut = flat.layout.mesh, np.flatnonzero(flat.layout.cut)
    quad, side = mesh.edge_quads[cut], mesh.edge_sides[cut]
    start, end = (flat.layout.flat_corners[quad, (side + i) % 4] for i in (0, 1))
    along = flat.points[end] - flat.points[start]
    along /= np.linalg.norm(along, axis=2, keepdims=True) * mesh.edge_lengths[cut][:, None, None]
    along[:, 1] *= -1.0
    rows, ends, starts, values = np.broadcast_arrays(
        np.arange(len(cut))[:, None, None],
        2 * end[..., None] + np.arange(2),
        2 * start[..., None] + np.arange(2),
        along,
    )
    entries = [np.concatenate([a.ravel(), b.ravel()]) for a, b in ((values, -values), (rows, rows), (ends, starts))]
    return coo_array((entries[0], (entries[1], entries[2])), shape=(len(cut), flat.points.size)).tocsr()


@dataclass(frozen=True, eq=False, kw_only=True)
class FlatProblem(Problem):
    """``Problem`` with the flat vertices as further unknowns, within ``flat``."""

    flat: FlatRange

    def at(
        self,
        x: np.ndarray,
        start: Pose,
        progress: Progress = SILENT,
        iterations: int | None = None,
        keep: Point | None = None,
    ) -> FlatPoint:
        """The point with stacked coordinates (n + P, 2); otherwise as ``Problem.at``."""
        n = self.assembly.size
        points = self.flat.points(x[n:])
        layout = self.flat.flat.layout
        lever, axes = rest_joints(layout.mesh, points[layout.flat_corners])
        assembly = replace(self.assembly, lever=lever, axes=axes).redesigned(*self.space.design(x[:n]))
        model, system = self.build(assembly), self.system(start, keep)
        found = solve(model, start, self.loads, self.simulate, progress, system, iterations)
        return FlatPoint(
            x=x,
            problem=self,
            model=model,
            equilibrium=found,
            mismatch=self.target.compare(found.pose.centres),
            system=system,
            assembly=assembly,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class FlatPoint(Point):
    """``Point`` with stacked coordinates."""

    problem: FlatProblem
    assembly: Assembly

    @cached_property
    def spirals(self) -> Point:
        """The same design with the spirals as its only unknowns."""
        x = self.x[: self.assembly.size]
        return Point(self.problem, x, self.model, self.equilibrium, self.mismatch, self.system)

    @cached_property
    def _cost(self) -> np.ndarray:
        """(r,) strains of the flat quads and seams, weighted."""
        return self._strained(self.x[self.assembly.size :] - 0.5)

    def _strained(self, change: np.ndarray) -> np.ndarray:
        flat = self.problem.flat
        return flat.strain @ flat.shift(change).ravel()

    def _strained_back(self, strains: np.ndarray) -> np.ndarray:
        flat = self.problem.flat
        return flat.shift((flat.strain.T @ strains).reshape(-1, 2))

    @cached_property
    def value(self) -> float:
        """The objective: mismatch, roughness of the spirals and strain of the flat shape by their weights."""
        return self.spirals.value + 0.5 * float((self._cost**2).sum())

    def rough(self, change: np.ndarray) -> np.ndarray:
        """(n + P, 2) product of the Hessian of roughness and strain with (n + P, 2)."""
        n = self.assembly.size
        strained = self._strained_back(self._strained(change[n:]))
        return np.concatenate([self.spirals.rough(change[:n]), strained])

    @cached_property
    def _by_geometry(self) -> tuple[np.ndarray, csr_array]:
        """(m, 12, 6) change of the joints' gradients with their rest geometry, and (6 m, 2 P) that with the flat vertices."""
        problem, n = self.problem, self.assembly.size
        by_geometry = gradient_by_geometry(self.assembly, problem.build, self.equilibrium.pose)
        map_ = geometry_by_points(problem.flat.flat.layout, problem.flat.points(self.x[n:]))
        return by_geometry.reshape(-1, 12, 6), map_

    def moves(self, change: np.ndarray) -> np.ndarray:
        """(n, 6) how the hubs move, to first order, when the coordinates change by (n + P, 2)."""
        n, pairs = self.assembly.size, self.assembly.pairs
        by_geometry, by_points = self._by_geometry
        geometry = (by_points @ self.problem.flat.shift(change[n:]).ravel()).reshape(-1, 6, 1)
        force = self.spirals._forces @ change[:n][pairs].reshape(-1, 4, 1) + by_geometry @ geometry
        return -self.system.solve(summed(force[..., 0], pairs, n))

    def adjoint(self, pull: np.ndarray) -> np.ndarray:
        """(n + P, 2) change with the coordinates of a quantity that changes with the hubs by (n, 6)."""
        pairs = self.assembly.pairs
        by_geometry, by_points = self._by_geometry
        answer = self.system.solve(pull)[pairs].reshape(-1, 1, 12)
        share = (answer @ self.spirals._forces)[:, 0].reshape(-1, 2, 2)
        out = np.zeros((self.assembly.size, 2))
        for k in (0, 1):
            out[:, k] = -np.bincount(pairs.ravel(), share[..., k].ravel(), len(out))
        points = by_points.T @ (answer @ by_geometry).ravel()
        return np.concatenate([out, -self.problem.flat.shift(points.reshape(-1, 2))])

    @cached_property
    def gradient(self) -> np.ndarray:
        """(n + P, 2) of the objective by the coordinates, by one adjoint solve."""
        n = self.assembly.size
        by_match = self.adjoint(_shifts(self.mismatch.gradient))
        return by_match + np.concatenate([self.spirals.rough(self.x[:n]), self._strained_back(self._cost)])
