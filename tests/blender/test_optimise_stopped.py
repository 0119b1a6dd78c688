"""An optimisation while it runs, and stopped at any moment."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import equilibrium, mesh, settings, stored_report
from flexmaps.engine.display import arrange, raster, solids
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.spirals.fabricable import unfabricable_quads
from flexmaps.operators import optimise as operators
from support.bowl import block, design, spiralled
from support.buttons import press


@pytest.fixture
def piece(add: Any, once: Any) -> Any:
    """A bowl with its spirals, ready to be optimised."""
    return once("bowl", lambda: spiralled(add))


class Button(operators.Optimise.__mro__[1]):  # type: ignore[misc, name-defined]  # ContinuedStage without bpy.types.Operator
    """The operator without Blender's part of it."""

    bl_label, bl_idname = "Optimise", operators.Optimise.bl_idname
    required_output, reads_loads = operators.Optimise.required_output, operators.Optimise.reads_loads
    continuation, finish, after_write = (
        getattr(operators.Optimise, name) for name in ("continuation", "finish", "after_write")
    )

    def __init__(self) -> None:
        self.said: list[tuple[str, str]] = []

    def report(self, kind: set[str], text: str) -> None:
        self.said.append((*kind, text))


def in_background(obj: Any, enough: Callable[[Any], bool]) -> tuple[Button, background.Job]:
    """Press it, and stop it as soon as ``enough`` of it was seen; what it has made is written."""
    button = Button()
    running = background.Job("Optimise", button._read(bpy.context))
    running.start()
    try:
        while not running.is_finished and not enough(running):
            time.sleep(0.001)
    finally:
        running.end()
    if running.error is None:
        for _ in button._write(bpy.context, running.result):
            pass
    return button, running


def test_stopping_keeps_the_best_so_far(piece: Any) -> None:
    button, running = in_background(
        piece, lambda job: job.intermediate is not None and len(job.intermediate.history) > 2
    )
    found = block(piece)
    assert not found["finished"] and "best so far" in button.said[-1][1]
    assert found["laplacian_rmse_mm"] < found["laplacian_rmse_mm_before"]
    assert not len(unfabricable_quads(design(piece)))
    assert running.intermediate.history[-1][0] >= running.intermediate.history[0][0] > 0.0
    press("optimise")
    assert block(piece)["finished"]
    assert block(piece)["laplacian_rmse_mm"] <= found["laplacian_rmse_mm"] * (1 + 1e-3)


def test_who_stops_it_does_not_wait_for_the_true_panels(
    piece: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flexmaps.bridge.view import flat_panels
    from flexmaps.engine.fabrication.connectors import connect as connectors

    def unwanted(*_: Any, **__: Any) -> None:
        raise AssertionError("drawn after the stop")

    with monkeypatch.context() as patch:
        patch.setattr(connectors, "connect", unwanted)
        in_background(piece, lambda job: job.intermediate is not None and len(job.intermediate.history) > 2)
    (plain,) = flat_panels.panels_of(piece)
    # they stand where the new spirals are, and tell that they are not the last word
    assert plain[flat_panels.FINGERPRINT_KEY] == flat_panels.NO_CONNECTORS
    assert not [o for o in bpy.data.objects if o.get("flexmaps_kind") == "outlines"]
    assert "slot_min_mm" not in block(piece, "spirals") and "reach" not in stored_report.read(piece.data)
    light = solids.make_light_solids(design(piece), arrange.arrange_patches(design(piece).flat))
    assert len(plain.data.vertices) == len(light.vertices)
    monkeypatch.setattr(raster, "SUBPIXELS", 1)  # rough edges, which is quicker
    press("report")  # with what is known
    piece.flexmaps.sheet.nesting = "FAST"
    piece.flexmaps.export.folder = str(tmp_path)
    press("export")
    (drawn,) = flat_panels.panels_of(piece)
    assert drawn[flat_panels.FINGERPRINT_KEY] != flat_panels.NO_CONNECTORS
    assert [o for o in bpy.data.objects if o.get("flexmaps_kind") == "outlines"]


@pytest.mark.thorough
def test_stopped_at_any_moment_the_scene_is_sound(piece: Any, all_of: Any, tmp_path: Path) -> None:
    piece.flexmaps.optimise.iterations = 6
    began = time.monotonic()
    in_background(piece, lambda running: False)
    whole = time.monotonic() - began
    random = np.random.default_rng(5)
    kept = 0
    for k in range(20):
        piece.flexmaps.optimise.smoothness = 0.01 * (k % 3)  # so that there is always something to do
        before, start, wait = all_of(piece), time.monotonic(), random.uniform(0.0, whole)
        _, running = in_background(piece, lambda _, until=start + wait: time.monotonic() > until)
        if running.error is not None:
            assert isinstance(running.error, Cancelled)
            assert all_of(piece) == before
        else:
            kept += 1
        assert background.current_job() is None
        assert not piece.data.validate(verbose=False)
        assert not len(unfabricable_quads(design(piece)))
        assert len(equilibrium.simulated_keys(piece.data)) == 1
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "piece.blend"), copy=True)
    assert kept > 0


def test_a_running_optimisation_touches_nothing(piece: Any, all_of: Any) -> None:
    before = all_of(piece)
    surface = mesh.read_surface(piece, bpy.context.scene)
    work = Button().prepare(surface, settings.read(piece.flexmaps, ObjectSettings))
    running = background.Job("Optimise", work)
    running.start()
    running.end()
    assert all_of(piece) == before
