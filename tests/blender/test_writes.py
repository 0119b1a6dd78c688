"""Buttons and commands before files of the user's: asked, refused, and gone on with where that is allowed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest
from flexmaps import api
from flexmaps.command import main as command_line
from flexmaps.engine.errors import FlexMapsError

FAST = {"sheet.nesting": "FAST"}


@pytest.fixture
def strip(tmp_path: Path) -> Any:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    obj = api.show(api.spirals(api.load("shape:strip", edge=20, settings=FAST)))
    obj.name = "strip"
    obj.flexmaps.export.folder = str(tmp_path)
    return obj


@pytest.mark.parametrize(
    "name",
    ["strip-01.svg", *(pytest.param(k, marks=pytest.mark.thorough) for k in ("strip-parts.csv", "strip-assembly.pdf"))],
)
def test_export_asks_before_it_replaces_a_file_of_the_users(strip: Any, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("the user's work")
    with pytest.raises(RuntimeError, match="would be written over"):
        bpy.ops.flexmaps.export()
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert bpy.ops.flexmaps.export(overwrite=True) == {"FINISHED"}
    assert (tmp_path / name).read_bytes() != b"the user's work"
    assert bpy.ops.flexmaps.export() == {"FINISHED"}, "what it wrote is its own"
    (tmp_path / name).write_text("worked on since")
    with pytest.raises(RuntimeError, match="would be written over"):
        bpy.ops.flexmaps.export()
    assert (tmp_path / name).read_text() == "worked on since"


@pytest.mark.parametrize(("asked", "name"), [
    ("all.png", "all.png"), ("all.mp4", "all.mp4"), ("all-film.png", "all-film-0001.png"),
])  # fmt: skip
def test_pictures_and_films_ask_too(strip: Any, tmp_path: Path, asked: str, name: str) -> None:
    strip.flexmaps.render.film = name != "all.png"
    strip.flexmaps.render.file = str(tmp_path / asked)
    (tmp_path / name).write_text("the user's work")
    with pytest.raises(RuntimeError, match="would be written over"):
        bpy.ops.flexmaps.render()
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "the user's work"


def test_the_share_page_asks_too(strip: Any, tmp_path: Path) -> None:
    (tmp_path / "strip-share.html").write_text("the user's page")
    with pytest.raises(RuntimeError, match="would be written over"):
        bpy.ops.flexmaps.share()
    assert (tmp_path / "strip-share.html").read_text() == "the user's page"


@pytest.mark.parametrize("words", [
    ("run", "--stop-after", "merge", "--no-pictures"), ("layout",), ("report",), ("export",), ("share",),
])  # fmt: skip
def test_commands_never_write_onto_what_they_read(tmp_path: Path, words: tuple[str, ...]) -> None:
    """With or without permission to replace others."""
    api.save(api.load("shape:strip", edge=20), tmp_path / "model.blend")
    read = {"run": "model.blend", "layout": "piece.blend", "share": "share.blend"}.get(words[0], "report.html")
    source = tmp_path / ("a.blend" if words[0] in {"report", "export"} else read)
    (tmp_path / "model.blend").rename(source)
    target = tmp_path / {"export": "sheet-01.svg", "report": "report.html"}.get(words[0], source.name)
    if target != source:
        target.symlink_to(source)
    before = source.read_bytes()
    out = str(target if words[0] in {"layout", "share"} else tmp_path)
    for allowed in ((), ("--overwrite",)):
        assert command_line.main([words[0], str(source), "--out", out, *words[1:], *allowed]) == 2
    assert source.read_bytes() == before and target.read_bytes() == before


def test_a_piece_is_never_saved_onto_its_source(tmp_path: Path) -> None:
    path = tmp_path / "a.blend"
    api.save(api.load("shape:strip", edge=20), path)
    api.save(api.load("shape:strip", edge=20), path)  # what was saved there is ours
    piece = api.load(path)
    for overwrite in (False, True):
        with pytest.raises(FlexMapsError, match="is read in this run"):
            api.save(piece, path, overwrite=overwrite)
