"""A repository on a web server of this machine: added to Blender, installed from, updated from, and broken on the way."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from flexmaps.engine import VERSION

pytestmark = pytest.mark.timeout(900)  # Blender starts many times, maybe on a busy machine
NEXT = "99.0.0"

# steps come as lines of JSON on standard input, answers go as lines to standard output
SCRIPT = """
import json, os, sys
from pathlib import Path
import bpy
import addon_utils

user, address = sys.argv[-2:]
preferences = bpy.context.preferences
preferences.system.use_online_access = True
repo = preferences.extensions.repos.new(name="FlexMaps", module="flexmaps_shop", remote_url=address)
index = list(preferences.extensions.repos).index(repo)

def version():
    manifest = Path(repo.directory, "flexmaps", "blender_manifest.toml")
    return [x.split('"')[1] for x in manifest.read_text().splitlines() if x.startswith("version")][0] if manifest.is_file() else None

def install():
    try:
        bpy.ops.extensions.repo_sync(repo_index=index)
        bpy.ops.extensions.package_install(repo_index=index, pkg_id="flexmaps", enable_on_install=True)
    except RuntimeError as error:
        return str(error)
    return ""

def update():
    try:
        bpy.ops.extensions.repo_sync(repo_index=index)  # what "Check for Updates" does
        bpy.ops.extensions.package_upgrade_all(use_active_only=False)
    except RuntimeError as error:
        return str(error)
    return ""

def offered():
    listed = json.loads(Path(repo.directory, ".blender_ext", "index.json").read_text())["data"]
    return [entry["version"] for entry in listed]

def api():
    import importlib
    return importlib.import_module("bl_ext.flexmaps_shop.flexmaps.api")

def make(path):
    piece = api().spirals(api().load("shape:strip", edge=20))
    api().save(piece, path)
    return len(piece.result.design.width)

def read(path):
    piece = api().load(path)
    return len(api().simulate(piece).result.design.width)

for line in sys.stdin:
    name, *words = json.loads(line)
    found = {f.__name__: f for f in (version, install, update, offered, make, read)}[name](*words)
    print("ANSWER " + json.dumps(found), flush=True)
os._exit(0)
"""


@pytest.fixture
def served(fresh_blender: ModuleType, tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """A folder on a web server, and the address of its index."""
    folder = tmp_path / "served"
    folder.mkdir()
    with fresh_blender.serve_folder(folder) as address:
        yield folder, f"{address}/index.json"


class Blender:
    """A Blender of its own, whose Python sees nothing of this environment but Blender itself."""

    def __init__(self, folder: Path, address: str, environment: dict[str, str]):
        (folder / "script.py").write_text(SCRIPT)
        command = [sys.executable, "-S", str(folder / "script.py"), str(folder / "user"), address]
        self._process = subprocess.Popen(
            command, env=environment, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, *words: str) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(words) + "\n")
        self._process.stdin.flush()
        for line in self._process.stdout:
            if line.startswith("ANSWER "):
                return json.loads(line.removeprefix("ANSWER "))
        raise AssertionError("Blender ended")

    def end(self) -> None:
        self._process.kill()
        self._process.wait()


@pytest.fixture
def blender(tmp_path: Path, served: tuple[Path, str], alone: dict[str, str]) -> Iterator[Blender]:
    made = Blender(tmp_path, served[1], alone)
    yield made
    made.end()


def newer(path: Path, version: str) -> Path:
    """A copy of a zip that says it is of another version."""
    target = path.with_name(path.name.replace(f"-{VERSION}-", f"-{version}-"))
    with zipfile.ZipFile(path) as given, zipfile.ZipFile(target, "w") as made:
        for entry in given.infolist():
            data = given.read(entry)
            if entry.filename == "blender_manifest.toml":
                data = data.replace(f'\nversion = "{VERSION}"'.encode(), f'\nversion = "{version}"'.encode())
            made.writestr(entry, data, entry.compress_type)
    return target


def test_installed_updated_and_not_broken(
    build_zip: ModuleType, zip_file: Path, served: tuple[Path, str], blender: Blender, tmp_path: Path
) -> None:
    folder, _ = served
    first = Path(shutil.copy2(zip_file, tmp_path))
    build_zip.repository([first], folder)
    page = (folder / "index.html").read_text()
    assert first.name in page, "what is dragged into Blender"
    assert blender.ask("install") == ""
    assert blender.ask("version") == VERSION
    spirals = blender.ask("make", str(tmp_path / "old.blend"))

    second = newer(first, NEXT)
    build_zip.repository([second], folder)
    (folder / second.name).write_bytes(second.read_bytes()[:-1000])  # a download that breaks off
    blender.ask("update")
    assert blender.ask("offered") == [NEXT], "the newer version is seen"
    assert blender.ask("version") == VERSION, "the old version stays"
    assert blender.ask("read", str(tmp_path / "old.blend")) == spirals

    whole = second.read_bytes()
    (folder / second.name).write_bytes(whole[:-1000] + bytes(1000))  # of the right length, with another checksum
    blender.ask("update")
    assert blender.ask("version") == VERSION

    build_zip.repository([second], folder)
    assert blender.ask("update") == ""
    assert blender.ask("version") == NEXT
    assert blender.ask("read", str(tmp_path / "old.blend")) == spirals
