"""The zip in a real Blender, without and with its window; pictures of every stage are left in out/window/."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
DRIVE = Path(__file__).with_name("drive.py")


@pytest.fixture(scope="session")
def zip_file(build_zip: ModuleType) -> Path:
    return build_zip.build("linux-x64", "debian-13-blender")


def drive(real_blender: ModuleType, zip_file: Path, work: Path, *, window: bool) -> dict[str, Any]:
    shutil.copy2(zip_file, work)
    done = real_blender.run(DRIVE, work, window=window, timeout=480)  # drawn by software
    result = work / "result.json"
    assert result.is_file(), done.stdout[-3000:] + done.stderr[-3000:]
    found: dict[str, Any] = json.loads(result.read_text())
    assert found["errors"] == []
    assert "Traceback" not in done.stdout + done.stderr, (done.stdout + done.stderr)[-3000:]
    return found


def check_work(found: dict[str, Any], work: Path) -> None:
    whole = found["whole"]
    assert {"layout", "spirals", "equilibrium", "optimise", "reach", "sheets"} <= set(whole["blocks"])
    assert whole["seams"] > 0
    assert {"flexmaps_flat", "flexmaps_patch", "flexmaps_width", "flexmaps_twist"} <= set(whole["attributes"])
    user = str(work / "user")
    assert {"scipy", "shapely", "igl"} <= set(found["places"])
    assert all(place.startswith(user) for place in found["places"].values()), found["places"]
    suffixes = {path.suffix for path in (work / "sheets").iterdir()}
    assert {".svg", ".dxf"} <= suffixes


def test_without_a_window(real_blender: ModuleType, zip_file: Path, tmp_path: Path) -> None:
    found = drive(real_blender, zip_file, tmp_path, window=False)
    check_work(found, tmp_path)
    assert "not quads" in found["refused"][0][0]
    assert set(map(tuple, found["stages"].values())) == {("FINISHED",)}


def test_with_its_window(real_blender: ModuleType, zip_file: Path, tmp_path: Path) -> None:
    found = drive(real_blender, zip_file, tmp_path, window=True)
    pictures = ROOT / "out" / "window"
    pictures.mkdir(parents=True, exist_ok=True)
    for shot in sorted(tmp_path.glob("*.xwd")):
        real_blender.picture(shot, pictures / f"{shot.stem}.png")
    check_work(found, tmp_path)
    assert found["refused"][1:] == ["EDIT", ["checks"]], "a click on Check shows the culprits in edit mode"
    assert found["escaped"], "Esc leaves the mesh as it was"
    assert "sheets" not in found["undone"]["blocks"] or "spirals" not in found["undone"]["blocks"]
