"""What would bring a piece nearer: which ways are tried, and which are told."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.choosing import prospects
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.optimisation.match_limits import find_limits
from flexmaps.engine.params import Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import Simulation, simulate
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking.folds import SHARP, fold_angles
from flexmaps.engine.surface.checking.topology import sides_of
from flexmaps.engine.surface.mesh import PolygonMesh


@lru_cache(maxsize=1)
def saddle() -> Simulation:
    """A saddle of evenly soft spirals, which is far from its target."""
    made = job.run(PolygonMesh.from_quads(shapes.make("saddle")), Settings(), edge=0.02, stop_after="spirals")
    assert made.flat is not None
    design = uniform_design(made.flat, Settings().spiral)
    found = simulate(design, made.mesh, MATERIALS["vero"], SimulateParams())
    assert found.target_distances["rms_percent"] > Settings().choose.match
    return found


def told(
    monkeypatch: pytest.MonkeyPatch, reached: dict[int, float], cut: float
) -> tuple[dict[str, float] | None, list[int]]:
    """What is told where a short search with so many quads held reaches so many percent, and a cut another; and what was held."""
    held: list[int] = []

    def search(*_: Any, supports: np.ndarray, **__: Any) -> Any:
        held.append(len(supports))
        if len(supports) not in reached:
            raise FlexMapsError("Nothing comes to rest")
        equilibrium = SimpleNamespace(converged=True)
        return SimpleNamespace(
            after=SimpleNamespace(target_distances={"rms_percent": reached[len(supports)]}, equilibrium=equilibrium)
        )

    monkeypatch.setattr(prospects, "optimise", search)
    monkeypatch.setattr(prospects._PredictionFilter, "gains", lambda *_: True)
    monkeypatch.setattr(
        prospects, "flatten_cuts", lambda *_, **__: None if np.isinf(cut) else SimpleNamespace(flat=None)
    )
    monkeypatch.setattr(prospects, "judge", lambda *_, **__: SimpleNamespace(rms=cut / 100.0))
    found = saddle()
    return prospects.find_prospects(found, find_limits(found), Settings()), held


def test_nothing_is_tried_within_the_match_that_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    now = saddle().target_distances["rms_percent"]
    monkeypatch.setattr(prospects, "support_options", lambda *_: pytest.fail("tried"))
    near = Settings(choose=replace(Settings().choose, match=1.01 * now))
    assert prospects.find_prospects(saddle(), find_limits(saddle()), near) is None


def test_the_best_come_first_and_what_gains_little_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, now = saddle().target, saddle().target_distances["rms_percent"]
    uses = np.bincount(mesh.quad_edges.ravel(), minlength=len(mesh.edges))
    border = np.flatnonzero((uses[mesh.quad_edges] == 1).any(axis=1))
    heights = np.sort(mesh.vertices[mesh.quads, 2], axis=1)[:, 1]
    lowest = np.flatnonzero(heights <= heights.min() + 0.25 * mesh.median_edge)
    assert len(lowest) < len(border), "else both are one"
    found, held = told(monkeypatch, {len(lowest): 0.3 * now, len(border): 0.1 * now}, 0.2 * now)
    assert held == [len(lowest), len(border)]
    assert list(found) == ["border", "cut", "lowest"] and found["lowest"] == pytest.approx(0.3 * now)
    found, _ = told(monkeypatch, {len(border): 0.95 * now}, np.inf)
    assert found == {}


def test_what_is_predicted_to_gain_little_is_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    ratios = iter([1.0, 0.3, 0.9, 0.9, 0.9, 0.9])  # the piece as it is, the first way to hold it, all others
    monkeypatch.setattr(prospects, "predict", lambda *_: next(ratios))
    held: list[int] = []

    def search(*_: Any, supports: np.ndarray, **__: Any) -> Any:
        held.append(len(supports))
        return SimpleNamespace(
            after=SimpleNamespace(target_distances={"rms_percent": 0.0}, equilibrium=SimpleNamespace(converged=True))
        )

    monkeypatch.setattr(prospects, "optimise", search)
    monkeypatch.setattr(prospects, "judge", lambda *_, **__: pytest.fail("searched"))
    assert (
        list(prospects.find_prospects(saddle(), find_limits(saddle()), Settings()) or ()) == ["lowest"]
        and len(held) == 1
    )


def test_folds_are_tried_rounded_under_the_same_seams(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y = np.meshgrid(np.arange(9.0), np.arange(7.0), indexing="ij")
    points = np.stack([x - 4.0, y, -np.abs(x - 4.0)], axis=2).reshape(-1, 3)  # a roof: its ridge turns by 90 degrees
    first = (np.arange(8)[:, None] * 7 + np.arange(6)).ravel()
    roof = PolygonMesh(points, np.stack([first, first + 7, first + 8, first + 1], axis=1).ravel(), np.full(48, 4))
    made = job.run(roof, Settings(), edge=0.02, stop_after="spirals")
    assert made.flat is not None
    found = simulate(uniform_design(made.flat, Settings().spiral), made.mesh, MATERIALS["vero"], SimulateParams())
    tried: list[tuple[Any, Any]] = []

    def judged(piece: Any, laid: Any, **_: Any) -> Any:
        tried.append((piece, laid))
        return SimpleNamespace(rms=0.001)

    monkeypatch.setattr(prospects, "judge", judged)
    monkeypatch.setattr(prospects._PredictionFilter, "gains", lambda *_: True)
    monkeypatch.setattr(prospects, "plans_with_cuts", lambda *_: iter(()))
    told = prospects.find_prospects(found, find_limits(found), Settings(), supports=np.array([0, 1])) or {}
    assert told == {"round": pytest.approx(0.1)} and len(tried) == 1
    piece, laid = tried[0]
    sharpest = [
        fold_angles(PolygonMesh.from_quads(mesh), sides_of(PolygonMesh.from_quads(mesh))).max()
        for mesh in (made.mesh, piece.mesh)
    ]
    assert sharpest[0] == pytest.approx(np.pi / 2) and sharpest[1] <= SHARP
    np.testing.assert_array_equal(laid.cut, made.flat.layout.cut)


def test_supports_that_somebody_chose_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prospects, "_distance_with_supports", lambda *_: pytest.fail("held elsewhere"))
    monkeypatch.setattr(prospects, "_distance_with_cuts", lambda *_: 0.1)
    found = saddle()
    assert list(prospects.find_prospects(found, find_limits(found), Settings(), supports=np.array([0, 1]))) == ["cut"]


@pytest.mark.thorough
def test_the_full_search_comes_as_near_as_is_told() -> None:
    from dataclasses import replace

    from flexmaps.engine.mechanics.loads import LOWEST, parse_supports
    from flexmaps.engine.optimisation.optimise import optimise

    made = job.run(PolygonMesh.from_quads(shapes.make("saddle")), Settings(), edge=0.02, stop_after="simulate")
    assert made.simulation is not None and made.limits is not None and made.design is not None
    found = prospects.find_prospects(made.simulation, made.limits, Settings()) or {}
    settings = Settings()
    for name in set(found) - {prospects.CUT}:
        mesh = made.mesh
        quads = (
            parse_supports(mesh, LOWEST) if name == LOWEST else np.unique(np.nonzero(mesh.border[mesh.quad_edges])[0])
        )
        better = optimise(
            made.design, mesh, settings.material.chosen, replace(settings.optimise), settings.simulate, supports=quads
        )
        assert better.after.target_distances["rms_percent"] <= 1.3 * found[name]
