"""Nesting: exact distances by shapely, never more sheets than the quick packing, ESC, rotation limits, large panels."""

import time
from dataclasses import replace

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.fabrication.nesting import nest as nesting
from flexmaps.engine.fabrication.nesting import process as nest_process
from flexmaps.engine.fabrication.nesting import strips
from flexmaps.engine.fabrication.nesting.covering import covering
from flexmaps.engine.fabrication.nesting.outlines import grown
from flexmaps.engine.fabrication.nesting.packing import Packing, fill, pack, used_length
from flexmaps.engine.fabrication.nesting.sheet_search import NestingSearch
from flexmaps.engine.params import SheetParams
from flexmaps.engine.progress import Progress
from shapely import affinity

pytest.importorskip("spyrrow")


def _placed(shapes, packing):
    for i, shape in enumerate(shapes):
        turned = affinity.rotate(shapely.Polygon(shape), packing.rotation[i], origin=(0, 0), use_radians=True)
        yield int(packing.sheet[i]), affinity.translate(turned, *packing.shift[i])


def _check(shapes, packing, params):
    placed = list(_placed(shapes, packing))
    for n, (sheet, shape) in enumerate(placed):
        width, height = packing.sizes[sheet]
        x0, y0, x1, y1 = shape.bounds
        assert min(x0, y0, width - x1, height - y1) >= params.margin - 1e-9
        for other_sheet, other in placed[:n]:
            assert other_sheet != sheet or shape.distance(other) >= params.spacing - 1e-9


def _triangles(count, size=0.19):
    return [size * np.array([[0, 0], [1, 0], [0, 1.0]])] * count


def _wedge(long, wide, narrow):
    return np.array([[0, 0], [long, 0.5 * (wide - narrow)], [long, 0.5 * (wide + narrow)], [0, wide]])


def _nest_until(reached, shapes, params, monkeypatch):
    """Nest with more and more time, in all and for a set of panels, until a packing satisfies ``reached``.

    How far a search comes in a second depends on what else the machine does.
    """
    for factor in (1, 4, 16, 64):
        monkeypatch.setattr(strips, "TURN", factor)
        packing = nesting.nest(shapes, replace(params, nesting_seconds=factor * params.nesting_seconds))
        if reached(packing):
            break
    return packing


def test_triangles_go_in_pairs():
    params = SheetParams(sheet_width=0.4, sheet_height=0.2, margin=0.0, spacing=0.002)
    shapes = _triangles(4)  # two squares of pairs, side by side
    packing = nesting.nest(shapes, params)
    assert len(packing.sizes) == 1
    _check(shapes, packing, params)


def test_fewer_sheets_than_the_quick_packing(monkeypatch):
    # slanted triangles: quarter turns cannot lay them side against side
    params = SheetParams(sheet_width=0.4, sheet_height=0.3, margin=0.005, spacing=0.002)
    shapes = [0.19 * np.array([[0, 0], [1, 0.1], [0.3, 0.8]])] * 9
    assert len(pack(shapes, (0.4, 0.3), 0.005, 0.002).sizes) == 3
    packing = _nest_until(lambda found: len(found.sizes) == 2, shapes, params, monkeypatch)
    assert len(packing.sizes) == 2
    _check(shapes, packing, params)


def test_one_sheet_leaves_a_longer_rest_than_the_quick_packing(monkeypatch):
    params = SheetParams(spacing=0.003, nesting_seconds=1.5)
    shapes = [_wedge(0.3, 0.12, 0.02)] * 5
    rough = pack(shapes, (0.6, 0.4), 0.005, 0.003)
    wanted = 0.95 * used_length(rough, shapes, 0)
    packing = _nest_until(lambda found: used_length(found, shapes, 0) < wanted, shapes, params, monkeypatch)
    assert used_length(packing, shapes, 0) < wanted
    _check(shapes, packing, params)


@pytest.mark.thorough
def test_on_as_few_sheets_as_can_be_the_last_bears_less_than_the_quick_packing_leaves_there(monkeypatch):
    params = SheetParams(sheet_width=0.4, sheet_height=0.3, margin=0.005, spacing=0.002, nesting_seconds=30.0)
    # with half of the spacing a little more than a sheet
    shapes = [0.19 * np.array([[0, 0], [1, 0.1], [0.3, 0.8]])] * 8
    rough = pack(shapes, (0.4, 0.3), 0.005, 0.002)
    monkeypatch.setattr(strips, "TURN", 5)  # the machine may be busy
    packing = nesting.nest(shapes, params)
    assert len(packing.sizes) == len(rough.sizes) == 2
    assert np.bincount(packing.sheet).min() < np.bincount(rough.sheet).min()
    _check(shapes, packing, params)


def test_where_sheets_are_as_few_as_can_be_the_search_goes_on(monkeypatch):
    """With answers by hand that gain nothing: four squares lie two on a sheet, and other orders are tried all the same."""
    square = 0.2 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    params = SheetParams(sheet_width=0.47, sheet_height=0.3, nesting_seconds=1e4)
    rough = pack([square] * 4, (0.47, 0.3), params.margin, params.spacing)
    assert np.bincount(rough.sheet).tolist() == [2, 2]
    asked = []

    def fill(self, rng, packing):
        asked.append(self.spent())
        return packing

    monkeypatch.setattr(NestingSearch, "fill", fill)
    monkeypatch.setattr(NestingSearch, "emptied", lambda self, packing: packing)
    monkeypatch.setattr(NestingSearch, "shortened", lambda self, packing, share, fine=False: packing)
    nesting.nest([square] * 4, params)
    assert len(asked) == nesting.PATIENCE


@pytest.mark.parametrize(("seconds", "fine"), [(10.0, [False, True]), (1.0, [False])])
def test_the_last_sheet_is_drawn_together_by_finer_outlines_where_there_is_time(monkeypatch, seconds, fine):
    """With answers by hand that gain a little every time: half of the time for the simple outlines, half for the fine ones."""
    comb = [
        [0, 0],
        *([0.02 * k + x, y] for k in range(10) for x, y in ((0.0, 0.1), (0.005, 0.1), (0.005, 0.02), (0.02, 0.02))),
        [0.2, 0],
    ]
    told, now = [], [100.0]

    def solutions(self, task, seconds):
        told.append((task["seconds"], len(task["items"][0][1])))
        now[0] += task["seconds"]
        yield nest_process.PackedStrip(0.9 ** len(told) * 100.0, {})

    monkeypatch.setattr(nest_process.Worker, "solutions", solutions)
    monkeypatch.setattr(strips, "cores", lambda: 1)
    monkeypatch.setattr(strips.time, "monotonic", lambda: now[0])
    shapes, params = [np.array(comb)] * 2, SheetParams(nesting_seconds=seconds)
    packing = nesting.nest(shapes, params)
    _check(shapes, packing, params)
    half = 0.5 * (params.spacing + strips.ROUNDING)
    points = [
        len(grown(shapes[0], half, strips.BAY, strips.CORNERS)),
        len(grown(shapes[0], half, strips.FINE_BAY, strips.FINE_CORNERS)),
    ]
    assert points[0] < points[1]
    assert [count for _, count in told] == sorted(count for _, count in told)
    for one in fine:
        assert sum(took for took, count in told if count == points[one]) == seconds // len(fine)


@pytest.mark.parametrize(("rotation", "step"), [("QUARTER", 90.0), ("GRAIN", 180.0)])
def test_rotation_limits_hold(rotation, step):
    params = SheetParams(rotation=rotation, nesting_seconds=1.5)
    shapes = [_wedge(0.3, 0.12, 0.06)] * 5
    packing = nesting.nest(shapes, params)
    turns = np.degrees(packing.rotation) / step
    np.testing.assert_allclose(turns, turns.round(), atol=1e-4)
    _check(shapes, packing, params)


def test_a_panel_that_is_too_large_gets_its_own_sheet():
    params = SheetParams(nesting_seconds=2.0)
    shapes = [np.array([[0, 0], [0.8, 0], [0.8, 0.5], [0, 0.5]]), *_triangles(3)]
    packing = nesting.nest(shapes, params)
    assert packing.sizes[packing.sheet[0]].max() >= 0.81
    assert (packing.sizes[packing.sheet[1:]] == [0.6, 0.4]).all()
    _check(shapes, packing, params)


def test_quick_or_without_spyrrow_it_is_the_quick_packing(monkeypatch):
    shapes = _triangles(6)
    rough = pack(shapes, (0.6, 0.4), 0.005, 0.003)
    monkeypatch.setattr(nesting, "available", lambda: False)
    for params in (SheetParams(nesting="FAST"), SheetParams()):
        packing = nesting.nest(shapes, params)
        np.testing.assert_array_equal(packing.shift, rough.shift)


def test_it_stops_when_asked_and_ends_by_itself():
    shapes = [_wedge(0.38, 0.17, 0.02)] * 12
    asked = time.monotonic()

    def stopped():
        return time.monotonic() - asked > 0.5

    with pytest.raises(Cancelled):
        nesting.nest(shapes, SheetParams(nesting_seconds=1e4), Progress(stopped=stopped))


def test_bays_narrower_than_any_panel_are_closed_and_nothing_is_cut_off():
    comb = [[0, 0]]
    for k in range(10):
        comb += [[0.01 * k, 0.05], [0.01 * k + 0.009, 0.05], [0.01 * k + 0.009, 0.01], [0.01 * k + 0.01, 0.01]]
    comb += [[0.1, 0]]
    outline = shapely.Polygon(comb)
    simple = shapely.Polygon(grown(np.array(comb), 0.001, 0.005, 14))
    assert len(simple.exterior.coords) - 1 <= 14
    # a little more than all that lies so near to the box, whose corners the arcs round off
    assert simple.contains(outline.buffer(0.001, quad_segs=64))
    assert simple.area == pytest.approx(outline.envelope.buffer(0.001, quad_segs=64).area, rel=0.01)


@pytest.mark.parametrize(("count", "most"), [(8, 1.3), (20, 1.0), (60, 0.75)])
def test_a_polygon_with_few_corners_covers_a_wild_one(count, most):
    """Of a star with 90 corners: with 20 it is smaller than the convex hull, so that bays are left open, with 60 much smaller."""
    rng = np.random.default_rng(count)
    for _ in range(30):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 90))
        wild = rng.uniform(0.2, 1.0, 90)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if rng.integers(2):
            wild = wild[::-1]
        given, few = shapely.Polygon(wild), shapely.Polygon(covering(wild, count))
        assert given.is_valid and few.is_valid and few.exterior.is_ccw
        assert len(few.exterior.coords) - 1 <= count
        assert given.difference(few).area < 1e-12
        assert few.area < most * given.convex_hull.area
    np.testing.assert_array_equal(covering(wild, 90), wild if given.exterior.is_ccw else wild[::-1])


def test_it_stops_at_once_in_the_middle_of_a_search(monkeypatch):
    shapes = [_wedge(0.38, 0.17, 0.02)] * 12
    monkeypatch.setattr(strips, "TURN", 60)  # one call of spyrrow that would go on for a minute
    workers, asked = [], []

    def start(self, original=nest_process.Worker._start):
        original(self)
        workers.append(self.process)

    def told(_, text):
        if workers and not asked:
            asked.append(time.monotonic() + 0.3)

    def stopped():
        return bool(asked) and time.monotonic() > asked[0]

    monkeypatch.setattr(nest_process.Worker, "_start", start)
    with pytest.raises(Cancelled):
        nesting.nest(shapes, SheetParams(nesting_seconds=1e4), Progress(told, stopped=stopped))
    assert workers and all(w is None or w.poll() is not None for w in workers)  # nothing is left running


def test_without_any_answer_it_ends_with_the_quick_packing(monkeypatch):
    """As where spyrrow's process dies of too little memory, or none may be started."""
    shapes, tasks = [_wedge(0.38, 0.17, 0.02)] * 12, []
    rough = pack(shapes, (0.6, 0.4), 0.005, 0.003)
    monkeypatch.setattr(nest_process.Worker, "solutions", lambda self, task, seconds: tasks.append(task) or iter(()))
    packing = nesting.nest(shapes, SheetParams(nesting_seconds=1e4))
    np.testing.assert_array_equal(packing.shift, rough.shift)
    assert tasks


def test_the_fullest_sheet_that_is_known_is_kept_where_nothing_fuller_fits(monkeypatch):
    """With answers by hand: every set fits at first, none later. What covers most is not tried first, for it hardly ever fits."""
    random, asked = np.random.default_rng(2), []
    shapes = [np.array([[0, 0], [w, 0], [w, h], [0, h]]) for w, h in random.uniform(0.05, 0.2, (12, 2))]
    one = NestingSearch(shapes, SheetParams(nesting_seconds=1e4), Progress())

    def area(members):
        return float(one.area[list(members)].sum())

    def on_a_sheet(sets):
        asked.append(sets)
        fits = len(asked) == 1
        return {m: nest_process.PackedStrip(0.5, {i: (0.0, np.zeros(2)) for i in m}) if fits else None for m in sets}

    monkeypatch.setattr(one.strips, "on_a_sheet", on_a_sheet)
    try:
        rest = np.argsort(-one.area).tolist()
        drawn = one._random_sets(rest, 0.0, np.random.default_rng(0))
        first = one._fullest(rest, 0.0, np.random.default_rng(0))
        again = one._fullest(rest, 0.0, np.random.default_rng(1))
    finally:
        one.finish()
    assert frozenset(first.places) in asked[0] and area(asked[0][0]) < max(map(area, drawn))
    assert len(asked) > 1 and all(area(members) > first.area for sets in asked[1:] for members in sets)
    assert again is first


def test_what_makes_two_sets_as_long_is_not_tried_again(monkeypatch):
    """With answers by hand: whatever holds the first two panels is 700 mm long, other sets are longer than a sheet too."""
    square, asked = 0.2 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), []
    one = NestingSearch([square] * 6, SheetParams(nesting_seconds=1e4), Progress())

    def on_a_sheet(sets):
        asked.extend(sets)
        return {m: nest_process.PackedStrip(0.7 if {0, 1} <= m else 0.7 + 0.01 * sum(m), {}) for m in sets}

    monkeypatch.setattr(one.strips, "on_a_sheet", on_a_sheet)
    tries = [frozenset(m) for m in ((0, 1, 2), (0, 2, 3), (0, 1, 3), (0, 1, 4), (0, 2, 4))]
    try:
        for members in tries:
            one._try([members])
    finally:
        one.finish()
    assert asked == [tries[0], tries[1], tries[2], tries[4]]
    assert all(one.known[members] is None for members in tries)


def test_what_has_no_place_when_time_is_up_is_laid_the_quick_way():
    shapes = [_wedge(0.38, 0.17, 0.02)] * 12
    params = SheetParams(nesting_seconds=0.01)
    packing = nesting.nest(shapes, params)
    assert len(packing.sizes) <= len(pack(shapes, (0.6, 0.4), 0.005, 0.003).sizes)
    _check(shapes, packing, params)


def test_fill_counts_the_last_sheet_as_far_as_it_is_used():
    square = np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]])
    shift = np.array([[0.005, 0.005], [0.13, 0.005], [0.005, 0.005]])
    found = Packing(np.array([0, 0, 1]), np.zeros(3), shift, np.array([[0.24, 0.12], [0.24, 0.12]]))
    wanted = 0.03 / (0.24 * 0.12 + 0.11 * 0.12)
    assert fill(found, [square] * 3, 0.03, 0.005) == pytest.approx(wanted)


def test_a_sheet_is_emptied_where_the_others_have_room(monkeypatch):
    """Triangles beside wedges: each has room in the slanted gap that no quarter turn fits."""
    params = SheetParams(sheet_width=0.4, sheet_height=0.3, margin=0.005, spacing=0.002, nesting_seconds=30.0)
    shapes = [0.19 * np.array([[0, 0], [1, 0.1], [0.3, 0.8]])] * 9
    rough = pack(shapes, (0.4, 0.3), 0.005, 0.002)

    def emptier(packing):
        fewest = [np.bincount(one.sheet).min() for one in (packing, rough)]
        return len(packing.sizes) < len(rough.sizes) or fewest[0] < fewest[1]

    for turn in (1, 5):  # the machine may be busy
        monkeypatch.setattr(strips, "TURN", turn)
        one = NestingSearch(shapes, params, Progress())
        try:
            packing = one.emptied(rough)
        finally:
            one.finish()
        if emptier(packing):
            break
    assert emptier(packing)
    _check(shapes, packing, params)
