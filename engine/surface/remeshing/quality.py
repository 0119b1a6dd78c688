"""How well quads of a remesher serve what comes after: few irregular vertices, along the curvature, even, on sharp edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..checking.check import as_quad_mesh
from ..curvature import misalignment
from ..mesh import PolygonMesh
from .mend import Target

KEPT = 0.1  # quad edges: so near to a side of a quad, a point of a sharp edge counts as kept; a tenth cannot be seen
# so many irregular vertices are worth a degree. Twice as much of one as of the other weighs the same on a usual mesh, which
# has 40 and 16; a product of both would take any direction for a few irregular vertices less on a smooth shell
DEGREE = 2.5
NONE = 20.0  # what counts as none of both together: unevenness and lost edges matter also where they are few


@dataclass(frozen=True)
class Quality:
    """Figures of a quad mesh; less is better in all of them.

    irregular : inner vertices without four quads, and those on the border without two
    misalignment : degrees, see ``curvature.misalignment``
    unevenness : standard deviation of the edges' lengths over their mean
    lost : share of the length of the surface's sharp edges along which no quad has a side
    """

    irregular: int
    misalignment: float
    unevenness: float
    lost: float

    @property
    def cost(self) -> float:
        """One number to compare by."""
        return (NONE + self.irregular + DEGREE * self.misalignment) * (1.0 + self.unevenness) * (1.0 + self.lost)


def quality(quads: PolygonMesh, target: Target) -> Quality:
    """Figures of quads that stand for the surface ``target``; raises ``FlexMapsError`` where they are no sound quad mesh."""
    mesh = as_quad_mesh(quads)
    lengths = mesh.edge_lengths
    irregular = int(mesh.irregular.sum())
    return Quality(
        irregular, misalignment(mesh), float(lengths.std() / lengths.mean()), _lost(quads, mesh.edges, target)
    )


def _lost(quads: PolygonMesh, edges: np.ndarray, target: Target) -> float:
    if not len(target.sharp):
        return 0.0
    import igl

    a, b = target.vertices[target.sharp.T]
    length = np.linalg.norm(b - a, axis=1)
    points = np.concatenate([a + t * (b - a) for t in (0.0, 0.25, 0.5, 0.75)])
    squared = igl.point_mesh_squared_distance(points, np.ascontiguousarray(quads.vertices, float), edges)[0]
    size = np.linalg.norm(quads.vertices[edges[:, 0]] - quads.vertices[edges[:, 1]], axis=1).mean()
    return float(np.average(np.sqrt(squared) > KEPT * size, weights=np.tile(length, 4)))
