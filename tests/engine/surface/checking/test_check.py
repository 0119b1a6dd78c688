"""Every fault is found, named, and blamed on the right faces; good meshes pass."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.checking import geometry as check_geometry
from flexmaps.engine.surface.checking.topology import sides_of
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh
from hypothesis import given, settings
from hypothesis import strategies as st


def polygons(vertices, faces) -> PolygonMesh:
    corners = np.array([v for f in faces for v in f], dtype=np.int64)
    return PolygonMesh(np.asarray(vertices, float), corners, np.array([len(f) for f in faces], dtype=np.int64))


def of(mesh) -> PolygonMesh:
    return polygons(mesh.vertices, mesh.quads.tolist())


def grid(n=3, m=3):
    mesh_u, mesh_v = np.meshgrid(np.arange(n + 1) * 0.02, np.arange(m + 1) * 0.02, indexing="ij")
    vertices = np.stack([mesh_u.ravel(), mesh_v.ravel(), 0 * mesh_u.ravel()], axis=1)
    at = np.arange(vertices.shape[0]).reshape(n + 1, m + 1)
    faces = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    return vertices, faces.tolist()


def found(mesh: PolygonMesh, **kwargs) -> dict[str, check.Finding]:
    result = check.findings(mesh, **kwargs)
    severities = [f.severity for f in result]
    assert severities == sorted(severities)  # errors before warnings
    assert len({f.code for f in result}) == len(result)
    for finding in result:
        assert f"    {finding.code} " in check.__doc__
        assert "\n" not in finding.message
        assert all(0 <= f < len(mesh.sizes) for f in finding.faces)
        edges = sides_of(mesh).edges if finding.edges else []
        assert all(0 <= e < len(edges) for e in finding.edges)
        assert set(finding.as_dict()) == {"code", "severity", "message", "faces"}
    return {f.code: f for f in result}


def errors(mesh: PolygonMesh) -> set[str]:
    return {code for code, f in found(mesh).items() if f.is_error}


@pytest.mark.parametrize("name", shapes.NAMES)
def test_own_shapes_pass(name):
    mesh = shapes.make(name)
    result = found(of(mesh))
    assert set(result) <= {"several-bodies"}
    assert ("several-bodies" in result) == (name == "two_bodies")
    again = check.as_quad_mesh(of(mesh))
    np.testing.assert_array_equal(again.quads, mesh.quads)
    np.testing.assert_array_equal(again.vertices, mesh.vertices)


def test_turned_over_as_a_whole_is_fine():
    mesh = shapes.make("vault")
    assert not found(polygons(mesh.vertices, mesh.quads[:, ::-1].tolist()))
    sphere = shapes.make("cubesphere")
    result = found(polygons(sphere.vertices, sphere.quads[:, ::-1].tolist()))
    assert set(result) == {"inside-out"}
    assert len(result["inside-out"].faces) == 150


def test_nothing():
    assert errors(PolygonMesh(np.zeros((3, 3)), np.zeros(0, int), np.zeros(0, int))) == {"no-faces"}
    assert errors(PolygonMesh(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int))) == {"no-faces"}


def test_bad_index():
    vertices, faces = grid()
    faces[4][2] = 99
    result = found(polygons(vertices, faces))
    assert result["bad-index"].faces == (4,)


def test_arrays_of_scripts():
    vertices, faces = grid()
    good = polygons(vertices, faces)
    for corners, sizes in (
        (good.corners.tolist(), good.sizes.tolist()),
        (good.corners.astype("u1"), good.sizes.astype("i1")),
    ):
        mesh = check.with_numeric_arrays(PolygonMesh(vertices.tolist(), corners, sizes))
        assert not found(mesh)
        assert sides_of(mesh).edges.tolist() == sides_of(good).edges.tolist()
    for wrong in (
        PolygonMesh(vertices[:, :2], good.corners, good.sizes),
        PolygonMesh(vertices, good.corners.astype(float), good.sizes),
        PolygonMesh(vertices, good.corners.reshape(-1, 4), good.sizes),
        PolygonMesh([["x", 0, 0]], good.corners, good.sizes),
        PolygonMesh(None, None, None),
    ):
        with pytest.raises(FlexMapsError, match="needs vertices"):
            check.with_numeric_arrays(wrong)
    assert errors(PolygonMesh(vertices, good.corners, -good.sizes)) == {"bad-index"}
    assert errors(PolygonMesh(vertices, good.corners[1:], good.sizes)) == {"bad-index"}


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_not_finite(value):
    vertices, faces = grid()
    vertices[5, 1] = value  # an inner vertex of four faces
    result = found(polygons(vertices, faces))
    assert set(result) == {"not-finite"}
    assert result["not-finite"].faces == (0, 1, 3, 4)
    assert "1 vertex (" in result["not-finite"].message and "has a position" in result["not-finite"].message
    vertices, faces = grid()
    loose = polygons([*vertices, [value, 0, 0]], faces)
    assert set(found(loose)) == {"loose-vertices"}


def test_non_quads():
    vertices, faces = grid()
    faces[4:5] = [faces[4][:3], [faces[4][0], *faces[4][2:]]]
    result = found(polygons(vertices, faces))
    assert result["non-quad"].faces == (4, 5)
    assert "Quad remesh" in result["non-quad"].message
    assert "2 triangles" in result["non-quad"].message


def test_repeated_vertex_and_duplicates():
    vertices, faces = grid()
    faces[2][1] = faces[2][0]
    result = found(polygons(vertices, faces))
    assert result["repeated-vertex"].faces == (2,)
    vertices, faces = grid()
    faces.append([faces[7][k] for k in (2, 3, 0, 1)])
    result = found(polygons(vertices, faces))
    assert result["duplicate-faces"].faces == (9,)


def test_zero_edge_and_area():
    vertices, faces = grid()
    vertices[5] = vertices[6]
    result = found(polygons(vertices, faces))
    assert result["zero-edge"].is_error
    edge = sides_of(polygons(vertices, faces)).edges[result["zero-edge"].edges[0]]
    assert edge.tolist() == [5, 6]
    assert result["zero-edge"].faces == (1, 4)
    vertices, faces = grid()
    middle = vertices[faces[4]].mean(axis=0)
    vertices[faces[4]] = middle + np.array([[0, 0, 0], [0.01, 0, 0], [0.02, 0, 0], [0.013, 0, 0]])
    assert 4 in found(polygons(vertices, faces))["zero-area"].faces


def test_crossed_and_concave():
    vertices, faces = grid(1, 1)
    faces[0] = [faces[0][k] for k in (0, 2, 1, 3)]
    assert errors(polygons(vertices, faces)) == {"crossed"}  # though the two halves of the bow have no area together
    vertices[3] += [0.0, 0.01, 0]
    assert errors(polygons(vertices, faces)) == {"crossed"}
    vertices, faces = grid(1, 1)
    vertices[3] = [0.006, 0.006, 0]
    result = found(polygons(vertices, faces), edge=0.1)
    assert set(result) == {"concave"}
    assert not result["concave"].is_error


def test_a_crossed_quad_is_the_cause_of_a_body_with_one_side():
    vertices, faces = grid()
    faces[4] = [faces[4][k] for k in (0, 2, 1, 3)]
    result = found(polygons(vertices, faces))
    assert [code for code, f in result.items() if f.is_error] == ["crossed", "non-orientable"]
    assert result["crossed"].faces == (4,)


def test_neighbours_that_lie_on_each_other():
    vertices, faces = grid(2, 1)
    vertices[:, 0] = np.abs(vertices[:, 0] - 0.02)
    result = found(polygons(vertices, faces))
    assert set(result) == {"folded"}
    assert result["folded"].faces == (0, 1)
    vertices[0, 2] = vertices[1, 2] = 0.001  # a sharp fold is one that can be made
    assert set(found(polygons(vertices, faces))) == {"sharp-folds"}


@pytest.mark.parametrize("size", [1e-310, 1e-170, 1e-12, 1e12, 1e160, 8e307])
def test_any_unit_will_do_once_it_is_scaled(size):
    """Squares of such numbers are zero or infinite."""
    vertices, faces = grid(2, 2)
    mesh = polygons(vertices / 0.04 * size, faces)
    assert errors(mesh) == {"size"}
    assert check.median_edge(mesh) == pytest.approx(size / 2, rel=1e-3)  # the smallest numbers have few digits
    scaled = check.scale_to_metres(mesh, edge=0.02)
    assert not found(scaled)
    np.testing.assert_allclose(scaled.vertices, vertices, atol=1e-12 if size > 1e-300 else 1e-4)


@pytest.mark.parametrize("away", [1e9, 1e300])
def test_a_vertex_far_from_all_others(away):
    vertices, faces = grid()
    vertices[5, 1] = away
    result = found(polygons(vertices, faces))
    assert [code for code, f in result.items() if f.is_error] == ["far-vertices"]
    assert result["far-vertices"].faces == (0, 1, 3, 4)


def test_so_far_out_that_positions_are_rounded():
    vertices, faces = grid()
    assert not found(polygons(vertices + 1e6, faces))
    assert errors(polygons(vertices + 1e9, faces)) == {"far-from-origin"}


def test_warped():
    vertices, faces = grid(2, 1)
    vertices[0, 2] = 0.035
    result = found(polygons(vertices, faces))
    assert set(result) == {"warped", "sharp-folds"}
    assert result["warped"].faces == (0,)


def test_breadth():
    """Closed forms: of a rectangle the shorter side, of a rhombus of the angle t the side times tan(t / 2)."""
    t, turn = np.radians(35.0), np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    rectangle = np.array([(0, 0, 0), (3, 0, 0), (3, 2, 0), (0, 2, 0)], float)
    rhombus = np.array([(0, 0, 0), (1, 0, 0), (1 + np.cos(t), np.sin(t), 0), (np.cos(t), np.sin(t), 0)])
    wide = check_geometry.breadth(np.stack([rectangle, rhombus]) @ turn + 5.0)
    assert wide == pytest.approx([2.0, np.tan(t / 2)])


def test_thin():
    vertices, faces = grid(4, 3)
    at = {tuple(row): k for k, row in enumerate(np.round(vertices / 0.02).astype(int).tolist())}
    sliver = vertices.copy()
    sliver[[at[2, k, 0] for k in range(4)], 0] -= 0.0185
    result = found(polygons(sliver, faces))
    assert set(result) == {"thin", "small-quads"} and result["thin"].faces == (3, 4, 5)
    needle = vertices.copy()
    needle[at[1, 1, 0], :2], needle[at[2, 2, 0], :2] = (0.0295, 0.0295), (0.0305, 0.0305)
    result = found(polygons(needle, faces))
    assert "thin" in result and result["thin"].faces == (4,) and not result["thin"].is_error


def test_non_manifold_edge():
    vertices, faces = grid()
    a, b = faces[4][0], faces[4][1]
    vertices = [*vertices, vertices[a] + [0, 0, 0.02], vertices[b] + [0, 0, 0.02]]
    mesh = polygons(vertices, [*faces, [a, b, 17, 16]])
    result = found(mesh)
    assert result["non-manifold-edge"].faces == (1, 4, 9) or result["non-manifold-edge"].faces == (3, 4, 9)
    edge = sides_of(mesh).edges[result["non-manifold-edge"].edges[0]]
    assert edge.tolist() == sorted([a, b])


def test_bow_tie():
    vertices, faces = grid(2, 2)
    result = found(polygons(vertices, [faces[0], faces[3]]))
    assert result["non-manifold-vertex"].faces == (0, 1)
    # two tips that touch on one surface: also where the body hangs together elsewhere
    vertices, faces = grid(4, 4)
    ring = [f for f in faces if 12 not in f]
    merged = [[6 if v == 18 else v for v in f] for f in ring]
    assert "non-manifold-vertex" in errors(polygons(vertices, merged))


def test_one_turned_face_and_a_turned_half():
    vertices, faces = grid()
    faces[4] = faces[4][::-1]
    result = found(polygons(vertices, faces))
    assert result["inconsistent-orientation"].faces == (4,)
    assert len(result["inconsistent-orientation"].edges) == 4
    assert "Recalculate Outside" in result["inconsistent-orientation"].message
    vertices, faces = grid(5, 1)
    faces[3:] = [f[::-1] for f in faces[3:]]
    assert found(polygons(vertices, faces))["inconsistent-orientation"].faces == (3, 4)


def moebius(n=24, width=2):
    t, w = np.meshgrid(np.linspace(0, 2 * np.pi, n, endpoint=False), np.linspace(-1, 1, width + 1), indexing="ij")
    radius = 4 + w * np.cos(t / 2)
    vertices = np.stack([radius * np.cos(t), radius * np.sin(t), w * np.sin(t / 2)], axis=-1).reshape(-1, 3)
    at = np.arange(n * (width + 1)).reshape(n, -1)
    at = np.vstack([at, at[:1, ::-1]])
    faces = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    return polygons(vertices, faces.tolist())


def test_moebius_strip():
    assert errors(moebius()) == {"non-orientable"}
    with pytest.raises(FlexMapsError, match="Moebius") as caught:
        check.as_quad_mesh(moebius())
    assert len(caught.value.faces) == 48


def test_moebius_beside_a_sound_body():
    strip, sphere = moebius(), shapes.make("cubesphere", 1.0)
    shifted = sphere.quads + len(strip.vertices)
    both = polygons(
        np.vstack([strip.vertices, sphere.vertices + 20]), strip.corners.reshape(-1, 4).tolist() + shifted.tolist()
    )
    result = found(both)
    assert result["non-orientable"].faces == tuple(range(48))
    assert "inconsistent-orientation" not in result


def test_size_ratio():
    def stretched(ratio):
        x = np.cumsum(np.concatenate([[0], np.geomspace(1, ratio, 40)]))
        vertices, faces = grid(40, 40)
        vertices[:, 0], vertices[:, 1] = np.repeat(x, 41), np.tile(x, 41)
        return polygons(vertices, faces)

    assert "size-ratio" not in found(stretched(2))
    assert not found(stretched(6))["size-ratio"].is_error
    result = found(stretched(40))
    assert result["size-ratio"].is_error
    assert "Quad remesh" in result["size-ratio"].message
    assert 0 in result["size-ratio"].faces
    assert 1599 in result["size-ratio"].faces
    # oblong but equal faces are no matter of size
    vertices, faces = grid(10, 10)
    vertices[:, 0] *= 4
    assert "size-ratio" not in found(polygons(vertices, faces))


def test_small_quads_know_the_scale():
    mesh = of(shapes.make("vault", 0.02))
    assert "small-quads" not in found(mesh)
    small = found(mesh, edge=0.009)["small-quads"]
    assert len(small.faces) > 100
    assert "small-quads" not in found(mesh, edge=0.009 * small.growth_factor)
    assert "small-quads" in found(mesh, edge=0.009 * (small.growth_factor - 0.06))
    assert "small-quads" not in found(of(shapes.make("vault", 2.0)), edge=0.02)
    assert "small-quads" in found(check.scale_to_metres(mesh, edge=0.009))
    assert "small-quads" not in found(of(shapes.make("cubesphere", 0.015)))


def test_bodies_and_loose_vertices():
    result = found(of(shapes.make("two_bodies")))
    assert len(result["several-bodies"].faces) == 96  # the smaller one
    vertices, faces = grid()
    mesh = polygons(np.vstack([[[9.0, 9, 9]], vertices, [[8, 8, 8]]]), [[v + 1 for v in f] for f in faces])
    assert set(found(mesh)) == {"loose-vertices"}
    quads = check.as_quad_mesh(mesh)
    np.testing.assert_array_equal(quads.vertices, vertices)
    assert quads.quads.tolist() == faces
    assert np.unique(mesh.corners).tolist() == list(range(1, 17))
    np.testing.assert_array_equal(sides_of(mesh).edges - 1, quads.edges)


def test_first_error_is_raised_with_the_others_named():
    vertices, faces = grid()
    faces[0] = faces[0][:3]
    faces[4] = faces[4][::-1]
    with pytest.raises(FlexMapsError, match=r"not quads.*inconsistent-orientation") as caught:
        check.as_quad_mesh(polygons(vertices, faces))
    assert caught.value.faces == [0]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_orientation_against_brute_force(seed):
    """Turned faces are found exactly, up to turning over the whole body."""
    rng = np.random.default_rng(seed)
    mesh = shapes.make("cubesphere")
    turned = rng.random(len(mesh.quads)) < 0.3
    quads = np.where(turned[:, None], mesh.quads[:, ::-1], mesh.quads)
    result = found(polygons(mesh.vertices, quads.tolist()))
    assert result["inconsistent-orientation"].faces == tuple(np.flatnonzero(turned))


def test_shared_meshes(shared_meshes):
    def judged(name):
        return found(check.scale_to_metres(meshio.read_mesh(shared_meshes / name), edge=0.02))

    suzanne = judged("suzanne.obj")
    assert "32 triangles" in suzanne["non-quad"].message
    assert "3 separate bodies" in suzanne["non-quad"].message
    desk = judged("moebius_desk.obj")
    assert desk["size-ratio"].is_error
    assert "127 times" in desk["size-ratio"].message
    assert judged("stanford-bunny.obj")["non-quad"].is_error
    for name in (
        "bunny.obj",
        "spot.obj",
        "three_holes.obj",
        "cubesphere.obj",
        "vault.obj",
        "flower_cmc1.obj",
        "amo_quad.off",
    ):
        assert not any(f.is_error for f in judged(name).values()), name
    assert "6.14 times" in judged("spot.obj")["size-ratio"].message
