"""Numbered files, one per sheet, and the files of an earlier run that may be removed."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

from ... import PROGRAM

_LOOK = 1 << 16  # bytes at either end of a file that are searched for the program's name


def numbered_paths(path: str | os.PathLike[str], count: int) -> list[Path]:
    """Return out/sheet-01.svg, out/sheet-02.svg, ... for out/sheet.svg."""
    path = Path(path)
    return [path.with_name(f"{path.stem}-{i + 1:02d}{path.suffix}") for i in range(count)]


def numbered_before(path: str | os.PathLike[str], count: int) -> list[Path]:
    """Return consecutive files of an earlier run with more sheets than ``count``, only those written by this program."""
    found: list[Path] = []
    path = Path(path)
    while os.path.isfile(old := path.with_name(f"{path.stem}-{count + len(found) + 1:02d}{path.suffix}")):
        found.append(old)
    return [old for old in found if ours(old)]


def ours(path: Path) -> bool:
    """Return whether a file contains this program's name, as all files of sheets do."""
    mark = PROGRAM.encode()
    try:
        if path.suffix.lower() == ".3mf":
            with zipfile.ZipFile(path) as package, package.open("3D/3dmodel.model") as model:
                return mark in model.read(_LOOK)
        with open(path, "rb") as stream:
            head = stream.read(_LOOK)
            stream.seek(max(path.stat().st_size - _LOOK, 0))
            return mark in head or mark in stream.read()
    except (OSError, KeyError, ValueError, zipfile.BadZipFile, NotImplementedError, RuntimeError):
        return False  # do not remove files that cannot be read
