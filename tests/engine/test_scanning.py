"""Scans made from surfaces, moved by poses that are known, and laid back over them."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.scanning import compare
from flexmaps.engine.surface import shapes
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation


def scanned(mesh, degrees, seed, count=8000):
    """Points of the surface with noise, without two fifths of it, with a table and outliers, turned; and the true points."""
    random = np.random.default_rng(seed)
    of = random.choice(len(mesh.quads), count, p=mesh.areas / mesh.areas.sum())
    u, v = random.random((2, count, 1))
    p = mesh.vertices[mesh.quads[of]]
    true = (p[:, 0] * (1 - u) + p[:, 1] * u) * (1 - v) + (p[:, 3] * (1 - u) + p[:, 2] * u) * v
    size = np.linalg.norm(np.ptp(true, axis=0))
    side = true @ (direction := random.normal(size=3)) / np.linalg.norm(direction)
    kept = true[side < np.quantile(side, 0.6)]
    noisy = kept + 0.001 * size * random.normal(size=kept.shape)
    outliers = true.mean(axis=0) + size * (random.random((200, 3)) - 0.5)
    axis = random.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    shift = 0.1 * size * random.normal(size=3)
    return np.concatenate([noisy, outliers]) @ turn.T + shift, kept, size


@pytest.mark.parametrize("name", ["vault", "saddle", "three_holes"])
def test_laid_back_over_the_surface(name):
    mesh = getattr(shapes, name)()
    scan, _, size = scanned(mesh, 25, 1)
    found = compare.compare(mesh, scan, scale=1.0, anywhere=False)
    surface = cKDTree(compare._samples(mesh, 100_000)[0])
    off = surface.query(found.points)[0]
    assert np.median(off) < 0.003 * size
    assert found.rms < 0.01 * size and 0.5 < found.covered.mean() <= 1.0


def test_millimetres_are_guessed():
    mesh = shapes.vault()
    scan, _, _ = scanned(mesh, 10, 2)
    found = compare.compare(mesh, 1000 * scan, anywhere=False)
    assert found.scale == 0.001 and "millimetres" in found.remark


def test_what_is_no_scan_is_named(tmp_path):
    mesh = shapes.vault()
    with pytest.raises(FlexMapsError, match="has 0 points"):
        compare.compare(mesh, np.zeros((0, 3)))
    with pytest.raises(FlexMapsError, match="Point 8 "):
        compare.compare(mesh, np.where(np.arange(200)[:, None] == 7, np.nan, np.ones((200, 3))))
    with pytest.raises(FlexMapsError, match="covers only"):
        line = np.linspace(0, 1, 500)[:, None] * [[1.0, 0.0, 0.0]]
        compare.compare(mesh, line, scale=1.0, anywhere=False)
    with pytest.raises(FlexMapsError, match="no scan that can be read"):
        compare.read_points(tmp_path / "scan.xyz")


def test_points_alone_are_read(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    (tmp_path / "scan.ply").write_text(head + "0 0 0\n1 2 3\n")
    np.testing.assert_array_equal(compare.read_points(tmp_path / "scan.ply"), [[0, 0, 0], [1, 2, 3]])
