"""Quality of remeshed quads: irregular vertices, alignment with curvature, evenness, sharp edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..checking.check import as_quad_mesh
from ..curvature import misalignment
from ..mesh import PolygonMesh
from .mend import TargetSurface

# A point on a sharp edge of the surface counts as preserved if a quad's side is within this distance, in quad edges; 0.1
# is not visible. Larger: sharp edges count as preserved although the quads round them off.
PRESERVED_DISTANCE = 0.1
# Weight of one degree of misalignment in the cost, in irregular vertices. Larger: quads follow the curvature more
# closely, with more irregular vertices.
MISALIGNMENT_WEIGHT = 2.5
# Constant added to the number of irregular vertices and the weighted misalignment in the cost. Larger: unevenness and
# lost sharp edges matter more.
BASE_COST = 20.0


@dataclass(frozen=True)
class Quality:
    """Quality measures of a quad mesh; smaller is better for all.

    irregular : number of irregular vertices, see ``QuadMesh.irregular``
    misalignment : degrees, see ``curvature.misalignment``
    unevenness : standard deviation of the edge lengths over their mean
    lost_edge_share : share of the total length of the surface's sharp edges along which no quad has a side
    """

    irregular: int
    misalignment: float
    unevenness: float
    lost_edge_share: float

    @property
    def cost(self) -> float:
        """All measures combined into one number, to rank quad meshes; smaller is better."""
        return (
            (BASE_COST + self.irregular + MISALIGNMENT_WEIGHT * self.misalignment)
            * (1.0 + self.unevenness)
            * (1.0 + self.lost_edge_share)
        )


def quality(quads: PolygonMesh, target: TargetSurface) -> Quality:
    """Measure the quality of quads that cover a surface.

    Parameters
    ----------
    quads : quad mesh without errors, metres
    target : the surface that the quads cover

    Raises
    ------
    FlexMapsError : ``check`` finds errors in the quads
    """
    mesh = as_quad_mesh(quads)
    lengths = mesh.edge_lengths
    irregular = int(mesh.irregular.sum())
    return Quality(
        irregular,
        misalignment(mesh),
        float(lengths.std() / lengths.mean()),
        _lost_edge_share(quads, mesh.edges, target),
    )


def _lost_edge_share(quads: PolygonMesh, edges: np.ndarray, target: TargetSurface) -> float:
    """Return the share of the target's sharp edges, by length, that is farther than ``PRESERVED_DISTANCE`` from all edges.

    edges : edges of the quads, as pairs of vertices
    """
    if not len(target.sharp_edges):
        return 0.0
    import igl

    a, b = target.vertices[target.sharp_edges.T]
    length = np.linalg.norm(b - a, axis=1)
    points = np.concatenate([a + t * (b - a) for t in (0.0, 0.25, 0.5, 0.75)])
    squared = igl.point_mesh_squared_distance(points, np.ascontiguousarray(quads.vertices, float), edges)[0]
    size = np.linalg.norm(quads.vertices[edges[:, 0]] - quads.vertices[edges[:, 1]], axis=1).mean()
    return float(np.average(np.sqrt(squared) > PRESERVED_DISTANCE * size, weights=np.tile(length, 4)))
