"""Files appear whole, together, or not at all."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.files import check_folder, write_all_atomically, write_atomically


def _names(folder):
    return sorted(p.name for p in folder.iterdir())


def test_a_file_appears_whole(tmp_path):
    target = tmp_path / "new folder" / "a.svg"
    with write_atomically(target) as temporary:
        assert temporary.parent == target.parent
        assert temporary.suffix == ".svg"
        temporary.write_text("new")
        assert not target.exists()
    assert target.read_text() == "new"
    assert _names(target.parent) == ["a.svg"]


def test_an_error_leaves_everything_as_it_was(tmp_path):
    old = tmp_path / "a.svg"
    old.write_text("old")
    with pytest.raises(RuntimeError), write_all_atomically() as new:
        new(old).write_text("half")
        new(tmp_path / "deep" / "er" / "b.dxf").write_text("half")
        raise RuntimeError
    assert old.read_text() == "old"
    assert _names(tmp_path) == ["a.svg"]


def test_several_files_appear_together_and_stale_ones_go(tmp_path):
    (tmp_path / "sheet-02.svg").write_text("old")
    (tmp_path / "mine.txt").write_text("mine")
    with write_all_atomically([tmp_path / "sheet-02.svg", tmp_path / "never-there.svg"]) as new:
        new(tmp_path / "sheet-01.svg").write_text("1")
        new(tmp_path / "sheet-01.dxf").write_text("2")
    assert _names(tmp_path) == ["mine.txt", "sheet-01.dxf", "sheet-01.svg"]


def test_full_disk_while_writing(tmp_path):
    old = tmp_path / "a.svg"
    old.write_text("old")
    with pytest.raises(FlexMapsError, match=r"a\.svg: the disk is full; make room"), write_all_atomically() as new:
        new(tmp_path / "b.svg").write_text("b")
        path = new(old)
        raise OSError(errno.ENOSPC, "No space left on device", str(path))
    assert old.read_text() == "old"
    assert _names(tmp_path) == ["a.svg"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_full_disk_for_real(tmp_path):
    with pytest.raises(FlexMapsError, match="the disk is full"), write_atomically(tmp_path / "a.svg") as temporary:
        temporary.unlink()
        temporary.symlink_to("/dev/full")
        temporary.write_text("x" * 100000)
    assert _names(tmp_path) == []


def test_disk_that_fills_up_while_the_files_take_their_places(tmp_path, monkeypatch):
    for name in "abc":
        (tmp_path / f"{name}.svg").write_text("old")
    replace, moves = os.replace, []

    def failing(source, target):
        if str(target).endswith("c.svg") and not moves:
            moves.append(1)
            raise OSError(errno.ENOSPC, "No space left on device", str(target))
        replace(source, target)

    with pytest.raises(FlexMapsError, match="the disk is full"), write_all_atomically() as new:
        for name in "abcd":
            new(tmp_path / f"{name}.svg").write_text("new")
        monkeypatch.setattr(os, "replace", failing)
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a.svg": "old", "b.svg": "old", "c.svg": "old"}


def test_read_only_folder(tmp_path, monkeypatch):
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o500)
    try:
        if os.access(folder, os.W_OK):  # the administrator may write anywhere: simulate what others see

            def denied(self, *args, **kwargs):
                raise PermissionError(errno.EACCES, "Permission denied", str(self))

            monkeypatch.setattr("pathlib.Path.touch", denied)
        with (
            pytest.raises(FlexMapsError, match="you may not write there; choose another folder"),
            write_atomically(folder / "a.svg"),
        ):
            pytest.fail("writing began")
        assert _names(folder) == []
    finally:
        folder.chmod(0o700)


def test_a_checked_folder_stays_as_it_was(tmp_path):
    (tmp_path / "there.txt").write_text("mine")
    check_folder(tmp_path)
    check_folder(tmp_path / "new" / "below")
    assert _names(tmp_path) == ["there.txt"]
    with pytest.raises(FlexMapsError, match=r"there\.txt"):
        check_folder(tmp_path / "there.txt" / "below")


def test_a_file_in_the_way_of_the_folder(tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(FlexMapsError, match="is a file and no folder"), write_atomically(tmp_path / "out" / "a.svg"):
        pytest.fail("writing began")
    assert (tmp_path / "out").read_text() == "a file"


def test_a_folder_in_the_way_of_the_file(tmp_path):
    (tmp_path / "a.svg").mkdir()
    with pytest.raises(FlexMapsError, match="a folder of that name"), write_atomically(tmp_path / "a.svg"):
        pytest.fail("writing began")


@pytest.mark.parametrize("name", ["x" * 300 + ".svg", "a\0b.svg"])
def test_impossible_names(tmp_path, name):
    with pytest.raises(FlexMapsError, match="Cannot write"), write_atomically(tmp_path / name) as temporary:
        temporary.write_text("x")
    assert _names(tmp_path) == []


@pytest.mark.parametrize("name", ["ein Blatt.svg", "schön ✂.svg", "100%.svg", ".hidden.svg", "no suffix"])
def test_odd_names(tmp_path, name):
    with write_atomically(tmp_path / name) as temporary:
        temporary.write_text("x")
    assert _names(tmp_path) == [name]


@pytest.mark.parametrize("error", [FileNotFoundError, ConnectionError, IsADirectoryError])
def test_errors_that_have_nothing_to_do_with_writing_stay_what_they_are(tmp_path, error):
    with pytest.raises(error), write_all_atomically(alone_in=tmp_path / "out") as new:
        new(tmp_path / "out" / "a.svg").write_text("half")
        if error is FileNotFoundError:
            (tmp_path / "no input.obj").read_text()
        raise error(errno.ENOENT, "elsewhere", "another file")
    assert _names(tmp_path) == []


# -- one run in a folder -------------------------------------------------------------------------------------------------


def test_a_second_run_in_the_same_folder_is_refused(tmp_path):
    out = tmp_path / "out"
    with write_all_atomically(alone_in=out) as new:
        new(out / "a.svg").write_text("first")
        with (
            pytest.raises(FlexMapsError, match=r"Another run is writing into .*out"),
            write_all_atomically(alone_in=out),
        ):
            pytest.fail("two runs in one folder")
        with write_all_atomically(alone_in=tmp_path / "elsewhere") as other:
            other(tmp_path / "elsewhere" / "a.svg").write_text("third")
    assert _names(out) == ["a.svg"]
    with write_all_atomically(alone_in=out) as new:
        new(out / "a.svg").write_text("later")
    assert (out / "a.svg").read_text() == "later"
    assert _names(out) == ["a.svg"]


def test_a_run_that_fails_lets_go_of_its_folder(tmp_path):
    for _ in range(2):
        with pytest.raises(RuntimeError), write_all_atomically(alone_in=tmp_path / "out"):
            raise RuntimeError
    assert _names(tmp_path) == []


_HOLDS = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("flexmaps", sys.argv[1], submodule_search_locations=[sys.argv[2]])
sys.modules["flexmaps"] = importlib.util.module_from_spec(spec)
from flexmaps.engine.files import write_all_atomically
with write_all_atomically(alone_in=sys.argv[3]) as new:
    print("held", flush=True)
    sys.stdin.read()
"""


def test_another_process_holds_its_folder_until_it_is_killed(tmp_path):
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, "-c", _HOLDS, str(root / "__init__.py"), str(root), str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout.readline() == "held\n"
            with pytest.raises(FlexMapsError, match="Another run"), write_all_atomically(alone_in=tmp_path):
                pytest.fail("two runs in one folder")
        finally:
            other.kill()
    # its lock lies there still, and is nobody's
    with write_all_atomically(alone_in=tmp_path) as new:
        new(tmp_path / "a.svg").write_text("mine")
    assert _names(tmp_path) == ["a.svg"]
