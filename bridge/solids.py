"""The cut panels as solids to look at: every arm a bar between its true edges, every hub a small plate.

Built arm by arm, for cutting a sheet with thousands of holes into triangles would take Blender minutes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..engine.design import SpiralDesign
from ..engine.spiral import LEFT, RIGHT, edge, mates

DEGREES = 9.5  # of an arm's twist between two of its steps


@dataclass(frozen=True, eq=False)
class Solid:
    """A polygon mesh.

    vertices : (V, 3) metres
    corners : (C,) int, vertex of every face corner; sizes : (P,) int, corners per face
    quad_of : (P,) int, the quad that every face belongs to
    flat : whether it is only the upper side
    """

    vertices: np.ndarray
    corners: np.ndarray
    sizes: np.ndarray
    quad_of: np.ndarray
    flat: bool = False


def light(design: SpiralDesign, centres: np.ndarray, most: int = 100_000) -> Solid:
    """Like ``solid``, but of many spirals only the upper side and in coarser steps, about ``most`` faces in all.

    So a window is not held up by them.
    """
    count, steps = len(design.width), _steps(design, DEGREES)
    if count * 16 * steps <= most:
        return solid(design, centres)
    steps = max(min(steps, most // (4 * count)), 5)
    flat = _edges(design, centres, steps)
    points = np.concatenate([flat, np.full((*flat.shape[:-1], 1), design.params.thickness)], axis=-1).reshape(-1, 3)
    index = np.arange(len(points)).reshape(count, 4, 2, steps)
    left, right = index[:, :, 0], index[:, :, 1]
    loops = np.stack([left[..., :-1], left[..., 1:], right[..., 1:], right[..., :-1]], axis=-1).reshape(-1, 4)
    plates = np.stack([right[..., -1], left[..., -1]], axis=-1).reshape(count, 8)
    corners = np.concatenate([loops.ravel(), plates.ravel()])
    sizes = np.concatenate([np.full(len(loops), 4), np.full(count, 8)])
    quad_of = np.concatenate([loops[:, 0], plates[:, 0]]) // (8 * steps)
    return Solid(points, corners, sizes, quad_of, flat=True)


def solid(design: SpiralDesign, centres: np.ndarray, degrees_per_step: float = DEGREES) -> Solid:
    """All panels, every patch's origin at ``centres`` (N, 2) metres, from z = 0 up to the sheet's thickness.

    Every edge has exactly two faces. Arms are straight between steps of ``degrees_per_step``: with 9.5 the volume is right to
    half a percent. For printing, ``engine/solid_files.py`` follows the true outlines.
    """
    layout, steps = design.flat.layout, _steps(design, degrees_per_step)
    flat = _edges(design, centres, steps)
    count = len(flat)
    bottom = np.concatenate([flat, np.zeros((*flat.shape[:-1], 1))], axis=-1).reshape(-1, 3)
    top = bottom + np.array([0.0, 0.0, design.params.thickness])
    index = np.arange(len(bottom)).reshape(count, 4, 2, steps)
    blunt = layout.cut[layout.mesh.quad_edges] | layout.mesh.border[layout.mesh.quad_edges]
    loops, plates = _faces(index, blunt)
    corners = np.concatenate([loops.ravel(), plates.ravel()])
    sizes = np.concatenate([np.full(len(loops), 4), np.full(len(plates), 8)])
    quad_of = np.concatenate([loops[:, 0], plates[:, 0]]) % len(bottom) // (8 * steps)
    same = _joined(index, blunt, design)
    used, corners = np.unique(np.concatenate([same, same + len(bottom)])[corners], return_inverse=True)
    return Solid(np.concatenate([bottom, top])[used], corners.ravel(), sizes, quad_of)


def _steps(design: SpiralDesign, degrees_per_step: float) -> int:
    """Points along every arm's edges."""
    return 5 + int(np.ceil(np.degrees(design.twist.max(initial=0.0)) / degrees_per_step))


def _edges(design: SpiralDesign, centres: np.ndarray, steps: int) -> np.ndarray:
    """(F, 4, 2, steps, 2) metres: the left and the right edge of every arm, from the joint to the hub."""
    arms, root = design.arms, design.roots
    share = np.linspace(0.0, 1.0, steps)
    left = edge(arms, root.left[..., None] * share, LEFT)[0]
    right = edge(arms, np.roll(root.right, 1, axis=1)[..., None] * share, RIGHT)[0]
    return np.stack([left, right], axis=2) + centres[design.flat.layout.patch_of][:, None, None, None]


def _joined(index: np.ndarray, blunt: np.ndarray, design: SpiralDesign) -> np.ndarray:
    """(n,) int: for every lower vertex the one that it is the same as, for two arms end at the same two points of a joint."""
    same = np.arange(index.size)
    quad, side = mates(design.flat.layout.mesh)
    own = np.arange(len(index))[:, None]
    second = ~blunt & (own > quad)
    ends = index[..., 0]
    # what is left of one arm, seen inwards, is right of the other
    for mine, theirs in ((0, 1), (1, 0)):
        same[ends[:, :, mine][second]] = ends[quad, side, theirs][second]
    return same


def _faces(index: np.ndarray, blunt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quads (n, 4) and hub plates (2 F, 8); index (F, 4, 2, steps) numbers the lower vertices, the upper ones follow.

    blunt : (F, 4) bool, arms that end at a cut, where the bar shows its end
    """
    up = index.size
    l0, l1, r0, r1 = index[:, :, 0, :-1], index[:, :, 0, 1:], index[:, :, 1, :-1], index[:, :, 1, 1:]
    # the right edge lies counter-clockwise before the left one as seen from the joint inwards
    plate = np.stack([index[:, :, 1, -1], index[:, :, 0, -1]], axis=-1).reshape(len(index), 8)
    after = np.roll(index[:, :, 1, -1], -1, axis=1)
    ends = index[:, :, :, 0][blunt]
    loops = [
        np.stack([l0, l1, r1, r0], axis=-1) + up,
        np.stack([r0, r1, l1, l0], axis=-1),
        np.stack([l1, l0, l0 + up, l1 + up], axis=-1)[..., ::-1],
        np.stack([r0, r1, r1 + up, r0 + up], axis=-1)[..., ::-1],
        np.stack([index[:, :, 0, -1], after, after + up, index[:, :, 0, -1] + up], axis=-1),
        np.stack([ends[:, 0], ends[:, 1], ends[:, 1] + up, ends[:, 0] + up], axis=-1)[..., ::-1],
    ]
    return np.concatenate([x.reshape(-1, 4) for x in loops]), np.concatenate([plate + up, plate[:, ::-1]])
