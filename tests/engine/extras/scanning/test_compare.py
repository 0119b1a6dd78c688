"""Scans made from surfaces, moved by poses that are known, and laid back over them; libigl's distances judge."""

from __future__ import annotations

from itertools import pairwise

import igl
import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.extras.scanning import compare, register, scan_reader
from flexmaps.engine.extras.scanning.poses import Poses, ScanFit
from flexmaps.engine.extras.scanning.scan_reader import Scan
from flexmaps.engine.extras.scanning.scan_target import ClosestPoints, TriangleSurface
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job, report
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh
from scipy.spatial.transform import Rotation


def true_points(mesh, count, random):
    """Points spread evenly over the triangles that libigl is asked about too."""
    of = random.choice(len(mesh.quads), count, p=mesh.areas / mesh.areas.sum())
    corners = np.where(random.random((count, 1)) < 0.5, mesh.quads[of][:, [0, 1, 2]], mesh.quads[of][:, [0, 2, 3]])
    return np.einsum("nk,nki->ni", random.dirichlet(np.ones(3), count), mesh.vertices[corners])


def scanned(mesh, degrees, seed, count=6000, table=True):
    """A scan without two fifths of the surface and a hole, with noise, a table below and outliers, moved; and its true points."""
    random = np.random.default_rng(seed)
    true = true_points(mesh, count, random)
    size = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    side = true @ random.normal(size=3)
    true = true[side < np.quantile(side, 0.6)]
    true = true[np.linalg.norm(true - true[0], axis=1) > 0.08 * size]
    noisy = true + 0.001 * size * random.normal(size=true.shape)
    outliers = true.mean(axis=0) + size * (random.random((200, 3)) - 0.5)
    low = np.column_stack(
        [true.mean(axis=0)[:2] + 0.6 * size * (random.random((1200, 2)) - 0.5), np.full(1200, true[:, 2].min())]
    )
    axis = random.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    shift = 0.1 * size * random.normal(size=3)
    parts = [noisy, outliers, low] if table else [noisy, outliers]
    return np.concatenate(parts) @ turn.T + shift, true @ turn.T + shift, size


def off(mesh, points):
    """RMS distance of points from the surface, by libigl."""
    triangles = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    return float(np.sqrt(igl.point_mesh_squared_distance(points, mesh.vertices, triangles)[0].mean()))


@pytest.fixture
def nearby(monkeypatch):
    """Fewer initial poses than a search needs that knows less of the scan, which is quicker."""
    monkeypatch.setattr(register, "TILTS", register.TILTS[:2])
    monkeypatch.setattr(register, "OFFSETS", (-0.125, 0.0, 0.125))


@pytest.mark.parametrize(
    ("name", "anywhere"),
    [
        ("dome", True),
        *(pytest.param(name, False, marks=pytest.mark.thorough) for name in ("vault", "saddle", "three_holes", "dome")),
        *(pytest.param(name, True, marks=pytest.mark.thorough) for name in ("vault", "saddle", "three_holes")),
    ],
)
def test_laid_back_over_the_surface(name, anywhere):
    mesh = shapes.make(name)
    scan, true, size = scanned(mesh, 130 if anywhere else 29, 1, max(6000, 24 * len(mesh.quads)))
    found = compare.compare_scan(mesh, Scan(scan, unit="m", anywhere=anywhere))
    assert off(mesh, true @ found.turn.T + found.shift) < 0.001 * size
    np.testing.assert_allclose(np.linalg.det(found.turn), 1.0)
    assert 0.5 < found.is_covered.mean() < 0.75  # three fifths, and the quads on the cut and around the hole
    assert found.rms < 0.001 * size and found.highest < 0.003 * size  # a median of points scatters less than they do
    assert found.noise == pytest.approx(0.001 * size, rel=0.3)
    beside = 1400 / len(scan)
    assert beside - 0.1 < 1 - found.used.mean() < beside + 0.1


@pytest.mark.parametrize("name", ["dome", pytest.param("torus", marks=pytest.mark.thorough)])
def test_a_table_and_a_wall_are_told_from_the_piece(name):
    """Both come close to parts that the scan does not show, and hold a smaller share of a dense scan than its noise may."""
    mesh = shapes.make(name)
    scan, true, size = scanned(mesh, 0, 3, 24 * len(mesh.quads))
    wall = true.mean(axis=0) + 0.6 * size * (np.random.default_rng(0).random((1500, 3)) - 0.5)
    wall[:, 0] = true[:, 0].min() - 0.02 * size
    found = compare.compare_scan(mesh, Scan(np.concatenate([scan, wall]), unit="m", anywhere=False))
    assert found.rms < 0.001 * size and found.highest < 0.003 * size


@pytest.mark.usefixtures("nearby")
def test_what_is_bent_is_measured():
    """A bump whose height is known shows in the distances, with its sign, and nothing else does."""
    mesh = shapes.make("vault")
    random = np.random.default_rng(3)
    true = true_points(mesh, 20_000, random)
    size = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    middle = mesh.centroids[len(mesh.quads) // 2]
    triangles = np.stack([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    index = igl.point_mesh_squared_distance(true, mesh.vertices, triangles)[1]

    def height(points):
        return 0.03 * size * np.exp(-((np.linalg.norm(points - middle, axis=1) / (0.12 * size)) ** 2))

    turn = Rotation.from_rotvec([0.1, -0.2, 0.2]).as_matrix()
    bent = true + height(true)[:, None] * mesh.normals[index // 2]
    found = compare.compare_scan(mesh, Scan(bent @ turn.T, unit="m", anywhere=False))
    np.testing.assert_allclose(found.distances, height(mesh.centroids), atol=0.003 * size)
    assert found.highest == pytest.approx(0.03 * size, rel=0.1)


@pytest.mark.usefixtures("nearby")
def test_units_are_guessed_or_asked_for():
    mesh = shapes.make("vault")
    scan, true, size = scanned(mesh, 10, 2, 3000, table=False)
    found = compare.compare_scan(mesh, Scan(1000 * scan, anywhere=False))
    assert found.scale == 0.001 and "millimetres" in found.remarks[0]
    assert off(mesh, 1000 * true * found.scale @ found.turn.T + found.shift) < 0.001 * size
    with pytest.raises(FlexMapsError, match="neither metres nor millimetres"):
        compare.compare_scan(mesh, Scan(scan / 0.0254, anywhere=False))


@pytest.mark.thorough
def test_inches_are_taken_as_told():
    mesh = shapes.make("vault")
    scan, _, size = scanned(mesh, 10, 2, 3000, table=False)
    inches = compare.compare_scan(mesh, Scan(scan / 0.0254, unit="in", anywhere=False))
    assert not any("taken to be" in text for text in inches.remarks) and inches.rms < 0.001 * size


@pytest.mark.usefixtures("nearby")
def test_a_scan_far_from_the_origin():
    """Surveyors' frames lie kilometres off."""
    mesh = shapes.make("saddle")
    scan, true, size = scanned(mesh, 20, 4)
    far = np.array([4e5, 5e6, 300.0])
    found = compare.compare_scan(mesh, Scan(scan + far, unit="m", anywhere=False))
    assert off(mesh, (true + far) @ found.turn.T + found.shift) < 0.001 * size


def test_what_is_no_scan_is_named(tmp_path):
    mesh = shapes.make("vault")
    with pytest.raises(FlexMapsError, match="only 0 points"):
        compare.compare_scan(mesh, Scan(np.zeros((0, 3))))
    with pytest.raises(FlexMapsError, match="Point 8 "):
        compare.compare_scan(mesh, Scan(np.where(np.arange(200)[:, None] == 7, np.nan, np.ones((200, 3)))))
    with pytest.raises(FlexMapsError, match="at one place"):
        compare.compare_scan(mesh, Scan(np.ones((200, 3))))
    with pytest.raises(FlexMapsError, match="another object"):
        line = np.linspace(0, 0.3, 500)[:, None] * [[1.0, 0.0, 0.0]]
        compare.compare_scan(mesh, Scan(line, unit="m", anywhere=False))
    with pytest.raises(FlexMapsError, match="not a readable scan"):
        scan_reader.read_scan(tmp_path / "scan.xyz")
    with pytest.raises(FlexMapsError, match="cannot be read"):
        scan_reader.read_scan(tmp_path / "scan.ply")
    (tmp_path / "scan.ply").write_text("")
    with pytest.raises(FlexMapsError, match="is empty"):
        scan_reader.read_scan(tmp_path / "scan.ply")
    with pytest.raises(FlexMapsError, match="not a unit of length"):
        scan_reader.read_scan(tmp_path / "scan.ply", "feet")


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("dome", "three_holes"),
        *(pytest.param(*names, marks=pytest.mark.thorough) for names in (("torus", "dome"), ("saddle", "cubesphere"))),
    ],
)
def test_another_object_is_refused(name, other):
    mesh, another = shapes.make(name), shapes.make(other)
    points = true_points(another, 5000, np.random.default_rng(0))
    points *= np.linalg.norm(np.ptp(mesh.vertices, axis=0)) / np.linalg.norm(np.ptp(another.vertices, axis=0))
    with pytest.raises(FlexMapsError, match="another object"):
        compare.compare_scan(mesh, Scan(points, unit="m", anywhere=False))


def test_points_alone_are_read_and_a_mesh_is_sampled(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    (tmp_path / "scan.ply").write_text(head + "0 0 0\n1 2 3\n")
    assert sorted(scan_reader.read_scan(tmp_path / "scan.ply").points.tolist()) == [[0, 0, 0], [1, 2, 3]]
    (tmp_path / "scan.obj").write_text("v 0 0 0\nv 3 0 0\nv 3 1 0\nv 0 1 0\nf 1 2 3 4\n")
    points = scan_reader.read_scan(tmp_path / "scan.obj").points
    np.testing.assert_allclose(points.mean(axis=0), [1.5, 0.5, 0.0], atol=0.02)  # even over both triangles
    np.testing.assert_allclose(points.var(axis=0), [9 / 12, 1 / 12, 0.0], rtol=0.03)
    (tmp_path / "scan.obj").write_text("v 0 0 0\nv 3 0 0\nv 3 1 0\nf 1 2 9\n")
    with pytest.raises(FlexMapsError, match="missing vertex"):
        scan_reader.read_scan(tmp_path / "scan.obj")


def test_distances_from_the_table_are_those_of_the_tree():
    mesh = shapes.make("torus")
    vertices = mesh.vertices - (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    surface = TriangleSurface.from_mesh(
        mesh.with_vertices(vertices), np.zeros(3), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    )
    points = np.random.default_rng(0).uniform(surface.vertices.min(axis=0), surface.vertices.max(axis=0), (3000, 3))
    squared = igl.point_mesh_squared_distance(points, surface.vertices, surface.triangles)[0]
    np.testing.assert_allclose(surface(points)[1], np.sqrt(squared), atol=1e-9)
    quick = np.abs(ClosestPoints(surface)(points)[1])
    assert np.quantile(np.abs(quick - np.sqrt(squared)), 0.9) < 0.003


def test_a_step_along_a_twist_is_the_matrix_exponential():
    from scipy.linalg import expm

    spin, speed = np.array([0.3, -0.5, 0.9]), np.array([0.2, 0.1, -0.4])
    about = np.array([[0.5, -0.2, 0.1]])
    start = Poses(Rotation.from_rotvec([[0.1, 0.2, 0.3]]).as_matrix(), np.array([[1.0, 2.0, 3.0]]))
    moved = start.screw(about, np.concatenate([spin, speed])[None])
    generator = np.zeros((4, 4))
    generator[:3, :3] = np.cross(np.eye(3), spin)
    generator[:3, 3] = speed
    screw = expm(generator)
    points = np.random.default_rng(0).normal(size=(5, 3))
    wanted = (start.apply(points)[0] - about) @ screw[:3, :3].T + screw[:3, 3] + about
    np.testing.assert_allclose(moved.apply(points)[0], wanted, atol=1e-12)


def test_the_cost_falls_as_its_gradient_says():
    """A Gauss-Newton step of a pose near the right one lessens the cost until it is at rest."""
    mesh = shapes.make("saddle")
    surface = TriangleSurface.from_mesh(
        mesh, mesh.vertices.mean(axis=0), float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    )
    points = true_points(mesh, 500, np.random.default_rng(1))
    points = (points - mesh.vertices.mean(axis=0)) / float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    fit = ScanFit(surface, points, np.ones(500))
    start = Poses(Rotation.from_rotvec([[0.02, -0.03, 0.01]]).as_matrix(), np.array([[0.01, 0.0, -0.01]]))
    cost = [float(fit.cost(fit.fit(start, 0.05, k), 0.05)[0]) for k in range(8)]
    assert all(b <= a + 1e-12 for a, b in pairwise(cost)) and cost[-1] < 1e-4 * cost[0]


def test_a_comparison_can_be_stopped():
    def tell(fraction, text):
        if fraction > 0.1:
            raise Cancelled

    with pytest.raises(Cancelled):
        compare.compare_scan(
            shapes.make("saddle"), Scan(scanned(shapes.make("saddle"), 10, 1)[0]), progress=Progress(tell)
        )


@pytest.mark.usefixtures("nearby")
def test_it_is_a_stage_that_a_new_simulation_drops():
    settings = ObjectSettings()
    made = job.run(PolygonMesh.from_quads(shapes.make("saddle")), settings, stop_after="spirals")
    with pytest.raises(FlexMapsError, match="no scan"):
        job.run_stages(made, settings, ("compare",))
    scan, _, _ = scanned(made.mesh, 15, 5, 3000)
    targeted = job.run_stages(made.with_user(scanned=Scan(scan, "my scan.ply", "m", False)), settings, ("compare",))
    block = report.build_report(targeted, source="saddle", settings=settings)["scan"]
    assert (
        block["file"] == "my scan.ply"
        and block["against"] == "target"
        and "Nothing was simulated" in block["remarks"][0]
    )
    assert block["max_percent"] >= block["rms_percent"] > 0 and block["rms_percent"] < 0.1
    assert targeted.scan is not None and not targeted.scan.simulated
    simulated = job.run_stages(targeted, settings, ("simulate",))
    assert simulated.scan is None
    again = job.run_stages(simulated, settings, ("compare",))
    assert again.without("simulation").scan is None
    assert again.scan.simulated and report.report_blocks(again, ("scan",))["scan"]["against"] == "simulated shape"
