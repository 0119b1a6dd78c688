"""Regularising: squarer quads on the same surface."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.params import RegulariseParams
from flexmaps.engine.progress import Progress
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.checking.geometry import breadth
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import QuadMesh
from flexmaps.engine.surface.remeshing import regularise as regularising
from flexmaps.engine.surface.remeshing.guide import VertexConstraints, distances, sample_points
from flexmaps.engine.surface.remeshing.regularise import (
    BEND,
    GOOD,
    WARP,
    WORSE,
    bend_angles,
    best_squares,
    flatten_bent_quads,
    regularise,
    square_energy,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial import cKDTree

PARAMS = RegulariseParams()


def deviation(mesh: QuadMesh, other: QuadMesh) -> float:
    """The largest distance between two surfaces of the same quads, metres, measured from vertices and quad middles both ways."""
    return float(max(distances(mesh, sample_points(other)).max(), distances(other, sample_points(mesh)).max()))


def shaken(mesh: QuadMesh, amount: float, seed: int = 0) -> QuadMesh:
    """Inner vertices moved at random along the surface."""
    rng = np.random.default_rng(seed)
    normal = np.zeros_like(mesh.vertices)
    np.add.at(normal, mesh.quads, mesh.area_vectors[:, None])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    step = rng.uniform(-1, 1, mesh.vertices.shape) * amount * mesh.median_edge
    step -= np.einsum("vi,vi->v", step, normal)[:, None] * normal
    step[mesh.on_border] = 0
    return mesh.with_vertices(mesh.vertices + step)


def energy(mesh: QuadMesh) -> np.ndarray:
    return square_energy(mesh.vertices[mesh.quads])


def rect(a: float, b: float) -> np.ndarray:
    return np.array([[[0, 0, 0], [a, 0, 0], [a, b, 0], [0, b, 0]]], float)


def test_square_energy_closed_forms():
    assert square_energy(rect(3, 3))[0] == pytest.approx(0, abs=1e-12)
    stretch = np.sqrt(2)  # a 2 x 1 rectangle against the square of the same area
    assert square_energy(rect(2, 1))[0] == pytest.approx((stretch - 1) ** 2 + (1 / stretch - 1) ** 2)
    skewed = rect(1, 1) + np.array([[[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0]]])
    values = np.linalg.svd(np.array([[1, 1], [0, 1]]), compute_uv=False)
    assert square_energy(skewed)[0] == pytest.approx(((values - 1) ** 2).sum())


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_square_energy_against_singular_values(seed):
    """Any convex planar quad, turned in space, against numpy's SVD of the four corner maps."""
    rng = np.random.default_rng(seed)
    flat = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) + rng.uniform(-0.2, 0.2, (4, 2))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    side = np.sqrt(0.5 * abs(np.cross(flat[2] - flat[0], flat[3] - flat[1])))
    total = 0.0
    for k in range(4):
        map_ = np.stack([flat[(k + 1) % 4] - flat[k], flat[(k - 1) % 4] - flat[k]], axis=1) / side
        total += ((np.linalg.svd(map_, compute_uv=False) - 1) ** 2).sum() / 4
    corners = np.c_[flat, np.zeros(4)] @ turn.T
    assert square_energy(corners[None])[0] == pytest.approx(total, rel=1e-9)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_best_square_is_the_nearest(seed):
    rng = np.random.default_rng(seed)
    quad = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) + rng.uniform(-0.3, 0.3, (4, 3))
    square = best_squares(quad[None])[0]
    sides = np.roll(square, -1, axis=0) - square
    np.testing.assert_allclose(np.linalg.norm(sides, axis=1), np.linalg.norm(sides[0]))
    assert abs(sides[0] @ sides[1]) < 1e-12

    def distance(x):  # any square: middle, half a diagonal of any direction, and a turn about the normal to it
        half = x[3:6]
        other = np.cross(x[6:9] / np.linalg.norm(x[6:9]), half)
        other *= np.linalg.norm(half) / max(np.linalg.norm(other), 1e-12)
        return ((np.stack([x[:3] + d for d in (-half, -other, half, other)]) - quad) ** 2).sum()

    start = np.concatenate([quad.mean(0), (quad[2] - quad[0]) / 2, [0, 0, 1.0]])
    best = minimize(distance, start, method="BFGS", options={"gtol": 1e-9}).fun
    assert ((square - quad) ** 2).sum() == pytest.approx(best, rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("name", ["cubesphere", "torus", "vault", "saddle", "demo", "three_holes"])
def test_shaken_shapes_become_squarer(name):
    mesh = shaken(shapes.make(name), 0.2)
    better = regularise(mesh, PARAMS)
    before, after = energy(mesh), energy(better)
    assert np.median(after) < 0.7 * np.median(before)
    assert after.mean() < 0.8 * before.mean()
    assert (after <= np.maximum(1.1 * GOOD, 1.1 * WORSE * before)).all()
    assert (np.einsum("fi,fi->f", mesh.normals, better.normals) > 0.3).all()
    assert deviation(mesh, better) < 0.4 * mesh.median_edge


def test_a_shaken_plane_becomes_a_grid():
    u, v, quads = shapes._grid(8, 8)
    mesh = shaken(QuadMesh(np.stack([u, v, 0 * u], axis=1), quads), 0.3)
    better = regularise(mesh, RegulariseParams(iterations=600))
    assert energy(better).max() < 1e-6
    np.testing.assert_allclose(better.vertices, np.stack([u, v, 0 * u], axis=1), atol=2e-3)


def test_border_keeps_its_line_and_its_corners():
    mesh = shaken(shapes.make("vault"), 0.2)
    better = regularise(mesh, PARAMS)
    rim = mesh.edges[mesh.border]
    distance = igl.point_mesh_squared_distance(better.vertices[mesh.on_border], mesh.vertices, rim)[0]
    assert np.sqrt(distance).max() < 1e-9
    corners = mesh.valence == 2
    np.testing.assert_array_equal(better.vertices[corners], mesh.vertices[corners])
    moved = np.linalg.norm(better.vertices - mesh.vertices, axis=1)
    assert moved[mesh.on_border].max() > 0.01 * mesh.median_edge  # they do slide


def test_free_border():
    mesh = shaken(shapes.make("saddle"), 0.2)
    better = regularise(mesh, RegulariseParams(boundary=False))
    rim = mesh.edges[mesh.border]
    distance = igl.point_mesh_squared_distance(better.vertices[mesh.on_border], mesh.vertices, rim)[0]
    assert np.sqrt(distance).max() > 0.01 * mesh.median_edge


def test_creases_of_a_box_stay():
    mesh = shapes.voxels(np.ones((8, 6, 4), dtype=bool))
    mesh = mesh.with_vertices(mesh.vertices - mesh.vertices.min(axis=0))
    inside = ((mesh.vertices > 0) & (mesh.vertices < [8, 6, 4])).sum(axis=1)
    step = np.random.default_rng(0).uniform(-0.25, 0.25, mesh.vertices.shape)
    on_face = (mesh.vertices == 0) | (mesh.vertices == [8, 6, 4])
    step[on_face] = 0.0
    mesh = mesh.with_vertices(mesh.vertices + step)
    better = regularise(mesh, PARAMS)
    low, high = better.vertices.min(axis=0), better.vertices.max(axis=0)
    np.testing.assert_allclose([*low, *high], [0, 0, 0, 8, 6, 4], atol=1e-9)
    edges = inside == 1
    on_two = (np.isclose(better.vertices, 0, atol=1e-9) | np.isclose(better.vertices, [8, 6, 4], atol=1e-9)).sum(axis=1)
    assert (on_two[edges] == 2).all()
    assert (on_two[inside == 0] == 3).all()
    assert energy(better).mean() < 0.3 * energy(mesh).mean()


@pytest.mark.parametrize(
    ("name", "motions"),
    [
        ("vault", [np.diag([-1, 1, 1]), [[0, 1, 0], [1, 0, 0], [0, 0, 1]]]),
        ("torus", [np.diag([1, 1, -1]), np.diag([1, -1, 1])]),
        ("cubesphere", [np.diag([-1, 1, 1]), [[0, 1, 0], [0, 0, 1], [1, 0, 0]]]),
        ("saddle", [np.diag([-1, 1, 1])]),
        ("demo", [[[-0.5, np.sqrt(0.75), 0], [-np.sqrt(0.75), -0.5, 0], [0, 0, 1]], np.diag([1, -1, 1])]),
    ],
)
def test_symmetry_stays(name, motions):
    mesh = shapes.make(name)
    better = regularise(mesh, PARAMS)
    moved = np.linalg.norm(better.vertices - mesh.vertices, axis=1).max()
    assert moved > 0.01 * mesh.median_edge
    for motion in motions:
        for m in (mesh, better):
            gap = cKDTree(m.vertices).query(m.vertices @ np.asarray(motion, float).T)[0]
            assert gap.max() < 1e-9


def test_warped_quads_are_pressed_flat():
    mesh = shapes.make("vault")
    at = len(mesh.vertices) // 2
    vertices = mesh.vertices.copy()
    vertices[at, 2] += 1.2 * mesh.median_edge
    better = regularise(mesh.with_vertices(vertices), PARAMS)
    p = better.vertices[mesh.quads]
    off = 0.25 * np.abs(np.einsum("fi,fi->f", p[:, 0] - p[:, 1] + p[:, 2] - p[:, 3], better.normals))
    shortest = np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2).min(axis=1)
    assert (off <= 1.05 * WARP * shortest).all()


def test_lines_of_a_box():
    cube = shapes.voxels(np.ones((8, 6, 4), dtype=bool))
    guide = VertexConstraints.from_mesh(cube, True)
    assert guide.is_fixed.sum() == 8
    assert len(guide.sliding) == 4 * (7 + 5 + 3)
    assert len(guide.line_edges) == 4 * (8 + 6 + 4)


def test_nothing_to_do():
    mesh = shapes.make("vault")
    assert regularise(mesh, RegulariseParams(iterations=0)) is mesh
    single = shapes.make("quad")
    np.testing.assert_array_equal(regularise(single, PARAMS).vertices, single.vertices)
    np.testing.assert_array_equal(regularise(mesh, PARAMS).quads, mesh.quads)


def test_same_again():
    mesh = shaken(shapes.make("torus"), 0.2)
    np.testing.assert_array_equal(regularise(mesh, PARAMS).vertices, regularise(mesh, PARAMS).vertices)


def test_progress_and_cancel():
    told: list[float] = []
    regularise(shapes.make("saddle"), PARAMS, Progress(lambda fraction, text: told.append(fraction)))
    assert len(told) > PARAMS.iterations
    assert told == sorted(told)
    with pytest.raises(Cancelled):
        regularise(shapes.make("saddle"), PARAMS, Progress(stopped=lambda: len(told) > 0))


def test_scale_does_not_matter():
    mesh = shaken(shapes.make("demo", 1.0), 0.2)
    small = mesh.with_vertices(mesh.vertices * 1e-3)
    one, two = regularise(mesh, PARAMS), regularise(small, PARAMS)
    np.testing.assert_allclose(energy(one), energy(two), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "falls"),
    [
        ("bunny.obj", 0.6),
        ("vault.obj", 0.5),
        *(
            pytest.param(*one, marks=pytest.mark.thorough)
            for one in (("three_holes.obj", 0.6), ("spot.obj", 0.5), ("flower_cmc1.obj", 0.5), ("amo_quad.off", 0.65))
        ),
    ],
)
def test_shared_meshes(shared_meshes, name, falls):
    mesh = check.as_quad_mesh(check.scale_to_metres(meshio.read_mesh(shared_meshes / name), edge=0.02))
    better = regularise(mesh, PARAMS)
    before, after = energy(mesh), energy(better)
    assert np.median(after) < falls * np.median(before)
    assert np.percentile(after, 95) < np.percentile(before, 95)
    # pressing warped quads flat costs their neighbours a little
    assert (after <= np.maximum(GOOD, WORSE * before) + 0.1).all()
    assert ((after > np.maximum(GOOD, WORSE * before)).mean()) < 0.005
    assert (np.einsum("fi,fi->f", mesh.normals, better.normals) > 0).all()
    assert deviation(mesh, better) < 0.006


def test_no_quad_gets_less_room_for_a_spiral_than_the_narrowest_had():
    """A spoilt saddle: relative to the median edge, the least breadth does not fall and no edge becomes short."""
    mesh = shapes.make("saddle")
    rng = np.random.default_rng(5)
    inner = ~mesh.on_border
    points = mesh.vertices.copy()
    points[inner] += 0.45 * mesh.median_edge * rng.uniform(-1.0, 1.0, (int(inner.sum()), 3))
    mesh = mesh.with_vertices(points)
    better = regularise(mesh, PARAMS)
    rooms = [breadth(m.vertices[m.quads]).min() / m.median_edge for m in (mesh, better)]
    assert rooms[0] < 0.4 and rooms[1] >= rooms[0] * (1.0 - 1e-9)
    was_short, is_short = (m.edge_lengths < 0.3 * m.median_edge for m in (mesh, better))
    assert not (is_short & ~was_short).any()


def cap(sectors: int, rings: int, opening: float, height: float) -> QuadMesh:
    """A cap whose pole is surrounded by quads with two sides on the first ring; ``height`` is a ball's times this."""
    angle, turn = np.linspace(0, opening, rings + 1)[1:, None], 2 * np.pi * np.arange(sectors) / sectors
    ring = [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.repeat(height * np.cos(angle), sectors, 1)]
    points = np.vstack([[0.0, 0.0, height], np.stack(ring, axis=2).reshape(-1, 3)])
    at = 1 + np.arange(rings * sectors).reshape(rings, sectors)
    after = np.roll(at, -1, axis=1)
    around = np.stack([at[:-1], at[1:], after[1:], after[:-1]], axis=2).reshape(-1, 4)
    middle = np.column_stack([np.zeros(sectors // 2, int), at[0, ::2], at[0, 1::2], np.roll(at[0, ::2], -1)])
    mesh = QuadMesh(points, np.vstack([middle, around]))
    return mesh.with_vertices(points * 0.02 / mesh.median_edge)


@pytest.mark.parametrize("height", [1.0, 0.25], ids=["round", "shallow"])
@pytest.mark.parametrize(("sectors", "rings"), [(12, 7), (16, 8), (20, 12)])
def test_quads_at_a_pole_keep_their_room_and_those_around_become_squarer(sectors: int, rings: int, height: float):
    mesh = cap(sectors, rings, np.radians(80), height)
    better = regularise(mesh, PARAMS)
    before, after = (breadth(m.vertices[m.quads]) for m in (mesh, better))
    least = min(0.4, before.min() / mesh.median_edge)
    assert ((after / better.median_edge >= least) | (after >= before * (1.0 - 1e-9))).all()
    assert energy(better).mean() < 0.85 * energy(mesh).mean()
    outwards = better.vertices[better.quads].mean(axis=1) * [1.0, 1.0, 1.0 / height**2]  # the ellipsoid's normals
    assert (np.einsum("fi,fi->f", better.normals, outwards) > 0).all()


def test_bend_of_a_quad_is_the_turn_of_its_normals():
    """Two triangles that meet at an angle on a diagonal: the normals at the two other corners differ by it, neighbours by half."""
    for angle in (0.0, 0.2, 0.9):
        rise = np.tan(0.5 * angle) * np.sqrt(0.5)
        corners = np.array([[0, 0, 0], [1, 0, rise], [1, 1, 0], [0, 1, rise]], float)
        triangles = [np.cross(corners[a] - corners[b], corners[c] - corners[b]) for a, b, c in ((2, 1, 0), (0, 3, 2))]
        first, second = (one / np.linalg.norm(one) for one in triangles)
        assert np.arccos(np.clip(first @ second, -1, 1)) == pytest.approx(angle, abs=1e-7)
        beside = np.cross(corners[3] - corners[0], corners[1] - corners[0])
        between = np.arccos(np.clip(abs(first @ beside) / np.linalg.norm(beside), -1, 1))
        assert bend_angles(corners[None])[0] == pytest.approx(between, abs=1e-7)


@pytest.mark.parametrize("height", [0.6, 1.2])
def test_quads_that_bend_are_pressed_flat(height):
    mesh = shapes.make("vault")
    vertices = mesh.vertices.copy()
    vertices[len(vertices) // 2, 2] += height * mesh.median_edge
    bent = mesh.with_vertices(vertices)
    flat = flatten_bent_quads(bent)
    before, after = (bend_angles(m.vertices[m.quads]) for m in (bent, flat))
    assert before.max() > BEND and after.max() < before.max() and (after > BEND).sum() < (before > BEND).sum()
    np.testing.assert_array_equal(flat.vertices[mesh.on_border], bent.vertices[mesh.on_border])
    assert breadth(flat.vertices[mesh.quads]).min() >= 0.99 * min(
        breadth(bent.vertices[mesh.quads]).min(), mesh.median_edge
    )


@pytest.mark.parametrize("quads", [4, 6, 12])
def test_a_twisted_surface_stays_as_it_is(quads):
    """A hyperbolic paraboloid of few quads: all of them twist, none bends by more than the surface does."""
    across = np.linspace(-1.0, 1.0, quads + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(across, across, indexing="ij"))
    corner = (np.arange(quads)[:, None] * (quads + 1) + np.arange(quads)).ravel()
    mesh = QuadMesh(
        np.stack([x, y, x * y], 1), np.stack([corner, corner + quads + 1, corner + quads + 2, corner + 1], 1)
    )
    assert flatten_bent_quads(mesh) is mesh


@pytest.mark.parametrize("rounds", [3, regularising.MENDING - 1, regularising.MENDING])
def test_a_repair_gives_up_only_what_stays_spoilt(rounds: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: the first quad of a strip stays spoilt for so many rounds, and nothing else moves."""
    mesh = shapes.strip(40, 1)
    moved, told, asked = mesh.vertices + np.array([0.0, 0.0, 1e-3]), list[float](), list[int]()

    class Still:
        def __init__(self) -> None:
            self.mesh = mesh

        def move_towards(self, points: np.ndarray, _: np.ndarray) -> np.ndarray:
            return points

    def spoilt(_: QuadMesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(0)
        none = np.zeros(len(mesh.quads), dtype=bool)
        return (np.arange(len(mesh.quads)) == 0) & (len(asked) <= rounds), none

    monkeypatch.setattr(regularising, "_spoilt_quads", spoilt)
    hold = regularising._MoveWeights(mesh, np.ones(len(mesh.quads)), np.zeros(len(mesh.vertices)))
    tell = Progress(lambda fraction, words: told.append(fraction))
    points = regularising._repair_spoilt_quads(moved, hold, Still(), tell)
    assert told == sorted(set(told)) and told[0] >= 0.0 and told[-1] < 1.0
    returned = (points == mesh.vertices).all(axis=1)
    first, last = mesh.quads[0], mesh.quads[-1]
    if rounds == 3:
        assert not returned.any()
    else:
        assert returned[first].all() and returned[last].all() == (rounds == regularising.MENDING)


@pytest.mark.parametrize(("shift", "expected"), [((0, 0, 0.3), "away"), ((0, 0, 0.2), ""), ((0.4, 0.4, 0), "worse")])
def test_quads_are_spoilt_whose_corner_leaves_the_surface_or_that_are_less_square(shift, expected) -> None:
    """Squares of 20 mm in a plane: one corner is lifted by a little more or less than a quarter of a side, or moved aside."""
    x, y = np.meshgrid(np.arange(7.0), np.arange(7.0), indexing="ij")
    at = np.arange(49).reshape(7, 7)
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    flat = QuadMesh(0.02 * np.column_stack([x.ravel(), y.ravel(), np.zeros(49)]), quads)
    points = flat.vertices.copy()
    points[24] += 0.02 * np.array(shift)
    around = (quads == 24).any(axis=1)
    for name, mask in zip(("worse", "away"), regularising._spoilt_quads(flat, points), strict=True):
        assert (mask == (around & (name == expected))).all()
