"""Roots of slots: circles that touch both edges, judged by shapely, and caps of the arms that are left out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals.caps import STUMP_START, left_out_arms, make_caps, stump_starts
from flexmaps.engine.spirals.clearance import slots
from flexmaps.engine.spirals.curves.spiral import LEFT, RIGHT, Arms, edge_points, make_arms
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.spirals.roots import SlotRoots, find_roots

FILLET = 0.0002  # metres
POINTS = 400  # of an edge


def sheared(points: np.ndarray) -> np.ndarray:
    return points @ np.array([[1.0, 0.1], [0.2, 0.9]])


@pytest.fixture(params=[(0.0, False), (1.5, False), (3.0, False), (3.0, True)], ids=str)
def arms(request: pytest.FixtureRequest, flat_grid: Callable[..., FlatPatches]) -> Arms:
    """Two quads, sheared, with arms of four widths each."""
    twist, clockwise = request.param
    width = np.array([[0.001, 0.0013, 0.0016, 0.0012], [0.0011, 0.0011, 0.0015, 0.001]])
    params = SpiralParams(fillet=FILLET, clockwise=clockwise)
    return make_arms(flat_grid(2, 1, move=sheared), params, width, np.full(2, twist))


def edges(arms: Arms, quad: int, slot: int, roots: SlotRoots, beyond: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """The two edges of a slot from its mouth to its root: of the arm before it and of the arm behind it."""
    t = np.linspace(0.0, 1.0, POINTS)
    left = np.broadcast_to(t * roots.left[..., None] * beyond, (len(roots.left), 4, len(t)))
    right = np.broadcast_to(t * np.roll(roots.right, 1, axis=1)[..., None] * beyond, left.shape)
    return edge_points(arms, left, LEFT)[0][quad, slot], edge_points(arms, right, RIGHT)[0][quad, (slot + 1) % 4]


def test_fillets_touch_both_edges_where_the_slot_ends(arms: Arms) -> None:
    roots = find_roots(arms, FILLET)
    assert not roots.is_missing.any() and (roots.fillet == FILLET).all()
    for quad in range(2):
        for slot in range(4):
            left, right = edges(arms, quad, slot, roots)
            for edge in (left, right):
                assert np.linalg.norm(edge[-1] - roots.centre[quad, slot]) == pytest.approx(FILLET, abs=1e-8)
                assert shapely.LineString(edge).distance(shapely.Point(roots.centre[quad, slot])) == pytest.approx(
                    FILLET, abs=1e-6
                )
            # nowhere from its mouth on is the slot narrower: a disc of this size rolls in along each edge
            apart = shapely.distance(shapely.points(left), shapely.LineString(right))
            assert apart.min() >= np.linalg.norm(left[-1] - right[-1]) - 1e-7


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_slot_is_as_wide_as_the_circle_between_its_edges(arms: Arms, share: float) -> None:
    """Found by moving a circle's centre away from the outer edge until the other edge is as near."""
    roots = find_roots(arms, FILLET)
    width, lean, outer, inner = slots.slot_widths(arms, roots.left, roots.right, np.array([share]))
    step = 1 if slots.is_clockwise(arms) else -1
    for quad in range(2):
        for slot in range(4):
            if lean[quad, slot, 0] < 0.8 or width[quad, slot, 0] > 0.004:
                continue  # an edge that is curved along the circle is taken for straight: 4 % at slots of 7 mm
            lines = edges(arms, quad, slot, roots, 1.02)
            far, near = lines if step > 0 else lines[::-1]
            assert outer[quad, slot, 0] == pytest.approx(share * (roots.left if step > 0 else roots.right)[quad, slot])
            k = round(share / 1.02 * (POINTS - 1))
            way = far[k + 1] - far[k - 1]
            across = np.array([-way[1], way[0]]) / np.linalg.norm(way)
            facing = shapely.get_coordinates(shapely.shortest_line(shapely.Point(far[k]), shapely.LineString(near)))[1]
            inwards = across * np.sign(across @ (facing - far[k]))
            radius = np.linspace(0.0, 0.004, 1001)
            centres = shapely.points(far[k] + radius[:, None] * inwards)
            touches = radius[np.argmax(shapely.distance(centres, shapely.LineString(near)) < radius)]
            assert width[quad, slot, 0] == pytest.approx(2.0 * touches, rel=0.03, abs=1e-5)
    assert (inner >= 0.0).all()


def test_narrowest_slot_and_bridge_of_straight_arms_in_closed_form(flat_grid: Callable[..., FlatPatches]) -> None:
    """Four arms at right angles: slots are narrowest at their roots, the thinnest arm is the narrowest place."""
    params = SpiralParams(fillet=FILLET)
    width = np.array([[0.001, 0.0013, 0.0016, 0.0012]])
    arms = make_arms(flat_grid(1, 1), params, width, np.zeros(1))
    roots = find_roots(arms, FILLET)
    slot, bridge = slots.min_slot_and_bridge(arms, roots.left, roots.right, FILLET)
    assert slot == pytest.approx(2.0 * FILLET) and bridge == pytest.approx(0.001, rel=1e-3)
    thin = np.array([[True, False, False, False]])
    assert slots.min_slot_and_bridge(arms, roots.left, roots.right, FILLET, thin)[1] == pytest.approx(0.0012, rel=1e-3)
    # the centre of each fillet lies where its distance from both arms is the fillet
    from_centre = np.abs(roots.centre[0] - arms.centre[0])
    for k in range(4):
        wanted = {round(float(0.5 * w + FILLET), 9) for w in (width[0, k], width[0, (k + 1) % 4])}
        assert {round(float(x), 9) for x in from_centre[k]} == wanted
    assert slots.is_beside_absent(thin).tolist() == [[True, False, False, True]]


# -- caps --------------------------------------------------------------------------------------------------------------


def test_a_stump_ends_in_a_half_circle_over_its_edges(arms: Arms) -> None:
    roots = find_roots(arms, FILLET)
    begin = stump_starts(roots)
    assert begin == pytest.approx(STUMP_START * np.minimum(roots.left, roots.right[:, [3, 0, 1, 2]]))
    absent = np.array([[False, True, False, False], [False, False, True, True]])
    caps = make_caps(arms, begin, absent, np.array([3, 5]))
    assert [(cap.arm, cap.patch) for cap in caps] == [(1, 3), (6, 5), (7, 5)]
    for cap in caps:
        quad, side = divmod(cap.arm, 4)
        assert cap.inner_end == begin[quad, side]
        t = np.broadcast_to(begin[..., None], (2, 4, 1))
        right, left = (edge_points(arms, t, way)[0][quad, side, 0] for way in (RIGHT, LEFT))
        np.testing.assert_allclose(cap.end_curve.points, [right, left])
        radius = 0.5 * np.linalg.norm(left - right)
        assert cap.end_curve.length == pytest.approx(np.pi * radius)
        assert cap.polygon.area == pytest.approx(0.5 * np.pi * radius**2, rel=0.01)
        # away from the hub
        middle, tip = 0.5 * (left + right), np.asarray(cap.polygon.centroid.coords[0])
        assert np.linalg.norm(tip - arms.centre[quad]) > np.linalg.norm(middle - arms.centre[quad])


@pytest.mark.parametrize("border", ["stubs", "left_out"])
def test_arms_at_the_border_are_left_out_where_that_is_asked_for(
    flat_grid: Callable[..., FlatPatches], border: str
) -> None:
    mesh = flat_grid(3, 3).layout.mesh
    found = left_out_arms(mesh, SpiralParams(border=border))
    assert found.sum() == (12 if border == "left_out" else 0)
    assert not found[4].any()
    made = SpiralDesign(flat_grid(3, 3), SpiralParams(border=border), np.full((9, 4), 0.001), np.ones(9))
    assert (made.is_absent == found).all() and len(made.caps) == found.sum()
