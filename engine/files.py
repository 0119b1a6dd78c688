"""Atomic writing of files: each appears complete or not at all."""

from __future__ import annotations

import errno
import os
import sys
import time
import unicodedata
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from . import own_files
from .errors import FlexMapsError
from .own_files import Guard

NewFile = Callable[[str | os.PathLike[str]], Path]
LOCK = ".flexmaps-lock"  # name of the file by which a run locks its folder


class FolderError(FlexMapsError):
    """A file or folder cannot be written; another folder would do."""


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
    errno.EIO: "the disk or its connection fails; choose another one",
    errno.EINVAL: "the name is not allowed there; choose another one",
}

_OPEN = {5, 32, 33}  # access denied, sharing violation, lock violation: usually another program has the file open
# error codes of Windows (learn.microsoft.com, System Error Codes), which are more specific than errno
_WINDOWS = {
    **dict.fromkeys(_OPEN, "another program may have it open; close it there, or choose another folder"),
    206: "the path is longer than Windows allows; choose a folder nearer to the drive",
}
# names that Windows reserves (learn.microsoft.com, Naming Files, Paths, and Namespaces)
_DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{name}{digit}" for name in ("COM", "LPT") for digit in "0123456789¹²³")}
# Largest number of UTF-8 bytes of a name; most file systems allow 255, and "-assembly", a number and a suffix are
# appended
MAX_NAME_LENGTH = 150
# Attempts to move a file, and seconds between them: virus scanners keep new files open for about a second
TRIES, PAUSE = 10, 0.1

_FULL = {errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO}  # codes of errors in write(); these name no file


def describe_error(error: OSError | ValueError) -> str:
    """Describe in words why writing failed, and what to do."""
    windows = getattr(error, "winerror", None)
    if windows in _WINDOWS:
        return _WINDOWS[windows]
    number = getattr(error, "errno", None)
    if number in _REASONS:
        return _REASONS[number]
    return f"{getattr(error, 'strerror', None) or error}; choose another name or folder"


@contextmanager
def write_atomically(path: str | os.PathLike[str], guard: Guard | None = None) -> Iterator[Path]:
    """Write a file atomically: yield a temporary path to write to; its file replaces the target at the end.

    Parameters
    ----------
    path : the target
    guard : as in ``write_all_atomically``

    Raises
    ------
    FlexMapsError : the file cannot be written
    """
    with write_all_atomically(guard=guard) as new:
        yield new(path)


@contextmanager
def write_all_atomically(
    stale: Iterable[str | os.PathLike[str]] = (),
    alone_in: str | os.PathLike[str] | None = None,
    guard: Guard | None = None,
) -> Iterator[NewFile]:
    """Write several files atomically: either all new files appear, or all old files stay; no temporary files remain.

    Yield a function from a target to a temporary path beside it, with the same suffix, to write to. Raise
    ``FlexMapsError`` if writing fails, another run has locked the folder, or the guard refuses; pass on other errors.

    Parameters
    ----------
    stale : old files to remove when the new ones appear
    alone_in : folder to lock, so that no other run writes to it meanwhile
    guard : permits changes of files that this program wrote; its checksums go to ``alone_in``, else beside the files
    """
    wanted, made = dict[Path, Path](), list[Path]()
    held: BinaryIO | None = None
    root = None if alone_in is None else Path(alone_in)

    def new(path: str | os.PathLike[str]) -> Path:
        target = Path(path)
        with _convert_write_errors(wanted):
            made.extend(_make_folder(target.parent))
            if target.is_dir():
                raise IsADirectoryError(errno.EISDIR, "is a folder", str(target))
            if guard is not None:
                guard.check([target], root)
            if target not in wanted:
                wanted[target] = _temporary_path(target)
                wanted[target].touch()  # fail before the work is done if the folder is read-only
        return wanted[target]

    try:
        if alone_in is not None:
            with _convert_write_errors(wanted):
                made.extend(_make_folder(Path(alone_in)))
                held = _folder_lock(Path(alone_in))
        try:
            yield new
        except OSError as error:
            if not _is_write_error(error, wanted):
                raise
            raise _write_error(error, wanted) from error
        with _convert_write_errors(wanted):
            gone = [p for p in map(Path, stale) if p not in wanted and p.is_file()]
            if guard is not None:
                gone = [p for p in gone if guard.may_remove(p, root)]
                _add_checksum_records(wanted, gone, root)
            _swap(wanted, gone)
        made.clear()
    finally:
        for temporary in wanted.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
        if held is not None:
            _unlock(held)
        for folder in reversed(made):
            with suppress(OSError):
                folder.rmdir()


def check_folder(folder: Path) -> None:
    """Check that files can be written into a folder, before long work begins; the folder itself is not kept.

    Raises
    ------
    FlexMapsError : the folder cannot be made, or takes no files
    """
    made, probe = list[Path](), _temporary_path(folder / "probe")
    try:
        with _convert_write_errors({folder: probe}):
            made.extend(_make_folder(folder))
            probe.touch()
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
        for new in reversed(made):
            with suppress(OSError):
                new.rmdir()


def _add_checksum_records(wanted: dict[Path, Path], gone: list[Path], root: Path | None) -> None:
    """Add to ``wanted`` the files that list checksums.

    wanted : temporary path of every file to write, by its target
    gone : files to remove; root : folder for the checksums of all files, or None for the folder of each file
    """
    for folder in {target.parent if root is None else root for target in (*wanted, *gone)}:
        own = {target: now for target, now in wanted.items() if root is not None or target.parent == folder}
        text = own_files.format_checksums(folder, own, gone)
        wanted[folder / own_files.CHECKSUM_FILE] = _temporary_path(folder / own_files.CHECKSUM_FILE)
        wanted[folder / own_files.CHECKSUM_FILE].write_text(text, encoding="utf-8")


@contextmanager
def _convert_write_errors(wanted: dict[Path, Path]) -> Iterator[None]:
    """Convert write errors to ``FlexMapsError``: OSError, and ValueError for file names with a zero byte.

    wanted : temporary path of every file to write, by its target
    """
    try:
        yield
    except (OSError, ValueError) as error:
        raise _write_error(error, wanted) from error


def _is_write_error(error: OSError, wanted: dict[Path, Path]) -> bool:
    """Return whether an error comes from writing a wanted file: it names the file, or no file (as for a full disk)."""
    if error.filename is None:
        return error.errno in _FULL
    return str(error.filename) in {str(temporary) for temporary in wanted.values()}


def _write_error(error: OSError | ValueError, wanted: dict[Path, Path]) -> FolderError:
    name = getattr(error, "filename", None)
    target = next((t for t, temporary in wanted.items() if str(temporary) == str(name)), None)
    place = target or name or next(iter(wanted), "the file")
    return FolderError(f"Cannot write {place}: {describe_error(error)}")


def safe_file_name(text: str) -> str:
    """Convert a user's text to a file name that is valid on every system.

    Punctuation, spaces and invisible characters become "_", as in Blender's own file names; letters of all scripts
    stay. Names that Windows reserves for devices get a "_" at the end. Names are cut to ``MAX_NAME_LENGTH`` bytes.
    """
    signs = (letter.isascii() and not letter.isalnum() and letter != "-" for letter in text)
    unseen = (unicodedata.category(letter)[0] in "CZ" for letter in text)
    clean = "".join("_" if any(bad) else letter for letter, *bad in zip(text, signs, unseen, strict=True))
    clean = clean.encode()[:MAX_NAME_LENGTH].decode(errors="ignore")
    return f"{clean}_" if clean.upper() in _DEVICES else clean


def _temporary_path(target: Path) -> Path:
    """Return an unused hidden path in the target's folder, with its suffix, by which some writers choose the format."""
    return target.with_name(f".{uuid.uuid4().hex[:12]}{target.suffix}")


def _folder_lock(folder: Path) -> BinaryIO:
    """Lock a folder until ``_unlock``, or until the process ends for any reason.

    Raises ``FlexMapsError`` if another run has locked it.
    """
    while True:
        stream = open(folder / LOCK, "ab")  # noqa: SIM115  # the open file is the lock
        if not _lock(stream):
            stream.close()
            raise FolderError(
                f"Another run is writing into {folder}; wait until it has ended, or choose another folder"
            )
        with suppress(FileNotFoundError):
            if os.path.samestat(os.stat(stream.name), os.fstat(stream.fileno())):
                return stream
        stream.close()  # the previous run has just removed this file: try again with a new one


def _lock(stream: BinaryIO) -> bool:
    """Try to lock a file; return False if another process has locked it. Succeeds on file systems without locks."""
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in (errno.EAGAIN, errno.EACCES)
    return True


def _unlock(stream: BinaryIO) -> None:
    # remove the file while it is locked, so that no other run can lock a file that is about to vanish; Windows cannot
    # remove open files, so there it is closed first
    windows = sys.platform == "win32"
    with suppress(OSError):
        if not windows:
            os.unlink(stream.name)
    stream.close()
    with suppress(OSError):
        if windows:
            os.unlink(stream.name)


def _make_folder(folder: Path) -> list[Path]:
    """Make a folder and its missing parents; return the new folders, outermost first."""
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
    return missing[::-1]


def _move(source: Path, target: Path) -> None:
    """Move a file as ``os.replace`` does; on Windows, retry while another program has one of the files open."""
    for left in reversed(range(TRIES)):
        try:
            os.replace(source, target)
            return
        except OSError as error:
            if not left or getattr(error, "winerror", None) not in _OPEN:
                raise
            time.sleep(PAUSE)


def _swap(wanted: dict[Path, Path], stale: list[Path]) -> None:
    """Move all new files to their targets and remove stale ones; restore the old files on any error."""
    done: list[tuple[Path, Path | None]] = []
    try:
        for target in [*wanted, *stale]:
            old = None
            if target.exists() or target.is_symlink():
                old = _temporary_path(target)
                _move(target, old)
            done.append((target, old))
            if target in wanted:
                _move(wanted[target], target)
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
