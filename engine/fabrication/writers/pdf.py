"""PDF at true size: a small writer for pages with lines, areas and text, and the sheets as pages.

The writer covers only the part of ISO 32000-1 that is needed here: cubic curves for arcs, a standard font, outlines of
letters that the font lacks, and optional content groups as layers.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from ... import MARK
from ...progress import SILENT, Progress
from ...spirals.curves.arcs import Curve
from . import glyphs
from .operations import DrawableSheets, curves_by_operation

POINT = 0.0254 / 72.0  # metres per point
MAX_PAGE_UNITS = 14400.0  # maximum size of a page in its units; larger pages need a unit larger than a point
COMPRESSION_LEVEL = 4  # zlib compression level; higher levels make slightly smaller files and take much longer
# widths of Helvetica's characters, starting at the space, in thousandths of the font size (Adobe Font Metrics)
_WIDTHS = (
    "278 278 355 556 556 889 667 191 333 333 389 584 278 333 278 278 556 556 556 556 556 556 556 556 556 556 278 278 584 "
    "584 584 556 1015 667 667 722 722 667 611 778 722 278 500 667 556 833 722 778 667 778 722 667 611 722 667 944 667 667 "
    "611 278 278 278 469 556 333 556 556 500 556 556 278 556 556 222 222 500 222 833 556 556 556 556 333 500 278 556 500 "
    "722 500 500 500 334 260 334 584"
)
HELVETICA_WIDTHS = tuple(int(w) for w in _WIDTHS.split())


@dataclass
class Page:
    """One page; lengths in metres, origin at its lower left. Later drawing covers earlier drawing.

    width, height : metres
    commands : PDF operators drawn so far
    layers : names of the page's layers
    """

    width: float
    height: float
    commands: list[str] = field(default_factory=list)
    layers: list[str] = field(default_factory=list)

    @property
    def metres_per_unit(self) -> float:
        """Metres per unit of the page's coordinates."""
        return POINT * max(1.0, np.ceil(max(self.width, self.height) / POINT / MAX_PAGE_UNITS))

    def begin_layer(self, name: str) -> None:
        """Begin a layer of this name, which ends at ``end_layer``."""
        if name not in self.layers:
            self.layers.append(name)
        self.commands.append(f"/OC /L{self.layers.index(name)} BDC")

    def end_layer(self) -> None:
        """End the current layer."""
        self.commands.append("EMC")

    def draw_curve(self, curve: Curve, colour: str = "#000000", width: float = 2e-4) -> None:
        """Draw a curve as a line.

        Parameters
        ----------
        curve : lines and arcs, metres
        colour : "#rrggbb"
        width : width of the line, metres
        """
        self.commands.append(
            f"{_colour_operands(colour)} RG {width / self.metres_per_unit:.5g} w [] 0 d {curve_operators(curve, self.metres_per_unit)} "
            + ("s" if curve.closed else "S")
        )

    def fill_polygon(self, points: np.ndarray, colour: str, line: str | None = None, width: float = 2e-4) -> None:
        """Fill a polygon, and draw its outline if ``line`` gives a colour for it.

        Parameters
        ----------
        points : (M, 2) metres
        colour, line : "#rrggbb" of the area and of its outline; without an outline by default
        width : line width of the outline, metres
        """
        command = f"{_colour_operands(colour)} rg {curve_operators(Curve(points, np.zeros(len(points))), self.metres_per_unit)} "
        if line is not None:
            command = f"{_colour_operands(line)} RG {width / self.metres_per_unit:.5g} w [] 0 d {command}"
        self.commands.append(command + ("b" if line is not None else "h f"))

    def draw_text(
        self, text: str, position: tuple[float, float], size: float, colour: str = "#000000", is_centred: bool = False
    ) -> None:
        """Write a line of text.

        Parameters
        ----------
        text : one line, in any script
        position : x and y of the start of the text's baseline, metres
        size : size of the font, metres
        colour : "#rrggbb"
        is_centred : whether ``position`` is the middle of the baseline and not its start
        """
        x = position[0] - (0.5 * text_width(text, size) if is_centred else 0.0)
        for run in glyphs.split_runs(text):
            outlines = glyphs.outlines_by_run.get(run)
            place = x / self.metres_per_unit, position[1] / self.metres_per_unit
            if outlines is not None:
                drawn = glyphs.glyph_operators(outlines, *place, size / self.metres_per_unit)
                self.commands.append(f"{_colour_operands(colour)} rg {drawn} f")
            else:
                written = run.encode("cp1252", "replace").decode("latin-1")
                written = written.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
                self.commands.append(
                    f"{_colour_operands(colour)} rg BT /F {size / self.metres_per_unit:.5g} Tf {place[0]:.5g} {place[1]:.5g} Td ({written}) Tj ET"
                )
            x += text_width(run, size)


def text_width(text: str, size: float) -> float:
    """Return the length in metres of a line of text.

    Parameters
    ----------
    text : one line
    size : size of the font, metres
    """
    drawn = [run for run in glyphs.split_runs(text) if run in glyphs.outlines_by_run]
    known = (ord(c) - 32 for run in glyphs.split_runs(text) if run not in glyphs.outlines_by_run for c in run)
    plain = 1e-3 * sum(HELVETICA_WIDTHS[n] if 0 <= n < len(HELVETICA_WIDTHS) else 556 for n in known)
    return size * (plain + sum(glyphs.outlines_by_run[run].width for run in drawn))


@lru_cache(maxsize=4096)
def _colour_operands(text: str) -> str:
    """Return the red, green and blue components (0 to 1) of a colour "#rrggbb" as PDF operands."""
    return " ".join(f"{int(text[i : i + 2], 16) / 255:.4g}" for i in (1, 3, 5))


def curve_operators(curve: Curve, unit: float) -> str:
    """Return the PDF path operators of a curve, in units of ``unit`` metres.

    Arcs become cubic Bezier curves of at most an eighth of a turn, which deviate by less than 1e-6 of the radius.
    """
    count = len(curve.points) if curve.closed else len(curve.points) - 1
    (x, y), *following = nodes = (curve.points / unit).tolist()
    first, bulge = f"{x:.10g} {y:.10g} m ", curve.bulge[:count]
    if (np.abs(bulge) < 1e-9).all():
        ends = [*following, nodes[0]] if curve.closed else following
        return first + " ".join([f"{x:.10g} {y:.10g} l" for x, y in ends])
    points = np.ascontiguousarray(curve.points).view(complex)[:, 0] / unit
    return first + " ".join(_segment_operators(points[:count], np.roll(points, -1)[:count], bulge))


def _segment_operators(start: np.ndarray, end: np.ndarray, bulge: np.ndarray) -> list[str]:
    """Return the PDF operators of lines and cubics from ``start`` to ``end`` (N,), complex, in order."""
    straight = np.abs(bulge) < 1e-9
    angle = 4.0 * np.arctan(np.where(straight, 1.0, bulge))
    centre = start + 0.5 * (end - start) * (1.0 + 1.0j / np.tan(0.5 * angle))
    pieces = np.where(straight, 1, np.ceil(np.abs(angle) / (0.25 * np.pi) - 1e-9).astype(int))
    which = np.repeat(np.arange(len(start)), pieces)
    place = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    step = (angle / pieces)[which]
    spoke = (start - centre)[which] * np.exp(1.0j * step * place)
    following = spoke * np.exp(1.0j * step)
    following[np.cumsum(pieces) - 1] = end - centre
    arm = 4.0j / 3.0 * np.tan(0.25 * step)
    middle = centre[which]
    found = np.stack([middle + spoke * (1 + arm), middle + following * (1 - arm), middle + following], axis=1)
    rows = np.ascontiguousarray(found).view(float).tolist()
    return [
        f"{x:.10g} {y:.10g} l" if flat else f"{a:.9g} {b:.9g} {c:.9g} {d:.9g} {x:.9g} {y:.9g} c"
        for (a, b, c, d, x, y), flat in zip(rows, straight[which].tolist(), strict=True)
    ]


def pdf_bytes(pages: list[Page], title: str, progress: Progress = SILENT) -> bytes:
    """Return the content of a PDF file with these pages.

    Parameters
    ----------
    pages : pages in order; layers with equal names become one layer of the file
    title : title of the file, in any script
    progress : called with the fraction done; may cancel
    """
    names = list(dict.fromkeys(name for page in pages for name in page.layers))
    first = 4 + len(names)  # objects: 1 catalogue, 2 pages, 3 font, then layers, then page and content alternately
    bodies = [
        b"<</Type/Catalog/Pages 2 0 R" + (_layer_list(len(names)) if names else b"") + b">>",
        f"<</Type/Pages/Count {len(pages)}/Kids[{' '.join(f'{first + 2 * i} 0 R' for i in range(len(pages)))}]>>".encode(),
        b"<</Type/Font/Subtype/Type1/BaseFont/Helvetica/Encoding/WinAnsiEncoding>>",
    ]
    bodies += [f"<</Type/OCG/Name({name})>>".encode("latin-1") for name in names]
    for i, page in enumerate(pages):
        progress(0.95 + 0.05 * i / len(pages), "writing the pages")
        content = zlib.compress("\n".join(["1 J 1 j", *page.commands]).encode("latin-1"), COMPRESSION_LEVEL)
        used = "".join(f"/L{k} {4 + names.index(name)} 0 R" for k, name in enumerate(page.layers))
        scale = page.metres_per_unit / POINT
        bodies.append(
            f"<</Type/Page/Parent 2 0 R/MediaBox[0 0 {page.width / page.metres_per_unit:.8g} {page.height / page.metres_per_unit:.8g}]"
            f"{f'/UserUnit {scale:g}' if scale > 1 else ''}"
            f"/Resources<</Font<</F 3 0 R>>/Properties<<{used}>>>>/Contents {first + 2 * i + 1} 0 R>>".encode()
        )
        bodies.append(b"<</Filter/FlateDecode/Length %d>>stream\n" % len(content) + content + b"\nendstream")
    # UTF-16 with byte order mark, in hexadecimal digits, can hold any script; readers show it in the window's title
    info = (b"\xfe\xff" + title.encode("utf-16-be", "replace")).hex().upper().encode()
    bodies.append(b"<</Title<" + info + b">/Producer(" + MARK.encode() + b")>>")
    return _assemble(bodies)


def _layer_list(count: int) -> bytes:
    """Return the entry of the PDF catalogue that lists the layers."""
    listed = " ".join(f"{4 + i} 0 R" for i in range(count)).encode()
    return b"/OCProperties<</OCGs[" + listed + b"]/D<</Order[" + listed + b"]/ON[" + listed + b"]>>>>"


def _assemble(bodies: list[bytes]) -> bytes:
    """Return the file's bytes: objects, cross-reference table and trailer."""
    data = bytearray(b"%PDF-1.6\n%\xe2\xe3\xcf\xd3\n")
    offsets = []
    for number, body in enumerate(bodies, start=1):
        offsets.append(len(data))
        data += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    start = len(data)
    data += b"xref\n0 %d\n0000000000 65535 f \n" % (len(bodies) + 1)
    data += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    data += b"trailer<</Size %d/Root 1 0 R/Info %d 0 R>>\nstartxref\n%d\n%%%%EOF\n" % (
        len(bodies) + 1,
        len(bodies),
        start,
    )
    return bytes(data)


# -- the sheets ----------------------------------------------------------------------------------------------------


def write_pdf(sheets: DrawableSheets, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write one sheet as a page of true size, with one layer and colour per operation.

    Parameters
    ----------
    sheets : panels on their sheets, and cuts
    index : number of the sheet, from 0
    path : file to write
    progress : called with the fraction done; may cancel
    """
    width, height = sheets.packing.sizes[index].tolist()
    page = Page(width, height)
    for (name, colour, _), curves in curves_by_operation(sheets, index, progress):
        page.begin_layer(name)
        for curve in curves:
            page.draw_curve(curve, colour, sheets.cut.line_width)
        page.end_layer()
    path.write_bytes(pdf_bytes([page], f"sheet {index + 1} of {sheets.count}"))
