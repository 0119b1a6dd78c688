"""Where the flat patches lie beside each other: rows of boxes, the tallest first. For looking at, not for cutting."""

from __future__ import annotations

import numpy as np

from ..engine.flatten import FlatPatches


def rows(sizes: np.ndarray, gap: float, aspect: float = 1.4) -> np.ndarray:
    """(N, 2) metres: the lower left corners of boxes of these sizes (N, 2), set in rows from the top down.

    The whole has its upper left corner at the origin and is about ``aspect`` times as wide as high.
    """
    padded = sizes + gap
    wanted = max(np.sqrt(padded.prod(axis=1).sum() * aspect), padded[:, 0].max())
    corners = np.zeros_like(sizes)
    x = y = height = 0.0
    for i in np.lexsort((np.arange(len(sizes)), -sizes[:, 1].round(9))):
        if x > 0 and x + padded[i, 0] > wanted * 1.001:
            x, y, height = 0.0, y - height, 0.0
        height = max(height, padded[i, 1])
        corners[i] = x, y - sizes[i, 1]
        x += padded[i, 0]
    return corners


def patch_boxes(flat: FlatPatches) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corners (N, 2) each, metres, of the patches in their own frames."""
    count = len(flat.layout.patches)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    patch = np.repeat(flat.layout.patch_of, 4)
    points = flat.corners.reshape(-1, 2)
    np.minimum.at(low, patch, points)
    np.maximum.at(high, patch, points)
    return low, high


def side_by_side(flat: FlatPatches) -> np.ndarray:
    """(N, 2) metres: where the origin of every patch goes, so that no two touch; upper left corner at the origin."""
    low, high = patch_boxes(flat)
    return rows(high - low, gap=flat.layout.mesh.median_edge) - low
