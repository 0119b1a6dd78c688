"""Colours against the values that the author of Oklab publishes."""

import numpy as np
import pytest
from flexmaps.engine import colours

# Ottosson (2020), A perceptual color space for image processing: linear sRGB and its Oklab coordinates L, a, b
PRIMARIES = {
    "white": ((1.0, 1.0, 1.0), (1.0, 0.0, 0.0)),
    "red": ((1.0, 0.0, 0.0), (0.62796, 0.22486, 0.12585)),
    "green": ((0.0, 1.0, 0.0), (0.86644, -0.23389, 0.17950)),
    "blue": ((0.0, 0.0, 1.0), (0.45201, -0.03246, -0.31153)),
}


@pytest.mark.parametrize("name", PRIMARIES)
def test_primaries_come_back_from_oklch(name):
    rgb, (lightness, a, b) = PRIMARIES[name]
    hue = np.arctan2(b, a)
    found = colours.oklch_to_linear(np.array([lightness]), np.array([np.hypot(a, b)]), np.array([hue]))
    assert found[0] == pytest.approx(rgb, abs=2e-3)


@pytest.mark.parametrize(("of", "apart"), [(colours.patch_colours, 0.03), (colours.seam_colours, 0.06)])
def test_many_colours_are_told_apart_and_neighbours_have_other_hues(of, apart):
    """Hues of HSV, an older model of colours than the one that they are made by."""
    import colorsys

    made = of(12)
    assert made.shape == (12, 3) and (made >= 0.0).all() and (made <= 1.0).all()
    away = np.linalg.norm(made[:, None] - made, axis=2) + np.eye(12)
    assert away.min() > apart
    hues = np.array([colorsys.rgb_to_hsv(*rgb)[0] for rgb in made])
    turns = np.abs((np.diff(hues) + 0.5) % 1.0 - 0.5)
    assert turns.min() > 0.2
