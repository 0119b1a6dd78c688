"""The sidebar, drawn into a list of lines."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import panels
from flexmaps.bridge.store import notes
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from support.buttons import press, report


class Drawn:
    """Stands for a layout and notes what is drawn; every property and operator must be there."""

    def __init__(self, lines: list[str] | None = None):
        self.lines = [] if lines is None else lines
        self.alert = False

    def prop(self, owner: Any, name: str, **_: Any) -> None:
        assert name in owner.bl_rna.properties, name

    def prop_search(self, owner: Any, name: str, where: Any, collection: str, **_: Any) -> None:
        assert name in owner.bl_rna.properties and collection in where.bl_rna.properties, name

    def operator(self, idname: str, text: str = "", **_: Any) -> Any:
        group, name = idname.split(".")
        self.lines.append(text or getattr(getattr(bpy.ops, group), name).get_rna_type().name)
        return SimpleNamespace()

    def label(self, text: str = "", icon: str = "", **_: Any) -> None:
        self.lines.append(("! " if self.alert else "") + text)
        if icon == "CANCEL" and not text:
            self.lines.append("failed")  # the sign of a sub-panel

    def progress(self, text: str = "", **_: Any) -> None:
        self.lines.append(text)

    def template_icon(self, icon_value: int, **_: Any) -> None:
        assert icon_value >= 0

    def separator(self, **_: Any) -> None:
        pass

    def panel(self, idname: str, default_closed: bool = False) -> Any:
        return self._inner(), self._inner()

    def _inner(self, **_: Any) -> Drawn:
        inner = Drawn(self.lines)
        inner.alert = self.alert
        return inner

    row = column = box = _inner


def draw(panel: Any) -> list[str]:
    drawn = Drawn()
    shown = SimpleNamespace(layout=drawn, stage=getattr(panel, "stage", ""))
    if hasattr(panel, "draw_header"):
        panel.draw_header(shown, bpy.context)
    panel.draw(shown, bpy.context)
    return drawn.lines


@pytest.fixture
def sides() -> Callable[[], list[str]]:
    ours = [
        panel for panel in panels.CLASSES if panel.bl_region_type == "UI"
    ]  # the list of presets is drawn by Blender
    return lambda: [line for panel in ours if getattr(panel, "poll", bool)(bpy.context) for line in draw(panel)]


def test_the_sidebar_shows_the_numbers_of_every_stage(dome: Any, tmp_path: Path, sides: Any, content: Any) -> None:
    dome.flexmaps.export.folder = str(tmp_path)
    assert "Largest distortion" not in sides()
    for button in ("check", "merge", "spirals", "export"):
        press(button)
        before = content(dome)
        sides()
        assert content(dome) == before
    lines = sides()
    for wanted in ("Patches", "Largest distortion", "Seam mismatch", "Spirals", "Twist", "Sheets", "Cut length"):
        assert wanted in lines
    assert "-" not in lines and "None" not in " ".join(lines)


def test_the_sidebar_tells_a_simulation_as_it_is(dome: Any, sides: Any) -> None:
    for button in ("flatten", "spirals", "simulate"):
        press(button)
    lines = sides()
    assert {"RMS distance", "Largest distance", "Largest strain"} <= set(lines)
    dome.flexmaps.simulate.iterations = 1
    assert "A setting was changed since" in sides()
    press("simulate")
    status = report(dome)["equilibrium"]["status"]
    assert "No equilibrium" in status and status[:20] in " ".join(sides())
    assert "! Iterations" in sides()  # in red
    dome.flexmaps.material.material = "custom"
    sides()


def test_the_sidebar_tells_what_is_borne(dome: Any, sides: Any) -> None:
    feet = dome.vertex_groups.new(name="feet")
    low = min(v.co.z for v in dome.data.vertices)
    feet.add([v.index for v in dome.data.vertices if v.co.z < low + 1e-4], 1.0, "REPLACE")
    dome.flexmaps.loads.supports = "feet"
    dome.flexmaps.structure.cases = "weight: weight; heavy: snow 1e5"
    for button in ("flatten", "spirals", "simulate", "structure"):
        press(button)
    lines = sides()
    assert {"heavy: snow 1e5", "Add load", "weight", "Largest deflection", "! Gives way at", "Utilisation"} <= set(
        lines
    )
    assert "'heavy' the piece snaps at" in " ".join(lines)


def test_the_sidebar_shows_a_running_job_and_warnings(add: Any, sides: Any) -> None:
    from flexmaps.bridge.hosts import background

    obj = add(shapes.make("dome"))
    notes.write_checks(obj.data, [check.Finding("x", "warning", "Quads are small", faces=(1,))])
    assert {"Quads are small", "Show faces"} <= set(sides())
    running = background.Job("Merge", lambda progress: None)
    running.text = "Merging: 12 patches"
    running.start()
    try:
        assert any("12 patches" in line for line in sides())
        assert not bpy.ops.flexmaps.trace.poll()
    finally:
        running.end()
    assert bpy.ops.flexmaps.trace.poll()


def test_the_sidebar_shows_the_first_remark_on_a_layout(dome: Any, sides: Any) -> None:
    press("flatten")
    quiet = sides()
    found = report(dome)["layout"]
    notes.write(
        dome.data, "layout", found | {"remarks": ["Panel 3 is one quad", "Panel 4 is another", "So is panel 5"]}
    )
    said = [line for line in sides() if line not in quiet]
    assert said[0] == "Panel 3 is one quad" and "and 2 more" in said[1]
    assert not any("another" in line or "So is" in line for line in said)
    notes.write(dome.data, "layout", found | {"remarks": ["Panel 3 is one quad"]})
    assert "more; Report" not in " ".join(sides())


def test_a_mesh_with_errors_has_no_tick(add: Any, sides: Any) -> None:
    """A check that found errors is done, and yet the mesh is not."""
    good = shapes.make("dome")
    obj = add(good)
    press("check")
    assert "failed" not in sides()
    add((good.vertices, np.concatenate([good.quads[:, :3], good.quads[:, [0, 2, 3]]])))
    with pytest.raises(RuntimeError, match="not quads"):
        press("check")
    assert "failed" in sides()
    bpy.context.view_layer.objects.active = obj
    assert "failed" not in sides()


def test_the_end_is_said_with_the_way_to_the_files(dome: Any, tmp_path: Path, sides: Any) -> None:
    dome.flexmaps.export.folder = str(tmp_path)
    for button in ("check", "merge", "spirals", "export"):
        press(button)
    files, lines = len(list(tmp_path.glob("[!.]*"))), sides()
    assert f"All is done. Sheets: 1, files: {files}" in " ".join(lines) and "Open the folder" in lines
    dome.flexmaps.sheet.sheet_width += 10.0
    assert "Open the folder" not in sides(), "sheets that are out of date are no end"


def test_who_has_nothing_selected_is_told_where_to_begin(sides: Any) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert "Add an example" in sides()
    press("example")
    obj = bpy.context.object
    assert obj.select_get() and {len(face.vertices) for face in obj.data.polygons} == {4}
    assert "Add an example" not in sides() and "Next: Check" in " ".join(sides())


def test_a_text_can_be_converted(sides: Any) -> None:
    bpy.ops.object.text_add()
    assert "Convert to a mesh" in sides()
    bpy.ops.mesh.primitive_cube_add()
    assert "Convert to a mesh" not in sides()


def test_in_a_narrow_sidebar_values_go_below_their_names(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is cut off would be the unit."""
    from flexmaps.panels import rows

    class Box(Drawn):
        rows = 0

        def row(self, **_: Any) -> Drawn:
            Box.rows += 1
            return super()._inner()

        def column(self, **_: Any) -> Box:
            return self

    for room, wanted in ((400, 1), (80, 2)):
        monkeypatch.setattr(rows, "_room", lambda _, room=room: room)
        Box.rows = 0
        rows.number(Box(), "Largest distance", "0.52 mm")
        assert Box.rows == wanted


def test_in_a_narrow_sidebar_long_settings_stand_below_their_names(dome: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from flexmaps.panels import rows

    fields: list[str | None] = []
    monkeypatch.setattr(Drawn, "prop", lambda self, owner, name, text=None: fields.append(text))
    for room, whole in ((500, True), (95, False)):
        monkeypatch.setattr(rows, "_room", lambda _, room=room: room)
        drawn = Drawn()
        fields.clear()
        for section, name in (("optimise", "lies"), ("optimise", "restart"), ("spiral", "thickness")):
            rows.setting_row(drawn, getattr(dome.flexmaps, section), name)
        assert fields == ([None] * 3 if whole else ["", "", ""])
        assert " ".join(drawn.lines) == ("" if whole else "Bends or lies alike Try other starts Thickness (mm)")
