"""The file of the tutorial, ``data/lamp_shade.blend``: a lamp shade in a room, ready for the first button.

``python3 tools/dev.py --python 3.11 python tools/lamp_shade.py`` makes it anew. It is committed, for the extension carries it, and made with the
older of the two Blenders, whose files all Blenders from 4.2 on can open; those of 5.0 and newer cannot be opened by 4.2.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from flexmaps.engine.surface.mesh import QuadMesh

ROOT = Path(__file__).resolve().parent.parent
FILE, NAME = ROOT / "data" / "lamp_shade.blend", "Lamp shade"
AROUND, ROWS = 30, 11  # quads: of about 20 mm, few enough that cutting and joining take an hour each at most
# (radius, height) in metres, a cubic Bezier curve from the lower to the upper rim; with the next two chosen by eye among eight
# shapes that all ended within 1 % of the target, of which this one has its panels on one sheet
PROFILE = np.array([[0.125, 0.0], [0.09, 0.05], [0.13, 0.17], [0.035, 0.185]])
LOBES, DEPTH, TURN = (
    6,
    0.08,
    0.6,
)  # waves round the shade, as a share of the radius; radians that they turn by from rim to rim
HANGS = 0.10  # metres from the table to the lower rim


def surface() -> QuadMesh:
    """A bell with six soft waves that turn as they rise; metres, its lower rim at z = 0."""
    t, phi = np.meshgrid(
        np.linspace(0.0, 1.0, ROWS + 1), np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False), indexing="ij"
    )
    weights = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=-1)
    radius, z = np.moveaxis(weights @ PROFILE, -1, 0)
    radius = radius * (1.0 + DEPTH * np.sin(np.pi * t) * np.cos(LOBES * (phi - TURN * t)))
    vertices = np.stack([radius * np.cos(phi), radius * np.sin(phi), z], axis=-1).reshape(-1, 3)
    index = np.arange(AROUND * (ROWS + 1)).reshape(ROWS + 1, AROUND)
    following = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], following[:-1], following[1:], index[1:]], axis=-1).reshape(-1, 4)
    return QuadMesh(vertices, quads)


def begin() -> tuple[Any, Any]:
    """A new file with the shade and the room that it hangs in; the model and its scene."""
    import bpy
    from flexmaps.bridge.view import scene

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    place = bpy.context.scene
    place.name = NAME
    place.unit_settings.length_unit = "MILLIMETERS"
    room(place)
    obj = scene.add_model(place, surface(), NAME)
    obj.flexmaps.spiral.border = "left_out"  # arms that end in the air would be the first to break
    obj.location.z = HANGS
    bpy.context.view_layer.update()
    return obj, place


# -- the room ----------------------------------------------------------------------------------------------------------


def room(scene: Any) -> None:
    """A table before a wall, the lamp's cord and bulb, soft light from the left, and a camera; all of it in a collection of its own."""
    import bpy

    own = bpy.data.collections.new("Room")
    scene.collection.children.link(own)

    def add(obj: Any, place: tuple[float, float, float], turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
        obj.location, obj.rotation_euler = place, turn
        obj.hide_select = True
        own.objects.link(obj)
        return obj

    top = HANGS + float(PROFILE[-1, 1])
    add(_stage(_matt("Paper", (0.50, 0.53, 0.55), 0.85)), (0.0, 0.0, 0.0))
    add(_pipe("Cord", [(0.0, 0.0, top - 0.02), (0.0, 0.0, top + 1.2)], 0.0025, _matt("Cord", (0.02, 0.02, 0.02), 0.6)), (0.0, 0.0, 0.0))  # fmt: skip
    add(_pipe("Lampholder", [(0.0, 0.0, top - 0.075), (0.0, 0.0, top - 0.01)], 0.017, _matt("Brass", (0.75, 0.53, 0.24), 0.3, metal=1.0)), (0.0, 0.0, 0.0))  # fmt: skip
    bulb = add(_ball("Bulb", 0.032, _glow("Bulb", (1.0, 0.70, 0.38), 5.0)), (0.0, 0.0, top - 0.105))
    bulb.visible_shadow = False  # the lamp inside it lights the room
    glow = bpy.data.lights.new("Lamplight", "POINT")
    glow.energy, glow.color, glow.shadow_soft_size = 2.4, (1.0, 0.66, 0.36), 0.012
    add(bpy.data.objects.new("Lamplight", glow), (0.0, 0.0, top - 0.105))
    window = bpy.data.lights.new("Window", "AREA")
    window.energy, window.size, window.color = 9.0, 1.2, (0.80, 0.90, 1.0)
    add(bpy.data.objects.new("Window", window), (-1.3, -0.9, 1.3), (0.87, 0.0, -0.96))
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 50.0
    scene.camera = add(bpy.data.objects.new("Camera", camera), (-0.14, -1.1, 0.50), (1.262, 0.0, 0.0))
    world = bpy.data.worlds.new("Dusk")
    world.use_nodes = True
    sky = world.node_tree.nodes["Background"]
    sky.inputs["Color"].default_value, sky.inputs["Strength"].default_value = (0.42, 0.52, 0.66, 1.0), 0.10
    scene.world = world
    render = scene.render
    render.engine, render.resolution_x, render.resolution_y = "CYCLES", 1920, 1080
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Medium High Contrast"
    scene.cycles.samples, scene.cycles.use_denoising = 128, True


def _stage(look: Any) -> Any:
    """Table and wall as one sheet of paper that is bent up behind, as photographers use it; metres."""
    import bpy

    turn = np.linspace(0.0, 0.5 * np.pi, 25)
    depth, bend, far = -2.5, 0.25, 0.5
    y = np.concatenate([[depth], far - bend + bend * np.sin(turn), [far]])
    z = np.concatenate([[0.0], bend - bend * np.cos(turn), [3.0]])
    points = np.concatenate([np.stack([np.full_like(y, x), y, z], axis=1) for x in (-4.0, 4.0)])
    k = np.arange(len(y) - 1)
    mesh = bpy.data.meshes.new("Stage")
    mesh.from_pydata(points.tolist(), [], np.stack([k, k + len(y), k + len(y) + 1, k + 1], axis=1).tolist())
    mesh.shade_smooth()
    mesh.materials.append(look)
    return bpy.data.objects.new("Stage", mesh)


def _pipe(name: str, points: list[tuple[float, float, float]], radius: float, look: Any) -> Any:
    import bpy

    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions, curve.bevel_depth, curve.use_fill_caps = "3D", radius, True
    line = curve.splines.new("POLY")
    line.points.add(len(points) - 1)
    for point, at in zip(line.points, points, strict=True):
        point.co = (*at, 1.0)
    curve.materials.append(look)
    return bpy.data.objects.new(name, curve)


def _ball(name: str, radius: float, look: Any) -> Any:
    import bmesh
    import bpy

    mesh, shape = bpy.data.meshes.new(name), bmesh.new()
    bmesh.ops.create_uvsphere(shape, u_segments=24, v_segments=16, radius=radius)
    shape.to_mesh(mesh)
    shape.free()
    mesh.shade_smooth()
    mesh.materials.append(look)
    return bpy.data.objects.new(name, mesh)


def _matt(name: str, rgb: tuple[float, float, float], rough: float, metal: float = 0.0) -> Any:
    import bpy

    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*rgb, 1.0)
    shader.inputs["Roughness"].default_value, shader.inputs["Metallic"].default_value = rough, metal
    made.diffuse_color = (*rgb, 1.0)
    return made


def _glow(name: str, rgb: tuple[float, float, float], strength: float) -> Any:
    made = _matt(name, rgb, 0.4)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Emission Color"].default_value = (*rgb, 1.0)
    shader.inputs["Emission Strength"].default_value = strength
    return made


def main() -> None:
    import bpy
    import flexmaps
    from flexmaps.bridge.view import scene

    if bpy.app.version >= (5, 0, 0):
        sys.exit("Make this file with Blender 4.5: python3 tools/dev.py --python 3.11 python tools/lamp_shade.py")
    flexmaps.register()
    begin()
    scene.save_file(FILE)
    print(f"{FILE.relative_to(ROOT)}  {FILE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # Blender as a module may wait for ever at the end of a process
