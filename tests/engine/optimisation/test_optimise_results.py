"""Results of a search: coordinates at their bounds, and which design counts after a cancel."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.optimisation import optimise


def test_coordinates_at_a_bound_have_its_sign() -> None:
    space = SimpleNamespace(by_spiral=lambda x: x.reshape(2, 3))
    point: Any = SimpleNamespace(x=np.array([0.0, 0.5, 1.0, 0.01, 0.99, 0.0]), problem=SimpleNamespace(space=space))
    nothing: Any = None
    found = optimise.Optimisation(nothing, nothing, nothing, "given", point, "reached")
    np.testing.assert_array_equal(found.at_bound, [[-1, 0, 1], [0, 0, -1]])


@pytest.mark.parametrize(
    ("stored", "latest", "chosen", "made"),
    [(1.01, 1.0, 1.01, 0), (1.05, 1.0, 1.0, 1), (0.9, 1.0, 0.9, 0), (None, 1.0, 1.0, 1)],
)
def test_the_latest_point_becomes_a_design_only_if_it_is_better_than_the_stored_one(
    monkeypatch: pytest.MonkeyPatch, stored: float | None, latest: float, chosen: float, made: int
) -> None:
    """Merits within two percent count as equal."""

    def point(merit: float) -> Any:
        return SimpleNamespace(merit=lambda _: merit)

    def result(_: Any, point: Any, __: float) -> Any:
        return point

    calls: list[Any] = []
    monkeypatch.setattr(optimise, "SimulatedResult", result)
    monkeypatch.setattr(optimise.codesign, "to_design", lambda *given: calls.append(given) or object())
    best = None if stored is None else SimpleNamespace(value=stored, design=object(), point=point(stored))
    search: Any = SimpleNamespace(
        results=[] if best is None else [best],
        best=best,
        max_distance=np.inf,
        task=SimpleNamespace(simulate_point=lambda *_: object()),
    )
    design: Any = object()
    found: Any = optimise._best_so_far(search, point(latest), design)
    assert found.merit(0.0) == chosen and len(calls) == made
