"""Colours on a surface are nearer to the eye than the surface, with the rounding of a graphics card."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.display.depth_offset import pull_forward

DEPTH_STEPS = 2**24  # of a depth buffer


def _times(*factors: np.ndarray) -> np.ndarray:
    """Return a product of matrices, the last first, every sum rounded as on a graphics card."""
    result = factors[-1].astype(np.float32)
    for factor in factors[-2::-1]:
        product = np.zeros((4, result.shape[1]), np.float32)
        for k in range(4):
            product += factor.astype(np.float32)[:, k : k + 1] * result[k : k + 1]
        result = product
    return result


def _depth(clip: np.ndarray) -> np.ndarray:
    """Return the depths of points in clip space, in steps of the depth buffer."""
    ndc = (clip[2] / clip[3]).astype(np.float32)
    return np.asarray((0.5 * ndc + np.float32(0.5)).astype(float) * DEPTH_STEPS)


def _projection(perspective: bool, near: float, far: float) -> np.ndarray:
    projection = np.diag([1.4, 1.7, 0.0, 0.0])
    if perspective:
        projection[2:, 2:] = [[-(far + near) / (far - near), -2.0 * far * near / (far - near)], [-1.0, 0.0]]
    else:  # Blender looks from -far to far
        projection[2:, 2:] = [[-1.0 / far, 0.0], [0.0, 1.0]]
    return projection


@pytest.mark.parametrize("perspective", [True, False], ids=["perspective", "orthographic"])
@pytest.mark.parametrize(
    ("size", "near", "far"), [(0.25, 0.01, 1e3), (250.0, 0.01, 1e3), (250.0, 1.0, 1e5), (9.8, 0.01, 1e3)]
)
def test_colours_are_in_front_of_their_surface(perspective: bool, size: float, near: float, far: float) -> None:
    generator = np.random.default_rng(3)
    turned = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    points = np.ones((4, 4000))
    points[:3] = generator.uniform(-0.5, 0.5, (3, 4000))
    model, view = np.diag([size, size, size, 1.0]), np.eye(4)
    model[:3, 3] = size * generator.normal(size=3)
    view[:3, :3], view[:3, 3] = turned, -turned @ model[:3, 3] - [0.0, 0.0, 2.0 * size]
    projection = _projection(perspective, near, far)
    surface = _depth(_times(projection, _times(view, _times(model, points))))  # as Blender draws a mesh

    def depth_of_colours(matrix: np.ndarray) -> np.ndarray:
        return _depth(_times(_times(matrix, view, model), points))

    assert depth_of_colours(pull_forward(projection)).max() < 2**24
    assert (depth_of_colours(pull_forward(projection)) < surface).all()
    assert (depth_of_colours(pull_forward(projection)) > surface - 8).all(), "what lies behind would be seen"
    lines = depth_of_colours(pull_forward(projection, 2.0))
    assert (lines < depth_of_colours(pull_forward(projection))).all()


def test_a_projection_moves_nothing_sideways() -> None:
    projection = _projection(True, 0.01, 1e3)
    assert (pull_forward(projection)[[0, 1, 3]] == projection[[0, 1, 3]]).all()
