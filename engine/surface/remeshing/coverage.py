"""Check whether quads cover the surface that they approximate: compare areas and distances."""

from __future__ import annotations

import numpy as np

from ..checking.finding import Finding, make_finding, with_count
from ..mesh import PolygonMesh
from .mend import TargetSurface

# Smallest and largest area of the quads without a warning, as shares of the surface's area. A wider range: lost parts go
# unnoticed; narrower: warnings where small features are merely rounded off.
AREA = (0.75, 1.25)
# Largest distance from points of the surface to the quads without a warning, in quad edges: USUAL for 95 % of the points,
# WORST for all points. Larger: fewer warnings, more lost parts go unnoticed.
USUAL, WORST = 0.5, 1.5
# Largest number of surface vertices whose distance is measured (0.1 s); more: slower, less risk to miss a tip.
MOST_TIPS = 20000


def suggest_finer_count(count: int) -> int:
    """Return the number of quads to suggest if ``count`` quads miss details: twice as many, rounded to tens."""
    return round(2.0 * count / 10.0) * 10


def warn_of_gaps(
    quads: PolygonMesh, made: TargetSurface, whole: TargetSurface, count: int, first: int
) -> list[Finding]:
    """Warn if quads miss parts of the surface; the warning names the quads nearest to these parts.

    Parameters
    ----------
    quads : the quads of one body
    made : the quads, triangulated
    whole : the surface that the quads should cover
    count : number of quads of all bodies
    first : index of this body's first quad among the quads of all bodies

    Returns
    -------
    one warning, or none
    """
    edge = (made.area / len(quads.sizes)) ** 0.5
    # vertices are measured too, because samples spread evenly by area miss sharp tips
    tips = whole.vertices[:: 1 + len(whole.vertices) // MOST_TIPS]
    points = np.concatenate([whole.sample_points, tips])
    away = made.distances(points) / edge
    usual = np.percentile(away[: len(whole.sample_points)], 95)
    ratio = made.area / whole.area
    if usual <= USUAL and away.max() <= WORST and AREA[0] <= ratio <= AREA[1]:
        return []
    from scipy.spatial import cKDTree

    far = points[away > min(USUAL, away.max() * (1.0 - 1e-9))]
    middles = quads.vertices[quads.corners.reshape(-1, 4)].mean(axis=1)
    faces = np.unique(cKDTree(middles).query(far)[1]) + first
    text = (
        f"The quads lie up to {away.max():.2g} edge lengths away from the surface and have {100.0 * ratio:.0f} % of its area, so that "
        f"parts are lost near {with_count(len(faces), 'face', 'faces')}: remesh to {suggest_finer_count(count)} quads"
    )
    return [make_finding("surface-missed", text, faces, severity="warning")]
