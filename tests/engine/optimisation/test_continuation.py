"""Springs that hold a piece near its target, where a search ends far from it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.optimisation import continuation
from flexmaps.engine.optimisation.optimise import Optimisation, optimise
from flexmaps.engine.optimisation.optimisers import CANCELLED
from flexmaps.engine.params import Settings
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

SETTINGS = Settings()
VERO = MATERIALS["vero"]


@lru_cache(maxsize=1)
def hill() -> tuple[SpiralDesign, QuadMesh]:
    """A hill of 30 quads, whose panels rest far from it, and its spirals."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 7), np.linspace(-1.0, 1.0, 6), indexing="ij")
    z = 0.125 * (1.0 + np.cos(np.pi * x / 1.2)) * (1.0 + np.cos(np.pi * y / 1.2))
    corner = np.arange(x.size).reshape(x.shape)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    mesh = QuadMesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), quads)
    made = job.run(PolygonMesh.from_quads(mesh), SETTINGS, edge=0.02, stop_after="spirals")
    assert made.design is not None
    return made.design, made.mesh


def fitted(progress: Progress = SILENT) -> Optimisation:
    design, mesh = hill()
    return optimise(design, mesh, VERO, replace(SETTINGS.optimise, patience=0.1), SETTINGS.simulate, progress=progress)


def test_springs_bring_a_search_on_that_ends_far_from_its_target(monkeypatch: pytest.MonkeyPatch) -> None:
    found = fitted()
    with monkeypatch.context() as patch:
        patch.setattr(continuation, "FAR_PERCENT", np.inf)
        usual = fitted()
    assert usual.after.match["rms_percent"] > continuation.FAR_PERCENT
    assert found.after.match["rms_percent"] < 0.2 * usual.after.match["rms_percent"]
    # nothing holds the result any more: it rests there from the target's pose too
    assert found.after.equilibrium.converged and found.after.loads.springs is None
    again = simulate(found.design, found.after.target, VERO, replace(SETTINGS.simulate, restarts=0))
    assert again.match["rms_percent"] == pytest.approx(found.after.match["rms_percent"], rel=0.01)


def test_a_cancel_while_springs_hold_the_piece_leaves_what_was_found_without_them() -> None:
    def report(_: float, text: str) -> None:
        if text.startswith(continuation.HELD):
            raise Cancelled

    found = fitted(Progress(report))
    assert found.ended == CANCELLED and found.after.loads.springs is None
    assert found.after.match["rms_percent"] <= found.before.match["rms_percent"]


def test_shapes_that_springs_hold_are_not_shown() -> None:
    texts, shown = [""], []
    fitted(Progress(lambda _, text: texts.append(text), shown=lambda step: shown.append(texts[-1])))
    assert continuation.HELD in texts and len(shown) > 2 and continuation.HELD not in shown
