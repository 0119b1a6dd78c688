"""Whether quads cover the surface that they stand for: its area, and how far its points are from them."""

from __future__ import annotations

import numpy as np

from ..checking.finding import Finding, counted, finding
from ..mesh import PolygonMesh
from .mend import Target

AREA = (
    0.75,
    1.25,
)  # times the surface's area that quads have at least and at most: rounding off what is small takes .15 of Suzanne's 500
USUAL, WORST = (
    0.5,
    1.5,
)  # edges: 95 of 100 points of the surface are nearer to the quads than the first, all nearer than the second
MORE = 2.0  # times the count with which the quads follow what they have missed; not measured


def finer(count: int) -> int:
    """How many quads to ask for where so many have missed something, in tens."""
    return round(MORE * count / 10.0) * 10


def uncovered(quads: PolygonMesh, made: Target, whole: Target, count: int, first: int) -> list[Finding]:
    """The warning that names the quads beside parts of the surface that they miss, if there are any.

    made : the surface of the quads; count : of quads of all bodies; first : the number of the first quad among all bodies
    """
    edge = (made.area / len(quads.sizes)) ** 0.5
    away = made.distances(whole.samples) / edge
    ratio = made.area / whole.area
    if np.percentile(away, 95) <= USUAL and away.max() <= WORST and AREA[0] <= ratio <= AREA[1]:
        return []
    from scipy.spatial import cKDTree

    far = whole.samples[away > min(USUAL, away.max() * (1.0 - 1e-9))]
    middles = quads.vertices[quads.corners.reshape(-1, 4)].mean(axis=1)
    faces = np.unique(cKDTree(middles).query(far)[1]) + first
    text = (
        f"The quads miss the surface by up to {away.max():.2g} of their edges and have {ratio:.0%} of its area, "
        f"beside {counted(len(faces), 'face', 'faces')}: remesh with {finer(count)} quads"
    )
    return [finding("surface-missed", text, faces, severity="warning")]
