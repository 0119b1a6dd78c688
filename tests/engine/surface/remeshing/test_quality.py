"""The quality of remeshed quads, against surfaces whose figures are known, and finer quads from coarse ones."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.surface import curvature
from flexmaps.engine.surface.checking.check import as_quad_mesh
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.surface.remeshing import quality, refine, requad
from flexmaps.engine.surface.remeshing.mend import TargetSurface, mesh_from_rows


def cylinder(turn: float, n: int = 24) -> QuadMesh:
    """A square sheet of n x n quads on a cylinder of radius 1, its sides ``turn`` radians off the axis."""
    u, v = (g.ravel() / n - 0.5 for g in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    x, y = u * np.cos(turn) - v * np.sin(turn), u * np.sin(turn) + v * np.cos(turn)
    k = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    rows = np.stack([k, k + n + 1, k + n + 2, k + 1], axis=1)
    return as_quad_mesh(mesh_from_rows(np.stack([np.cos(x), np.sin(x), y], axis=1), rows))


@pytest.mark.parametrize("degrees", [0.0, 10.0, 30.0, 45.0, 70.0])
def test_quads_across_a_cylinder_are_off_its_axis_by_their_turn(degrees: float) -> None:
    off = curvature.misalignment(cylinder(np.radians(degrees)))
    assert off == pytest.approx(min(degrees, 90.0 - degrees), abs=0.5)


def cube(n: int) -> PolygonMesh:
    grid = np.arange(n + 1)
    a, b = (x.ravel() for x in np.meshgrid(grid, grid, indexing="ij"))
    k = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    side = np.stack([k, k + n + 1, k + n + 2, k + 1], axis=1)
    points, rows = [], []
    for axis in range(3):
        for end in (0, n):
            points.append(np.roll(np.stack([np.full(len(a), end), a, b], axis=1), axis, axis=1))
            rows.append((side if end else side[:, ::-1]) + (len(points) - 1) * len(a))
    places, index = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return mesh_from_rows(places / n, index.reshape(-1)[np.concatenate(rows)])


def as_target(quads: PolygonMesh) -> TargetSurface:
    return requad.target_surface(quads)


def test_a_cube_has_eight_irregular_vertices_and_keeps_its_edges() -> None:
    target = as_target(cube(3))
    assert len(target.sharp_edges) == 12 * 3
    found = quality.quality(cube(6), target)
    assert (found.irregular, found.lost_edge_share) == (8, 0.0) and found.unevenness == pytest.approx(0.0, abs=1e-12)
    rounded = cube(6)
    middle = rounded.vertices - 0.5
    rounded = PolygonMesh(0.5 + 0.8 * middle / np.linalg.norm(middle, axis=1)[:, None], rounded.corners, rounded.sizes)
    worse = quality.quality(rounded, target)
    assert worse.lost_edge_share > 0.5 and worse.cost > found.cost


def test_directions_are_not_given_up_for_a_few_irregular_vertices() -> None:
    """On a smooth shell; where there are many, as on a scan, a degree does not pay for fifty."""

    def cost(irregular: int, misalignment: float) -> float:
        return quality.Quality(irregular, misalignment, 0.2, 0.0).cost

    assert cost(16, 13.0) < cost(3, 29.0)
    assert cost(28, 11.9) < cost(64, 10.9)
    assert cost(8, 20.0) < cost(8, 21.0) and cost(8, 20.0) < cost(10, 20.0)


def test_finer_quads_lie_on_the_surface_and_on_its_sharp_edges() -> None:
    """Coarse quads whose corners miss the cube by a little; the cube's own measures are the reference."""
    coarse = cube(4)
    moved = coarse.vertices + 0.02 * np.random.default_rng(1).standard_normal(coarse.vertices.shape)
    made = refine.refine_quads(PolygonMesh(moved, coarse.corners, coarse.sizes), as_target(cube(1)), 1)
    assert len(made.sizes) == 4 * len(coarse.sizes)
    found = quality.quality(made, as_target(cube(1)))
    assert (found.irregular, found.lost_edge_share) == (8, 0.0)
    p = made.vertices[made.corners.reshape(-1, 4)]
    area = 0.5 * np.linalg.norm(np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]), axis=1)
    assert area.sum() == pytest.approx(6.0, rel=1e-6)
    volume = np.einsum("fi,fi->f", p.mean(axis=1) - 0.5, 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])).sum() / 3
    assert volume == pytest.approx(1.0, rel=1e-6)


def test_the_border_of_a_sheet_stays_where_it_is() -> None:
    n = 3
    x, y = (g.ravel() / n for g in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    k = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    sheet = mesh_from_rows(np.stack([x, y, 0 * x], axis=1), np.stack([k, k + n + 1, k + n + 2, k + 1], axis=1))
    small = PolygonMesh(0.05 + 0.9 * sheet.vertices * [1.0, 1.0, 0.0], sheet.corners, sheet.sizes)
    made = refine.refine_quads(small, as_target(sheet), 1)
    p = made.vertices[made.corners.reshape(-1, 4)]
    assert np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])[:, 2].sum() / 2 == pytest.approx(1.0)
