"""Pictures of a step in the assembly sheet: the panels joined so far, and the flat new panel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...arrays import Bool, Float, Int
from ...fabrication.panels.labels import panel_name, seam_name
from ...fabrication.writers.pdf import Page
from ...patches.flattening.flatten import FlatPatches
from ...patches.joining import AssemblyStep, SeamJoin, panel_numbers
from ...spirals.curves.arcs import Curve

WIDTH, HEIGHT, MARGIN = 0.21, 0.297, 0.015  # width, height and margin of a page (A4), metres
INK, PALE, GREY = "#1c1e24", "#e4e6e9", "#7a7f87"
CAMERA_SLOPE = 0.35  # tangent of the angle by which the camera looks down; larger: more from above
MAX_TESTED_QUADS = 24  # number of quads per panel that are tested for visibility; larger: better views, slower
NUMBER_SIZE = (0.0065, 0.004)  # width and height that a panel's number needs on paper, metres


@dataclass(frozen=True)
class PatchColours:
    """Colours of patches and seams, "#rrggbb"."""

    patches: list[str]
    seams: list[str]


@dataclass(frozen=True)
class PageBox:
    """A rectangle on a page: lower left corner, width and height, metres."""

    x: float
    y: float
    width: float
    height: float


def inner_point(points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, " 2"]:
    """Return a point inside a polygon, well away from its outline."""
    import shapely

    place = shapely.Polygon(points).buffer(0.0).representative_point()
    return np.array([place.x, place.y])


def polyline(points: list[list[float]] | np.ndarray) -> Curve:
    """Return the open polyline through points (n, 2)."""
    points = np.asarray(points, dtype=float)
    return Curve(points, np.zeros(len(points)), closed=False)


def fit_box(low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"], box: PageBox) -> tuple[float, np.ndarray]:
    """Return scale and shift that fit a rectangle into a box, centred.

    Parameters
    ----------
    low, high : lower left and upper right corner of the rectangle
    box : where it should lie
    """
    size = np.maximum(high - low, 1e-9)
    scale = float(min(box.width / size[0], box.height / size[1]))
    return scale, np.array([box.x + 0.5 * box.width, box.y + 0.5 * box.height]) - 0.5 * scale * (low + high)


def draw_surface(
    page: Page,
    box: PageBox,
    flat: FlatPatches,
    there: tuple[int, ...],
    strong: tuple[int, ...],
    joins: tuple[SeamJoin, ...],
    look: PatchColours,
    view: Float[np.ndarray, "3 3"],
) -> None:
    """Draw the target surface: the panels joined so far in colour, panels that are still missing in pale lines.

    Parameters
    ----------
    page, box : where to draw
    flat : mesh and layout
    there : patches joined so far
    strong : patches in full colour; other patches of ``there`` are lighter
    joins : seams to highlight
    look : colours
    view : axes of the camera, see ``camera_axes``
    """
    layout, mesh = flat.layout, flat.layout.mesh
    ahead, places = view[2], mesh.vertices @ view.T
    scale, shift = fit_box(places[:, :2].min(axis=0), places[:, :2].max(axis=0), box)
    drawn = places[:, :2] * scale + shift
    shown = np.isin(layout.patch_of, there)
    towards = mesh.normals @ ahead
    depth = places[mesh.quads, 2].mean(axis=1)
    seam_of = {int(e): j.seam for j in joins for e in layout.seams[j.seam].tolist()}
    items = [(float(d), 0, int(q)) for q, d in enumerate(depth.tolist())]
    # draw a seam after the quads on both sides
    items += [(float(depth[mesh.edge_quads[e]].max()) + 1e-6, 1, e) for e in seam_of]
    for _, kind, index in sorted(items):
        if kind:
            page.draw_curve(polyline(drawn[mesh.edges[index]]), look.seams[seam_of[index]], 7e-4)
            continue
        points, patch = drawn[mesh.quads[index]], int(layout.patch_of[index])
        if not shown[index]:
            if towards[index] > 0:
                page.draw_curve(Curve(points, np.zeros(4)), PALE, 5e-5)
            continue
        shade = 0.8 + 0.2 * abs(float(towards[index])) if towards[index] > 0 else 0.62
        colour = mix_colours(look.patches[patch], "#ffffff", 0.0 if patch in strong else 0.45)
        page.fill_polygon(
            points, mix_colours(colour, "#000000", round(1.0 - shade, 2)), mix_colours(colour, "#000000", 0.3), 5e-5
        )
    _draw_panel_numbers(page, flat, there, places, drawn, towards)


def _draw_panel_numbers(
    page: Page, flat: FlatPatches, there: tuple[int, ...], places: np.ndarray, drawn: np.ndarray, towards: np.ndarray
) -> None:
    """Write the numbers of the panels joined so far, where they are visible and do not overlap.

    places : vertices in the axes of the camera; drawn : vertices on paper; towards : cosine of quad normal and view
    """
    layout, mesh, numbers = flat.layout, flat.layout.mesh, panel_numbers(flat.layout)
    candidates = []
    for patch in sorted(there, key=lambda p: len(layout.patches[p])):  # small panels have few places for a number
        quads = layout.patches[patch]
        quads = quads[towards[quads] > 0.2]
        candidates.append(
            (patch, quads[np.argsort(-_suitability(towards[quads], mesh.centroids[quads]))[:MAX_TESTED_QUADS]])
        )
    every = np.concatenate([quads for _, quads in candidates])
    open_ = np.zeros(len(mesh.quads), dtype=bool)
    open_[every[are_visible(places, mesh.quads, every, np.isin(layout.patch_of, there))]] = True
    middles = drawn[mesh.quads].mean(axis=1)
    # positions of the numbers written so far, by the cell of a grid whose cells are as large as a number
    written: dict[tuple[int, int], tuple[float, float]] = {}
    for patch, quads in candidates:
        for x, y in middles[quads[open_[quads]]].tolist():
            box = int(x // NUMBER_SIZE[0]), int(y // NUMBER_SIZE[1])
            neighbours = (written.get((box[0] + i, box[1] + j)) for i in (-1, 0, 1) for j in (-1, 0, 1))
            if not any(p and abs(x - p[0]) <= NUMBER_SIZE[0] and abs(y - p[1]) <= NUMBER_SIZE[1] for p in neighbours):
                written[box] = x, y
                page.draw_text(panel_name(numbers[patch]), (x, y - 0.0012), 0.0036, INK, is_centred=True)
                break


def _suitability(towards: np.ndarray, centroids: np.ndarray) -> np.ndarray:
    """Return how suitable each quad is to bear its patch's number: best if it faces the viewer and is central."""
    if not len(centroids):
        return towards
    apart = np.linalg.norm(centroids - centroids.mean(axis=0), axis=1)
    return np.minimum(towards, 0.6) - 0.5 * apart / max(float(apart.max()), 1e-12)


def are_visible(
    places: Float[np.ndarray, "vertices 3"], quads: Int[np.ndarray, "quads 4"],
    which: Int[np.ndarray, " m"], shown: Bool[np.ndarray, " quads"],
) -> Bool[np.ndarray, " m"]:  # fmt: skip
    """Return whether the middle of each quad is visible.

    Parameters
    ----------
    places : vertices in the axes of the camera: right, up, towards the viewer
    quads : vertex indices of all quads
    which : indices of the quads to test
    shown : whether each quad can hide others
    """
    import shapely

    corners, middles = places[quads[shown]], places[quads[which]].mean(axis=1)
    if not len(corners) or not len(middles):
        return np.ones(len(middles), dtype=bool)
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    tree = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    point, quad = tree.query(shapely.points(middles[:, :2]))
    side, to = np.roll(corners, -1, axis=1) - corners, middles[point, None] - corners[quad]
    cross = side[quad, :, 0] * to[..., 1] - side[quad, :, 1] * to[..., 0]
    inside = (cross > 0).all(axis=1) | (cross < 0).all(axis=1)
    nearer = corners[quad, :, 2].mean(axis=1) > middles[point, 2] + 1e-9
    return np.bincount(point, weights=inside & nearer, minlength=len(middles)) == 0.0


def best_view(flat: FlatPatches, step: AssemblyStep) -> Float[np.ndarray, "3 3"]:
    """Return the camera's axes for the view that shows most of a step's panel.

    Views are tried from the panel's front outwards, until one shows half of the panel. A view replaces an earlier one
    only if it shows 5 % of the panel more.

    Parameters
    ----------
    flat : mesh and layout
    step : step of the assembly, which adds the panel
    """
    layout, mesh = flat.layout, flat.layout.mesh
    quads = layout.patches[step.panel]
    some = quads[np.linspace(0, len(quads) - 1, min(len(quads), MAX_TESTED_QUADS)).astype(int)]
    shown = np.isin(layout.patch_of, step.joined_panels)
    facing = mesh.area_vectors[quads].sum(axis=0)
    start = float(np.arctan2(facing[1], facing[0])) if np.hypot(facing[0], facing[1]) > 1e-9 else -0.93
    slope = float(np.clip(facing[2] / max(np.hypot(facing[0], facing[1]), 1e-9), -1.2, 1.2))
    best, best_share = camera_axes(facing), -1.0
    for tilt in (slope, 0.0, 0.8, -0.7):
        for turn in (0.0, 0.6, -0.6, 1.3, -1.3, 2.2, -2.2, np.pi):
            view = camera_axes(np.array([np.cos(start + turn), np.sin(start + turn), tilt]))
            facing_us = np.maximum(mesh.normals[some] @ view[2], 0.0)
            share = float((are_visible(mesh.vertices @ view.T, mesh.quads, some, shown) * facing_us).mean())
            if share > best_share + 0.05:
                best, best_share = view, share
            if best_share > 0.5:
                return best
    return best


def camera_axes(facing: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return the axes of a camera, rows right, up and towards the viewer, that looks slightly down at a surface.

    facing : direction from the surface towards the viewer, before the view is tilted down
    """
    level = np.array([facing[0], facing[1], 0.0])
    size, whole = float(np.linalg.norm(level)), float(np.linalg.norm(facing))
    level = level / size if size > 0.15 * max(whole, 1e-12) else np.array([0.6, -0.8, 0.0])
    ahead = level + np.array([0.0, 0.0, np.clip(facing[2] / max(size, 1e-12), -1.2, 1.2) + CAMERA_SLOPE])
    ahead /= np.linalg.norm(ahead)
    right = np.cross([0.0, 0.0, 1.0], ahead)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def draw_flat_panel(page: Page, box: PageBox, flat: FlatPatches, step: AssemblyStep, look: PatchColours) -> None:
    """Draw the flat panel that a step adds, the seams to join in their colours, and the names of each seam's first and
    last joint.

    Parameters
    ----------
    page, box : where to draw
    flat : flat patches
    step : the step
    look : colours
    """
    layout, mesh = flat.layout, flat.layout.mesh
    quads = layout.patches[step.panel]
    corners = flat.points[layout.flat_corners[quads]]
    points = corners.reshape(-1, 2)
    inner = PageBox(box.x + 0.006, box.y + 0.006, box.width - 0.012, box.height - 0.012)
    scale, shift = fit_box(points.min(axis=0), points.max(axis=0), inner)
    loop = flat.points[flat.outlines[step.panel]] * scale + shift
    page.fill_polygon(loop, look.patches[step.panel], INK, 2e-4)
    for corner in corners * scale + shift:
        page.draw_curve(Curve(corner, np.zeros(4)), mix_colours(look.patches[step.panel], "#000000", 0.2), 4e-5)
    page.draw_text(
        panel_name(panel_numbers(layout)[step.panel]),
        tuple(inner_point(loop) - [0.0, 0.002]),
        0.006,
        INK,
        is_centred=True,
    )
    for number, edges in ((join.seam, layout.seams[join.seam]) for join in step.joins):
        for place, edge in enumerate(edges.tolist()):
            for quad, side in zip(mesh.edge_quads[edge].tolist(), mesh.edge_sides[edge].tolist(), strict=True):
                if layout.patch_of[quad] != step.panel:
                    continue
                ends = flat.points[layout.flat_corners[quad, [side, (side + 1) % 4]]] * scale + shift
                page.draw_curve(polyline(ends), look.seams[number], 8e-4)
                if place in {0, len(edges) - 1}:
                    across = np.array([ends[1, 1] - ends[0, 1], ends[0, 0] - ends[1, 0]])
                    at = ends.mean(axis=0) + 0.003 * across / max(float(np.linalg.norm(across)), 1e-12) - [0.0, 0.0008]
                    page.draw_text(
                        f"{seam_name(number)}{place + 1}", tuple(at), 0.0023, look.seams[number], is_centred=True
                    )


@lru_cache(maxsize=4096)
def mix_colours(one: str, two: str, share: float) -> str:
    """Interpolate two colours "#rrggbb"; ``share`` is the share of ``two``, 0 to 1."""
    a, b = (np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)]) for c in (one, two))
    return "#" + "".join(f"{round(x):02x}" for x in ((1 - share) * a + share * b).tolist())
