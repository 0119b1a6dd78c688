"""What is compared with the strains of solids."""

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.database.validation_cases import sheet
from flexmaps.database.validation_strain import kink_sharpness
from flexmaps.engine.mechanics.assembly import assembly_from_design
from flexmaps.engine.spirals.curves.spiral import centre_line


def test_kinks_are_what_blends_turn_arms_by():
    """Against the tangents of the curves that are cut, with their blends and without them."""
    odd = (np.arange(16) + np.arange(16) // 4) % 2 == 1
    design = sheet(4, 4, 1.5, np.where(odd, 30.0, 200.0))
    arms, known = design.arms, assembly_from_design(design)
    at_joint = np.zeros((*arms.radius.shape, 1))
    blended, pure = (centre_line(one, at_joint)[1][..., 0, :] for one in (arms, arms.without_blends(arms.wind)))
    turned = np.linalg.norm(blended - pure, axis=-1)[known.pairs, known.sides]
    expected = (turned / known.radius).max(axis=1) * design.params.thickness / 0.0015
    assert kink_sharpness(known) == pytest.approx(expected, rel=1e-6) and expected.max() > 0.1
    assert not kink_sharpness(replace(known, cut=None)).any()
