"""The calibration sheet in Blender: written, read, kept as a preset; by buttons, from scripts and on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import pytest
from flexmaps import api
from flexmaps.bridge.store import presets
from flexmaps.command import main as command
from flexmaps.engine.surface import shapes


@pytest.fixture
def own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Blender's folder for a person's own presets, somewhere else."""
    monkeypatch.setattr(
        bpy.utils, "user_resource", lambda kind, path="", create=False: str(tmp_path / "scripts" / path)
    )
    return tmp_path / "scripts" / "presets" / "flexmaps"


@pytest.fixture
def dome(add: Any, tmp_path: Path) -> bpy.types.Object:
    mesh = shapes.dome(4)
    obj = add((mesh.vertices * (0.02 / mesh.median_edge), mesh.quads))
    obj.flexmaps.export.folder = str(tmp_path / "out")
    obj.flexmaps.cut.kerf_outline = obj.flexmaps.cut.kerf_holes = 0.15
    return obj


READINGS = {"kerf_comb": [1.87, 1.85], "clearance": 0.05, "spiral_sag": [(0.75, 0.75), (0.76, 0.75)]}


def test_from_a_script(tmp_path: Path, own_folder: Path) -> None:
    paths = api.calibration_sheet(
        tmp_path / "sheet", {"cut.kerf_outline": 0.15, "cut.kerf_holes": 0.15}, formats=("svg",)
    )
    assert [path.name for path in paths] == ["calibration.svg", "calibration.json"]
    found = api.calibrated(tmp_path / "sheet", name="My laser", **READINGS)
    assert found.settings["cut.kerf_outline"] == pytest.approx(1.86 / 11, abs=1e-4)
    assert (own_folder / "My_laser.py").is_file()
    piece = api.load("shape:strip", edge=20, settings={**found.settings, "sheet.nesting": "FAST"})
    assert piece.settings.material.chosen.youngs == pytest.approx(1e9 * found.settings["material.youngs"])
    assert api.sheets(piece).result.sheets.cut.kerf_outline == pytest.approx(1.86e-3 / 11, abs=1e-7)


def test_by_buttons(dome: bpy.types.Object, own_folder: Path, tmp_path: Path) -> None:
    assert bpy.ops.flexmaps.calibration_sheet() == {"FINISHED"}
    assert {p.suffix for p in (tmp_path / "out" / "calibration").glob("[!.]*")} == {".svg", ".dxf", ".pdf", ".json"}
    done = bpy.ops.flexmaps.calibrated(
        kerf_comb="1.87, 1.85", clearance="0.05", kind="key", sag_a="0.75, 0.76", sag_b="0.75 0.75", preset="Mine"
    )
    assert done == {"FINISHED"}
    got = dome.flexmaps
    assert got.cut.kerf_holes == pytest.approx(1.86 / 11, abs=1e-4) and got.connect.connector == "key"
    assert got.connect.clearance == pytest.approx(0.05 + 1.86 / 11 - 0.15, abs=1e-4)
    assert got.material.material == "custom" and 2.5 < got.material.youngs < 4.5
    # the preset gives the same to another object
    values = got.material.youngs, got.cut.kerf_outline
    got.material.material, got.material.youngs, got.cut.kerf_outline = "pom", 1.0, 0.0
    assert bpy.ops.flexmaps.apply_preset(filepath=str(own_folder / "Mine.py")) == {"FINISHED"}
    assert (got.material.youngs, got.cut.kerf_outline) == pytest.approx(values) and got.material.material == "custom"


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({}, "Nothing was measured"),
        ({"kerf_comb": "wide"}, "not a list of numbers"),
        ({"sag_a": "1"}, "as many sags"),
        ({"kerf_comb": "0.3", "clearance": "0.05"}, "cannot fit"),
        ({"kerf_comb": "1.8", "preset": "..."}, "cannot be the name"),
    ],
)
def test_mistakes_are_said_once(dome: bpy.types.Object, own_folder: Path, given: dict[str, str], says: str) -> None:
    with pytest.raises(RuntimeError, match="make a calibration sheet first"):
        bpy.ops.flexmaps.calibrated(kerf_comb="1.8")
    bpy.ops.flexmaps.calibration_sheet()
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.flexmaps.calibrated(**given)
    assert not own_folder.exists()
    if "preset" not in given:
        assert dome.flexmaps.cut.kerf_outline == pytest.approx(0.15)


def test_a_name_cannot_leave_the_folder(own_folder: Path) -> None:
    path = presets.write_preset("../../evil\nname", {"cut.kerf_outline": 0.1})
    assert path.parent == own_folder
    body = path.read_text(encoding="utf-8").splitlines()
    assert [line for line in body if line and not line.startswith(("#", "import bpy", "settings"))] == []


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], own_folder: Path) -> None:
    assert command.main(["calibrate", "--out", str(tmp_path), "--set", "cut.kerf_outline=0.15", "--json"]) == 0
    assert "calibration.json" in json.loads(capsys.readouterr().out)["files"]
    words = [
        "calibrated",
        str(tmp_path),
        "--kerf-comb",
        "1.87",
        "1.85",
        "--spiral-sag",
        "0.75",
        "0.75",
        "--name",
        "Laser",
    ]
    assert command.main(words) == 0
    said = capsys.readouterr().out
    assert "kerf" in said and "GPa" in said and "kept as preset 'Laser'" in said
    assert (own_folder / "Laser.py").is_file()
    assert command.main(["calibrated", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("flexmaps: Nothing was measured")
    assert command.main(["calibrate", "--out", str(tmp_path), "--set", "spiral.thickness"]) == 2
