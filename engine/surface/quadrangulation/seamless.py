"""Seamless map of a triangle mesh onto the plane, whose integer grid gives a quad mesh (Bommes et al. 2009).

The surface is cut open to a disk through the irregular points of the cross field. On the disk, quarter turns make the
crosses consistent, and the gradients of u and v follow them in the least-squares sense. Across a cut the map may turn
by quarter turns and shift by integers, so that the grid continues; irregular points, borders and sharp folds lie on
integers.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from ...arrays import Float, Int
from ...components import components
from ...errors import FlexMapsError
from ...linalg import SparseCholesky, SparsityPattern
from .field import CrossField

# After a rotation by -q quarter turns, coordinate c of (u, v) is ROTATED_SIGN[q][c] times the former coordinate
# ROTATED_AXIS[q][c]
ROTATED_AXIS, ROTATED_SIGN = ((0, 1), (1, 0), (0, 1), (1, 0)), ((1, 1), (1, -1), (-1, -1), (-1, 1))
# Share of the diagonal that is added to the energy's matrix, which is singular if the whole map may shift. Larger: less
# exact maps; smaller: the matrix may not be positive definite.
DIAGONAL_SHIFT = 1e-9


@dataclass(frozen=True, eq=False)
class Chart:
    """The mesh cut open to a disk, with consistent directions of u and v.

    quarter_turns : quarter turns from the cross of every triangle to the direction of u
    period_jumps : for every side, quarter turns from the direction of u in its triangle to that in the neighbouring
        triangle; 0 at the border
    cut : mask of the sides on the cut, across which the map may jump
    wedge : vertex of the cut mesh, for every corner of every triangle
    """

    field: CrossField
    quarter_turns: Int[np.ndarray, " triangles"]
    period_jumps: Int[np.ndarray, " sides"]
    cut: np.ndarray
    wedge: Int[np.ndarray, " corners"]

    @cached_property
    def angles(self) -> Float[np.ndarray, " triangles"]:
        """Angle from side 0 of every triangle to the direction of u, radians."""
        return self.field.angles + 0.5 * np.pi * self.quarter_turns


def cut_to_disk(field: CrossField) -> Chart:
    """Cut a connected mesh open to a disk, through all irregular points, and choose consistent directions of u."""
    from scipy.sparse.csgraph import breadth_first_order

    mesh = field.mesh
    other, count = mesh.opposite, len(mesh.corners)
    lean = (field.angles[:, None] - np.angle(mesh.side_vectors)).ravel()
    inner = other >= 0
    quarters = np.zeros(len(other), dtype=np.int64)  # by side: quarter turns after which the neighbour's cross matches
    quarters[inner] = -np.round((lean[other] - lean - field.side_rotations)[inner] / (0.5 * np.pi)).astype(np.int64) - 2
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
    cut = _prune_dead_ends(field, inner & ~crossed)
    if (jump[inner & ~cut] != 0).any():
        raise FlexMapsError("The field of crosses does not fit together")
    joined = np.flatnonzero(inner & ~cut)
    a = np.concatenate([joined, _next_side(joined)])
    b = np.concatenate([_next_side(other[joined]), other[joined]])
    wedge = components(3 * count, a, b)
    return Chart(field, turn, jump, cut, wedge.astype(np.int64))


def _next_side(sides: np.ndarray) -> np.ndarray:
    """Return the next side of the same triangle; a corner has the number of the side that begins at it."""
    return sides - sides % 3 + (sides + 1) % 3


def _prune_dead_ends(field: CrossField, cut: np.ndarray) -> np.ndarray:
    """Return the cut (a mask of sides) without its dead ends, except dead ends at irregular points or at the border."""
    mesh, irregular = field.mesh, field.indices != 0
    start, other = mesh.corners.ravel(), mesh.opposite
    rim = np.zeros(len(mesh.vertices), dtype=bool)
    rim[start[other < 0]] = True
    at: dict[int, set[int]] = {}
    for s in np.flatnonzero(cut):
        at.setdefault(int(start[s]), set()).add(int(s))  # every cut edge appears at both of its ends
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
class MapParametrisation:
    """All seamless maps of a chart, parametrised by real unknowns and integer unknowns.

    The coordinates of the map are ``real_factors`` times the real unknowns plus ``integer_factors`` times the integer
    unknowns. Row 2 w + c belongs to coordinate c (0 for u, 1 for v) of vertex w of the cut mesh.
    """

    real_factors: csr_array
    integer_factors: csr_array


def parametrise_maps(chart: Chart, lines: np.ndarray) -> MapParametrisation:
    """Parametrise the seamless maps of a chart.

    Parameters
    ----------
    chart : mesh, cut open
    lines : (sides,) mask of borders and sharp folds; along each of these lines one of u and v is a constant integer
    """
    field, mesh = chart.field, chart.field.mesh
    other, wedges = mesh.opposite, chart.wedge.max() + 1
    shift = _chains(chart)
    relations: list[tuple[int, int, int, int]] = []  # (a, b, sign, shift), see ``_classify_coordinates``
    for s in np.flatnonzero(shift >= 0):
        o, q = int(other[s]), int(chart.period_jumps[s])
        for mine, theirs in ((s, int(_next_side(np.array(o)))), (int(_next_side(np.array(s))), o)):
            for c in (0, 1):
                b = 2 * chart.wedge[mine] + ROTATED_AXIS[q][c]
                relations.append((int(2 * chart.wedge[theirs] + c), int(b), ROTATED_SIGN[q][c], 2 * int(shift[s]) + c))
    wholes: set[int] = set()
    for s in np.flatnonzero(lines):
        f = s // 3
        along = round((np.angle(mesh.side_vectors.ravel()[s]) - chart.angles[f]) / (0.5 * np.pi)) % 2
        a, b = 2 * chart.wedge[[s, int(_next_side(np.array(s)))]] + 1 - along
        relations.append((int(a), int(b), 1, -1))
        wholes.add(int(a))
    irregular = np.flatnonzero(field.indices[mesh.corners.ravel()] != 0)
    rim = np.zeros(len(mesh.vertices), dtype=bool)
    rim[mesh.corners.ravel()[other < 0]] = True
    for w in np.unique(chart.wedge[irregular[~rim[mesh.corners.ravel()[irregular]]]]):
        wholes |= {int(2 * w), int(2 * w + 1)}
    shifts = 2 * (int(shift.max(initial=-1)) + 1)
    return _eliminate_dependent(
        2 * int(wedges), shifts, _classify_coordinates(2 * int(wedges), relations, wholes, shifts)
    )


def _chains(chart: Chart) -> np.ndarray:
    """Number the chains of the cut: a chain is a part between ends, branch points and irregular points.

    Returns
    -------
    (sides,) chain of every cut side on one flank of the cut; -1 for sides on the other flank and sides not on the cut
    """
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
class _CoordinateClasses:
    """Classes of coordinates that determine each other.

    Coordinate 2 w + c is u (c = 0) or v (c = 1) of vertex w of the cut mesh. It is its factor times the coordinate
    ``root`` of its class, plus its offset, a sum of shifts. A shift is an unknown integer by which the map jumps across
    a chain of the cut.

    root, factor, offset : of each coordinate; its offset is a dictionary from shifts to their factors
    is_integer : mask of coordinates whose class lies on integers
    rows : equations: sums that must be zero, as dictionaries from unknowns to their factors; unknown k is shift k, or
        root k - n where n is the number of shifts
    """

    root: Int[np.ndarray, " coordinates"]
    factor: Int[np.ndarray, " coordinates"]
    offset: dict[int, dict[int, int]]
    is_integer: np.ndarray
    rows: list[dict[int, int]]


def _classify_coordinates(
    size: int, relations: list[tuple[int, int, int, int]], wholes: set[int], shifts: int
) -> _CoordinateClasses:
    """Find the classes of related coordinates, breadth first.

    Parameters
    ----------
    size : number of coordinates
    relations : (a, b, sign, t) for the equation x_a = sign x_b + (shift t) between coordinates; t = -1 for no shift
    wholes : coordinates that must be integers
    shifts : number of shifts
    """
    near: dict[int, list[tuple[int, int, int, int]]] = {}
    for a, b, sign, t in relations:  # reversed: x_b = sign x_a - sign (shift t)
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
    return _CoordinateClasses(root, factor, offset, whole[root], rows)


def _eliminate_dependent(size: int, shifts: int, classes: _CoordinateClasses) -> MapParametrisation:
    """Express the coordinates by real unknowns and independent integers, after elimination of dependent integers.

    Parameters
    ----------
    size, shifts : number of coordinates, number of shifts
    classes : classes of coordinates, with the equations (``rows``) that the integers must satisfy
    """
    is_root = classes.root == np.arange(size)
    place = np.full(size, -1)
    whole, free = np.flatnonzero(is_root & classes.is_integer), np.flatnonzero(is_root & ~classes.is_integer)
    place[whole], place[free] = shifts + np.arange(len(whole)), np.arange(len(free))
    rows = [{k if k < shifts else int(place[k - shifts]): n for k, n in row.items()} for row in classes.rows]
    basis = _integer_kernel(rows, shifts + len(whole))
    entries = [(x, k, n) for x, found in classes.offset.items() for k, n in found.items()]
    more = np.array(entries, dtype=np.int64).reshape(-1, 3)
    there = classes.is_integer
    numbers = coo_array(
        (
            np.r_[classes.factor[there], more[:, 2]].astype(float),
            (np.r_[np.flatnonzero(there), more[:, 0]], np.r_[place[classes.root[there]], more[:, 1]]),
        ),
        shape=(size, len(basis)),
    )
    at = np.flatnonzero(~there)
    factors = coo_array((classes.factor[at].astype(float), (at, place[classes.root[at]])), shape=(size, len(free)))
    return MapParametrisation(factors.tocsr(), csr_array(numbers.tocsr() @ csr_array(basis.astype(float))))


def _integer_kernel(rows: list[dict[int, int]], size: int) -> np.ndarray:
    """Return a basis (size, k) of all integer solutions of the equations ``rows``, by Euclid's algorithm on columns."""
    basis = np.eye(size, dtype=np.int64, order="F")
    # mask of columns in use; unused columns are removed together at the end, because each removal copies the matrix
    left = np.ones(size, dtype=bool)
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


class SeamlessMaps:
    """Least-squares maps of a chart for any quad size; the expensive parts are computed once.

    The energy is the area integral of |grad u - d|^2 + |grad v - i d|^2; d is the cross field's direction of u, a complex
    number of length 1 / (quad edge).
    """

    def __init__(self, chart: Chart, found: MapParametrisation):
        mesh = chart.field.mesh
        count = len(mesh.corners)
        self.chart, self.parametrisation = chart, found
        # the gradient of a corner's hat function is perpendicular to the opposite side (Bommes et al. 2009, section 4)
        gradient = (1j * np.roll(mesh.side_vectors, -1, axis=1) / (2 * mesh.areas[:, None])).ravel()
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
        self._real_gradients, self._integer_gradients = (
            gradients @ found.real_factors,
            gradients @ found.integer_factors,
        )
        along = np.exp(1j * chart.angles)
        self._target_gradients = np.stack([along.real, along.imag, -along.imag, along.real], axis=1).ravel()
        normal = (self._real_gradients.T @ self._real_gradients).tocoo()
        self._pattern = SparsityPattern(normal.coords[0], normal.coords[1], normal.shape[0])
        self._factor = SparseCholesky(self._pattern)
        self.set_weights(np.ones(count))

    def set_weights(self, weights: Float[np.ndarray, " triangles"]) -> None:
        """Weight every triangle in the energy by its area times ``weights``."""
        self._weight = np.repeat(self.chart.field.mesh.areas * weights, 4)
        normal = (self._real_gradients.T @ (diags_array(self._weight) @ self._real_gradients)).tocoo()
        rows = self._pattern.size * normal.coords[1].astype(np.int64) + normal.coords[0]
        keys = self._pattern.size * self._pattern.columns + self._pattern.indices
        below = normal.coords[0] >= normal.coords[1]
        values = np.zeros(self._pattern.nnz)
        values[np.searchsorted(keys, rows[below])] = normal.data[below]
        values[self._pattern.columns == self._pattern.indices] *= 1 + DIAGONAL_SHIFT
        self._factor.factor(values)

    @cached_property
    def _schur(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrix M and right side r of the energy 1/2 x^T M x - r^T x of the integers x, for a quad edge of 1 m.

        The real unknowns take their optimal values (Schur complement).
        """
        weighted = diags_array(self._weight) @ self._integer_gradients
        cross = (self._real_gradients.T @ weighted).toarray()
        solved = self._factor.solve(cross) if cross.size else cross
        right = weighted.T @ self._target_gradients - solved.T @ (
            self._real_gradients.T @ (self._weight * self._target_gradients)
        )
        return (self._integer_gradients.T @ weighted).toarray() - cross.T @ solved, right

    def real_optimum(self, edge: float) -> Float[np.ndarray, " whole"]:
        """Return the values of the integer unknowns that minimise the energy if they may be real; ``edge`` in metres."""
        matrix, right = self.energy(edge)
        return np.linalg.solve(matrix, right)

    def energy(self, edge: float) -> tuple[Float[np.ndarray, "whole whole"], Float[np.ndarray, " whole"]]:
        """Return M and r of the energy 1/2 x^T M x - r^T x of the integers x, with the real unknowns at their optimum.

        edge : quad edge, metres
        """
        matrix, right = self._schur
        count = len(right)
        return matrix + np.eye(count) * (1e-9 * max(float(np.trace(matrix)) / max(count, 1), 1e-300)), right / edge

    def uv_coordinates(self, edge: float, whole: np.ndarray) -> Float[np.ndarray, "triangles 3 2"]:
        """Return u and v at every triangle's corners, in quads, for the integers ``whole`` and a quad edge in metres."""
        right = self._weight * (self._target_gradients / edge - self._integer_gradients @ whole)
        both = (
            self.parametrisation.real_factors @ self._factor.solve(self._real_gradients.T @ right)
            + self.parametrisation.integer_factors @ whole
        )
        return both.reshape(-1, 2)[self.chart.wedge].reshape(-1, 3, 2)
