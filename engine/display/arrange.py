"""Where the flat patches lie beside each other: rows of boxes, the tallest first. For looking at, not for cutting."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..patches.flattening.flatten import FlatPatches


def rows(sizes: np.ndarray, gap: float, aspect: float = 1.6) -> np.ndarray:
    """(N, 2) metres: the lower left corners of boxes of these sizes (N, 2), set in rows from the top down.

    The whole has its upper left corner at the origin; of several widths, the one that fills a page of this aspect best.
    """
    padded = sizes + gap
    ideal = np.sqrt(padded.prod(axis=1).sum() * aspect)
    widths = np.maximum(np.array([0.8, 0.9, 1.0, 1.1, 1.2, 1.35, 1.5, 1.8, 2.2]) * ideal, padded[:, 0].max())
    tried = [_rows(sizes, gap, width) for width in widths]

    def page(corners: np.ndarray) -> float:
        width, height = (corners + sizes)[:, 0].max(), -corners[:, 1].min()
        return max(width / aspect, height)

    return min(tried, key=page)


def _rows(sizes: np.ndarray, gap: float, width: float) -> np.ndarray:
    """Rows no wider than ``width``, each centred under the widest."""
    lines: list[list[int]] = [[]]
    x = 0.0
    for i in np.lexsort((np.arange(len(sizes)), -sizes[:, 1].round(5))).tolist():
        if lines[-1] and x + sizes[i, 0] > width * 1.001:
            lines.append([])
            x = 0.0
        lines[-1].append(i)
        x += sizes[i, 0] + gap
    lengths = [sizes[line, 0].sum() + gap * (len(line) - 1) for line in lines]
    corners = np.zeros_like(sizes)
    y = 0.0
    for line, length in zip(lines, lengths):
        x = 0.5 * (max(lengths) - length)
        height = sizes[line, 1].max()
        for i in line:
            corners[i] = x, y - 0.5 * (height + sizes[i, 1])
            x += sizes[i, 0] + gap
        y -= height + gap
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


def side_by_side(flat: FlatPatches, width: float | None = None) -> np.ndarray:
    """(N, 2) metres: where the origin of every patch goes, so that no two touch; upper left corner at the origin.

    ``width`` is about how wide the whole is to be, metres; if not given it fills a page.
    """
    (low, high), gap = patch_boxes(flat), flat.layout.mesh.median_edge
    if width is None:
        return rows(high - low, gap) - low
    area = float((high - low + gap).prod(axis=1).sum())
    return rows(high - low, gap, aspect=width**2 / area) - low
