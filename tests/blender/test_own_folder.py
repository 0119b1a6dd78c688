"""Everything that the program writes against a folder of the user's files, on a full disk, where nothing may be written, and cancelled midway."""

from __future__ import annotations

import os
import resource
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import bpy
import pytest
from flexmaps import api
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.fabrication.writers.export import FORMATS

FAST = {"sheet.nesting": "FAST"}
INPUTS = (
    "mesh.obj",
    "mesh.stl",
    "scan.ply",
    "remnant.dxf",
    "remnant.svg",
    "preset.py",
    "measured.json",
    "notes.txt",
    "piece.blend",
)
NOBODY = 65534  # a user who may write nowhere
Tell = Callable[[float, str], None] | None


def sheets(piece: Any, out: Path, tell: Tell) -> None:
    api.export(piece, out, formats=("svg", "pdf"), progress=tell)


def all_formats(piece: Any, out: Path, tell: Tell) -> None:
    api.export(piece, out, formats=FORMATS, progress=tell)


def report(piece: Any, out: Path, tell: Tell) -> None:
    api.report(piece, out, progress=tell)


def share(piece: Any, out: Path, tell: Tell) -> None:
    api.share(piece, out / "share.html", progress=tell)


def blend(piece: Any, out: Path, tell: Tell) -> None:
    if tell is not None:
        tell(0.0, "")
    api.save(piece, out / "model.blend")


def everything(piece: Any, out: Path, tell: Tell) -> None:
    api.run("shape:strip", out, edge=20, settings=FAST, pictures=False, stop_after="spirals", progress=tell)


def calibration(piece: Any, out: Path, tell: Tell) -> None:
    api.calibration_sheet(out, progress=tell)


def pictures(piece: Any, out: Path, tell: Tell) -> None:
    api.run("shape:strip", out, edge=20, settings=FAST, stop_after="merge", progress=tell)


def explore(piece: Any, out: Path, tell: Tell) -> None:
    api.explore(piece, {"spiral.thickness": [1.5, 2.0]}, out, progress=tell)


LONG = (pytest.param(one, marks=pytest.mark.thorough) for one in (all_formats, pictures))
OUTPUTS = (sheets, report, share, blend, everything, calibration, *LONG)


@contextmanager
def full_disk() -> Iterator[None]:
    """No file may grow beyond some bytes, as on a disk that is nearly full."""
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (600, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    folder.chmod(0o555)
    user = os.geteuid()
    if user == 0:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(user)
        folder.chmod(0o755)


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def piece() -> Any:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return api.simulate(api.spirals(api.load("shape:strip", edge=20, settings=FAST)))


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that another user may enter: pytest shuts its own whenever another run of it begins."""
    with tempfile.TemporaryDirectory(prefix="flexmaps-") as place:
        Path(place).chmod(0o755)
        yield Path(place)


@pytest.mark.thorough
def test_an_exploration_loses_nothing(piece: Any, tmp_path: Path) -> None:
    """One that is stopped keeps what it has found, so that its own files may change."""
    for name in INPUTS:
        (tmp_path / name).write_bytes(f"the user's {name}".encode())
    told: list[float] = []
    explore(piece, tmp_path, lambda fraction, text: told.append(fraction))
    for stop in sorted({0, len(told) // 2, len(told) - 1}):
        calls: list[float] = []

        def tell(fraction: float, text: str, calls: list[float] = calls, stop: int = stop) -> None:
            calls.append(fraction)
            if len(calls) > stop:
                raise Cancelled

        with suppress(Cancelled):
            explore(piece, tmp_path, tell)
    written = content(tmp_path)
    assert all(written[name] == f"the user's {name}".encode() for name in INPUTS)
    changed = next(name for name in written if name not in INPUTS and not name.startswith("."))
    (tmp_path / changed).write_bytes(b"the user went on with it")
    with pytest.raises(FlexMapsError):
        explore(piece, tmp_path, None)
    assert (tmp_path / changed).read_bytes() == b"the user went on with it"


@pytest.mark.parametrize("write", OUTPUTS, ids=lambda one: one.__name__)
def test_nothing_is_lost(piece: Any, open_folder: Path, write: Callable) -> None:
    out = open_folder
    for name in INPUTS:
        (out / name).write_bytes(f"the user's {name}".encode())
    told: list[float] = []
    write(piece, out, None)
    write(piece, out, lambda fraction, text: told.append(fraction))
    written = content(out)
    assert len(written) > len(INPUTS)
    assert all(written[name] == f"the user's {name}".encode() for name in INPUTS)
    with full_disk(), pytest.raises(FlexMapsError):
        write(piece, out, None)
    assert content(out) == written
    with read_only(out), pytest.raises(FlexMapsError):
        write(piece, out, None)
    assert content(out) == written
    for stop in sorted({0, len(told) // 2, len(told) - 1} if told else {0}):
        calls: list[float] = []

        def tell(fraction: float, text: str, calls: list[float] = calls, stop: int = stop) -> None:
            calls.append(fraction)
            if len(calls) > stop:
                raise Cancelled

        with pytest.raises(Cancelled):
            write(piece, out, tell)
        assert content(out) == written
    changed = next(name for name in written if name not in INPUTS and not name.startswith("."))
    (out / changed).write_bytes(b"the user went on with it")
    with pytest.raises(FlexMapsError):
        write(piece, out, None)
    assert content(out) == written | {changed: b"the user went on with it"}
