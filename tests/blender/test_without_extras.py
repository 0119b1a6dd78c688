"""The road from a mesh to its files without the extras: in copies of the package that lack their folders."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import choices, exploration, mesh, scans, stored_report
from flexmaps.engine.extras.registry import REGISTRY
from support.quick import few_layouts, few_poses
from test_compare import write_scan

FOLDERS = [extra.folder for extra in REGISTRY]
FAST = {"sheet.nesting": "FAST", "optimise.iterations": 2, "simulate.restarts": 0, "structure.cases": "weight: weight"}
# the copy, a .blend file, an empty folder, the folder of drawing.py, and the settings of a piece to make, if any
SCRIPT = """
import importlib.util, json, os, sys
import bpy
copy, blend, out, support, given = sys.argv[1:]
path = os.path.join(copy, "__init__.py")
spec = importlib.util.spec_from_file_location("flexmaps", path, submodule_search_locations=[copy])
package = sys.modules["flexmaps"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
package.register()
from flexmaps import api
from flexmaps.bridge.store import stored_report
from flexmaps.command import arguments
arguments.make_parser()
buttons = dir(bpy.ops.flexmaps)
bpy.ops.wm.open_mainfile(filepath=blend)
obj = bpy.context.view_layer.objects.active
kept = set(stored_report.read(obj.data))
described = api.report(obj, os.path.join(out, "report"))
sys.path.append(support)
import drawing
drawing.everything()  # the tab names only operators that there are
pressed = []
settings = json.loads(given)
if settings:
    api.run("shape:strip", os.path.join(out, "job"), optimised=True, pictures=False, settings=settings)
    obj = api.show(api.load("shape:strip", settings=settings))
    obj.flexmaps.export.folder = os.path.join(out, "sheets")
    pressed = [[one["pressed"], one["error"]] for one in api.presses(obj)]
    bpy.ops.wm.open_mainfile(filepath=blend)
bpy.ops.wm.save_as_mainfile(filepath=os.path.join(out, "again.blend"), check_existing=False)
print("FOUND", json.dumps([buttons, sorted(kept), sorted(described), pressed]))
"""


@pytest.fixture(scope="module")
def model(extension: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A .blend file with results of all extras that store some."""
    folder = tmp_path_factory.mktemp("model")
    settings = FAST | {"layout.patch_min": 4, "optimise.codesign": False, "optimise.patience": 0.05}
    loaded = api.load("shape:saddle", edge=20, settings=settings, supports="lowest")
    with pytest.MonkeyPatch.context() as patch:
        few_layouts(patch)
        few_poses(patch)
        piece = api.structure(api.choose(loaded, match=50.0))
        made = piece.result.simulation
        assert made is not None
        scan = write_scan(folder / "scan.obj", made.vertices, piece.mesh.quads)
        obj = api.show(api.compare(piece, scan, anywhere=False))
    row = {"values": {"edge": 30.0}, "measures": {"rms_percent": 1.0}}
    exploration.write(obj, {"best": 0, "front": [0], "candidates": [row], "note": "Found."})
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "all.blend"))
    return folder / "all.blend"


def _stored() -> dict[str, Any]:
    """What the extras keep in the open file."""
    obj = bpy.context.view_layer.objects.active
    arrays = {}
    for name in (scans.NAME, "flexmaps_utilisation"):
        arrays[name] = np.empty(len(obj.data.polygons), np.float32)
        obj.data.attributes[name].data.foreach_get("value", arrays[name])
    text = {name: stored_report.read(obj.data)[name] for name in ("choose", "scan", "structure")}
    return {
        "notes": text,
        "arrays": {name: values.tolist() for name, values in arrays.items()},
        "explored": exploration.read(obj),
        "points": obj[scans.POINTS].name,
        "layouts": choices.read_cuts(mesh.read_surface(obj, bpy.context.scene), 0).tolist(),
        "cases": obj.flexmaps.structure.cases,
    }


def _without(folders: list[str], root: Path, to: Path) -> Path:
    """Copy the package without some folders of extras."""
    copy = to / "flexmaps"
    tops = [
        path
        for path in root.iterdir()
        if path.name in {"api", "bridge", "command", "data", "engine", "operators", "panels", "presets"}
    ]
    for top in tops:
        shutil.copytree(top, copy / top.name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("__init__.py", "blender_manifest.toml"):
        shutil.copy(root / name, copy / name)
    for folder in folders:
        shutil.rmtree(copy / "engine" / "extras" / folder)
    return copy


@pytest.mark.parametrize(
    ("gone", "whole"),
    [(FOLDERS, False), *(pytest.param([folder], True, marks=pytest.mark.thorough, id=folder) for folder in FOLDERS)],
)
def test_the_road_needs_none_and_what_they_stored_stays(
    gone: list[str], whole: bool, model: Path, root: Path, tmp_path: Path
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(model))
    before = _stored()
    copy = _without(gone, root, tmp_path)
    words = [
        str(copy),
        str(model),
        str(tmp_path),
        str(Path(__file__).with_name("support")),
        json.dumps(FAST if whole else {}),
    ]
    done = subprocess.run([sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, timeout=250)
    assert "FOUND" in done.stdout and "Traceback" not in done.stderr, done.stdout[-3000:] + done.stderr[-3000:]
    buttons, kept, described, pressed = json.loads(done.stdout.partition("FOUND")[2])
    blocks = {"choosing": "choose", "scanning": "scan", "structure": "structure"}
    assert {*blocks.values(), "equilibrium"} <= set(kept)
    assert {"layout", "spirals", "equilibrium", *blocks.values()} - {blocks.get(one) for one in gone} <= set(described)
    assert (tmp_path / "report" / "report.html").is_file()
    for extra, name in (("choosing", "take_choice"), ("scanning", "compare"), ("live", "live"), ("film", "animate")):
        assert (name in buttons) == (extra not in gone)
    assert {"spirals", "simulate", "export", "next"} <= set(buttons)
    if whole:
        assert not [error for _, error in pressed if error] and (tmp_path / "job" / "sheet-01.svg").is_file()
        assert [*(tmp_path / "sheets").glob("*.svg")], pressed
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "again.blend"))
    assert _stored() == before
