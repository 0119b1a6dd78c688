"""What cannot be made is refused in one sentence that says what, where and what to do; the files of an earlier run stay."""

import os

import pytest
from flexmaps.engine import files
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.params import ConnectorParams, CutParams, Settings, SheetParams, SpiralParams
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

QUICK = {"nesting": "FAST", "labels": False}


def _write(out, name="sheet", **blocks):
    """Mesh to files, as the main job does it; the settings are made inside, for they may be refused already."""
    with files.write_all_atomically() as new:
        made = {key: make() for key, make in blocks.items()}
        settings = Settings(**{"sheet": SheetParams(**QUICK)} | made)
        result = job.run(PolygonMesh.from_quads(shapes.make("strip")), settings, edge=0.02)
        return export.write_sheets(result.sheets, out / name, ("svg",), new)


@pytest.fixture(scope="module")
def strip():
    settings = Settings(sheet=SheetParams(**QUICK))
    return job.run(PolygonMesh.from_quads(shapes.make("strip")), settings, edge=0.02).sheets


@pytest.fixture
def earlier(tmp_path):
    (tmp_path / "sheet-01.svg").write_text("earlier")
    yield tmp_path
    assert (tmp_path / "sheet-01.svg").read_text() == "earlier"
    assert os.listdir(tmp_path) == ["sheet-01.svg"]


def _in_two():
    """Sheets too small for the strip in one panel, so that it has joints."""
    return SheetParams(**QUICK, sheet_width=0.08, sheet_height=0.08)


REFUSED = {
    "kerf wider than a slot": (
        {"cut": lambda: CutParams(kerf_outline=0.0008, kerf_holes=0.0008)},
        r"Kerf, outlines 0\.8 mm is above Smallest slot 0\.3 mm; .* make the smallest slot at least as wide",
        False,
    ),
    "kerf wider than the ends of slots": (
        {
            "cut": lambda: CutParams(kerf_outline=0.0008, kerf_holes=0.0008),
            "spiral": lambda: SpiralParams(slot_min=0.0008),
        },
        r"kerf of 0\.8 mm is too wide .* make the kerf smaller",
        True,
    ),
    "kerf wider than the spacing": (
        {"cut": lambda: CutParams(kerf_outline=0.005), "spiral": lambda: SpiralParams(slot_min=0.005)},
        r"Kerf, outlines 5 mm is above Spacing 3 mm; .* make the spacing larger",
        False,
    ),
    "clearance larger than a connector": (
        {"connect": lambda: ConnectorParams(clearance=0.001), "sheet": _in_two},
        r"clearance of 1 mm connectors would slip out.* make the clearance at most",
        False,
    ),
    "sheet smaller than every panel": (
        {"sheet": lambda: SheetParams(**QUICK, sheet_width=0.02, sheet_height=0.02, margin=0.002)},
        r"sheet of 20 x 20 mm has no room for \d+ single quads; use a larger sheet",
        True,
    ),
    "sheet smaller than a panel that may not be cut": (
        {"sheet": lambda: SheetParams(**QUICK, sheet_width=0.05, sheet_height=0.05, oversize="error")},
        r"Panel \d is .* larger than the sheet of 50 x 50 mm.*use a larger sheet",
        True,
    ),
    "nothing but margin": (
        {"sheet": lambda: SheetParams(**QUICK, margin=0.3)},
        r"nothing but margin; make it larger or the margin of 300 mm smaller",
        False,
    ),
    "no thickness": ({"spiral": lambda: SpiralParams(thickness=0.0)}, r"Thickness 0 mm", False),
    "mill thicker than the smallest slot": (
        {"cut": lambda: CutParams(mill=0.002)},
        r"Mill 2 mm is above Smallest slot 0\.3 mm; .* make the smallest slot at least as wide",
        False,
    ),
    "mill thicker than the slots": (
        {"cut": lambda: CutParams(mill=0.002), "spiral": lambda: SpiralParams(slot_min=0.002)},
        r"mill of 2 mm does not fit into the slots of \d+ spirals.*make the smallest slot at least 2 mm and the fillet 1 mm",
        True,
    ),
    "mill thicker than the spacing": (
        {"cut": lambda: CutParams(mill=0.004), "spiral": lambda: SpiralParams(slot_min=0.005)},
        r"Mill 4 mm is above Spacing 3 mm; .* make the spacing larger",
        False,
    ),
    "corners sharper than the cutter": (
        {
            "cut": lambda: CutParams(kerf_outline=0.0003, kerf_holes=0.0003),
            "connect": lambda: ConnectorParams(rounding=0.0001),
            "sheet": _in_two,
        },
        r"too wide for corners of 0\.1 mm in the connectors; make their rounding at least 0\.15 mm",
        False,
    ),
    "widths the wrong way round": (
        {"spiral": lambda: SpiralParams(width_min=0.003, width_max=0.002)},
        r"Smallest width 3 mm is above Largest width 2 mm; exchange them",
        False,
    ),
    "twists the wrong way round": (
        {"spiral": lambda: SpiralParams(twist_min=5.0, twist_max=1.0)},
        r"Smallest twist 286\.479.* is above Largest twist 57\.29.*; exchange them",
        False,
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_the_place_and_the_way_out(earlier, case):
    blocks, says, place = REFUSED[case]
    with pytest.raises(FlexMapsError, match=says) as error:
        _write(earlier, **blocks)
    assert "\n" not in str(error.value)
    assert bool(len(error.value.faces)) == place
    assert all(0 <= f < 108 for f in error.value.faces)


def test_unwritable_folder(earlier):
    with pytest.raises(FlexMapsError, match=r"Cannot write .*file and no folder; choose another folder"):
        _write(earlier / "sheet-01.svg")


@pytest.mark.parametrize("name", ["a sheet (1) & more", "Blätter ✂ 100%", "'quoted' \"twice\"", "...dots"])
def test_odd_file_names(strip, tmp_path, name):
    assert [p.name for p in export.write_sheets(strip, tmp_path / name, ("svg",))] == [f"{name}-01.svg"]
    assert (tmp_path / f"{name}-01.svg").read_text().rstrip().endswith("</svg>")


def test_more_tabs_and_longer_lead_ins_than_there_is_room_for_are_left_out(tmp_path):
    _write(tmp_path, cut=lambda: CutParams(tabs=50, tab_width=0.02, lead_in=0.02))
    assert (tmp_path / "sheet-01.svg").is_file()
