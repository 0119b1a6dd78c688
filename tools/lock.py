"""``lock`` of tools/dev.py: requirements/locked.txt anew, every package that is downloaded with the checksums of all its files, and
the same of what makes the site.

What is wanted stands in dev.txt and runtime.txt, and in tools/website/requirements.txt, for people. From these uv (https://docs.astral.sh/uv) finds what else comes with
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
WEBSITE = ROOT / "tools" / "website"
SITE = WEBSITE / "locked.txt"
HEAD = "# Made by `python3 tools/dev.py lock` from {}: every package, its files' checksums; pip takes no others\n"


def main(argv: list[str]) -> int:
    """Write the files anew; the exit status is 0 when that went well."""
    with tempfile.TemporaryDirectory() as place:
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q", "--target", place, "uv"]
        subprocess.run(pip, check=True)
        uv = next(path for path in Path(place).rglob("uv*") if path.name in {"uv", "uv.exe"} and path.is_file())
        _locked(uv, FOLDER / "dev.txt", LOCKED, "dev.txt and runtime.txt", "3.11")
        # of this one every package is named, and one wants the fifth Python 3.11 or newer
        _locked(uv, WEBSITE / "requirements.txt", SITE, "requirements.txt", "3.11.5", "--no-deps")
    return 0


def _locked(uv: Path, wanted: Path, target: Path, of: str, python: str, *more: str) -> None:
    """Write a file of checksums of what another one wants on a Python or newer; what only comes along stays in its version."""
    options = [
        "--universal",
        "--python-version",
        python,
        "--generate-hashes",
        "--no-header",
        "--no-annotate",
        "-q",
        *more,
    ]
    with tempfile.TemporaryDirectory() as place:
        made = Path(place) / target.name
        made.write_bytes(target.read_bytes() if target.is_file() else b"")
        subprocess.run([uv, "pip", "compile", str(wanted), *options, "-o", str(made)], check=True)
        text = HEAD.format(of) + made.read_text(encoding="utf-8")
    target.write_text(text, encoding="utf-8", newline="\n")
    print(f"{target.relative_to(ROOT)}: {len(hashes(text))} packages")


def hashes(text: str) -> dict[str, list[str]]:
    """Return pip's hash options for every name==version, as ``plain`` writes it."""
    found: dict[str, list[str]] = {}
    for entry in re.split(r"\n(?=[\w])", text):
        pin = re.match(r"([\w.-]+)==([\w.+!]+)", entry)
        if pin:
            found.setdefault(normalise_pin(pin[0]), []).extend(re.findall(r"--hash=\S+", entry))
    return found


def normalise_pin(pin: str) -> str:
    """A name==version as package indexes compare names (PEP 503)."""
    name, _, version = pin.partition("==")
    return f"{re.sub(r'[-_.]+', '-', name).lower()}=={version}"
