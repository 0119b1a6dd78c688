"""Flat patches beside each other: apart from each other, on a page, with xatlas and without."""

import importlib.util

import numpy as np
import pytest
import shapely
from flexmaps.engine.display import arrange
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.spirals import fabricable

EDGE = 0.02


@pytest.fixture
def angle_iron(flat_grid):
    """An L of twelve quads a side, and four rectangles that were cut from its bay; one of them fits back into it."""
    return flat_grid(12, 12, EDGE, cut=lambda x, y: (x in (4, 10) and y > 4) or (y in (4, 10) and x > 4))


def _placed(flat, shift):
    corners = flat.corners + shift[flat.layout.patch_of][:, None]
    patches = [shapely.union_all([shapely.Polygon(c) for c in corners[quads]]) for quads in flat.layout.patches]
    points = corners.reshape(-1, 2)
    assert [points[:, 0].min(), points[:, 1].max()] == pytest.approx([0.0, 0.0], abs=1e-6)
    return patches, np.ptp(points, axis=0)


@pytest.mark.parametrize("width", [None, 0.3, 0.8])
def test_no_two_patches_touch(angle_iron, width):
    patches, _ = _placed(angle_iron, arrange.arrange_patches(angle_iron, width))
    assert len(patches) == 5
    apart = [one.distance(other) for k, one in enumerate(patches) for other in patches[:k]]
    assert min(apart) > 0.6 * EDGE


def test_the_bay_of_a_patch_is_used_where_xatlas_is_installed(angle_iron, monkeypatch):
    patches, page = _placed(angle_iron, arrange.arrange_patches(angle_iron))
    large = max(patches, key=lambda patch: patch.area)
    assert any(large.envelope.contains(other) for other in patches if other is not large)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    in_rows, other_page = _placed(angle_iron, arrange.arrange_patches(angle_iron))
    assert min(one.distance(other) for k, one in enumerate(in_rows) for other in in_rows[:k]) > 0.99 * EDGE
    assert page.prod() < 0.9 * other_page.prod()


def test_panels_lie_on_the_table_in_front_of_the_middle_of_the_piece(flat_grid):
    """A flat piece away from the origin of its patches: its arms end in the middles of the quads' sides, so at its border."""
    flat = flat_grid(6, 3, EDGE, cut=lambda x, y: x in (2, 4))
    made, away, count = fabricable.uniform_design(flat, SpiralParams()), np.array([0.3, -0.7, 0.05]), 18
    pose = Pose(np.c_[made.arms.centre, np.zeros(count)] + away, np.broadcast_to(np.eye(3), (count, 3, 3)).copy())
    placed = arrange.places_before_assembly(made, pose)
    corners = flat.corners + placed[flat.layout.patch_of][:, None, :2]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    assert high[1] == pytest.approx(away[1] - 2.0 * EDGE)
    assert 0.5 * (low + high)[0] == pytest.approx(away[0] + 3.0 * EDGE)
    assert placed[:, 2] == pytest.approx(away[2])
