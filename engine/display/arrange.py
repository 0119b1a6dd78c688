"""Arrange the flat patches side by side for display, not for cutting: in rows, or packed by xatlas."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Float

if TYPE_CHECKING:
    from ..mechanics.assembly import Pose
    from ..patches.flattening.flatten import FlatPatches
    from ..spirals.design import SpiralDesign

TABLE = 1.3  # width of the rows of panels on a table, as a factor on the piece's width; by eye
ASPECT = 1.6  # width over height of the page to fill, as of a screen
# widths of rows tried, as factors on the width of a page that the boxes fill; finer steps were not measured
WIDTHS = (0.8, 0.9, 1.0, 1.1, 1.2, 1.35, 1.5, 1.8, 2.2)
# Pixels of xatlas in the gap between two patches, half of them round each; with 4 the pages of 9 and 23 patches are 3 %
# smaller and 9 % larger.
PIXELS = 8
# largest number of patches that xatlas packs: 23 take 0.14 s, and it cannot be stopped; more are as well seen in rows
MOST = 100


def side_by_side(flat: FlatPatches, width: float | None = None) -> Float[np.ndarray, "patches 2"]:
    """Return the positions of the patches' origins, metres, about an edge apart; the upper left corner of all is the origin.

    Of rows of boxes and, if installed, xatlas's packing of the true shapes, the smaller page is taken.

    Parameters
    ----------
    flat : flat patches
    width : approximate total width, metres; by default that of a page
    """
    (low, high), gap = patch_boxes(flat), flat.layout.mesh.median_edge
    sizes = high - low
    aspect = ASPECT if width is None else width**2 / float((sizes + gap).prod(axis=1).sum())
    tried = [rows(sizes, gap, aspect)]
    if 1 < len(sizes) <= MOST and importlib.util.find_spec("xatlas") is not None:
        tried.append(_pack(flat, low, gap, aspect))
    return min(tried, key=lambda corners: _page(corners, sizes, aspect)) - low


def patch_boxes(flat: FlatPatches) -> tuple[Float[np.ndarray, "patches 2"], Float[np.ndarray, "patches 2"]]:
    """Lower and upper corners of the patches in their own frames, metres."""
    count = len(flat.layout.patches)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    patch = np.repeat(flat.layout.patch_of, 4)
    points = flat.corners.reshape(-1, 2)
    np.minimum.at(low, patch, points)
    np.maximum.at(high, patch, points)
    return low, high


def on_table(design: SpiralDesign, pose: Pose) -> Float[np.ndarray, "patches 3"]:
    """Return the positions of the patches' origins before assembly, metres: in rows in front of the piece, on its ground.

    Parameters
    ----------
    design : spirals
    pose : of the piece
    """
    flat = design.flat
    spokes = 0.5 * (flat.corners + np.roll(flat.corners, -1, axis=1)) - design.arms.centre[:, None]
    tips = pose.centres[:, None] + spokes @ np.swapaxes(pose.rotations[:, :, :2], 1, 2)
    low, high = tips.min(axis=(0, 1)), tips.max(axis=(0, 1))
    places = side_by_side(flat, TABLE * float(np.linalg.norm((high - low)[:2])))
    (corner, top), gap = patch_boxes(flat), 2.0 * flat.layout.mesh.median_edge
    corner, top = (corner + places).min(axis=0), (top + places).max(axis=0)
    shift = np.array([0.5 * (low + high)[0] - 0.5 * (corner + top)[0], low[1] - gap - top[1]])
    return np.c_[places + shift, np.full(len(places), low[2])]


def rows(sizes: Float[np.ndarray, "boxes 2"], gap: float, aspect: float = ASPECT) -> Float[np.ndarray, "boxes 2"]:
    """Return the lower left corners of boxes, metres, in rows from the top down, the tallest first.

    The upper left corner of all is the origin; of several widths, the best for a page of this aspect is taken.

    Parameters
    ----------
    sizes : of the boxes, metres
    gap : between boxes, metres
    aspect : width over height of the page
    """
    padded = sizes + gap
    ideal = np.sqrt(padded.prod(axis=1).sum() * aspect)
    widths = np.maximum(np.array(WIDTHS) * ideal, padded[:, 0].max())
    return min((_rows(sizes, gap, width) for width in widths), key=lambda corners: _page(corners, sizes, aspect))


def _page(corners: Float[np.ndarray, "boxes 2"], sizes: Float[np.ndarray, "boxes 2"], aspect: float) -> float:
    """Height of the page of this aspect that holds boxes at these lower left corners."""
    width, height = (corners + sizes)[:, 0].max(), -corners[:, 1].min()
    return float(max(width / aspect, height))


def _rows(sizes: Float[np.ndarray, "boxes 2"], gap: float, width: float) -> Float[np.ndarray, "boxes 2"]:
    """Set boxes in rows no wider than ``width``, each centred under the widest."""
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


# Keep the last atlas alive: its destructor waits for worker threads, for ever if they have not started yet. By the time
# the next one replaces it they have.
_LAST: list[object] = []


def _pack(
    flat: FlatPatches, low: Float[np.ndarray, "patches 2"], gap: float, aspect: float
) -> Float[np.ndarray, "patches 2"]:
    """Return the lower left corners of the patches' boxes, metres, as xatlas packs the true shapes without rotation."""
    import xatlas

    # xatlas fills squares, so the patches are scaled to make a square a page of this aspect
    scale = PIXELS / gap * np.array([aspect**-0.5, aspect**0.5])
    atlas, kept = xatlas.Atlas(), []
    _LAST[:] = [atlas]
    for quads, corner in zip(flat.layout.patches, low):
        used, index = np.unique(flat.layout.flat_corners[quads], return_inverse=True)
        faces = index.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.uint32)
        points = np.zeros((len(used), 2), np.float32)
        points[index.ravel()] = ((flat.corners[quads] - corner) * scale).reshape(-1, 2)
        # xatlas identifies meshes by address, so they must live until it has packed them
        kept.append((points, faces))
        atlas.add_uv_mesh(points, faces)
    options = xatlas.PackOptions()
    options.texels_per_unit, options.padding, options.bruteForce = 1.0, PIXELS // 2, True
    options.bilinear = options.rotate_charts = options.rotate_charts_to_axis = False
    atlas.generate(pack_options=options)
    size = np.array([atlas.width, atlas.height])
    corners = np.array([(atlas[i][2] * size).min(axis=0) for i in range(len(kept))]) / scale
    sizes = np.array([np.ptp(points, axis=0) for points, _ in kept]) / scale
    return corners - [corners[:, 0].min(), (corners + sizes)[:, 1].max()]
