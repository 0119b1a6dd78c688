"""Stress in the necks of joints, against beam theory."""

import numpy as np
import pytest
from flexmaps.engine.fabrication.joints import Necks

WIDTH, THICKNESS = 2e-3, 3e-3


def test_a_force_beside_the_neck_bends_it():
    """6 N across, along and normal to the edge, each at a neck 1 mm along the arms and 2 mm beside their centre line."""
    wrench = np.zeros((3, 6))
    wrench[range(3), range(3)] = 6.0
    necks = Necks(np.full(3, WIDTH), np.full(3, 1e-3), np.full(3, 2e-3))
    moments = 6.0 * 2e-3, 6.0 * 1e-3, 6.0 * np.hypot(1e-3, 2e-3)
    moduli = THICKNESS * WIDTH**2 / 6, THICKNESS * WIDTH**2 / 6, WIDTH * THICKNESS**2 / 6
    expected = [6.0 / (WIDTH * THICKNESS) + m / w for m, w in zip(moments, moduli, strict=True)]
    assert necks.stresses(wrench, THICKNESS) == pytest.approx(expected)


def test_it_bounds_the_stress_of_either_sign():
    """The moment about a neck's centre is that about the joint less the lever's cross product with the force."""
    rng = np.random.default_rng(5)
    wrench, place = rng.normal(size=(200, 6)), np.column_stack([rng.normal(size=(200, 2)), np.zeros(200)])
    about_neck = wrench.copy()
    about_neck[:, 3:] -= np.cross(place, wrench[:, :3])
    necks = Necks(np.full(200, WIDTH), *np.abs(place[:, :2].T))
    centred = Necks(np.full(200, WIDTH), np.zeros(200), np.zeros(200))
    assert (necks.stresses(wrench, THICKNESS) >= centred.stresses(about_neck, THICKNESS) * (1.0 - 1e-12)).all()
