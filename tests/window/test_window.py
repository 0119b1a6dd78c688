"""The zip in a real Blender, without and with its window; pictures of every stage are left in out/window/ to look at."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
pytestmark = pytest.mark.timeout(1000)  # some minutes where the machine is free
PYTHON_COMPLAINS = re.compile(r"Traceback|\.py:\d+: \w*Warning|^Error in |\bunregistered\b", re.MULTILINE)


@pytest.fixture(scope="session")
def zip_file(build_zip: ModuleType) -> Path:
    return build_zip.build("linux-x64", "debian-13-blender")


# few quads, for the time of a test; "bench blender --only next" takes the defaults
FEW = {"optimise.iterations": 3, "sheet.nesting": "FAST"}
QUADS = {"suzanne": 200, "text": 150, "cylinder": 150, "bunny": 250, "lamp": 100, "roof": 100, "mask": 150}


def drive(real_blender: ModuleType, script: Path, zip_file: Path, work: Path, *, window: bool) -> dict[str, Any]:
    shutil.copy2(zip_file, work)
    found = driven(real_blender, script, work, window=window)
    assert {"scipy", "shapely", "igl"} <= set(found["places"])
    user = str(work / "user")
    assert all(place.startswith(user) for place in found["places"].values()), found["places"]
    assert {".svg", ".dxf"} <= {path.suffix for path in (work / "sheets").iterdir()}
    return found


def driven(real_blender: ModuleType, script: Path, work: Path, *, window: bool, variables: str = "") -> dict[str, Any]:
    """What the script found, where it ran into no error and Python complained of nothing."""
    done = real_blender.run(
        script, work, window=window, timeout=900, variables=variables
    )  # drawn by software, maybe on a busy machine
    console, result = done.stdout + done.stderr, work / "result.json"
    assert result.is_file(), console[-3000:]
    found: dict[str, Any] = json.loads(result.read_text())
    assert found["errors"] == []
    assert PYTHON_COMPLAINS.search(console) is None, console[-3000:]
    return found


@pytest.mark.thorough
def test_without_a_window(real_blender: ModuleType, zip_file: Path, tmp_path: Path) -> None:
    found = drive(real_blender, HERE / "headless.py", zip_file, tmp_path, window=False)
    assert "not quads" in found["refused"][0]
    assert set(map(tuple, found["stages"].values())) == {("FINISHED",)}
    assert {"layout", "spirals", "equilibrium", "optimise", "reach", "sheets"} <= set(found["blocks"])
    assert found["explored"]["tried"] == 2 and found["explored"]["rows"]


@contextmanager
def kept(real_blender: ModuleType, work: Path, pictures: Path) -> Iterator[None]:
    """The screens that a script leaves become pictures in a folder, also where it fails."""
    shutil.rmtree(pictures, ignore_errors=True)
    pictures.mkdir(parents=True)
    try:
        yield
    finally:
        for shot in sorted(work.glob("*.xwd")):
            real_blender.picture(shot, pictures / f"{shot.stem}.png")


@pytest.mark.thorough
@pytest.mark.parametrize("names", [("suzanne", "text", "cylinder"), ("lamp", "roof", "mask"), ("bunny",)], ids="-".join)
def test_next_leads_models_to_their_sheets(
    real_blender: ModuleType, zip_file: Path, tmp_path: Path, names: tuple[str, ...], request: pytest.FixtureRequest
) -> None:
    wanted = {name: {"remesh.quads": QUADS[name]} | FEW for name in names}
    if "bunny" in names:
        shutil.copyfile(request.getfixturevalue("shared_meshes") / "stanford-bunny.obj", tmp_path / "bunny.obj")
    shutil.copy2(zip_file, tmp_path)
    (tmp_path / "models.json").write_text(json.dumps(wanted))
    pictures = ROOT / "out" / f"window-{'-'.join(names)}"
    with kept(real_blender, tmp_path, pictures):
        found = driven(real_blender, HERE / "models.py", tmp_path, window=True)
    (pictures / "figures.json").write_text(json.dumps(found, indent=1))
    assert found["wrong"] == []
    assert set(found["models"]) == set(names)


def test_with_its_window(
    real_blender: ModuleType, zip_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = ROOT / "out" / "window"
    with kept(real_blender, tmp_path, pictures):
        found = drive(real_blender, HERE / "walk.py", zip_file, tmp_path, window=True)
    (pictures / "figures.json").write_text(json.dumps(found, indent=1))
    with capsys.disabled():
        print("\n" + _told(found))
    assert found["wrong"] == []
    assert found["pictures"] == len(list(pictures.glob("*.png")))


@pytest.mark.thorough
def test_spirals_are_painted_with_the_pointer(real_blender: ModuleType, zip_file: Path, tmp_path: Path) -> None:
    shutil.copy2(zip_file, tmp_path)
    pictures = ROOT / "out" / "window-brush"
    with kept(real_blender, tmp_path, pictures):
        found = driven(real_blender, HERE / "brush.py", tmp_path, window=True)
    (pictures / "figures.json").write_text(json.dumps(found, indent=1))
    assert found["wrong"] == []


@pytest.mark.thorough
def test_live_mode_follows_a_hand_on_the_mouse(real_blender: ModuleType, zip_file: Path, tmp_path: Path) -> None:
    shutil.copy2(zip_file, tmp_path)
    pictures = ROOT / "out" / "window-live"
    with kept(real_blender, tmp_path, pictures):
        found = driven(real_blender, HERE / "following.py", tmp_path, window=True)
    (pictures / "figures.json").write_text(json.dumps(found, indent=1))
    assert found["wrong"] == []
    assert found["pictures"] == len(list(pictures.glob("*.png")))


@pytest.mark.parametrize("language", ["", pytest.param("de_DE", marks=pytest.mark.thorough)])
def test_the_tab_stays_in_its_place_and_in_sight(
    real_blender: ModuleType, zip_file: Path, tmp_path: Path, language: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(real_blender, "SCREEN", (700, 1300))  # higher than the tab may be, and little beside it to draw
    shutil.copy2(zip_file, tmp_path)
    pictures = ROOT / "out" / f"window-tab{language and '-' + language}"
    with kept(real_blender, tmp_path, pictures):
        found = driven(real_blender, HERE / "tab.py", tmp_path, window=True, variables=f"FLEXMAPS_LANGUAGE={language}")
    (pictures / "figures.json").write_text(json.dumps(found, indent=1))
    assert found["wrong"] == []


def _told(found: dict[str, Any]) -> str:
    """The measured times, for a person: they depend on the machine and on drawing by software, so nothing asserts them."""
    lines = [f"  {found['seconds']['all']:.0f} s; drawing the sidebar alone takes {found['redraw_ms'][0]:.0f} ms here"]
    for name, row in found["stages"].items():
        first = "" if row["first_progress_ms"] is None else f", progress seen after {row['first_progress_ms']:.0f} ms"
        lines.append(
            f"  {name:12} {row['seconds']:6.2f} s, no answer for {row['blocked_ms']:.0f} ms at most, "
            f"of which at work {row['at_work_ms']:.0f} ms{first}"
        )
    return "\n".join(lines)
