"""What is seen of an optimisation: its arms, its plot, what limits it."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.view import colouring, history_plot, optimisation_shape
from flexmaps.engine import colours
from flexmaps.engine.display import arrange, solids
from flexmaps.engine.optimisation import optimise as engine
from flexmaps.engine.optimisation.match_limits import REASON_NAMES
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import flatten
from flexmaps.engine.patches.tracing.trace import make_disks
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh
from support.bowl import EDGE, QUADS, block, spiralled
from support.buttons import press


@pytest.fixture
def piece(add: Any, once: Any) -> Any:
    """A bowl with its spirals, ready to be optimised."""
    return once("bowl", lambda: spiralled(add))


def test_arms_are_drawn_where_they_are() -> None:
    """On flat squares: straight arms are rectangles from the middle of the sides to the centre; wound ones turn."""
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1]]) * EDGE
    quads = np.array([[0, 1, 2, 3], [1, 4, 5, 2]])
    vertices = np.c_[points, np.zeros(6)]
    width, twist = np.array([0.001, 0.002]), np.array([0.0, np.pi / 2])
    look = engine.OptimisationStep(vertices, np.repeat(width[:, None], 4, axis=1), twist, 0.0012, 3)
    shape = optimisation_shape.OptimisationShape(look, quads, SpiralParams(), ((0.0, 0.003), (0.1, 0.0012)))
    for unit in (1.0, 0.001):
        found, triangles = shape.bands(unit)
        pieces = len(found) // (2 * 4 * 2) - 1
        bands = found.reshape(2, 4, pieces + 1, 2, 3) * unit
        assert triangles.shape == (2 * 4 * pieces * 2, 3) and triangles.max() == len(found) - 1
        across = np.linalg.norm(bands[..., 0, :] - bands[..., 1, :], axis=-1)
        assert across == pytest.approx(np.broadcast_to(width[:, None, None], across.shape), rel=1e-4)
        line = bands.mean(axis=3)
        corners = vertices[quads]
        middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
        assert line[:, :, 0, :2] == pytest.approx(middles[..., :2], abs=1e-6)
        assert line[:, :, -1, :2] == pytest.approx(
            np.broadcast_to(corners.mean(axis=1)[:, None, :2], (2, 4, 2)), abs=1e-6
        )
        # half way in, the second one's arms have turned by half of a quarter turn, counter-clockwise
        middle = pieces // 2
        out, now = middles[1] - corners[1].mean(axis=0), line[1, :, middle] - corners[1].mean(axis=0)
        turned = np.arctan2(np.cross(out, now)[:, 2], (out[:, :2] * now[:, :2]).sum(axis=1))
        assert turned == pytest.approx(np.full(4, twist[1] * middle / pieces), abs=1e-4)
        area = 0.5 * np.linalg.norm(
            np.cross(found[triangles[:, 1]] - found[triangles[:, 0]], found[triangles[:, 2]] - found[triangles[:, 0]]),
            axis=1,
        ).reshape(2, -1)
        assert area[0].sum() * unit**2 == pytest.approx(4 * 0.5 * EDGE * width[0], rel=1e-4)
    light = shape.colours.sum(axis=1)
    assert light[1] < light[0]  # the more wound, the darker
    assert "1.2 mm from the target" in shape.legend.title and "step 3" in shape.legend.title


def test_arms_lie_on_warped_quads() -> None:
    """Everywhere as high above the triangles that are drawn as on a flat quad."""
    vertices = np.array([[0, 0, 0.2], [1, 0, -0.15], [1.2, 1, 0.25], [0, 1, -0.2]]) * EDGE
    quads = np.array([[0, 1, 2, 3]])
    look = engine.OptimisationStep(vertices, np.full((1, 4), 0.001), np.array([4.0]), 0.001, 0)
    shape = optimisation_shape.OptimisationShape(look, quads, SpiralParams(), ((0.0, 0.001),))
    triangles = shape.faces_and_lines(1.0)[0].reshape(-1, 3, 3).astype(float)
    corners, normal = shape.corners_and_normals(1.0)
    found = shape.bands(1.0)[0].astype(float)
    heights = []
    for point in found:
        for a, b, c in triangles:  # where the line through the point along the quad's normal meets the triangle
            u, v, height = np.linalg.solve(np.stack([b - a, c - a, normal[0]], axis=1), point - a)
            if min(u, v, 1 - u - v) > -1e-6:
                heights.append(height)
                break
    assert len(heights) > 0.9 * len(found)  # but for the corners of the tips
    lift = optimisation_shape.LIFT * float(np.linalg.norm(corners[0, 1] - corners[0, 0]))
    assert heights == pytest.approx([lift] * len(heights), rel=0.01)


def test_plot_of_the_history() -> None:
    margin = round(0.05 * history_plot.SIZE)

    def height(picture: np.ndarray, share: float) -> int:
        """The row of the highest point of the curve at a share of the way."""
        column = margin + int(share * (history_plot.SIZE - 2 * margin - 8)) + 4
        curve = (picture[:, column, 3] > 0.9) & (picture[:, column, 0] > 0.9)
        return int(np.flatnonzero(curve).max())

    falling = history_plot.draw_pixels([4.0, 3.0, 2.0])
    assert height(falling, 0.0) > height(falling, 0.5) > height(falling, 1.0)
    # in proportion, as the scale begins at zero
    low = margin
    assert (height(falling, 1.0) - low) / (height(falling, 0.0) - low) == pytest.approx(0.5, abs=0.06)
    assert height(history_plot.draw_pixels([1.0, 1e-3]), 1.0) < height(history_plot.draw_pixels([1.0, 1e-3]), 0.5)
    for odd in ([], [1.0], [0.0, 0.0], [1.0, np.nan, 0.5], [2.0] * 1000):
        picture = history_plot.draw_pixels(odd)
        assert picture.shape == (history_plot.SIZE, history_plot.SIZE, 4) and np.isfinite(picture).all()
        assert ((picture >= 0.0) & (picture <= 1.0)).all()
    assert history_plot.icon_number([3.0, 2.0]) == history_plot.icon_number([3.0, 2.0, 1.0])  # one icon, drawn anew


def test_limits_as_colours(piece: Any, attribute: Any) -> None:
    with pytest.raises(RuntimeError, match="press Simulate first"):
        bpy.ops.flexmaps.overlay(kind="REACH")
    for stage in ("simulate", "optimise"):
        press(stage)
        found = block(piece, "reach")
        assert sum(found["spirals"].values()) == QUADS and found["advice"].endswith(".")
        press("overlay", kind="REACH")
        legend = colouring.legend_of(piece, "REACH")
        shown = {name: n for name, n in found["spirals"].items() if n}
        assert sorted(int(text.rpartition(": ")[2]) for _, text in legend.entries) == sorted(shown.values())
        rgb = np.round(attribute(piece, "flexmaps_colour", "color", 4)[::4, :3], 5)
        assert len(np.unique(rgb, axis=0)) == len(shown)
    assert set(colours.LIMITS) == set(REASON_NAMES)
    piece.flexmaps.material.material = "birch"
    with pytest.raises(RuntimeError, match="nothing to show"):
        bpy.ops.flexmaps.overlay(kind="REACH")


def test_many_panels_are_drawn_light() -> None:
    """The upper side of the panels covers what the design's own outline says."""
    quads = shapes.make("dome")
    surface = make_disks(mesh_layout(quads))
    made = uniform_design(flatten(surface, LayoutParams()), SpiralParams(), twist=2.0)
    centres = arrange.arrange_patches(made.flat)
    assert not solids.make_light_solids(made, centres, max_faces=10**6).is_one_sided
    shape = solids.make_light_solids(made, centres, max_faces=20_000)
    assert shape.is_one_sided and len(shape.sizes) <= 20_000
    ends = np.cumsum(shape.sizes)
    area = 0.0
    for end, size in zip(ends, shape.sizes, strict=True):
        x, y = shape.vertices[shape.corners[end - size : end], :2].T
        area += 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(made.area.sum(), rel=0.03)


def mesh_layout(quads: QuadMesh) -> Any:
    from flexmaps.engine.patches.layout import PatchLayout

    return PatchLayout(quads, np.zeros(len(quads.edges), bool))
