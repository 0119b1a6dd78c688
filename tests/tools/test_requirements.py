"""What is downloaded is what was looked at: every pin has the checksums of its files for every system, and pip holds to them."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def lock(build_zip: ModuleType) -> ModuleType:
    made: ModuleType = build_zip.lock
    return made


def test_every_pin_has_checksums(root: Path, lock: ModuleType) -> None:
    for name, locked in (
        ("requirements/dev.txt", lock.LOCKED),
        ("requirements/runtime.txt", lock.LOCKED),
        ("tools/website/requirements.txt", lock.SITE),
    ):
        known = lock.hashes(locked.read_text(encoding="utf-8"))
        assert all(words for words in known.values())
        pins = re.findall(r"^([\w.-]+==[\w.+!]+)", (root / name).read_text(encoding="utf-8"), re.MULTILINE)
        missing = [pin for pin in pins if lock.normalise_pin(pin) not in known]
        assert pins and not missing, "python3 tools/dev.py lock"


def test_pip_refuses_another_file(lock: ModuleType, tmp_path: Path) -> None:
    """A wheel of the right name and version with another content."""
    info = "polib-1.2.0.dist-info"
    with zipfile.ZipFile(tmp_path / "polib-1.2.0-py2.py3-none-any.whl", "w") as made:
        made.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: polib\nVersion: 1.2.0\n")
        made.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py2-none-any\n")
        made.writestr(f"{info}/RECORD", "")
    words = lock.hashes(lock.LOCKED.read_text(encoding="utf-8"))["polib==1.2.0"]
    (tmp_path / "wanted.txt").write_text(f"polib==1.2.0 {' '.join(words)}\n")
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--isolated",
        "--disable-pip-version-check",
        "download",
        "--no-deps",
        "--no-index",
    ]
    pip += [
        "--find-links",
        str(tmp_path),
        "-d",
        str(tmp_path / "out"),
        "--require-hashes",
        "-r",
        str(tmp_path / "wanted.txt"),
    ]
    done = subprocess.run(pip, capture_output=True, text=True)
    assert done.returncode != 0 and "DO NOT MATCH THE HASHES" in done.stderr
