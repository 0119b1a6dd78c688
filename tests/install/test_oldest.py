"""The oldest Blender that the manifest promises, as a module beside the environment of the tests.

It is fetched once (520 MB) into ~/.cache/flexmaps. What differs between Blenders is the mesh in edit mode and the second
Blender, so these are what runs in it; the longer ones where thorough tests are asked for.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
QUICK, LONG = ("test_mesh.py", "test_register.py"), ("test_states.py", "test_second.py")
pytestmark = pytest.mark.timeout(900)


@pytest.fixture(scope="session")
def oldest() -> Path:
    """The folder with that Blender; skips where it cannot be had."""
    manifest = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    version = re.search(r'^blender_version_min = "(.+)"', manifest, re.MULTILINE)
    assert version is not None
    if sys.version_info[:2] != (3, 11):
        pytest.skip(f"Blender {version[1]} needs Python 3.11")
    folder = Path.home() / ".cache" / "flexmaps" / f"bpy-{version[1]}"
    if not folder.is_dir():
        making = folder.with_name(folder.name + "-making")
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input", "install", "-q", "--no-deps"]
        done = subprocess.run([*pip, "--target", str(making), f"bpy=={version[1]}"], capture_output=True, text=True)
        if done.returncode:
            pytest.skip(f"Blender {version[1]} could not be fetched: {done.stderr.strip().splitlines()[-1:]}")
        making.rename(folder)
    return folder


@pytest.mark.parametrize(
    "names", [QUICK, pytest.param(LONG, marks=pytest.mark.thorough)], ids=["edit mode", "the second Blender"]
)
def test_in_the_oldest_blender(oldest: Path, names: tuple[str, ...]) -> None:
    environment = dict(os.environ, PYTHONPATH=str(oldest))
    version = oldest.name.removeprefix("bpy-")
    asked = [sys.executable, "-c", "import bpy, os; print(bpy.app.version_string, flush=True); os._exit(0)"]
    assert subprocess.run(asked, env=environment, capture_output=True, text=True).stdout.startswith(version)
    files = [f"tests/blender/{name}" for name in names]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *files], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-3000:]
