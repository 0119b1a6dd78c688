"""A printable sheet that shows how to put the panels together: what there is, then a picture of every step (A4, PDF)."""

from __future__ import annotations

import os
import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..colours import hexadecimal, of_patches, of_seams
from ..fabrication.estimates import Estimates
from ..fabrication.labels import panel_name, seam_name
from ..fabrication.pdf import Page, document, text_width
from ..fabrication.sheets import CutSheets
from ..files import NewFile, replacing
from ..patches.flatten import FlatPatches
from ..spirals.arcs import Curve
from ..spirals.design import SpiralDesign
from .assembly_check import AssemblyCheck
from .assembly_order import Join, Step, steps

WIDTH, HEIGHT, MARGIN = 0.21, 0.297, 0.015  # metres
ROWS = 3  # steps on a page
INK, GREY, PALE = "#1c1e24", "#7a7f87", "#e4e6e9"
LIFT = 0.35  # how far the view looks down, as the tangent of the angle
BAY = 0.006  # metres; narrower gaps between the arms on an outline are left out of small pictures
LOOKED_AT = 24  # quads of a panel of which it is found out whether they can be seen


def write(
    design: SpiralDesign,
    sheets: CutSheets,
    figures: Estimates,
    target: str | os.PathLike[str],
    title: str,
    new: NewFile | None = None,
    checked: AssemblyCheck | None = None,
) -> Path:
    """Write the assembly sheet of a design; returns its path.

    ``title`` names the object; ``checked`` tells how hard every seam is to join. ``new`` comes from ``files.replacing_many`` where it shall appear together with other files.
    Raises ``FlexMapsError`` where it cannot be written.
    """
    data = document(pages(design, sheets, figures, title, checked), f"{title}: assembly")
    if new is None:
        with replacing(target) as place:
            place.write_bytes(data)
    else:
        new(target).write_bytes(data)
    return Path(target)


def pages(
    design: SpiralDesign, sheets: CutSheets, figures: Estimates, title: str, checked: AssemblyCheck | None = None
) -> list[Page]:
    """The pages: an overview, where every panel lies on its sheet, and the steps."""
    flat = design.flat
    look = _Look(
        hexadecimal(of_patches(len(flat.layout.patches))), hexadecimal(of_seams(max(len(flat.layout.seams), 1)))
    )
    order = steps(flat.layout)
    found = [_overview(flat, sheets, figures, title, look, checked)]
    for first in range(0, len(order), ROWS):
        page = Page(WIDTH, HEIGHT)
        height = (HEIGHT - 2 * MARGIN) / ROWS
        for row, step in enumerate(order[first : first + ROWS]):
            box = _Box(MARGIN, HEIGHT - MARGIN - (row + 1) * height, WIDTH - 2 * MARGIN, height)
            _step(page, box, flat, first + row + 1, len(order), step, look)
        found.append(page)
    for number, page in enumerate(found, start=1):
        page.text(f"{title}  -  {number} of {len(found)}", (0.5 * WIDTH, 0.007), 0.0028, GREY, middle=True)
    return found


@dataclass(frozen=True)
class _Look:
    """Colours of patches and seams, "#rrggbb"."""

    patches: list[str]
    seams: list[str]


@dataclass(frozen=True)
class _Box:
    """A part of a page, metres, from its lower left corner."""

    x: float
    y: float
    width: float
    height: float


# -- the pages -----------------------------------------------------------------------------------------------------


def _overview(
    flat: FlatPatches, sheets: CutSheets, figures: Estimates, title: str, look: _Look, checked: AssemblyCheck | None
) -> Page:
    page, layout = Page(WIDTH, HEIGHT), flat.layout
    page.text(title, (MARGIN, HEIGHT - 0.022), 0.007, INK)
    page.text("How to put it together", (MARGIN, HEIGHT - 0.029), 0.004, GREY)
    everything = tuple(range(len(layout.patches)))
    view = _camera(np.array([0.6, -0.8, 0.0]))
    _model(page, _Box(MARGIN, 0.155, 0.115, 0.105), flat, everything, everything, (), look, view)
    y = HEIGHT - 0.045
    for name, value in _figures(sheets, figures, len(layout.patches)):
        page.text(name, (0.135, y), 0.0032, GREY)
        page.text(value, (0.166, y), 0.0032, INK)
        y -= 0.0056
    y -= 0.004
    for line in (
        "Panels are numbered, seams have letters. Every arm at a",
        "seam is engraved with the seam's letters and its number:",
        "A1 goes to A1, A2 to A2. The engraved side is outside.",
        "Work along a seam from one end to the other.",
        *_without_head(sheets),
    ):
        page.text(line, (0.135, y), 0.0025, INK)
        y -= 0.0042
    _thumbnails(page, _Box(MARGIN, 0.075, WIDTH - 2 * MARGIN, 0.07), sheets, look)
    _seam_list(page, _Box(MARGIN, 0.014, WIDTH - 2 * MARGIN, 0.056), flat, look, checked)
    return page


def _without_head(sheets: CutSheets) -> list[str]:
    """Lines that name the joints that do not hold by themselves, where others do."""
    made = sheets.connections
    glued = [c.name for c in made.connectors if c.kind == "tab"]
    if len(glued) == len(made.connectors):  # tabs, or no connectors at all, were asked for
        return []
    found = []
    for said, names in (("Glue these joints", glued), ("These have plain ends", [name for name, *_ in made.unsolved])):
        if names:
            text = f"{said}: {', '.join(names)}."
            found += ["", *textwrap.wrap(text, 52, max_lines=8, placeholder=" ...")]
    return found


def _figures(sheets: CutSheets, figures: Estimates, panels: int) -> list[tuple[str, str]]:
    found = [
        ("Panels", str(panels)),
        ("Sheets", f"{sheets.count}, {sheets.thickness * 1e3:g} mm thick"),
        ("Mass", f"{figures.mass * 1e3:.0f} g"),
        ("Joints", str(figures.joints)),
        ("Cut length", f"{sheets.cut_length:.1f} m"),
    ]
    if figures.cut_seconds is not None:
        found.append(("Laser", f"about {_duration(figures.cut_seconds)}"))
    if figures.joints:
        found.append(("Assembly", f"about {_duration(figures.assembly_seconds)}"))
    return [*found, ("Narrowest", f"slot {sheets.slot_min * 1e3:.2f}, arm {sheets.bridge_min * 1e3:.2f} mm")]


def _duration(seconds: float) -> str:
    minutes = max(round(seconds / 60.0), 1)
    return f"{minutes} min" if minutes < 90 else f"{minutes / 60.0:.1f} h"


def _thumbnails(page: Page, box: _Box, sheets: CutSheets, look: _Look) -> None:
    """All sheets with their panels, small."""
    sizes = sheets.packing.sizes
    scale, columns = max(
        (min(0.95 * box.width / n / sizes[:, 0].max(), 0.92 * box.height / -(-len(sizes) // n) / sizes[:, 1].max()), n)
        for n in range(1, len(sizes) + 1)
    )
    across = min(box.width / columns, 1.06 * scale * float(sizes[:, 0].max()))
    rows = -(-len(sizes) // columns)
    down = min(box.height / rows, 1.06 * scale * float(sizes[:, 1].max()))
    page.text("Where the panels lie on the sheets", (box.x, box.y + rows * down + 0.002), 0.0032, GREY)
    for index, size in enumerate(sizes):
        row, column = divmod(index, columns)
        corner = np.array([box.x + column * across, box.y + (rows - row - 1) * down])
        frame = corner + scale * size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        page.fill(frame, "#ffffff", GREY, 1.5e-4)
        for panel in sheets.on_sheet(index):
            points = corner + scale * _coarse(panel.outline.sampled(1e-4), 0.15e-3 / scale)
            page.fill(points, look.patches[panel.patch] if panel.patch >= 0 else GREY)
            if panel.patch < 0:  # a loose key
                continue
            page.text(panel_name(panel.patch), tuple(_middle(points) - [0.0, 0.001]), 0.003, INK, middle=True)
        page.text(str(index + 1), tuple(frame[3] + [0.001, -0.0035]), 0.0028, GREY)


def _coarse(points: np.ndarray, tolerance: float) -> np.ndarray:
    import shapely

    closed = shapely.Polygon(points).buffer(BAY, quad_segs=2).buffer(-BAY, quad_segs=2)
    largest = max(getattr(closed, "geoms", [closed]), key=lambda g: g.area)
    return np.asarray(largest.simplify(tolerance).exterior.coords)[:-1]


def _middle(points: np.ndarray) -> np.ndarray:
    import shapely

    place = shapely.Polygon(points).buffer(0.0).representative_point()
    return np.array([place.x, place.y])


def _seam_list(page: Page, box: _Box, flat: FlatPatches, look: _Look, checked: AssemblyCheck | None) -> None:
    """Every seam with its panels and joints, and what the check found, in columns."""
    layout, seams = flat.layout, () if checked is None else checked.seams
    forces = any(s.force is not None for s in seams)
    title = "Seams: panels, number of joints" + ", largest force" * forces
    title += "; ! is hard to join" * any(s.hard for s in seams)
    page.text(title, (box.x, box.y + box.height), 0.0032, GREY)
    line, columns = 0.0042, 5 if forces else 6
    most = columns * int(box.height / line - 1)
    for number, edges in enumerate(layout.seams[: most if len(layout.seams) <= most else most - 1]):
        row, column = number % (most // columns), number // (most // columns)
        x, y = box.x + column * box.width / columns, box.y + box.height - (row + 1.2) * line
        page.fill(np.array([[x, y], [x + 0.003, y], [x + 0.003, y + 0.002], [x, y + 0.002]]), look.seams[number])
        one, two = (panel_name(p) for p in layout.patch_of[layout.mesh.edge_quads[edges[0]]].tolist())
        text = (
            f"{seam_name(number)}: {one} - {two}, {len(edges)}"
            if one != two
            else f"{seam_name(number)}: in {one}, {len(edges)}"
        )
        if seams:
            seam = seams[number]
            text += ("" if seam.force is None else f", {seam.force:.2g} N") + " !" * bool(seam.hard)
        page.text(text, (x + 0.004, y), 0.0026, INK)
    if len(layout.seams) > most:
        page.text("... the others are in the steps", (box.x + box.width * (1 - 1 / columns), box.y), 0.0026, INK)


def _step(page: Page, box: _Box, flat: FlatPatches, number: int, count: int, step: Step, look: _Look) -> None:
    top = box.y + box.height
    page.stroke(_line([[box.x, top - 0.001], [box.x + box.width, top - 0.001]]), PALE, 2e-4)
    page.text(f"{number}", (box.x, top - 0.0095), 0.008, INK)
    name = panel_name(step.panel)
    done = f"Take panel {name}" if len(step.there) == 1 or not _outer(step) else f"Add panel {name}"
    page.text(done, (box.x + 0.004 + text_width(str(number), 0.008), top - 0.0075), 0.004, INK)
    x, y = box.x + 0.004 + text_width(str(number), 0.008), top - 0.0125
    for join in step.joins:
        text = _sentence(join)
        if x + text_width(text, 0.0029) > box.x + box.width:
            x, y = box.x + 0.012, y - 0.0045
        page.text(text, (x, y), 0.0029, look.seams[join.seam])
        x += text_width(text + "     ", 0.0029)
    height = y - box.y - 0.006
    half = 0.5 * box.width
    view = _best_view(flat, step)
    _model(
        page,
        _Box(box.x, box.y + 0.003, half - 0.003, height),
        flat,
        step.there,
        (step.panel,),
        step.joins,
        look,
        view,
    )
    _panel(page, _Box(box.x + half + 0.003, box.y + 0.003, half - 0.003, height), flat, step, look)


def _outer(step: Step) -> list[Join]:
    return [j for j in step.joins if j.other != step.panel]


def _sentence(join: Join) -> str:
    joints = f"{join.joints} joint" + "s" * (join.joints > 1)
    where = "within the panel" if join.other == join.panel else f"to panel {panel_name(join.other)}"
    return f"{join.name}: {joints} {where}"


# -- the pictures --------------------------------------------------------------------------------------------------


def _line(points: list[list[float]] | np.ndarray) -> Curve:
    points = np.asarray(points, dtype=float)
    return Curve(points, np.zeros(len(points)), closed=False)


def _fitted(low: np.ndarray, high: np.ndarray, box: _Box) -> tuple[float, np.ndarray]:
    """Scale and shift that bring a rectangle into the middle of a box."""
    size = np.maximum(high - low, 1e-9)
    scale = float(min(box.width / size[0], box.height / size[1]))
    return scale, np.array([box.x + 0.5 * box.width, box.y + 0.5 * box.height]) - 0.5 * scale * (low + high)


def _model(
    page: Page,
    box: _Box,
    flat: FlatPatches,
    there: tuple[int, ...],
    strong: tuple[int, ...],
    joins: tuple[Join, ...],
    look: _Look,
    view: np.ndarray,
) -> None:
    """The target surface as far as it is there, from a camera's axes ``view`` (3, 3); the rest as a pale ghost."""
    layout, mesh = flat.layout, flat.layout.mesh
    ahead, places = view[2], mesh.vertices @ view.T
    scale, shift = _fitted(places[:, :2].min(axis=0), places[:, :2].max(axis=0), box)
    drawn = places[:, :2] * scale + shift
    shown = np.isin(layout.patch_of, there)
    towards = mesh.normals @ ahead
    depth = places[mesh.quads, 2].mean(axis=1)
    seam_of = {int(e): j.seam for j in joins for e in layout.seams[j.seam].tolist()}
    items = [(float(d), 0, int(q)) for q, d in enumerate(depth.tolist())]
    # a seam lies over the quads on its sides
    items += [(float(depth[mesh.edge_quads[e]].max()) + 1e-6, 1, e) for e in seam_of]
    for _, kind, index in sorted(items):
        if kind:
            page.stroke(_line(drawn[mesh.edges[index]]), look.seams[seam_of[index]], 7e-4)
            continue
        points, patch = drawn[mesh.quads[index]], int(layout.patch_of[index])
        if not shown[index]:
            if towards[index] > 0:
                page.stroke(Curve(points, np.zeros(4)), PALE, 5e-5)
            continue
        shade = 0.8 + 0.2 * abs(float(towards[index])) if towards[index] > 0 else 0.62
        colour = _mixed(look.patches[patch], "#ffffff", 0.0 if patch in strong else 0.45)
        page.fill(points, _mixed(colour, "#000000", 1.0 - shade), _mixed(colour, "#000000", 0.3), 5e-5)
    written: list[np.ndarray] = []
    for patch in sorted(there, key=lambda p: len(layout.patches[p])):  # small ones have the least choice
        quads = layout.patches[patch]
        quads = quads[towards[quads] > 0.2]
        quads = quads[np.argsort(-_goodness(towards[quads], mesh.centroids[quads]))[:LOOKED_AT]]
        seen = quads[_seen(places, mesh.quads, quads, shown)]
        for at in drawn[mesh.quads[seen]].mean(axis=1):
            if all(np.abs((at - other) / [0.0065, 0.004]).max() > 1.0 for other in written):
                written.append(at)
                page.text(panel_name(patch), (float(at[0]), float(at[1]) - 0.0012), 0.0036, INK, middle=True)
                break


def _goodness(towards: np.ndarray, centroids: np.ndarray) -> np.ndarray:
    """How good a place every quad is for its patch's number: facing the viewer, in the middle of the patch."""
    if not len(centroids):
        return towards
    apart = np.linalg.norm(centroids - centroids.mean(axis=0), axis=1)
    return np.minimum(towards, 0.6) - 0.5 * apart / max(float(apart.max()), 1e-12)


def _seen(places: np.ndarray, quads: np.ndarray, which: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """(m,) bool: quads ``which`` (m,) whose middles no quad that is ``shown`` (F,) covers.

    places : (V, 3), to the right, upwards and towards the viewer; quads : (F, 4) vertices
    """
    corners = places[quads[shown]]
    middles = places[quads[which]].mean(axis=1)
    side = np.roll(corners, -1, axis=1) - corners
    to = middles[:, None, None] - corners[None]  # (m, F, 4, 3)
    cross = side[None, ..., 0] * to[..., 1] - side[None, ..., 1] * to[..., 0]
    inside = (cross > 0).all(axis=2) | (cross < 0).all(axis=2)
    nearer = corners[..., 2].mean(axis=1)[None] > middles[:, None, 2] + 1e-9
    return ~(inside & nearer).any(axis=1)


def _best_view(flat: FlatPatches, step: Step) -> np.ndarray:
    """The camera's axes (3, 3) from which most of the step's panel is seen; from where it faces, if that is as good."""
    layout, mesh = flat.layout, flat.layout.mesh
    quads = layout.patches[step.panel]
    some = quads[np.linspace(0, len(quads) - 1, min(len(quads), LOOKED_AT)).astype(int)]
    shown = np.isin(layout.patch_of, step.there)
    facing = mesh.area_vectors[quads].sum(axis=0)
    start = float(np.arctan2(facing[1], facing[0])) if np.hypot(facing[0], facing[1]) > 1e-9 else -0.93
    slope = float(np.clip(facing[2] / max(np.hypot(facing[0], facing[1]), 1e-9), -1.2, 1.2))
    best, best_share = _camera(facing), -1.0
    for tilt in (slope, 0.0, 0.8, -0.7):
        for turn in (0.0, 0.6, -0.6, 1.3, -1.3, 2.2, -2.2, np.pi):
            view = _camera(np.array([np.cos(start + turn), np.sin(start + turn), tilt]))
            facing_us = np.maximum(mesh.normals[some] @ view[2], 0.0)
            share = float((_seen(mesh.vertices @ view.T, mesh.quads, some, shown) * facing_us).mean())
            if share > best_share + 0.05:
                best, best_share = view, share
            if best_share > 0.5:
                return best
    return best


def _camera(facing: np.ndarray) -> np.ndarray:
    """The rows right, up and towards the viewer (3, 3) of a view with ``facing`` (3,) towards the viewer and z upright."""
    level = np.array([facing[0], facing[1], 0.0])
    size, whole = float(np.linalg.norm(level)), float(np.linalg.norm(facing))
    level = level / size if size > 0.15 * max(whole, 1e-12) else np.array([0.6, -0.8, 0.0])
    ahead = level + np.array([0.0, 0.0, np.clip(facing[2] / max(size, 1e-12), -1.2, 1.2) + LIFT])
    ahead /= np.linalg.norm(ahead)
    right = np.cross([0.0, 0.0, 1.0], ahead)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def _panel(page: Page, box: _Box, flat: FlatPatches, step: Step, look: _Look) -> None:
    """The flat panel, its seams of this step in their colours with the numbers of their first and last joints."""
    layout, mesh = flat.layout, flat.layout.mesh
    quads = layout.patches[step.panel]
    points = flat.corners[quads].reshape(-1, 2)
    inner = _Box(box.x + 0.006, box.y + 0.006, box.width - 0.012, box.height - 0.012)
    scale, shift = _fitted(points.min(axis=0), points.max(axis=0), inner)
    loop = flat.points[flat.outlines[step.panel]] * scale + shift
    page.fill(loop, look.patches[step.panel], INK, 2e-4)
    for corners in (flat.corners[quads] * scale + shift).tolist():
        page.stroke(Curve(np.array(corners), np.zeros(4)), _mixed(look.patches[step.panel], "#000000", 0.2), 4e-5)
    page.text(panel_name(step.panel), tuple(_middle(loop) - [0.0, 0.002]), 0.006, INK, middle=True)
    ours = {join.seam for join in step.joins}
    for number, edges in enumerate(layout.seams):
        for place, edge in enumerate(edges.tolist()):
            for quad, side in zip(mesh.edge_quads[edge].tolist(), mesh.edge_sides[edge].tolist(), strict=True):
                if layout.patch_of[quad] != step.panel:
                    continue
                ends = flat.corners[quad][[side, (side + 1) % 4]] * scale + shift
                if number in ours:
                    page.stroke(_line(ends), look.seams[number], 8e-4)
                if number in ours and place in {0, len(edges) - 1}:
                    across = np.array([ends[1, 1] - ends[0, 1], ends[0, 0] - ends[1, 0]])
                    at = ends.mean(axis=0) + 0.003 * across / max(float(np.linalg.norm(across)), 1e-12) - [0.0, 0.0008]
                    page.text(f"{seam_name(number)}{place + 1}", tuple(at), 0.0023, look.seams[number], middle=True)


def _mixed(one: str, two: str, share: float) -> str:
    """A colour between two."""
    a, b = (np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)]) for c in (one, two))
    return "#" + "".join(f"{round(x):02x}" for x in ((1 - share) * a + share * b).tolist())
