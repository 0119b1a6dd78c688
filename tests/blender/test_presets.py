"""Presets: those that come along can be cut, one's own come back, and each is one step to undo."""

from __future__ import annotations

import os
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import presets, settings, stored_report
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.surface import shapes

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "presets" / "flexmaps").glob("*.py"))


ASSIGN = "import bpy\nsettings = bpy.context.object.flexmaps\n"  # how every preset begins


def assigned(path: Path) -> dict[str, Any]:
    rows = re.findall(r"^settings\.(\S+) = (.+)$", path.read_text(), re.MULTILINE)
    return {name: eval(value) for name, value in rows}


def apply(path: Path) -> None:
    assert bpy.ops.flexmaps.apply_preset(filepath=str(path)) == {"FINISHED"}


def values(obj: Any) -> dict[str, Any]:
    return {name: eval(name, {"settings": obj.flexmaps}) for name in presets.list_expressions()}


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Presets are saved here rather than among those of whoever runs the test."""
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_, path="", **__: _made(tmp_path / path))
    paths = bpy.utils.preset_paths
    monkeypatch.setattr(bpy.utils, "preset_paths", lambda subdir: [*paths(subdir), str(tmp_path / "presets" / subdir)])
    _made(tmp_path / "presets" / "flexmaps")
    return tmp_path / "presets" / "flexmaps"


def _made(path: Path) -> str:
    path.mkdir(parents=True, exist_ok=True)
    return str(path)


def test_blender_finds_those_that_come_along() -> None:
    found = [Path(folder) / name for folder in bpy.utils.preset_paths("flexmaps") for name in os.listdir(folder)]
    assert {p for p in found if p.suffix == ".py"} >= set(SHIPPED) and len(SHIPPED) >= 4


def test_each_sets_the_same_settings() -> None:
    """Else what one preset leaves out would be left over from another one."""
    names = [list(assigned(path)) for path in SHIPPED]
    assert all(other == names[0] for other in names)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_its_values_arrive_and_are_within_the_bounds(path: Path, add: Any) -> None:
    obj = add(shapes.dome(4))
    apply(path)
    for name, value in assigned(path).items():
        block, _, setting = name.partition(".")
        found = getattr(getattr(obj.flexmaps, block), setting)
        assert found == (pytest.approx(value) if isinstance(value, float) else value), name
    settings.read(obj.flexmaps, ObjectSettings)  # within the engine's bounds


# the narrowest kerf, and the widest cutter
QUICK = {"Laser_Delrin_2_mm", "Mill_acrylic_3_mm"}


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=() if p.stem in QUICK else pytest.mark.thorough, id=p.stem) for p in SHIPPED],
)
def test_a_piece_can_be_made_with_it(path: Path, add: Any, tmp_path: Path) -> None:
    """Applied as it is, the stages to the sheets have nothing to refuse or to leave out."""
    wanted = assigned(path)
    mesh = shapes.dome(4)
    obj = add((mesh.vertices * (wanted["remesh.edge"] * 1e-3 / mesh.median_edge), mesh.quads))
    obj.flexmaps.export.folder, obj.flexmaps.sheet.nesting = str(tmp_path), "FAST"
    obj.flexmaps.export.guide = False  # takes longest, and does not depend on the preset
    apply(path)
    for button in ("trace", "spirals", "export"):
        assert getattr(bpy.ops.flexmaps, button)() == {"FINISHED"}
    made, sheets = stored_report.read(obj.data)["spirals"], stored_report.read(obj.data)["sheets"]
    assert made["slot_min_mm"] >= wanted["spiral.slot_min"] - 1e-3
    assert made["slot_min_mm"] >= wanted["cut.kerf_outline"]  # the cutter has room between two arms
    assert made["too_thin"] == 0
    assert made["twist_deg"][-1] > 60  # there is room for spirals that bend
    assert not sheets["unsolved"]
    assert (
        sheets["connector_kinds"][wanted["connect.connector"]] >= 0.85 * sheets["joints"]
    )  # the rest has room for tabs
    assert any(tmp_path.iterdir())


def test_a_preset_of_ones_own_comes_back(dome: Any, own_folder: Path) -> None:
    dome.flexmaps.spiral.thickness, dome.flexmaps.layout.neck_min = 3.25, 3
    dome.flexmaps.loads.supports, dome.flexmaps.export.folder = "feet", "//mine"
    wanted = values(dome)
    assert bpy.ops.flexmaps.preset(name="My cutter") == {"FINISHED"}
    saved = own_folder / "My_cutter.py"
    assert saved.is_file() and "feet" not in saved.read_text() and "mine" not in saved.read_text()
    apply(SHIPPED[0])
    assert values(dome) != wanted
    dome.flexmaps.export.folder = "//other"
    apply(saved)
    assert values(dome) == wanted
    assert dome.flexmaps.export.folder == "//other" and dome.flexmaps.loads.supports == "feet"
    assert bpy.ops.flexmaps.preset(name="My cutter", remove_name=True) == {"FINISHED"}
    assert not saved.exists()


def test_settings_of_earlier_versions_that_are_gone_are_ignored(dome: Any, tmp_path: Path) -> None:
    preset = tmp_path / "old.py"
    gone = "settings.sheet.cut_joints = 30\nsettings.optimise.grain = 'free'\nsettings.optimise.method = 'lbfgs'\n"
    preset.write_text(f"{ASSIGN}{gone}settings.spiral.thickness = 3.25\n")
    apply(preset)
    assert dome.flexmaps.spiral.thickness == pytest.approx(3.25)  # what follows them is applied
    assert "cut_joints" not in presets.list_expressions()


def test_a_saved_preset_holds_every_setting_of_a_way_to_work() -> None:
    every = {f"settings.{b.name}.{f.name}" for b in fields(ObjectSettings) for f in fields(b.default_factory)}  # type: ignore[arg-type]
    left_out = every - set(presets.list_expressions())
    assert left_out == {n for n in every if n.startswith("settings.loads.")} | {
        "settings.export.folder",
        "settings.render.file",
    }


def test_one_step_to_undo(dome: Any) -> None:
    name = dome.name
    bpy.ops.ed.undo_push(message="before")
    apply(SHIPPED[0])
    changed = dome.flexmaps.spiral.width_min
    bpy.ops.ed.undo_push(message="preset")  # what the window does after an operator with UNDO
    assert "UNDO" in bpy.ops.flexmaps.apply_preset.bl_options
    bpy.ops.ed.undo()
    assert bpy.data.objects[name].flexmaps.spiral.width_min != pytest.approx(changed)


def test_without_an_object_or_a_file_it_says_so(dome: Any) -> None:
    with pytest.raises(RuntimeError, match="There is no preset"):
        bpy.ops.flexmaps.apply_preset(filepath="/nowhere.py")
    bpy.context.view_layer.objects.active = None
    assert not bpy.ops.flexmaps.apply_preset.poll() and not bpy.ops.flexmaps.preset.poll()


def test_values_are_numbers_that_blender_can_write(dome: Any) -> None:
    assert all(isinstance(v, bool | int | float | str) for v in values(dome).values())
    assert np.isfinite([v for v in values(dome).values() if isinstance(v, float)]).all()
