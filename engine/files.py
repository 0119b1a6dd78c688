"""Writing files so that they appear whole or not at all."""

from __future__ import annotations

import errno
import os
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import FlexMapsError

_REASONS = {
    errno.ENOSPC: "the disk is full; make room and try again",
    errno.EFBIG: "the file would be too large for that disk; choose another one",
    errno.EDQUOT: "your disk quota is used up; make room and try again",
    errno.EACCES: "you may not write there; choose another folder or change its permissions",
    errno.EPERM: "you may not write there; choose another folder or change its permissions",
    errno.EROFS: "the folder is read-only; choose another folder",
    errno.ENOENT: "the folder does not exist and could not be made; choose another folder",
    errno.ENOTDIR: "a part of the path is a file and no folder; choose another folder",
    errno.EISDIR: "a folder of that name is in the way; choose another name",
    errno.EEXIST: "a file of that name is in the way of the folder; choose another folder",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
    errno.EINVAL: "the name is not allowed there; choose another one",
}


def reason(error: OSError | ValueError) -> str:
    """What went wrong, and what to do about it."""
    number = getattr(error, "errno", None)
    if number in _REASONS:
        return _REASONS[number]
    return f"{getattr(error, 'strerror', None) or error}; choose another name or folder"


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write one file whole or not at all: gives a temporary path beside it, which takes its place at the end."""
    with replacing_many() as new:
        yield new(path)


@contextmanager
def replacing_many(stale: Iterable[str | os.PathLike[str]] = ()) -> Iterator[Callable[[str | os.PathLike[str]], Path]]:
    """Write several files so that all of them appear, or none and the earlier ones stay as they were.

    Gives a function that takes the path of a wanted file and returns a temporary path beside it, of the same suffix, to
    write to. ``stale`` are old files that vanish when the new ones appear. Raises ``FlexMapsError`` where the folder cannot
    be written to or the disk is full; whatever is raised inside, no temporary file is left.
    """
    wanted: dict[Path, Path] = {}
    made: list[Path] = []
    try:

        def new(path: str | os.PathLike[str]) -> Path:
            target = Path(path)
            made.extend(_make_folder(target.parent))
            if target.is_dir():
                raise IsADirectoryError(errno.EISDIR, "is a folder", str(target))
            if target not in wanted:
                wanted[target] = _beside(target)
                wanted[target].touch()  # a folder that cannot be written to says so before the work is done
            return wanted[target]

        yield new
        _swap(wanted, [p for p in map(Path, stale) if p not in wanted and p.is_file()])
        made.clear()
    except (OSError, ValueError) as error:
        if isinstance(error, ValueError) and "null" not in str(error):
            raise
        name = getattr(error, "filename", None)
        target = next((t for t, temporary in wanted.items() if str(temporary) == str(name)), None)
        place = target or name or next(iter(wanted), "the file")
        raise FlexMapsError(f"Cannot write {place}: {reason(error)}") from error
    finally:
        for temporary in wanted.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
        for folder in reversed(made):
            with suppress(OSError):
                folder.rmdir()


def _beside(target: Path) -> Path:
    """A free name in the same folder and of the same suffix, so that writers that look at suffixes are content."""
    return target.with_name(f".{uuid.uuid4().hex[:12]}{target.suffix}")


def _make_folder(folder: Path) -> list[Path]:
    """Make the folder and the missing ones above it; returns those that were made."""
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
    return missing[::-1]


def _swap(wanted: dict[Path, Path], stale: list[Path]) -> None:
    """Put all new files in their places; on any error put the old ones back."""
    done: list[tuple[Path, Path | None]] = []
    try:
        for target in [*wanted, *stale]:
            old = None
            if target.exists() or target.is_symlink():
                old = _beside(target)
                os.replace(target, old)
            done.append((target, old))
            if target in wanted:
                os.replace(wanted[target], target)
    except BaseException:
        for target, old in reversed(done):
            with suppress(OSError):
                if old is None:
                    target.unlink(missing_ok=True)
                else:
                    os.replace(old, target)
        raise
    for _, old in done:
        if old is not None:
            with suppress(OSError):
                old.unlink()
