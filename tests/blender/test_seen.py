"""What is seen is what is made: shape keys, bending parents, hidden objects and parents, scale and rotation included."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import mesh, shape_keys
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from support.drawing import draw

DOME = shapes.make("dome")
SIZE = np.ptp(DOME.vertices, axis=0)


@pytest.fixture
def dome() -> Any:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    box = bpy.data.collections.new("box")
    bpy.context.scene.collection.children.link(box)
    data = bpy.data.meshes.new("m")
    data.from_pydata(DOME.vertices.tolist(), [], DOME.quads.tolist())
    obj = bpy.data.objects.new("m", data)
    box.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    return obj


def shown(obj: Any) -> None:
    """As it stands."""


def eye(obj: Any) -> None:
    bpy.context.view_layer.update()
    obj.hide_set(True)


def monitor(obj: Any) -> None:
    obj.hide_viewport = True


def collection(obj: Any) -> None:
    bpy.data.collections["box"].hide_viewport = True


def excluded(obj: Any) -> None:
    bpy.context.view_layer.layer_collection.children["box"].exclude = True


def other_scene(obj: Any) -> None:
    bpy.context.window.scene = bpy.data.scenes.new("other") if bpy.context.window else bpy.context.scene


HIDING = (shown, eye, monitor, collection, excluded)


def scaled(obj: Any) -> np.ndarray:
    obj.scale = (1, 1, 2)
    return SIZE * (1, 1, 2)


def delta(obj: Any) -> np.ndarray:
    obj.delta_scale = (1, 3, 1)
    return SIZE * (1, 3, 1)


def turned(obj: Any) -> np.ndarray:
    obj.rotation_euler, obj.scale = (0, np.pi / 2, 0), (1, 2, 1)
    return SIZE[[2, 1, 0]] * (1, 2, 1)


def parent(obj: Any) -> np.ndarray:
    obj.parent = bpy.data.objects.new("empty", None)
    bpy.context.scene.collection.objects.link(obj.parent)
    obj.parent.scale = (2, 1, 1)
    return SIZE * (2, 1, 1)


def hidden_parent(obj: Any) -> np.ndarray:
    size = parent(obj)
    obj.parent.hide_viewport = True
    return size


def constraint(obj: Any) -> np.ndarray:
    limit = obj.constraints.new("LIMIT_SCALE")
    limit.use_min_z, limit.min_z = True, 3.0
    return SIZE * (1, 1, 3)


@pytest.mark.parametrize("hide", HIDING, ids=lambda one: one.__name__)
@pytest.mark.parametrize(
    "place", [scaled, delta, turned, parent, hidden_parent, constraint], ids=lambda one: one.__name__
)
def test_hidden_objects_keep_their_size(dome: Any, tmp_path: Path, place: Callable, hide: Callable) -> None:
    wanted = place(dome)
    hide(dome)
    path = tmp_path / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    count = len(bpy.data.scenes)
    assert np.ptp(api.load(path).source.vertices, axis=0) == pytest.approx(wanted, rel=1e-5)
    assert len(bpy.data.scenes) == count


# -- shape keys and what bends -------------------------------------------------------------------------------------------


def taller(obj: Any, value: float = 1.0) -> Any:
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="taller")
    for vertex in key.data:
        vertex.co = (*vertex.co[:2], 2 * vertex.co[2])
    key.value = value
    return key


def key_on(obj: Any) -> float:
    taller(obj)
    return 2.0


def half(obj: Any) -> float:
    taller(obj, 0.5)
    return 1.5


def muted(obj: Any) -> float:
    taller(obj).mute = True
    return 1.0


def pinned(obj: Any) -> float:
    taller(obj, 0.0)
    obj.show_only_shape_key, obj.active_shape_key_index = True, 1
    return 2.0


def two(obj: Any) -> float:
    taller(obj)
    key = obj.shape_key_add(name="more", from_mix=False)
    for vertex in key.data:
        vertex.co = (*vertex.co[:2], 1.5 * vertex.co[2])
    key.value = 1.0
    return 2.5


def grouped(obj: Any) -> float:
    taller(obj).vertex_group = "all"
    obj.vertex_groups.new(name="all").add(range(len(obj.data.vertices)), 0.25, "REPLACE")
    return 1.25


def driven(obj: Any) -> float:
    curve = taller(obj, 0.0).driver_add("value")
    curve.driver.expression = "0.75"
    return 1.75


def lattice(obj: Any) -> float:
    data = bpy.data.lattices.new("l")
    data.interpolation_type_u = data.interpolation_type_v = data.interpolation_type_w = "KEY_LINEAR"
    cage = bpy.data.objects.new("l", data)
    bpy.context.scene.collection.objects.link(cage)
    cage.location, cage.scale = (0, 0, 0), (1, 1, 1)
    for point in data.points:
        point.co_deform = (*point.co_deform[:2], 2 * point.co_deform[2])
    obj.modifiers.new("l", "LATTICE").object = cage
    return 2.0


def armature(obj: Any, by_parent: bool = True) -> float:
    rig = bpy.data.armatures.new("r")
    bones = bpy.data.objects.new("r", rig)
    bpy.context.scene.collection.objects.link(bones)
    bpy.context.view_layer.objects.active = bones
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.edit_bones.new("b")
    bone.head, bone.tail = (0, 0, 0), (0, 0, 0.1)
    bpy.ops.object.mode_set(mode="OBJECT")
    if by_parent:
        obj.parent, obj.parent_type = bones, "ARMATURE"
    else:
        obj.modifiers.new("a", "ARMATURE").object = bones
    obj.vertex_groups.new(name="b").add(range(len(obj.data.vertices)), 1.0, "ADD")
    bones.pose.bones["b"].scale = (1, 2, 1)
    bpy.context.view_layer.objects.active = obj
    return 2.0


def by_modifier(obj: Any) -> float:
    return armature(obj, by_parent=False)


SEEN = (key_on, half, muted, pinned, two, grouped, driven)


@pytest.mark.parametrize("hide", (shown, monitor), ids=lambda one: one.__name__)
@pytest.mark.parametrize("bend", SEEN, ids=lambda one: one.__name__)
def test_the_seen_points_are_made(dome: Any, tmp_path: Path, bend: Callable, hide: Callable) -> None:
    wanted = bend(dome) * SIZE[2]
    bpy.context.view_layer.update()
    hide(dome)
    path = tmp_path / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert np.ptp(api.load(path).source.vertices[:, 2]) == pytest.approx(wanted, rel=1e-5)
    obj = bpy.data.objects["m"]
    assert mesh.read_surface(obj, bpy.context.scene).is_same_mesh(mesh.read_surface(obj, bpy.context.scene))


def test_other_faces_are_to_be_applied_first(dome: Any) -> None:
    taller(dome)
    dome.modifiers.new("s", "SUBSURF")
    bpy.context.view_layer.update()
    with pytest.raises(FlexMapsError, match="Apply"):
        mesh.read_surface(dome, bpy.context.scene)


@pytest.mark.parametrize("bend", (lattice, armature, by_modifier), ids=lambda one: one.__name__)
def test_what_bends_the_mesh_is_to_be_applied_first(dome: Any, bend: Callable) -> None:
    bend(dome)
    bpy.context.view_layer.update()
    with pytest.raises(FlexMapsError, match="modifier"):
        mesh.read_surface(dome, bpy.context.scene)


@pytest.mark.parametrize(
    "bend",
    [two, *(pytest.param(one, marks=pytest.mark.thorough) for one in (key_on, half))],
    ids=lambda one: one.__name__,
)
def test_our_shape_comes_on_top_of_the_users_keys(dome: Any, bend: Callable) -> None:
    """The view shows the piece at rest, not the sum of both, and the target stays what it was."""
    bend(dome)
    piece = api.simulate(api.load(dome))
    api.show(piece, dome)
    seen = dome.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.array([vertex.co for vertex in seen.vertices])
    assert points == pytest.approx(piece.result.simulation.vertices, abs=1e-6)
    assert mesh.read_surface(dome, bpy.context.scene).polygons.vertices == pytest.approx(
        piece.source.vertices, abs=1e-7
    )
    shape_keys.equilibrium_key(dome.data).value = 0.0
    bpy.context.view_layer.update()
    seen = dome.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert np.array([vertex.co for vertex in seen.vertices]) == pytest.approx(piece.source.vertices, abs=1e-6)


@pytest.mark.parametrize(
    "far", [(1e7, 1e7, 1e7), *(pytest.param(k, marks=pytest.mark.thorough) for k in ((5e3, 0, 0), (1e6, -1e6, 3e5)))]
)
def test_an_object_far_away_stays_there_and_is_made_all_the_same(dome: Any, far: tuple) -> None:
    near = api.spirals(api.load(dome))
    dome.location = far
    bpy.context.view_layer.update()
    made = api.spirals(api.load(dome))
    sides = [np.sort(np.linalg.norm(np.diff(one.result.flat.corners, axis=1), axis=2).ravel()) for one in (near, made)]
    assert sides[0] == pytest.approx(sides[1], abs=1e-5)
    api.show(made, dome)
    assert tuple(dome.location) == pytest.approx(far)
    points = np.array([vertex.co for vertex in dome.data.vertices])
    assert points == pytest.approx(DOME.vertices, abs=1e-6)


def test_an_object_of_another_file_has_a_button_that_makes_it_local(dome: Any, tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.objects = ["m"]
    obj = wanted.objects[0]
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    with pytest.raises(FlexMapsError, match="local"):
        mesh.read_surface(obj, bpy.context.scene)
    assert "Make local" in draw()
    obj.select_set(True)
    bpy.ops.object.make_local(type="SELECT_OBDATA")
    assert mesh.read_surface(bpy.context.object, bpy.context.scene).polygons.vertices == pytest.approx(
        DOME.vertices, abs=1e-6
    )
    assert "Make local" not in draw()
