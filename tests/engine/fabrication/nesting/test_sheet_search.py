"""What the search for sets of panels trusts in: distances, rotations, strips in millimetres, promising sets."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import shapely
from flexmaps.engine.fabrication.nesting import sheet_search
from flexmaps.engine.fabrication.nesting.outlines import HULL_SHARE_DEVIATION, MEAN_HULL_SHARE, grow_outline, hull_area
from flexmaps.engine.fabrication.nesting.packing import Packing
from flexmaps.engine.fabrication.nesting.sheet_search import SheetSearch
from flexmaps.engine.fabrication.nesting.strip import PackedStrip
from flexmaps.engine.params import SheetParams
from flexmaps.engine.progress import SILENT

SHEET = SheetParams(sheet_width=0.3, sheet_height=0.2, margin=0.01, spacing=0.004, nesting_seconds=1e3)


def rectangle(width: float, height: float) -> np.ndarray:
    return np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])


def search(shapes: list[np.ndarray], params: SheetParams = SHEET) -> SheetSearch:
    return SheetSearch(shapes, params, cast(Any, SimpleNamespace(count=2)), SILENT)


def laid(*shifts: tuple[float, float], sheet: tuple[int, ...] = (), turn: float = 0.0) -> Packing:
    on = np.array(sheet or (0,) * len(shifts))
    return Packing(on, np.full(len(shifts), turn), np.array(shifts), np.tile([0.3, 0.2], (on.max() + 1, 1)))


def test_margin_and_spacing_are_kept_to_the_last_micrometre() -> None:
    made = search([rectangle(0.1, 0.05), rectangle(0.1, 0.05)])
    assert made._keeps_distances(laid((0.01, 0.01), (0.114, 0.01)))
    assert made._keeps_distances(laid((0.19, 0.14), (0.01, 0.14)))
    assert made._keeps_distances(laid((0.01, 0.01), (0.01, 0.01), sheet=(0, 1)))
    for second in ((0.1139, 0.01), (0.01, 0.0639), (0.05, 0.02)):
        assert not made._keeps_distances(laid((0.01, 0.01), second))
    for first in ((0.0099, 0.01), (0.01, 0.0099), (0.1901, 0.01), (0.01, 0.1401)):
        assert not made._keeps_distances(laid(first, (0.1, 0.07)))
    # turned by a quarter to the left, a rectangle lies to the left of its origin
    assert made._keeps_distances(laid((0.06, 0.01), (0.12, 0.01), turn=0.5 * np.pi))
    assert not made._keeps_distances(laid((0.059, 0.01), (0.12, 0.01), turn=0.5 * np.pi))


@pytest.mark.parametrize(("rotation", "wanted"), [("GRAIN", {0.0, 180.0}), ("QUARTER", {0.0, 90.0, 180.0, 270.0})])
def test_allowed_rotations_begin_with_those_of_least_width(rotation: str, wanted: set[float]) -> None:
    """Of 280 x 180 mm, a bar of 150 x 20 mm has room either way; one of 200 x 20 mm along the sheet alone."""
    params = replace(SHEET, rotation=rotation)
    found = search([rectangle(0.15, 0.02)], params).rotations[0]
    assert {round(turn % 360.0, 6) for turn in found} == wanted
    assert rotation == "GRAIN" or [round(turn % 180.0, 6) for turn in found[:2]] == [90.0, 90.0]
    assert {round(turn % 360.0, 6) for turn in search([rectangle(0.2, 0.02)], params).rotations[0]} == {0.0, 180.0}
    assert search([rectangle(0.281, 0.02)], params).rotations == [[]]


def test_a_bar_longer_than_the_sheet_has_the_rotations_that_leave_it_on_the_sheet() -> None:
    made = search([rectangle(0.31, 0.005)], replace(SHEET, rotation="FREE"))
    assert made.rotations[0]
    for turn in made.rotations[0]:
        x, y = abs(np.cos(np.radians(turn))), abs(np.sin(np.radians(turn)))
        assert 0.31 * x + 0.005 * y <= 0.28 + 2e-4 and 0.31 * y + 0.005 * x <= 0.18 + 2e-4


def test_strips_are_in_millimetres_and_their_places_on_the_sheet() -> None:
    """A strip of grown outlines: they may touch there and lie on its borders, where true shapes keep their distances."""
    made = search([rectangle(0.1, 0.05), rectangle(0.08, 0.05)])
    task = made._strip_task(frozenset([1, 0]), 3, 5, 0.28)
    assert [key for key, *_ in task.items] == [0, 1] and (task.seconds, task.seed) == (3, SHEET.seed + 5)
    gap = 1e3 * made.separation
    assert gap == pytest.approx(4.02) and task.height == pytest.approx(180.0 + gap)
    assert task.target_length == pytest.approx(280.0 + gap)
    assert made._strip_task(frozenset([1]), 3, 0).target_length == 0.0
    for _, points, _turns in task.items:
        assert np.ptp(np.array(points), axis=0).min() == pytest.approx(50.0 + gap, abs=0.35)
    strip = PackedStrip(2.0 * 184.02, {0: (0.0, (0.5 * gap, 0.5 * gap)), 1: (90.0, (254.02 - 0.5 * gap, 0.5 * gap))})
    metres = made._in_metres(strip)
    assert metres.length == pytest.approx(0.36804 - made.separation)
    assert made._places_on_sheet(metres) is None and made._places_on_sheet(None) is None
    places = made._places_on_sheet(metres._replace(length=0.2799))
    assert places is not None and places[1][0] == pytest.approx(0.5 * np.pi)
    assert places[0][1] == pytest.approx([0.01, 0.01]) and places[1][1] == pytest.approx([0.26, 0.01])
    both = Packing(
        np.zeros(2, int),
        np.array([places[k][0] for k in (0, 1)]),
        np.array([places[k][1] for k in (0, 1)]),
        np.array([[0.3, 0.2]]),
    )
    assert made._keeps_distances(both)


def test_fewer_sheets_rank_first_and_then_less_on_the_emptiest() -> None:
    made = search([rectangle(0.1, 0.05), rectangle(0.1, 0.06), rectangle(0.1, 0.04)])
    shifts = ((0.01, 0.01),) * 3
    one, even, uneven = (laid(*shifts, sheet=on) for on in ((0, 0, 0), (0, 1, 0), (0, 0, 1)))
    assert made._rank(one) < made._rank(uneven) < made._rank(even)
    assert made._rank(uneven) == (2, pytest.approx(0.004)) and made._rank(even) == (2, pytest.approx(0.006))


def test_random_sets_hold_the_first_panel_gain_area_and_probably_fit() -> None:
    shapes = [rectangle(0.05 + 0.01 * k, 0.05) for k in range(14)]
    made = search(shapes)
    rest, sheet = list(range(13, -1, -1)), 0.28 * 0.18
    failed, tried = frozenset([13, 0]), frozenset([13, 12, 11, 1])
    made.results = {failed: None, tried: {}}
    least = 0.02
    found = made._random_sets(rest, least, np.random.default_rng(0))
    assert len(found) == len(set(found)) > 10
    worth = []
    for members in found:
        area, hulls = sum(made.areas[i] for i in members), sum(hull_area(shapes[i]) for i in members)
        assert 13 in members and area > least and not failed <= members and members != tried
        assert hulls <= (MEAN_HULL_SHARE + 1.5 * HULL_SHARE_DEVIATION) * sheet
        # a logistic distribution with this mean and standard deviation
        scale = HULL_SHARE_DEVIATION * 3.0**0.5 / np.pi
        worth.append((area - least) * (1.0 - 1.0 / (1.0 + np.exp(-(hulls / sheet - MEAN_HULL_SHARE) / scale))))
    assert np.diff(worth).max() < 1e-12  # equal sets may differ by rounding
    assert made._random_sets([3], 0.0, np.random.default_rng(0)) == []


def test_the_time_limit_keeps_a_share_for_compacting(monkeypatch: pytest.MonkeyPatch) -> None:
    made = search([rectangle(0.1, 0.05)] * 2, replace(SHEET, nesting_seconds=10.0))
    for elapsed, left in ((7.4, True), (7.6, False)):
        monkeypatch.setattr(sheet_search.time, "monotonic", lambda elapsed=elapsed: made.begin + elapsed)
        assert made.share_of_time == pytest.approx(0.1 * elapsed) and made._has_time_left == left
    made.params = replace(SHEET, nesting_seconds=1.0)  # half of the time of one search is always kept
    for elapsed, left in ((0.45, True), (0.55, False)):
        monkeypatch.setattr(sheet_search.time, "monotonic", lambda elapsed=elapsed: made.begin + elapsed)
        assert made._has_time_left == left


# -- outlines ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [0.0, 0.002])
def test_a_grown_outline_holds_all_that_lies_within_the_distance_and_little_more(distance: float) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    star = (0.05 + 0.02 * np.sin(5.0 * angle))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    ring = grow_outline(star, distance, 1e-4)
    grown, wanted = shapely.Polygon(ring), shapely.Polygon(star).buffer(distance, quad_segs=64)
    assert shapely.LinearRing(ring).is_ccw and grown.contains(wanted)
    assert shapely.Polygon(star).buffer(1.02 * distance + 4e-4, quad_segs=64).contains(grown)


def test_the_hull_of_an_l_is_a_pentagon() -> None:
    shape = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2.0]])
    assert hull_area(shape) == pytest.approx(5.0)
