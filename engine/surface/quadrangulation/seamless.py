"""A seamless map of a triangle mesh onto the plane in which the integer grid is a mesh of quads (Bommes et al. 2009).

The surface is cut open to a disk through the irregular points of the field of crosses, the crosses are turned so that they
fit together there, and u and v follow them as well as they can in the sense of least squares. Over every cut the map may
turn by quarters and shift by whole numbers, so that the grid goes on across it; irregular points, borders and sharp folds
lie on whole numbers.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...linalg import Pattern, SparseCholesky
from .field import CrossField

# (u + iv) turned by -q quarters: which coordinate each is taken from
TAKEN = ((0, 1), (1, 0), (0, 1), (1, 0))
# and the sign that it gets
SIGN = ((1, 1), (1, -1), (-1, -1), (-1, 1))
LOOSE = 1e-9  # of the matrix's diagonal: what holds a map that may be shifted as a whole


@dataclass(frozen=True, eq=False)
class Chart:
    """The mesh cut open, with one sense of u and v.

    turn : quarters by which the cross of every triangle is turned to give the direction of u
    jump : quarters by which the neighbour's u is turned against this triangle's, for every side; 0 at the border
    cut : sides where the map may jump
    wedge : for every corner of every triangle, the point of the cut mesh; corners that share one are alike in u and v
    """

    field: CrossField
    turn: Int[np.ndarray, " triangles"]
    jump: Int[np.ndarray, " sides"]
    cut: np.ndarray
    wedge: Int[np.ndarray, " corners"]

    @cached_property
    def angles(self) -> Float[np.ndarray, " triangles"]:
        """Radians of the direction of u from side 0 of every triangle."""
        return self.field.angles + 0.5 * np.pi * self.turn


def opened(field: CrossField) -> Chart:
    """Cut one connected mesh to a disk through all irregular points, and turn the crosses so that they fit together."""
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    mesh = field.mesh
    other, count = mesh.opposite, len(mesh.corners)
    lean = (field.angles[:, None] - np.angle(mesh.sides)).ravel()
    inner = other >= 0
    quarters = np.zeros(len(other), dtype=np.int64)  # by which the neighbour's cross is to be turned to fit this one
    quarters[inner] = -np.round((lean[other] - lean - field.turns)[inner] / (0.5 * np.pi)).astype(np.int64) - 2
    sides = np.flatnonzero(inner)
    dual = csr_array((np.ones(len(sides)), (sides // 3, other[sides] // 3)), shape=(count, count))
    order, before = breadth_first_order(dual, 0, directed=False)
    if len(order) < count:
        raise FlexMapsError("The surface is in several parts: give quads to each by itself")
    side_to = {(int(s) // 3, int(other[s]) // 3): int(s) for s in sides}
    turn, crossed = np.zeros(count, dtype=np.int64), np.zeros(len(other), dtype=bool)
    for f in order[1:]:
        s = side_to[int(before[f]), int(f)]
        turn[f] = turn[before[f]] + quarters[s]
        crossed[s] = crossed[other[s]] = True
    jump = np.zeros(len(other), dtype=np.int64)
    jump[sides] = (turn[other[sides] // 3] - turn[sides // 3] - quarters[sides]) % 4
    cut = _pruned(field, inner & ~crossed)
    if (jump[inner & ~cut] != 0).any():
        raise FlexMapsError("The field of crosses does not fit together")
    joined = np.flatnonzero(inner & ~cut)
    a = np.concatenate([joined, _after(joined)])
    b = np.concatenate([_after(other[joined]), other[joined]])
    wedge = connected_components(csr_array((np.ones(len(a)), (a, b)), shape=(3 * count, 3 * count)), directed=False)[1]
    return Chart(field, turn, jump, cut, wedge.astype(np.int64))


def _after(sides: np.ndarray) -> np.ndarray:
    """The next side of the same triangle; corners have the number of the side that begins at them."""
    return sides - sides % 3 + (sides + 1) % 3


def _pruned(field: CrossField, cut: np.ndarray) -> np.ndarray:
    """The cut without dead ends, but for those at irregular points."""
    mesh, irregular = field.mesh, field.indices != 0
    start, other = mesh.corners.ravel(), mesh.opposite
    rim = np.zeros(len(mesh.vertices), dtype=bool)
    rim[start[other < 0]] = True
    at: dict[int, set[int]] = {}
    for s in np.flatnonzero(cut):
        at.setdefault(int(start[s]), set()).add(int(s))  # every cut edge from both of its ends
    dead = deque(v for v, found in at.items() if len(found) == 1 and not rim[v] and not irregular[v])
    cut = cut.copy()
    while dead:
        v = dead.popleft()
        if len(at[v]) != 1:
            continue
        s = at[v].pop()
        o = int(other[s])
        cut[s] = cut[o] = False
        w = int(start[o])
        at[w].discard(o)
        if len(at[w]) == 1 and not rim[w] and not irregular[w]:
            dead.append(w)
    return cut


@dataclass(frozen=True, eq=False)
class Lattice:
    """All maps of a chart that fit together, as free numbers and whole numbers.

    Coordinate 2 w + c (u or v) of wedge w is ``free`` times free numbers plus ``whole`` times whole numbers.
    """

    free: csr_array
    whole: csr_array


def lattice(chart: Chart, lines: np.ndarray) -> Lattice:
    """What u and v may be.

    lines : (sides,) bool, borders and sharp folds, along which one coordinate is a whole number
    """
    field, mesh = chart.field, chart.field.mesh
    other, wedges = mesh.opposite, chart.wedge.max() + 1
    shift = _chains(chart)
    relations: list[tuple[int, int, int, int]] = []  # as ``_walked`` takes them
    for s in np.flatnonzero(shift >= 0):
        o, q = int(other[s]), int(chart.jump[s])
        for mine, theirs in ((s, int(_after(np.array(o)))), (int(_after(np.array(s))), o)):
            for c in (0, 1):
                b = 2 * chart.wedge[mine] + TAKEN[q][c]
                relations.append((int(2 * chart.wedge[theirs] + c), int(b), SIGN[q][c], 2 * int(shift[s]) + c))
    wholes: set[int] = set()
    for s in np.flatnonzero(lines):
        f = s // 3
        along = round((np.angle(mesh.sides.ravel()[s]) - chart.angles[f]) / (0.5 * np.pi)) % 2
        a, b = 2 * chart.wedge[[s, int(_after(np.array(s)))]] + 1 - along
        relations.append((int(a), int(b), 1, -1))
        wholes.add(int(a))
    irregular = np.flatnonzero(field.indices[mesh.corners.ravel()] != 0)
    rim = np.zeros(len(mesh.vertices), dtype=bool)
    rim[mesh.corners.ravel()[other < 0]] = True
    for w in np.unique(chart.wedge[irregular[~rim[mesh.corners.ravel()[irregular]]]]):
        wholes |= {int(2 * w), int(2 * w + 1)}
    shifts = 2 * (int(shift.max(initial=-1)) + 1)
    return _eliminated(2 * int(wedges), shifts, _walked(2 * int(wedges), relations, wholes, shifts))


def _chains(chart: Chart) -> np.ndarray:
    """(sides,) int: one number for the sides of the cut between two of its ends or branchings, which all lie on the same
    hand; -1 for their opposite sides and all others."""
    mesh, cut = chart.field.mesh, chart.cut
    start, other = mesh.corners.ravel(), mesh.opposite
    degree = np.bincount(start[cut], minlength=len(mesh.vertices)) + 2 * np.bincount(
        start[other < 0], minlength=len(mesh.vertices)
    )
    node = (degree != 2) | (chart.field.indices != 0)
    out: dict[int, list[int]] = {}
    for s in np.flatnonzero(cut):
        out.setdefault(int(start[s]), []).append(int(s))
    number, seen, count = np.full(len(other), -1), np.zeros(len(other), dtype=bool), 0
    for first in sorted(out, key=lambda v: not node[v]):
        for s in out[first]:
            begun = not seen[s]
            while not seen[s]:
                seen[s] = seen[other[s]] = True
                number[s] = count
                v, back = int(start[other[s]]), int(other[s])
                if node[v]:
                    break
                s = next(t for t in out[v] if t != back)
            count += begun
    return number


@dataclass(frozen=True, eq=False)
class _Walked:
    """Every coordinate as factor times that of its class's root, plus an offset in the shifts.

    whole : classes that lie on whole numbers, at their roots
    rows : what shifts and roots have to fulfil: sums of them, roots numbered after the shifts, that are zero
    """

    root: Int[np.ndarray, " coordinates"]
    factor: Int[np.ndarray, " coordinates"]
    offset: dict[int, dict[int, int]]
    whole: np.ndarray
    rows: list[dict[int, int]]


def _walked(size: int, relations: list[tuple[int, int, int, int]], wholes: set[int], shifts: int) -> _Walked:
    """Go round every class of coordinates that are related: x_a = sign x_b + shift t, where t is -1 for none."""
    near: dict[int, list[tuple[int, int, int, int]]] = {}
    for a, b, sign, t in relations:  # the other way round x_b = sign x_a - sign (shift t)
        near.setdefault(b, []).append((a, sign, t, 1))
        near.setdefault(a, []).append((b, sign, t, -sign))
    root, factor = np.arange(size), np.ones(size, dtype=np.int64)
    whole = np.zeros(size, dtype=bool)
    whole[list(wholes)] = True
    offset: dict[int, dict[int, int]] = {}
    rows: list[dict[int, int]] = []
    for first in near:
        if first in offset:
            continue
        offset[first] = {}
        todo = deque([first])
        while todo:
            x = todo.popleft()
            for y, sign, t, times in near[x]:
                there = {k: sign * n for k, n in offset[x].items()}
                if t >= 0:
                    there[t] = there.get(t, 0) + times
                if y not in offset:
                    root[y], factor[y], offset[y] = first, sign * factor[x], {k: n for k, n in there.items() if n}
                    whole[first] |= whole[y]
                    todo.append(y)
                    continue
                row = {k: there.get(k, 0) - offset[y].get(k, 0) for k in there.keys() | offset[y].keys()}
                if twice := int(sign * factor[x] - factor[y]):
                    row[shifts + first] = twice
                    whole[first] = True
                if any(row.values()):
                    rows.append({k: n for k, n in row.items() if n})
    return _Walked(root, factor, offset, whole[root], rows)


def _eliminated(size: int, shifts: int, walked: _Walked) -> Lattice:
    """The coordinates by free and whole numbers, after the whole ones that the rows determine are gone."""
    is_root = walked.root == np.arange(size)
    place = np.full(size, -1)
    whole, free = np.flatnonzero(is_root & walked.whole), np.flatnonzero(is_root & ~walked.whole)
    place[whole], place[free] = shifts + np.arange(len(whole)), np.arange(len(free))
    rows = [{k if k < shifts else int(place[k - shifts]): n for k, n in row.items()} for row in walked.rows]
    basis = _kernel(rows, shifts + len(whole))
    entries = [(x, k, n) for x, found in walked.offset.items() for k, n in found.items()]
    more = np.array(entries, dtype=np.int64).reshape(-1, 3)
    there = walked.whole
    numbers = coo_array(
        (
            np.r_[walked.factor[there], more[:, 2]].astype(float),
            (np.r_[np.flatnonzero(there), more[:, 0]], np.r_[place[walked.root[there]], more[:, 1]]),
        ),
        shape=(size, len(basis)),
    )
    at = np.flatnonzero(~there)
    factors = coo_array((walked.factor[at].astype(float), (at, place[walked.root[at]])), shape=(size, len(free)))
    return Lattice(factors.tocsr(), csr_array(numbers.tocsr() @ csr_array(basis.astype(float))))


def _kernel(rows: list[dict[int, int]], size: int) -> np.ndarray:
    """(size, k) int: a basis of all whole-number solutions of the rows, by Euclid's algorithm on columns."""
    basis = np.eye(size, dtype=np.int64, order="F")
    left = np.ones(size, dtype=bool)  # columns; the others are 0 and go in the end, for taking one out copies all
    unique = {tuple(sorted(row.items())) for row in rows}
    for row in sorted(unique, key=len):
        y = sum(n * basis[k] for k, n in row)
        while np.count_nonzero(y) > 1:
            p = int(np.where(y == 0, np.iinfo(np.int64).max, np.abs(y)).argmin())
            q = y // y[p]
            q[p] = 0
            changed = np.flatnonzero(q)
            basis[:, changed] -= np.outer(basis[:, p], q[changed])
            y = y - q * y[p]
            if np.abs(basis[:, changed]).max(initial=0) > 1 << 40:
                raise FlexMapsError("The cut is too tangled for whole numbers")
        if y.any():
            gone = int(np.flatnonzero(y)[0])
            left[gone], basis[:, gone] = False, 0
    return basis[:, left]


class Maps:
    """Maps of one chart at any size of the quads; what takes time is done once.

    The energy is the area integral of |grad u - d|^2 + |grad v - i d|^2 with the direction d of the crosses over the edge.
    """

    def __init__(self, chart: Chart, found: Lattice):
        mesh = chart.field.mesh
        count = len(mesh.corners)
        self.chart, self.lattice = chart, found
        # the gradient of the hat over a corner stands on the opposite side (Bommes et al. 2009, section 4)
        gradient = (1j * np.roll(mesh.sides, -1, axis=1) / (2 * mesh.areas[:, None])).ravel()
        row = 4 * np.repeat(np.arange(count), 3)
        gradients = coo_array(
            (
                np.concatenate([gradient.real, gradient.imag] * 2),
                (
                    np.concatenate([row, row + 1, row + 2, row + 3]),
                    np.concatenate([2 * chart.wedge] * 2 + [2 * chart.wedge + 1] * 2),
                ),
            ),
            shape=(4 * count, 2 * (int(chart.wedge.max()) + 1)),
        ).tocsr()
        self._free, self._whole = gradients @ found.free, gradients @ found.whole
        along = np.exp(1j * chart.angles)
        self._wished = np.stack([along.real, along.imag, -along.imag, along.real], axis=1).ravel()
        normal = (self._free.T @ self._free).tocoo()
        self._pattern = Pattern(normal.coords[0], normal.coords[1], normal.shape[0])
        self._factor = SparseCholesky(self._pattern)
        self.weigh(np.ones(count))

    def weigh(self, weights: Float[np.ndarray, " triangles"]) -> None:
        """Let triangles count more or less than by their area, which are ``weights`` of one."""
        self._weight = np.repeat(self.chart.field.mesh.areas * weights, 4)
        normal = (self._free.T @ (diags_array(self._weight) @ self._free)).tocoo()
        rows = self._pattern.size * normal.coords[1].astype(np.int64) + normal.coords[0]
        keys = self._pattern.size * self._pattern.columns + self._pattern.indices
        below = normal.coords[0] >= normal.coords[1]
        values = np.zeros(self._pattern.nnz)
        values[np.searchsorted(keys, rows[below])] = normal.data[below]
        values[self._pattern.columns == self._pattern.indices] *= 1 + LOOSE
        self._factor.factor(values)

    @cached_property
    def _schur(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrix and right side (for an edge of one metre) of the energy in the whole numbers, all else being best."""
        weighted = diags_array(self._weight) @ self._whole
        cross = (self._free.T @ weighted).toarray()
        solved = self._factor.solve(cross) if cross.size else cross
        right = weighted.T @ self._wished - solved.T @ (self._free.T @ (self._weight * self._wished))
        return (self._whole.T @ weighted).toarray() - cross.T @ solved, right

    def relaxed(self, edge: float) -> Float[np.ndarray, " whole"]:
        """The whole numbers as they would be if they need not be whole."""
        matrix, right = self.energy(edge)
        return np.linalg.solve(matrix, right)

    def energy(self, edge: float) -> tuple[Float[np.ndarray, "whole whole"], Float[np.ndarray, " whole"]]:
        """Matrix and right side of the energy in the whole numbers, all other numbers being best for them."""
        matrix, right = self._schur
        count = len(right)
        return matrix + np.eye(count) * (1e-9 * max(float(np.trace(matrix)) / max(count, 1), 1e-300)), right / edge

    def map(self, edge: float, whole: np.ndarray) -> Float[np.ndarray, "triangles 3 2"]:
        """u and v at every corner, in quads."""
        right = self._weight * (self._wished / edge - self._whole @ whole)
        both = self.lattice.free @ self._factor.solve(self._free.T @ right) + self.lattice.whole @ whole
        return both.reshape(-1, 2)[self.chart.wedge].reshape(-1, 3, 2)
