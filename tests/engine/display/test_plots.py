"""Plots: what can be said of them without looking."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.display.drawing import FilledShapes, Text
from flexmaps.engine.display.plots import Colouring, draw_shape_map, plot_histogram
from flexmaps.engine.surface import shapes


def test_both_sides_of_a_surface_are_lit_alike() -> None:
    mesh = shapes.make("saddle")
    grey = Colouring("", np.full((len(mesh.quads), 3), 0.5))
    plain = np.zeros((len(mesh.quads), 4), dtype=bool)
    front, back = (
        [
            item.fills
            for item in draw_shape_map(mesh.vertices, quads, plain, grey).items
            if isinstance(item, FilledShapes)
        ]
        for quads in (mesh.quads, mesh.quads[:, ::-1])
    )
    np.testing.assert_allclose(np.concatenate(front), np.concatenate(back), atol=1e-12)
    assert np.ptp(np.concatenate(front)) > 0.01  # slopes differ


def test_the_bars_of_a_histogram_are_as_high_as_their_counts() -> None:
    drawing = plot_histogram(np.array([0.1, 0.9, 0.1, 0.5, 0.1]), "Strain", "percent")
    (bars,) = (item.points for item in drawing.items if isinstance(item, FilledShapes))
    heights = np.ptp(bars[..., 1], axis=1)
    assert heights / heights.min() == pytest.approx([3.0, 1.0, 1.0])  # 0.1 thrice, then 0.5 and 0.9
    first, second = np.diff(bars[..., 0].mean(axis=1))
    assert first == pytest.approx(second, rel=0.1)  # a bar stands within a bin's width of its value


def test_the_name_of_the_upright_axis_reads_along_it() -> None:
    drawing = plot_histogram(np.array([0.1, 0.9]), "Strain", "percent")
    turned = {item.text for item in drawing.items if isinstance(item, Text) and item.is_vertical}
    assert turned == {"Spirals"}
