"""Solids of a rim in the numbering of the spirals: a node's hub is where neck and strip cross, its arms are the neck and both halves.

Its fourth arm, outwards, is a sliver at the strip's outer edge, for every hub has four. Holes are left out.
"""

from __future__ import annotations

import numpy as np

from ..engine.arrays import Complex, Float
from ..engine.errors import FlexMapsError
from ..engine.mechanics.rim_bodies import BACKWARDS, NECK
from ..engine.spirals.design import SpiralDesign
from ..engine.spirals.rim import Rim

OUTWARDS = 3  # the arm of a node that is none
SLIVER = 0.03  # strip widths that it is long
SKEW = (
    0.3  # by how much of an arm's width, or of half its length, its first section is skewed; as ``design_mesh.BESIDE``
)


def plane_nodes(
    design: SpiralDesign,
    quarters: np.ndarray,
    sections: np.ndarray,
    at: Float[np.ndarray, " stations"],
    share: np.ndarray,
) -> Complex[np.ndarray, "nodes plane"]:
    """Plane nodes (metres, seen from the nodes' centres) of the hubs' ``quarters`` and of the arms' ``sections``.

    at : shares of an arm's length where its sections are; share : those of their width. Raises FlexMapsError where the rim has holes.
    """
    rim = design.rim
    assert rim is not None
    if rim.hole_diameter > 0.0:
        raise FlexMapsError("Solids of rims have no holes; set their diameter to 0")
    count = len(rim.quad)
    half = 0.5 * design.arms.joint_width[rim.quad, rim.side]
    corner = _corners(rim, half)
    out = np.zeros((count, int(sections.max()) + 1), dtype=complex)
    ends = np.zeros((count, 4, 2, len(at)), dtype=complex)
    for k in range(4):
        ends[:, k] = _edges(rim, k, half, at)
    arms = ends[:, :, 0, :, None] * (1.0 - share) + ends[:, :, 1, :, None] * share
    along, across = share[:, None], share[None, :]
    for k in range(4):
        right, left = corner[:, k - 1][:, None, None], corner[:, k][:, None, None]
        far = ends[:, k, 1, 0][:, None, None]
        out[:, quarters[k]] = right * along * (1.0 - across) + left * across * (1.0 - along) + far * along * across
    out[:, sections[:, 1:]] = arms[:, :, 1:]
    return out


def _corners(rim: Rim, half: np.ndarray) -> Complex[np.ndarray, "nodes 4"]:
    """Of the hubs, after the arms forwards, of the neck, backwards and outwards."""
    x, y = half[:, None] * [1.0, -1.0, -1.0, 1.0], 0.5 * rim.width * np.array([1.0, 1.0, -1.0, -1.0])
    return x * rim.along[:, None] - y * rim.outwards[:, None]


def _edges(rim: Rim, arm: int, half: np.ndarray, at: np.ndarray) -> Complex[np.ndarray, "nodes 2 stations"]:
    """Right and left edge of an arm of all nodes at shares of its length."""
    if arm in (NECK, OUTWARDS):
        way = -rim.outwards if arm == NECK else rim.outwards
        long, skew = (
            (rim.depth, SKEW * half)
            if arm == NECK
            else (SLIVER * rim.width, np.full(len(half), 0.5 * SLIVER * rim.width))
        )
        begin, aside = 0.5 * rim.width, half
        skew = np.minimum(skew, 0.5 * long)
        return np.stack([
            (begin + s[:, None] + (long - s[:, None]) * at) * way[:, None] + sign * 1j * aside[:, None] * way[:, None]
            for s, sign in ((np.zeros_like(skew), -1.0), (skew, 1.0))
        ], axis=1)  # fmt: skip
    back = arm == BACKWARDS
    whole = rim.reach[:, int(back)]
    skew = np.minimum(SKEW * rim.width, 0.5 * (whole - half))
    sides = []
    for s, edge in ((np.zeros_like(skew), -1.0), (skew, 1.0)):
        far = half[:, None] + s[:, None] + (whole - half - s)[:, None] * at
        place, way = (
            x.reshape(far.shape)
            for x in rim.vectors_along_strip(np.repeat(np.arange(len(half)), len(at)), back, far.ravel())
        )
        sides.append(place + edge * 1j * (-way if back else way) * 0.5 * rim.width)
    return np.stack(sides, axis=1)
