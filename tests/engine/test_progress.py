"""Progress of work whose number of steps is unknown, and of work within a step."""

from __future__ import annotations

from itertools import islice

import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.progress import SILENT, Progress


def test_steps_of_unknown_number_share_what_is_left() -> None:
    told: list[float] = []
    whole = Progress(lambda done, _: told.append(done)).part(0.2, 1.0)
    for part in islice(whole.shares(0.25), 40):
        part(0.0)
        part(1.0)
    begun, ended = told[::2], told[1::2]
    assert begun[0] == pytest.approx(0.2) and begun[1:] == pytest.approx(ended[:-1])
    left = [1.0 - done for done in ended]
    assert left == pytest.approx([0.75 * (1.0 - done) for done in begun]) and min(left) > 0.0


def test_work_within_a_step_keeps_its_words_and_can_be_cancelled() -> None:
    told: list[tuple[float, str]] = []
    shown: list[int] = []
    stop = False
    outer = Progress(lambda *given: told.append(given), lambda: stop, 0.0, 0.5, shown.append)
    inner = outer.saying("Step")
    inner(0.5, "Something else")
    inner.show(1)
    assert told == [(0.25, "Step")] and not shown
    stop = True
    with pytest.raises(Cancelled):
        inner(1.0)
    SILENT.saying("Step")(1.0)


def test_every_step_begins_with_a_capital() -> None:
    """Whether it is told directly, for each of several things, or in place of other words."""
    told: list[str] = []
    outer = Progress(lambda _, text: told.append(text))
    outer(0.0, "room between the arms")
    list(outer.each([1], "labels"))
    list(outer.batches(1, 1, "near the joints"))
    outer.at(0.5, "packing")(0.0)
    outer.saying("outlines")(1.0, "something else")
    outer(1.0)
    assert told == ["Room between the arms", "Labels", "Near the joints", "Packing", "Packing", "Outlines", ""]
