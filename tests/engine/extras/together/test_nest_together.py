"""Several pieces and copies on common sheets: nothing overlaps, all is there as often as asked, every label says whose it is."""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.together.nest_together import nest_together
from flexmaps.engine.fabrication.panels import lettering
from flexmaps.engine.fabrication.panels.labels import panel_name, seam_labels
from flexmaps.engine.fabrication.writers import export, parts
from flexmaps.engine.params import ObjectSettings, with_values
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

QUICK = with_values(ObjectSettings(), {"sheet.nesting": "FAST", "connect.connector": "key"})


@pytest.fixture(scope="module")
def pieces() -> list[Result]:
    return [
        job.run(PolygonMesh.from_quads(shapes.make(name, 0.02)), settings, stop_after="spirals")
        for name, settings in (("strip", with_values(QUICK, {"layout.seamless": True})), ("dome", QUICK))
    ]


def copies(*counts: int) -> list[ObjectSettings]:
    return [with_values(QUICK, {"export.copies": count}) for count in counts]


def test_all_copies_lie_apart_on_common_sheets(pieces: list[Result]) -> None:
    made = nest_together(["arch", "dome"], pieces, copies(2, 1))
    alone = [len(r.flat.layout.patches) for r in pieces if r.flat is not None]
    panels = [p for p in made.sheets.panels if p.patch >= 0]
    assert len(panels) == 2 * alone[0] + alone[1]
    assert Counter(p.mark for p in panels) == {"A": alone[0], "B": alone[0], "C": alone[1]}
    names = [panel_name(p.number, p.mark) for p in panels]
    assert len(set(names)) == len(names)
    for k in range(made.sheets.count):
        placed = [shapely.Polygon(p.outline.sample(1e-5)) for p in made.sheets.panels_on_sheet(k)]
        box = shapely.box(0, 0, *made.sheets.packing.sizes[k])
        assert all(box.contains(p) for p in placed)
        tree = shapely.STRtree(placed)
        one, two = tree.query(placed, predicate="dwithin", distance=QUICK.sheet.spacing - 1e-6)
        assert (one == two).all()


def test_the_letter_is_engraved_before_the_number(pieces: list[Result]) -> None:
    """The strokes that a copy's panel has and its plain panel has not are those of its letter, before the number and every joint."""
    made = nest_together(["arch"], pieces[:1], copies(2))
    plain = nest_together(["arch"], pieces[:1], copies(1))
    layout = made.parts[0].design.flat.layout
    assert {p.mark for p in plain.sheets.panels} == {""} and {p.mark for p in made.sheets.panels if p.patch >= 0} == {
        "A",
        "B",
    }
    for mark in "AB":
        for panel in (p for p in made.sheets.panels if p.patch >= 0 and p.mark == mark):
            bare = next(p for p in plain.sheets.panels if p.patch == panel.patch)
            joints = [name for (quad, _), name in seam_labels(layout).items() if layout.patch_of[quad] == panel.patch]
            both = [
                (panel_name(panel.number, mark), panel_name(panel.number)),
                *((f"{mark}-{j}", j) for j in joints),
            ]
            more = sum(len(lettering.text_strokes(a)) - len(lettering.text_strokes(b)) for a, b in both)
            assert len(panel.labels) - len(bare.labels) == more > 0
    assert made.sheets.labels_left_out == plain.sheets.labels_left_out == 0
    assert made.sheets.labels_placed == 2 * plain.sheets.labels_placed


def test_parts_list_and_files(pieces: list[Result], tmp_path: Path) -> None:
    made = nest_together(["arch", "dome"], pieces, copies(1, 2))
    parts.write_parts_list(made.sheets, made.designs, made.parts[0].material, tmp_path / "parts.csv")
    rows = list(csv.DictReader((tmp_path / "parts.csv").open(encoding="utf-8")))[:-1]
    assert len(rows) == len(made.sheets.panels) and len({row["part"] for row in rows}) == len(rows)
    spirals = sum(int(row["spirals"]) for row in rows)
    assert spirals == len(pieces[0].mesh.quads) + 2 * len(pieces[1].mesh.quads)
    files = export.write_sheets(made.sheets, tmp_path / "all", ("svg", "dxf"))
    assert len(files) == 2 * made.sheets.count
    seen = made.seen_by(1)
    assert {p.piece for p in seen.panels if p.patch >= 0} == {1, 2} and made.letters_of(1) == ["B", "C"]
    assert seen.connections is made.parts[1].sheets.connections


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"spiral.thickness": 3}, "thickness differs"),
        ({"material.material": "pla"}, "material differs"),
        ({"cut.kerf_outline": 0.1}, "cutter differs"),
    ],
)
def test_what_cannot_share_a_sheet_is_refused(pieces: list[Result], values: dict, says: str) -> None:
    other = with_values(QUICK, values)
    result = pieces[1]
    if "spiral.thickness" in values:
        result = result.without_outdated(other)
    with pytest.raises(FlexMapsError, match=f"dome and arch cannot share sheets, for their .*{says}"):
        nest_together(["arch", "dome"], [pieces[0], result], [QUICK, other])


def test_none_and_too_many_are_refused(pieces: list[Result]) -> None:
    with pytest.raises(FlexMapsError, match="nothing to lay"):
        nest_together([], [], [])
    with pytest.raises(FlexMapsError, match="too many"):
        nest_together(["dome"] * 3, [pieces[1]] * 3, copies(1000, 1000, 1000))
    begun = job.check_input(pieces[0].surface.source)
    with pytest.raises(FlexMapsError, match=r"^bare: "):
        nest_together(["bare"], [begun], [QUICK])


def test_one_piece_once_is_as_ever(pieces: list[Result]) -> None:
    made = nest_together(["arch"], pieces[:1], copies(1)).sheets
    plain = job.run_stages(pieces[0], QUICK, ("sheets",)).sheets
    assert plain is not None and made.count == plain.count
    assert np.allclose(made.packing.shift, plain.packing.shift) and made.cut_length == pytest.approx(plain.cut_length)
