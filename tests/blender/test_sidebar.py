"""The sidebar, drawn into a list of lines."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from flexmaps import operators
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import catalogue, finding_words, notices, stored_report
from flexmaps.bridge.store.notice import Notice
from flexmaps.bridge.view import text_layout
from flexmaps.bridge.view.tab import SECTIONS
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.surface import shapes
from flexmaps.panels import head, translations, workshop
from support.buttons import press, report
from support.drawing import Drawn, draw, everything

FRAME, MARGIN = 56, 6  # pixels, read off pictures: of the tab beside its rows; beside words in their part of a row
ROOM = text_layout.DEFAULT_WIDTH - text_layout.FRAME_WIDTH
# settings that stand nowhere in the tab: for the command line, and what the size in the head and the object's border say better
OUT = {("ChooseParams", "near"), ("RemeshParams", "edge"), ("SpiralParams", "border")}
TODAY = {  # operators that a person finds in the tab
    "quad_remesh", "regularise", "choose", "trace", "merge", "update_from_seams", "flatten", "spirals", "simulate",
    "optimise", "live", "pick_brush", "paint_from", "use_handles", "add_load", "remove_load", "structure", "compare_file",
    "explore", "export", "export_together", "report", "share", "add_remnant", "preview", "animate", "render", "check",
    "calibration_sheet", "calibrated", "overlay", "set_size", "apply_preset", "tutorial", "example", "next",
}  # fmt: skip


def test_every_setting_and_button_is_somewhere(dome: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workshop, "shows_expert_settings", lambda context: True)
    dome.flexmaps.choose.goal = "panels"
    found = everything()
    dome.flexmaps.choose.goal = "match"
    dome.flexmaps.base.base = "eyelets"
    found = draw("layout", found) and draw("piece", found) and found
    drawn = {(kind.removeprefix("FLEXMAPS_PG_"), name) for kind, name in found.props}
    wanted = {
        (type(block.default_factory()).__name__, f.name)
        for block in fields(ObjectSettings)
        for f in fields(block.default_factory)  # type: ignore[arg-type]
    }
    switched = {("ExportParams", "solids"), ("ExportParams", "dxf")}
    assert wanted - drawn - switched == OUT
    assert {f"flexmaps.{name}" for name in TODAY} <= set(found.operators)


def test_the_sections_show_the_figures_of_every_stage(dome: Any, tmp_path: Path, content: Any) -> None:
    dome.flexmaps.export.folder = str(tmp_path)
    assert "Seam mismatch" not in draw("layout")
    for name in ("check", "merge", "spirals", "export"):
        press(name)
        before = content(dome)
        lines = [line for section in SECTIONS for line in draw(section)]
        assert content(dome) == before
        assert "None" not in " ".join(lines) and "-" not in lines
    wanted = {"layout": "Distortion, largest", "shape": "Twist", "make": "Sheets, filled"}
    for section, label in wanted.items():
        assert label in draw(section)
    folded = draw()
    assert "1 panel" in folded and any(line.startswith("1 sheet") for line in folded)


def test_one_section_at_a_time(dome: Any) -> None:
    tab = bpy.context.window_manager.flexmaps_tab
    for key in SECTIONS:
        setattr(tab, f"open_{key}", True)
        assert [name for name in SECTIONS if getattr(tab, f"open_{name}")] == [key]


def test_the_head_has_as_many_rows_in_every_state(dome: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[int] = []

    class Box(Drawn):
        rows = 0

        def _inner(self, **_: Any) -> Drawn:
            made = Box(self)
            return made

        def box(self, **_: Any) -> Any:
            return Slots()

    class Slots(Drawn):
        """The box: each label, row or split directly in it is one row."""

        def column(self, **_: Any) -> Slots:
            return self

        def row(self, **_: Any) -> Drawn:
            counted[-1] += 1
            return Drawn()

        split = row

        def label(self, **_: Any) -> None:
            counted[-1] += 1

    def count() -> int:
        counted.append(0)
        head.draw(Box(), bpy.context, None)
        return counted[-1]

    dome.flexmaps.export.folder = str(tmp_path)
    from flexmaps.panels import stages

    for name in ("check", "merge", "spirals", "export"):
        stages.read_stages(bpy.context, refresh=True)
        count()
        press(name)
    running = background.Job(operators.layout.Merge.bl_label, lambda progress: None)
    running.start()
    try:
        count()
    finally:
        running.end()
    dome.flexmaps.spiral.thickness += 0.1
    stages.read_stages(bpy.context, refresh=True)
    count()
    assert set(counted) == {1 + head.NOTICE_ROWS}


def test_a_simulation_is_told_as_it_is(dome: Any) -> None:
    for name in ("flatten", "spirals", "simulate"):
        press(name)
    assert {"Distance, mean", "Distance, largest", "Strain, largest"} <= set(draw("shape"))
    dome.flexmaps.simulate.iterations = 1
    assert "<FILE_REFRESH>" in draw()
    press("simulate")
    assert "No equilibrium" in report(dome)["equilibrium"]["status"]
    assert "! Distance, mean" in draw("shape")  # in red


@pytest.mark.parametrize(("share", "sign"), [(0.9, "CHECKMARK"), (1.1, "ERROR")])
def test_no_tick_stands_beside_a_distortion_beyond_its_limit(dome: Any, share: float, sign: str) -> None:
    from flexmaps.panels import layout, sidebar, stages

    press("flatten")
    most = share * dome.flexmaps.layout.distortion_limit
    stored_report.write(dome.data, "layout", report(dome)["layout"] | {"energy_max": most})
    stages.read_stages(bpy.context, refresh=True)
    assert sidebar._section_icon(bpy.context, layout, ("layout",)) == sign


def test_what_is_borne(dome: Any) -> None:
    feet = dome.vertex_groups.new(name="feet")
    low = min(v.co.z for v in dome.data.vertices)
    feet.add([v.index for v in dome.data.vertices if v.co.z < low + 1e-4], 1.0, "REPLACE")
    dome.flexmaps.loads.supports = "feet"
    assert dome.flexmaps_rests == "STANDS"
    dome.flexmaps.structure.cases = "weight: weight; heavy: snow 1e5"
    for name in ("flatten", "spirals", "simulate", "structure"):
        press(name)
    bpy.context.window_manager.flexmaps_tab.check = "LOADS"
    lines = draw("check")
    assert {"heavy: snow 1e5", "Bends by", "! heavy: gives way at"} <= set(lines)


def test_a_running_job_stands_in_the_row_of_next(dome: Any) -> None:
    running = background.Job(operators.layout.Merge.bl_label, lambda progress: None)
    running.text = "Merging: 12 panels"
    running.start()
    try:
        layout = Drawn()
        lines = draw("piece", layout)
        assert "Lay out the panels, 0 %" in lines and any("12 panels" in line for line in lines)
        assert "flexmaps.stop" in layout.operators and "flexmaps.next" not in layout.operators
        press("stop")
        assert running.is_stopping and "Stopping" in draw("piece")
        assert not bpy.ops.flexmaps.trace.poll()
    finally:
        running.end()
    assert bpy.ops.flexmaps.trace.poll()


def test_the_size_is_set_in_millimetres(add: Any) -> None:
    obj = add(shapes.make("dome"))
    bpy.context.scene.unit_settings.scale_length = 0.01
    obj.scale = (50.0, 50.0, 50.0)
    bpy.context.view_layer.update()
    before = tuple(obj.flexmaps_size)
    assert before == pytest.approx([10.0 * length for length in obj.dimensions], rel=1e-5)
    obj.flexmaps_size[0] = 300.0
    bpy.context.view_layer.update()
    assert tuple(obj.flexmaps_size) == pytest.approx([300.0 / before[0] * length for length in before], rel=1e-4)
    edge = [(obj.matrix_world @ obj.data.vertices[a].co - obj.matrix_world @ obj.data.vertices[b].co).length
            for a, b in obj.data.edge_keys]  # fmt: skip
    middle = sorted(edge)[len(edge) // 2] * 10.0
    assert obj.flexmaps.remesh.edge == pytest.approx(middle, rel=0.05), "the size holds: quads are wanted as they are"


def test_the_size_is_that_of_the_target(dome: Any) -> None:
    before = tuple(dome.flexmaps_size)
    for button in ("flatten", "spirals", "simulate"):
        press(button)
    bpy.context.view_layer.update()
    assert tuple(1e3 * length for length in dome.dimensions) != pytest.approx(before, rel=1e-3)  # at rest it is another
    assert tuple(dome.flexmaps_size) == pytest.approx(before, rel=1e-5)


def test_stands_and_hangs(dome: Any) -> None:
    assert dome.flexmaps_rests == "FREE"
    dome.flexmaps_rests = "STANDS"
    assert "Plain, Stands, For days" in draw()
    group = dome.vertex_groups[dome.flexmaps.loads.supports]
    held = [v.co.z for v in dome.data.vertices if any(g.group == group.index for g in v.groups)]
    heights = sorted(v.co.z for v in dome.data.vertices)
    assert held and max(held) < heights[len(heights) // 2]
    dome.flexmaps_rests = "HANGS"
    assert dome.flexmaps.base.base == "eyelets" and dome.flexmaps_rests == "HANGS"
    for vertex in dome.data.vertices:
        vertex.select = vertex.index < 7
    press("hold_selection")
    assert sum(any(g.group == group.index for g in v.groups) for v in dome.data.vertices) == 7
    dome.flexmaps_rests = "FREE"
    assert (dome.flexmaps.base.base, dome.flexmaps.loads.supports) == ("none", "")


def test_nothing_ends_in_the_air_unless_somebody_wants_it(add: Any) -> None:
    """Arms at an open border are left out, also of quads that take the place of others; a choice is kept, and a closed mesh has no border."""
    bpy.ops.mesh.primitive_plane_add()
    bpy.ops.flexmaps.quad_remesh(quads=60)
    remeshed, plain, chosen, closed = (
        bpy.context.object,
        *(add(shapes.make(name)) for name in ("dome", "dome", "torus")),
    )
    chosen.flexmaps.spiral.border = "stubs"
    for obj, wanted in ((remeshed, "left_out"), (plain, "left_out"), (chosen, "stubs"), (closed, "stubs")):
        bpy.context.view_layer.objects.active = obj
        assert obj.flexmaps_border == wanted, "as it will be cut, before anything is"
        press("trace")
        assert obj.flexmaps.spiral.border == obj.flexmaps_border == wanted
    closed.flexmaps_border = "rim"
    assert closed.flexmaps.spiral.border == "rim"


def test_the_end_is_said_with_the_way_to_the_files(dome: Any, tmp_path: Path) -> None:
    dome.flexmaps.export.folder = str(tmp_path)
    for name in ("check", "merge", "spirals", "export"):
        press(name)
    assert "Open the folder" in draw()
    dome.flexmaps.sheet.sheet_width += 10.0
    assert "Open the folder" not in draw(), "sheets that are out of date are no end"


def test_who_has_nothing_selected_is_told_where_to_begin() -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert {"Next: Add an example", "Welcome to FlexMaps", "Tutorial"} <= set(draw())
    press("example")
    obj = bpy.context.object
    assert obj.select_get() and {len(face.vertices) for face in obj.data.polygons} == {4}
    lines = draw()
    assert "Welcome to FlexMaps" not in lines and any(line.startswith("Next: ") for line in lines)
    assert "Tutorial" in lines, "until a first piece is made"
    press("merge")
    assert stored_report.NAME in obj.data and "Tutorial" not in draw()


def test_a_text_can_be_converted() -> None:
    bpy.ops.object.text_add()
    assert "Next: Convert to a mesh" in draw()
    bpy.ops.mesh.primitive_cube_add()
    assert "Next: Convert to a mesh" not in draw()


def test_a_preset_is_named_until_a_setting_of_it_is_changed(dome: Any, root: Path) -> None:
    assert "Presets" in draw()
    file = root / "presets" / "flexmaps" / "Laser_Delrin_2_mm.py"
    press("apply_preset", filepath=str(file))
    assert "Laser Delrin 2 mm" in draw()
    dome.flexmaps.cut.kerf_outline += 0.05
    assert "Laser Delrin 2 mm*" in draw()
    dome.flexmaps.film.seconds += 1.0
    press("apply_preset", filepath=str(file))
    assert "Laser Delrin 2 mm" in draw()


def spoken(language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the sidebar speak a language; "" for English."""
    if not language:
        return
    known = {
        text: said for (_, text), said in catalogue.read_translations(translations.FOLDER / f"{language}.po").items()
    }
    words = SimpleNamespace(
        pgettext_iface=lambda text, context=None: known.get(text, text), pgettext_rpt=lambda text: known.get(text, text)
    )
    monkeypatch.setattr("flexmaps.bridge.store.i18n.bpy", SimpleNamespace(app=SimpleNamespace(translations=words)))


@pytest.mark.parametrize("language", ["", "de"])
def test_no_notice_and_no_cure_is_cut_at_the_usual_width(
    dome: Any, language: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the check and the simulation find, each with every button that may stand beside it."""
    spoken(language, monkeypatch)
    remedies = {"larger": 1.25, "thinner": 0.75, "finer": 1200.0, "cut": None}
    monkeypatch.setattr("flexmaps.engine.optimisation.remedies.read_block", lambda block: remedies)
    found = [
        {"code": code, "faces": [0] * 24, "edges": [0] * 24, "severity": "warning", "message": "", "more": 0.1}
        for code in finding_words.LABELS
    ]
    made = [
        *notices._from_checks(dome, bpy.context.scene, found),
        *notices._from_findings("structure", found),
        *(
            Notice(
                "failed",
                notices.interface(words, "24 quads"),
                "",
                finding_words.STOPS,
                cures=tuple(notices._cures_of_failure(dome, name)),
            )
            for name, words in finding_words.FAILURE_LABELS.items()
        ),
    ]
    cut = set()
    for notice in made:
        for cure in notice.cures:
            share = head._text_share(bpy.context, (replace(notice, cures=(cure,)),))
            for text, free in (
                (notice.label, share * ROOM - head.SIGN), (cure.label, (1.0 - share) * ROOM - head.CURE)
            ):  # fmt: skip
                if text_layout.text_width(text) > free:
                    cut.add((text, round(text_layout.text_width(text)), round(free)))
    assert not cut


@pytest.mark.parametrize("language", ["", "de"])
def test_no_name_is_cut_at_the_usual_width(dome: Any, language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names before values, and choices that stand beside each other."""
    spoken(language, monkeypatch)
    for button in ("flatten", "spirals"):
        press(button)
    monkeypatch.setattr(workshop, "shows_expert_settings", lambda context: True)
    width = text_layout.DEFAULT_WIDTH - FRAME
    cut = {
        (words, round(share * width - MARGIN), round(text_layout.text_width(words)))
        for words, share in everything().tight
        if text_layout.text_width(words) > share * width - MARGIN
    }
    assert not cut
