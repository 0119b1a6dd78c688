"""What the tab says: step and share of a running job, names of jobs, sentences under *Next*, and plain figures."""

from __future__ import annotations

from typing import Any

import bpy
import polib
from flexmaps import operators
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import guidance, stored_report
from flexmaps.bridge.view import head_text, progress, text_layout
from flexmaps.panels import head, translations
from support.buttons import press, report
from support.drawing import draw

ROOM = text_layout.DEFAULT_WIDTH - text_layout.FRAME_WIDTH


def test_the_tab_is_never_ahead_of_the_status_bar() -> None:
    """It may be drawn at any time, but shows the step that the status bar was last given."""
    running = background.Job("Optimise", lambda progress: None)
    running._report(0.25, "First step")
    progress.show_progress(bpy.context, running)
    running._report(0.75, "Second step")
    content = head_text.head_content(bpy.context, "", None, running, None)
    assert "25 %" in content.label and content.hint.startswith("First step")
    assert "25 % First step" in progress.progress_line(running)
    progress.show_progress(bpy.context, running)
    assert "75 %" in head_text.head_content(bpy.context, "", None, running, None).label


def test_what_next_says_about_new_quads_fits_its_rows() -> None:
    """Also where it tells the size that they get, and in other languages."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=7)
    action = guidance.read_guidance(bpy.context.object, bpy.context.scene).action
    assert action is not None and action.properties["size"] > 0.0
    written = [
        entry.msgstr.format(2000, "130 mm")
        for file in translations.FOLDER.glob("*.po")
        for entry in polib.pofile(str(file))
        if entry.msgid.startswith("Makes about {} quads as a new object, {} large")
    ]
    assert written
    for sentence in (action.tooltip, *written):
        assert len(text_layout.break_lines(sentence, ROOM, 2 * head.NOTICE_ROWS)) <= head.NOTICE_ROWS


def test_jobs_are_named_as_the_buttons_of_next() -> None:
    named = {
        operators.layout.Merge: "Lay out the panels",
        operators.fit.Fit: "Make it fit",
        operators.export.Export: "Write the files",
    }
    assert {operator: operator.bl_label for operator in named} == named


def test_a_layout_without_distortion_is_told_so() -> None:
    assert operators.layout.describe_layout({"patches": 2, "energy_max": 1e-9}) == "2 panels without distortion"
    assert operators.layout.describe_layout({"patches": 1, "energy_max": 0.0123}) == "1 panel, largest distortion 0.012"


def test_energies_of_other_shapes_are_plain_figures(dome: Any) -> None:
    for name in ("flatten", "spirals", "simulate"):
        press(name)
    energy = report(dome)["equilibrium"]["energy"]
    others = [18.0 * energy, 0.9 * energy, energy]
    stored_report.write(dome.data, "equilibrium", report(dome)["equilibrium"] | {"other_energies": others})
    drawn = draw("shape")
    assert {"+1700 %", "-10 %", "0 %"} <= set(drawn)
