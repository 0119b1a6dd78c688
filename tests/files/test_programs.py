"""Sheets in the programs that read them: each is run where it is installed, and named where it is not."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from flexmaps.engine.fabrication.nesting import drawings
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.fabrication.writers.operations import frame_curves
from flexmaps.engine.params import Settings, with_values
from flexmaps.engine.runs import job
from flexmaps.engine.surface.mesh import PolygonMesh

# inserts a drawing and counts the edges of its objects
COUNT = """
import FreeCAD, Import, os
document = FreeCAD.newDocument()
Import.readDXF(os.environ["DRAWING"], document.Name)
print("EDGES", sum(len(each.Shape.Edges) for each in document.Objects if hasattr(each, "Shape")))
"""


def program(*names: str) -> str:
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        pytest.skip(f"{names[0]} is not installed")
    return str(found)


def run(*words: str | Path, **more: str) -> str:
    made = subprocess.run(
        [str(w) for w in words], capture_output=True, text=True, timeout=300,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen", **more},
    )  # fmt: skip
    assert made.returncode == 0, made.stdout + made.stderr
    return made.stdout + made.stderr


@pytest.fixture(scope="module")
def sheets() -> CutSheets:
    settings = with_values(
        Settings(), {"sheet.nesting": "FAST", "sheet.sheet_width": 300.0, "sheet.sheet_height": 200.0}
    )
    x, y = np.meshgrid(0.02 * np.arange(5), 0.02 * np.arange(4))
    points = np.column_stack([x.ravel(), y.ravel(), 2.0 * x.ravel() ** 2])
    corner = np.add.outer(5 * np.arange(3), np.arange(4)).ravel()
    made = job.run(
        PolygonMesh(points, (corner[:, None] + [0, 1, 6, 5]).ravel(), np.full(len(corner), 4)), settings
    ).sheets
    assert made is not None and made.count == 1
    return made


@pytest.fixture(scope="module")
def files(sheets: CutSheets, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    kinds = ("svg", "dxf", "dxf-r12", "pdf", "3mf")
    return dict(zip(kinds, export.write_sheets(sheets, tmp_path_factory.mktemp("files") / "sheet", kinds), strict=True))


@pytest.mark.parametrize("kind", ["dxf", "dxf-r12"])
def test_freecad_reads_every_edge(sheets: CutSheets, files: dict[str, Path], kind: str, tmp_path: Path) -> None:
    freecad = program("freecadcmd", "FreeCADCmd")
    script = tmp_path / "count.py"
    script.write_text(COUNT, encoding="utf-8")
    found = re.search(r"EDGES (\d+)", run(freecad, script, DRAWING=str(files[kind])))
    runs = sheets.cuts_on_sheet(0)
    curves = (*runs.engraving, *runs.inner_cuts, *runs.outer_cuts)
    wanted = sum(len(c.points) - (not c.closed) for c in curves) + 4 + 1  # the sheet's edge and its origin
    assert found is not None and int(found[1]) == wanted


def kinds() -> dict[str, Callable[[Path], CutSheets]]:
    sys.path.append(str(Path(__file__).resolve().parents[2] / "tools"))
    found: dict[str, Callable[[Path], CutSheets]] = __import__("sheet_kinds").KINDS
    return found


@pytest.mark.parametrize(
    "name", ["feet", *(pytest.param(one, marks=pytest.mark.thorough) for one in kinds() if one != "feet")]
)
def test_freecad_reads_sheets_of_every_kind(name: str, tmp_path: Path) -> None:
    """Arcs that are hardly bent, as of feet, are those at which it loses an outline."""
    freecad = program("freecadcmd", "FreeCADCmd")
    made = kinds()[name](tmp_path)
    script = tmp_path / "count.py"
    script.write_text(COUNT, encoding="utf-8")
    for index, path in enumerate(export.write_sheets(made, tmp_path / "sheet", ("dxf-r12",))):
        runs = made.cuts_on_sheet(index)
        curves = (*runs.engraving, *runs.inner_cuts, *runs.outer_cuts, *frame_curves(made, index))
        found = re.search(r"EDGES (\d+)", run(freecad, script, DRAWING=str(path)))
        assert found is not None and int(found[1]) == sum(len(c.points) - (not c.closed) for c in curves)


@pytest.mark.parametrize("kind", ["dxf", "dxf-r12"])
def test_librecad_prints_the_drawing(files: dict[str, Path], kind: str, tmp_path: Path) -> None:
    import pypdfium2

    librecad = program("librecad")
    shutil.copy(files[kind], tmp_path / "drawing.dxf")
    run(librecad, "dxf2pdf", tmp_path / "drawing.dxf")
    picture = np.array(pypdfium2.PdfDocument(tmp_path / "drawing.pdf")[0].render(scale=1).to_pil().convert("L"))
    assert (picture < 200).any()


def test_inkscape_finds_the_sheet_and_its_layers(files: dict[str, Path]) -> None:
    rows = [line.split(",") for line in run(program("inkscape"), "--query-all", files["svg"]).splitlines()]
    boxes = {row[0]: [float(x) * 25.4 / 96.0 for x in row[1:]] for row in rows if len(row) == 5}
    assert {"engrave", "cut-inner", "cut-outer", "sheet"} <= set(boxes)
    np.testing.assert_allclose(boxes["sheet"], [0, 0, 300, 200], atol=0.06)  # half of the line's width beside it


def test_librsvg_draws_the_colours(files: dict[str, Path], tmp_path: Path) -> None:
    from PIL import Image

    run(program("rsvg-convert"), "-w", "3000", "-b", "white", files["svg"], "-o", tmp_path / "sheet.png")
    picture = np.array(Image.open(tmp_path / "sheet.png").convert("RGB")).astype(int)
    assert picture.shape[:2] == (2000, 3000)
    for channel in (0, 2):  # outlines in red, holes in blue
        assert (picture[..., channel] - picture[..., 1] > 20).any()


def test_the_slicer_finds_sound_solids(sheets: CutSheets, files: dict[str, Path]) -> None:
    said = run(program("prusa-slicer"), "--info", files["3mf"])
    assert said.count("manifold = yes") == len(sheets.panels_on_sheet(0))
    assert float(re.findall(r"size_z = ([\d.]+)", said)[0]) == pytest.approx(2.0)


def nested(random: np.random.Generator, name: str, depth: int) -> str:
    """A shape in groups, drawings, and references with transforms and units at random."""
    if depth == 0:
        return str(random.choice([
            f'<rect id="{name}" x="3" y="{random.integers(1, 9)}mm" width="{random.integers(5, 60)}" height="8mm"/>',
            f'<circle id="{name}" cx="1cm" cy="4" r="{random.integers(5, 40)}"/>',
            f'<path id="{name}" d="M1 2c8 30 40 10 {random.integers(20, 60)} 5q9 9-8 30z"/>',
            f'<ellipse id="{name}" rx="{random.integers(5, 30)}px" ry=".2in"/>',
        ]))  # fmt: skip
    inside = nested(random, name, depth - 1)
    a, b, c = random.integers(-60, 60, 3)
    return str(random.choice([
        f'<g transform="rotate({a} {b} {c}) translate({b},{c})">{inside}</g>',
        f'<g transform="scale({1 + abs(a) / 50} {0.3 + abs(b) / 60})skewX({c / 2})">{inside}</g>',
        f'<g transform="matrix(1,{a / 90},{b / 90},1,{c},0)">{inside}</g>',
        f'<svg x="{a}" y="3mm" width="90mm" height="40%" viewBox="0 {b} 80 {70 + c}" overflow="visible">{inside}</svg>',
        f'<svg width="200" height="9cm" viewBox="{a} 0 100 50" preserveAspectRatio="xMaxYMin slice" overflow="visible">{inside}</svg>',
    ]))  # fmt: skip


def test_remnants_are_where_inkscape_sees_them(tmp_path: Path) -> None:
    inkscape, random = program("inkscape"), np.random.default_rng(5)
    names = [f"n{k}" for k in range(40)]
    body = "".join(nested(random, name, 1 + k % 4) for k, name in enumerate(names))
    head = 'xmlns="http://www.w3.org/2000/svg" width="400mm" height="300mm" viewBox="0 0 800 600"'
    (tmp_path / "a.svg").write_text(f'<svg {head} stroke="none" fill="#000">{body}</svg>', encoding="utf-8")
    rows = [line.split(",") for line in run(inkscape, "--query-all", tmp_path / "a.svg").splitlines()]
    seen = {row[0]: np.array([float(x) * 25.4 / 96.0 for x in row[1:]]) for row in rows if len(row) == 5}
    lines = drawings.read_svg(tmp_path / "a.svg", 1.0).lines
    assert len(lines) == len(names)
    for name, (points, closed) in zip(names, lines, strict=True):
        assert closed
        found = [points[:, 0].min(), -points[:, 1].max(), *np.ptp(points, axis=0)]
        np.testing.assert_allclose(found, seen[name], atol=0.011, err_msg=name)
