"""``lock`` of tools/dev.py: requirements/locked.txt anew, every package that is downloaded with the checksums of all its files.

What is wanted stands in dev.txt and runtime.txt, for people. From these uv (https://docs.astral.sh/uv) finds what else comes with
them on every system and Python, and asks the package index for the checksums. pip refuses any file that has none of them.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "requirements"
LOCKED = FOLDER / "locked.txt"
HEAD = "# Made by `python3 tools/dev.py lock` from dev.txt and runtime.txt: every package, its files' checksums; pip takes no others\n"


def main(argv: list[str]) -> int:
    """Write the file anew; the exit status is 0 when that went well."""
    with tempfile.TemporaryDirectory() as place:
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q", "--target", place, "uv"]
        subprocess.run(pip, check=True)
        uv = next(path for path in Path(place).rglob("uv*") if path.name in {"uv", "uv.exe"} and path.is_file())
        made = Path(place) / LOCKED.name
        made.write_bytes(LOCKED.read_bytes() if LOCKED.is_file() else b"")  # what comes along stays in its version
        options = ["--universal", "--python-version", "3.11", "--generate-hashes", "--no-header", "--no-annotate", "-q"]
        subprocess.run([uv, "pip", "compile", str(FOLDER / "dev.txt"), *options, "-o", str(made)], check=True)
        LOCKED.write_text(HEAD + made.read_text(encoding="utf-8"), encoding="utf-8", newline="\n")
    print(f"{LOCKED.relative_to(ROOT)}: {len(hashes(LOCKED.read_text(encoding='utf-8')))} packages")
    return 0


def hashes(text: str) -> dict[str, list[str]]:
    """Of every name==version, as ``plain`` writes it, the words that tell pip its files' checksums."""
    found: dict[str, list[str]] = {}
    for entry in re.split(r"\n(?=[\w])", text):
        pin = re.match(r"([\w.-]+)==([\w.+!]+)", entry)
        if pin:
            found.setdefault(plain(pin[0]), []).extend(re.findall(r"--hash=\S+", entry))
    return found


def plain(pin: str) -> str:
    """A name==version as package indexes compare names (PEP 503)."""
    name, _, version = pin.partition("==")
    return f"{re.sub(r'[-_.]+', '-', name).lower()}=={version}"
