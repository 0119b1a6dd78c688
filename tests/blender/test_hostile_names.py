"""A name that tries to get out of its place, in every file that the program writes, each read by what others wrote."""

from __future__ import annotations

import csv
import json
import re
import unicodedata
import zipfile
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import bpy
import ezdxf
import pypdfium2
import pytest
from flexmaps import api
from flexmaps.bridge.store.paths import file_name
from flexmaps.command import main as command
from flexmaps.engine import MARK
from flexmaps.engine.extras.exploring.folder import escape_formula
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.surface.checking.finding import make_finding
from support.bowl import bowl

# ends of places in HTML, XML, JSON, PDF, DXF, shell and templates, what a spreadsheet runs, and letters that XML knows not
HOSTILE = "=1+1|x!A0 </script></title><svg onload=alert(7)> ]]> -->\\\"' (\\) {{7*7}} %n $(x) \r\n  0\nEOF\n \x07\x0b"
FORMULA = re.compile(r"^[=+\-@\t\r]")
SHORT = '</a>=1&"\x07'  # what names of cases are held to


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every kind of file of a piece of that name, one of whose load cases cannot be read and is told of."""
    folder = tmp_path_factory.mktemp("hostile")
    settings = {"sheet.nesting": "FAST", "structure.cases": f"{SHORT}: snow 500"}
    made = api.simulate(api.load("shape:strip", edge=20, settings=settings), supports="lowest")
    named = replace(made, name=f"{HOSTILE}.obj")
    told = make_finding("undone", f"Load case '{SHORT}' in '{HOSTILE}'", severity="warning")
    named.result.surface.findings.append(told)
    api.export(named, folder / "out", formats=export.FORMATS)
    api.report(named, folder / "out")
    api.share(named, folder / "out" / "share.html")
    api.save(named, folder / "out" / "model.blend")
    return folder


class Page(HTMLParser):
    """The tags of a page, and their attributes."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def test_every_file_can_be_read_and_holds_the_name_as_text_alone(written: Path) -> None:
    out, seen = written / "out", set()
    for path in sorted(path for path in written.rglob("*") if path.is_file()):
        assert path.parent in (out, *out.iterdir()), "nothing lies outside"
        seen.add(path.suffix)
        if path.suffix == ".html":
            page = Page(path.read_text(encoding="utf-8"))
            assert not [(tag, attrs) for tag, attrs in page.tags if any(name.startswith("on") for name in attrs)]
            assert "alert(7)" not in {body for tag, attrs in page.tags if tag == "script" for body in attrs.values()}
            assert "alert(7)" in path.read_text(encoding="utf-8"), "the name itself is there"
            assert "49" not in re.findall(r"<title>(.*?)</title>", path.read_text(encoding="utf-8"))[0], (
                "no template runs"
            )
        elif path.suffix == ".svg":
            tags = {element.tag.rpartition("}")[2] for element in ElementTree.parse(path).iter()}
            assert not tags & {"script", "a", "foreignObject"}
        elif path.suffix == ".dxf":
            assert not ezdxf.readfile(path).audit().errors  # type: ignore[attr-defined]
        elif path.suffix == ".pdf":
            assert len(pypdfium2.PdfDocument(path)) > 0
        elif path.suffix == ".csv":
            with open(path, encoding="utf-8", newline="") as stream:
                cells = [cell for row in csv.reader(stream) for cell in row]
            assert not [cell for cell in cells if FORMULA.match(cell) and not re.fullmatch(r"-?[\d.e+-]+", cell)]
        elif path.suffix == ".json":
            json.loads(path.read_text(encoding="utf-8"))
        elif path.suffix == ".3mf":
            with zipfile.ZipFile(path) as package:
                for name in package.namelist():
                    ElementTree.fromstring(package.read(name))
    assert HOSTILE in json.loads((out / "report.json").read_text(encoding="utf-8"))["input"]["file"]
    assert {".html", ".svg", ".dxf", ".pdf", ".csv", ".json", ".3mf", ".stl", ".blend"} <= seen


def test_the_name_of_an_object(written: Path, tmp_path: Path) -> None:
    """The same by the buttons, where a file is called after the object."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    obj = api.show(api.sheets(api.load("shape:strip", edge=20, settings={"sheet.nesting": "FAST"})))
    obj.name = "../..\\CON:</b>\n"
    obj.flexmaps.export.folder = str(tmp_path / "out")
    assert bpy.ops.flexmaps.export() == {"FINISHED"}
    made = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert made and all(path.parent == tmp_path / "out" and re.fullmatch(r"[\w.-]+", path.name) for path in made)


def test_a_table_holds_no_formulas() -> None:
    assert [escape_formula(value) for value in ("=1+1", "+1", "-x", "@x", "\t=1", "wood", "", -1.5, None)] == [
        "'=1+1", "'+1", "'-x", "'@x", "'\t=1", "wood", "", -1.5, None,
    ]  # fmt: skip


def test_scripts_in_a_file_are_not_run(tmp_path: Path) -> None:
    """By no command, whatever the preferences say: a text that Blender would register, and a driver."""
    path, mark = tmp_path / "scripted.blend", tmp_path / "ran"
    api.show(api.load("shape:strip", edge=20))
    text = bpy.data.texts.new("boot.py")
    text.write(f"open({str(mark)!r}, 'w').close()")
    text.use_module = True
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = True
    try:
        assert command.main(["check", str(path)]) == 0 and not mark.exists()
        bpy.ops.wm.open_mainfile(filepath=str(path), use_scripts=True)
        assert mark.exists(), "the file would have done it"
    finally:
        bpy.context.preferences.filepaths.use_scripts_auto_execute = False


def test_objects_whose_names_come_to_the_same_have_files_of_their_own(add: Any) -> None:
    """On Windows and macOS names that differ in case alone are one file, on macOS those of one letter in two ways to write it too;
    everywhere the plain forms of a.b and a_b are, and a number behind one may make it a third one's name."""
    names = ("a.b", "a_b", "A_B", "a_b_2", "a_B_3", "caf\u00e9", "cafe\u0301", "other")
    for name in names:
        add(bowl()).name = name
    files = {name: file_name(name) for name in names}
    on_disk = {unicodedata.normalize("NFC", file).casefold() for file in files.values()}
    assert len(on_disk) == len(names), files
    assert files["other"] == "other" and sum(file.casefold() == "a_b" for file in files.values()) == 1


def test_every_file_says_which_version_made_it(written: Path, tmp_path: Path) -> None:
    """But for pictures, and for what others' formats have no place for; a Blender file says it beside the notes."""
    api.calibration_sheet(tmp_path)
    silent = []
    for path in [*written.rglob("[!.]*"), *tmp_path.rglob("[!.]*")]:
        if path.is_file() and path.suffix not in (".png", ".blend"):
            data = zipfile.ZipFile(path).read("3D/3dmodel.model") if path.suffix == ".3mf" else path.read_bytes()
            silent += [] if MARK.encode() in data else [path.name]
    assert silent == []
