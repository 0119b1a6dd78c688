"""Measures meshes and scenes of others: soups, doubled vertices, T-junctions, doubled shells, far places, hidden and keyed objects, files.

python3 tools/dev.py bench scenes [--json FILE] [--seed N]

Every kind is made ten times, of other surfaces and by chance; a row counts what came out right. ``refused`` counts those that end with
a sentence instead of a surface: at most a quarter of all.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.nesting import remnants
from flexmaps.engine.fabrication.nesting.many import refuse_many
from flexmaps.engine.files import write_all_atomically
from flexmaps.engine.own_files import Guard
from flexmaps.engine.params import Settings, SheetParams, with_values
from flexmaps.engine.patches.splitting import split
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking.overlaps import overlaps
from flexmaps.engine.surface.checking.sewing import sewn
from flexmaps.engine.surface.checking.topology import sides_of
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.surface.remeshing.bodies import without_crumbs
from flexmaps.engine.surface.welding import welded
from harness import Bench
from rows import at_least, at_most
from scene_kinds import CLOSE, MADE, WRONG, bent, braces, far_object, hidden, keyed, linked, right
from scipy.spatial import cKDTree

MANY = 10  # of each kind
QUADS = 60  # of a polygon that is remeshed
REFUSED = 0.25  # share of all that may end with a sentence
NAMES = [name for name in shapes.NAMES if name != "quad"]
REFUSAL = "refused"
Kind = Callable[[str, np.random.Generator], str]


def main(arguments: list[str]) -> int:
    """Try every kind, print the table and write the rows; return 0 whatever the figures."""
    bench, refused, whole = Bench("scenes", arguments, 44, seed=(0, "another number makes others")), 0, 0
    for kind in KINDS:
        random = np.random.default_rng(bench.options.seed)
        found = [kind(NAMES[k % len(NAMES)], random) for k in range(MANY)]
        told = (kind.__doc__ or "").rstrip(".")
        bench.table.add(at_least(kind.__name__, told, MANY, float(MANY - found.count(WRONG))))
        refused, whole = refused + found.count(REFUSAL), whole + MANY
    return bench.finish(at_most("all", "share that is refused by name", REFUSED, refused / whole))


def quads(name: str) -> PolygonMesh:
    return PolygonMesh.from_quads(shapes.make(name))


def triangles(name: str) -> PolygonMesh:
    mesh = shapes.make(name)
    rows = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    return PolygonMesh(mesh.vertices, rows.ravel(), np.full(len(rows), 3))


def joined(*parts: PolygonMesh) -> PolygonMesh:
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    corners = [part.corners + k for part, k in zip(parts, first, strict=False)]
    vertices, sizes = [part.vertices for part in parts], [part.sizes for part in parts]
    return PolygonMesh(np.concatenate(vertices), np.concatenate(corners), np.concatenate(sizes))


def euler(mesh: PolygonMesh) -> int:
    return len(np.unique(mesh.corners)) - len(sides_of(mesh).edges) + len(mesh.sizes)


# -- meshes --------------------------------------------------------------------------------------------------------------


def soup(name: str, random: np.random.Generator) -> str:
    """triangles, noise of 1e-7 to 5e-3 edges"""
    mesh, noise = triangles(name), 10 ** random.uniform(-7, np.log10(5e-3))
    points = mesh.vertices[mesh.corners]
    points = points + noise * shapes.make(name).median_edge * random.normal(size=points.shape)
    return right(euler(welded(PolygonMesh(points, np.arange(len(points)), mesh.sizes))) == euler(mesh))


def own_vertices(name: str, random: np.random.Generator) -> str:
    """quads with vertices of their own"""
    mesh = quads(name)
    apart = PolygonMesh(mesh.vertices[mesh.corners], np.arange(len(mesh.corners)), mesh.sizes)
    return right("Merge by Distance" in overlaps(apart)[0].message and euler(sewn(apart)) == euler(mesh))


def halves(name: str, random: np.random.Generator) -> str:
    """halves that are not merged, along any plane"""
    mesh, way = quads(name), random.normal(size=3)
    middle = mesh.vertices[mesh.corners.reshape(-1, 4)].mean(axis=1) @ way
    side = middle > np.median(middle)
    return right(euler(sewn(joined(mesh.kept(side), mesh.kept(~side)))) == euler(mesh))


def t_junction(name: str, random: np.random.Generator) -> str:
    """a quad cut in two beside a whole one"""
    mesh = quads(name)
    rows = mesh.corners.reshape(-1, 4)
    face = int(random.integers(len(rows)))
    a, b, c, d = rows[face]
    n = len(mesh.vertices)
    points = np.concatenate([mesh.vertices, mesh.vertices[[[a, b], [c, d]]].mean(axis=1)])
    halved = np.concatenate([np.delete(rows, face, axis=0), [[a, n, n + 1, d], [n, b, c, n + 1]]])
    made = sewn(PolygonMesh(points, halved.ravel(), np.full(len(halved), 4)))
    named = not made.cured or "T-junction" in made.cured[0][1]
    return right(named and euler(made) == euler(mesh) and not overlaps(made))


def shell_twice(name: str, random: np.random.Generator) -> str:
    """a shell that is there twice"""
    mesh = quads(name)
    shuffled = random.permutation(len(mesh.sizes))
    again = replace(mesh, corners=mesh.corners.reshape(-1, 4)[shuffled].ravel())
    found = overlaps(joined(mesh, again))
    return right("lie on each other" in found[0].message and len(sewn(joined(mesh, again)).sizes) == len(mesh.sizes))


def through(name: str, random: np.random.Generator) -> str:
    """two balls, through each other or not"""
    mesh, way = quads("cubesphere"), random.normal(size=3)
    radius = np.ptp(mesh.vertices, axis=0).max() / 2
    share = random.choice([random.uniform(0.1, 0.9), random.uniform(1.1, 2.0)])
    moved = replace(mesh, vertices=mesh.vertices + 2 * radius * share * way / np.linalg.norm(way))
    found = overlaps(joined(mesh, moved))
    return right(any("cuts itself" in one.message for one in found) == (share < 1.0))


def both_skins(name: str, random: np.random.Generator) -> str:
    """both skins of a thin closed shell"""
    mesh = shapes.make("cubesphere")
    middle = mesh.vertices.mean(axis=0)
    factor = 1.0 - random.uniform(0.02, 0.4) * mesh.median_edge / np.linalg.norm(mesh.vertices - middle, axis=1).mean()
    gone = mesh.centroids @ random.normal(size=3) > 0.3 * np.ptp(mesh.vertices)
    kept = mesh.quads[~gone]
    n, inner = len(mesh.vertices), middle + factor * (mesh.vertices - middle)
    sides = sides_of(PolygonMesh(mesh.vertices, kept.ravel(), np.full(len(kept), 4)))
    once = np.flatnonzero(np.bincount(sides.edge)[sides.edge] == 1)
    a, b = kept.ravel()[once], sides.following[once]
    rows = np.concatenate([kept, kept[:, ::-1] + n, np.stack([b, a, a + n, b + n], axis=1)])
    made = PolygonMesh(np.concatenate([mesh.vertices, inner]), rows.ravel(), np.full(len(rows), 4))
    # two skins that nothing joins are two closed bodies, one in the other
    return right(any(one.code == "double-skin" for one in overlaps(made)) or not len(once))


def far_text(name: str, random: np.random.Generator) -> str:
    """text files up to 10,000 km away"""
    mesh = triangles(name)
    away = random.normal(size=3)
    away *= 10 ** random.uniform(2, 7) / np.linalg.norm(away)
    lines = ["v {:.9f} {:.9f} {:.9f}".format(*p) for p in mesh.vertices + away]
    lines += ["f {} {} {}".format(*row) for row in mesh.corners.reshape(-1, 3) + 1]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.obj"
        path.write_text("\n".join(lines))
        read = meshio.named(str(path), "z")[1]
    a, b = (one.vertices[one.corners] - one.vertices[one.corners].mean(axis=0) for one in (read, mesh))
    return right(float(np.abs(a - b).max()) < CLOSE)


def crumbs(name: str, random: np.random.Generator) -> str:
    """bodies too small for the count"""
    areas = np.append(1.0, random.uniform(1e-4, 0.01, int(random.integers(1, 40))))
    try:
        large, _ = without_crumbs(areas, 100, np.full(len(areas), 6), 0.1)
    except FlexMapsError as error:
        return REFUSAL if "--remesh" in str(error) and "--crumbs" in str(error) else WRONG
    return right(areas[~large].sum() <= 0.1 * areas.sum() * (1.0 + 1e-9))


def _polygon(random: np.random.Generator) -> tuple[float, ...]:
    """The angles of the corners of a polygon in a circle."""
    count = int(random.integers(3, 8))
    angle = np.sort(random.uniform(0.0, 2.0 * np.pi, count))
    if np.max(np.diff(np.append(angle, angle[0] + 2.0 * np.pi))) > 0.9 * np.pi:
        angle = 2.0 * np.pi * np.arange(count) / count
    return tuple(angle.tolist())


def _corners(angle: tuple[float, ...]) -> np.ndarray:
    """(count, 3) metres."""
    return 0.1 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])


@cache
def _remeshed(angle: tuple[float, ...]) -> QuadMesh | str:
    """The quads of a polygon, or what came of it instead."""
    from flexmaps import api

    points, count = _corners(angle), len(angle)
    lines = ["v {:.9f} {:.9f} {:.9f}".format(*p) for p in points]
    lines.append("f " + " ".join(str(k + 1) for k in range(count)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.obj"
        path.write_text("\n".join(lines))
        try:
            made = api.load(path, quads=QUADS, up="z").mesh
        except FlexMapsError as error:
            return REFUSAL if "quads" in str(error) else WRONG
    assert made is not None
    return made


def ngon(name: str, random: np.random.Generator) -> str:
    """flat polygons with sharp corners, remeshed whole"""
    angle = _polygon(random)
    made, points = _remeshed(angle), _corners(angle)
    if isinstance(made, str):
        return made
    area = 0.5 * np.abs(np.cross(points[:, :2], np.roll(points[:, :2], -1, axis=0)).sum())
    return right(abs(made.areas.sum() / area - 1.0) < 0.02)


def coverage(name: str, random: np.random.Generator) -> str:
    """polygons no part of which is far from their quads"""
    angle = _polygon(random)
    made, points = _remeshed(angle), _corners(angle)
    if isinstance(made, str):
        return made
    random = np.random.default_rng(len(angle))  # so that polygons are those of the row before
    share = random.uniform(0.0, 1.0, 1000)[:, None]
    rim = np.concatenate(
        [(1.0 - share) * a + share * b for a, b in zip(points, np.roll(points, 1, axis=0), strict=True)]
    )
    inside = rim * np.sqrt(random.uniform(0.0, 1.0, len(rim)))[:, None]
    # quads are sampled ten times an edge, so that the nearest sample is as near as the quad but for a tenth of an edge
    u, v = (one.ravel()[:, None, None] for one in np.meshgrid(np.linspace(0, 1, 11), np.linspace(0, 1, 11)))
    a, b, c, d = (made.vertices[made.quads[:, k]] for k in range(4))
    sampled = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    far = cKDTree(sampled.reshape(-1, 3)).query(np.concatenate([rim, inside]))[0] / made.median_edge
    return right(float(np.quantile(far, 0.95)) < 0.6 and float(far.max()) < 1.6)


# -- sheets and files ------------------------------------------------------------------------------------------------------


@cache
def _merged_dome() -> Result:
    """A dome laid out for a sheet that all of its panels fit."""
    return job.run(quads("dome"), Settings(), edge=0.015, stop_after="merge")


def split_fits(name: str, random: np.random.Generator) -> str:
    """every panel fits a sheet of any size"""
    width, height = random.uniform(0.06, 0.4, 2)
    settings = with_values(Settings(), {"sheet.sheet_width": 1e3 * width, "sheet.sheet_height": 1e3 * height})
    try:
        made = job.run_stages(_merged_dome(), settings, ("split",))
    except FlexMapsError as error:
        return REFUSAL if "single quads" in str(error) else WRONG
    assert made.flat is not None
    try:
        split.check_size(made.flat, settings.layout, settings.sheet)
    except FlexMapsError:
        return WRONG
    return MADE


def many_sheets(name: str, random: np.random.Generator) -> str:
    """sheets far too small, with a size that would do"""
    side = float(random.uniform(0.03, 0.2))
    square = side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    size = side * float(random.uniform(1.02, 1.9)) + 0.01
    sheet = replace(SheetParams(), sheet_width=size, sheet_height=size, margin=0.003)
    thin = [square * (1.0, 0.2) if random.random() < 0.1 else square * (1.0, 0.9) for _ in range(40)]
    try:
        refuse_many(thin, sheet)
    except FlexMapsError as error:
        return REFUSAL if "would do" in str(error) else WRONG
    return MADE


def own_files(name: str, random: np.random.Generator) -> str:
    """files of the user's, under any name for the same file"""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "mine.obj", Path(folder) / "out" / "sheet-01.svg"
        target.parent.mkdir()
        source.write_text("mine")
        way = random.choice(["link", "hard link", "path", "foreign"])
        if way == "link":
            target.symlink_to(source)
        elif way == "hard link":
            os.link(source, target)
        else:
            target.write_text("mine")
        read = {"path": [target], "foreign": []}.get(str(way), [source])
        try:
            with write_all_atomically([target], target.parent, Guard(read)) as new:
                new(target).write_text("ours")
            return WRONG
        except FlexMapsError:
            return right(source.read_text() == target.read_text() == "mine")


def remnant_dxf(name: str, random: np.random.Generator) -> str:
    """remnants in blocks in blocks, in any unit, beside layers that are off"""
    import ezdxf

    size, document = random.uniform(50.0, 400.0, 2), ezdxf.new("R2010")
    unit = float(random.choice([1.0, 10.0, 1000.0, 25.4]))
    document.header["$INSUNITS"] = {1.0: 4, 10.0: 5, 1000.0: 6, 25.4: 1}[unit]
    scale, depth = random.uniform(0.2, 3.0), int(random.integers(1, 4))
    corners = [(0, 0), (size[0], 0), (size[0], size[1]), (0, size[1])]
    block = document.blocks.new("b0")
    block.add_lwpolyline([(x / scale**depth / unit, y / scale**depth / unit) for x, y in corners], close=True)
    for k in range(1, depth):
        document.blocks.new(f"b{k}").add_blockref(f"b{k - 1}", (1, 2), {"xscale": scale, "yscale": scale})
    space = document.modelspace()
    space.add_blockref(f"b{depth - 1}", (3, 4), {"xscale": scale, "yscale": scale})
    document.layers.add("off").off()
    space.add_circle((0, 0), 5.0, {"layer": "off"})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.dxf"
        document.saveas(path)
        found = remnants.read_file(path)
    return right(len(found) == 1 and not found[0].holes and np.allclose(1e3 * found[0].size, size, atol=0.01))


def remnant_svg(name: str, random: np.random.Generator) -> str:
    """remnants in drawings of any size, unit, view box and nesting"""
    size, inner = random.uniform(50.0, 400.0, 2), random.uniform(0.2, 3.0)
    unit, factor = [("mm", 1.0), ("cm", 10.0), ("in", 25.4), ("pt", 25.4 / 72), ("px", 25.4 / 96), ("Q", 0.25)][
        int(random.integers(6))
    ]
    width, share = 900.0 / factor, random.uniform(0.3, 3.0)
    head = f'width="{width}{unit}" viewBox="0 0 {900 * share} {900 * share}"'
    if random.random() < 0.5:
        head = f'style="width:{width}{unit};height:{width}{unit}" viewBox="0 0 {900 * share} {900 * share}"'
    x, y = size * share / inner
    body = f'<g transform="scale({inner})"><rect x="7" width="{x}" height="{y}"/></g>'
    if random.random() < 0.5:
        body = f'<defs><g id="a">{body}</g></defs><use href="#a" x="3"/><circle r="5" display="none"/>'
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.svg"
        path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {head}>{body}</svg>')
        found = remnants.read_file(path)
    return right(len(found) == 1 and np.allclose(1e3 * found[0].size, size, atol=0.01))


KINDS: tuple[Kind, ...] = (
    soup, own_vertices, halves, t_junction, shell_twice, through, both_skins, far_text, crumbs, ngon, coverage, split_fits, many_sheets,
    own_files, remnant_dxf, remnant_svg, hidden, keyed, bent, far_object, linked, braces,
)  # fmt: skip


if __name__ == "__main__":
    import sys

    sys.exit(main(sys.argv[1:]))
