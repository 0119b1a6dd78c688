"""Files of the user's are never lost: every kind of output against every kind of input and every state of the folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.files import write_all_atomically, write_atomically
from flexmaps.engine.own_files import CHECKSUM_FILE, Guard, UserFileError, is_unchanged_output

OUTPUTS = (
    "sheet-01.svg",
    "sheet-01.dxf",
    "model.blend",
    "report.html",
    "report.json",
    "plots/surface.svg",
    "layout.png",
)
INPUTS = ("mesh.obj", "piece.blend", "scan.ply", "remnant.dxf", "preset.py", "calibration.json")


def named_by(way: str, source: Path, target: Path) -> Path:
    """Make the target the same file as the source in some way; returns how the source is named."""
    if way == "path":
        target.write_text(source.read_text())
        return target
    if way == "dots":
        target.write_text(source.read_text())
        return target.parent / ".." / target.parent.name / target.name
    if way == "link":
        target.symlink_to(source)
    if way == "link from the source":
        target.write_text(source.read_text())
        source.unlink()
        source.symlink_to(target)
    if way == "hard link":
        os.link(source, target)
    return source


@pytest.mark.parametrize("way", ["path", "dots", "link", "link from the source", "hard link"])
@pytest.mark.parametrize("read", INPUTS)
@pytest.mark.parametrize("name", OUTPUTS)
def test_what_is_read_is_never_written_over(tmp_path: Path, name: str, read: str, way: str) -> None:
    out = tmp_path / "out"
    (out / name).parent.mkdir(parents=True)
    source = tmp_path / read
    source.write_text("the user's work")
    given = named_by(way, source, out / name)
    for overwrite in (False, True):
        guard = Guard([given], overwrite)
        with pytest.raises(FlexMapsError, match=r"is read in this run .* write to .*-2"):
            guard.check([out / name], out)
        with pytest.raises(FlexMapsError, match="is read"), write_all_atomically(alone_in=out, guard=guard) as new:
            new(out / name).write_text("ours")
    assert given.read_text() == (out / name).read_text() == "the user's work"


@pytest.mark.skipif(os.path.normcase("A") == "A", reason="names differ by case here")
def test_other_case_is_the_same_file(tmp_path: Path) -> None:
    (tmp_path / "Model.BLEND").write_text("the user's work")
    with pytest.raises(FlexMapsError, match="is read"):
        Guard([tmp_path / "Model.BLEND"]).check([tmp_path / "model.blend"])


@pytest.mark.parametrize("state", ["foreign", "changed", "renamed", "link to nothing"])
@pytest.mark.parametrize("name", OUTPUTS)
def test_files_of_others_stay_unless_that_is_allowed(tmp_path: Path, name: str, state: str) -> None:
    target = tmp_path / name
    target.parent.mkdir(exist_ok=True)
    if state in {"changed", "renamed"}:
        with write_all_atomically(alone_in=tmp_path, guard=Guard()) as new:
            new(target if state == "changed" else tmp_path / "another.txt").write_text("ours")
    if state == "link to nothing":
        target.symlink_to(tmp_path / "nowhere")
    elif state == "renamed":
        (tmp_path / "another.txt").rename(target)
    else:
        target.write_text("the user's work")
    before = None if state == "link to nothing" else target.read_bytes()
    with pytest.raises(UserFileError, match="--overwrite"):
        Guard().check([target], tmp_path)
    with pytest.raises(UserFileError), write_all_atomically([target], tmp_path, Guard()) as new:
        new(target)
    with write_all_atomically([target], tmp_path, Guard()):
        pass  # it would be removed if it were ours
    assert os.path.islink(target) if before is None else target.read_bytes() == before
    with write_all_atomically(alone_in=tmp_path, guard=Guard(overwrite=True)) as new:
        new(target).write_text("ours now")
    assert target.read_text() == "ours now" and is_unchanged_output(target, tmp_path)


def test_what_the_last_run_wrote_is_replaced_and_removed(tmp_path: Path) -> None:
    for number in range(3):
        with write_all_atomically([tmp_path / "sheet-02.svg"], tmp_path, Guard()) as new:
            for name in ("sheet-01.svg", "sheet-02.svg")[: 2 - number % 2]:
                new(tmp_path / name).write_text(f"run {number}")
        assert (tmp_path / "sheet-01.svg").read_text() == f"run {number}"
        assert (tmp_path / "sheet-02.svg").exists() == (number % 2 == 0)


def test_two_kinds_of_files_share_a_note(tmp_path: Path) -> None:
    with write_atomically(tmp_path / "a.html", Guard()) as new:
        new.write_text("one")
    with write_all_atomically(alone_in=tmp_path, guard=Guard()) as new:
        new(tmp_path / "b.svg").write_text("two")
    assert is_unchanged_output(tmp_path / "a.html") and is_unchanged_output(tmp_path / "b.svg")


@pytest.mark.parametrize("error", [Cancelled("stopped"), FlexMapsError("refused"), OSError(28, "disk full")])
def test_a_run_that_ends_early_changes_neither_files_nor_note(tmp_path: Path, error: Exception) -> None:
    with write_all_atomically(alone_in=tmp_path, guard=Guard()) as new:
        new(tmp_path / "a.svg").write_text("first")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with (
        pytest.raises((Cancelled, FlexMapsError)),
        write_all_atomically([tmp_path / "a.svg"], tmp_path, Guard()) as new,
    ):
        new(tmp_path / "a.svg").write_text("half")
        new(tmp_path / "b.svg").write_text("half")
        raise error
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("note", ["", "no json", "[1]", '{"a.svg": 3}'])
def test_a_damaged_note_makes_no_file_ours(tmp_path: Path, note: str) -> None:
    (tmp_path / "a.svg").write_text("whose?")
    (tmp_path / CHECKSUM_FILE).write_text(note)
    with pytest.raises(UserFileError):
        Guard().check([tmp_path / "a.svg"], tmp_path)


def test_sheets_that_may_be_replaced_are_found_before_their_number_is_known(tmp_path: Path) -> None:
    for name in ("sheet-01.svg", "sheet-12.svg", "sheet-r12-03.dxf", "sheet-parts.csv", "sheet-1.svg", "other-01.svg"):
        (tmp_path / name).write_text("there")
    found = {path.name for path in export.existing_files(tmp_path / "sheet", ("svg", "dxf-r12"))}
    assert found == {"sheet-01.svg", "sheet-12.svg", "sheet-r12-03.dxf", "sheet-parts.csv"}
    assert export.existing_files(tmp_path / "sheet", ()) == []


def test_a_folder_that_cannot_be_looked_into_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> list[str]:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("os.listdir", refuse)  # root, who may run the tests, may look everywhere
    with pytest.raises(FlexMapsError, match=f"Cannot look into the folder {tmp_path}: "):
        export.existing_files(tmp_path / "sheet", ("svg",))
