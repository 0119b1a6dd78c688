"""Soups, doubled vertices, T-junctions, doubled shells and surfaces through themselves: found by name, and cured."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking.check import as_quad_mesh, findings
from flexmaps.engine.surface.checking.overlaps import overlap_findings
from flexmaps.engine.surface.checking.sewing import sew
from flexmaps.engine.surface.checking.t_junctions import t_junctions
from flexmaps.engine.surface.checking.topology import bodies, orientation_faults, sides_of
from flexmaps.engine.surface.far import recentre, rounding_step
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.welding import weld

NAMES = [name for name in shapes.NAMES if name != "quad"]


def euler(mesh: PolygonMesh) -> int:
    sides = sides_of(mesh)
    return len(np.unique(mesh.corners)) - len(sides.edges) + len(mesh.sizes)


def triangles(name: str) -> PolygonMesh:
    mesh = shapes.make(name)
    rows = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    return PolygonMesh(mesh.vertices, rows.ravel(), np.full(len(rows), 3))


def quads(name: str) -> PolygonMesh:
    return PolygonMesh.from_quads(shapes.make(name))


def soup(mesh: PolygonMesh, noise: float, seed: int) -> PolygonMesh:
    """Every face with corners of its own, moved by so many median edges."""
    random = np.random.default_rng(seed)
    edge = float(np.median(np.linalg.norm(np.diff(mesh.vertices[sides_of(mesh).edges], axis=1)[:, 0], axis=1)))
    points = mesh.vertices[mesh.corners]
    points = points + noise * edge * random.normal(size=points.shape)
    return PolygonMesh(points, np.arange(len(points)), mesh.sizes)


def joined(*parts: PolygonMesh) -> PolygonMesh:
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    corners = [part.corners + k for part, k in zip(parts, first, strict=False)]
    vertices, sizes = [part.vertices for part in parts], [part.sizes for part in parts]
    return PolygonMesh(np.concatenate(vertices), np.concatenate(corners), np.concatenate(sizes))


def codes(mesh: PolygonMesh) -> set[str]:
    return {one.code for one in overlap_findings(mesh)}


@pytest.mark.parametrize("noise", [1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 3e-3, 5e-3])
@pytest.mark.parametrize("name", NAMES)
def test_soups_come_back_whole(name: str, noise: float) -> None:
    for mesh in (triangles(name), quads(name)):
        made = weld(soup(mesh, noise, 1))
        assert euler(made) == euler(mesh)
        assert sides_of(made).edges.shape == sides_of(mesh).edges.shape


def test_two_corners_of_a_face_are_never_one() -> None:
    """A sliver's short side is shorter than the distance within which corners are joined."""
    mesh = triangles("dome")
    vertices = np.concatenate([mesh.vertices, mesh.vertices[[0, 0]] + np.array([[0, 0, 1e-6], [0, 0.01, 0]])])
    n = len(mesh.vertices)
    made = weld(PolygonMesh(vertices, np.concatenate([mesh.corners, [0, n, n + 1]]), np.append(mesh.sizes, 3)))
    assert len(set(made.corners[-3:].tolist())) == 3


def test_a_binary_stl_with_noise(tmp_path: Path) -> None:
    mesh = soup(triangles("dome"), 1e-4, 2)
    records = np.zeros(len(mesh.sizes), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("m", "<u2")])
    records["c"] = mesh.vertices.reshape(-1, 3, 3)
    path = tmp_path / "a.stl"
    path.write_bytes(b" " * 80 + struct.pack("<I", len(records)) + records.tobytes())
    assert euler(meshio.read_mesh(path)) == euler(triangles("dome"))


# -- borders that are not joined -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_quads_with_vertices_of_their_own(name: str) -> None:
    mesh = quads(name)
    apart = soup(mesh, 0.0, 0)
    assert "doubled-vertices" in codes(apart)
    assert any("Merge by Distance" in one.message for one in overlap_findings(apart))
    made = sew(apart)
    assert euler(made) == euler(mesh) and [code for code, _ in made.repairs] == ["doubled-vertices"]
    assert sew(mesh) is mesh and not codes(mesh)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("axis", [0, 1])
def test_halves_that_are_not_merged(name: str, axis: int) -> None:
    mesh = quads(name)
    side = mesh.vertices[mesh.corners.reshape(-1, 4)].mean(axis=1)[:, axis] > mesh.vertices[:, axis].mean()
    halves = joined(mesh.subset(side), mesh.subset(~side))
    assert "doubled-vertices" in codes(halves)
    assert euler(sew(halves)) == euler(mesh)


def test_what_joining_would_spoil_stays_apart() -> None:
    """Three sheets that meet at an edge, and a shell that is there twice."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    turned = [square * (np.cos(t), 1, 1) + np.outer(square[:, 0], (0, 0, np.sin(t))) for t in (0, 2, 4)]
    sheets = joined(*(PolygonMesh(p, np.arange(4), np.array([4])) for p in turned))
    assert sew(sheets) is sheets


# -- T-junctions -----------------------------------------------------------------------------------------------------------


def finer(mesh: PolygonMesh, faces: np.ndarray) -> PolygonMesh:
    """Some quads cut into four: where they meet others there are T-junctions."""
    points, rows = [*mesh.vertices], []
    middles: dict[tuple[int, int], int] = {}

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in middles:
            middles[key] = len(points)
            points.append(0.5 * (points[a] + points[b]))
        return middles[key]

    for number, row in enumerate(mesh.corners.reshape(-1, 4).tolist()):
        if not faces[number]:
            rows.append(row)
            continue
        sides = [middle(row[k], row[(k + 1) % 4]) for k in range(4)]
        points.append(np.mean([points[v] for v in row], axis=0))
        rows += [[row[k], sides[k], len(points) - 1, sides[k - 1]] for k in range(4)]
    return PolygonMesh(np.array(points), np.array(rows).ravel(), np.full(len(rows), 4))


@pytest.mark.parametrize("name", NAMES)
def test_t_junctions_are_found_and_named(name: str) -> None:
    mesh = quads(name)
    some = np.zeros(len(mesh.sizes), bool)
    some[len(some) // 2] = True
    made = finer(mesh, some)
    sides = sides_of(mesh)
    inner = np.bincount(sides.edge)[sides.edge[4 * (len(some) // 2) :][:4]] == 2
    assert len(t_junctions(made, sides_of(made)).vertex) == inner.sum()
    found = next(one for one in overlap_findings(made) if one.code == "t-junction")
    assert "T-junction" in found.message and "mm" in found.message and len(found.faces) == inner.sum()
    assert "V in Blender" not in found.message


@pytest.mark.parametrize("name", NAMES)
def test_t_junctions_are_cured(name: str) -> None:
    """By carrying the cuts on, which keeps quads and area, or by faces of more corners, which hang together again."""
    mesh = quads(name)
    some = np.zeros(len(mesh.sizes), bool)
    some[len(some) // 2] = True
    made = sew(finer(mesh, some))
    assert [code for code, _ in made.repairs] == ["t-junction"]
    assert euler(made) == euler(mesh)
    assert bodies(sides_of(made), len(made.sizes)).max() == bodies(sides_of(mesh), len(mesh.sizes)).max()
    if (made.sizes == 4).all():
        assert len(made.sizes) < 1.1 * len(mesh.sizes)
        assert not [one for one in findings(made) if one.is_error and one.code != "size-ratio"]
        bare = replace(made, repairs=())
        assert as_quad_mesh(bare).areas.sum() == pytest.approx(shapes.make(name).areas.sum(), rel=0.02)
    assert not {"t-junction", "doubled-vertices"} & codes(replace(made, repairs=()))


def test_cuts_end_in_faces_of_five_corners_where_three_faces_meet_at_an_edge() -> None:
    """A sheet of 24 by 24 quads, one of them finer, without a fin on an edge elsewhere and with one."""
    mesh = PolygonMesh.from_quads(shapes.strip(24, 24))
    a, b = sides_of(mesh).edges[sides_of(mesh).edge[1]]
    up = mesh.vertices[[b, a]] + [0.0, 0.0, np.linalg.norm(mesh.vertices[a] - mesh.vertices[b])]
    fin = [a, b, len(mesh.vertices), len(mesh.vertices) + 1]
    finned = PolygonMesh(
        np.concatenate([mesh.vertices, up]), np.concatenate([mesh.corners, fin]), np.append(mesh.sizes, 4)
    )
    assert (np.bincount(sides_of(finned).edge) == 3).sum() == 1
    for one, corners in ((mesh, {4}), (finned, {4, 5})):
        cured = sew(finer(one, np.arange(len(one.sizes)) == 300))
        assert set(cured.sizes.tolist()) == corners and [code for code, _ in cured.repairs] == ["t-junction"]


def test_triangles_beside_finer_ones() -> None:
    mesh = triangles("dome")
    row = mesh.corners[:3].tolist()
    points = np.concatenate([mesh.vertices, [mesh.vertices[row[:2]].mean(axis=0)]])
    n = len(mesh.vertices)
    corners = np.concatenate([[row[0], n, row[2], n, row[1], row[2]], mesh.corners[3:]])
    made = sew(PolygonMesh(points, corners, np.append(mesh.sizes, 3)))
    assert euler(made) == euler(mesh)


# -- in one place ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_shell_that_is_there_twice(name: str) -> None:
    mesh = quads(name)
    twice = joined(mesh, mesh)
    found = next(one for one in overlap_findings(twice) if one.code == "doubled-faces")
    assert f"{2 * len(mesh.sizes)} faces (" in found.message and "lie on faces of another shell" in found.message
    made = sew(twice)
    assert len(made.sizes) == len(mesh.sizes) and euler(made) == euler(mesh)


@pytest.mark.parametrize("name", NAMES)
def test_both_skins_of_a_thin_shell(name: str) -> None:
    """Closed at its border as Solidify does; what was closed before becomes two bodies, each with a skin of its own."""
    mesh = quads(name)
    made = shapes.make(name)
    normal = np.zeros_like(made.vertices)
    for k in range(4):
        np.add.at(normal, made.quads[:, k], made.normals)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    inner = PolygonMesh(mesh.vertices - 0.1 * made.median_edge * normal, made.quads[:, ::-1].ravel(), mesh.sizes)
    thick = joined(mesh, inner)
    rim = made.edges[made.border]
    ahead = made.edge_quads[made.border][:, 0] >= 0
    rim = np.where(ahead[:, None], rim, rim[:, ::-1])
    n = len(mesh.vertices)
    wall = np.stack([rim[:, 1], rim[:, 0], rim[:, 0] + n, rim[:, 1] + n], axis=1)
    thick = PolygonMesh(
        thick.vertices, np.append(thick.corners, wall.ravel()), np.append(thick.sizes, np.full(len(wall), 4))
    )
    if len(rim):
        assert "double-skin" in codes(thick)
    assert "double-skin" not in codes(mesh)


@pytest.mark.parametrize("way", [(1, 0, 0), (0, 0, 1), (1, 1, 0), (0.3, 0.5, 0.9)])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.97, 1.01, 1.5])
def test_a_surface_through_another(way: tuple[float, float, float], share: float) -> None:
    """Two balls cut each other until they are a diameter apart; corners lie on the ball, faces a little inside."""
    mesh = quads("cubesphere")
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    radius = np.linalg.norm(mesh.vertices - middle, axis=1).max()
    step = 2 * radius * share * np.array(way) / np.linalg.norm(way)
    found = [
        one
        for one in overlap_findings(joined(mesh, replace(mesh, vertices=mesh.vertices + step)))
        if one.code == "bodies-cross"
    ]
    if share < 0.95 or share > 1.0:
        assert bool(found) == (share < 1.0)
    assert all("go through each other" in one.message and "mm" in one.message for one in found)


def test_a_ring_that_overlaps_itself() -> None:
    turns = np.linspace(0, 2 * np.pi * 1.13, 24)
    wall = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    points = np.concatenate([0.1 * wall + (0, 0, z) for z in (0, 0.02, 0.04)])
    k = np.arange(23)
    rows = np.concatenate([np.stack([k, k + 1, k + 25, k + 24], axis=1) + 24 * j for j in (0, 1)])
    mesh = PolygonMesh(points, rows.ravel(), np.full(len(rows), 4))
    assert "cuts-itself" in codes(mesh)


def strip(surface: Any, columns: int, rows: int, closed: bool = False) -> PolygonMesh:
    """Quads over the unit square, of points ``surface(u, v)``; ``closed``: u runs around."""
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.arange(columns + (not closed)) / columns, indexing="ij")
    width, (j, i) = u.shape[1], np.indices((rows, columns))
    right = (i + 1) % width
    corners = np.stack([j * width + i, j * width + right, (j + 1) * width + right, (j + 1) * width + i], axis=-1)
    points = np.stack(np.broadcast_arrays(*surface(u, v)), axis=-1).reshape(-1, 3)
    return PolygonMesh(points, corners.ravel(), np.full(columns * rows, 4))


def ring(turns: float, columns: int, rise: float = 0.0) -> PolygonMesh:
    angle = 2 * np.pi * turns
    return strip(lambda u, v: (0.1 * np.cos(angle * u), 0.1 * np.sin(angle * u), 0.06 * v + rise * u), columns, 3)


def sheet(y: float) -> PolygonMesh:
    """An upright square across the plane z = 0."""
    return strip(lambda u, v: (0.2 * u - 0.1, y, 0.2 * v - 0.1), 8, 8)


FLOOR = strip(lambda u, v: (0.2 * u - 0.1, 0.2 * v - 0.1, 0.0), 8, 8)
THEMSELVES = {
    "a ring with other columns where it overlaps": ring(400 / 360, 33),
    "a ring of two turns": ring(2.0, 60),
    "a ring that rises in its own wall": ring(420 / 360, 35, 0.01),
    "a flat ring": strip(
        lambda u, v: ((0.06 + 0.06 * v) * np.cos(7 * u), (0.06 + 0.06 * v) * np.sin(7 * u), 0.0), 33, 3
    ),
    "a figure of eight": strip(
        lambda u, v: (0.1 * np.sin(2 * np.pi * u), 0.1 * np.sin(4 * np.pi * u), 0.1 * v), 41, 5, closed=True
    ),
    "a figure of eight that crosses along edges": strip(
        lambda u, v: (0.1 * np.sin(2 * np.pi * u), 0.1 * np.sin(4 * np.pi * u), 0.1 * v), 40, 5, closed=True
    ),
}
BODIES = {
    "sheets with ends beside each other": joined(FLOOR, sheet(0.003)),
    "sheets that cross along edges": joined(FLOOR, sheet(0.0)),
}


@pytest.mark.parametrize("name", [*THEMSELVES, *BODIES])
def test_a_surface_through_itself_is_named_and_not_sewn(name: str) -> None:
    mesh = (THEMSELVES | BODIES)[name]
    made = sew(mesh)
    assert not made.repairs and made.corners is mesh.corners
    assert codes(mesh) == {"cuts-itself" if name in THEMSELVES else "bodies-cross"}


@pytest.mark.parametrize("name", BODIES)
def test_a_body_through_itself_is_told_apart_from_bodies_through_each_other(name: str) -> None:
    """Each finding names the faces of its own kind."""
    own = THEMSELVES["a figure of eight that crosses along edges"]
    aside = replace(own, vertices=own.vertices + np.array([1.0, 0.0, 0.0]))
    found = {one.code: one for one in overlap_findings(joined(BODIES[name], aside))}
    sheets = len(BODIES[name].sizes)
    assert set(found) == {"cuts-itself", "bodies-cross"}
    assert min(found["cuts-itself"].faces) >= sheets > max(found["bodies-cross"].faces)
    halves = np.array(found["bodies-cross"].faces) < len(FLOOR.sizes)
    assert halves.any() and not halves.all()  # faces of both


def test_a_half_that_faces_the_other_way_is_turned_over() -> None:
    mesh = quads("dome")
    side = mesh.vertices[mesh.corners.reshape(-1, 4)].mean(axis=1)[:, 0] < 0
    other = mesh.subset(~side)
    made = sew(joined(mesh.subset(side), replace(other, corners=other.corners.reshape(-1, 4)[:, ::-1].ravel())))
    assert euler(made) == euler(mesh) and "Merge by Distance" in made.repairs[0][1]
    sides = sides_of(made)
    assert not len(orientation_faults(sides, bodies(sides, len(made.sizes)))[0])


def test_a_shell_that_is_there_twice_in_other_faces() -> None:
    made = sew(joined(quads("dome"), triangles("dome")))
    assert len(made.sizes) == len(quads("dome").sizes) and "lie on each other" in made.repairs[0][1]


# -- far away -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("far", [(0, 0, 0), (447993, 5410993, 306), (1e7, -1e7, 1e7), (5, 0, 0)])
@pytest.mark.parametrize("ending", [".obj", ".off", ".ply", ".stl"])
def test_text_files_far_away_are_read_to_a_hundredth_of_a_millimetre(tmp_path: Path, ending: str, far: tuple) -> None:
    mesh = triangles("dome")
    points = mesh.vertices + far
    path = tmp_path / f"a{ending}"
    rows = mesh.corners.reshape(-1, 3)
    lines = ["{:.9f} {:.9f} {:.9f}".format(*p) for p in points]
    if ending == ".obj":
        text = "\n".join([*(f"v {line}" for line in lines), *("f {} {} {}".format(*(row + 1)) for row in rows)])
    elif ending == ".off":
        text = "\n".join([f"OFF\n{len(lines)} {len(rows)} 0", *lines, *("3 {} {} {}".format(*row) for row in rows)])
    elif ending == ".ply":
        head = f"ply\nformat ascii 1.0\nelement vertex {len(lines)}\nproperty float x\nproperty float y\nproperty float z\n"
        head += f"element face {len(rows)}\nproperty list uchar int vertex_indices\nend_header"
        text = "\n".join([head, *lines, *("3 {} {} {}".format(*row) for row in rows)])
    else:
        facets = (
            "facet normal 0 0 1\nouter loop\n{}\nendloop\nendfacet".format("\n".join(f"vertex {lines[v]}" for v in row))
            for row in rows
        )
        text = "\n".join(["solid a", *facets, "endsolid a"])
    path.write_text(text + "\n")
    read = meshio.read_upright(str(path), "z")[1]
    assert not read.left_out
    a, b = (one.vertices[one.corners] - one.vertices[one.corners].mean(axis=0) for one in (read, mesh))
    assert np.abs(a - b).max() < 1e-5
    if max(map(abs, far)) > 100:
        assert np.abs(read.vertices).max() < 1.0


def test_what_was_rounded_before_is_said(tmp_path: Path) -> None:
    mesh = soup(triangles("dome"), 0.0, 0)
    for far, told in ((0.0, False), (5.0, False), (5e5, True)):
        records = np.zeros(len(mesh.sizes), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("m", "<u2")])
        records["c"] = (10 * mesh.vertices + far).reshape(-1, 3, 3)
        path = tmp_path / "a.stl"
        path.write_bytes(b" " * 80 + struct.pack("<I", len(records)) + records.tobytes())
        left = meshio.read_mesh(path).left_out
        assert any("stored to 0.031" in text for text in left) == told
    assert rounding_step(np.zeros((0, 3))) == 0.0 == rounding_step(np.full((2, 3), np.nan))


def test_near_pieces_stay_where_they_are() -> None:
    mesh = quads("dome")
    assert recentre(mesh) is mesh
    near = replace(mesh, vertices=mesh.vertices + 1.0)
    assert recentre(near) is near
