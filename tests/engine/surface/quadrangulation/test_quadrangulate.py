"""Quads along the curvature: known grids come back, nothing irregular where nothing has to be, and all stays on the surface."""

from __future__ import annotations

import itertools
import sys

import igl
import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface.checking.check import as_quad_mesh
from flexmaps.engine.surface.curvature import misalignment
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.surface.quadrangulation import separation
from flexmaps.engine.surface.quadrangulation.even import equalise_triangles
from flexmaps.engine.surface.quadrangulation.extraction import _has_same_topology, extract_quads
from flexmaps.engine.surface.quadrangulation.field import ALIGNMENT, Triangles
from flexmaps.engine.surface.quadrangulation.quadrangulate import quadrangulate
from flexmaps.engine.surface.quadrangulation.rounding import round_unknowns
from flexmaps.engine.surface.quadrangulation.seamless import _integer_kernel
from flexmaps.engine.surface.quadrangulation.separation import NO_CONSTRAINTS, MapConstraints

t = sys.modules["flexmaps_triangles"]

SHARP = np.pi / 4


def quads_of(mesh: Triangles, edge: float, fold: float = np.pi) -> QuadMesh:
    return as_quad_mesh(
        quadrangulate(PolygonMesh(mesh.vertices, mesh.corners.ravel(), np.full(len(mesh.corners), 3)), edge, fold)
    )


@pytest.mark.parametrize(
    ("make", "edge", "irregular"),
    [(t.torus, 0.4, 0), (t.barrel, 0.3, 0), (t.icosphere, 0.3, 8), (t.ellipsoid, 0.5, 8), (t.cube, 0.3, 8)],
)
def test_quads_of_known_shapes(make, edge, irregular):
    """The fewest irregular vertices that there can be, the surface's own kind, its place, and about the edge asked for."""
    mesh = make()
    quads = quads_of(mesh, edge, SHARP)
    assert int(quads.irregular.sum()) == irregular
    triangles = np.concatenate([quads.quads[:, [0, 1, 2]], quads.quads[:, [0, 2, 3]]])
    assert igl.euler_characteristic(triangles) == igl.euler_characteristic(mesh.corners)
    squared = igl.point_mesh_squared_distance(quads.vertices, mesh.vertices, mesh.corners)[0]
    assert np.sqrt(squared).max() < 0.01 * edge  # of flat triangles, which are simplified first where they are many
    assert len(quads.quads) == pytest.approx(mesh.areas.sum() / edge**2, rel=0.3)
    # seen from the same side as the triangles
    _, at, _ = igl.point_mesh_squared_distance(quads.centroids, mesh.vertices, mesh.corners)[:3]
    assert (np.einsum("ni,ni->n", quads.normals, mesh.frames[at, 2]) > 0.5).all()


def test_a_stronger_pull_brings_quads_nearer_to_the_curvature():
    """On z = x y over a square, the principal directions run along the diagonals, and the border wants the sides."""
    n = 24
    x, y = (g.ravel() / n - 0.5 for g in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    k = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack([k, k + n + 1, k + n + 2, k + 1], axis=1)
    corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    mesh = PolygonMesh(np.stack([x, y, x * y], axis=1), corners.ravel(), np.full(len(corners), 3))
    weak, strong = (
        misalignment(as_quad_mesh(quadrangulate(mesh, 0.06, np.pi, pull))) for pull in (ALIGNMENT, 16 * ALIGNMENT)
    )
    assert weak > 30.0, "along the border"
    assert strong < 20.0, "along the curvature"


def test_sharp_folds_and_rims_are_kept():
    box = quads_of(t.cube(), 0.3, SHARP)
    on = np.isclose(np.abs(box.vertices), 1.0, atol=1e-9).sum(axis=1)
    assert (on == 3).sum() == 8, "the corners"
    assert len(box.quads) % 6 == 0
    rims = quads_of(t.barrel(), 0.3)
    border = rims.vertices[np.unique(rims.edges[rims.border])]
    assert set(np.unique(np.round(border[:, 2], 9))) == {0.0, 3.0}


def plane(seed: int = 0) -> Triangles:
    """A rectangle of 4 by 3 in triangles of all shapes."""
    from scipy.spatial import Delaunay

    inside = np.random.default_rng(seed).uniform([0.05, 0.05], [3.95, 2.95], (60, 2))
    rim = (
        [(x, y) for x in range(5) for y in (0, 3)] + [(x, y) for x in (0, 4) for y in (1, 2)] + [(2.0, 0.7), (2.0, 1.9)]
    )
    points = np.concatenate([inside, rim])
    rows = Delaunay(points).simplices
    a, b, c = (points[rows[:, k]] for k in range(3))
    turned = np.linalg.det(np.stack([b - a, c - a], axis=1)) < 0
    rows[turned] = rows[turned][:, ::-1]
    flat = np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))) < 1e-9
    return Triangles(np.pad(points, ((0, 0), (0, 1))), rows[~flat].astype(np.int64))


def test_a_map_by_hand_gives_its_grid():
    """u and v are x and y: the grid's points are the whole numbers, whatever the triangles."""
    mesh = plane()
    uv = mesh.vertices[mesh.corners][..., :2]
    quads = extract_quads(mesh, np.zeros(3 * len(mesh.corners), dtype=np.int64), uv)
    assert len(quads.sizes) == 12
    found = {tuple(p) for p in np.round(quads.vertices, 4)}
    assert found == {(float(x), float(y), 0.0) for x in range(5) for y in range(4)}


def test_a_map_smaller_than_a_quad_is_refused():
    """One triangle whose map lies within a cell and is turned over: nothing of it is a quad."""
    mesh = Triangles(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    uv = np.array([[[0.1, 0.1], [0.1, 0.4], [0.4, 0.1]]])
    with pytest.raises(FlexMapsError):
        extract_quads(mesh, np.zeros(3, int), uv)


def test_the_grid_goes_on_over_turns_and_shifts():
    """Every triangle with a u and v of its own, turned by quarters and shifted by whole numbers: the same grid."""
    mesh = plane(1)
    random = np.random.default_rng(2)
    turn, shift = random.integers(0, 4, len(mesh.corners)), random.integers(-5, 6, (len(mesh.corners), 2))
    z = (mesh.vertices[mesh.corners][..., 0] + 1j * mesh.vertices[mesh.corners][..., 1]) * (1j ** (-turn))[:, None]
    uv = np.stack([z.real, z.imag], axis=2) + shift[:, None]
    jump = np.zeros(3 * len(mesh.corners), dtype=np.int64)
    inner = np.flatnonzero(mesh.opposite >= 0)
    jump[inner] = (turn[mesh.opposite[inner] // 3] - turn[inner // 3]) % 4
    quads = extract_quads(mesh, jump, uv)
    assert len(quads.sizes) == 12 and len(quads.vertices) == 20
    jump[inner[0]] += 1
    with pytest.raises(FlexMapsError):
        extract_quads(mesh, jump, uv)


def test_whole_number_solutions_are_all_found():
    random = np.random.default_rng(3)
    for _ in range(20):
        rows = random.integers(-2, 3, (2, 5))
        basis = _integer_kernel([{k: int(n) for k, n in enumerate(row) if n} for row in rows], 5)
        assert not (rows @ basis).any()
        every = np.array(list(itertools.product(range(-2, 3), repeat=5))).T
        solutions = every[:, ~(rows @ every).any(axis=0)]
        weights = np.linalg.lstsq(basis, solutions, rcond=None)[0]
        np.testing.assert_allclose(basis @ weights, solutions, atol=1e-9)
        np.testing.assert_allclose(weights, np.round(weights), atol=1e-9)


def test_even_triangles_keep_the_surface():
    mesh = t.ellipsoid()
    fine = equalise_triangles(mesh, 0.15, np.pi)
    assert np.abs(fine.side_vectors).max() <= 0.15
    assert fine.areas.sum() == pytest.approx(mesh.areas.sum(), rel=1e-9)
    assert igl.euler_characteristic(fine.corners) == 2


def test_surfaces_without_sides_are_refused():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]])
    three = PolygonMesh(points, np.array([0, 1, 2, 0, 1, 3, 0, 1, 4]), np.full(3, 3))
    with pytest.raises(FlexMapsError):
        quadrangulate(three, 0.3)


def test_needles_are_refused_or_become_quads():
    """Triangles whose points lie nearly on a line make systems that no solver takes."""
    mesh = t.barrel()
    thin = mesh.vertices * [1.0, 1.0, 1e-9]
    try:
        quads = quadrangulate(PolygonMesh(thin, mesh.corners.ravel(), np.full(len(mesh.corners), 3)), 0.3)
        assert (quads.sizes == 4).all()
    except FlexMapsError:
        pass


def quadratic(seed: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """An energy with its least anywhere: half x A x - b x."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(size, size))
    matrix = root @ root.T + np.eye(size)
    return matrix, matrix @ random.uniform(-2, 2, size)


def energy(matrix: np.ndarray, right: np.ndarray, x: np.ndarray) -> float:
    return float(0.5 * x @ matrix @ x - right @ x)


@pytest.mark.parametrize("seed", range(10))
def test_rounding_is_near_the_best_whole_numbers(seed):
    """Against all of a box of whole numbers: among the best few of 7^4, and no step of one is better."""
    matrix, right = quadratic(seed, 4)
    got = round_unknowns(matrix, right, NO_CONSTRAINTS)
    every = np.array(list(itertools.product(range(-3, 4), repeat=4)))
    all_of_them = 0.5 * np.einsum("ni,ij,nj->n", every, matrix, every) - every @ right
    assert (all_of_them < energy(matrix, right, got) - 1e-9).sum() < 10
    for k in range(4):
        for step in (-1, 1):
            moved = got + step * np.eye(4, dtype=int)[k]
            assert energy(matrix, right, moved) >= energy(matrix, right, got) - 1e-9


@pytest.mark.parametrize("seed", range(10))
def test_rounding_keeps_pairs_apart(seed):
    """Numbers in a chain whose best values are a quarter apart: each stays at least one above the one before."""
    size = 6
    matrix = np.eye(size) + 0.1 * np.ones((size, size))
    right = matrix @ (np.random.default_rng(seed).uniform(-1, 1) + 0.25 * np.arange(size))
    chain = MapConstraints(np.diff(np.eye(size), axis=0), np.ones(size - 1))
    assert not chain.are_satisfied(round_unknowns(matrix, right, NO_CONSTRAINTS))
    got = round_unknowns(matrix, right, chain)
    assert chain.are_satisfied(got)
    np.testing.assert_array_equal(np.diff(got), 1)


def test_what_cannot_be_kept_apart_is_left():
    impossible = MapConstraints(np.array([[1.0], [-1.0]]), np.ones(2))
    assert round_unknowns(np.eye(1), np.zeros(1), impossible) == 0


def test_sharp_points_near_each_other_stay_apart():
    """A slab less than half a quad thick: its two rims of corners do not fall onto one another."""
    box = t.cube()
    thin = Triangles(box.vertices * [1.0, 1.0, 0.08], box.corners)
    quads = quads_of(thin, 0.4, SHARP)
    on = np.isclose(np.abs(quads.vertices), [1.0, 1.0, 0.08], atol=1e-9).sum(axis=1)
    assert (on == 3).sum() == 8
    triangles = np.concatenate([quads.quads[:, [0, 1, 2]], quads.quads[:, [0, 2, 3]]])
    assert igl.euler_characteristic(triangles) == 2


def test_a_map_of_too_many_pairs_is_refused_before_they_are_all_found(monkeypatch):
    box = t.cube()
    thin = Triangles(box.vertices * [1.0, 1.0, 0.08], box.corners)
    looked = []
    look = separation._NeighbourWalk.add_constraints_near
    monkeypatch.setattr(
        separation._NeighbourWalk, "add_constraints_near", lambda *args: looked.append(args[1]) or look(*args)
    )
    quads_of(thin, 0.4, SHARP)
    all_of_them = len(looked)
    monkeypatch.setattr(separation, "MAX_PAIRS", 0)
    with pytest.raises(FlexMapsError, match="too many sharp folds"):
        quads_of(thin, 0.4, SHARP)
    assert 0 < len(looked) - all_of_them < all_of_them


def test_short_folds_are_noise():
    """One point pushed out of a plane makes a few sharp edges; the cube's own edges are long."""
    mesh = plane()
    points = mesh.vertices.copy()
    inner = np.flatnonzero((np.abs(points[:, :2] - [2.0, 1.5]) < 0.6).all(axis=1))[0]
    points[inner, 2] = 1.0
    bumped = Triangles(points, mesh.corners)
    border = bumped.opposite < 0
    assert bumped.feature_sides(SHARP)[~border].any()
    np.testing.assert_array_equal(bumped.long_feature_sides(SHARP, 20.0), border)
    box = t.cube()
    np.testing.assert_array_equal(box.long_feature_sides(SHARP, 20.0), box.feature_sides(SHARP))
    assert box.feature_sides(SHARP).any() and not box.long_feature_sides(SHARP, 24.1).any()  # twelve edges of two


def test_torn_quads_are_told_from_sound_ones():
    """A grid is like the rectangle; with a hole, a corner joined to another one, or a quad turned round it is not."""
    mesh = plane()
    uv = mesh.vertices[mesh.corners][..., :2]
    rows = extract_quads(mesh, np.zeros(3 * len(mesh.corners), dtype=np.int64), uv).corners.reshape(-1, 4)
    assert _has_same_topology(mesh, rows)
    use = np.bincount(rows.ravel())
    corners = np.flatnonzero(use == 1)
    inner = np.flatnonzero((use[rows] == 4).all(axis=1))
    assert not _has_same_topology(mesh, np.delete(rows, inner[0], axis=0))
    assert not _has_same_topology(mesh, np.where(rows == corners[0], corners[-1], rows))
    turned = rows.copy()
    turned[0] = turned[0, ::-1]
    assert not _has_same_topology(mesh, turned)
