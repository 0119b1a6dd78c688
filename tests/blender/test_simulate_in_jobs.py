"""A simulation among settings and colours, in the main job and on the assembly sheet."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import equilibrium, settings, shape_keys, states, stored_report
from flexmaps.command import main as command
from flexmaps.engine.extras.assembly_sheet import sheet as assembly_sheet
from flexmaps.engine.fabrication import assembly_check as assembly_check
from flexmaps.engine.params import LoadParams, MaterialParams, ObjectSettings
from flexmaps.engine.surface import shapes
from support.arch import spiralled
from support.buttons import press


@pytest.fixture
def piece(add: Any) -> Any:
    """An arch with its spirals, ready to be simulated."""
    return spiralled(add)


# -- settings, colours, main job ---------------------------------------------------------------------------------------


def test_settings_there_and_back(dome: Any) -> None:
    wanted = replace(
        ObjectSettings(),
        material=MaterialParams(material="custom", youngs=1.23e9, poisson=0.41, density=900.0, strain_limit=0.033),
        loads=LoadParams(supports="feet", pulled="top", force_x=-0.25, force_z=1.5),
    )
    settings.write(dome.flexmaps, wanted)
    assert dome.flexmaps.material.youngs == pytest.approx(1.23)  # gigapascals
    found = settings.read(dome.flexmaps, ObjectSettings)
    assert found.loads == wanted.loads and found.loads.force == (-0.25, 0.0, 1.5)
    assert found.material.chosen.youngs == pytest.approx(1.23e9)
    assert found.material.chosen.strain_limit == pytest.approx(0.033)


@pytest.mark.parametrize("kind", ["DISTANCE", "STRAIN_ENERGY", "SAFETY"])
def test_colours(piece: Any, attribute: Any, kind: str) -> None:
    with pytest.raises(RuntimeError, match="press Simulate first"):
        bpy.ops.flexmaps.overlay(kind=kind)
    press("simulate")
    press("overlay", kind=kind)
    name = {"DISTANCE": "distance", "STRAIN_ENERGY": "strain_energy", "SAFETY": "strain"}[kind]
    values = attribute(piece, f"flexmaps_{name}")
    rgb = attribute(piece, "flexmaps_colour", "color", 4)[::4, :3]
    # the larger the number, the darker the colour
    light = rgb @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light[np.argsort(values, kind="stable")]) < 1e-5).all()


def run(*arguments: object) -> int:
    return command.main(["run", *(str(a) for a in arguments)])


def test_main_job_up_to_simulate(tmp_path: Path) -> None:
    rc = run("shape:saddle", "--edge", 20, "--out", tmp_path, "--stop-after", "simulate", "--no-pictures",
             "--material", "birch", "--model", "rod")  # fmt: skip
    assert rc == 0
    report = json.loads((tmp_path / "report.json").read_text())
    block = report["equilibrium"]
    assert block["converged"] and block["model"] == "rod" and block["material"] == "Birch plywood"
    assert {"residual", "negative_eigenvalues", "twist_max", "rms_mm", "rms_percent", "max_percent"} <= set(block)
    assert "sheets" not in report and "simulate" in report["seconds"]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "model.blend"))
    obj = bpy.data.objects["saddle"]
    assert shape_keys.equilibrium_key(obj.data) is not None
    assert not states.is_stale(obj, bpy.context.scene, "equilibrium")


def test_main_job_goes_on_where_it_cannot_simulate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Weight without supports: the files are there, the exit status and the report say what is missing."""
    arguments = ("shape:saddle", "--edge", 20, "--gravity", "--out", tmp_path, "--no-pictures", "--nesting", "FAST")
    assert run(*arguments) == command.UNDONE_STATUS == 3
    report = json.loads((tmp_path / "report.json").read_text())
    assert "equilibrium" not in report and report["sheets"]["sheets"] >= 1 and report["undone"] == ["simulate"]
    warning = next(c for c in report["checks"] if c["code"] == "not-simulated")
    assert warning["severity"] == "warning" and "supports" in warning["message"] and warning["faces"]
    assert list(tmp_path.glob("sheet-01.*")) and (tmp_path / "model.blend").is_file()
    assert "Not simulated" in capsys.readouterr().out
    assert run(*arguments, "--stop-after", "simulate") == 2


def test_main_job_says_that_it_found_no_equilibrium(tmp_path: Path) -> None:
    given = ("shape:saddle", "--edge", 20, "--out", tmp_path, "--no-pictures", "--stop-after", "simulate")
    assert run(*given, "--set", "simulate.iterations=1") == command.UNDONE_STATUS
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["undone"] == ["simulate"] and not report["equilibrium"]["converged"]
    assert [f["code"] for f in report["equilibrium"]["findings"]] == ["no-equilibrium"]


def test_main_job_tells_what_is_outside_the_model(tmp_path: Path) -> None:
    size = ("--edge", 20, "--thickness", 0.2)
    assert run("shape:saddle", *size, "--out", tmp_path, "--no-pictures", "--stop-after", "simulate") == 0
    block = json.loads((tmp_path / "report.json").read_text())["equilibrium"]
    (found,) = [f for f in block["findings"] if f["code"] == "beyond-model"]
    assert "width / thickness" in found["message"] and found["faces"]
    assert found["message"] in equilibrium.list_warnings(block) and equilibrium.describe_result(block)[1]
    assert found["message"].replace("'", "&#x27;") in (tmp_path / "report.html").read_text()


def test_default_shapes_simulate_without_a_warning(add: Any) -> None:
    add(shapes.make("saddle"))
    for button in ("merge", "spirals", "simulate"):
        press(button)
    assert equilibrium.is_reliable(stored_report.read(bpy.context.object.data)["equilibrium"])


def test_the_assembly_sheet_tells_the_forces_at_rest(
    spiralled: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only where the piece was simulated and nothing has changed since."""
    told: list[Any] = []

    def write(
        design: Any, sheets: Any, figures: Any, target: Path, title: str, new: Any, checked: Any, *_: Any
    ) -> Path:
        told.append(checked)
        new(target).write_bytes(b"")
        return target

    monkeypatch.setattr(assembly_sheet, "write_assembly_sheet", write)
    spiralled.flexmaps.export.folder, spiralled.flexmaps.export.dxf = str(tmp_path), "NONE"

    assert bpy.ops.flexmaps.export() == {"FINISHED"}
    assert bpy.ops.flexmaps.simulate() == {"FINISHED"}
    monkeypatch.setattr(assembly_check, "MAX_HAND_FORCE", 0.0)  # newtons, so that every joint pulls too hard
    assert bpy.ops.flexmaps.export() == {"FINISHED"}
    spiralled.flexmaps.material.material = "custom"
    assert bpy.ops.flexmaps.export() == {"FINISHED"}

    assert [any(seam.force is not None for seam in checked.seams) for checked in told] == [False, True, False]
    assert "pulls with more than" in told[1].warnings[-1]
