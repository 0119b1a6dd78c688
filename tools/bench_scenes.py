"""Measures meshes and scenes of others: soups, doubled vertices, T-junctions, doubled shells, far places, hidden and keyed objects, files.

python3 tools/dev.py bench scenes [--json FILE] [--seed N]

Every kind is made ten times, of other surfaces and by chance; a row counts what came out right. ``refused`` counts those that end with
a sentence instead of a surface: at most a quarter of all.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.nesting.many import refuse_many
from flexmaps.engine.files import replacing_many
from flexmaps.engine.own_files import Guard
from flexmaps.engine.params import Settings, SheetParams, changed
from flexmaps.engine.patches.splitting import split
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking.overlaps import overlaps
from flexmaps.engine.surface.checking.sewing import sewn
from flexmaps.engine.surface.checking.topology import sides_of
from flexmaps.engine.surface.files import meshio
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.remeshing.bodies import without_crumbs
from flexmaps.engine.surface.welding import welded
from rows import Table, at_least, at_most

MANY = 10  # of each kind
REFUSED = 0.25  # share of all that may end with a sentence
CLOSE = 1e-5  # metres of error far away
NAMES = [name for name in shapes.NAMES if name != "quad"]
MADE, REFUSAL, WRONG = "made", "refused", "wrong"
Kind = Callable[[str, np.random.Generator], str]


def main(arguments: list[str]) -> int:
    """Try every kind, print the table, write the rows; 0 whatever was measured."""
    parser = argparse.ArgumentParser(prog="dev.py bench scenes")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    parser.add_argument("--seed", type=int, default=0, help="another number makes others")
    options = parser.parse_args(arguments)
    table, refused, whole = Table(44), 0, 0
    for kind in KINDS:
        random = np.random.default_rng(options.seed)
        found = [kind(NAMES[k % len(NAMES)], random) for k in range(MANY)]
        told = (kind.__doc__ or "").rstrip(".")
        table.add(at_least(kind.__name__, told, MANY, float(MANY - found.count(WRONG))))
        refused, whole = refused + found.count(REFUSAL), whole + MANY
    table.add(at_most("all", "share that is refused by name", REFUSED, refused / whole))
    table.finish(options.json)
    return 0


def quads(name: str) -> PolygonMesh:
    return PolygonMesh.of(shapes.make(name))


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


def right(so: bool) -> str:
    return MADE if so else WRONG


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
    small = areas[1:].sum() / areas.sum()
    try:
        large, _ = without_crumbs(areas, 100, 6, 0.1)
    except FlexMapsError as error:
        return REFUSAL if small > 0.1 and "--remesh" in str(error) and "--crumbs" in str(error) else WRONG
    return right(small <= 0.1 and large.sum() == 1)


# -- sheets and files ------------------------------------------------------------------------------------------------------


def split_fits(name: str, random: np.random.Generator) -> str:
    """every panel fits a sheet of any size"""
    width, height = random.uniform(0.06, 0.4, 2)
    settings = changed(Settings(), {"sheet.sheet_width": 1e3 * width, "sheet.sheet_height": 1e3 * height})
    try:
        made = job.run(quads("dome"), settings, edge=0.015, stop_after="split")
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
            with replacing_many([target], target.parent, Guard(read)) as new:
                new(target).write_text("ours")
            return WRONG
        except FlexMapsError:
            return right(source.read_text() == target.read_text() == "mine")


# -- Blender -----------------------------------------------------------------------------------------------------------------


def scene_object(name: str) -> tuple:
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    mesh = shapes.make(name)
    data = bpy.data.meshes.new("m")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.quads.tolist())
    obj = bpy.data.objects.new("m", data)
    box = bpy.data.collections.new("box")
    bpy.context.scene.collection.children.link(box)
    box.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    return obj, mesh


def hidden(name: str, random: np.random.Generator) -> str:
    """objects hidden in any way keep their scale"""
    import bpy
    from flexmaps import api

    obj, mesh = scene_object(name)
    obj.scale = random.uniform(0.5, 2.0, 3)
    wanted = np.ptp(mesh.vertices, axis=0) * np.array(obj.scale)
    layer = bpy.context.view_layer.layer_collection.children["box"]
    way = int(random.integers(4))
    bpy.context.view_layer.update()
    if way == 0:
        obj.hide_set(True)
    elif way == 1:
        obj.hide_viewport = True
    elif way == 2:
        layer.collection.hide_viewport = True
    else:
        layer.exclude = True
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "a.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path)
        return right(np.allclose(np.ptp(api.load(path).source.vertices, axis=0), wanted, rtol=1e-5))


def keyed(name: str, random: np.random.Generator) -> str:
    """shape keys in effect are what is made"""
    from flexmaps import api

    obj, mesh = scene_object(name)
    obj.shape_key_add(name="Basis")
    points = np.array(mesh.vertices)
    for number in range(int(random.integers(1, 4))):
        key = obj.shape_key_add(name=f"key {number}", from_mix=False)
        moved = mesh.vertices * random.uniform(0.8, 1.5, 3)
        key.data.foreach_set("co", moved.astype(np.float32).ravel())
        key.value, key.mute = float(random.uniform(0, 1)), bool(random.integers(2))
        points += (0.0 if key.mute else key.value) * (moved - mesh.vertices)
    return right(np.allclose(api.load(obj).source.vertices, points, atol=1e-6))


KINDS: tuple[Kind, ...] = (
    soup, own_vertices, halves, t_junction, shell_twice, through, both_skins, far_text, crumbs, split_fits, many_sheets,
    own_files, hidden, keyed,
)  # fmt: skip


if __name__ == "__main__":
    import sys

    sys.exit(main(sys.argv[1:]))
