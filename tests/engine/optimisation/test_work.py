"""Work of a search: its limit, and the rate at which a search ends."""

from __future__ import annotations

import pytest
from flexmaps.engine.optimisation.work import END_RATE, RATED_STEPS, Work


def test_work_is_counted_not_timed() -> None:
    usual, large = Work.for_spirals(1500, 1.0).limit, Work.for_spirals(6000, 1.0).limit
    assert usual is not None and large is not None
    assert 36.0 < usual < 50.0 and 120.0 < large < 180.0  # the setting promises 50 s and 3 min
    assert Work.for_spirals(12000, 0.5).limit == pytest.approx(0.5 * large)  # short searches have half as long for each
    endless, short = Work.for_spirals(100, 0.0), Work.for_spirals(100, 1.0)
    for work in (endless, short):
        work.add(1e6, 100)
    assert short.over and not endless.over


@pytest.mark.parametrize("patience", [1.0, 2.0])
def test_a_search_ends_where_its_last_steps_bring_too_little_for_their_work(patience: float) -> None:
    work = Work.for_spirals(100, patience)
    fast, slow = (factor * END_RATE / patience for factor in (1.1, 0.9))
    for steps, rate, over in (
        (RATED_STEPS, slow, False),  # too few
        (RATED_STEPS + 1, slow, True),
        (RATED_STEPS + 1, fast, False),
    ):
        work.begin(1.0)
        for _ in range(steps):
            work.add(1e-3, 100)
            work.note(0.1 * rate)
        assert work.over == over
    work.add(1e-2, 100)  # what is tried without success counts too
    assert work.over
    work.factor = 20.0  # far from the target
    assert not work.over


def test_a_search_does_not_begin_a_step_that_it_would_not_finish() -> None:
    def after_steps(*, proposed: bool) -> Work:
        work = Work.for_spirals(100, 1.0)
        work.begin(1.0)
        for _ in range(RATED_STEPS + 1):
            work.add(1e-3, 100)
            if proposed:
                work.note_proposal()
            work.note(0.105 * END_RATE)  # enough for this work, but not for that of another step
        return work

    assert not after_steps(proposed=False).over
    work = after_steps(proposed=True)
    assert work.over and work.slow
    work.begin(1.0)
    assert not work.over
    work.note(0.0)
    assert not work.late
    work.share = (work.done + 0.05) / work.limit
    assert work.late


def test_a_stage_may_add_to_the_work_beyond_the_limit() -> None:
    work = Work.for_spirals(100, 1.0)
    limit = work.limit
    assert limit is not None
    work.add(0.9 * limit / 100, 100)
    work.extend(0.5 * limit)
    work.add(0.4 * limit / 100, 100)
    assert work.done > limit and not work.over
    work.began -= 10.0 * limit  # the clock allows for busy machines in proportion
    assert not work.over
    work.add(0.2 * limit / 100, 100)
    assert work.late
