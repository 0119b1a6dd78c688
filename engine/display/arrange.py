"""Arrange flat patches side by side for display (not for cutting): in rows, or packed by xatlas."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Float

if TYPE_CHECKING:
    from ..mechanics.assembly import Pose
    from ..patches.flattening.flatten import FlatPatches
    from ..spirals.design import SpiralDesign

# Width of the rows of panels in front of the piece, as a factor on the diagonal of the piece's ground plan. Larger:
# fewer, longer rows.
TABLE_WIDTH_RATIO = 1.3
ASPECT = 1.6  # width over height of the page that patches should fill, as of a screen
# Widths of rows to try, as factors on the width of a page whose area is that of all boxes. More: slower, denser.
ROW_WIDTHS = (0.8, 0.9, 1.0, 1.1, 1.2, 1.35, 1.5, 1.8, 2.2)
GAP_PIXELS = 8  # gap between two patches, in pixels of xatlas; larger: patches are packed at a finer resolution, slower
# Largest number of patches that xatlas packs (23 take 0.14 s); it cannot be cancelled, and rows suit many patches too.
MAX_PACKED = 100


def arrange_patches(flat: FlatPatches, width: float | None = None) -> Float[np.ndarray, "patches 2"]:
    """Arrange flat patches without overlap, with gaps of about one edge length.

    Rows of bounding boxes and, if xatlas is installed, its packing of the true shapes are tried; the arrangement that
    fits on the smaller page is returned.

    Parameters
    ----------
    flat : flat patches
    width : approximate total width, metres; None for a page of the aspect ``ASPECT``

    Returns
    -------
    positions of the patches' origins, metres; the upper left corner of the whole is at (0, 0)
    """
    (low, high), gap = patch_boxes(flat), flat.layout.mesh.median_edge
    sizes = high - low
    aspect = ASPECT if width is None else width**2 / float((sizes + gap).prod(axis=1).sum())
    tried = [arrange_in_rows(sizes, gap, aspect)]
    if 1 < len(sizes) <= MAX_PACKED and importlib.util.find_spec("xatlas") is not None:
        tried.append(_pack_with_xatlas(flat, low, gap, aspect))
    return min(tried, key=lambda corners: _page_height(corners, sizes, aspect)) - low


def patch_boxes(flat: FlatPatches) -> tuple[Float[np.ndarray, "patches 2"], Float[np.ndarray, "patches 2"]]:
    """Return the lower left and upper right corners of the patches' bounding boxes, in the patches' frames, metres."""
    count = len(flat.layout.patches)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    patch = np.repeat(flat.layout.patch_of, 4)
    points = flat.corners.reshape(-1, 2)
    np.minimum.at(low, patch, points)
    np.maximum.at(high, patch, points)
    return low, high


def places_before_assembly(design: SpiralDesign, pose: Pose) -> Float[np.ndarray, "patches 3"]:
    """Return the positions of the flat patches' origins before assembly, metres: in front of the piece, on its ground.

    Parameters
    ----------
    design : spirals of the piece
    pose : pose of the piece
    """
    flat = design.flat
    spokes = 0.5 * (flat.corners + np.roll(flat.corners, -1, axis=1)) - design.arms.centre[:, None]
    tips = pose.centres[:, None] + spokes @ np.swapaxes(pose.rotations[:, :, :2], 1, 2)
    low, high = tips.min(axis=(0, 1)), tips.max(axis=(0, 1))
    places = arrange_patches(flat, TABLE_WIDTH_RATIO * float(np.linalg.norm((high - low)[:2])))
    (corner, top), gap = patch_boxes(flat), 2.0 * flat.layout.mesh.median_edge
    corner, top = (corner + places).min(axis=0), (top + places).max(axis=0)
    shift = np.array([0.5 * (low + high)[0] - 0.5 * (corner + top)[0], low[1] - gap - top[1]])
    return np.c_[places + shift, np.full(len(places), low[2])]


def arrange_in_rows(
    sizes: Float[np.ndarray, "boxes 2"], gap: float, aspect: float = ASPECT
) -> Float[np.ndarray, "boxes 2"]:
    """Arrange boxes in rows from the top down, the tallest first, so that they fill a page well.

    Parameters
    ----------
    sizes : widths and heights of the boxes, metres
    gap : distance between boxes, metres
    aspect : width over height of the page

    Returns
    -------
    lower left corners of the boxes, metres; the upper left corner of the whole is at (0, 0)
    """
    padded = sizes + gap
    ideal = np.sqrt(padded.prod(axis=1).sum() * aspect)
    widths = np.maximum(np.array(ROW_WIDTHS) * ideal, padded[:, 0].max())
    return min(
        (_fill_rows(sizes, gap, width) for width in widths), key=lambda corners: _page_height(corners, sizes, aspect)
    )


def _page_height(corners: Float[np.ndarray, "boxes 2"], sizes: Float[np.ndarray, "boxes 2"], aspect: float) -> float:
    """Return the height of the smallest page of an aspect that contains boxes, given by lower left corner and size."""
    width, height = (corners + sizes)[:, 0].max(), -corners[:, 1].min()
    return float(max(width / aspect, height))


def _fill_rows(sizes: Float[np.ndarray, "boxes 2"], gap: float, width: float) -> Float[np.ndarray, "boxes 2"]:
    """Return the lower left corners of boxes in rows no wider than ``width``; all rows have one centre line."""
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


# Keep the last atlas alive: its destructor waits for worker threads, for ever if they have not started yet. When the
# next atlas replaces it, they have started.
_LAST: list[object] = []


def _pack_with_xatlas(
    flat: FlatPatches, low: Float[np.ndarray, "patches 2"], gap: float, aspect: float
) -> Float[np.ndarray, "patches 2"]:
    """Pack the true shapes of patches with xatlas, without rotation.

    Parameters
    ----------
    flat : flat patches
    low : lower left corner of every patch in its frame, metres
    gap : distance between patches, metres
    aspect : width over height of the page

    Returns
    -------
    lower left corners of the patches' bounding boxes, metres
    """
    import xatlas

    # xatlas fills squares, so the patches are scaled to turn a page of this aspect into a square
    scale = GAP_PIXELS / gap * np.array([aspect**-0.5, aspect**0.5])
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
    options.texels_per_unit, options.padding, options.bruteForce = 1.0, GAP_PIXELS // 2, True
    options.bilinear = options.rotate_charts = options.rotate_charts_to_axis = False
    atlas.generate(pack_options=options)
    size = np.array([atlas.width, atlas.height])
    corners = np.array([(atlas[i][2] * size).min(axis=0) for i in range(len(kept))]) / scale
    sizes = np.array([np.ptp(points, axis=0) for points, _ in kept]) / scale
    return corners - [corners[:, 0].min(), (corners + sizes)[:, 1].max()]
