"""The match that a layout can reach, predicted by a few linear steps."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from flexmaps.engine.extras.choosing import drawn_cuts
from flexmaps.engine.extras.choosing import predict as predict_module
from flexmaps.engine.extras.choosing.judge import CutPlan, FlatLayout, LayoutProblem, flatten_cuts
from flexmaps.engine.extras.choosing.predict import PredictionStart, predict
from flexmaps.engine.optimisation.codesign_problem import FlatPoint, FlatProblem
from flexmaps.engine.optimisation.inverse import DesignPoint
from flexmaps.engine.params import Settings
from flexmaps.engine.progress import Progress
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.mesh import QuadMesh


def sheet(height: float, across: int = 8, along: int = 6) -> QuadMesh:
    """A rectangle of 20 mm quads; its middle stands ``height`` metres above its border."""
    u, v = np.meshgrid(np.arange(across + 1), np.arange(along + 1), indexing="ij")
    z = height * np.sin(np.pi * u / across) * np.sin(np.pi * v / along)
    points = np.stack([0.02 * u, 0.02 * v, z], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(across), np.arange(along), indexing="ij")
    a = (i * (along + 1) + j).ravel()
    return QuadMesh(points, np.stack([a, a + along + 1, a + along + 2, a + 1], axis=1))


@cache
def dome() -> tuple[LayoutProblem, dict[str, FlatLayout]]:
    """A dome with three of its layouts: whole and halved both ways."""
    piece = LayoutProblem(sheet(0.03), Settings())
    ideas = {"whole": np.zeros(len(piece.mesh.edges), dtype=bool)}
    for name, cut in drawn_cuts.equal_part_cuts(piece.mesh, 2, []):
        ideas[f"{name}, {int(cut.sum())} edges"] = cut
    laid = {name: flatten_cuts(piece, CutPlan(cut, name)) for name, cut in ideas.items()}
    return piece, {name: one for name, one in laid.items() if one is not None}


def test_a_flat_sheet_is_matched() -> None:
    piece = LayoutProblem(sheet(0.0), Settings())
    laid = flatten_cuts(piece, CutPlan(np.zeros(len(piece.mesh.edges), dtype=bool), "whole"))
    assert laid is not None and predict(piece, laid.flat) < 1e-6


def test_nothing_is_expected_of_a_layout_whose_quads_have_no_room() -> None:
    """Arms three times as wide as a quad leave none; what is tried beside a finished search must not end it with an error."""
    piece, layouts = dome()
    spiral = replace(piece.settings.spiral, width_min=0.06, width_max=0.08)
    crowded = replace(piece, settings=replace(piece.settings, spiral=spiral))
    assert predict(crowded, next(iter(layouts.values())).flat) == np.inf


def test_no_search_begins_nearer_than_is_predicted() -> None:
    """The design that prediction begins with, simulated by itself, lies no nearer than the prediction."""
    piece, layouts = dome()
    for laid in layouts.values():
        start = PredictionStart.from_layout(piece, laid.flat)
        design = SpiralDesign(laid.flat, piece.settings.spiral, *start.spirals)
        found = simulate(design, piece.mesh, piece.settings.material.chosen, piece.settings.simulate)
        near = predict(piece, laid.flat, start)
        assert 0.0 < near < 0.01 * found.target_distances["rms_percent"]


def test_a_step_out_of_the_limits_of_flat_shapes_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    piece, layouts = dome()
    near = [predict(piece, laid.flat) for laid in layouts.values()]

    def beyond(self: FlatProblem, x: np.ndarray, inner: DesignPoint) -> np.ndarray:
        return np.concatenate([x[: self.n_spiral_x], np.resize([0.0, 1.0, 1.0], len(x) - self.n_spiral_x)])

    monkeypatch.setattr(FlatProblem, "restore_clearances", beyond)
    for laid, usual in zip(layouts.values(), near, strict=True):
        assert 0.0 < predict(piece, laid.flat) < 10.0 * usual


def test_every_further_step_shrinks_the_distance_by_the_same_share() -> None:
    piece, layouts = dome()
    shares = []
    for laid in layouts.values():
        start = PredictionStart.from_layout(piece, laid.flat)
        two, three, four = (predict(piece, laid.flat, start, further=steps) for steps in range(3))
        assert 0.0 < four <= three <= two and three / two == pytest.approx(four / three)
        shares.append(three / two)
    assert min(shares) < 1.0, "more steps bring one of these layouts nearer"


def test_further_steps_bring_nothing_once_a_fourth_of_the_design_is_at_its_bounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    piece, layouts = dome()
    start = PredictionStart.from_layout(piece, next(iter(layouts.values())).flat)
    usual = predict_module._gauss_newton_step

    def reach(laid: FlatLayout) -> list[float]:
        return [predict(piece, laid.flat, start, further=steps) for steps in (0, 2)]

    assert any(two < none for none, two in map(reach, layouts.values()))

    def to_bounds(point: FlatPoint, progress: Progress) -> np.ndarray:
        step = usual(point, progress)
        step[: len(step) // 3] = -point.x[: len(step) // 3]
        return step

    monkeypatch.setattr(predict_module, "_gauss_newton_step", to_bounds)
    assert all(two == none for none, two in map(reach, layouts.values()))


def test_it_hardly_matters_which_layout_gives_the_start() -> None:
    piece, layouts = dome()
    starts = [PredictionStart.from_layout(piece, laid.flat) for laid in layouts.values()]
    for laid in layouts.values():
        several = [predict(piece, laid.flat, start) for start in starts]
        assert max(several) < 1.5 * min(several)


@pytest.mark.parametrize("border", ["rim", "stubs"])
def test_borders_of_all_kinds_and_supports_are_predicted(border: str) -> None:
    piece, layouts = dome()
    settings = replace(piece.settings, spiral=replace(piece.settings.spiral, border=border))
    held = replace(piece, settings=settings, supports=np.arange(6))
    near = predict(held, layouts["whole"].flat)
    assert 0.0 < near < 0.1
