"""Along the grain: every panel's grain, which is its longer side here, lies along the sheet's width in every kind of file, as other programs read it."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

import ezdxf
import numpy as np
import pytest
import shapely
import svgelements
import trimesh
from ezdxf import path as paths
from flexmaps.engine.fabrication.nesting.nest import can_search
from flexmaps.engine.fabrication.sheets import CutSheets, make_sheets
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.params import ConnectorParams, SheetParams, SpiralParams
from flexmaps.engine.spirals import fabricable

TURN = 0.02  # radians by which a least box may be aslant of its sheet; outlines of different fineness have slightly other boxes


@pytest.fixture(params=["FAST", "TRUE"])
def sheets(request: pytest.FixtureRequest, flat_grid: Any) -> CutSheets:
    """Three panels of 2 x 5 spirals that stand upright in their patches, the grain along them, so that all have to be turned."""
    if request.param == "TRUE" and not can_search():
        pytest.skip("spyrrow is not installed")
    made = fabricable.uniform_design(
        flat_grid(6, 5, 0.02, cut=lambda x, y: x in (2, 4)), SpiralParams(grain=0.5 * np.pi), width=0.0015, twist=1.0
    )
    params = SheetParams(nesting=request.param, nesting_seconds=2.0, rotation="GRAIN")
    found = make_sheets(made, params, connectors=ConnectorParams(connector="none"))
    assert len(found.panels) == 3
    return found


def aslant(points: np.ndarray) -> float:
    """Radians between a shape's longer side and the width of its sheet, by shapely's least rectangle."""
    box = np.asarray(shapely.MultiPoint(points).minimum_rotated_rectangle.exterior.coords)
    sides = np.diff(box, axis=0)
    longer = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    angle = abs(np.arctan2(longer[1], longer[0]))
    return float(min(angle, np.pi - angle))


def of_svg(path: Path) -> list[np.ndarray]:
    drawing = svgelements.SVG.parse(path)
    group = next(g for g in drawing.select(lambda e: isinstance(e, svgelements.Group) and e.id == "cut-outer"))
    share = np.linspace(0.0, 1.0, 400)
    return [np.array([(p.x, p.y) for p in map(curve.point, share)]) for curve in group]


def of_dxf(path: Path) -> list[np.ndarray]:
    outer = [e for e in ezdxf.readfile(path).modelspace() if e.dxf.layer == "CUT_OUTER"]
    return [np.array([(v.x, v.y) for v in paths.make_path(e).flattening(0.05)]) for e in outer]


def of_pdf(path: Path) -> list[np.ndarray]:
    """Of the one page's content: the layer of the outer cuts, its paths by their points."""
    stream = re.search(rb"/FlateDecode/Length \d+>>stream\n(.*?)\nendstream", path.read_bytes(), re.DOTALL)
    assert stream is not None
    layer = zlib.decompress(stream[1]).decode("latin-1").split("BDC")[-1].split("EMC")[0]
    curves = [re.findall(r"(-?[\d.e+-]+) (-?[\d.e+-]+) [mlc]\b", line) for line in layer.splitlines()]
    return [np.array(c, dtype=float) for c in curves if c]


def of_solids(path: Path) -> list[np.ndarray]:
    if path.suffix == ".3mf":
        with ZipFile(path) as package:
            root = ElementTree.fromstring(package.read("3D/3dmodel.model"))
        space = {"m": "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"}
        return [np.array([[float(v.get(k, "")) for k in "xy"] for v in mesh.iterfind(".//m:vertex", space)])
                for mesh in root.iterfind(".//m:mesh", space)]  # fmt: skip
    return [np.asarray(part.vertices)[:, :2] for part in trimesh.load(path).split(only_watertight=False)]


READERS = {".svg": of_svg, ".dxf": of_dxf, ".pdf": of_pdf, ".3mf": of_solids, ".stl": of_solids}


def test_in_every_kind_of_file(sheets: CutSheets, tmp_path: Path) -> None:
    files = export.write_sheets(sheets, tmp_path / "sheet", export.FORMATS)
    keys = sum(p.patch < 0 for p in sheets.panels)
    assert not keys
    seen: dict[str, int] = {}
    for path in files:
        panels = READERS[path.suffix](path)
        kind = path.name[: -len("-01.svg")] + path.suffix
        seen[kind] = seen.get(kind, 0) + len(panels)
        assert max(aslant(panel) for panel in panels) < TURN, path.name
    assert set(seen.values()) == {len(sheets.panels)} and len(seen) == len(export.FORMATS)
