"""Files on a disk of Windows, mounted here: one file for names that differ in case alone, and no name that Windows refuses.

NTFS through ntfs-3g, as root on Linux, in a mount namespace that ends with its process; nothing stays mounted.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
NAMES = (
    "Vase",
    "vase",
    "VASE.001",
    "con",
    "aux.svg",
    "COM\u00b9",
    "a:b",
    'say "x"',
    "a?b*c|d<e>",
    "piece. ",
    "..",
    "花瓶",
    "q" * 300,
)

MOUNTED = """
lowntfs-3g "$1" "$2" -o ignore_case,windows_names || exit 77
cd "$2" && shift 2 && exec "$@"
"""
BEGIN = """
import json, os, sys
from pathlib import Path
sys.path.append(sys.argv[1])
import dev
dev.load_package()
words = json.loads(sys.argv[2])
"""

FILES = """
from flexmaps.engine import files
from flexmaps.engine.errors import FlexMapsError

Path("Probe").touch()
assert Path("pROBE").exists(), "names that differ in case alone are one"
Path("Probe").unlink()
told = {}
for name in words:  # as they are called, in one folder
    Path(f"{files.safe_file_name(name)}-01.svg").write_text(name)
told["written"] = sorted(path.name for path in Path().iterdir())
try:
    with files.write_atomically("a:b.svg") as new:
        new.write_text("x")
except FlexMapsError as error:
    told["refused"] = str(error)
folder = Path("out")
folder.mkdir()
(folder / "Sheet-01.svg").write_text("old")
(folder / "SHEET-02.svg").write_text("old")
with files.write_all_atomically([folder / "sheet-02.svg"], folder) as new:
    new(folder / "sheet-01.svg").write_text("new")
    try:
        with files.write_all_atomically(alone_in=Path("OUT")):
            told["held"] = ""
    except FlexMapsError as error:
        told["held"] = str(error)
told["out"] = {path.name: path.read_text() for path in folder.iterdir()}
print(json.dumps(told))
"""

RUN = """
from flexmaps.command import main
import flexmaps
flexmaps.register()
common = ["--nesting", "FAST", "--no-pictures", "--formats", "svg", "dxf"]
told = [main.main(["run", "shape:strip", "--out", out, *common]) for out in ("Out", "oUT")]
print(json.dumps([told, sorted(path.name for path in Path("out").iterdir()), [path.name for path in Path().iterdir()]]))
sys.stdout.flush()
os._exit(0)
"""


@pytest.fixture(scope="module")
def disk() -> None:
    """Skips where no such disk can be mounted; fetches Debian's ntfs-3g where that is allowed."""
    if sys.platform != "linux" or os.geteuid() != 0 or not Path("/dev/fuse").exists():
        pytest.skip("a disk of Windows is mounted by root on Linux alone, through /dev/fuse")
    if shutil.which("lowntfs-3g") is None and shutil.which("apt-get") is not None:
        subprocess.run(["apt-get", "install", "-q", "-y", "ntfs-3g"], capture_output=True)
    if shutil.which("lowntfs-3g") is None or shutil.which("mkntfs") is None:
        pytest.skip("ntfs-3g is missing, which mounts a disk of Windows")


def on_disk(script: str, words: Any, folder: Path) -> Any:
    """What a script prints last whose working folder is the root of a fresh disk."""
    image, place = folder / "disk.img", folder / "disk"
    place.mkdir()
    with open(image, "wb") as stream:
        stream.truncate(64_000_000)  # bytes; only what is written takes room
    subprocess.run(["mkntfs", "-F", "-Q", "-q", str(image)], check=True, capture_output=True)
    (folder / "script.py").write_text(BEGIN + script, encoding="utf-8")
    inside = ["sh", "-c", MOUNTED, "sh", str(image), str(place)]
    python = [sys.executable, str(folder / "script.py"), str(ROOT / "tools"), json.dumps(words)]
    done = subprocess.run(["unshare", "-m", *inside, *python], capture_output=True, text=True, timeout=280)
    if done.returncode == 77:
        pytest.skip(f"no disk could be mounted: {done.stderr.strip()[-200:]}")
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_names_and_files_that_take_each_other_s_place(disk: None, tmp_path: Path) -> None:
    told = on_disk(FILES, NAMES, tmp_path)
    assert len(told["written"]) == len(NAMES) - 1, (
        "Vase and vase are one, which the caller has to see to; all others are there"
    )
    assert "a:b.svg: the name is not allowed there" in told["refused"]
    assert "Another run is writing into OUT" in told["held"]
    assert told["out"] == {"sheet-01.svg": "new"}, "the earlier files went, by whatever case they are called"


@pytest.mark.thorough
def test_the_main_job_twice_into_one_folder(disk: None, tmp_path: Path) -> None:
    statuses, files, top = on_disk(RUN, None, tmp_path)
    assert statuses == [0, 0]
    assert [name.casefold() for name in top] == ["out"], "one folder, by whatever case it is called"
    assert {"sheet-01.svg", "sheet-01.dxf", "report.html", "report.json", "model.blend"} <= set(files)
    assert not [name for name in files if name.startswith(".")]
