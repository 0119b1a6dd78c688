"""Time that is left: of even work exactly, of work that slows down nearly, and never before anybody can know."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.progress import Progress
from flexmaps.engine.remaining import FIRST_SECONDS, FIRST_SHARE, RemainingTime, format_seconds


def test_of_even_work_it_is_exact() -> None:
    left = RemainingTime()
    for now in np.arange(0.0, 60.0, 0.1):
        left.report(now, now / 100.0)
        found = left.seconds(now)
        if now < FIRST_SECONDS or left.seen[-1][1] < FIRST_SHARE:
            assert found is None
        else:
            assert found == pytest.approx(100.0 - now, rel=0.02)
    assert len(left.seen) <= 400


def test_work_that_slows_down_is_seen_to() -> None:
    """Half of the work in a tenth of the time: later on the pace of now counts."""
    left = RemainingTime()
    for now in np.arange(0.0, 60.0, 0.5):
        left.report(now, now / 20.0 if now < 10.0 else 0.5 + (now - 10.0) / 180.0)
    found = left.seconds(60.0)
    assert found is not None and abs(np.log(found / 40.0)) < np.log(1.7)
    left.report(60.0, 0.2)  # a report that goes back is none
    assert left.seconds(60.0) == found


def test_nothing_is_told_where_nothing_is_done() -> None:
    left = RemainingTime()
    assert left.seconds(100.0) is None
    left.report(1.0, 0.0)
    assert left.seconds(100.0) is None


def test_times_are_said_as_people_say_them() -> None:
    assert [format_seconds(s) for s in (0.0, 3.0, 12.0, 58.0, 100.0, 5000.0, 6000.0)] == [
        "5 s",
        "5 s",
        "10 s",
        "1 min",
        "2 min",
        "83 min",
        "1.7 h",
    ]


def test_the_bar_of_a_search_moves_on_where_it_takes_all_of_its_time() -> None:
    shown: list[float] = []
    work = Work(limit=8.0)
    told = work.with_work_fraction(Progress(report=lambda share, _: shown.append(share)))
    for seconds in np.arange(0.0, 8.5, 0.5):
        work.seconds_done = seconds
        told(0.0, "")
    assert shown[0] == 0.0 and (np.diff(shown) > 0.0).all() and shown[-1] == pytest.approx(1.0)
    assert shown[2] == pytest.approx(0.5)  # half after an eighth of the time, as most searches end before half of it


def test_the_bar_of_a_search_does_not_fall_where_its_time_is_extended() -> None:
    shown: list[float] = []
    work = Work(limit=10.0)
    told = work.with_work_fraction(Progress(report=lambda share, _: shown.append(share)).rising())
    for seconds in (0.0, 5.0, 10.0):
        work.seconds_done = seconds
        told(0.0, "")
    work.begin_overtime(10.0)
    for seconds in (10.0, 15.0, 20.0):
        work.seconds_done = seconds
        told(0.0, "")
    assert (np.diff(shown) >= 0.0).all() and shown[-1] == pytest.approx(1.0)
    assert work.fraction == 1.0 and shown[2] == pytest.approx(1.0)
