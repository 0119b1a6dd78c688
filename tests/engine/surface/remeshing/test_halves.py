"""Quads of symmetric surfaces: made on one side of every mirror plane, and mirrored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.progress import Progress
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.checking.topology import bodies, sides_of
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.remeshing import halves, requad
from flexmaps.engine.surface.remeshing.mend import mesh_from_rows
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

TURN = Rotation.from_rotvec([0.3, 0.5, -0.8]).as_matrix()
X, Y, Z = np.eye(3)


class NoTool:
    """Makes triangles and no quads, so that those along the curvature are taken."""

    def triangles(self, mesh: PolygonMesh, near: float, progress: Progress) -> PolygonMesh:
        return mesh

    def intersecting_pairs(self, parts: list[PolygonMesh], progress: Progress) -> list[tuple[int, int]]:
        return []

    def quads(self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress) -> None:
        return None

    voxels = cells = lambda *_: None


def triangles(name: str) -> PolygonMesh:
    """The triangles of a shape, all cut along the same diagonal of their quads, which no mirror keeps."""
    mesh = shapes.make(name)
    return mesh_from_rows(mesh.vertices, np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]]))


def dented(mesh: PolygonMesh) -> PolygonMesh:
    """A surface with one vertex off its place by a hundredth of the extent."""
    points = mesh.vertices.copy()
    points[np.argmax(points @ (1.0, 0.7, -0.4))] += 0.01 * np.ptp(points, axis=0).max() * np.array([1.0, 0.5, 0.0])
    return replace(mesh, vertices=points)


@pytest.mark.parametrize(("name", "normals"), [("torus", (X, Y, Z)), ("saddle", (X, Y)), ("vault", (X, Y))])
def test_mirror_planes_are_found_wherever_a_surface_lies(name: str, normals: tuple[np.ndarray, ...]) -> None:
    mesh = triangles(name)
    mesh = replace(mesh, vertices=mesh.vertices + np.array([0.3, 1.0, -2.0]))
    assert sorted(map(tuple, np.abs([plane.normal for plane in halves.mirror_planes(mesh)]).round(6))) == sorted(
        map(tuple, normals)
    )
    turned = halves.mirror_planes(replace(mesh, vertices=mesh.vertices @ TURN.T))
    if name == "torus":  # the others' principal directions are any that lie in their plane
        assert any(abs(plane.normal @ TURN @ normal) > 1.0 - 1e-6 for plane in turned for normal in normals)
    assert not halves.mirror_planes(dented(mesh))


def test_a_half_ends_in_the_plane_and_has_half_of_the_area() -> None:
    mesh = triangles("torus")
    plane = halves.MirrorPlane(mesh.vertices.mean(axis=0), TURN[0])
    sides = [halves.cut_at_plane(mesh, halves.MirrorPlane(plane.point, way * plane.normal)) for way in (1.0, -1.0)]
    areas = []
    for side in sides:
        assert side is not None and requad.is_clean(side)
        edges = sides_of(side)
        border = np.unique(edges.edges[np.bincount(edges.edge) == 1])
        assert np.abs(plane.signed_distances(side.vertices[border])).max() < 1e-9
        areas.append(requad.target_surface(side).area)
    assert sum(areas) == pytest.approx(requad.target_surface(mesh).area)


def image_distance(mesh: PolygonMesh, plane: halves.MirrorPlane) -> float:
    """Metres: the largest distance of the middles of mirrored faces from those of faces."""
    middles = mesh.vertices[mesh.corners.reshape(-1, 4)].mean(axis=1)
    return float(
        cKDTree(middles).query(middles - 2.0 * plane.signed_distances(middles)[:, None] * plane.normal)[0].max()
    )


@pytest.mark.parametrize(("name", "count"), [("torus", 160), ("saddle", 120)])
def test_quads_of_a_symmetric_surface_are_symmetric_and_whole(name: str, count: int) -> None:
    mesh = triangles(name)
    made = requad.requad(mesh, count, NoTool(), symmetric=True).polygons
    planes, extent = halves.mirror_planes(mesh), float(np.ptp(mesh.vertices))
    assert planes and max(image_distance(made, plane) for plane in planes) < 1e-9 * extent
    assert not [finding for finding in check.findings(made) if finding.is_error]
    area = requad.target_surface(mesh).area
    assert requad.target_surface(made).area == pytest.approx(area, rel=0.08) and 0.6 < len(made.sizes) / count < 1.5
    if name == "torus":
        assert (np.bincount(sides_of(made).edge) == 2).all()
    lopsided = requad.requad(dented(mesh), count, NoTool(), symmetric=True).polygons
    assert max(image_distance(lopsided, plane) for plane in planes) > 1e-3 * extent


def test_corners_in_a_plane_are_kept() -> None:
    """A square cut along its diagonal has sharp corners there, which quads cut off."""
    square = mesh_from_rows(
        np.array([(-1, 0, 0), (0, -1, 0), (1, 0, 0), (0, 1, 0)], float), np.array([(0, 1, 2), (0, 2, 3)])
    )
    made = requad.requad(square, 80, NoTool(), symmetric=True).polygons
    assert requad.target_surface(made).area == pytest.approx(2.0, rel=0.01)
    assert max(image_distance(made, halves.MirrorPlane(np.zeros(3), normal)) for normal in (X, Y)) < 1e-9


def test_bodies_beside_a_plane_get_mirrored_quads() -> None:
    one = triangles("vault")
    one = replace(one, vertices=one.vertices @ TURN.T + (2.0, 0.0, 0.0))
    plane = halves.MirrorPlane(np.zeros(3), X)
    made = requad.requad(requad.concatenate_meshes([one, plane.mirror(one)]), 160, NoTool(), symmetric=True).polygons
    assert bodies(sides_of(made), len(made.sizes)).max() == 1
    assert image_distance(made, plane) < 1e-9


def test_what_halves_lack_is_not_what_a_body_lacks() -> None:
    """A ring with fewer quads than anything could have: the message names one reason, the whole body's."""
    with pytest.raises(FlexMapsError) as refused:
        requad.requad(triangles("torus"), 12, NoTool(), symmetric=True)
    assert str(refused.value).count("No sound quads were found") == 1 and "halves" not in str(refused.value)
