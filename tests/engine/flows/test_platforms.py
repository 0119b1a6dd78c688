"""What Windows and macOS do otherwise, as far as that can be played here: locks, names, processes, consoles, compiled files."""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from flexmaps.engine import files
from flexmaps.engine.errors import FlexMapsError

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ("engine", "bridge", "api", "command", "operators", "panels", "database")


class Held(PermissionError):
    """As Windows raises it where another program has a file open."""

    winerror = 32


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that has a viewer hold a file for a number of tries; pauses take no time."""
    replace = os.replace
    waited: list[float] = []
    monkeypatch.setattr(files.time, "sleep", waited.append)

    def hold(path: Path, tries: int) -> list[float]:
        left = [tries]

        def replaced(source: Any, target: Any) -> None:
            if path in (Path(source), Path(target)) and left[0] > 0:
                left[0] -= 1
                raise Held(
                    13, "The process cannot access the file because it is being used", str(source), 32, str(target)
                )
            replace(source, target)

        monkeypatch.setattr(os, "replace", replaced)
        return waited

    return hold


def test_a_file_that_is_held_for_a_moment(held: Any, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    waited = held(path, 3)
    with files.write_atomically(path) as new:
        new.write_text("new")
    assert path.read_text() == "new" and len(waited) == 3
    assert [one.name for one in tmp_path.iterdir()] == ["report.html"]


def test_a_file_that_is_held_for_good(held: Any, tmp_path: Path) -> None:
    """One clear error after a second, and everything as it was, the files beside it too."""
    path, other = tmp_path / "sheet-02.svg", tmp_path / "sheet-01.svg"
    path.write_text("old")
    other.write_text("old")
    waited = held(path, 10**6)
    with pytest.raises(FlexMapsError, match=r"sheet-02\.svg: another program may have it open; close it"):
        with files.write_all_atomically() as new:
            new(other).write_text("new")
            new(path).write_text("new")
    assert sum(waited) < 2.0
    assert {one.name: one.read_text() for one in tmp_path.iterdir()} == {path.name: "old", other.name: "old"}


def test_a_path_that_is_too_long_for_windows(tmp_path: Path) -> None:
    class TooLong(FileNotFoundError):
        winerror = 206

    with (
        pytest.raises(FlexMapsError, match="longer than Windows allows"),
        files.write_atomically(tmp_path / "a.svg") as new,
    ):
        raise TooLong(2, "The filename or extension is too long", str(new))


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("Vase.001", "Vase_001"), ("CON", "CON_"), ("nul", "nul_"), ("com7", "com7_"), ("Com7a", "Com7a"), ("aux.x", "aux_x"), ("COM\u00b9", "COM\u00b9_"),
        ("piece. ", "piece__"), ("..", "__"), ("../../etc/x", "______etc_x"), ("C:\\x", "C__x"), ("a\u202eb\u2028\ud800", "a_b__"),
        ("花瓶 é ☂", "花瓶_é_☂"), ("हिन्दी", "हिन्दी"), ("", ""),
    ],
)  # fmt: skip
def test_names_of_files(name: str, wanted: str) -> None:
    assert files.safe_file_name(name) == wanted
    assert files.safe_file_name(wanted) == wanted, "twice is the same"


def test_long_names_leave_room(tmp_path: Path) -> None:
    for letter in "a花\U0001f33b":
        (tmp_path / f"{files.safe_file_name(letter * 255)}-assembly-01.svg").write_text(
            ""
        )  # as long as a file system takes


def test_processes_are_started_anew_everywhere() -> None:
    """Windows and macOS know no fork, and Blender must not be forked: nothing of the package asks for one, or leaves it open."""
    forbidden = (
        r"^\s*(import|from) multiprocessing|\bos\.(fork|forkpty|posix_spawn)\b|ProcessPoolExecutor\(|preexec_fn="
    )
    for path in (path for folder in PACKAGE for path in (ROOT / folder).rglob("*.py")):
        found = re.search(forbidden, path.read_text(encoding="utf-8"), re.MULTILINE)
        assert found is None, f"{path}: {found}"


def test_no_two_files_differ_in_case_alone() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True).stdout.decode()
    names = listed.split("\0")[:-1]
    assert len({name.casefold() for name in names}) == len(names)
    devices = {part.split(".")[0].upper() for name in names for part in name.split("/")} & files._DEVICES
    assert not devices and max(map(len, names)) < 120, "a checkout on Windows has 260 letters for the folder before"


def test_a_console_that_lacks_letters(tmp_path: Path) -> None:
    """The command line with the code pages of Western Windows and of its old consoles, and names in other scripts."""
    mesh = tmp_path / "花瓶.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    script = "import sys; sys.path.append(sys.argv.pop(1)); import dev; dev.load_package()\nfrom flexmaps.command import main; "
    script += "sys.stdout.flush(); import os; status = main.main(sys.argv[1:]); sys.stdout.flush(); os._exit(status)"
    for file, status, page in ((mesh, (0, 2), "cp437"), (mesh.with_name("वृक्ष.obj"), (2,), "cp1252")):
        environment = dict(os.environ, PYTHONIOENCODING=page, PYTHONUTF8="0")
        command = [sys.executable, "-c", script, str(ROOT / "tools"), "check", str(file)]
        done = subprocess.run(command, env=environment, capture_output=True, timeout=120)
        told = (done.stdout + done.stderr).decode(page)
        assert done.returncode in status and "Traceback" not in told and "fault" not in told, told
    assert "\\u0935" in told, "what the console cannot show is told by its number"


def _elf(machine: int, needs: bytes = b"") -> bytes:
    return b"\x7fELF" + bytes(14) + struct.pack("<H", machine) + bytes(40) + needs


def _pe(machine: int) -> bytes:
    return b"MZ" + bytes(58) + struct.pack("<I", 64) + b"PE\0\0" + struct.pack("<H", machine)


def _mach(processor: int) -> bytes:
    return b"\xcf\xfa\xed\xfe" + struct.pack("<I", processor) + bytes(24)


@pytest.mark.parametrize(
    ("tag", "data", "fault"),
    [
        ("manylinux_2_28_x86_64", _elf(62, b"\0GLIBC_2.27\0GLIBC_2.2.5\0"), ""), ("manylinux_2_17_x86_64", _elf(62, b"\0GLIBC_2.27\0"), "needs glibc 2.27"),
        ("manylinux_2_28_x86_64", _elf(183), "is ELF for arm64"), ("manylinux_2_28_x86_64", _pe(0x8664), "is PE"),
        ("win_amd64", _pe(0x8664), ""), ("win_amd64", _pe(0x14C), "is PE for ?"), ("win_amd64", b"no program", "no compiled file"),
        ("macosx_11_0_arm64", _mach(0x0100000C), ""), ("macosx_11_0_arm64", _mach(0x01000007), "Mach-O for x86_64"),
        ("any", _elf(62), "for any system"),
    ],
    ids=range(10),
)  # fmt: skip
def test_compiled_files_are_for_the_system_of_their_wheel(
    build_zip: ModuleType, tmp_path: Path, tag: str, data: bytes, fault: str
) -> None:
    wheel = tmp_path / f"some-1.0-cp313-cp313-{tag}.whl"
    with zipfile.ZipFile(wheel, "w") as made:
        made.writestr("some/core.so" if "win" not in tag else "some/core.pyd", data)
    found = build_zip.binaries.faults(wheel)
    assert bool(found) == bool(fault) and all(fault in one for one in found), found
