"""Protect the user's files: overwrite or remove only files that this program wrote and nobody changed since."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from itertools import count
from pathlib import Path

from .errors import FlexMapsError

# name of the hidden file that lists, in each folder, the checksums of the files written there by this program
CHECKSUM_FILE = ".flexmaps-files"


class UserFileError(FlexMapsError):
    """A file to write exists already, and the user made or changed it."""


class Guard:
    """Check that a run overwrites or removes no file of the user.

    Parameters
    ----------
    read : input files of the run, which are never overwritten
    overwrite : whether to overwrite files of the user that are not input files
    """

    def __init__(self, read: Iterable[str | os.PathLike[str]] = (), overwrite: bool = False):
        self._read = [Path(path) for path in read]
        self.overwrite = overwrite

    def also(self, read: Iterable[str | os.PathLike[str]]) -> None:
        """Add input files to those that must not be overwritten."""
        self._read += map(Path, read)

    def check(self, targets: Iterable[Path], root: Path | None = None) -> None:
        """Check that files may be written.

        Parameters
        ----------
        targets : files to write
        root : folder with the checksums of the targets; None if each target's own folder has them

        Raises
        ------
        FlexMapsError : a target is an input file
        UserFileError : the user made or changed a target
        """
        foreign = []
        for target in targets:
            if not os.path.lexists(target) or target.is_dir():
                continue
            source = next((path for path in self._read if _same(path, target)), None)
            if source is not None:
                raise FlexMapsError(
                    f"{target} is read in this run ({source}) and would be written over; {_advise_other_target(target, root)}"
                )
            if not self.overwrite and not is_unchanged_output(target, root):
                foreign.append(target)
        if foreign:
            more = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
            raise UserFileError(
                f"{foreign[0]}{more} would be written over, but FlexMaps did not write it, or it was changed since; "
                f"{_advise_other_target(foreign[0], root)}, or allow it (--overwrite, overwrite=True)"
            )

    def may_remove(self, path: Path, root: Path | None = None) -> bool:
        """Return whether a stale file may be removed: this program wrote it, and it is not an input of this run.

        Parameters
        ----------
        path : the stale file
        root : folder with the recorded checksum; None for the file's own folder
        """
        return is_unchanged_output(path, root) and not any(_same(source, path) for source in self._read)


def is_unchanged_output(path: Path, root: Path | None = None) -> bool:
    """Return whether this program wrote a file and nobody changed it: its checksum equals the recorded one.

    Parameters
    ----------
    path : the file
    root : folder with the recorded checksum; None for the file's own folder
    """
    folder = path.parent if root is None else root
    noted = read_checksums(folder).get(_key(path, folder))
    try:
        return noted is not None and not path.is_symlink() and noted == checksum(path)
    except OSError:
        return False


def read_checksums(folder: Path) -> dict[str, str]:
    """Return the recorded checksums by the files' paths in the folder; empty if the record is missing or damaged."""
    try:
        noted = json.loads((folder / CHECKSUM_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return noted if isinstance(noted, dict) else {}


def format_checksums(folder: Path, written: dict[Path, Path], removed: Iterable[Path]) -> str:
    """Return the text of a folder's new record of checksums.

    Parameters
    ----------
    folder : holds the present record
    written : temporary path of every new file, by its target
    removed : files to delete from the record
    """
    noted = read_checksums(folder) | {_key(place, folder): checksum(now) for place, now in written.items()}
    gone = {_key(path, folder) for path in removed}
    return json.dumps({name: noted[name] for name in sorted(noted) if name not in gone}, indent=1) + "\n"


def checksum(path: Path) -> str:
    """Return a file's SHA-256 checksum."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _key(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()


def _same(one: Path, other: Path) -> bool:
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return False


def _advise_other_target(target: Path, root: Path | None) -> str:
    """Return the advice to write to another folder (with ``root``) or file, with a name that is free."""
    place = (target if root is None else root).absolute()
    names = (
        place.with_name(f"{place.stem}-{k}{place.suffix}" if root is None else f"{place.name}-{k}") for k in count(2)
    )
    free = next(name for name in names if not os.path.lexists(name))
    return f"write to {free} instead"
