"""Which files of a folder this program wrote and nobody changed since; all others are the user's and stay."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from itertools import count
from pathlib import Path

from .errors import FlexMapsError

NOTE = ".flexmaps-files"  # name of the file in which a folder's runs note the checksums of what they wrote there


class TheirFile(FlexMapsError):
    """A file that the user made or changed stands where this program is to write."""


class Guard:
    """Keeps the user's files: ``read`` are never written over, others that are not ours only with ``overwrite``."""

    def __init__(self, read: Iterable[str | os.PathLike[str]] = (), overwrite: bool = False):
        self._read = [Path(path) for path in read]
        self.overwrite = overwrite

    def also(self, read: Iterable[str | os.PathLike[str]]) -> None:
        """Add files that are read in this run."""
        self._read += map(Path, read)

    def check(self, targets: Iterable[Path], root: Path | None = None) -> None:
        """Raise where a target is a file that is read (``FlexMapsError``) or the user's (``TheirFile``).

        root : the folder whose note speaks of the targets; else each one's own folder
        """
        foreign = []
        for target in targets:
            if not os.path.lexists(target) or target.is_dir():
                continue
            source = next((path for path in self._read if _same(path, target)), None)
            if source is not None:
                raise FlexMapsError(
                    f"{target} is read in this run ({source}) and would be written over; {_elsewhere(target, root)}"
                )
            if not self.overwrite and not is_ours(target, root):
                foreign.append(target)
        if foreign:
            more = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
            raise TheirFile(
                f"{foreign[0]}{more} would be written over, but FlexMaps did not write it, or it was changed since; "
                f"{_elsewhere(foreign[0], root)}, or allow it (--overwrite, overwrite=True)"
            )

    def may_remove(self, path: Path, root: Path | None = None) -> bool:
        """Return whether an earlier run's file may go: it is ours, and not read in this run."""
        return is_ours(path, root) and not any(_same(source, path) for source in self._read)


def is_ours(path: Path, root: Path | None = None) -> bool:
    """Return whether a file has the checksum that the last run noted in its folder."""
    folder = path.parent if root is None else root
    noted = read_note(folder).get(_key(path, folder))
    try:
        return noted is not None and not path.is_symlink() and noted == checksum(path)
    except OSError:
        return False


def read_note(folder: Path) -> dict[str, str]:
    """The noted checksums by the files' paths relative to the folder; empty where there is no sound note."""
    try:
        noted = json.loads((folder / NOTE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return noted if isinstance(noted, dict) else {}


def note_text(folder: Path, written: dict[Path, Path], removed: Iterable[Path]) -> str:
    """The folder's note with new checksums; ``written``: the place of every file, and the path that holds its content now."""
    noted = read_note(folder) | {_key(place, folder): checksum(now) for place, now in written.items()}
    gone = {_key(path, folder) for path in removed}
    return json.dumps({name: noted[name] for name in sorted(noted) if name not in gone}, indent=1) + "\n"


def checksum(path: Path) -> str:
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _key(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()


def _same(one: Path, other: Path) -> bool:
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return False


def _elsewhere(target: Path, root: Path | None) -> str:
    """Advice that names a folder, or a file, that is free."""
    place = (target if root is None else root).absolute()
    names = (
        place.with_name(f"{place.stem}-{k}{place.suffix}" if root is None else f"{place.name}-{k}") for k in count(2)
    )
    free = next(name for name in names if not os.path.lexists(name))
    return f"write to {free} instead"
