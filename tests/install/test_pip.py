"""``pip install`` of the checkout: the package beside Blender as a Python module, with its command."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def wheel(build_zip: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = build_zip.package(tmp_path_factory.mktemp("dist"))
    return made


@pytest.fixture(scope="module")
def folder(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where pip has put it; what it depends on is in this environment already."""
    target = tmp_path_factory.mktemp("pip")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q", "--no-deps"]
    subprocess.run([*pip, "--target", str(target), str(wheel)], check=True)
    return target


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The command ``flexmaps`` in a Python that knows no checkout."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    environment["PYTHONPATH"] = str(folder)
    command = [sys.executable, str(folder / "bin" / "flexmaps"), *words]
    return subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, timeout=280)


def test_the_command_makes_a_piece(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run(
        folder, "run", "shape:strip", "--out", str(out), "--nesting", "FAST", "--no-pictures", "--formats", "svg"
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert (out / "sheet-01.svg").is_file() and (out / "report.html").is_file()
    assert json.loads((out / "report.json").read_text())["program"].startswith("FlexMaps")


def test_everything_that_it_reads_came_along(folder: Path) -> None:
    """Every file of the folders that the extension ships, but for what only Blender's extensions read."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    tops = ("bridge/", "command/", "data/", "engine/", "operators/", "panels/", "presets/")
    missing = [name for name in listed if name.startswith(tops) and not (folder / "flexmaps" / name).is_file()]
    assert missing == []


def test_a_mistake_is_told_in_one_line(folder: Path) -> None:
    done = run(folder, "check", "nothing.obj")
    assert done.returncode == 2 and "nothing.obj" in done.stderr and "Traceback" not in done.stderr


# what calls most of every package: quads anew, layouts compared, spirals optimised, every format
SCRIPT = """
import os, sys
import bpy
import flexmaps
flexmaps.register()
from flexmaps import api
settings = {"optimise.iterations": 2, "optimise.codesign": False, "sheet.nesting": "FAST"}
piece = api.remesh(api.load("shape:dome", edge=20, settings=settings), quads=60)
piece = api.optimise(piece, supports="lowest")
api.export(piece, "out", formats=("svg", "dxf", "dxf-r12", "pdf", "stl", "3mf"))
api.report(piece, "out")
sys.stdout.flush()
os._exit(0)
"""


@pytest.mark.thorough
@pytest.mark.timeout(1200)  # Blender itself is fetched
@pytest.mark.parametrize("oldest", [False, True], ids=["as pip chooses", "the oldest that it allows"])
def test_in_a_clean_environment(wheel: Path, tmp_path: Path, oldest: bool) -> None:
    """With all that it needs from the package index, by its own ranges and none of the pins; then with the least of each."""
    if oldest and sys.version_info[:2] != (3, 11):
        pytest.skip("the oldest versions have no wheels for newer Pythons, where pip takes newer ones")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "own")], check=True)
    inside = tmp_path / "own" / ("Scripts" if os.name == "nt" else "bin")
    pip = [str(inside / "python"), "-m", "pip", "--disable-pip-version-check", "install", "-q"]
    subprocess.run([*pip, f"{wheel}[blender]"], check=True, env=environment)
    if oldest:
        subprocess.run([*pip, "--no-deps", "--only-binary=:all:", *least()], check=True, env=environment)
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    for command in ([str(inside / "flexmaps"), "check", "shape:dome"], [str(inside / "python"), "script.py"]):
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-3000:]
    made = {path.name for path in (tmp_path / "out").iterdir()}
    assert {f"sheet-01.{kind}" for kind in ("svg", "dxf", "pdf", "stl", "3mf")} | {"report.html"} <= made


def least() -> list[str]:
    """The pins of the oldest versions that pyproject.toml allows; of numpy those that Blender itself asks for stay."""
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    return [one.split(";")[0].strip().replace(">=", "==") for one in needed if not one.startswith("numpy")]
