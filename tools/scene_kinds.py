"""Objects in Blender for ``bench_scenes.py``: hidden, keyed, bent, far away."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from flexmaps.engine.surface import shapes

CLOSE = 1e-5  # metres of error far away
MADE, WRONG = "made", "wrong"


def right(so: bool) -> str:
    return MADE if so else WRONG


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


def bent(name: str, random: np.random.Generator) -> str:
    """meshes that a lattice bends are refused, and are made as they are seen once that is applied"""
    import bpy
    from flexmaps import api
    from flexmaps.bridge.store import objects

    obj, mesh = scene_object(name)
    data = bpy.data.lattices.new("l")
    cage = bpy.data.objects.new("l", data)
    bpy.context.scene.collection.objects.link(cage)
    cage.scale = 1.2 * np.maximum(np.ptp(mesh.vertices, axis=0), 0.05)
    cage.location = mesh.vertices.mean(axis=0)
    for point in data.points:
        point.co_deform = np.array(point.co_deform) + random.uniform(-0.06, 0.06, 3)
    obj.modifiers.new("l", "LATTICE").object = cage
    bpy.context.view_layer.update()
    refused = objects.changed_by_modifiers(obj) is not None
    seen = np.array([v.co for v in obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices])
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.convert(target="MESH")
    return right(refused and np.allclose(api.load(bpy.context.object).source.vertices, seen, atol=1e-6))


def linked(name: str, random: np.random.Generator) -> str:
    """linked objects are refused, and can be worked on once they are local"""
    import bpy
    from flexmaps import api
    from flexmaps.bridge.store import objects

    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "library.blend")
        _, mesh = scene_object(name)
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        with bpy.data.libraries.load(path, link=True) as (there, here):
            here.objects = there.objects
        bpy.context.scene.collection.objects.link(here.objects[0])
        bpy.context.view_layer.objects.active = bpy.data.objects[0]
        bpy.data.objects[0].select_set(True)
        refused = objects.linked(bpy.context.object) and objects.unusable(bpy.context.object) is not None
        bpy.ops.object.make_local(type="SELECT_OBDATA")
        local = objects.unusable(bpy.context.object) is None
        points = api.load(bpy.context.object).source.vertices if local else np.zeros((0, 3))
    return right(refused and points.shape == mesh.vertices.shape and np.allclose(points, mesh.vertices, atol=1e-6))


def braces(name: str, random: np.random.Generator) -> str:
    """pictures in folders with braces in their names"""
    import bpy
    from flexmaps import api
    from flexmaps.bridge.view import picture

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    obj = api.show(api.load("shape:strip", edge=20))
    names = ("{}", "{blend_name}", "a{b", "b}c", "{{x}}", "{fps:03}")
    inner = names[int(random.integers(len(names)))]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / inner / "all{0}.png"
        path.parent.mkdir()
        picture.layout(obj, path, (64, 64), samples=1)
        made = [one for one in Path(folder).rglob("*") if one.is_file()]
        return right(made == [path] and path.stat().st_size > 0)


def far_object(name: str, random: np.random.Generator) -> str:
    """objects up to 10,000 km away by their transform"""
    from flexmaps import api

    obj, mesh = scene_object(name)
    away = random.normal(size=3)
    obj.location = away * 10 ** random.uniform(2, 7) / np.linalg.norm(away)
    points = api.load(obj).source.vertices
    sides = [np.linalg.norm(p[mesh.quads] - p[np.roll(mesh.quads, 1, axis=1)], axis=2) for p in (points, mesh.vertices)]
    return right(float(np.abs(sides[0] - sides[1]).max()) < CLOSE)
