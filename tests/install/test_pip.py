"""``pip install`` of the checkout: the package beside Blender as a Python module, with its command."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where pip has put it; what it depends on is in this environment already."""
    target = tmp_path_factory.mktemp("pip")
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--disable-pip-version-check",
        "install",
        "-q",
        "--no-deps",
        "--no-build-isolation",
    ]
    subprocess.run([*pip, "--target", str(target), str(ROOT)], check=True)
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
