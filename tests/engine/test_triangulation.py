"""Triangles of polygons with holes."""

import numpy as np
import pytest
import shapely
from flexmaps.engine.triangulation import triangulate


def areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = points[triangles].transpose(1, 0, 2)
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.parametrize("way", [1, -1], ids=["counter-clockwise", "clockwise"])
def test_triangles_cover_a_polygon_with_a_hole_and_another_one(way: int) -> None:
    outer = np.array([[0, 0], [6, 0], [6, 4], [3, 2], [0, 4]], float)[::way]
    hole = np.array([[1, 1], [2, 1], [2, 2], [1, 2]], float)
    other = np.array([[10, 0], [12, 0], [11, 3]], float)
    polygons = [shapely.Polygon(outer, [hole]), shapely.Polygon(other)]
    known = np.concatenate([other, hole, outer])[np.random.default_rng(0).permutation(12)]
    triangles = triangulate(polygons, known)
    assert (areas(known, triangles) > 0).all()
    assert areas(known, triangles).sum() == pytest.approx(sum(one.area for one in polygons))
    for triangle in known[triangles]:
        assert any(one.covers(shapely.Polygon(triangle).representative_point()) for one in polygons)


def test_zeros_of_either_sign_are_one_point() -> None:
    polygon = shapely.Polygon([(0.0, 0.0), (1.0, -0.0), (0.0, 1.0)])
    assert sorted(triangulate([polygon], np.array([[-0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))[0].tolist()) == [0, 1, 2]
