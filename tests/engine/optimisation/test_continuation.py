"""Springs that hold a piece near its target, where a search ends far from it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.optimisation import continuation
from flexmaps.engine.optimisation.gauss_newton import CANCELLED
from flexmaps.engine.optimisation.optimise import Optimisation, optimise
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import Settings
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.curvature import relief
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

SETTINGS = Settings()
VERO = MATERIALS["vero"]


@lru_cache(maxsize=2)
def hill(height: float = 0.5) -> tuple[SpiralDesign, QuadMesh]:
    """A hill of 30 quads over a square with sides of 2, whose panels rest far from it, and its spirals."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 7), np.linspace(-1.0, 1.0, 6), indexing="ij")
    z = 0.25 * height * (1.0 + np.cos(np.pi * x / 1.2)) * (1.0 + np.cos(np.pi * y / 1.2))
    corner = np.arange(x.size).reshape(x.shape)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    mesh = QuadMesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), quads)
    made = job.run(PolygonMesh.from_quads(mesh), SETTINGS, edge=0.02, stop_after="spirals")
    assert made.design is not None
    return made.design, made.mesh


class Watcher:
    """Records the progress, and its last text at every shape that is shown; may cancel at the first springs."""

    def __init__(self, *, cancels: bool):
        self.cancels, self.fractions, self.texts, self.shown = cancels, [0.0], [""], list[str]()

    def report(self, fraction: float, text: str) -> None:
        self.fractions.append(fraction)
        self.texts.append(text)
        if self.cancels and text == continuation.MESSAGE:
            raise Cancelled

    def show(self, _: object) -> None:
        self.shown.append(self.texts[-1])


@lru_cache(maxsize=2)
def fitted(*, cancels: bool) -> tuple[Optimisation, Watcher]:
    (design, mesh), watcher = hill(), Watcher(cancels=cancels)
    params, progress = (
        replace(SETTINGS.optimise, patience=0.5),
        Progress(watcher.report, shown=watcher.show),
    )
    return optimise(design, mesh, VERO, params, SETTINGS.simulate, progress=progress), watcher


def test_a_cancel_while_springs_hold_the_piece_leaves_what_was_found_without_them() -> None:
    usual, _ = fitted(cancels=True)
    assert usual.ended == CANCELLED and usual.after.loads.springs is None
    found = usual.after.target_distances["rms_percent"]
    assert continuation.FAR_PERCENT < found <= usual.before.target_distances["rms_percent"]


def test_springs_bring_a_search_on_that_ends_far_from_its_target() -> None:
    usual, (found, _) = fitted(cancels=True)[0].after, fitted(cancels=False)
    assert found.after.target_distances["rms_percent"] < 0.2 * usual.target_distances["rms_percent"]
    # nothing holds the result any more: it rests there from the target's pose too
    assert found.after.equilibrium.converged and found.after.loads.springs is None
    again = simulate(found.design, found.after.target, VERO, replace(SETTINGS.simulate, restarts=0))
    assert again.target_distances["rms_percent"] == pytest.approx(found.after.target_distances["rms_percent"], rel=0.01)


@pytest.mark.parametrize(
    "height", [pytest.param(0.1, marks=pytest.mark.thorough), pytest.param(0.12, marks=pytest.mark.thorough), 0.16]
)
def test_a_shallow_surface_does_not_stay_flat(height: float) -> None:
    design, mesh = hill(height)
    found = optimise(design, mesh, VERO, replace(SETTINGS.optimise, patience=0.5), SETTINGS.simulate)
    flat = relief(found.before.equilibrium.pose.centres)
    assert (
        flat < 0.01 * relief(mesh.centroids) and found.before.target_distances["rms_percent"] < continuation.FAR_PERCENT
    )
    assert relief(found.after.equilibrium.pose.centres) == pytest.approx(relief(mesh.centroids), rel=0.1)
    assert found.after.target_distances["rms_percent"] < 0.2 * found.before.target_distances["rms_percent"]


def test_no_springs_where_nothing_can_make_a_piece_leave_the_plane() -> None:
    design, mesh = hill(0.12)
    seamless = job.run(
        PolygonMesh.from_quads(mesh),
        replace(SETTINGS, layout=replace(SETTINGS.layout, seamless=True)),
        stop_after="spirals",
    )
    assert seamless.design is not None and design.flat.layout.cut.any() and not seamless.design.flat.layout.cut.any()
    watcher = Watcher(cancels=True)
    params, progress = replace(SETTINGS.optimise, patience=0.5), Progress(watcher.report)
    found = optimise(seamless.design, mesh, VERO, params, SETTINGS.simulate, progress=progress)
    assert found.ended != CANCELLED and relief(found.after.equilibrium.pose.centres) < 0.01 * relief(mesh.centroids)


def test_shapes_that_springs_hold_are_not_shown() -> None:
    watcher = fitted(cancels=False)[1]
    assert continuation.MESSAGE in watcher.texts and watcher.shown and continuation.MESSAGE not in watcher.shown


def test_progress_never_goes_back_and_moves_while_springs_hold_the_piece() -> None:
    watcher = fitted(cancels=False)[1]
    assert watcher.fractions == sorted(watcher.fractions)
    held = [part for part, text in zip(watcher.fractions, watcher.texts, strict=True) if text == continuation.MESSAGE]
    assert held[0] < held[-1] < watcher.fractions[-1]


def test_springs_may_add_their_shares_of_the_usual_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a search that took all of its time: with the springs, and after them, where steps are rated again."""
    work, allowed = Work.for_spirals(1500, 2.0), []
    assert work.limit is not None
    work.add(work.limit, 1)

    def note(*given: Any) -> Any:
        assert work.limit is not None
        allowed.append((work.share * work.limit - work.seconds_done, work.ends_at_rate))
        work.add(0.1, 1)
        return object()

    monkeypatch.setattr(continuation, "_allowed_percent", lambda *_: continuation.FAR_PERCENT)
    monkeypatch.setattr(continuation, "_release_from_springs", note)
    best = SimpleNamespace(point=SimpleNamespace(arm_model=object()), distance_percent=5.0)
    search: Any = SimpleNamespace(
        best=best, task=SimpleNamespace(work=work, params=SimpleNamespace(codesign=True)),
        trace=SimpleNamespace(ended="as before"), run_cycles=note, relieve_strains=lambda *_: None,
    )  # fmt: skip
    continuation.continue_far(search, Progress())
    shares = continuation.TIME_WITH_SPRINGS, continuation.TIME_AFTER_SPRINGS
    assert [seconds for seconds, _ in allowed] == pytest.approx([share * work.usual for share in shares])
    assert [rated for _, rated in allowed] == [False, True] and search.trace.ended == "as before"
