"""Names of numbered files, one per sheet, and surplus files of an earlier run that may be removed."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

from ... import PROGRAM

_SEARCHED_BYTES = 1 << 16  # number of bytes at each end of a file searched for this program's name; more read longer


def numbered_paths(path: str | os.PathLike[str], count: int) -> list[Path]:
    """Return ``count`` paths out/sheet-01.svg, out/sheet-02.svg, ... for the path out/sheet.svg."""
    path = Path(path)
    return [path.with_name(f"{path.stem}-{i + 1:02d}{path.suffix}") for i in range(count)]


def surplus_paths(path: str | os.PathLike[str], count: int) -> list[Path]:
    """Return the files numbered ``count`` + 1 and on that an earlier run of this program left.

    Parameters
    ----------
    path : path of the files without number
    count : number of sheets of this run
    """
    found: list[Path] = []
    path = Path(path)
    while os.path.isfile(old := path.with_name(f"{path.stem}-{count + len(found) + 1:02d}{path.suffix}")):
        found.append(old)
    return [old for old in found if is_own_file(old)]


def is_own_file(path: Path) -> bool:
    """Return whether a file contains this program's name, as all files of sheets do."""
    mark = PROGRAM.encode()
    try:
        if path.suffix.lower() == ".3mf":
            with zipfile.ZipFile(path) as package, package.open("3D/3dmodel.model") as model:
                return mark in model.read(_SEARCHED_BYTES)
        with open(path, "rb") as stream:
            head = stream.read(_SEARCHED_BYTES)
            stream.seek(max(path.stat().st_size - _SEARCHED_BYTES, 0))
            return mark in head or mark in stream.read()
    except (OSError, KeyError, ValueError, zipfile.BadZipFile, NotImplementedError, RuntimeError):
        return False  # do not remove files that cannot be read
