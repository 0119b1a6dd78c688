"""Check whether quads cover their target surface: compare areas and distances."""

from __future__ import annotations

import numpy as np

from ..checking.finding import Finding, finding, with_count
from ..mesh import PolygonMesh
from .mend import TargetSurface

AREA = (
    0.75,
    1.25,
    # smallest and largest area of the quads, as a share of the surface's; rounding off small features takes 0.15 of Suzanne
    # with 500 quads
)
# in edges: 95 % of the surface's points are nearer to the quads than the first, all are nearer than the second
USUAL, WORST = 0.5, 1.5
MOST_TIPS = 20000  # vertices of the target surface whose distance is measured; takes about a tenth of a second


def finer(count: int) -> int:
    """Return the number of quads to suggest where ``count`` quads miss details, in tens: twice as many, 0.7 times as long."""
    return round(2.0 * count / 10.0) * 10


def warn_of_gaps(
    quads: PolygonMesh, made: TargetSurface, whole: TargetSurface, count: int, first: int
) -> list[Finding]:
    """Warn if the quads miss parts of the surface; the warning names the quads beside these parts.

    Parameters
    ----------
    quads : of one body
    made, whole : the quads' surface, the target surface
    count : quads of all bodies
    first : index of this body's first quad among all bodies
    """
    edge = (made.area / len(quads.sizes)) ** 0.5
    tips = whole.vertices[:: 1 + len(whole.vertices) // MOST_TIPS]  # samples, even by area, leave out sharp tips
    points = np.concatenate([whole.samples, tips])
    away = made.distances(points) / edge
    usual = np.percentile(away[: len(whole.samples)], 95)
    ratio = made.area / whole.area
    if usual <= USUAL and away.max() <= WORST and AREA[0] <= ratio <= AREA[1]:
        return []
    from scipy.spatial import cKDTree

    far = points[away > min(USUAL, away.max() * (1.0 - 1e-9))]
    middles = quads.vertices[quads.corners.reshape(-1, 4)].mean(axis=1)
    faces = np.unique(cKDTree(middles).query(far)[1]) + first
    text = (
        f"The quads lie up to {away.max():.2g} edge lengths away from the surface and have {100.0 * ratio:.0f} % of its area, so that "
        f"parts are lost near {with_count(len(faces), 'face', 'faces')}: remesh to {finer(count)} quads"
    )
    return [finding("surface-missed", text, faces, severity="warning")]
