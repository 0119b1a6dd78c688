"""Strips by spyrrow with answers by hand: which are given up, which count, and for how long they are looked for."""

import threading

import numpy as np
import pytest
from flexmaps.engine.fabrication.nesting import process as nest_process
from flexmaps.engine.fabrication.nesting import strips
from flexmaps.engine.params import SheetParams

pytest.importorskip("spyrrow")


def test_of_sets_tried_at_once_those_after_the_first_that_fits_are_given_up(monkeypatch):
    """With answers by hand: of three pairs the first is too long at once, the second fits after a while, the third would take for ever."""
    square = 0.2 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    begun = threading.Event()

    def solutions(self, task, seconds):
        pair = [int(name) for name, *_ in task["items"]]
        if pair == [0, 1]:
            yield nest_process.PackedStrip(0.9, {})
            return
        if pair == [2, 3]:
            begun.wait(30)
            yield nest_process.PackedStrip(0.5, {})
            return
        begun.set()
        while True:
            yield None

    monkeypatch.setattr(nest_process.Worker, "solutions", solutions)
    monkeypatch.setattr(strips, "AT_ONCE", 3)
    monkeypatch.setattr(strips, "cores", lambda: 3)
    one = strips.Strips([square] * 6, SheetParams(), 1e9, lambda: None, lambda panels: None)
    try:
        sets = [frozenset(pair) for pair in ((0, 1), (2, 3), (4, 5))]
        found = one.on_a_sheet(sets)
    finally:
        one.finish()
    assert list(found) == sets[:2] and found[sets[0]].width > 0.8 and found[sets[1]].width < 0.5


@pytest.mark.parametrize(("gain", "whole"), [(0.01, True), (0.0, False)])
def test_a_strip_that_gains_nothing_is_given_up(monkeypatch, gain, whole):
    """With answers by hand, one every tenth of a second, of which each is shorter by a share, or as long as the first."""
    square, now, told = 0.2 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), [0.0], []

    def solutions(self, task, seconds):
        for k in range(round(10 * task["seconds"])):
            now[0] += 0.1
            told.append(now[0])
            yield nest_process.PackedStrip(0.7 * (1.0 - gain) ** k, {})

    monkeypatch.setattr(nest_process.Worker, "solutions", solutions)
    monkeypatch.setattr(strips, "HOPELESS", np.inf)
    monkeypatch.setattr(strips.time, "monotonic", lambda: now[0])
    one = strips.Strips(
        [square] * 2, SheetParams(sheet_width=0.5, sheet_height=0.25), 1e9, lambda: None, lambda panels: None
    )
    try:
        (found,) = one.on_a_sheet([frozenset((0, 1))]).values()
        assert not one.fits(found)
    finally:
        one.finish()
    assert (max(told) == pytest.approx(strips.TURN)) is whole and len(told) > 2


def test_the_shortest_strip_of_several_starts_counts(monkeypatch):
    """With answers by hand: every start has its own length, and a core begins anew as long as that gains."""
    square, told = 0.2 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), []
    lengths = {7: 0.9, 8: 0.8, 9: 0.85, 10: 0.6, 11: 0.7, 12: 0.65, 13: 0.7}

    def solutions(self, task, seconds):
        told.append(task["seed"])
        yield nest_process.PackedStrip(lengths[task["seed"]], {})

    monkeypatch.setattr(nest_process.Worker, "solutions", solutions)
    monkeypatch.setattr(strips, "cores", lambda: 2)
    one = strips.Strips([square] * 2, SheetParams(seed=7), 1e9, lambda: None, lambda panels: None)
    try:
        found = one.shortest(frozenset((0, 1)), 60)
    finally:
        one.finish()
    assert sorted(told) == [
        7,
        8,
        9,
        10,
        11,
        12,
        13,
    ]  # of one core 9 and 11 gain and 13 does not, of the other 10 and not 12
    assert found.width == pytest.approx(0.6 - one.separation)


def test_no_set_is_tried_for_longer_than_there_is_time(monkeypatch):
    square, told = 0.2 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), []

    def solutions(self, task, seconds):
        told.append(task["seconds"])
        yield nest_process.PackedStrip(0.6, {})  # 590 mm are free: near enough for finer outlines

    monkeypatch.setattr(nest_process.Worker, "solutions", solutions)
    monkeypatch.setattr(strips.time, "monotonic", lambda: 100.0)
    one = strips.Strips([square] * 2, SheetParams(nesting_seconds=60.0), 103.5, lambda: None, lambda panels: None)
    try:
        one.on_a_sheet([frozenset((0, 1))])
        assert [one.harder() for _ in range(4)] == [True, True, False, False]  # up to a twelfth of 60
        one.on_a_sheet([frozenset((0, 1))])
    finally:
        one.finish()
    assert told == [1, 3, 3, 3]  # of 1 and 5, then of 16 and 16
