"""Python packages of other extensions that stand where this one's were meant to.

All extensions of a Blender share one folder of packages, and of every package the newest version wins. What an extension comes
with stands in its manifest; elsewhere, as after ``pip install``, there is nothing to compare.
"""

from __future__ import annotations

import re
import traceback
from importlib import metadata
from pathlib import Path

from . import MANIFEST
from .errors import FlexMapsError

# by what name a package is imported, where that is not its own
MODULES = {"libigl": "igl", "fonttools": "fontTools"}


def strangers(manifest: Path = MANIFEST) -> dict[str, tuple[str, str]]:
    """Of every package that is there in another version than this extension comes with: that version, and ours."""
    wheels = re.findall(r'"\./wheels/([^-"]+)-([^-"]+)-', manifest.read_text(encoding="utf-8"))
    found = {}
    for name, ours in wheels:
        try:
            there = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
        if there != ours:
            found[name] = there, ours
    return found


def blamed(error: BaseException, manifest: Path = MANIFEST) -> FlexMapsError | None:
    """What another extension's package has to do with an error that nobody expected, as a sentence; None where nothing."""
    files = {Path(frame.filename).as_posix() for frame in traceback.extract_tb(error.__traceback__)}
    told = [
        f"{name} {there} instead of {ours}"
        for name, (there, ours) in strangers(manifest).items()
        if re.search(rf"\b{(module := MODULES.get(name, name))}\b", str(error))
        or any(f"/site-packages/{module}/" in file for file in files)
    ]
    if not told:
        return None
    return FlexMapsError(
        f"Another extension has put its own packages in the place of FlexMaps' ({', '.join(told)}), and they do not work here "
        f"({type(error).__name__}: {error}); disable that extension, or ask its maker for other versions"
    )
