"""Drawings: colours, legends and dashes by hand."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.display.drawing import FilledShapes, Line, colour_bar, colour_by_scale, parse_colour
from flexmaps.engine.display.raster import _dashes

GREYS = np.array([[0.0] * 3, [1.0] * 3])


def test_a_colour_is_three_pairs_of_digits() -> None:
    np.testing.assert_allclose(parse_colour("#ff8001"), [1.0, 128.0 / 255.0, 1.0 / 255.0])


def test_a_scale_runs_from_its_lower_to_its_upper_end() -> None:
    shades = colour_by_scale(np.array([0.0, 2.0, 3.0, 4.0, 9.0]), 2.0, 4.0, GREYS)[:, 0]
    np.testing.assert_allclose(shades, [0.0, 0.0, 0.5, 1.0, 1.0], atol=0.01)


def test_a_legend_fills_its_place_with_the_upper_end_above() -> None:
    bar = next(
        item for item in colour_bar((10.0, 20.0), (8.0, 100.0), GREYS, 0.0, 1.0, "mm") if isinstance(item, FilledShapes)
    )
    points = np.array(bar.points)
    assert points.min(axis=(0, 1)).tolist() == [10.0, 20.0] and points.max(axis=(0, 1)).tolist() == [18.0, 120.0]
    top, bottom = bar.fills[np.argsort(points[:, :, 1].mean(axis=1))[[0, -1]], 0]
    assert top > 0.9 and bottom < 0.1


@pytest.mark.parametrize("dash", [1.0, 2.5, 4.0])
def test_dashes_are_about_as_long_as_their_gaps_and_as_wanted(dash: float) -> None:
    corners = np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 80.0]])
    lengths = [float(np.linalg.norm(b - a)) for a, b in _dashes(Line(corners, dash=dash))]
    assert sum(lengths) == pytest.approx(70.0) and lengths == pytest.approx([dash] * len(lengths), rel=0.1)
