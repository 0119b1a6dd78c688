"""A scan of the built piece beside the piece: from the button, from a script and from the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import scans, shape_keys, stored_report
from flexmaps.bridge.view import colouring
from flexmaps.command import main as command
from support.buttons import press
from support.quick import few_poses


def write_scan(path: Path, vertices: np.ndarray, quads: np.ndarray, factor: float = 1000.0) -> Path:
    """An OBJ of a surface without its last quarter, a little turned and shifted, in millimetres."""
    angle = np.radians(20)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    points = factor * (vertices @ turn.T + 0.05)
    kept = quads[: 3 * len(quads) // 4] + 1
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points] + ["f " + " ".join(map(str, q)) for q in kept]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def saddle(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A saddle with spirals as an object, and the engine's piece; its scan is sought from fewer poses, which is quicker."""
    few_poses(monkeypatch)
    piece = api.spirals(api.load("shape:saddle", edge=20, settings={"layout.patch_min": 4}))
    return api.show(piece), piece


def test_the_button_measures_shows_and_is_dropped(saddle: Any, tmp_path: Path, attribute: Any) -> None:
    obj, piece = saddle
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    scan = write_scan(tmp_path / "scan.obj", piece.mesh.vertices, piece.mesh.quads)
    press("compare", filepath=str(scan), anywhere=False)
    block = stored_report.read(obj.data)["scan"]
    assert block["against"] == "target" and block["unit_m"] == 0.001 and block["rms_percent"] < 0.05
    assert 0.7 < block["covered"] < 0.8  # three quarters
    distance = attribute(obj, "flexmaps_scan")
    assert (distance < 0).mean() == pytest.approx(1 - block["covered"], abs=1e-3)
    assert distance.max() == pytest.approx(block["max_mm"], abs=1e-3)
    assert colouring.store_colours(obj, "SCAN") and colouring.legend_of(obj, "SCAN").title.startswith(
        "Distance of the scan"
    )
    points = obj[scans.POINTS]
    assert len(points.data.vertices) == block["points"] and points.name in bpy.context.scene.objects
    described = api.report(obj, tmp_path / "report")
    assert described["scan"]["file"] == "scan.obj"
    page = (tmp_path / "report" / "report.html").read_text()
    assert "As built" in page and (tmp_path / "report" / "plots" / "scan.svg").is_file()
    press("simulate")
    assert (
        "scan" not in stored_report.read(obj.data)
        and scans.POINTS not in obj
        and "flexmaps_scan" not in obj.data.attributes
    )
    assert not colouring.store_colours(obj, "SCAN")
    press("compare", filepath=str(scan), anywhere=False)
    assert stored_report.read(obj.data)["scan"]["against"] == "simulated shape"
    obj.flexmaps.spiral.thickness *= 1.2  # the shape that it was compared with is no longer that of the piece
    assert not colouring.store_colours(obj, "SCAN") and "scan" not in api.report(obj)


@pytest.mark.thorough
def test_it_is_compared_with_the_simulated_shape(saddle: Any, tmp_path: Path) -> None:
    """A scan of the shape that the simulation found lies over it, not over the target."""
    obj, piece = saddle
    simulated = api.simulate(piece)
    shape = simulated.result.simulation.vertices
    scan = write_scan(tmp_path / "scan.obj", shape, piece.mesh.quads)
    found = api.compare(simulated, scan, anywhere=False).result.scan
    assert found.simulated and found.rms < 1e-4 * found.size
    on_target = api.compare(piece, scan, anywhere=False).result.scan
    assert not on_target.simulated and on_target.rms > 3 * found.rms
    api.show(simulated, obj)
    assert shape_keys.equilibrium_key(obj.data) is not None
    held = api.compare(
        api.load(obj), scan, anywhere=False
    ).result.scan  # what the object holds, without simulating anew
    assert held.simulated and held.rms == pytest.approx(found.rms, rel=0.2, abs=1e-5)
    api.show(api.compare(simulated, scan, anywhere=False), obj)
    assert stored_report.read(obj.data)["scan"]["against"] == "simulated shape" and scans.is_current(
        obj, bpy.context.scene
    )


def test_from_the_command_line(tmp_path: Path, capsys: Any) -> None:
    piece = api.load("shape:saddle", edge=20)
    scan = write_scan(tmp_path / "scan.obj", piece.mesh.vertices, piece.mesh.quads, factor=1.0)
    words = ["compare", "shape:saddle", str(scan), "--near", "--out", str(tmp_path / "out")]
    assert command.main(words) == 0
    assert "the scan shows 7" in capsys.readouterr().out
    described = json.loads((tmp_path / "out" / "report.json").read_text())
    assert described["scan"]["covered"] > 0.7 and "metres" in described["scan"]["remarks"][0]
    assert (tmp_path / "out" / "plots" / "scan.svg").is_file()
    (tmp_path / "empty.ply").write_text("")
    assert command.main(["compare", "shape:saddle", str(tmp_path / "empty.ply")]) == 2
    assert "is empty" in capsys.readouterr().err


def test_a_missing_file_is_named(saddle: Any) -> None:
    obj, _ = saddle
    bpy.context.view_layer.objects.active = obj
    with pytest.raises(RuntimeError, match="nowhere"):
        bpy.ops.flexmaps.compare_file(filepath="/nowhere/scan.ply")
    with pytest.raises(RuntimeError, match="nowhere"):
        bpy.ops.flexmaps.compare(filepath="/nowhere/scan.ply")
    for ask in (bpy.ops.flexmaps.compare_file, bpy.ops.flexmaps.compare):
        with pytest.raises(RuntimeError, match="Choose the file of a scan"):
            ask()
    assert "scan" not in stored_report.read(obj.data)


def test_a_file_that_is_no_scan_is_refused_without_a_traceback(saddle: Any, tmp_path: Path) -> None:
    path = tmp_path / "scan.obj"
    path.write_text("nothing")
    with pytest.raises(RuntimeError) as told:
        bpy.ops.flexmaps.compare_file(filepath=str(path))
    assert "Traceback" not in str(told.value)
