"""Outlines of connectors against the sizes that they are drawn for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.fabrication.connectors.shape import (
    ConnectorSize,
    connector_size,
    connector_sizes,
    face_curve,
    head_curve,
    key_outline,
    min_radius,
    round_polyline,
    socket_curve,
    tab_sizes,
)
from flexmaps.engine.params import ConnectorParams
from shapely import LineString, Polygon


def test_a_head_is_as_wide_as_its_size_says() -> None:
    """Each side gives up half of the clearance, measured across the middle of the head's end, and at the pad."""
    made = ConnectorSize(0.001, 0.002, 0.0015, 0.0005, 0.0005, 0.004, 1e-4, 0.0)
    line = LineString(head_curve(made).sample(1e-7))
    low, high = line.bounds[1], line.bounds[3]
    assert high - low == pytest.approx(made.pad_width, abs=2e-5)
    end = line.intersection(LineString([(made.length - 6e-5, -1.0), (made.length - 6e-5, 1.0)])).bounds
    slope = 0.5 * (made.head - made.neck) / made.length
    across = 2.0 * (0.5 * made.head - 6e-5 * slope - 0.5 * made.clearance * (1.0 + slope**2) ** 0.5)
    assert end[3] - end[1] == pytest.approx(across, abs=1e-6)


def test_sizes_follow_the_width_of_the_arms() -> None:
    """A neck of 0.7 arm widths, and the head, walls and widened end that belong to it."""
    params = ConnectorParams(neck=0.7, thinnest=0.0008, clearance=1e-4, rounding=2e-4)
    made = connector_size(0.004, params)
    assert made.neck == pytest.approx(0.0028) and made.length == pytest.approx(0.85 * 0.0028)
    assert made.head == pytest.approx(made.neck + 2.0 * made.length * math.tan(math.radians(25.0)))
    assert made.wall == pytest.approx(0.6 * 0.0028) and made.thinnest == 0.0008 and made.clearance == 1e-4
    assert made.pad_width == pytest.approx(made.head + 1e-4 + 2.0 * made.wall) and made.inside_radius == 0.0
    half = connector_size(0.004, params, 0.5)
    assert half.neck == pytest.approx(0.5 * made.neck) and half.head == pytest.approx(0.5 * made.head)
    # as thin as permitted once the clearance is cut away, and walls as thin as permitted
    thin = connector_size(0.001, params)
    assert thin.neck == pytest.approx(0.0009) and thin.wall == pytest.approx(0.0008)
    # a wide arm is not widened further
    assert connector_size(0.004, replace(params, neck=0.5), 0.5).pad_width == 0.004


@pytest.mark.parametrize("mill", [0.001, 0.002])
def test_a_mill_needs_wider_necks_and_longer_flanks(mill: float) -> None:
    params = ConnectorParams(thinnest=0.0005, clearance=1e-4, rounding=2e-4)
    plain, made = connector_size(0.0012, params), connector_size(0.0012, params, 1.0, mill)
    assert 0.5 * mill < made.inside_radius < 0.5 * mill + 5e-5
    assert made.neck == pytest.approx(max(plain.neck, 2.0 * made.inside_radius))
    # room for the rounded root, whose tangents meet at 115 degrees, and for a dogbone on every flank
    flank = made.length / math.cos(math.radians(25.0))
    assert flank > made.inside_radius * (math.tan(math.radians(57.5)) + 1.9) > plain.length
    assert made.pad_width > made.head + made.clearance + 2.0 * made.wall + 0.49 * mill


@pytest.mark.parametrize("rounding", [1e-4, 3e-4, 6e-4])
def test_finished_corners_are_as_round_as_asked_where_the_flank_is_long_enough(rounding: float) -> None:
    params = ConnectorParams(rounding=rounding, clearance=1e-4, thinnest=0.0008)
    made = connector_size(0.003, params)
    assert min_radius(made) == pytest.approx(max(rounding, 0.75 * 1e-4 - 0.5e-4), rel=1e-6)
    for curve in (head_curve(made), socket_curve(made)):
        a, b, bulge = curve.points[:-1], curve.points[1:], curve.bulge[:-1]
        chord = np.linalg.norm(b - a, axis=1)[bulge != 0.0]
        radius = chord / (2.0 * np.sin(2.0 * np.arctan(np.abs(bulge[bulge != 0.0]))))
        assert len(radius) == 4 and radius.min() >= min_radius(made) - 1e-12


def test_sizes_that_come_out_equal_are_tried_once() -> None:
    params = ConnectorParams(thinnest=0.0008)
    made = connector_sizes(0.001, params, (1.0, 0.9, 0.8, 0.5))
    assert list(made) == sorted(set(made), key=lambda one: -one.neck) and made[0] == connector_size(0.001, params)
    assert len({one.neck for one in made}) == len(made)


def test_tabs_come_widest_first_and_end_flat() -> None:
    params = ConnectorParams(thinnest=0.0008, clearance=1e-4)
    made = tab_sizes(0.001, params, (1.0, 0.5))
    pads = [one.pad_width for one in made]
    wanted = {connector_size(0.001, params, scale).pad_width for scale in (1.0, 0.5)} | {0.002, 0.0016, 0.0013}
    assert pads == pytest.approx(sorted(wanted, reverse=True))
    for one in made:
        assert one.neck == one.head == one.length == 0.0005 and one.thinnest == 0.0008 and one.wall == 0.0
        assert one.rounding <= 0.0002 and one.clearance == 1e-4
        face = face_curve(one, 3e-4)
        half = 0.5 * one.pad_width
        np.testing.assert_allclose(face.points, [[-3.5e-4, -half], [-3.5e-4, half]])
    assert tab_sizes(0.0006, params, (1.0,))[0].thinnest == 0.0006


@pytest.mark.parametrize("setback", [0.0, 6e-4])
def test_a_key_fills_both_sockets_up_to_the_clearance(setback: float) -> None:
    made = connector_size(0.002, ConnectorParams(clearance=1e-4), 1.0)
    key = Polygon(key_outline(made, setback).sample(1e-8))
    assert key.is_valid and key_outline(made, setback).area > 0.0
    assert key.bounds == pytest.approx((-key.bounds[2], -key.bounds[3], key.bounds[2], key.bounds[3]))
    assert key.bounds[2] == pytest.approx(setback + made.length - 0.5e-4)
    socket = socket_curve(made, setback).sample(1e-8)  # of the arm that comes from the right
    side = LineString(socket)
    other = LineString(-socket)
    for line in (side, other):
        assert line.distance(key) == pytest.approx(1e-4, abs=2e-8)
    assert side.distance(other) == pytest.approx(2.0 * setback + 1e-4 if setback else 1e-4, abs=2e-8)


@pytest.mark.parametrize("closed", [True, False])
def test_rounded_corners_touch_their_sides_and_short_sides_limit_them(closed: bool) -> None:
    corners = [(0.0, 0.0), (0.01, 0.0), (0.01, 0.01), (0.01, 0.015), (0.0, 0.015)]
    made = round_polyline(corners, 0.002, closed)
    drawn = Polygon(corners)
    if closed:
        wanted = drawn.buffer(-0.002, quad_segs=200).buffer(0.002, quad_segs=200)
        assert Polygon(made.sample(1e-8)).symmetric_difference(wanted).area < 1e-10
        assert len(made.points) == 8  # straight on at the third point
    else:
        np.testing.assert_array_equal(made.points[[0, -1]], [corners[0], corners[-1]])
        assert made.length == pytest.approx(0.035 - 2.0 * (2.0 - 0.5 * math.pi) * 0.002)
    step = round_polyline([(0.0, 0.0), (0.01, 0.0), (0.01, 0.001), (0.02, 0.001)], 0.005)
    lengths = np.linalg.norm(np.diff(step.points, axis=0), axis=1)
    assert lengths[2] == pytest.approx(0.02 * 0.001) and step.points[3] == pytest.approx([0.01, 0.00051])
    single = round_polyline(corners[:3], [0.0, 0.003, 0.0])
    assert single.points[1] == pytest.approx([0.007, 0.0]) and single.bulge[1] == pytest.approx(math.tan(math.pi / 8))
