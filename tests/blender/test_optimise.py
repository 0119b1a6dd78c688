"""The Optimise button: what it writes, how it goes on, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import shape_keys, states, stored_report
from flexmaps.command import main as command
from flexmaps.engine.extras.choosing import prospects
from flexmaps.engine.optimisation import optimise as engine
from flexmaps.engine.spirals.fabricable import unfabricable_quads
from support.bowl import block, design, spiralled
from support.buttons import press


@pytest.fixture
def piece(add: Any, once: Any) -> Any:
    """A bowl with its spirals, ready to be optimised."""
    return once("bowl", lambda: spiralled(add))


# -- what is written ---------------------------------------------------------------------------------------------------


def test_the_piece_comes_nearer_to_its_target(piece: Any, attribute: Any) -> None:
    before = attribute(piece, "flexmaps_twist")
    piece.flexmaps.optimise.codesign = True
    piece.flexmaps.optimise.patience = 4.0  # with 1 a single step reaches the target
    press("simulate")
    start = block(piece, "equilibrium")["laplacian_rmse_mm"]
    press("optimise")
    found = block(piece)
    assert found["finished"] and found["laplacian_rmse_mm_before"] == pytest.approx(start, rel=1e-3)
    assert found["laplacian_rmse_mm"] < 0.9 * start
    assert len(found["history"]) == found["iterations"] > 1
    assert np.abs(attribute(piece, "flexmaps_twist") - before).max() > 1.0
    # what is on the mesh is a design that can be cut, and what was simulated
    made = design(piece)
    assert not len(unfabricable_quads(made))
    assert block(piece, "spirals")["twist_deg"][0] == pytest.approx(np.degrees(made.twist.min()), abs=1e-3)
    assert not states.is_stale(piece, bpy.context.scene, "optimise")
    assert shape_keys.equilibrium_key(piece.data).value == 1.0
    distance = attribute(piece, "flexmaps_distance")
    press("simulate")
    again = block(piece, "equilibrium")["laplacian_rmse_mm"]
    assert again == pytest.approx(found["laplacian_rmse_mm"], rel=1e-3, abs=1e-4)  # single precision
    assert attribute(piece, "flexmaps_distance") == pytest.approx(distance, abs=0.01)
    assert "optimise" in stored_report.read(piece.data)  # still true of these spirals
    press("spirals")
    assert "optimise" not in stored_report.read(piece.data) and "reach" not in stored_report.read(piece.data)


@pytest.mark.usefixtures("tried_prospects")
def test_pressed_again_it_goes_on(piece: Any) -> None:
    piece.flexmaps.optimise.iterations = 1
    press("optimise")
    first = block(piece)
    assert "prospects" not in block(piece, "reach")  # it is near already
    piece.flexmaps.optimise.iterations = 12
    press("optimise")
    second = block(
        piece
    )  # from the given design or, where that ends nearer, from another start: never worse than before
    assert second["laplacian_rmse_mm_before"] == pytest.approx(first["laplacian_rmse_mm"], rel=1e-3)
    assert second["laplacian_rmse_mm"] < first["laplacian_rmse_mm"]


def test_changed_settings_are_kept_to(piece: Any, attribute: Any) -> None:
    press("optimise")
    assert attribute(piece, "flexmaps_width").max() > 1.5
    piece.flexmaps.spiral.width_max, piece.flexmaps.optimise.restart = 1.4, False
    assert states.is_stale(piece, bpy.context.scene, "optimise")
    press("optimise")
    assert block(piece)["start"] == "given"
    assert attribute(piece, "flexmaps_width").max() <= 1.4 + 1e-5
    assert not len(unfabricable_quads(design(piece)))


def test_changed_seams_begin_with_the_last_spirals(piece: Any, attribute: Any) -> None:
    piece.flexmaps.optimise.iterations, piece.flexmaps.optimise.restart = 2, False
    press("optimise")
    width = attribute(piece, "flexmaps_width")
    press("merge")
    assert block(piece, "layout")["patches"] == 1
    assert "flexmaps_width" not in piece.data.attributes
    assert not bpy.ops.flexmaps.simulate.poll()  # these spirals are not the new patches'
    assert attribute(piece, "flexmaps_last_width") == pytest.approx(width)
    seen = []
    real = engine.optimise

    def optimise(start: Any, *args: Any, **named: Any) -> Any:
        seen.append(start)
        return real(start, *args, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "optimise", optimise)
        patch.setattr(prospects, "find_prospects", lambda *_, **__: {"cut": 0.5})
        press("optimise")
    assert block(piece, "reach")["prospects"] == {"cut": 0.5}
    assert seen[0].width * 1e3 == pytest.approx(width.reshape(-1, 4), abs=0.3) and len(seen[0].flat.layout.patches) == 1
    assert "flexmaps_last_width" not in piece.data.attributes
    assert len(design(piece).flat.layout.patches) == 1


@pytest.mark.parametrize("mode", [pytest.param("OBJECT", marks=pytest.mark.thorough), "EDIT"])
def test_undo_and_redo_in_one_step(piece: Any, all_of: Any, mode: str) -> None:
    name = piece.name
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.ed.undo_push(message="before")
    before = all_of(piece)
    press("optimise")
    bpy.ops.ed.undo_push(message="optimise")
    after = all_of(bpy.data.objects[name])
    bpy.ops.ed.undo()
    assert all_of(bpy.data.objects[name]) == before
    bpy.ops.ed.redo()
    assert all_of(bpy.data.objects[name]) == after


# -- refused -----------------------------------------------------------------------------------------------------------


def test_patches_and_spirals_come_first(dome: Any) -> None:
    assert not bpy.ops.flexmaps.optimise.poll()
    press("flatten")
    assert not bpy.ops.flexmaps.optimise.poll()


def too_wide(obj: Any) -> None:
    for corner in range(4 * 7, 4 * 8):
        obj.data.attributes["flexmaps_width"].data[corner].value = 15.0


def too_wound(obj: Any) -> None:
    obj.data.attributes["flexmaps_twist"].data[7].value = 4000.0


def no_number(obj: Any) -> None:
    obj.data.attributes["flexmaps_twist"].data[7].value = np.nan


def missing(obj: Any) -> None:
    obj.data.attributes.remove(obj.data.attributes["flexmaps_width"])


def edited_seams(obj: Any) -> None:
    for edge in obj.data.edges:
        edge.use_seam = True


def unconverged(obj: Any) -> None:
    obj.flexmaps.simulate.iterations = 1


def falling(obj: Any) -> None:
    obj.flexmaps.simulate.gravity = True


@pytest.mark.parametrize(
    "mistake, says, culprits",
    [
        (too_wide, "spirals were changed by hand.*press Spirals", None),
        (too_wound, "cannot be cut", [7]),
        (no_number, "cannot be cut", [7]),
        (missing, "no spirals yet", []),
        (edited_seams, "Update from seams", None),
        (unconverged, "No equilibrium was found", []),
        (falling, "nothing holds", None),
    ],
    ids=lambda x: getattr(x, "__name__", ""),
)
def test_a_mistake_is_named_and_the_design_stays(
    piece: Any, all_of: Any, mistake: Callable[[Any], None], says: str, culprits: list[int] | None
) -> None:
    mistake(piece)
    before = all_of(piece)
    with pytest.raises(RuntimeError, match=says) as error:
        bpy.ops.flexmaps.optimise()
    assert str(error.value).count("Error: ") == 1
    assert all_of(piece) == before and piece.data.shape_keys is None
    if culprits:
        assert [p.index for p in piece.data.polygons if p.select] == culprits


# -- main job ----------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_main_job_with_and_without(tmp_path: Path) -> None:
    reports = {}
    for flag in ((), ("--optimise", "--optimise-iterations", "3")):
        out = tmp_path / str(len(flag))
        arguments = [
            "shape:saddle",
            "--edge",
            "20",
            "--out",
            str(out),
            "--no-pictures",
            "--stop-after",
            "simulate",
            *flag,
        ]
        assert command.main(["run", *arguments]) == 0
        reports[bool(flag)] = json.loads((out / "report.json").read_text())
    assert "optimise" not in reports[False] and "optimise" not in reports[False]["seconds"]
    found = reports[True]["optimise"]
    assert {"method", "iterations", "laplacian_rmse_mm_before", "laplacian_rmse_mm", "at_bound", "history"} <= set(
        found
    )
    assert found["laplacian_rmse_mm"] < found["laplacian_rmse_mm_before"]
    assert reports[True]["equilibrium"]["laplacian_rmse_mm"] == pytest.approx(found["laplacian_rmse_mm"], rel=1e-3)
    assert reports[True]["spirals"] != reports[False]["spirals"]
    assert {"spirals", "mismatch_share", "advice", "remedies"} == set(reports[True]["reach"])
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "3" / "model.blend"))
    obj = bpy.data.objects["saddle"]
    assert not states.is_stale(obj, bpy.context.scene, "optimise")
    assert block(obj)["history"] == found["history"]
