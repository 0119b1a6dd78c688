"""Solids: watertight, outward and of the right volume, as trimesh finds them in the files."""

import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest
import shapely
import trimesh
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication import sheets
from flexmaps.engine.fabrication.panels import lettering
from flexmaps.engine.fabrication.panels.panel import Panel
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.fabrication.writers import panel_solids as solid_files
from flexmaps.engine.params import SheetParams, SpiralParams
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.curves.arcs import Curve


@pytest.fixture(scope="module")
def made(flat_grid):
    flat = flat_grid(5, 3, cut=lambda x, y: x == 2)
    return sheets.make_sheets(
        fabricable.uniform_design(flat, SpiralParams(thickness=0.0015)), SheetParams(nesting="FAST")
    )


def lost(panel: Panel) -> float:
    """Cubic millimetres at most between arcs and chords, of a sheet of 1.5 mm: two thirds of the tolerance along all outlines."""
    length = panel.outline.length + sum(hole.length for hole in panel.holes)
    return 1.5 * 1e6 * 2.0 / 3.0 * solid_files.TOLERANCE * length


def test_stl_reads_back_as_closed_solids(made, tmp_path):
    (path,) = export.write_sheets(made, tmp_path / "sheet", ("stl",))
    mesh = trimesh.load_mesh(path)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 2
    assert mesh.volume == pytest.approx(1.5 * sum(p.area for p in made.panels) * 1e6, abs=sum(map(lost, made.panels)))
    low, high = mesh.bounds
    outlines = np.concatenate([p.outline.sample(1e-5) for p in made.panels_on_sheet(0)]) * 1e3
    np.testing.assert_allclose(low, [*outlines.min(axis=0), 0.0], atol=0.02)
    np.testing.assert_allclose(high, [*outlines.max(axis=0), 1.5], atol=0.02)


def test_3mf_holds_every_panel_by_its_number(made, tmp_path):
    (path,) = export.write_sheets(made, tmp_path / "sheet", ("3mf",))
    space = {"m": "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"}
    with zipfile.ZipFile(path) as package:
        assert package.testzip() is None
        assert {"[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"} == set(package.namelist())
        root = ET.fromstring(package.read("3D/3dmodel.model"))
    assert root.get("unit") == "millimeter"
    objects = root.findall(".//m:object", space)
    assert [o.get("name") for o in objects] == [f"panel {panel.number}" for panel in made.panels_on_sheet(0)]
    assert [i.get("objectid") for i in root.findall(".//m:item", space)] == ["1", "2"]
    for found, panel in zip(objects, made.panels_on_sheet(0), strict=True):
        vertices = np.array([[float(v.get(k)) for k in "xyz"] for v in found.iterfind(".//m:vertex", space)])
        triangles = np.array(
            [[int(t.get(k)) for k in ("v1", "v2", "v3")] for t in found.iterfind(".//m:triangle", space)]
        )
        mesh = trimesh.Trimesh(vertices, triangles, process=False)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(1.5 * panel.area * 1e6, abs=lost(panel))


def test_a_ring_has_exactly_its_volume():
    square = Curve(np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]), np.zeros(4))
    hole = Curve(np.array([[0.02, 0.02], [0.02, 0.05], [0.05, 0.05], [0.05, 0.02]]), np.zeros(4))
    solid = solid_files.extrude_panel(Panel(1, 0, square, (hole,), (), 0.0091), 0.002)
    mesh = trimesh.Trimesh(solid.vertices, solid.triangles, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(0.0091 * 0.002)
    assert mesh.euler_number == 0  # a torus


@pytest.mark.parametrize("text", ["A1", "B08A", "D-69", "Q8"])
def test_letters_on_hubs_are_grooves_of_a_fifth_of_the_thickness(text):
    square = Curve(np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]), np.zeros(4))
    lines = lettering.straight_text(text, 0.004, np.array([0.05, 0.05]), np.array([0.8, 0.6]))
    strokes = tuple(Curve(s, np.zeros(len(s)), closed=False) for s in lines)
    for nozzle in (0.0, 0.0006):
        solid = solid_files.extrude_panel(Panel(1, 0, square, (), (), 0.01, hub_labels=strokes), 0.002, nozzle=nozzle)
        mesh = trimesh.Trimesh(solid.vertices, solid.triangles, process=False)
        assert mesh.is_volume
        wide = nozzle or solid_files.GROOVE_WIDTH
        letters = shapely.union_all([shapely.LineString(s).buffer(0.5 * wide, quad_segs=2) for s in lines])
        assert mesh.volume == pytest.approx(0.01 * 0.002 - letters.area * 0.0004, rel=1e-9)
        assert set(np.round(mesh.vertices[:, 2], 9)) == {0.0, 0.0016, 0.002}


def test_letters_near_an_edge_are_left_out():
    square = Curve(np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]), np.zeros(4))
    stroke = Curve(np.array([[0.0005, 0.01], [0.0005, 0.02]]), np.zeros(2), closed=False)
    solid = solid_files.extrude_panel(Panel(1, 0, square, (), (), 0.01, hub_labels=(stroke,)), 0.002)
    assert set(solid.vertices[:, 2]) == {0.0, 0.002}


def test_an_outline_that_crosses_itself_is_refused():
    bow = Curve(np.array([[0, 0], [0.1, 0.1], [0.1, 0], [0, 0.1]]), np.zeros(4))
    with pytest.raises(FlexMapsError, match="Panel 7"):
        solid_files.extrude_panel(Panel(7, 6, bow, (), (), 0.0), 0.002)


def test_solids_are_written_only_when_asked_for(made, tmp_path):
    names = {p.name for p in export.write_sheets(made, tmp_path / "sheet")}
    assert names == {"sheet-01.svg", "sheet-01.dxf", "sheet-r12-01.dxf", "sheet-01.pdf"}
    assert {p.name for p in export.write_sheets(made, tmp_path / "sheet", ("stl", "3mf"))} == {
        "sheet-01.stl",
        "sheet-01.3mf",
    }
