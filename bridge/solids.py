"""The cut panels as solids to look at: every arm a bar between its true edges, every hub a small plate.

Built arm by arm, for cutting a sheet with thousands of holes into triangles would take Blender minutes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..engine.contours import hubs
from ..engine.design import SpiralDesign
from ..engine.spiral import LEFT, RIGHT, edge, mates


@dataclass(frozen=True, eq=False)
class Solid:
    """A polygon mesh.

    vertices : (V, 3) metres
    corners : (C,) int, vertex of every face corner; sizes : (P,) int, corners per face
    quad_of : (P,) int, the quad that every face belongs to
    """

    vertices: np.ndarray
    corners: np.ndarray
    sizes: np.ndarray
    quad_of: np.ndarray


def solid(design: SpiralDesign, centres: np.ndarray, degrees_per_step: float = 9.5) -> Solid:
    """All panels, every patch's origin at ``centres`` (N, 2) metres, from z = 0 up to the sheet's thickness.

    Every edge has exactly two faces. Arms are straight between steps of ``degrees_per_step``: with 9.5 the volume is right to
    half a percent. For printing, ``engine/solid_files.py`` follows the true outlines.
    """
    arms, layout = design.arms, design.flat.layout
    root = hubs(arms, design.params.fillet)
    steps = 5 + int(np.ceil(np.degrees(design.twist.max(initial=0.0)) / degrees_per_step))
    share = np.linspace(0.0, 1.0, steps)
    left = edge(arms, root.left[..., None] * share, LEFT)[0]
    right = edge(arms, np.roll(root.right, 1, axis=1)[..., None] * share, RIGHT)[0]
    flat = np.stack([left, right], axis=2)  # (F, 4, 2, steps, 2)
    flat = flat + centres[layout.patch_of][:, None, None, None]
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
