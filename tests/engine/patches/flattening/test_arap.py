"""Flattening one patch: energies against singular values, maps against closed forms and libigl."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.patches.flattening.arap import PatchProblem, minimise_max_energy, solve_local_global
from flexmaps.engine.patches.flattening.triangles import corner_triangles, quad_energy, square_energy
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh


def whole(mesh: QuadMesh) -> PatchProblem:
    """A mesh without any cut as one patch."""
    layout = PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool))
    return PatchProblem(mesh, np.arange(len(mesh.quads)), layout.flat_corners)


def singular_values(surface: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Of the linear map from a triangle (3, 3) in space to one (3, 2) in the plane."""
    e1, e2 = surface[1] - surface[0], surface[2] - surface[0]
    x = e1 / np.linalg.norm(e1)
    y = e2 - (e2 @ x) * x
    y /= np.linalg.norm(y)
    source = np.array([[e1 @ x, e2 @ x], [e1 @ y, e2 @ y]])
    target = np.stack([plane[1] - plane[0], plane[2] - plane[0]], axis=1)
    return np.linalg.svd(target @ np.linalg.inv(source), compute_uv=False)


def test_energy_is_the_one_of_the_singular_values() -> None:
    rng = np.random.default_rng(3)
    mesh = shapes.make("saddle")
    mesh = mesh.with_vertices(mesh.vertices + 0.002 * rng.normal(size=mesh.vertices.shape))
    problem = whole(mesh)
    points = mesh.vertices[:, 0] + 1j * mesh.vertices[:, 1]
    points = points + 0.002 * (rng.normal(size=len(points)) + 1j * rng.normal(size=len(points)))
    flat_of = np.empty(len(points), dtype=complex)
    flat_of[problem.corners] = points[mesh.quads]
    energy = problem.flat_patch(flat_of).energy
    for quad in (0, 57, 131):
        total = weight = 0.0
        for k in range(4):
            corners = mesh.quads[quad][[k, (k + 1) % 4, (k + 3) % 4]]
            p, u = mesh.vertices[corners], points[corners]
            area = 0.5 * np.linalg.norm(np.cross(p[1] - p[0], p[2] - p[0]))
            s = singular_values(p, np.stack([u.real, u.imag], axis=1))
            total += area * ((s - 1) ** 2).sum()
            weight += area
        # singular values have no sign: only triangles that are not turned over compare
        assert energy[quad] == pytest.approx(total / weight, rel=1e-9)


def test_energy_is_blind_to_rigid_motions_and_sees_scale() -> None:
    mesh = shapes.make("quad")
    tri = corner_triangles(mesh)
    problem = whole(mesh)
    turned = solve_local_global(problem).points * np.exp(0.7j) + 3
    assert problem.flat_patch(turned).energy.max() < 1e-20
    a, b = problem.map_coefficients(turned * 1.1)
    assert quad_energy(tri, np.abs(a), np.abs(b)) == pytest.approx(2 * 0.1**2)


def test_square_energy_of_squares_and_rectangles() -> None:
    square = np.array([[0, 1, 1 + 1j, 1j]]) * 0.3 * np.exp(0.4j) + 5
    assert square_energy(square)[0] == pytest.approx(0, abs=1e-15)
    stretch = 1.2
    rectangle = np.array([[0, stretch, stretch + 1j / stretch, 1j / stretch]])
    assert square_energy(rectangle)[0] == pytest.approx((stretch - 1) ** 2 + (1 / stretch - 1) ** 2)


def test_a_cylinder_unrolls_without_distortion() -> None:
    n, radius = 24, 0.1
    u, v = np.meshgrid(np.arange(n + 1), np.arange(7), indexing="ij")
    angle = u.ravel() * 0.2
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.02 * v.ravel()], axis=1)
    index = np.arange(u.size).reshape(u.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    flat = solve_local_global(whole(QuadMesh(vertices, quads)), tolerance=1e-12, rounds=100)
    assert flat.max_energy < 1e-12
    chord = 2 * radius * np.sin(0.1)
    assert np.ptp(np.abs(flat.points[:, None] - flat.points[None, :])) == pytest.approx(
        np.hypot(n * chord, 0.12), rel=1e-6
    )


def test_weighing_bad_quads_lowers_the_worst() -> None:
    problem = whole(shapes.make("dome"))
    start = solve_local_global(problem)
    better = minimise_max_energy(problem, start)
    assert better.flip_count == 0
    assert better.max_energy < 0.8 * start.max_energy


@pytest.mark.parametrize("height", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("name", ["dome", "saddle", "strip"])
def test_giving_up_early_loses_nothing_that_comes_within_the_limit(name: str, height: float) -> None:
    mesh = shapes.make(name)
    problem = whole(mesh.with_vertices(mesh.vertices * [1.0, 1.0, height]))
    start, solves = solve_local_global(problem), [0]
    problem.tick = lambda: solves.__setitem__(0, solves[0] + 1)
    least = minimise_max_energy(problem, start).max_energy
    for limit in np.array([1.0, 1.001, 1.02, 1.2]) * least:
        without = minimise_max_energy(problem, start, target=0.97 * limit)
        found = minimise_max_energy(problem, start, target=0.97 * limit, give_up_above=limit)
        assert without.max_energy > limit or (found.points == without.points).all()
    solves[0] = 0
    minimise_max_energy(problem, start)
    whole_way, solves[0] = solves[0], 0
    assert minimise_max_energy(problem, start, give_up_above=0.1 * least).max_energy > 0.1 * least
    assert solves[0] < 0.5 * whole_way


def test_not_worse_than_libigl() -> None:
    igl = pytest.importorskip("igl")
    mesh = shapes.make("dome")
    problem = whole(mesh)
    points = np.zeros((problem.count, 3))
    points[problem.corners] = mesh.vertices[mesh.quads]
    c = problem.corners
    # libigl sees one triangulation, our energy takes both: hence a band and no equality
    triangles = np.concatenate([c[:, [0, 1, 2]], c[:, [0, 2, 3]]]).astype(np.int64)
    loop = igl.boundary_loop(triangles)
    circle = np.asarray(igl.map_vertices_to_circle(np.asfortranarray(points), loop.astype(np.int32)))[:, :2] * 0.1
    start = np.asarray(igl.harmonic(points, triangles, loop.astype(np.int64), np.ascontiguousarray(circle), 1))
    data = igl.ARAPData()
    data.max_iter = 200
    data.energy = igl.ARAP_ENERGY_TYPE_ELEMENTS
    held = np.array([0], dtype=np.int32)
    igl.arap_precomputation(points, triangles, 2, held, data)
    theirs = np.asarray(igl.arap_solve(start[held], data, start))
    their_energy = problem.flat_patch(theirs[:, 0] + 1j * theirs[:, 1]).energy
    ours = solve_local_global(problem, tolerance=1e-7, rounds=300)
    area = problem.triangles.area.sum(axis=1)
    assert (area * ours.energy).sum() <= 1.001 * (area * their_energy).sum()
    assert (area * ours.energy).sum() > 0.8 * (area * their_energy).sum()
    uv = np.stack([ours.points.real, ours.points.imag], axis=1)
    assert len(igl.flipped_triangles(uv, triangles)) == ours.flip_count == 0


def test_the_smoothest_rotations_fit_better_than_carried_ones() -> None:
    problem = whole(shapes.make("dome"))
    fa, _, fb, _ = problem.joints

    def misfit(rotation: np.ndarray) -> float:
        r = rotation[:, 0]
        return float((np.abs(r[fb] - r[fa] * problem._joint_rotations) ** 2).sum())

    assert misfit(problem.smoothest_rotations()) < 0.9 * misfit(problem.propagate_rotations())


def test_patches_side_by_side_lie_as_each_does_alone() -> None:
    mesh = shapes.make("saddle")
    cut = ~mesh.border & (np.abs(mesh.vertices[mesh.edges].mean(axis=1)[:, 0] % 0.06 - 0.03) < 0.011)
    layout = PatchLayout(mesh, cut)
    assert len(layout.patches) > 2
    quads = np.concatenate(layout.patches)
    corners = np.unique(layout.flat_corners[quads], return_inverse=True)[1].reshape(-1, 4)
    together = PatchProblem(mesh, quads, corners, sizes=[len(patch) for patch in layout.patches])
    made = solve_local_global(together, rounds=200, tolerance=1e-9)
    for patch, one in zip(layout.patches, np.split(made.energy, np.cumsum(together.sizes)[:-1]), strict=True):
        own = np.unique(layout.flat_corners[patch], return_inverse=True)[1].reshape(-1, 4)
        alone = solve_local_global(PatchProblem(mesh, patch, own), rounds=200, tolerance=1e-9)
        assert one == pytest.approx(alone.energy, rel=1e-3, abs=1e-9)
    assert together.max_energies(made.energy) == pytest.approx(
        [made.energy[together.patch_of == k].max() for k in range(len(together.sizes))]
    )
