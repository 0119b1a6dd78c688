"""Mirror planes of a surface: one side of a plane is remeshed, and its quads are mirrored, so that they are symmetric."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Float
from ..checking.topology import sides_of
from ..mesh import PolygonMesh
from .bodies import joined, target_of
from .mend import of_rows

ALIKE = 1e-3  # of the extent: a surface whose mirrored vertices lie nearer to it is symmetric
SNAPPED = (
    1e-6  # of the extent: a vertex so near to the plane is on it; rounding errors of what is stored in single precision
)
AT_PLANE = 0.5  # quad edges: border vertices of a half that are nearer to the plane are joined with their images
FITS = 4  # rounds of fitting a plane to the pairs of a point and its image


@dataclass(frozen=True, eq=False)
class Plane:
    """A mirror plane; metres.

    normal : unit length
    """

    point: Float[np.ndarray, " 3"]
    normal: Float[np.ndarray, " 3"]

    def heights(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Metres above the plane."""
        return (points - self.point) @ self.normal

    def mirrored(self, mesh: PolygonMesh) -> PolygonMesh:
        """The image of a mesh, its faces turned so that the outside stays outside; the first corner stays the first."""
        points = mesh.vertices - 2.0 * self.heights(mesh.vertices)[:, None] * self.normal
        corners = mesh.corners.reshape(len(mesh.sizes), -1)
        return PolygonMesh(points, np.roll(corners[:, ::-1], 1, axis=1).ravel(), mesh.sizes)

    def maps(self, one: PolygonMesh, other: PolygonMesh, extent: float) -> bool:
        """Whether the image of a mesh lies on another one, and the other's on it; ``extent`` in metres is that of the whole."""
        pairs = ((one, other), (other, one))
        return all(
            target_of(b).distances(np.ascontiguousarray(self.mirrored(a).vertices)).max() < ALIKE * extent
            for a, b in pairs
        )


def planes_of(mesh: PolygonMesh) -> list[Plane]:
    """Mirror planes of triangles, at right angles to each other: along the axes first, then along the principal directions."""
    points, extent = mesh.vertices, float(np.ptp(mesh.vertices, axis=0).max())
    _, directions = np.linalg.eigh(np.cov(points.T))
    found: list[Plane] = []
    for k, normal in enumerate([*np.eye(3), *directions.T]):
        heights = points @ normal
        plane = Plane(0.5 * (heights.min() + heights.max()) * normal, normal)
        if k >= 3:
            plane = _fitted(mesh, plane)
        at_right_angles = all(abs(plane.normal @ one.normal) < ALIKE for one in found)
        if at_right_angles and plane.maps(mesh, mesh, extent):
            found.append(plane)
    return found


def _fitted(mesh: PolygonMesh, plane: Plane) -> Plane:
    """The plane nearest to the middles between points and where the surface is nearest to their images."""
    target = target_of(mesh)
    for _ in range(FITS):
        images, _ = target.nearest(np.ascontiguousarray(plane.mirrored(mesh).vertices))
        apart = mesh.vertices - images
        plane = Plane(0.5 * (mesh.vertices + images).mean(axis=0), np.linalg.eigh(apart.T @ apart)[1][:, 2])
    return plane


def half(mesh: PolygonMesh, plane: Plane) -> PolygonMesh | None:
    """The triangles above the plane, those across it cut there; ``None`` where a face lies in the plane or nothing is above."""
    rows = mesh.corners.reshape(-1, 3)
    heights = plane.heights(mesh.vertices)
    heights[np.abs(heights) < SNAPPED * np.ptp(mesh.vertices, axis=0).max()] = 0.0
    sign = np.sign(heights)[rows]
    if (sign == 0).all(axis=1).any() or not (sign > 0).any():
        return None
    points, made = list(mesh.vertices), [*rows[(sign >= 0).all(axis=1)].tolist()]
    cuts: dict[tuple[int, int], int] = {}

    def cut(a: int, b: int) -> int:
        """The vertex where the edge from a to b crosses the plane."""
        low, high = min(a, b), max(a, b)
        if (low, high) not in cuts:
            share = heights[low] / (heights[low] - heights[high])
            points.append((1.0 - share) * mesh.vertices[low] + share * mesh.vertices[high])
            cuts[low, high] = len(points) - 1
        return cuts[low, high]

    for row in rows[(sign > 0).any(axis=1) & (sign < 0).any(axis=1)].tolist():
        corners: list[int] = []
        for a, b in zip(row, row[1:] + row[:1], strict=True):
            if heights[a] >= 0.0:
                corners.append(a)
            if heights[a] * heights[b] < 0.0:
                corners.append(cut(a, b))
        made += [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]
    return of_rows(np.array(points), np.array(made))


def doubled(
    quads: PolygonMesh, plane: Plane, edge: float, ends: Float[np.ndarray, "ends 3"] | None = None
) -> PolygonMesh:
    """The quads of a half and their images, joined along the plane.

    edge : metres, about that of a quad
    ends : metres, where the border meets the plane: the half has corners there, maybe sharp ones, that quads have cut off
    """
    sides = sides_of(quads)
    border = sides.edges[np.bincount(sides.edge, minlength=len(sides.edges)) == 1]
    heights = plane.heights(quads.vertices)
    on_plane = np.zeros(len(heights), bool)
    on_plane[border] = True
    on_plane &= np.abs(heights) < AT_PLANE * edge
    points = quads.vertices - np.where(on_plane, heights, 0.0)[:, None] * plane.normal
    if ends is not None and len(ends) and on_plane.any():
        away, nearest = cKDTree(points[on_plane]).query(ends)
        near = away < edge
        points[np.flatnonzero(on_plane)[nearest[near]]] = ends[near]
    moved = replace(quads, vertices=points)
    both = joined([moved, plane.mirrored(moved)])
    count = len(heights)
    index = np.arange(2 * count)
    index[count:][on_plane] = np.flatnonzero(on_plane)
    return of_rows(both.vertices, index[both.corners].reshape(-1, 4))


def euler(mesh: PolygonMesh) -> int:
    """Vertices less edges and more faces: one less for every slit where halves do not meet."""
    return len(np.unique(mesh.corners)) - len(sides_of(mesh).edges) + len(mesh.sizes)


def own_planes(mesh: PolygonMesh, planes: Sequence[Plane], extent: float) -> list[Plane]:
    """Those planes that map one body of several onto itself."""
    return [plane for plane in planes if plane.maps(mesh, mesh, extent)]
