"""Mirror symmetry in remeshing: remesh the part on one side of a mirror plane, and reflect its quads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Float
from ...tolerances import SINGLE_TOL
from ..checking.topology import sides_of
from ..mesh import PolygonMesh
from .bodies import concatenate_meshes, target_surface
from .mend import mesh_from_rows

# Symmetry tolerance: largest distance of a mirrored vertex from the surface, as a share of the mesh's extent; also the
# largest cosine between the normals of planes that count as perpendicular. Larger: slightly asymmetric meshes are made
# symmetric.
ALIKE = 1e-3
# Border vertices of a half within this distance of the plane, in quad edges, are merged with their mirror images.
# Larger: fewer slits between the halves, but vertices of other borders may be merged.
AT_PLANE = 0.5
FITS = 4  # iterations of fitting a plane to points and their mirror images; more: slower, more accurate


@dataclass(frozen=True, eq=False)
class MirrorPlane:
    """A mirror plane.

    point : any point on the plane, metres
    normal : unit normal
    """

    point: Float[np.ndarray, " 3"]
    normal: Float[np.ndarray, " 3"]

    def signed_distances(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Return the signed distances of points from the plane, metres."""
        return (points - self.point) @ self.normal

    def mirror(self, mesh: PolygonMesh) -> PolygonMesh:
        """Return the mirror image of a mesh, with faces reversed to face outwards; faces keep their first corners."""
        points = mesh.vertices - 2.0 * self.signed_distances(mesh.vertices)[:, None] * self.normal
        corners = mesh.corners.reshape(len(mesh.sizes), -1)
        return PolygonMesh(points, np.roll(corners[:, ::-1], 1, axis=1).ravel(), mesh.sizes)

    def maps_onto(self, one: PolygonMesh, other: PolygonMesh, extent: float) -> bool:
        """Return whether each of two meshes is the mirror image of the other.

        one, other : triangle or quad meshes
        extent : size to which the tolerance ``ALIKE`` refers, metres
        """
        pairs = ((one, other), (other, one))
        return all(
            target_surface(b).distances(np.ascontiguousarray(self.mirror(a).vertices)).max() < ALIKE * extent
            for a, b in pairs
        )


def mirror_planes(mesh: PolygonMesh) -> list[MirrorPlane]:
    """Return the mirror planes of a mesh that are normal to coordinate axes or principal axes.

    Planes that are not perpendicular to an earlier plane are left out.
    """
    points, extent = mesh.vertices, float(np.ptp(mesh.vertices, axis=0).max())
    _, directions = np.linalg.eigh(np.cov(points.T))
    found: list[MirrorPlane] = []
    for k, normal in enumerate([*np.eye(3), *directions.T]):
        heights = points @ normal
        plane = MirrorPlane(0.5 * (heights.min() + heights.max()) * normal, normal)
        if k >= 3:
            plane = _fit_plane(mesh, plane)
        at_right_angles = all(abs(plane.normal @ one.normal) < ALIKE for one in found)
        if at_right_angles and plane.maps_onto(mesh, mesh, extent):
            found.append(plane)
    return found


def _fit_plane(mesh: PolygonMesh, plane: MirrorPlane) -> MirrorPlane:
    """Return a better mirror plane: fitted to the midpoints between vertices and their images projected onto the mesh."""
    target = target_surface(mesh)
    for _ in range(FITS):
        images, _ = target.nearest(np.ascontiguousarray(plane.mirror(mesh).vertices))
        apart = mesh.vertices - images
        plane = MirrorPlane(0.5 * (mesh.vertices + images).mean(axis=0), np.linalg.eigh(apart.T @ apart)[1][:, 2])
    return plane


def cut_at_plane(mesh: PolygonMesh, plane: MirrorPlane) -> PolygonMesh | None:
    """Cut a triangle mesh at the plane and return the part on the side of the normal.

    Return None if a face lies in the plane, or no vertex lies on that side.
    """
    rows = mesh.corners.reshape(-1, 3)
    heights = plane.signed_distances(mesh.vertices)
    heights[np.abs(heights) < SINGLE_TOL * np.ptp(mesh.vertices, axis=0).max()] = 0.0
    sign = np.sign(heights)[rows]
    if (sign == 0).all(axis=1).any() or not (sign > 0).any():
        return None
    points, made = list(mesh.vertices), [*rows[(sign >= 0).all(axis=1)].tolist()]
    cuts: dict[tuple[int, int], int] = {}

    def cut(a: int, b: int) -> int:
        """Return the index of the vertex where the edge from a to b crosses the plane; add it if it is new."""
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
    return mesh_from_rows(np.array(points), np.array(made))


def mirror_and_join(
    quads: PolygonMesh, plane: MirrorPlane, edge: float, ends: Float[np.ndarray, "ends 3"] | None = None
) -> PolygonMesh:
    """Return a mesh of the quads of one half and their mirror images, joined along the plane.

    Parameters
    ----------
    quads : quads on one side of the plane
    plane : the mirror plane
    edge : typical length of a quad's edge, metres
    ends : points where the mesh's border meets the plane, metres; the nearest quad corners are moved there, as
        remeshers cut these corners off
    """
    sides = sides_of(quads)
    border = sides.edges[np.bincount(sides.edge, minlength=len(sides.edges)) == 1]
    heights = plane.signed_distances(quads.vertices)
    on_plane = np.zeros(len(heights), bool)
    on_plane[border] = True
    on_plane &= np.abs(heights) < AT_PLANE * edge
    points = quads.vertices - np.where(on_plane, heights, 0.0)[:, None] * plane.normal
    if ends is not None and len(ends) and on_plane.any():
        away, nearest = cKDTree(points[on_plane]).query(ends)
        near = away < edge
        points[np.flatnonzero(on_plane)[nearest[near]]] = ends[near]
    moved = replace(quads, vertices=points)
    both = concatenate_meshes([moved, plane.mirror(moved)])
    count = len(heights)
    index = np.arange(2 * count)
    index[count:][on_plane] = np.flatnonzero(on_plane)
    return mesh_from_rows(both.vertices, index[both.corners].reshape(-1, 4))


def euler_characteristic(mesh: PolygonMesh) -> int:
    """Return the Euler characteristic of a mesh; every slit left between two joined halves lowers it by one."""
    return len(np.unique(mesh.corners)) - len(sides_of(mesh).edges) + len(mesh.sizes)


def planes_preserving(mesh: PolygonMesh, planes: Sequence[MirrorPlane], extent: float) -> list[MirrorPlane]:
    """Return the planes that map a body onto itself.

    Parameters
    ----------
    mesh : the body
    planes : planes to test
    extent : size of the whole mesh, metres, to which the tolerance ``ALIKE`` refers
    """
    return [plane for plane in planes if plane.maps_onto(mesh, mesh, extent)]
