"""Work of a search: its limit, and the rate at which a search ends."""

from __future__ import annotations

import pytest
from flexmaps.engine.optimisation.work import END_RATE, RATE_STEPS, Work


def test_work_is_counted_not_timed() -> None:
    usual, large = Work.for_spirals(1500, 1.0).limit, Work.for_spirals(6000, 1.0).limit
    assert usual is not None and large is not None
    assert 36.0 < usual < 50.0 and 120.0 < large < 180.0  # the setting promises 50 s and 3 min
    assert Work.for_spirals(12000, 0.5).limit == pytest.approx(0.5 * large)  # short searches have half as long for each
    endless, short = Work.for_spirals(100, 0.0), Work.for_spirals(100, 1.0)
    for work in (endless, short):
        work.add(1e6, 100)
    assert short.is_over and not endless.is_over


@pytest.mark.parametrize("patience", [1.0, 2.0])
def test_a_search_ends_where_its_last_steps_bring_too_little_for_their_work(patience: float) -> None:
    work = Work.for_spirals(100, patience)
    fast, slow = (factor * END_RATE / patience for factor in (1.1, 0.9))
    for steps, rate, over in (
        (RATE_STEPS, slow, False),  # too few
        (RATE_STEPS + 1, slow, True),
        (RATE_STEPS + 1, fast, False),
    ):
        work.begin_stage(1.0)
        for _ in range(steps):
            work.add(1e-3, 100)
            work.add_step(0.1 * rate)
        assert work.is_over == over
    work.add(1e-2, 100)  # what is tried without success counts too
    assert work.is_over
    work.rate_factor = 20.0  # far from the target
    assert not work.is_over


def test_a_search_does_not_begin_a_step_that_it_would_not_finish() -> None:
    def after_steps(*, proposed: bool) -> Work:
        work = Work.for_spirals(100, 1.0)
        work.begin_stage(1.0)
        for _ in range(RATE_STEPS + 1):
            work.add(1e-3, 100)
            if proposed:
                work.add_proposal()
            work.add_step(0.105 * END_RATE)  # enough for this work, but not for that of another step
        return work

    assert not after_steps(proposed=False).is_over
    work = after_steps(proposed=True)
    assert work.is_over and work.is_slow
    work.begin_stage(1.0)
    assert not work.is_over
    work.add_step(0.0)
    assert not work.is_late
    work.share = (work.seconds_done + 0.05) / work.limit
    assert work.is_late


def test_a_stage_may_add_to_the_work_beyond_the_limit() -> None:
    work = Work.for_spirals(100, 1.0)
    limit = work.limit
    assert limit is not None
    work.add(0.9 * limit / 100, 100)
    work.begin_overtime(0.5 * limit)
    work.add(0.4 * limit / 100, 100)
    assert work.seconds_done > limit and not work.is_over
    work.start_time -= 10.0 * limit  # the clock allows for busy machines in proportion
    assert not work.is_over
    work.add(0.2 * limit / 100, 100)
    assert work.is_late
