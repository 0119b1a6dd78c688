"""Arms of the spirals: the closed form in squares, derivatives by differences, joints across edges and seams."""

import numpy as np
import pytest
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.spirals.curves import spiral
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.checking import geometry as check_geometry


def _shaken(points):
    return points + np.random.default_rng(4).uniform(-0.002, 0.002, points.shape)


@pytest.fixture
def shaken(flat_grid):
    """Arms of many different spirals in distorted quads, two patches with a seam between them."""
    flat = flat_grid(4, 3, move=_shaken, cut=lambda x, y: x == 2)
    rng = np.random.default_rng(5)
    return flat, spiral.make_arms(flat, SpiralParams(), rng.uniform(0.001, 0.002, (12, 4)), rng.uniform(0, 5, 12))


@pytest.mark.parametrize("clockwise", [False, True])
def test_centre_lines_of_equal_spirals_in_squares_are_archimedean(flat_grid, clockwise):
    flat = flat_grid(3, 3)
    params = SpiralParams(clockwise=clockwise)
    t, sign = np.linspace(0, 1, 33), -1 if clockwise else 1
    arms = SpiralDesign(flat, params, np.full((9, 4), 0.001), np.full(9, 4.0)).arms
    lines = spiral.centre_line(arms, np.broadcast_to(t, (9, 4, 33)))[0]
    for k, start in enumerate((-90, 0, 90, 180)):  # side 0 is the lower one
        angle = np.radians(start) + sign * 4.0 * t
        expected = 0.01 * (1 - t)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1) + [0.03, 0.03]
        np.testing.assert_allclose(lines[4, k], expected, atol=1e-15)


def test_the_check_of_thin_quads_knows_the_room_of_a_cross(shaken):
    """Up to the fillets, and the tenth of the arms that is left to the joints, the breadth is what the widest arms may take."""
    flat, params = shaken[0], SpiralParams()
    corners = np.concatenate([flat.corners, np.zeros((*flat.corners.shape[:2], 1))], axis=2)
    expected = 0.9 * check_geometry.breadth(corners) - 2 * params.fillet
    np.testing.assert_allclose(spiral.widest_arms(flat, params), expected, rtol=1e-9)


def test_derivatives_agree_with_differences(shaken):
    _, arms = shaken
    t = np.broadcast_to(np.linspace(0.01, 0.9, 40), (*arms.radius.shape, 40))
    e = 1e-6
    _, d1, d2 = spiral.centre_line(arms, t)
    (p, a, _), (q, b, _) = spiral.centre_line(arms, t + e), spiral.centre_line(arms, t - e)
    np.testing.assert_allclose(d1, (p - q) / (2 * e), atol=2e-8)
    np.testing.assert_allclose(d2, (a - b) / (2 * e), atol=2e-6)
    for side in (spiral.LEFT, spiral.RIGHT):
        tangent = spiral.edge_points(arms, t, side)[1]
        difference = (spiral.edge_points(arms, t + e, side)[0] - spiral.edge_points(arms, t - e, side)[0]) / (2 * e)
        np.testing.assert_allclose(tangent, difference, atol=2e-8)


def test_edges_run_on_smoothly_across_every_edge_and_seam(shaken):
    flat, arms = shaken
    mesh, corners = flat.layout.mesh, flat.corners
    quad, side = spiral.opposite_sides(mesh)
    zero = np.zeros((*arms.radius.shape, 1))
    left, d_left = (x[:, :, 0] for x in spiral.edge_points(arms, zero, spiral.LEFT))
    right, d_right = (x[:, :, 0] for x in spiral.edge_points(arms, zero, spiral.RIGHT))
    checked = 0
    for q, k in np.argwhere(quad != np.arange(len(quad))[:, None]):
        other, j = quad[q, k], side[q, k]
        # here all patches lie side by side, so positions and tangents can be compared as they are
        np.testing.assert_allclose(left[q, k], right[other, j], atol=1e-12)
        a, b = d_left[q, k] / np.linalg.norm(d_left[q, k]), -d_right[other, j] / np.linalg.norm(d_right[other, j])
        np.testing.assert_allclose(a, b, atol=1e-9)
        middle = 0.5 * (corners[q, k] + corners[q, (k + 1) % 4])
        np.testing.assert_allclose(0.5 * (left[q, k] + right[q, k]), middle, atol=1e-12)
        checked += 1
    assert checked == 34


def test_arms_keep_their_own_width_beyond_the_blend(shaken):
    _, arms = shaken
    t = np.broadcast_to(np.linspace(0.71, 0.95, 20), (*arms.radius.shape, 20))
    across = spiral.edge_points(arms, t, spiral.LEFT)[0] - spiral.edge_points(arms, t, spiral.RIGHT)[0]
    np.testing.assert_allclose(
        np.linalg.norm(across, axis=-1), np.broadcast_to(arms.width[..., None], t.shape), rtol=1e-12
    )


def inner_radius(arms):
    """Smallest ratio of the inner edge's radius of curvature to the centre line's, in the blend of every arm; the edge folds at 0."""
    t = arms.share[..., None] * np.linspace(0.0, 1.0, 17)
    _, d1, d2 = spiral.centre_line(arms, t)
    speed = np.hypot(d1[..., 0], d1[..., 1])
    curvature = np.abs(d1[..., 0] * d2[..., 1] - d1[..., 1] * d2[..., 0]) / speed**3
    return (1.0 - 0.5 * spiral.width_at(arms, t)[0] * curvature).min(axis=-1)


def test_sharp_turns_get_longer_blends_and_never_fold(flat_grid):
    flat = flat_grid(2, 1)
    arms = spiral.make_arms(flat, SpiralParams(), spiral.same_width(np.array([0.002, 0.001])), np.array([0.0, 6.0]))
    assert arms.share[0, 1] > 0.2  # the straight, thick arm at the joint with the wound one
    assert arms.share[0, 3] == pytest.approx(0.15)
    assert inner_radius(arms).min() > 0.25
