"""Several objects on common sheets, copies and remnants: by buttons, from scripts and on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import ezdxf
import pytest
from flexmaps import api
from flexmaps.command import main as command
from flexmaps.engine.surface import shapes

QUICK = {"sheet.nesting": "FAST"}


@pytest.fixture
def two(add: Any, tmp_path: Path) -> list[bpy.types.Object]:
    """A dome and a strip, both with spirals and selected; the dome is the active one."""
    made = []
    for name in ("strip", "dome"):
        mesh = shapes.make(name, 0.02)
        obj = add((mesh.vertices, mesh.quads))
        obj.name = name
        obj.flexmaps.export.folder, obj.flexmaps.sheet.nesting = str(tmp_path / "out"), "FAST"
        assert bpy.ops.flexmaps.trace() == {"FINISHED"} and bpy.ops.flexmaps.spirals() == {"FINISHED"}
        made.append(obj)
    for obj in made:
        obj.select_set(True)
    return made[::-1]


def remnant(path: Path) -> Path:
    document = ezdxf.new(units=4)
    document.modelspace().add_lwpolyline([(0, 0), (900, 0), (900, 500), (400, 500), (400, 300), (0, 300)], close=True)
    document.saveas(path)
    return path


def test_all_selected_objects_by_one_button(two: list[bpy.types.Object], tmp_path: Path) -> None:
    two[1].flexmaps.export.copies = 2
    assert bpy.ops.flexmaps.export_together() == {"FINISHED"}
    names = {path.name for path in (tmp_path / "out").glob("[!.]*")}
    assert {"dome-together-01.svg", "dome-together-01.dxf", "dome-together-parts.csv"} <= names
    assert {"dome-together-A-assembly.pdf", "dome-together-B-assembly.pdf"} <= names
    rows = (tmp_path / "out" / "dome-together-parts.csv").read_text(encoding="utf-8").splitlines()
    assert {row.partition("-")[0] for row in rows[1:-1]} == {"A", "B", "C"}


def test_what_has_no_spirals_is_named(two: list[bpy.types.Object], add: Any) -> None:
    mesh = shapes.make("quad", 0.02)
    bare = add((mesh.vertices, mesh.quads))
    bare.name = "bare"
    for obj in (*two, bare):
        obj.select_set(True)
    with pytest.raises(RuntimeError, match="no spirals yet on bare"):
        bpy.ops.flexmaps.export_together()


def test_a_remnant_is_added_and_filled(two: list[bpy.types.Object], tmp_path: Path) -> None:
    obj = two[0]
    bpy.context.view_layer.objects.active = obj
    path = remnant(tmp_path / "rest.dxf")
    assert bpy.ops.flexmaps.add_remnant(filepath=str(path)) == {"FINISHED"}
    assert obj.flexmaps.sheet.remnants == str(path)
    (tmp_path / "none.svg").write_text("<svg", encoding="utf-8")
    with pytest.raises(RuntimeError, match="cannot be read as SVG"):
        bpy.ops.flexmaps.add_remnant(filepath=str(tmp_path / "none.svg"))
    assert obj.flexmaps.sheet.remnants == str(path)
    assert bpy.ops.flexmaps.export() == {"FINISHED"}
    drawn = ezdxf.readfile(tmp_path / "out" / "dome-01.dxf")
    edges = [e for e in drawn.modelspace() if e.dxf.layer == "SHEET" and e.closed]
    assert [len(e) for e in edges] == [6]


def test_from_a_script_and_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pieces = [api.load(f"shape:{name}", edge=20, settings=QUICK) for name in ("strip", "dome")]
    paths = api.export(pieces, tmp_path / "api", formats=("svg",))
    assert [p.name for p in paths if p.suffix == ".pdf"] == ["sheet-A-assembly.pdf", "sheet-B-assembly.pdf"]
    words = ["export", "shape:strip", "shape:dome", "--copies", "2", "1", "--out", str(tmp_path / "cli"), "--formats", "svg",
             "--set", "sheet.nesting=FAST", "--remnant", str(remnant(tmp_path / "rest.dxf"))]  # fmt: skip
    assert command.main(words) == 0
    said = capsys.readouterr().out
    assert "2 x strip" in said and "1 x dome" in said
    assert (tmp_path / "cli" / "sheet-C-assembly.pdf").is_file()
    assert command.main([*words[:3], "--copies", "1", "2", "3", "--out", str(tmp_path)]) == 2
    assert command.main([*words[:3], "--copies", "0", "--out", str(tmp_path)]) == 2


@pytest.mark.parametrize("name", ["Привет", "日本語", "שלום", "नमस्ते", "Ü Žluť ελ"])
def test_names_in_any_script_are_drawn(name: str, tmp_path: Path) -> None:
    """Beside the same letters as question marks the page has more ink where the title stands: they were drawn, by PDFium."""
    import numpy as np
    import pypdfium2
    from flexmaps.bridge.hosts import letters
    from flexmaps.engine.fabrication.writers import glyphs, pdf

    before = len(bpy.data.curves), len(bpy.data.objects)
    letters.add_outlines(name)
    assert (len(bpy.data.curves), len(bpy.data.objects)) == before
    unlike = [run for run in glyphs.split_runs(name) if not glyphs.is_in_helvetica(run)]
    assert unlike and all(
        glyphs.outlines_by_run[run].splines and glyphs.outlines_by_run[run].width > 0.3 * len(run) for run in unlike
    )
    page = pdf.Page(0.1, 0.02)
    page.draw_text(name, (0.005, 0.005), 0.008)
    picture = pypdfium2.PdfDocument(pdf.pdf_bytes([page], name))[0].render(scale=4.0).to_pil().convert("L")
    ink = np.asarray(picture) < 128
    columns = np.flatnonzero(ink.any(axis=0)) * 25.4e-3 / 72.0 / 4.0
    assert columns.min() == pytest.approx(0.005, abs=1.5e-3)
    assert columns.max() == pytest.approx(0.005 + pdf.text_width(name, 0.008), abs=1.5e-3)
