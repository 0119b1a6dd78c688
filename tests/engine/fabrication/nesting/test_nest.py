"""Nesting: exact distances by shapely, never more sheets than the quick packing, ESC, rotation limits, large panels."""

import time
from dataclasses import replace

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.fabrication.nesting import nest as nesting
from flexmaps.engine.fabrication.nesting import sheet_search
from flexmaps.engine.fabrication.nesting.outlines import grow_outline
from flexmaps.engine.fabrication.nesting.packing import Packing, fill_ratio, pack, used_length
from flexmaps.engine.fabrication.nesting.sheet_search import SheetSearch
from flexmaps.engine.fabrication.nesting.strip import PackedStrip, StripTask, pack_strip
from flexmaps.engine.params import SheetParams
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.workers import WorkerDied, Workers
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
        monkeypatch.setattr(sheet_search, "FIRST_SECONDS", factor)
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
    monkeypatch.setattr(sheet_search, "FIRST_SECONDS", 5)  # the machine may be busy
    packing = nesting.nest(shapes, params)
    assert len(packing.sizes) == len(rough.sizes) == 2
    assert np.bincount(packing.sheet).min() < np.bincount(rough.sheet).min()
    _check(shapes, packing, params)


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
    monkeypatch.setattr(nesting, "can_search", lambda: False)
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
    simple = shapely.Polygon(grow_outline(np.array(comb), 0.001, 0.005))
    assert len(simple.exterior.coords) - 1 <= 4 * 7  # a rectangle with four rounded corners, not 42 corners
    # a little more than all that lies so near to the box, whose corners the arcs round off
    assert simple.contains(outline.buffer(0.001, quad_segs=64))
    assert simple.area == pytest.approx(outline.envelope.buffer(0.001, quad_segs=64).area, rel=0.01)


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
    assert fill_ratio(found, [square] * 3, 0.03, 0.005) == pytest.approx(wanted)


def _search(shapes, params, answers=None):
    """Return a search whose strips are given by hand, as long as ``answers`` says of a set of panels, in metres."""
    search = SheetSearch(shapes, params, Workers(2), SILENT)
    if answers is not None:

        def strips(tasks):
            sets = [frozenset(i for i, *_ in task.items) for task in tasks]
            return [PackedStrip(answers(s), dict.fromkeys(s, (0.0, (0.0, 0.0)))) for s in sets]

        search._pack_strips = strips
    return search


def _packed(task):
    """Return the strip that another process packs, as spyrrow must not go on in this one when it ends."""
    with Workers(1) as workers:
        return workers.submit(pack_strip, task).result()


def test_a_strip_is_as_short_as_two_squares_and_its_places_are_disjoint():
    square = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
    # much time, of which it takes what it needs: the machine may be busy
    strip = _packed(StripTask([(3, square, [0.0]), (5, square, [0.0])], 11.0, 60, 0, 20.01))
    assert strip.length == pytest.approx(20.0, abs=0.01) and set(strip.places) == {3, 5}
    assert abs(strip.places[3][1][0] - strip.places[5][1][0]) >= 10.0 - 1e-3


def test_a_strip_that_is_short_enough_ends_the_search():
    begun = time.monotonic()
    square = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
    assert _packed(StripTask([(k, square, [0.0, 30.0]) for k in range(8)], 25.0, 60, 0, 60.0)).length <= 60.0
    assert time.monotonic() - begun < 30.0


def test_it_stops_at_once_in_the_middle_of_a_search(monkeypatch):
    shapes = [_wedge(0.38, 0.17, 0.02)] * 12
    monkeypatch.setattr(sheet_search, "FIRST_SECONDS", 60)  # one call of spyrrow that would go on for a minute
    started, asked = [], []

    def start(self, original=Workers._new):
        started.append(original(self))
        return started[-1]

    def told(_, text):
        if started and not asked:
            asked.append(time.monotonic() + 0.3)

    def stopped():
        return bool(asked) and time.monotonic() > asked[0]

    monkeypatch.setattr(Workers, "_new", start)
    with pytest.raises(Cancelled):
        nesting.nest(shapes, SheetParams(nesting_seconds=1e4), Progress(told, stopped=stopped))
    assert started and not any(one.running for one in started)  # nothing is left running


def test_without_any_answer_it_ends_with_the_quick_packing(monkeypatch):
    """As where spyrrow's process dies of too little memory."""
    shapes, tasks = [_wedge(0.38, 0.17, 0.02)] * 12, []
    rough = pack(shapes, (0.6, 0.4), 0.005, 0.003)

    def call(self, function, arguments):
        tasks.append(arguments)
        raise WorkerDied("by hand")

    monkeypatch.setattr(Workers, "_called", call)
    packing = nesting.nest(shapes, SheetParams(nesting_seconds=20.0))
    np.testing.assert_array_equal(packing.shift, rough.shift)
    assert tasks


def test_of_the_sets_that_fit_the_fullest_is_taken_and_sets_that_hold_one_that_does_not_are_left_out():
    random, asked = np.random.default_rng(2), []
    shapes = [np.array([[0, 0], [w, 0], [w, h], [0, h]]) for w, h in random.uniform(0.05, 0.2, (12, 2))]

    def answers(members):
        asked.append(members)
        return 0.7 if len(asked) % 2 else 0.5

    search = _search(shapes, SheetParams(nesting_seconds=1e4), answers)
    rest = np.argsort(-search.areas).tolist()
    for seed in range(3):
        places = search._fill_sheet(rest, 0.0, np.random.default_rng(seed))
    failed, fit = asked[::2], asked[1::2]
    assert len(fit) == 3 and frozenset(places) == max(fit, key=search._total_area)
    later = search._random_sets(rest, 0.0, np.random.default_rng(9))
    assert later and not any(m <= other for m in failed for other in later) and not set(asked) & set(later)


def test_sets_that_did_not_fit_get_more_time_when_nothing_else_is_left():
    """With answers by hand that gain nothing: four squares lie two on a sheet, whatever the time."""
    square = 0.2 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    params = SheetParams(sheet_width=0.47, sheet_height=0.3, nesting_seconds=100.0)
    search = _search([square] * 4, params, lambda members: 0.9)
    rough = pack([square] * 4, (0.47, 0.3), params.margin, params.spacing)
    assert search.find_best_packing(rough) is rough
    assert search.seconds_per_set == 16  # the first power of two of which 12 are longer than the time limit


def test_panels_of_one_sheet_leave_no_less_room_than_before():
    """With answers by hand: a strip that is longer than the packing found first is not taken."""
    square = 0.2 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    rough = pack([square] * 2, (0.6, 0.4), 0.005, 0.003)
    search = _search([square] * 2, SheetParams(nesting_seconds=1.0), lambda members: 0.55)
    assert search.find_best_packing(rough) is rough


def test_a_panel_alone_takes_the_least_of_its_sheet():
    wedge = _wedge(0.3, 0.12, 0.02)
    search = SheetSearch([wedge, wedge], SheetParams(), Workers(1), SILENT)
    ((i, (turn, shift)),) = search._place_alone(1).items()
    turned = affinity.translate(affinity.rotate(shapely.Polygon(wedge), turn, origin=(0, 0), use_radians=True), *shift)
    x0, y0, x1, _ = turned.bounds
    least = min(np.ptp(affinity.rotate(shapely.Polygon(wedge), a).exterior.coords.xy[0]) for a in range(180))
    assert i == 1 and (x0, y0) == pytest.approx((0.005, 0.005)) and x1 - x0 < least + 0.002
