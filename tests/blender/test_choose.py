"""Choosing a layout in Blender, in the main job and from a script; taking another one; what the sidebar shows of it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import mesh, next_button, states
from flexmaps.bridge.view import thumbnails
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh
from support.bowl import bowl
from support.buttons import press, report
from support.drawing import draw
from support.quick import few_layouts


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    few_layouts(monkeypatch)


@pytest.fixture
def chosen(add: Any, once: Any, quick: None) -> Any:
    def make() -> None:
        obj = add(bowl(closed=True))
        obj.flexmaps.choose.match = 0.05
        obj.flexmaps.optimise.patience = 0.1
        press("merge")
        press("choose")

    return once("chosen", make)


def seams(obj: Any) -> np.ndarray:
    return np.array([edge.use_seam for edge in obj.data.edges])


def widths_of(obj: Any) -> np.ndarray:
    return np.array([item.value for item in obj.data.attributes["flexmaps_width"].data])


def test_a_layout_is_chosen_and_another_taken(chosen: Any) -> None:
    block = report(chosen)["choose"]
    rows = block["proposals"]
    assert len(rows) >= 2
    assert report(chosen)["layout"]["patches"] == rows[block["taken"]]["panels"]
    assert seams(chosen).sum() == rows[block["taken"]]["joints"]
    press("spirals")
    before = seams(chosen)
    other = next(k for k in range(len(rows)) if k != block["taken"])
    press("take_choice", number=other)
    again = report(chosen)["choose"]
    assert again["taken"] == other and again["proposals"] == rows
    assert seams(chosen).sum() == rows[other]["joints"] and not np.array_equal(seams(chosen), before)
    assert "spirals" not in report(chosen)  # they belonged to the other panels
    now = states.read_states(chosen, bpy.context.scene)
    assert now["choose"].kind == now["layout"].kind == states.DONE
    press("take_choice", number=block["taken"])
    np.testing.assert_array_equal(seams(chosen), before)


def test_the_spirals_are_those_with_which_the_layout_was_chosen(chosen: Any) -> None:
    """Simulated without another search, the piece comes as near as its proposal says; pressed again, curvature decides."""
    block = report(chosen)["choose"]
    press("spirals")
    press("simulate")
    asked = block["proposals"][block["taken"]]["rms_percent"]
    assert report(chosen)["equilibrium"]["rms_percent"] == pytest.approx(asked, rel=0.1, abs=0.005)
    first = widths_of(chosen)
    press("spirals")
    assert np.abs(widths_of(chosen) - first).max() > 1e-3


@pytest.mark.thorough
def test_what_was_made_fit_stays_where_no_layout_comes_nearer(
    add: Any, quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With no other layout to compare, the present one keeps its spirals, its shape, and the match that it has reached."""
    few_layouts(monkeypatch, 1)
    obj = add(bowl(closed=True))
    obj.flexmaps.choose.match = 0.001
    obj.flexmaps.optimise.iterations = 1  # stays farther than the match that is wanted
    obj.flexmaps.optimise.restart, obj.flexmaps.optimise.codesign = False, False
    press("merge")
    press("fit")
    before, widths, cut = report(obj), widths_of(obj), seams(obj)
    press("choose")
    after = report(obj)
    row = after["choose"]["proposals"][after["choose"]["taken"]]
    assert {name: after[name] for name in before} == before
    np.testing.assert_array_equal(widths_of(obj), widths)
    np.testing.assert_array_equal(seams(obj), cut)
    assert row["origin"] == "as it was" and row["proved"]
    assert row["rms_percent"] == pytest.approx(after["equilibrium"]["rms_percent"], abs=1e-4)  # rounded
    scene = bpy.context.scene
    now = states.read_states(obj, scene)
    assert {now[stage].kind for stage in ("layout", "choose", "spirals", "optimise", "equilibrium")} == {states.DONE}
    assert next_button.next_idname(obj, scene, now) != "flexmaps.choose"
    assert "is expected to come clearly nearer than the present one" in after["choose"]["note"]  # none was searched


def test_there_is_nothing_to_take_before_and_no_such_proposal(add: Any, chosen: Any) -> None:
    with pytest.raises(RuntimeError, match="no proposal 9"):
        bpy.ops.flexmaps.take_choice(number=9)
    other = add(bowl(closed=True))
    assert not bpy.ops.flexmaps.choose.poll() and not bpy.ops.flexmaps.take_choice.poll()
    bpy.context.view_layer.objects.active = other


@pytest.mark.thorough
def test_cut_there_changes_the_layout_that_is_there_and_says_what_it_brought(add: Any, quick: None) -> None:
    obj = add(bowl())
    obj.flexmaps.optimise.patience = 0.2
    press("merge")
    before = seams(obj)
    press("cut_there")
    block = report(obj)["choose"]
    origins = {row["origin"] for row in block["proposals"]}
    assert origins <= {"as it was", "cut in the middle", "cut through the worst place", "a dart", "joined"}
    assert "nearer match by other cuts" in block["note"]
    taken = block["proposals"][block["taken"]]
    given = next(row for row in block["proposals"] if row["origin"] == "as it was")
    assert taken["rms_percent"] <= given["rms_percent"]
    if taken["origin"] != "joined":
        assert seams(obj)[before].all()  # cuts were added
    assert obj.flexmaps.choose.goal == "match" and not obj.flexmaps.choose.near  # the settings are the user's own


def test_undoable_settings_and_seams_make_it_out_of_date(chosen: Any) -> None:
    scene = bpy.context.scene
    chosen.flexmaps.choose.match = 2.0  # what is wanted says how to search, not what was found
    assert states.read_states(chosen, scene)["choose"].kind == states.DONE
    chosen.data.edges[0].use_seam = not chosen.data.edges[0].use_seam
    assert states.read_states(chosen, scene)["choose"].kind == states.STALE


def test_the_pictures_show_each_layout_in_its_square(chosen: Any) -> None:
    count = len(report(chosen)["choose"]["proposals"])
    strip = bpy.data.images[f"{chosen.data.name} layouts"]
    assert tuple(strip.size) == (thumbnails.SIZE * count, thumbnails.SIZE) and strip.packed_file is not None
    pixels = np.array(strip.pixels[:]).reshape(thumbnails.SIZE, -1, 4)
    for k in range(count):
        filled = pixels[:, k * thumbnails.SIZE : (k + 1) * thumbnails.SIZE, 3] > 0.5
        assert 0.2 < filled.mean() < 0.95  # a bowl fills most of its square, and not its corners
        assert not filled[[0, 0, -1, -1], [0, -1, 0, -1]].any()
    assert thumbnails.icon_numbers(chosen, count) == [0] * count  # there is no window


def test_the_sidebar_shows_the_proposals(chosen: Any) -> None:
    lines = draw("layout")
    proposals = report(chosen)["choose"]["proposals"][:6]
    for row in proposals:
        assert ("1 panel" if row["panels"] == 1 else f"{row['panels']} panels") in lines
    for figure in (r"(~ )?\S+ %", r"\S+ (min|h)", r"\d+ sheets?"):
        assert len([line for line in lines if re.fullmatch(figure, line)]) >= len(proposals)


@pytest.mark.thorough
def test_the_main_job_writes_the_others_figures(quick: None, tmp_path: Path) -> None:
    source = tmp_path / "bowl.obj"
    made = bowl(closed=True)
    text = [f"v {x} {y} {z}" for x, y, z in made.vertices] + ["f " + " ".join(map(str, q + 1)) for q in made.quads]
    source.write_text("\n".join(text), encoding="utf-8")
    wanted = {"choose.goal": "panels", "choose.panels": 5, "optimise.patience": 0.1, "sheet.nesting": "FAST"}
    described = api.run(source, tmp_path / "out", settings=wanted, chosen=True, pictures=False)
    block = described["choose"]
    assert described["layout"]["patches"] == block["proposals"][block["taken"]]["panels"] <= 5
    assert json.loads((tmp_path / "out" / "report.json").read_text())["choose"] == block
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Layouts that were compared" in page and block["proposals"][0]["origin"] in page
    assert (tmp_path / "out" / "plots" / "choices.svg").is_file()
    api.load(tmp_path / "out" / "model.blend")  # and another one can be taken there
    obj = bpy.context.object
    surface = mesh.read_surface(obj, bpy.context.scene)
    assert {"choices"} <= surface.values.keys()
    assert len(check.as_quad_mesh(surface.polygons).quads) == len(made.quads)


@pytest.mark.thorough
def test_from_a_script_by_a_number_of_panels(quick: None) -> None:
    piece = api.load(PolygonMesh.from_quads(bowl(closed=True)), settings={"optimise.patience": 0.1})
    piece = api.choose(piece, panels=3)
    assert piece.settings.choose.goal == "panels"
    choice = piece.result.choice
    assert choice is not None and piece.result.flat is choice.best.flat
    other = api.take(piece, (choice.taken + 1) % len(choice.proposals))
    assert other.result.flat is not piece.result.flat
