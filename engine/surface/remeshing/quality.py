"""Quality of a remesher's quads: irregular vertices, alignment with curvature, evenness, sharp edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..checking.check import as_quad_mesh
from ..curvature import misalignment
from ..mesh import PolygonMesh
from .mend import TargetSurface

# in quad edges: a point of a sharp edge nearer than this to a quad's side counts as kept; a tenth is not visible
KEPT = 0.1
# Irregular vertices that weigh as much as one degree of misalignment. With it, doubling either weighs the same on a
# usual mesh, with 40 vertices and 16 degrees; a product of both would accept any direction for slightly fewer irregular
# vertices on a smooth shell.
DEGREE = 2.5
NONE = 20.0  # constant part of that sum, so that unevenness and lost edges matter even if the sum is small


@dataclass(frozen=True)
class Quality:
    """Measures of a quad mesh; less is better in all of them.

    irregular : number of irregular vertices, see ``QuadMesh.irregular``
    misalignment : degrees, see ``curvature.misalignment``
    unevenness : standard deviation of the edge lengths over their mean
    lost : share of the length of the surface's sharp edges without a quad's side along it
    """

    irregular: int
    misalignment: float
    unevenness: float
    lost: float

    @property
    def cost(self) -> float:
        """All measures combined in one number, to rank quad meshes."""
        return (NONE + self.irregular + DEGREE * self.misalignment) * (1.0 + self.unevenness) * (1.0 + self.lost)


def quality(quads: PolygonMesh, target: TargetSurface) -> Quality:
    """Measure quads against their surface.

    Parameters
    ----------
    quads : a sound quad mesh, metres
    target : the surface that they cover

    Raises
    ------
    FlexMapsError : ``check`` finds errors in the quads
    """
    mesh = as_quad_mesh(quads)
    lengths = mesh.edge_lengths
    irregular = int(mesh.irregular.sum())
    return Quality(
        irregular, misalignment(mesh), float(lengths.std() / lengths.mean()), _lost_share(quads, mesh.edges, target)
    )


def _lost_share(quads: PolygonMesh, edges: np.ndarray, target: TargetSurface) -> float:
    """Return the share of the length of sharp edges that is not kept."""
    if not len(target.sharp):
        return 0.0
    import igl

    a, b = target.vertices[target.sharp.T]
    length = np.linalg.norm(b - a, axis=1)
    points = np.concatenate([a + t * (b - a) for t in (0.0, 0.25, 0.5, 0.75)])
    squared = igl.point_mesh_squared_distance(points, np.ascontiguousarray(quads.vertices, float), edges)[0]
    size = np.linalg.norm(quads.vertices[edges[:, 0]] - quads.vertices[edges[:, 1]], axis=1).mean()
    return float(np.average(np.sqrt(squared) > KEPT * size, weights=np.tile(length, 4)))
