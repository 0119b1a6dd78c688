"""The order of assembly, and the sheet that shows it as PDFium reads it."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.extras.assembly_sheet import sheet as assembly_sheet
from flexmaps.engine.extras.assembly_sheet import step_pictures
from flexmaps.engine.fabrication import estimates, sheets
from flexmaps.engine.fabrication.panels.labels import panel_name, seam_name
from flexmaps.engine.fabrication.writers import pdf
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.params import LayoutParams, SheetParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.joining import assembly_steps, panel_numbers
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import Progress
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import shapes

pdfium = pytest.importorskip("pypdfium2")


def test_every_step_adds_one_panel_that_touches_what_is_there(flat_grid):
    layout = flat_grid(9, 6, cut=lambda x, y: x in (3, 6) or y == 3).layout  # 3 by 2 panels
    found = assembly_steps(layout)
    assert sorted(s.panel for s in found) == list(range(6))
    assert found[0].joins == ()
    for before, step in pairwise(found):
        assert set(step.joined_panels) == {*before.joined_panels, step.panel}
        assert step.joins
        assert all(j.panel == step.panel and j.other in before.joined_panels for j in step.joins)
    # every joint is made once
    assert sum(j.joints for s in found for j in s.joins) == layout.cut.sum()
    assert sorted(j.seam for s in found for j in s.joins) == list(range(len(layout.seams)))


def test_breadth_first_from_the_largest(flat_grid):
    # a row of panels 2, 2, 6, 2 and 2 quads long: out from the middle one, by turns
    layout = flat_grid(14, 2, cut=lambda x, y: x in (2, 4, 10, 12)).layout
    order = [s.panel for s in assembly_steps(layout)]
    middles = [layout.mesh.centroids[layout.patches[p], 0].mean() for p in order]
    away = np.abs(np.array(middles) - 0.14)
    assert away[0] == pytest.approx(0)
    assert (np.diff(away) >= -1e-9).all()


def test_bodies_begin_anew_and_inner_cuts_are_closed():
    layout = trace.trace_layout(shapes.make("two_bodies"), LayoutParams())
    found = assembly_steps(layout)
    body = layout.mesh.body_of
    bodies = [int(body[layout.patches[s.panel][0]]) for s in found]
    assert sum(not s.joins for s in found) == 2
    assert len(set(bodies[: bodies.count(bodies[0])])) == 1
    sphere = merge.merge(trace.trace_layout(shapes.make("cubesphere"), LayoutParams()), LayoutParams())
    alone = [s for s in assembly_steps(sphere.layout) if any(j.other == j.panel for j in s.joins)]
    inner = [
        e for e in sphere.layout.seams if len(set(sphere.layout.patch_of[sphere.layout.mesh.edge_quads[e[0]]])) == 1
    ]
    assert sum(j.other == j.panel for s in alone for j in s.joins) == len(inner)


def test_the_sheet_says_what_to_do(tmp_path):
    mesh = shapes.make("saddle")
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    cut = flat.layout.cut.copy()
    cut[trace.middle_line(flat.layout, 0)] = True
    flat = flatten.flatten(type(flat.layout)(mesh, cut), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams())
    on_sheets = sheets.make_sheets(made, SheetParams(nesting="FAST"))
    figures = estimates.estimate(on_sheets, made, MATERIALS["acrylic"])
    path = assembly_sheet.write_assembly_sheet(made, on_sheets, figures, tmp_path / "assembly.pdf", "A saddle (large)")
    document = pdfium.PdfDocument(path)
    np.testing.assert_allclose(np.array(document[0].get_size()) * 25.4 / 72, [210, 297], atol=0.01)
    text = [page.get_textpage().get_text_range() for page in document]
    assert "A saddle (large)" in text[0]
    assert f"{figures.mass * 1e3:.0f} g" in text[0]
    assert "1 of 2" in text[0]
    joined = "\n".join(text)
    order = assembly_steps(flat.layout)
    said = re.findall(r"(?:Take|Add) panel (\d+)", joined)
    assert [int(number) for number in said] == list(range(1, len(order) + 1))
    assert joined.count("Add panel") == len(order) - 1
    for step in order:
        for join in step.joins:
            assert f"{seam_name(join.seam)}: {join.joints} joint" in joined
            # the numbers that are engraved on the first and the last arm
            assert f"{seam_name(join.seam)}1" in joined
            assert f"{seam_name(join.seam)}{join.joints}" in joined


def test_a_view_shows_the_panel_and_not_what_hides_it(flat_grid):
    flat = flat_grid(4, 4)
    mesh = flat.layout.mesh
    view = step_pictures.camera_axes(np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view) == pytest.approx(1.0)
    assert step_pictures.are_visible(mesh.vertices @ view.T, mesh.quads, np.arange(16), np.ones(16, dtype=bool)).all()
    # a second sheet above hides the first one, seen from above
    places = np.concatenate([mesh.vertices, mesh.vertices + np.array([0.0, 0.0, 0.1])])
    quads = np.concatenate([mesh.quads, mesh.quads + len(mesh.vertices)])
    assert not step_pictures.are_visible(places, quads, np.arange(16), np.ones(32, dtype=bool)).any()


def test_joints_that_do_not_hold_by_themselves_are_named(flat_grid):
    spirals = fabricable.uniform_design(flat_grid(4, 3, cut=lambda x, _: x == 2), SpiralParams(), twist=1.0)
    made = sheets.make_sheets(spirals, SheetParams(nesting="FAST"))
    one, *rest = made.connections.connectors
    tab = replace(one, candidate=replace(one.candidate, kind="tab"))
    joints = replace(made.connections, connectors=(tab, *rest), plain_joints=(("B7", 0, 1),))

    def words(sheet):
        figures = estimates.estimate(sheet, spirals, MATERIALS["pom"])
        page = assembly_sheet.draw_pages(spirals, sheet, figures, "x")[0]
        text = pdfium.PdfDocument(assembly_sheet.pdf_bytes([page], "x"))[0].get_textpage().get_text_range()
        return " ".join(text.split())

    assert "Glue" not in words(made)
    found = words(replace(made, connections=joints))
    assert f"Glue these joints: {one.name}." in found
    assert "These have plain ends: B7." in found


def test_steps_beyond_the_pictures_are_told_in_words(flat_grid, monkeypatch):
    flat = flat_grid(6, 6, cut=lambda x, y: True)
    spirals = fabricable.uniform_design(flat, SpiralParams())
    made = sheets.make_sheets(spirals, SheetParams(nesting="FAST", labels=False))
    figures = estimates.estimate(made, spirals, MATERIALS["pom"])
    monkeypatch.setattr(assembly_sheet, "SHOWN", 10 * 36)
    seen = []
    found = assembly_sheet.draw_pages(spirals, made, figures, "x", progress=Progress(lambda f, _: seen.append(f)))
    assert seen == sorted(seen)
    assert len(found) == 1 + 4 + 1  # the overview, ten pictures on pages of three, and words
    document = pdfium.PdfDocument(pdf.pdf_bytes(found, "x"))
    text = [" ".join(page.get_textpage().get_text_range().split()) for page in document]
    order, numbers = assembly_steps(flat.layout), panel_numbers(flat.layout)
    assert [int(number) for number in re.findall(r"(\d+)\. Add panel", text[-1])] == list(range(11, 37))
    for number, step in enumerate(order[10:], start=11):
        joins = " ".join(f"{seam_name(join.seam)} to {panel_name(numbers[join.other])}" for join in step.joins)
        assert f"{number}. Add panel {panel_name(number)} {joins}" in text[-1]
    with pytest.raises(Cancelled):
        assembly_sheet.draw_pages(spirals, made, figures, "x", progress=Progress(stopped=lambda: True))
