"""Quads of any mesh: what is done with bodies, holes and folded quads, whatever tool makes them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.checking.topology import bodies, sides_of
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.remeshing import coverage, requad, soundness
from flexmaps.engine.surface.remeshing.mend import TargetSurface, mend_quads, mesh_from_rows

RADIUS = 0.5
OWN = requad.CURVATURE_ATTEMPTS


def box(n: int) -> tuple[np.ndarray, np.ndarray]:
    """A cube's surface in n x n quads a side, about the origin: vertices and quads."""
    grid = np.arange(n + 1)
    a, b = (x.ravel() for x in np.meshgrid(grid, grid, indexing="ij"))
    points, rows = [], []
    for axis in range(3):
        for end in (0, n):
            p = np.stack([np.full(len(a), end), a, b], axis=1)
            first = len(np.concatenate(points)) if points else 0
            points.append(np.roll(p, axis, axis=1))
            k = first + (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
            quad = np.stack([k, k + n + 1, k + n + 2, k + 1], axis=1)
            rows.append(quad if end else quad[:, ::-1])
    places, index = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return 2.0 * places / n - 1.0, index.reshape(-1)[np.concatenate(rows)]


def ball(n: int, centre: tuple[float, float, float] = (0.0, 0.0, 0.0), radius: float = RADIUS) -> PolygonMesh:
    points, rows = box(n)
    return mesh_from_rows(radius * points / np.linalg.norm(points, axis=1)[:, None] + centre, rows)


def halved(mesh: PolygonMesh) -> PolygonMesh:
    rows = mesh.corners.reshape(-1, 4)
    return mesh_from_rows(mesh.vertices, np.concatenate([rows[:, [0, 1, 2]], rows[:, [0, 2, 3]]]))


def both(*meshes: PolygonMesh) -> PolygonMesh:
    return requad.concatenate_meshes(list(meshes))


@pytest.fixture(autouse=True)
def _first_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tool's first sound answer is taken; what is chosen among several has tests of its own."""
    monkeypatch.setattr(requad, "MIN_ATTEMPTS", 1)
    monkeypatch.setattr(requad, "CURVATURE_ATTEMPTS", ())


class Balls:
    """A tool that knows balls alone, and notes what it was given; ``parts`` of its first answers lack the bottom."""

    def __init__(self, cutting: tuple[tuple[int, int], ...] = (), hopeless: int = 0, parts: int = 0):
        self.given: list[tuple[float, int]] = []
        self.cutting, self.hopeless, self.parts = list(cutting), hopeless, parts

    def triangles(self, mesh: PolygonMesh, near: float, progress: Progress) -> PolygonMesh:
        return mesh if (mesh.sizes == 3).all() else halved(mesh)

    def intersecting_pairs(self, parts: list[PolygonMesh], progress: Progress) -> list[tuple[int, int]]:
        return self.cutting

    def quads(self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress) -> PolygonMesh | None:
        extent = float(np.ptp(body.vertices, axis=0).max())
        self.given.append((extent, count))
        if len(self.given) <= self.hopeless:
            return None
        middle = 0.5 * (body.vertices.max(axis=0) + body.vertices.min(axis=0))
        made = ball(max(2, round((count / 6) ** 0.5)), tuple(middle), extent / 2)
        rows = made.corners.reshape(-1, 4)
        lacking = len(self.given) <= self.parts
        return mesh_from_rows(made.vertices, rows[made.vertices[rows].mean(axis=1)[:, 2] > -0.4]) if lacking else made

    def voxels(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        return None

    cells = voxels


def spread(quads: PolygonMesh) -> np.ndarray:
    return np.bincount(bodies(sides_of(quads), len(quads.sizes)))


def test_every_body_gets_its_share_by_area() -> None:
    mesh = both(ball(8), ball(8, (3.0, 0.0, 0.0), RADIUS / 2))
    found = requad.requad(mesh, 5 * 150, Balls())
    assert sorted(spread(found.polygons)) == [150, 600] and not found.findings
    assert not [f for f in check.findings(found.polygons) if f.is_error]


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_the_tool_works_at_one_size(size: float) -> None:
    mesh = ball(6, (4.0, 5.0, 6.0))
    tool = Balls()
    found = requad.requad(PolygonMesh(size * mesh.vertices, mesh.corners, mesh.sizes), 96, tool).polygons
    assert [given[0] for given in tool.given] == pytest.approx([requad.EXTENT])
    assert np.linalg.norm(found.vertices / size - (4.0, 5.0, 6.0), axis=1) == pytest.approx(RADIUS, rel=1e-5)


def test_what_is_too_small_for_quads_is_left_out_and_named() -> None:
    mesh = both(ball(8), ball(4, (2.0, 0.0, 0.0), RADIUS / 20))
    found = requad.requad(mesh, 300, Balls())
    assert len(spread(found.polygons)) == 1
    assert [f.code for f in found.findings] == ["bodies-left-out"] and "1 of 2" in found.findings[0].message


def test_what_fails_once_is_tried_again_and_in_the_end_named() -> None:
    tool = Balls(hopeless=2)
    assert len(requad.requad(ball(6), 96, tool).polygons.sizes) and len(tool.given) == 3
    with pytest.raises(FlexMapsError, match="No sound quads") as error:
        requad.requad(ball(6), 96, Balls(hopeless=10**6))
    assert "remesh" not in str(error.value)


@pytest.mark.parametrize("hopeless", [0, 10**6])
def test_quads_along_the_curvature_are_tried_first(hopeless: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """They need no tool; the best of both is taken."""
    monkeypatch.setattr(requad, "CURVATURE_ATTEMPTS", OWN)
    tool = Balls(hopeless=hopeless)
    found = requad.requad(ball(6), 96, tool).polygons
    assert np.linalg.norm(found.vertices, axis=1) == pytest.approx(RADIUS, rel=0.05)
    assert len(found.sizes) == pytest.approx(96, rel=0.3)
    assert requad.is_clean(found) and requad.is_closed(found)


def tried(monkeypatch: pytest.MonkeyPatch, works: Callable[[float, float, float], bool], maps: int = 99) -> list:
    """What is tried along the curvature of a box, in how many maps at most, where ``works`` tells what gives quads."""
    hows: list[tuple[float, float, float]] = []

    def own(
        surface: PolygonMesh, whole: TargetSurface, count: int, how: tuple, progress: Progress
    ) -> requad.SoundQuads | str:
        hows.append(how)
        return requad.SoundQuads(surface, (0, 0, 0), 1.0) if works(*how) else "The map folds over itself"

    monkeypatch.setattr(requad, "CURVATURE_ATTEMPTS", OWN)
    monkeypatch.setattr(requad, "MAX_MAPS", maps)
    monkeypatch.setattr(requad, "MAX_MAPPED_QUADS", 96 * maps)
    monkeypatch.setattr(requad, "_quads_along_curvature", own)
    points, rows = box(4)
    search = requad._BodySearch(halved(mesh_from_rows(points, rows)), 96, Balls(), "")
    search.run(SILENT, True)
    return hows


def test_a_stronger_pull_is_tried_only_where_a_weaker_one_works(monkeypatch: pytest.MonkeyPatch) -> None:
    def pulls(hows: list) -> list:
        return [(fold < requad.NO_FOLDS, pull) for fold, pull, _ in hows]

    assert pulls(tried(monkeypatch, lambda *_: True)) == [(True, 4.0), (True, 16.0)]
    flat = pulls(tried(monkeypatch, lambda fold, _, __: fold == requad.NO_FOLDS))
    assert flat == [(True, 4.0), (False, 4.0), (False, 16.0)]
    assert tried(monkeypatch, lambda *_: False)[-1][2] > 10, "smoothed more in the end"
    assert len(tried(monkeypatch, lambda *_: False, maps=2)) == 2, "no more maps than are allowed"


def test_a_stop_keeps_the_best_so_far_and_a_stop_before_it_nothing() -> None:
    shown: list[PolygonMesh] = []
    made = requad.requad(ball(6), 96, Balls(), Progress(stopped=lambda: bool(shown), shown=shown.append))
    assert len(shown) == 1 and len(made.polygons.sizes) == len(shown[0].sizes)
    with pytest.raises(Cancelled):
        requad.requad(ball(6), 96, Balls(), Progress(stopped=lambda: True))


def test_dense_bodies_are_thinned_and_keep_their_borders() -> None:
    """A bent sheet of 8192 triangles for 96 quads; the tool gets few of them, of the same area within the same border."""
    n = 64
    u, v = (g.ravel() / n for g in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    k = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    points = np.stack([np.sin(u), v, np.cos(u)], axis=1)
    body = halved(mesh_from_rows(points, np.stack([k, k + n + 1, k + n + 2, k + 1], axis=1)))
    thin, whole = requad._simplify(body, 96), requad.target_surface(body)
    target = requad.target_surface(thin)
    assert len(thin.sizes) <= requad.TRIANGLES_PER_QUAD * 96 < len(body.sizes) and requad.is_clean(thin)
    assert target.area == pytest.approx(whole.area, rel=1e-3)
    border = target.vertices[np.unique(target.border_edges)]
    assert whole.distances_to_border(border).max() < 1e-3
    assert target.distances_to_border(points[[0, n, n * (n + 1), (n + 1) ** 2 - 1]]).max() < 1e-3, "its four corners"
    assert requad._simplify(body, 8192) is body


def test_what_hangs_together_by_an_edge_of_three_faces_is_cut_there() -> None:
    points = [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0), (-1, 0, 0), (-1, 1, 0), (0, 0, 1), (0, 1, 1)]
    rows = np.array([(0, 2, 3), (0, 3, 1), (4, 0, 1), (4, 1, 5), (0, 1, 7), (0, 7, 6)])
    parts, said = requad.find_bodies(mesh_from_rows(np.array(points, float), rows), Balls(), SILENT)
    assert [len(part.sizes) for part in parts] == [2, 2, 2] and [f.code for f in said] == ["bodies-cut"]
    assert all(requad.is_clean(part) for part in parts)


class Cells(Balls):
    """Gives no quads, but the polygons of a square: two quads and two triangles."""

    def quads(self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress) -> PolygonMesh | None:
        return None

    def cells(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        low, size = body.vertices.min(axis=0), float(np.ptp(body.vertices, axis=0).max())
        points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0, 0), (0.5, 0.5, 0), (0, 0.5, 0)])
        faces = [[0, 4, 5, 6], [4, 1, 5], [1, 2, 5], [6, 5, 2, 3]]
        return PolygonMesh(low + size * points, np.concatenate(faces), np.array([4, 3, 3, 4]))


def test_open_bodies_that_get_no_quads_are_cut_into_some() -> None:
    square = mesh_from_rows(
        np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float), np.array([(0, 1, 2), (0, 2, 3)])
    )
    made = requad.requad(square, 14, Cells()).polygons
    assert requad.is_clean(made) and len(made.sizes) == 14 and (made.sizes == 4).all()
    p = made.vertices[made.corners.reshape(-1, 4)]
    areas = 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])[:, 2]
    assert areas.min() > 0 and areas.sum() == pytest.approx(1.0)


# -- mending -------------------------------------------------------------------------------------------------------------


def poor(quads: PolygonMesh) -> set[str]:
    return {f.code for f in check.findings(quads) if f.is_error}


def sphere_target() -> TargetSurface:
    return requad.target_surface(halved(ball(24)))


@pytest.mark.parametrize("seed", range(4))
def test_folded_quads_are_unfolded_on_the_surface(seed: int) -> None:
    quads = ball(8)
    points = quads.vertices.copy()
    rng = np.random.default_rng(seed)
    rows = quads.corners.reshape(-1, 4)
    for face in rng.choice(len(rows), 3, replace=False):
        a, b = rows[face][:2]
        points[[a, b]] = points[[b, a]]  # two corners changed places
    folded = PolygonMesh(points, quads.corners, quads.sizes)
    assert "crossed" in poor(folded)
    good = mend_quads(folded, sphere_target())
    assert not poor(good)
    assert np.linalg.norm(good.vertices, axis=1) == pytest.approx(RADIUS, rel=5e-3)


def test_corners_at_one_place_are_drawn_apart() -> None:
    quads = ball(8)
    points = quads.vertices.copy()
    a, b = quads.corners[:2]
    points[a] = points[b]
    squeezed = PolygonMesh(points, quads.corners, quads.sizes)
    assert "zero-edge" in poor(squeezed)
    good = mend_quads(squeezed, sphere_target())
    assert not poor(good) and len(good.sizes) == len(quads.sizes)


def flattened(quads: PolygonMesh, face: int) -> PolygonMesh:
    """Two opposite corners of a quad are drawn nearly together: a needle between the other two."""
    points = quads.vertices.copy()
    a, c = quads.corners.reshape(-1, 4)[face, ::2]
    points[[a, c]] = [[0.51, 0.49], [0.49, 0.51]] @ points[[a, c]]
    return PolygonMesh(points, quads.corners, quads.sizes)


def pinched(quads: PolygonMesh, face: int) -> PolygonMesh:
    """A side of a quad is drawn nearly onto the one across it: a sliver."""
    points = quads.vertices.copy()
    a, b, c, d = quads.corners.reshape(-1, 4)[face]
    points[[a, b]] += 0.97 * (points[[d, c]] - points[[a, b]])
    return PolygonMesh(points, quads.corners, quads.sizes)


def slit(quads: PolygonMesh, face: int) -> PolygonMesh:
    """Two edges in a row are opened by a hair, and a quad fills the gap, as QuadriFlow leaves them."""
    rows, points = quads.corners.reshape(-1, 4).copy(), quads.vertices
    middle, start, _, last = rows[face]
    second = int(np.flatnonzero(((rows == middle) & (np.roll(rows, -1, axis=1) == last)).any(axis=1))[0])
    end = rows[second][(np.flatnonzero(rows[second] == middle)[0] - 1) % 4]
    moved = 0.98 * points[middle] + 0.02 * points[rows[[face, second]]].mean(axis=(0, 1))
    for f in (face, second):
        rows[f][rows[f] == middle] = len(points)
    return mesh_from_rows(
        np.concatenate([points, [moved]]), np.concatenate([rows, [(start, len(points), end, middle)]])
    )


def sharpest(quads: PolygonMesh) -> np.ndarray:
    """(F,) degrees: the second smallest angle between two sides that meet, of every quad; a needle has two small ones."""
    p = quads.vertices[quads.corners.reshape(-1, 4)]
    one, two = np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p
    cosine = np.einsum("fki,fki->fk", one, two) / np.linalg.norm(one, axis=2) / np.linalg.norm(two, axis=2)
    return np.sort(np.degrees(np.arccos(np.clip(cosine, -1, 1))), axis=1)[:, 1]


@pytest.mark.parametrize("spoil", [flattened, pinched, slit])
@pytest.mark.parametrize("face", [27, 100, 300])
def test_needles_and_slivers_become_broad_or_go(spoil: Callable[[PolygonMesh, int], PolygonMesh], face: int) -> None:
    spoilt = spoil(ball(8), face)
    p = spoilt.vertices[spoilt.corners.reshape(-1, 4)]
    lengths = np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2)
    assert sharpest(spoilt).min() < 5 or (lengths.min(axis=1) / lengths.max(axis=1)).min() < 0.05
    assert requad.is_clean(spoilt) and not poor(spoilt)
    good = mend_quads(spoilt, sphere_target())
    assert not check.findings(good) and len(good.sizes) in (len(spoilt.sizes), len(spoilt.sizes) - 1)
    p = good.vertices[good.corners.reshape(-1, 4)]
    lengths = np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2)
    assert sharpest(good).min() > 25 and (lengths.min(axis=1) / lengths.max(axis=1)).min() > 0.25
    assert np.linalg.norm(good.vertices, axis=1) == pytest.approx(RADIUS, rel=5e-3)


class Needles(Balls):
    """Gives quads with a needle first."""

    def quads(self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress) -> PolygonMesh | None:
        found = super().quads(body, count, seed, sharp, progress)
        return flattened(found, 20) if found is not None and len(self.given) <= requad.MIN_RESULTS else found


def test_quads_without_needles_are_taken_where_there_are_any(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soundness, "mend_quads", lambda quads, target: quads)
    assert sharpest(flattened(ball(4), 20)).min() < 5
    assert sharpest(requad.requad(ball(6), 96, Needles()).polygons).min() > 45


def test_two_quads_that_share_two_sides_become_one() -> None:
    quads = ball(6)
    rows, points = quads.corners.reshape(-1, 4), quads.vertices
    a, b, c, d = rows[0]
    extra = len(points)
    middle = points[rows[0]].mean(axis=0)
    doubled = mesh_from_rows(
        np.concatenate([points, [middle]]), np.concatenate([[(a, b, c, extra), (a, extra, c, d)], rows[1:]])
    )
    good = mend_quads(doubled, sphere_target())
    assert len(good.sizes) == len(quads.sizes) and len(good.vertices) == len(points)
    assert not poor(good)


def test_a_border_keeps_its_corners_and_its_line() -> None:
    n = 8
    x, y = (g.ravel() / n for g in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    k = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    sheet = mesh_from_rows(np.stack([x, y, 0 * x], axis=1), np.stack([k, k + n + 1, k + n + 2, k + 1], axis=1))
    points = sheet.vertices.copy()
    points[[1, n + 2]] = points[[n + 2, 1]]  # a corner of the border and one within
    target = requad.target_surface(halved(sheet))
    good = mend_quads(PolygonMesh(points, sheet.corners, sheet.sizes), target)
    assert not poor(good)
    for corner in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)):
        assert np.abs(good.vertices - corner).sum(axis=1).min() < 1e-9


def test_what_the_quads_miss_is_found_and_what_they_cover_is_not() -> None:
    """A ball's upper half alone misses the lower one; the whole ball misses nothing."""
    whole, quads = requad.target_surface(ball(8)), ball(6)
    assert not coverage.warn_of_gaps(quads, requad.target_surface(quads), whole, 216, 0)
    rows = quads.corners.reshape(-1, 4)
    half = mesh_from_rows(quads.vertices, rows[quads.vertices[rows].mean(axis=1)[:, 2] > 0])
    (found,) = coverage.warn_of_gaps(half, requad.target_surface(half), whole, 216, 1000)
    assert found.code == "surface-missed" and "430 quads" in found.message
    lowest = half.vertices[half.corners.reshape(-1, 4)[np.array(found.faces) - 1000]][:, :, 2].min(axis=1)
    assert (lowest < 0.5 * RADIUS).all(), "beside the border"


def test_quads_of_a_part_of_the_surface_are_taken_where_there_are_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requad, "MIN_ATTEMPTS", 4)
    found = requad.requad(halved(ball(8)), 96, Balls(parts=10**6))
    assert [finding.code for finding in found.findings] == ["surface-missed"]
    found = requad.requad(halved(ball(8)), 96, Balls(parts=1))
    assert not found.findings and requad.is_closed(found.polygons)
    judged = requad.SoundQuads(ball(6), (0, 0, 0), 1.0)  # a body that cuts itself has lost no more than what was inside
    assert (
        requad._BodySearch(both(ball(8), ball(8, (0.3, 0.0, 0.0))), 216, Balls(), "")._with_area_fault(judged) is judged
    )


def test_one_shape_gives_one_numbering() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(9, 3))
    faces = [[0, 1, 2], [2, 1, 3, 4], [4, 5, 6, 7, 8], [8, 0, 2]]

    def mesh(points: np.ndarray, faces: list[list[int]]) -> PolygonMesh:
        return PolygonMesh(points, np.concatenate(faces), np.array([len(face) for face in faces]))

    once = mesh(points, faces).with_canonical_order()
    same = {frozenset(tuple(points[v]) for v in face) for face in faces}
    begins = np.cumsum(once.sizes)[:-1]
    assert {frozenset(tuple(once.vertices[v]) for v in face) for face in np.split(once.corners, begins)} == same
    for _ in range(10):
        new = rng.permutation(len(points))  # vertex k of the other numbering was vertex new[k]
        place = np.argsort(new)
        turned = [np.roll(place[face], rng.integers(len(face))).tolist() for face in faces]
        again = mesh(points[new], [turned[k] for k in rng.permutation(len(faces))]).with_canonical_order()
        assert (again.vertices == once.vertices).all() and (again.sizes == once.sizes).all()
        assert (again.corners == once.corners).all()
