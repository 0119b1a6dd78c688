"""What there is to look at, in report.json."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
from flexmaps import api
from flexmaps.api import pressing

FEW = {"optimise.iterations": 2, "optimise.codesign": False, "sheet.nesting": "FAST", "spiral.thickness": 1.5}


def test_what_there_is_to_look_at_is_in_the_report_with_calls_that_cure_it(tmp_path: Path) -> None:
    obj = api.show(api.sheets(api.optimise(api.load("shape:strip", edge=20, settings=FEW), supports="lowest")))
    found = api.report(obj, tmp_path)["findings"]
    assert (
        found
        == pressing.describe_object(obj)["findings"]
        == json.loads((tmp_path / "report.json").read_text())["findings"]
    )
    cures = [cure for one in found for cure in one["cures"]]
    assert cures, "a strip of a few steps lies far from its target"
    before = len(found)
    exec(next(cure["call"] for cure in cures if "let_go" in cure["call"]), {"bpy": bpy})
    after = pressing.describe_object(obj)["findings"]
    assert len(after) == before
    assert sum(one["kind"] == "information" for one in after) == 1 + sum(one["kind"] == "information" for one in found)


def test_the_main_job_tells_the_same(tmp_path: Path) -> None:
    described = api.run("shape:strip", tmp_path, edge=20, settings=FEW, formats=("svg",), pictures=False)
    assert described["findings"] == json.loads((tmp_path / "report.json").read_text())["findings"]
    assert described["findings"] == pressing.describe_object(bpy.context.view_layer.objects.active)["findings"]
