"""Pieces that another version of the program made: what is noted, and what is said when they are opened."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import states, stored_report
from flexmaps.command import main as command
from flexmaps.engine import VERSION, versions


@pytest.fixture
def older(tmp_path: Path) -> Path:
    """A file as the program wrote it before the version was noted, and before a part was looked at that counts today."""
    path = tmp_path / "older.blend"
    obj = api.show(api.spirals(api.load("shape:strip", edge=20)))
    made = json.loads(obj.data[stored_report.INPUT_CHECKSUMS])
    for stamps in made.values():
        assert stamps.pop(stored_report.PROGRAM) == VERSION
    gone = next(part for part in states.INPUTS["spirals"] if part in states.SETTINGS_INPUTS)
    del made["spirals"][gone]
    stored_report.put_text(obj.data, stored_report.INPUT_CHECKSUMS, made)
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


OLDER = sorted((Path(__file__).resolve().parents[1] / "older").glob("*.blend"))


def first_mesh(path: Path) -> Any:
    """The one object of a file that holds a scene alone."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    (obj,) = (obj for obj in bpy.data.objects if obj.type == "MESH")
    bpy.context.window.scene = obj.users_scene[0]
    obj.users_scene[0].view_layers[0].objects.active = obj
    obj.select_set(True)
    return obj


@pytest.mark.parametrize("path", OLDER, ids=[path.stem for path in OLDER])
def test_files_that_were_written_by_earlier_versions(path: Path, tmp_path: Path) -> None:
    """Layout, spirals and settings are there; what changed is said; the stages go on from there, by hand and by script."""
    obj = first_mesh(path)
    with pytest.warns(versions.OtherVersion, match=r"0\.1, .*grain"):
        piece = api.load(obj)
    assert stored_report.read_version(obj.data) == versions.FIRST_VERSION
    made = piece.result
    assert made.flat is not None and made.design is not None and made.design.width.shape == (8, 4)
    assert len(made.flat.layout.patches) == 2
    assert 1e-3 <= made.design.width.min() < made.design.width.max() and np.ptp(made.design.twist) > 0.1, (
        "of its optimiser"
    )
    assert (piece.settings.optimise.iterations, piece.settings.spiral.thickness) == (4, pytest.approx(3e-3))
    damaged = [one.message for one in made.findings if "damaged" in one.message]
    assert damaged == []
    assert api.simulate(piece).result.simulation is not None
    obj.flexmaps.sheet.nesting = "FAST"
    with pytest.warns(versions.OtherVersion):
        assert api.export(api.load(obj), tmp_path / "sheets", formats=("svg",))
    for stage in ("check", "flatten", "spirals", "simulate"):
        assert getattr(bpy.ops.flexmaps, stage)() == {"FINISHED"}, stage
    assert stored_report.read_version(obj.data) == VERSION and not stored_report.lacks_checksums(obj.data)
    assert states.read_states(obj, bpy.context.scene)["spirals"].kind == states.DONE
    assert api.load(obj).result.findings == []


def opened(path: Path) -> Any:
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.object


def test_an_older_file_says_what_changed_and_can_be_gone_on_with(older: Path) -> None:
    obj = opened(older)
    assert stored_report.read_version(obj.data) == versions.FIRST_VERSION
    found = states.read_states(obj, bpy.context.scene)
    assert (found["layout"].kind, found["spirals"].kind) == (states.DONE, states.STALE)
    assert found["spirals"].changed_input
    with pytest.warns(versions.OtherVersion, match=r"0\.1, .*grain"):
        piece = api.load(obj)
    count = len(piece.result.design.width)
    assert bpy.ops.flexmaps.update_from_seams() == {"FINISHED"}
    assert bpy.ops.flexmaps.spirals() == {"FINISHED"}
    assert stored_report.read_version(obj.data) == VERSION, "nothing of the older version is left"
    assert states.read_states(obj, bpy.context.scene)["spirals"].kind == states.DONE
    assert len(api.load(obj).result.design.width) == count


def test_the_command_line_says_it_in_one_line(older: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert command.main(["report", str(older), "--out", str(older.parent / "out")]) == 0
    said = [line for line in capfd.readouterr().err.splitlines() if line.startswith("flexmaps:")]
    assert len(said) == 1 and versions.RESULT_CHANGES[0][1] in said[0]
    assert json.loads((older.parent / "out" / "report.json").read_text())["program"].endswith(VERSION)


def test_a_newer_file_says_so(older: Path) -> None:
    obj = opened(older)
    made = json.loads(obj.data[stored_report.INPUT_CHECKSUMS])
    made["layout"][stored_report.PROGRAM] = "99.1.0"
    stored_report.put_text(obj.data, stored_report.INPUT_CHECKSUMS, made)
    with pytest.warns(versions.OtherVersion, match=r"99\.1\.0.*newer"):
        api.load(obj)


def test_what_changed_between_two_versions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(versions, "RESULT_CHANGES", (("0.1.0", "a"), ("0.9.0", "b"), ("0.10.0", "c"), ("2.0.0", "d")))
    assert versions.changes_between("0.1", "0.10.0") == ("a", "b", "c")
    assert versions.changes_between("0.9.0", "0.10.0") == ("c",) and versions.changes_between("0.10.0", "0.9.0") == ()
    assert (
        versions.version_key("rubbish")
        < versions.version_key("0.1")
        < versions.version_key("0.1.0")
        < versions.version_key("0.10.0")
    )
