"""Candidates in Blender: tried from the sidebar, kept with the object, taken; and from the command line."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from flexmaps import api
from flexmaps.bridge.store import exploration
from flexmaps.command import main as command
from flexmaps.engine import workers
from flexmaps.engine.extras.exploring import run_exploration as running
from flexmaps.engine.materials import MATERIALS
from support.bowl import bowl
from support.buttons import press
from support.drawing import draw


@pytest.fixture
def tried(add: Any, once: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setitem(running.explore_piece.__kwdefaults__, "effort", 0.02)
    monkeypatch.setattr(workers, "count_cores", lambda: 1)  # starting processes takes longer than their work

    def make() -> None:
        obj = add(bowl())
        obj.flexmaps.explore.candidates = 4
        press("merge")
        press("explore")

    return once("explored", make)


def test_candidates_are_kept_and_one_is_taken(tried: Any) -> None:
    found = exploration.read(tried)
    assert found is not None and found["tried"] == 4 and found["rows"]
    values, scale = found["rows"][0]["values"], tried.scale.copy()
    before = exploration.median_edge_mm(tried, bpy.context.scene)
    assert before / 1.5 <= values["edge"] <= before * 1.5
    press("use_candidate", number=0)
    assert tried.flexmaps.spiral.thickness == pytest.approx(values["spiral.thickness"])
    assert exploration.median_edge_mm(tried, bpy.context.scene) == pytest.approx(values["edge"], rel=1e-4)
    assert tried.scale.x / scale.x == pytest.approx(values["edge"] / before, rel=1e-4)
    with pytest.raises(RuntimeError, match="no such candidate"):
        press("use_candidate", number=99)


def test_the_sidebar_lists_them(tried: Any) -> None:
    count = len(exploration.read(tried)["rows"])
    bpy.context.window_manager.flexmaps_tab.check = "EXPLORE"
    drawn = draw("check")
    assert sum(bool(re.fullmatch(r"\S+ %, \S+ %", line)) for line in drawn) == min(count, 6)
    report = {
        "best": 0,
        "front": [0],
        "note": "",
        "candidates": [{"values": {"material.material": "pom", "gone": 3}, "measures": {}}],
    }
    exploration.write(tried, report)
    assert f"{MATERIALS['pom'].name}, gone 3" in draw("check")
    for wrong in ("no json", "[]", '{"note": 1}', '{"note": "a", "tried": 2, "rows": [{"values": 3}]}'):
        tried[exploration.NAME] = wrong
        assert exploration.read(tried) is None
        draw("check")


def test_the_command_line_explores(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(running.explore_piece.__kwdefaults__, "effort", 0.02)
    words = [
        "explore",
        "shape:strip",
        "--out",
        str(tmp_path / "x"),
        "--vary",
        "spiral.thickness=1,2",
        "--goal",
        "panels<=1",
        "--cores",
        "1",
    ]
    assert command.main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [one["values"] for one in told["candidates"]] == [{"spiral.thickness": 1.0}, {"spiral.thickness": 2.0}]
    assert (tmp_path / "x" / "candidates.csv").is_file()
    assert command.main(words) == 0
    assert told["note"] in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("--vary", "spiral.thickness"),
        ("--vary", "spiral.thick=1:2"),
        ("--vary", "edge=20:10"),
        ("--vary", "edge=10:20", "--goal", "beauty<=1"),
        ("--vary", "edge=10:20", "--candidates", "0"),
        ("--vary", "edge=10:20", "--scheduler", "nonsense"),
    ],
    ids=" ".join,
)
def test_what_cannot_be_explored_is_told_in_one_line(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main(["explore", "shape:strip", "--out", str(tmp_path / "x"), *words]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("flexmaps:")]
    assert len(said) == 1


def test_no_cluster_where_blender_may_not_go_online(monkeypatch: pytest.MonkeyPatch) -> None:
    """The network is asked for in the manifest, and used where the preferences allow it alone."""
    monkeypatch.setattr(bpy, "app", SimpleNamespace(binary_path="blender", online_access=False))
    with pytest.raises(api.FlexMapsError, match="may not go online"):
        api.explore(api.load("shape:strip"), {"spiral.thickness": "2:3"}, scheduler="tcp://127.0.0.1:1")
