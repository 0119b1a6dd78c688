"""PDF: true size and true places, judged by PDFium, which draws the pages."""

import re

import numpy as np
import pytest
from flexmaps.engine.fabrication import sheets
from flexmaps.engine.fabrication.writers import export, pdf
from flexmaps.engine.params import SheetParams, SpiralParams
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.curves.arcs import Curve

pdfium = pytest.importorskip("pypdfium2")
MM = 25.4 / 72.0


def _drawn(data, dots_per_mm=10.0):
    """The first page as grey values (rows, columns), row 0 at the top."""
    page = pdfium.PdfDocument(data)[0]
    return np.asarray(page.render(scale=dots_per_mm * MM).to_pil().convert("L"))


def test_page_sizes_are_the_sheets(flat_grid, tmp_path):
    made = fabricable.uniform_design(flat_grid(3, 3, 0.03, cut=lambda x, y: x == 1), SpiralParams())
    cut = sheets.make_sheets(made, SheetParams(sheet_width=0.2, sheet_height=0.11, nesting="FAST"))
    (path,) = export.write_sheets(cut, tmp_path / "sheet", ("pdf",))
    assert path.name == "sheet-01.pdf"
    document = pdfium.PdfDocument(path)
    np.testing.assert_allclose(np.array(document[0].get_size()) * MM, [200.0, 110.0], atol=1e-4)
    # every panel lies where the sheet has it: the ink's extent is that of the outlines, and of labels beside them
    ink = np.nonzero(_drawn(path) < 200)
    curves = [curve for p in cut.panels_on_sheet(0) for curve in (p.outline, *p.labels, *p.waste_labels)]
    corners = np.concatenate([curve.sample(1e-5) for curve in curves]) * 1e3
    assert ink[1].min() / 10 == pytest.approx(corners[:, 0].min(), abs=0.15)
    assert ink[1].max() / 10 == pytest.approx(corners[:, 0].max(), abs=0.15)
    assert 110 - ink[0].max() / 10 == pytest.approx(corners[:, 1].min(), abs=0.15)
    assert 110 - ink[0].min() / 10 == pytest.approx(corners[:, 1].max(), abs=0.15)


@pytest.mark.parametrize("bulge", [0.05, 0.4, 1.0, 3.0, -0.7])
def test_arcs_are_round(bulge):
    # both halves of a lens or of a circle of another size
    curve = Curve(np.array([[0.01, 0.02], [0.03, 0.02]]), np.array([bulge, bulge]))
    numbers = pdf.curve_operators(curve, 1e-3).replace("m", "").split("c")[:-1]
    values = [np.array(n.split(), dtype=float) for n in numbers]
    start = complex(*values[0][:2])
    values[0] = values[0][2:]
    radius, half = 20 * (1 + bulge**2) / (4 * abs(bulge)), (1 - bulge**2) / (4 * abs(bulge)) * 20
    for value in values:
        one, two, end = (complex(*value[i : i + 2]) for i in (0, 2, 4))
        t = np.linspace(0, 1, 30)
        points = (1 - t) ** 3 * start + 3 * t * (1 - t) ** 2 * one + 3 * t**2 * (1 - t) * two + t**3 * end
        centres = [20 + 1j * (20 + s * half) for s in (-1, 1)]
        assert min(np.abs(np.abs(points - c) - radius).max() for c in centres) < 1e-5 * radius
        start = end


def test_text_stands_where_it_should():
    page = pdf.Page(0.1, 0.05)
    page.draw_text("HHHH (1) \\", (0.05, 0.02), 0.01, is_centred=True)
    ink = np.nonzero(_drawn(pdf.pdf_bytes([page], "a (title)")) < 128)
    assert ink[1].min() / 10 + ink[1].max() / 10 == pytest.approx(100.0, abs=4.0)
    assert (ink[1].max() - ink[1].min()) / 10 == pytest.approx(1e3 * pdf.text_width("HHHH (1) \\", 0.01), abs=3.0)


def test_a_page_larger_than_the_format_allows_gets_another_unit():
    page = pdf.Page(8.0, 6.0)
    page.draw_curve(Curve(np.array([[1.0, 1.0], [2.0, 1.0]]), np.zeros(2), closed=False))
    size = np.array(pdfium.PdfDocument(pdf.pdf_bytes([page], "large"))[0].get_size())
    assert size.max() <= 14400
    assert b"/UserUnit 2" in pdf.pdf_bytes([page], "large")


def test_areas_and_layers():
    page = pdf.Page(0.1, 0.1)
    page.begin_layer("cut inner")
    page.fill_polygon(np.array([[0.02, 0.02], [0.06, 0.02], [0.06, 0.06], [0.02, 0.06]]), "#000000")
    page.end_layer()
    data = pdf.pdf_bytes([page], "areas")
    assert (_drawn(data) < 128).sum() == pytest.approx(400 * 400, rel=0.01)
    assert b"/Type/OCG/Name(cut inner)" in data


def test_the_file_is_built_as_the_standard_says():
    """ISO 32000-1, 7.3.10 and 7.5: every object by itself between its own lines, where the table of contents says it is."""
    pages = []
    for k in range(3):
        pages.append(pdf.Page(0.1, 0.1))
        pages[-1].begin_layer(f"layer {k}")
        pages[-1].draw_text("(a) \\ b", (0.02, 0.02), 0.005)
        pages[-1].end_layer()
    data = pdf.pdf_bytes(pages, "a (title) \\")
    start = int(re.search(rb"\nstartxref\n(\d+)\n%%EOF\n$", data)[1])
    table = re.match(rb"xref\n0 (\d+)\n0000000000 65535 f \n((?:\d{10} 00000 n \n)*)trailer\n?<<", data[start:])
    offsets = [int(line[:10]) for line in table[2].splitlines()]
    assert len(offsets) == int(table[1]) - 1
    for number, (begin, end) in enumerate(zip(offsets, [*offsets[1:], start], strict=True), start=1):
        body = data[begin:end]
        assert re.match(rb"%d 0 obj\s" % number, body)
        assert body.endswith(b"\nendobj\n")
        stream = re.search(rb"/Length (\d+)>>\s*stream\r?\n", body)
        assert (b"endstream" in body) == (stream is not None)
        if stream:
            assert body[stream.end() + int(stream[1]) :] == b"\nendstream\nendobj\n"


def test_letters_that_the_font_lacks_are_drawn(monkeypatch):
    """As outlines where somebody gave them, in their place between the others; as question marks elsewhere."""
    from flexmaps.engine.fabrication.writers import glyphs

    square = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 1.0]])
    outlines = glyphs.GlyphOutlines(0.6, (np.repeat(square[:, None], 3, axis=1),))
    assert list(glyphs.split_runs("aЖЖ b")) == ["a", "ЖЖ", " b"] and list(glyphs.split_runs("")) == []
    plain = pdf.text_width("a", 1.0) + pdf.text_width(" b", 1.0)
    assert pdf.text_width("aЖЖ b", 1.0) == pytest.approx(plain + 2 * 0.556)
    monkeypatch.setitem(glyphs.outlines_by_run, "ЖЖ", outlines)
    assert pdf.text_width("aЖЖ b", 1.0) == pytest.approx(plain + 0.6)
    page = pdf.Page(0.1, 0.1)
    page.draw_text("aЖЖ b", (0.01, 0.02), 0.01)
    first, drawn, last = page.commands
    assert "(a) Tj" in first and "( b) Tj" in last and drawn.endswith(" f")
    x, y = (float(word) * page.metres_per_unit for word in drawn.split(" rg ")[1].split()[:2])
    assert (x, y) == (pytest.approx(0.01 + pdf.text_width("a", 0.01), rel=1e-4), pytest.approx(0.02, rel=1e-4))


def test_the_title_is_in_any_script():
    written = pdf.pdf_bytes([pdf.Page(0.1, 0.1)], "Ж (日本) \\ 😀")
    assert pdfium.PdfDocument(written).get_metadata_dict()["Title"] == "Ж (日本) \\ 😀"
