"""The scripts of ``examples/``: each runs as it stands, and does what it says."""

from __future__ import annotations

import re
import runpy
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.engine.mechanics.arms.beams import path_integrals
from flexmaps.engine.surface import shapes

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
FOR_SOMEBODY = 13  # from this number on they are programs with words behind "--"


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", text)]


def one_panel(out: str) -> None:
    text = Path("one_quad/sheet-01.svg").read_text()
    assert text.startswith("<?xml") and "<path" in text


def near_the_saddle(out: str) -> None:
    assert 0.0 < numbers(out)[-1] < 10.0


def sheets_for_a_laser(out: str) -> None:
    assert {path.suffix for path in Path("sheets").glob("[!.]*")} == {".svg", ".dxf", ".pdf", ".csv"}


def stiffness_of_the_strip(out: str) -> None:
    # a cantilever: F L^3 / (3 E I) with I = b t^3 / 12
    youngs = 9.81 * 0.05 * 0.10**3 / (3 * 0.0047 * 0.02 * 0.002**3 / 12)
    assert numbers(out)[:2] == pytest.approx([youngs / 1e9, 0.0051 / (0.1 * 0.02 * 0.002)], rel=2e-3)


def sags(out: str) -> None:
    assert numbers(out)[0] > 0.0


def better(out: str) -> None:
    (before, _), (after, _) = (numbers(line) for line in out.splitlines()[-2:])
    assert after < before


def cut_in_the_middle(out: str) -> None:
    assert numbers(out)[0] == 2


def every_kind(out: str) -> None:
    assert [line.split()[0] for line in out.splitlines()[-3:]] == ["dovetail", "key", "tab"]


def three_test_cuts(out: str) -> None:
    texts = {path.read_text() for path in Path().glob("clearance_*mm/sheet-01.svg")}
    assert len(texts) == 3  # each another one


def beds(out: str) -> None:
    for path in Path("beds").glob("*.3mf"):
        assert "3D/3dmodel.model" in zipfile.ZipFile(path).namelist()


def areas(out: str) -> None:
    assert all(numbers(line)[1] > 0.0 for line in out.splitlines() if line.startswith("panel"))


def stopped(out: str) -> None:
    assert out.rstrip().endswith("stopped; the piece is as it was before")


CHECKS: dict[int, Callable[[str], None]] = {
    1: one_panel,
    2: near_the_saddle,
    3: sheets_for_a_laser,
    4: stiffness_of_the_strip,
    5: sags,
    6: better,
    7: cut_in_the_middle,
    8: every_kind,
    9: three_test_cuts,
    10: beds,
    11: areas,
    12: stopped,
}


def number(path: Path) -> int:
    return int(path.name[:2])


def example(number: int) -> dict[str, Any]:
    """A script that is a program, loaded but not run."""
    path = SCRIPTS[number - 1]
    return runpy.run_path(str(path), run_name=path.stem)


def test_they_are_numbered_and_the_guide_shows_them_all() -> None:
    assert [number(path) for path in SCRIPTS] == list(range(1, len(SCRIPTS) + 1))
    guide = (ROOT / "docs" / "guide.md").read_text(encoding="utf-8")
    assert [path.name for path in SCRIPTS if f"examples/{path.name})" not in guide] == []


LONG = {3, 6, 9, 10}  # remeshing, optimising, three cuts, beds of a printer


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[pytest.mark.thorough] if number(path) in LONG else [], id=path.stem)
        for path in SCRIPTS[: FOR_SOMEBODY - 1]
    ],
)
def test_short_ones(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["blender"])
    runpy.run_path(str(path), run_name="__main__")
    CHECKS[number(path)](capsys.readouterr().out)


def test_for_artists(add: Any, capsys: pytest.CaptureFixture[str]) -> None:
    add(shapes.make("strip"), "arch")
    example(13)
    assert "arch: 54 spirals on" in capsys.readouterr().out
    assert "FlexMaps equilibrium" in bpy.data.objects["arch"].data.shape_keys.key_blocks


def test_for_makers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    arch = shapes.make("strip")
    lines = [f"v {x} {y} {z}" for x, y, z in arch.vertices] + [f"f {a} {b} {c} {d}" for a, b, c, d in arch.quads + 1]
    (meshes / "arch.obj").write_text("\n".join(lines))
    (meshes / "broken.stl").write_text("solid nothing")
    script = example(14)
    script["SETTINGS"] |= {"optimise.iterations": 2, "optimise.codesign": False, "sheet.nesting": "FAST"}
    script["main"]([str(meshes), str(tmp_path / "out"), "20"])
    assert (tmp_path / "out" / "arch" / "sheet-01.svg").is_file()
    out = capsys.readouterr().out
    assert re.search(r"arch.obj: \d+ sheets", out) and "1 refused: broken.stl" in out


@pytest.mark.thorough
def test_for_researchers(tmp_path: Path) -> None:
    rows = example(15)["main"](["shape:strip", str(tmp_path), "1.5", "3"])
    assert [row["thickness_mm"] for row in rows] == [1.5, 3.0]
    lines = (tmp_path / "sweep.csv").read_text().splitlines()
    assert len(lines) == 3 and lines[0].startswith("thickness_mm")
    assert (tmp_path / "3mm" / "report.html").is_file()


def test_four_widths(capsys: pytest.CaptureFixture[str]) -> None:
    found = example(16)["main"](["shape:strip"], {"optimise.iterations": 2, "optimise.codesign": False})
    # what bends along x are the arms along x: those across hardly count
    assert found["softer along"] > 1.3 * found["even"] and found["softer across"] < 1.1 * found["even"]
    assert "sags by" in capsys.readouterr().out


@pytest.mark.thorough
def test_a_layout_chosen_by_the_shape(capsys: pytest.CaptureFixture[str]) -> None:
    rows = example(17)["main"](["shape:strip", "3"], {"optimise.patience": 0.1})
    out = capsys.readouterr().out
    assert len(rows) >= 3 and "with the least work: 1" in out
    taken = next(line for line in out.splitlines() if line.startswith("*"))
    assert numbers(taken)[0] <= 3
    assert numbers(taken)[2] <= min(row["rms_percent"] for row in rows if row["panels"] == 1) * 1.05 + 1e-3


@pytest.mark.thorough
def test_explored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    taken = example(18)["main"](["shape:strip", "6"])
    assert "RMS" in capsys.readouterr().out
    rows = (tmp_path / "out" / "explored" / "candidates.csv").read_text().splitlines()
    assert len(rows) == 7
    assert 0.012 <= taken.mesh.median_edge <= 0.030
    assert example(18)["main"](["shape:strip", "6"]).settings == taken.settings  # all of them are known by now


def test_square_spirals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    script = example(19)
    curve, t, step = script["square_points"], np.linspace(0.05, 0.95, 9), 1e-6
    before, here, after = (curve(0.02, 0.3, 4.0, np.ones(1), 0.3, t + k * step) for k in (-1, 0, 1))
    for k in (0, 1):
        assert (after[k] - before[k]) / (2.0 * step) == pytest.approx(here[k + 1], rel=1e-7)
    script["main"]()
    spirals, squares = (numbers(line)[0] for line in capsys.readouterr().out.splitlines())
    assert squares < 0.9 * spirals  # longer arms are softer
    assert "<path" in Path("square_spirals/sheet-01.svg").read_text()
    monkeypatch.setitem(curve.__globals__, "CORNERS", 0.0)
    assert script["square_integrals"](3.0) == pytest.approx(path_integrals(3.0), rel=1e-12)
