"""Spiral arms drawn as flat bands on quads in space, fast enough to redraw at every step of the optimiser."""

from __future__ import annotations

import numpy as np

from ..arrays import Float, Int
from ..spirals.curves.spiral import LEFT, RIGHT, Arms, edge_points

# Largest number of points of all bands; beyond it arms get fewer pieces. Larger: smoother arms, slower redrawing.
MAX_POINTS = 250_000
# Smallest and largest number of straight pieces of an arm. Larger: smoother arms, slower redrawing.
MIN_PIECES, MAX_PIECES = 5, 18


def make_bands(
    corners: Float[np.ndarray, "quads 4 3"],
    normal: Float[np.ndarray, "quads 3"],
    width: Float[np.ndarray, "quads 4"],
    wind: Float[np.ndarray, " quads"],
    lift: float,
    pieces: int | None = None,
) -> tuple[Float[np.ndarray, "points 3"], Int[np.ndarray, "triangles 3"]]:
    """Build the bands of all arms, from the joints to the centres, without the blends at the joints.

    Parameters
    ----------
    corners : corners of the quads in space; all lengths in one unit
    normal : unit normals of the quads
    width : widths of the arms
    wind : twist, radians, with the sign of the sense of rotation
    lift : distance of the bands above the quads
    pieces : number of pieces per arm; by default as many as ``MAX_POINTS`` allows

    Returns
    -------
    points; triangles
    """
    count = len(corners)
    if pieces is None:
        pieces = int(np.clip(MAX_POINTS // (8 * max(count, 1)) - 1, MIN_PIECES, MAX_PIECES))
    centre = corners.mean(axis=1)
    # the midpoints of a quad's sides lie in one plane (Varignon)
    spokes = 0.5 * (corners + np.roll(corners, -1, axis=1)) - centre[:, None]
    axes = np.stack([spokes[:, 0], np.cross(normal, spokes[:, 0])], axis=1)
    axes /= np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-30)
    flat = spokes @ axes.transpose(0, 2, 1)
    radius, angle = np.linalg.norm(flat, axis=2), np.arctan2(flat[..., 1], flat[..., 0])
    arms = Arms(np.zeros((count, 2)), radius, angle, wind, width, width, np.zeros_like(flat), np.ones_like(radius))
    t = np.broadcast_to(np.linspace(0.0, 1.0, pieces + 1), (*radius.shape, pieces + 1))
    edges = np.stack([edge_points(arms, t, side)[0] for side in (LEFT, RIGHT)], axis=3)  # (F, 4, pieces + 1, 2, 2)
    points = (edges.reshape(count, 8 * (pieces + 1), 2) @ axes).reshape(*edges.shape[:-1], 3)
    points += _warp_offsets(points.reshape(count, 8 * (pieces + 1), 3), corners, spokes).reshape(points.shape)
    points += (centre + lift * normal)[:, None, None, None]
    first = np.arange(4 * count)[:, None] * 2 * (pieces + 1) + 2 * np.arange(pieces)
    one, two = np.stack([first, first + 1, first + 3], axis=-1), np.stack([first, first + 3, first + 2], axis=-1)
    return points.reshape(-1, 3), np.concatenate([one, two], axis=1).reshape(-1, 3)


def _warp_offsets(
    points: Float[np.ndarray, "quads points 3"],
    corners: Float[np.ndarray, "quads 4 3"],
    spokes: Float[np.ndarray, "quads 4 3"],
) -> Float[np.ndarray, "quads points 3"]:
    """Return offsets that move points from the quads' mean planes onto the four triangles that are drawn for a quad.

    points : positions in the mean planes, from the quads' centres
    spokes : vectors from the quads' centres to the sides' midpoints
    """
    one, two = spokes[:, 0], spokes[:, 1]  # the midpoints of the other two sides are opposite
    a, b, c = ((x * y).sum(axis=1)[:, None] for x, y in ((one, one), (one, two), (two, two)))
    along, across = (np.einsum("fnk,fk->fn", points, x) for x in (one, two))
    scale = 1.0 / np.maximum(a * c - b * b, 1e-30)
    u, v = scale * (c * along - b * across), scale * (a * across - b * along)
    warp = 0.25 * (corners[:, 1] + corners[:, 3] - corners[:, 0] - corners[:, 2])
    share = np.minimum(np.abs(u), np.abs(v)) * np.sign(u * v)
    return share[..., None] * warp[:, None]
