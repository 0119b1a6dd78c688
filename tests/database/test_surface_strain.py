"""Strains on the surface of solids: uniform fields whose strain is known, and which places count as free of fillets."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.database.design_solid import DesignSolid
from flexmaps.database.surface_strain import free_places, surface_strains
from flexmaps.database.validation_cases import sheet


def test_a_uniform_stretch_strains_every_arm_alike() -> None:
    """Green strain of a stretch by 1 % is 1 % and half of its square, and that of a simple shear is known too."""
    solid = DesignSolid(sheet(2, 1, np.array([1.0, 1.8]), np.array([150.0, 60.0])), 0.3, [0])
    for change, wanted in (
        (np.diag([1.01, 1.0, 1.0]), 0.01 + 0.5 * 0.01**2),
        (np.array([[1.0, 0.0, 0.02], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), 0.5 * 0.02 * (1.0 + 0.5 * 0.02)),
    ):
        free, fillet = surface_strains(solid, solid.mesh.nodes @ change.T)
        assert free == pytest.approx(np.full((2, 4), wanted), rel=2e-3)
        assert fillet == pytest.approx(free, rel=1e-9)


def test_places_at_the_root_are_not_free() -> None:
    design = sheet(2, 1, 1.5, 150.0)
    centre = np.zeros((2, 4, 1, 1, 2))
    assert not free_places(design, np.arange(2), centre).any()
    # tips, seen from the centres
    angle, radius = design.arms.angle, design.arms.radius * 1e3
    tips = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)[:, :, None, None]
    assert free_places(design, np.arange(2), tips).all()
