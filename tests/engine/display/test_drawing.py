"""Drawings: colours and figures by hand."""

from __future__ import annotations

import numpy as np
from flexmaps.engine.display.drawing import rgb


def test_a_colour_is_three_pairs_of_digits() -> None:
    np.testing.assert_allclose(rgb("#ff8001"), [1.0, 128.0 / 255.0, 1.0 / 255.0])
