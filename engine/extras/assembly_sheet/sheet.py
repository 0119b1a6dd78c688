"""Write the printable assembly sheet (A4, PDF): an overview, then a picture of every step."""

from __future__ import annotations

import os
import textwrap
from pathlib import Path

import numpy as np

from ...colours import patch_colours, seam_colours, to_hexadecimal
from ...fabrication.assembly_check import AssemblyCheck
from ...fabrication.estimates import Estimates, format_duration
from ...fabrication.panels.labels import panel_name, seam_name
from ...fabrication.sheets import CutSheets
from ...fabrication.writers.pdf import Page, pdf_bytes, text_width
from ...files import NewFile, write_atomically
from ...patches.flattening.flatten import FlatPatches
from ...patches.joining import AssemblyStep, SeamJoin, assembly_steps, panel_numbers
from ...progress import SILENT, Progress
from ...spirals.design import SpiralDesign
from .step_pictures import (
    GREY,
    HEIGHT,
    INK,
    MARGIN,
    PALE,
    WIDTH,
    PageBox,
    PatchColours,
    best_view,
    camera_axes,
    draw_flat_panel,
    draw_surface,
    inner_point,
    polyline,
)
from .support_page import draw_support_page

ROWS = 3  # number of steps with pictures on a page; larger: smaller pictures, fewer pages
BAY = 0.006  # small pictures close gaps between arms that are narrower than twice this, metres; larger: fewer details
SMALL = 0.005  # width of a panel on paper, metres, below which it is drawn as its convex hull without a number
# largest number of quads in all pictures of steps (15 microseconds and 30 bytes each); steps beyond it are described in
# words only. Larger: larger file, more time
SHOWN = 250_000
LINES = 58  # number of steps in a column of a page without pictures; a page has two columns


def write_assembly_sheet(
    design: SpiralDesign,
    sheets: CutSheets,
    figures: Estimates,
    target: str | os.PathLike[str],
    title: str,
    new: NewFile | None = None,
    checked: AssemblyCheck | None = None,
    progress: Progress = SILENT,
) -> Path:
    """Write the assembly sheet of a design and return its path.

    Parameters
    ----------
    design, sheets, figures : the piece, its panels on sheets, and its estimates of mass, time and cost
    target : path of the file
    title : name of the object
    new : file function of ``files.write_all_atomically``, if the sheet must appear together with other files
    checked : check of how hard every seam is to join, or None
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : the file cannot be written
    """
    data = pdf_bytes(draw_pages(design, sheets, figures, title, checked, progress), f"{title}: assembly", progress)
    if new is None:
        with write_atomically(target) as place:
            place.write_bytes(data)
    else:
        new(target).write_bytes(data)
    return Path(target)


def draw_pages(
    design: SpiralDesign,
    sheets: CutSheets,
    figures: Estimates,
    title: str,
    checked: AssemblyCheck | None = None,
    progress: Progress = SILENT,
) -> list[Page]:
    """Return the pages: an overview, steps with pictures, further steps in words, and the page of the base.

    Parameters
    ----------
    design, sheets, figures, title, checked, progress : as in ``write_assembly_sheet``
    """
    flat = design.flat
    look = PatchColours(
        to_hexadecimal(patch_colours(len(flat.layout.patches))),
        to_hexadecimal(seam_colours(max(len(flat.layout.seams), 1))),
    )
    progress(0.0, "ordering the steps")
    order = assembly_steps(flat.layout)
    found = [_draw_overview(flat, sheets, figures, title, look, checked, progress)]
    drawn = min(len(order), max(SHOWN // len(flat.layout.mesh.quads), ROWS))
    for first in range(0, drawn, ROWS):
        page = Page(WIDTH, HEIGHT)
        height = (HEIGHT - 2 * MARGIN) / ROWS
        for row, step in enumerate(order[first : min(first + ROWS, drawn)]):
            progress(0.2 + 0.7 * (first + row) / drawn, "drawing the steps of the assembly")
            box = PageBox(MARGIN, HEIGHT - MARGIN - (row + 1) * height, WIDTH - 2 * MARGIN, height)
            _draw_step(page, box, flat, first + row + 1, step, look)
        found.append(page)
    found += _draw_worded_steps(order, panel_numbers(flat.layout), drawn, look, progress)
    if sheets.base is not None:
        found.append(draw_support_page(sheets.base))
    for number, page in enumerate(found, start=1):
        page.draw_text(f"{title}  -  {number} of {len(found)}", (0.5 * WIDTH, 0.007), 0.0028, GREY, is_centred=True)
    return found


# -- the pages -----------------------------------------------------------------------------------------------------


def _draw_overview(
    flat: FlatPatches,
    sheets: CutSheets,
    figures: Estimates,
    title: str,
    look: PatchColours,
    checked: AssemblyCheck | None,
    progress: Progress,
) -> Page:
    """Return the overview page: picture of the whole piece, figures, sheets and list of seams."""
    page, layout = Page(WIDTH, HEIGHT), flat.layout
    page.draw_text(title, (MARGIN, HEIGHT - 0.022), 0.007, INK)
    page.draw_text("How to put it together", (MARGIN, HEIGHT - 0.029), 0.004, GREY)
    progress(0.0, "drawing the whole piece")
    everything = tuple(range(len(layout.patches)))
    view = camera_axes(np.array([0.6, -0.8, 0.0]))
    draw_surface(page, PageBox(MARGIN, 0.155, 0.115, 0.105), flat, everything, everything, (), look, view)
    progress(0.0, "collecting the figures of the sheets")
    y = HEIGHT - 0.045
    for name, value in _figures(sheets, figures, len(layout.patches)):
        page.draw_text(name, (0.135, y), 0.0032, GREY)
        page.draw_text(value, (0.166, y), 0.0032, INK)
        y -= 0.0056
    y -= 0.004
    for said in (
        "Panels are numbered, seams have letters. Every arm at a",
        "seam is engraved with the seam's letters and its number:",
        "A1 goes to A1, A2 to A2. The engraved side is outside.",
        "Work along a seam from one end to the other.",
        *_describe_letters(sheets),
        *_describe_glued_and_plain(sheets),
    ):
        page.draw_text(said, (0.135, y), 0.0025, INK)
        y -= 0.0042
    _draw_thumbnails(page, PageBox(MARGIN, 0.075, WIDTH - 2 * MARGIN, 0.07), sheets, look, progress)
    _draw_seam_list(page, PageBox(MARGIN, 0.014, WIDTH - 2 * MARGIN, 0.056), flat, look, checked)
    return page


def _describe_letters(sheets: CutSheets) -> list[str]:
    """Return lines of text about the letter that precedes all labels, if several pieces share the sheets."""
    marks = dict.fromkeys(p.mark for p in sheets.panels if p.patch >= 0 and p.mark)
    if not marks:
        return []
    said = f"Before each stands the letter of the copy, {' or '.join(marks)}, and a dash: only one letter goes into one piece."
    return textwrap.wrap(said, 52, max_lines=4, placeholder=" ...")


def _describe_glued_and_plain(sheets: CutSheets) -> list[str]:
    """Return lines of text that list glued joints and plain ends; no lines if all connectors are tabs or none exist."""
    made = sheets.connections
    glued = [c.name for c in made.connectors if c.kind == "tab"]
    if len(glued) == len(made.connectors):  # the user chose tabs, or no connectors
        return []
    found = []
    for said, names in (
        ("Glue these joints", glued),
        ("These have plain ends", [name for name, *_ in made.plain_joints]),
    ):
        if names:
            text = f"{said}: {', '.join(names)}."
            found += ["", *textwrap.wrap(text, 52, max_lines=8, placeholder=" ...")]
    return found


def _figures(sheets: CutSheets, figures: Estimates, panels: int) -> list[tuple[str, str]]:
    """Return the figures in the overview as (name, value with unit)."""
    found = [
        ("Panels", str(panels)),
        ("Sheets", f"{sheets.count}, {sheets.thickness * 1e3:g} mm thick"),
        ("Mass", f"{figures.mass * 1e3:.0f} g"),
        ("Joints", str(figures.joints)),
        ("Cut length", f"{figures.cut_length:.1f} m"),
    ]
    if figures.cut_seconds is not None:
        found.append(("Laser", f"about {format_duration(figures.cut_seconds / 60.0)}"))
    if figures.joints:
        found.append(("Assembly", f"about {format_duration(figures.assembly_seconds / 60.0)}"))
    if figures.costs:
        found.append(("Cost", f"about {sum(figures.costs.values()):.2f}"))
    return [*found, ("Narrowest", f"slot {sheets.slot_min * 1e3:.2f}, arm {sheets.bridge_min * 1e3:.2f} mm")]


def _draw_thumbnails(page: Page, box: PageBox, sheets: CutSheets, look: PatchColours, progress: Progress) -> None:
    """Draw small pictures of all sheets with their panels and the panels' numbers."""
    sizes = sheets.packing.sizes
    scale, columns = max(
        (min(0.95 * box.width / n / sizes[:, 0].max(), 0.92 * box.height / -(-len(sizes) // n) / sizes[:, 1].max()), n)
        for n in range(1, len(sizes) + 1)
    )
    across = min(box.width / columns, 1.06 * scale * float(sizes[:, 0].max()))
    rows = -(-len(sizes) // columns)
    down = min(box.height / rows, 1.06 * scale * float(sizes[:, 1].max()))
    along = ", their grain from left to right" if sheets.params.rotation == "GRAIN" else ""
    page.draw_text(f"Where the panels lie on the sheets{along}", (box.x, box.y + rows * down + 0.002), 0.0032, GREY)
    for index, size in enumerate(sizes):
        row, column = divmod(index, columns)
        corner = np.array([box.x + column * across, box.y + (rows - row - 1) * down])
        frame = corner + scale * size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        if index < len(sheets.packing.remnants):
            remnant = sheets.packing.remnants[index]
            page.fill_polygon(corner + scale * remnant.outline, "#ffffff", GREY, 1.5e-4)
            for hole in remnant.holes:
                page.fill_polygon(corner + scale * hole, "#dddddd", GREY, 1.5e-4)
        else:
            page.fill_polygon(frame, "#ffffff", GREY, 1.5e-4)
        for i in np.flatnonzero(sheets.packing.sheet == index).tolist():
            progress(0.2 * i / len(sheets.panels), "drawing the sheets")
            one = sheets.panels[i]
            outline = one.outline.transform(float(sheets.packing.rotation[i]), sheets.packing.shift[i]).sample(1e-4)
            small = scale * float(np.ptp(outline, axis=0).min()) < SMALL
            points = corner + scale * (_convex_hull(outline) if small else _simplify(outline, 0.15e-3 / scale))
            page.fill_polygon(points, look.patches[one.patch] if one.patch >= 0 else GREY)
            if one.patch < 0 or small:  # loose keys have no number
                continue
            page.draw_text(
                panel_name(one.number, one.mark), tuple(inner_point(points) - [0.0, 0.001]), 0.003, INK, is_centred=True
            )
        page.draw_text(str(index + 1), tuple(frame[3] + [0.001, -0.0035]), 0.0028, GREY)


def _convex_hull(points: np.ndarray) -> np.ndarray:
    """Return the convex hull of points (n, 2)."""
    from scipy.spatial import ConvexHull

    return points[ConvexHull(points).vertices]


def _simplify(points: np.ndarray, tolerance: float) -> np.ndarray:
    """Return an outline, points (n, 2), with its narrow gaps closed and fewer points; ``tolerance`` in metres."""
    import shapely

    closed = shapely.Polygon(points).buffer(BAY, quad_segs=2).buffer(-BAY, quad_segs=2)
    largest = max(getattr(closed, "geoms", [closed]), key=lambda g: g.area)
    return np.asarray(largest.simplify(tolerance).exterior.coords)[:-1]


def _draw_seam_list(
    page: Page, box: PageBox, flat: FlatPatches, look: PatchColours, checked: AssemblyCheck | None
) -> None:
    """Write the list of seams in columns: panels, number of joints, force, and a mark if a seam is hard to join."""
    layout, seams = flat.layout, () if checked is None else checked.seams
    numbers = panel_numbers(layout)
    forces = any(s.force is not None for s in seams)
    title = "Seams: panels, number of joints" + ", largest force" * forces
    title += "; ! is hard to join" * any(s.difficulties for s in seams)
    page.draw_text(title, (box.x, box.y + box.height), 0.0032, GREY)
    line, columns = 0.0042, 5 if forces else 6
    most = columns * int(box.height / line - 1)
    for number, edges in enumerate(layout.seams[: most if len(layout.seams) <= most else most - 1]):
        row, column = number % (most // columns), number // (most // columns)
        x, y = box.x + column * box.width / columns, box.y + box.height - (row + 1.2) * line
        page.fill_polygon(
            np.array([[x, y], [x + 0.003, y], [x + 0.003, y + 0.002], [x, y + 0.002]]), look.seams[number]
        )
        one, two = (panel_name(numbers[p]) for p in layout.patch_of[layout.mesh.edge_quads[edges[0]]].tolist())
        text = (
            f"{seam_name(number)}: {one} - {two}, {len(edges)}"
            if one != two
            else f"{seam_name(number)}: in {one}, {len(edges)}"
        )
        if seams:
            seam = seams[number]
            text += ("" if seam.force is None else f", {seam.force:.2g} N") + " !" * bool(seam.difficulties)
        page.draw_text(text, (x + 0.004, y), 0.0026, INK)
    if len(layout.seams) > most:
        page.draw_text("... the others are in the steps", (box.x + box.width * (1 - 1 / columns), box.y), 0.0026, INK)


def _draw_step(
    page: Page, box: PageBox, flat: FlatPatches, number: int, step: AssemblyStep, look: PatchColours
) -> None:
    """Draw a step: its title, its seams, the panels joined so far, and the flat new panel."""
    top = box.y + box.height
    page.draw_curve(polyline([[box.x, top - 0.001], [box.x + box.width, top - 0.001]]), PALE, 2e-4)
    page.draw_text(f"{number}", (box.x, top - 0.0095), 0.008, INK)
    numbers = panel_numbers(flat.layout)
    page.draw_text(
        _step_title(step, number), (box.x + 0.004 + text_width(str(number), 0.008), top - 0.0075), 0.004, INK
    )
    x, y = box.x + 0.004 + text_width(str(number), 0.008), top - 0.0125
    for join in step.joins:
        text = _describe_join(join, numbers)
        if x + text_width(text, 0.0029) > box.x + box.width:
            x, y = box.x + 0.012, y - 0.0045
        page.draw_text(text, (x, y), 0.0029, look.seams[join.seam])
        x += text_width(text + "     ", 0.0029)
    height = y - box.y - 0.006
    half = 0.5 * box.width
    view = best_view(flat, step)
    draw_surface(
        page,
        PageBox(box.x, box.y + 0.003, half - 0.003, height),
        flat,
        step.joined_panels,
        (step.panel,),
        step.joins,
        look,
        view,
    )
    draw_flat_panel(page, PageBox(box.x + half + 0.003, box.y + 0.003, half - 0.003, height), flat, step, look)


def _draw_worded_steps(
    order: list[AssemblyStep], numbers: tuple[int, ...], first: int, look: PatchColours, progress: Progress
) -> list[Page]:
    """Return pages that describe the steps from index ``first`` on without pictures, in two columns."""
    found = []
    width = 0.5 * (WIDTH - 2 * MARGIN)
    for start in range(first, len(order), 2 * LINES):
        page = Page(WIDTH, HEIGHT)
        for place, step in enumerate(order[start : start + 2 * LINES]):
            progress(0.9, "writing the steps of the assembly")
            column, row = divmod(place, LINES)
            x, y = MARGIN + column * width, HEIGHT - MARGIN - (row + 1) * (HEIGHT - 2 * MARGIN) / (LINES + 1)
            page.draw_text(f"{start + place + 1}. {_step_title(step, start + place + 1)}", (x, y), 0.0028, INK)
            end, x = x + width - 0.004, x + 0.034
            for join in step.joins:
                text = f"{seam_name(join.seam)} to {panel_name(numbers[join.other])}"
                if x + text_width(text, 0.0025) > end:
                    page.draw_text("...", (x, y), 0.0025, GREY)
                    break
                page.draw_text(text, (x, y), 0.0025, look.seams[join.seam])
                x += text_width(text + "   ", 0.0025)
        found.append(page)
    return found


def _step_title(step: AssemblyStep, number: int) -> str:
    """Return the title of a step, "Add panel 3" or "Take panel 1" for the first panel of a body."""
    joined = len(step.joined_panels) > 1 and any(join.other != step.panel for join in step.joins)
    return f"{'Add' if joined else 'Take'} panel {panel_name(number)}"


def _describe_join(join: SeamJoin, numbers: tuple[int, ...]) -> str:
    """Return the description of a seam to join, such as "A: 5 joints to panel 2"."""
    joints = f"{join.joints} joint" + "s" * (join.joints > 1)
    where = "within the panel" if join.other == join.panel else f"to panel {panel_name(numbers[join.other])}"
    return f"{seam_name(join.seam)}: {joints} {where}"
