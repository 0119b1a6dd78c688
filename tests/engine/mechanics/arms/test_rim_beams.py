"""Strips of a rim with holes: their compliance in other units of length."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.rim_beams import _beams
from flexmaps.engine.mechanics.rim_bodies import RimBeams

PIECES = 200


def compliance(scale: float) -> np.ndarray:
    """(6, 6) of a strip of 20 by 6 by 2 with a hole of 2.5 in its middle, in units of ``scale`` metres."""
    length, width, height, hole = scale * np.array([20.0, 6.0, 2.0, 2.5])
    at = length * (np.arange(PIECES) + 0.5) / PIECES
    bore = 2.0 * np.sqrt(np.maximum(0.25 * hole**2 - (at - 0.5 * length) ** 2, 0.0))
    line = RimBeams.from_points(
        at[None] + 0j, np.ones((1, PIECES), complex), np.array([length + 0j]), np.full((1, PIECES), length / PIECES),
        np.full(1, width), bore[None],
    )  # fmt: skip
    sheet: Any = SimpleNamespace(grain=0.0, thickness=height, rim=SimpleNamespace(width=width - hole))
    return _beams(sheet, line, MATERIALS["pom"])[0]


def test_a_strip_with_a_hole_is_as_soft_as_its_image_of_another_size() -> None:
    """Shifts per force go with 1 / length, turns per force with 1 / length^2, turns per moment with 1 / length^3."""
    powers = np.repeat([0.5, 1.5], 3)
    large = compliance(1e-2) * 10.0 ** np.add.outer(powers, powers)
    np.testing.assert_allclose(large, compliance(1e-3), rtol=1e-9, atol=1e-9 * np.abs(large).max())
