"""Move flat points inside patches so that quads too small for a spiral grow; outlines and seams stay."""

from __future__ import annotations

import numpy as np

from ..arrays import Int
from ..patches.flattening.flatten import FlatPatches, with_energies
from ..progress import SILENT, Progress
from ..surface.remeshing.regularise import best_squares

RINGS = 2  # number of rings of quads around a small quad whose corners move too; more spread the change wider
ITERATIONS = 60  # number of smoothing iterations; more come closer to convergence and take longer
SMALL_SIDE_SHARE = (
    0.7  # least target side of a quad, as a share of the median side; larger values leave less room to neighbours
)


def enlarge_quads(flat: FlatPatches, quads: Int[np.ndarray, " n"], progress: Progress = SILENT) -> FlatPatches:
    """Move the inner corners of ``quads`` and of quads near them so that quads become squarer and small quads larger.

    Return the input if a quad would turn over or become concave.
    """
    corners, layout = flat.layout.flat_corners, flat.layout
    moving = np.zeros(len(flat.points), dtype=bool)
    moving[corners[quads]] = True
    for _ in range(RINGS):
        moving[corners[moving[corners].any(axis=1)]] = True
    outline = layout.outline_sides
    moving[corners[outline]] = moving[np.roll(corners, -1, axis=1)[outline]] = False
    near = moving[corners].any(axis=1)
    some = corners[near]
    if not len(some):
        return flat
    points = np.pad(flat.points, ((0, 0), (0, 1)))
    count = np.maximum(np.bincount(some.ravel(), minlength=len(points)), 1)
    middle = float(np.median(np.linalg.norm(np.roll(flat.corners, -1, axis=1) - flat.corners, axis=2)))
    for done in range(ITERATIONS):
        progress(done / ITERATIONS, "making room for spirals")
        squares = best_squares(points[some])
        centre = squares.mean(axis=1, keepdims=True)
        side = np.sqrt(2.0) * np.linalg.norm(squares[:, 0] - centre[:, 0], axis=1)
        larger = np.maximum(SMALL_SIDE_SHARE * middle / np.maximum(side, 1e-9 * middle), 1.0)[:, None, None]
        goals = (centre + larger * (squares - centre)).reshape(-1, 3)
        total = np.stack([np.bincount(some.ravel(), goals[:, k], minlength=len(points)) for k in range(2)], axis=1)
        points[moving, :2] = (total / count[:, None])[moving]
    patches = with_energies(layout, points[:, :2])
    return flat if (_smallest_corner(patches)[near] <= 0.0).any() else patches


def _smallest_corner(flat: FlatPatches) -> np.ndarray:
    """Return every quad's smallest cross product of successive sides; not positive if it is turned over or concave."""
    along = np.roll(flat.corners, -1, axis=1) - flat.corners
    before = np.roll(along, 1, axis=1)
    return (before[..., 0] * along[..., 1] - before[..., 1] * along[..., 0]).min(axis=1)
