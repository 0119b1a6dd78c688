"""Progress of a search for layouts: its parts follow each other and fill the whole."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from flexmaps.engine.extras.choosing import choose
from flexmaps.engine.progress import Progress


def reporter() -> tuple[Progress, list[float]]:
    seen: list[float] = []
    return Progress(lambda fraction, _: seen.append(fraction)), seen


def whole(*given: Any) -> bool:
    """Work that reports its begin and its end to the progress that it is given."""
    (progress,) = (one for one in given if isinstance(one, Progress))
    progress(0.0)
    progress(1.0)
    return True


@pytest.mark.parametrize("proved", [{}, {"a": object()}])
def test_the_parts_of_a_search_follow_each_other_from_0_to_1(monkeypatch: pytest.MonkeyPatch, proved: Any) -> None:
    for name in ("_flatten_candidates", "_improve_best", "_fill_gaps", "_run_long_searches"):
        monkeypatch.setattr(choose, name, whole)
    search: Any = SimpleNamespace(proved=proved, start=None, left=1.0, ranking=[], next=lambda _: [], judge=whole)
    progress, seen = reporter()
    first: Any = object()
    choose._search_layouts(search, first, progress)
    begun, ended = seen[::2], seen[1::2]
    assert len(begun) == 4 + choose.ROUNDS
    assert begun == pytest.approx([0.0, *ended[:-1]]) and ended[-1] == pytest.approx(1.0)


@pytest.mark.parametrize("goal", ["panels", "match"])
def test_progress_of_a_turn_of_changes_rises_from_0_to_1(monkeypatch: pytest.MonkeyPatch, goal: str) -> None:
    best: Any = SimpleNamespace(laid=SimpleNamespace(panels=3))
    monkeypatch.setattr(choose, "propose_changes", lambda *_, **__: iter([object()] * 3))
    monkeypatch.setattr(choose, "make_variants", lambda *_: iter([]))

    def together(work: Any, things: Any, progress: Progress, text: str) -> list[None]:
        whole(progress)
        return [None for _ in things]

    search: Any = SimpleNamespace(
        ranking=[best], key=lambda _: 0.0, left=1.0, params=SimpleNamespace(goal=goal, panels=3), holds=lambda _: False,
        piece=None, progress_text="", together=together, judge=whole,
    )  # fmt: skip
    progress, seen = reporter()
    first: Any = object()
    assert not choose._improve_best(search, first, progress)
    assert seen == sorted(seen) and (seen[0], seen[-1]) == (0.0, 1.0)
