"""Room for letters on arms, against lengths by shapely."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from flexmaps.engine.fabrication.panels import labels
from flexmaps.engine.fabrication.panels.lettering import text_length
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.progress import SILENT
from flexmaps.engine.spirals import fabricable, roots
from flexmaps.engine.spirals.curves.spiral import centre_line, width_at


@pytest.mark.parametrize("blend", [0.05, 0.3])
def test_letters_fit_between_joint_and_hub_and_across_the_narrowest_place(flat_grid: Any, blend: float) -> None:
    design = fabricable.uniform_design(flat_grid(2, 2, 0.03), SpiralParams(blend=blend))
    hubs, taken = roots.find_roots(design.arms, design.params.fillet), np.full((4, 4), 0.002)
    places = labels._LabelPlaces(design.arms, hubs, taken, SILENT)
    end = np.minimum(hubs.left, np.roll(hubs.right, 1, axis=1))
    t = end[..., None] * np.linspace(0.0, 1.0, 4000)
    length = shapely.length(shapely.linestrings(centre_line(design.arms, t)[0]))
    width = width_at(design.arms, t)[0]
    np.testing.assert_allclose(places.length, length, rtol=2e-3)
    for quad, side in np.ndindex(4, 4):
        room = 0.9 * (length[quad, side] - 0.002 - 0.4 * width[quad, side, 0])
        long = places.height_on_arm(quad, side, 40 * "A", 1.0)
        assert long * text_length(40 * "A") == pytest.approx(room, rel=5e-3)
        short = places.height_on_arm(quad, side, "I", 1.0)
        assert short == pytest.approx(labels.FILL_SHARE * width[quad, side].min(), rel=5e-3)
        assert places.height_on_arm(quad, side, "I", 1e-4) == 1e-4
