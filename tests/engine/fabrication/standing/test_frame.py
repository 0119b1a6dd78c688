"""Planks of a frame under slots at known places: whole, apart by the clearance, locked, and none larger than a sheet."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
import shapely.affinity
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.standing import frame
from flexmaps.engine.params import SheetParams

MARGIN, CLEARANCE, WALL = 0.01, 2e-4, 0.002
LARGE = SheetParams(sheet_width=2.0, sheet_height=2.0, margin=0.0)


def slot(x: float, y: float, turn: float = 0.0) -> np.ndarray:
    """A slot of 20 x 4 mm."""
    corners = np.array([[-0.01, -0.002], [0.01, -0.002], [0.01, 0.002], [-0.01, 0.002]])
    cos, sin = np.cos(turn), np.sin(turn)
    return corners @ np.array([[cos, sin], [-sin, cos]]) + np.array([x, y])


def oblong(length: float = 0.4, height: float = 0.2, count: int = 4) -> np.ndarray:
    """Slots along the sides of a rectangle, in no order."""
    x = np.linspace(0.0, length, count)
    slots = [slot(a, b) for b in (0.0, height) for a in x]
    return np.array(slots)[np.random.default_rng(0).permutation(len(slots))]


def planks(slots: np.ndarray, sheet: SheetParams = LARGE, **more: float) -> list[tuple[shapely.Polygon, np.ndarray]]:
    sizes = {"margin": MARGIN, "clearance": CLEARANCE, "wall": WALL} | more
    made = frame.make_planks(slots, sizes["margin"], sizes["clearance"], sizes["wall"], sheet)
    assert all(outline.area > 0.0 for outline, _ in made)
    return [(shapely.Polygon(outline.sample(1e-6)), rows) for outline, rows in made]


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_every_slot_is_in_one_plank_with_its_margin_around(turn: float) -> None:
    cos, sin = np.cos(turn), np.sin(turn)
    slots = oblong() @ np.array([[cos, sin], [-sin, cos]])
    made = planks(slots)
    assert sorted(k for _, rows in made for k in rows.tolist()) == list(range(8))
    whole = shapely.union_all([body for body, _ in made])
    for body, rows in made:
        assert body.is_valid
        for k in rows.tolist():
            hole = shapely.Polygon(slots[k])
            # rounded where the outline has its corners, and nearer to a joint, but never nearer than the wall
            assert body.contains(hole.buffer(WALL)) and whole.buffer(CLEARANCE).contains(hole.buffer(0.9 * MARGIN))
    assert whole.buffer(CLEARANCE).buffer(-CLEARANCE).geom_type == "Polygon"
    holes = [shapely.Polygon(ring) for ring in whole.buffer(CLEARANCE).interiors]
    assert sum(hole.area > 1e-5 for hole in holes) == 1  # others are left by the rounded corners of dovetails


def test_planks_are_apart_by_the_clearance_and_do_not_slide_apart() -> None:
    made = [body for body, _ in planks(oblong())]
    touching = [(a, b) for a, b in itertools.combinations(made, 2) if a.distance(b) < 1e-3]
    assert len(touching) == len(made) >= 2
    for a, b in touching:
        assert not a.intersects(b) and a.distance(b) == pytest.approx(CLEARANCE, rel=0.02)
        centre = (a.buffer(0.01) & b.buffer(0.01)).centroid
        along_x = min(abs(centre.y), abs(centre.y - 0.2)) < min(abs(centre.x), abs(centre.x - 0.4))
        for pull in (0.003, -0.003):  # one way they meet, the other way the dovetail holds
            moved = shapely.affinity.translate(b, *((pull, 0.0) if along_x else (0.0, pull)))
            assert moved.intersection(a).area > 1e-7


def test_a_dovetail_is_as_wide_as_its_shares_of_the_ring() -> None:
    cut = frame._RingCut(0, np.array([1.0, 2.0]), np.array([0.0, 1.0]), 0.03, 0.02)
    np.testing.assert_array_equal(cut.left_normal, [-1.0, 0.0])
    tongue = cut.tongue(0.001)
    assert tongue.bounds == pytest.approx((1.0 - 0.0042, 2.0 - 0.001, 1.0 + 0.0042, 2.005))
    assert tongue.area == pytest.approx(0.006 * 0.001 + 0.5 * (0.006 + 0.0084) * 0.005)
    assert tongue.intersection(shapely.LineString([(0.9, 2.0), (1.1, 2.0)])).length == pytest.approx(0.006)
    aside = frame._RingCut(0, np.zeros(2), np.array([0.6, 0.8]), 0.03, 0.02).tongue(0.0)
    assert aside.contains(shapely.Point(0.6 * 0.0049, 0.8 * 0.0049)) and not aside.contains(shapely.Point(-1e-4, 0.0))


def test_cuts_lie_midway_between_slots_with_walls_before_and_behind() -> None:
    """A straight ring 24 mm wide between slots 40 mm apart: the tongue of a quarter of that lies in the middle."""
    slots = np.array([slot(0.0, 0.0), slot(0.06, 0.0), slot(0.06, 0.2), slot(0.0, 0.2)])
    ring = shapely.box(-0.05, -0.012, 0.11, 0.012) | shapely.box(-0.05, 0.188, 0.11, 0.212)
    cut = frame._cut_between(slots, 0, ring, MARGIN, WALL)
    assert cut is not None and cut.after == 0 and cut.width == pytest.approx(0.024) == cut.dovetail_scale
    assert cut.middle == pytest.approx([0.03 - 0.5 * 0.006, 0.0], abs=1e-9) and cut.direction == pytest.approx(
        [1.0, 0.0]
    )
    # with walls of 18.5 mm 3 mm are left for the tongue, which is half as large; with 19 mm it would be too small
    small = frame._cut_between(slots, 0, ring, MARGIN, 0.0185)
    assert small is not None and small.dovetail_scale == pytest.approx(0.012)
    assert frame._cut_between(slots, 0, ring, MARGIN, 0.019) is None
    # where the ring is much wider than between straight slots, as in a corner, nothing is cut
    assert frame._cut_between(slots, 0, ring | shapely.box(0.0, -0.024, 0.06, 0.012), MARGIN, WALL) is None


def test_planks_fit_on_the_sheet_and_turn_no_further_than_they_may() -> None:
    slots = oblong(1.2, 0.5, 10)
    few = planks(slots)
    sheet = SheetParams(sheet_width=0.5, sheet_height=0.3, margin=0.01)
    many = planks(slots, sheet)
    assert len(many) > len(few) >= 4  # corners of a right angle end planks
    for body, _ in many:
        box = np.asarray(body.minimum_rotated_rectangle.exterior.coords)
        sides = sorted(np.linalg.norm(np.diff(box[:3], axis=0), axis=1))
        assert sides[1] <= np.hypot(0.48, 0.28) and sides[0] <= 0.28
    for _, rows in few:
        way = np.diff(slots[rows].mean(axis=1), axis=0)
        turns = np.diff(np.unwrap(np.arctan2(way[:, 1], way[:, 0])))
        assert np.abs(turns).sum() <= frame.MAX_PLANK_TURN + 1e-9


@pytest.mark.parametrize(
    ("slots", "words"),
    [
        (np.array([slot(0.0, 0.0), slot(0.3, 0.0)]), "at least 3 feet"),
        (np.array([slot(0.0, 0.0), slot(0.03, 0.0), slot(0.015, 0.02)]), "has no hole"),
        (np.array([slot(0.03 * np.cos(a), 0.03 * np.sin(a), a + np.pi / 2) for a in np.arange(8) * np.pi / 4]), "too near to each other to cut"),
    ],
)  # fmt: skip
def test_slots_that_make_no_frame_are_refused(slots: np.ndarray, words: str) -> None:
    with pytest.raises(FlexMapsError, match=words):
        planks(slots)


def test_of_nine_points_no_exchange_of_two_steps_makes_the_path_shorter() -> None:
    """A path that no reversal shortens, which is what 2-opt promises."""
    points = np.random.default_rng(5).normal(size=(9, 2))
    path = points[frame.shortest_closed_path(points)]

    def length(order: np.ndarray) -> float:
        return float(np.linalg.norm(np.roll(order, -1, axis=0) - order, axis=1).sum())

    for i, j in itertools.combinations(range(9), 2):
        other = np.concatenate([path[: i + 1], path[i + 1 : j + 1][::-1], path[j + 1 :]])
        assert length(other) >= length(path) - 1e-9
