"""Curves of arcs: closed forms of the circle, and fits measured against densely sampled curves."""

import numpy as np
import pytest
from flexmaps.engine.spirals.curves import arcs
from flexmaps.engine.spirals.curves.arcs import Curve, arc_points, fit_biarcs
from shapely import LineString, Point, Polygon

HALF = Curve(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 1.0]))  # a circle as two half circles


def test_circle_has_its_area_and_length():
    assert HALF.area == pytest.approx(np.pi, rel=1e-12)
    assert HALF.length == pytest.approx(2 * np.pi, rel=1e-12)


def test_clockwise_circle_has_negative_area():
    assert Curve(HALF.points, -HALF.bulge).area == pytest.approx(-np.pi)


def test_straight_bulges_give_a_polygon():
    square = Curve(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]), np.zeros(4))
    assert square.area == pytest.approx(2.0)
    assert square.length == pytest.approx(6.0)
    np.testing.assert_allclose(square.sample(), square.points)


def test_area_agrees_with_shapely_after_moving():
    rng = np.random.default_rng(1)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 12))
    curve = Curve(np.stack([np.cos(angle), np.sin(angle)], axis=1), rng.uniform(-0.3, 0.3, 12)).transform(
        0.7, np.array([3.0, -2.0])
    )
    assert Polygon(curve.sample(1e-9)).area == pytest.approx(curve.area, rel=1e-6)
    assert LineString(np.vstack([curve.sample(1e-9), curve.points[:1]])).length == pytest.approx(curve.length, rel=1e-6)


def test_points_on_an_arc_lie_on_its_circle():
    points = arc_points(
        np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]), np.array([np.tan(np.pi / 8)]), np.linspace(0, 1, 9)[None]
    )
    np.testing.assert_allclose(np.linalg.norm(points[0], axis=1), 1.0, rtol=1e-12)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_fitted_arcs_stay_within_their_tolerance_and_run_smoothly(tolerance):
    axes = np.array([[3.0, 1.0], [1.0, 1.0], [2.0, 0.3]])  # ellipses, one of them a circle, one sharply bent

    def evaluate(which, t):
        a, b = axes[which].T[..., None]
        point = np.stack([a * np.cos(t), b * np.sin(t)], axis=-1)
        return point, np.stack([-a * np.sin(t), b * np.cos(t)], axis=-1)

    ends = np.array([[0.1, 2.9], [2.0, 0.3], [0.0, 3.1]])  # the second one backwards
    fitted = fit_biarcs(evaluate, ends, tolerance)
    for i in range(3):
        part = slice(fitted.start[i], fitted.start[i + 1])
        last = evaluate(np.array([i]), ends[i, 1:][None])[0][0]
        curve = Curve(np.vstack([fitted.points[part], last]), np.append(fitted.bulge[part], 0.0), closed=False)
        true = evaluate(np.array([i]), np.linspace(*ends[i], 40001)[None])[0][0]
        line = LineString(true)
        assert max(line.distance(Point(p)) for p in curve.sample(tolerance / 20)) < 1.1 * tolerance
        np.testing.assert_allclose(curve.points[0], true[0], atol=1e-12)
        # end tangents of consecutive arcs agree: chord angle plus and minus half of each arc's angle
        a, half = np.diff(curve.points, axis=0), 2 * np.arctan(curve.bulge[:-1])
        angle = np.arctan2(a[:, 1], a[:, 0])
        kink = (angle[1:] - half[1:]) - (angle[:-1] + half[:-1])
        np.testing.assert_allclose(np.angle(np.exp(1j * kink)), 0.0, atol=1e-7)
    counts = np.diff(fitted.start)
    assert counts[1] == 2  # a circle is two arcs
    # the number of arcs grows with the third root of the accuracy only
    assert (counts <= 4.0 * tolerance ** (-1 / 3) + 4).all()


def test_distances_from_a_circle_are_those_from_its_centre():
    """Through (-h, 0), (0, -s) and (h, 0): the centre lies at (h^2 - s^2) / 2 s; without a sag it is a straight line."""
    half, sag = 0.7, np.array([-0.9, -0.1, 0.2, 1.3])
    x, y = np.random.default_rng(0).uniform(-2.0, 2.0, (2, 50, 1))
    centre, radius = (half**2 - sag**2) / (2.0 * sag), (half**2 + sag**2) / (2.0 * np.abs(sag))
    found = arcs._circle_distance(x, y, np.array(half), sag)
    np.testing.assert_allclose(found, np.abs(np.hypot(x, y - centre) - radius), atol=1e-12)
    np.testing.assert_allclose(arcs._circle_distance(x, y, np.array(half), np.array(0.0)), np.abs(y), atol=1e-12)
