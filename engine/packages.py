"""Detect Python packages that another Blender extension has replaced by its own version.

All extensions share one folder of packages, in which the newest version of a package wins. The manifest lists the
versions that this extension installs; a manifest without wheels, as in an installation by ``pip``, gives nothing to
compare.
"""

from __future__ import annotations

import re
import traceback
from importlib import metadata
from pathlib import Path

from . import MANIFEST
from .errors import FlexMapsError

# module name by package name, for packages whose module has another name
MODULES = {"libigl": "igl", "fonttools": "fontTools"}


def replaced_packages(manifest: Path = MANIFEST) -> dict[str, tuple[str, str]]:
    """Return the packages whose installed version differs from the manifest's: (installed, manifest's) by name."""
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


def blame_extension(error: BaseException, manifest: Path = MANIFEST) -> FlexMapsError | None:
    """Return an error that blames another extension if packages that it replaced are involved in an unexpected error.

    Parameters
    ----------
    error : the unexpected error, with its traceback
    manifest : file that lists the versions which this extension installs

    Returns
    -------
    None if no replaced package is involved
    """
    files = {Path(frame.filename).as_posix() for frame in traceback.extract_tb(error.__traceback__)}
    suspects = [
        f"{name} {there} instead of {ours}"
        for name, (there, ours) in replaced_packages(manifest).items()
        if re.search(rf"\b{(module := MODULES.get(name, name))}\b", str(error))
        or any(f"/site-packages/{module}/" in file for file in files)
    ]
    if not suspects:
        return None
    return FlexMapsError(
        f"Another extension has put its own packages in the place of FlexMaps' ({', '.join(suspects)}), and they do not work here "
        f"({type(error).__name__}: {error}); disable that extension, or ask its maker for other versions"
    )
