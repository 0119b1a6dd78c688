"""Last page of the assembly sheet: the base on which the piece stands, or the eyelets by which it hangs."""

from __future__ import annotations

import numpy as np

from ...fabrication.panels.labels import panel_name
from ...fabrication.standing.base import Base, foot_name
from ...fabrication.standing.eyelets import Eyelet
from ...fabrication.writers.pdf import Page
from ...patches.joining import panel_numbers
from .step_pictures import GREY, HEIGHT, INK, MARGIN, PALE, WIDTH

# Lengths on paper, metres
DOT = 0.0013  # half the width of the mark of an eyelet
LINE = 0.0045  # distance between the lines of the table of eyelets
PICTURE = 0.12  # height of the picture above the table
COLUMNS = (0.0, 0.012, 0.03, 0.05, 0.068, 0.086, 0.104)  # positions of the table's columns


def draw_support_page(base: Base) -> Page:
    """Return the page that shows where the feet or the eyelets of a base belong."""
    return _draw_eyelet_page(base) if base.eyelets else _draw_base_page(base)


def _draw_base_page(base: Base) -> Page:
    """Draw the plates from above, with the number of the foot beside each slot."""
    page, framed = Page(WIDTH, HEIGHT), base.is_frame
    page.draw_text("Put the feet into the slots of the base", (MARGIN, HEIGHT - MARGIN - 0.006), 0.005, INK)
    words = (
        "Every foot bears the number of its slot. They stand on their shoulders; glue them, or wedge them from below."
    )
    if framed:
        words = "Join the planks of the frame first. " + words
    page.draw_text(words, (MARGIN, HEIGHT - MARGIN - 0.013), 0.0029, GREY)
    outlines = [plate.outline.sample(1e-4) for plate in base.plates]
    low, high = (f(np.concatenate(outlines), axis=0) for f in (np.min, np.max))
    room = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN - 0.03])
    scale = min(1.0, float((room / (high - low)).min()))
    shift = np.array([MARGIN, HEIGHT - MARGIN - 0.02]) - scale * np.array([low[0], high[1]])
    for plate, outline in zip(base.plates, outlines, strict=True):
        page.fill_polygon(scale * outline + shift, PALE, INK)
        for foot, corners in zip(plate.feet, plate.slots, strict=True):
            page.fill_polygon(scale * corners + shift, GREY)
            size = min(0.0029, scale * 0.5 * foot.width)
            inwards = 0.5 * (low + high) - corners.mean(axis=0)
            beside = corners.mean(axis=0) + 0.9 * foot.width * inwards / max(float(np.linalg.norm(inwards)), 1e-9)
            x, y = (scale * beside + shift).tolist()
            page.draw_text(foot_name(foot), (x, y), size, INK, is_centred=True)
    return page


def _draw_eyelet_page(base: Base) -> Page:
    """Draw the eyelets from above and tabulate their positions and forces."""
    page = Page(WIDTH, HEIGHT)
    page.draw_text("Hang it by its eyelets", (MARGIN, HEIGHT - MARGIN - 0.006), 0.005, INK)
    first = base.eyelets[0]
    words = (
        f"Holes of {1e3 * first.diameter:g} mm, each with at least {1e3 * min(one.edge_width for one in base.eyelets):.2g} mm of material round "
        "it. The points are those of the simulated"
    )
    page.draw_text(words, (MARGIN, HEIGHT - MARGIN - 0.013), 0.0029, GREY)
    more = (
        "shape, seen from above; hold every one there with a hook or a short cord, so that the piece can turn about it."
    )
    page.draw_text(more, (MARGIN, HEIGHT - MARGIN - 0.0175), 0.0029, GREY)
    places = np.array([one.place[:2] for one in base.eyelets])
    corners = base.design.flat.layout.mesh.vertices[:, :2]
    low, high = (f(np.concatenate([places, corners]), axis=0) for f in (np.min, np.max))
    scale = min(1.0, float((np.array([WIDTH - 2 * MARGIN, PICTURE]) / np.maximum(high - low, 1e-9)).min()))
    shift = np.array([MARGIN, HEIGHT - MARGIN - 0.024]) - scale * np.array([low[0], high[1]])
    for quad in base.design.flat.layout.mesh.quads:
        page.fill_polygon(scale * corners[quad] + shift, PALE)
    square = DOT * np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    for one, place in zip(base.eyelets, places, strict=True):
        page.fill_polygon(scale * place + shift + square, INK)
        x, y = (scale * place + shift).tolist()
        page.draw_text(one.name, (x, y + 1.5 * DOT), 0.0024, INK, is_centred=True)
    _draw_table(page, base, HEIGHT - MARGIN - 0.034 - PICTURE)
    return page


def _draw_table(page: Page, base: Base, top: float) -> None:
    """Write a table of the eyelets, in one or two columns: name, panel, quad, position and force.

    top : height of the first line on the page, metres
    """
    eyelets, numbers = base.eyelets, panel_numbers(base.design.flat.layout)
    rows = int((top - MARGIN) / LINE) - 1
    for first in range(0, min(len(eyelets), 2 * rows), rows):
        left, some = MARGIN + (0.0 if first == 0 else 0.5 * (WIDTH - 2 * MARGIN)), eyelets[first : first + rows]
        narrow = 0.8 if len(eyelets) > rows else 1.0
        titles = ("", "Panel", "Face", "x mm", "y mm", "z mm", "Force N")
        table = [titles, *(_eyelet_cells(one, numbers[one.patch]) for one in some)]
        for n, cells in enumerate(table):
            for place, text in zip(COLUMNS, cells, strict=True):
                page.draw_text(text, (left + narrow * place, top - n * LINE), 0.0026, GREY if n == 0 else INK)
    if len(eyelets) > 2 * rows:
        page.draw_text(f"and {len(eyelets) - 2 * rows} more, see the report", (MARGIN, MARGIN), 0.0026, GREY)


def _eyelet_cells(one: Eyelet, number: int) -> tuple[str, ...]:
    """Return the cells of an eyelet's row in the table; ``number`` is the number of its panel."""
    force = "-" if one.force_magnitude is None else f"{one.force_magnitude:.3g}"
    place = (f"{1e3 * float(x):.1f}" for x in one.place)
    return (one.name, panel_name(number), str(one.quad), *place, force)
