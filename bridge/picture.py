"""Pictures of a finished job: a white ground, soft light, a camera that fits. Cycles on the CPU, so no screen is needed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ..engine import colours
from ..engine.errors import FlexMapsError
from . import beside, equilibrium, overlay

SIZE = (1280, 720)
SAMPLES = 6  # a pixel; the denoiser does the rest
MARGIN = 1.1


def layout(obj: bpy.types.Object, path: str | Path, size: tuple[int, int] = SIZE, samples: int = SAMPLES) -> None:
    """The model from above and one side, in the colours of its patches, quads as thin and seams as dark lines."""
    _model(obj, path, "PATCH", 0.0, size, samples)


def shape(obj: bpy.types.Object, path: str | Path, size: tuple[int, int] = SIZE, samples: int = SAMPLES) -> None:
    """The shape that the simulation found, coloured by its distance to the target, with a scale.

    Raises ``FlexMapsError`` where nothing was simulated yet.
    """
    if equilibrium.key_of(obj.data) is None:
        raise FlexMapsError("There is no simulated shape yet; press Simulate first")
    _model(obj, path, "DISTANCE", 1.0, size, samples)


def _model(
    obj: bpy.types.Object, path: str | Path, kind: str, share: float, size: tuple[int, int], samples: int
) -> None:
    """The model in an overlay's colours, at its target, share = 0, or at its equilibrium, 1."""
    overlay.store(obj, kind)
    with equilibrium.shown_at(obj, share), _studio([obj], np.array([0.9, -1.0, 1.15]), size, samples) as scene:
        added = _lines(obj, scene)
        if kind != "PATCH":
            added += _legend(scene, overlay.legend_of(obj, kind))
        try:
            _render(scene, path)
        finally:
            for item in added:
                data = item.data
                bpy.data.objects.remove(item)
                bpy.data.batch_remove([data])


def panels(obj: bpy.types.Object, path: str | Path, size: tuple[int, int] = SIZE, samples: int = SAMPLES) -> None:
    """What lies flat beside the model, straight from above. Raises ``FlexMapsError`` where nothing is there yet."""
    found = beside.existing(obj)
    shown = [o for o in found.objects if not o.hide_render] if found is not None else []
    if not shown:
        raise FlexMapsError("There are no flat patches yet; merge or flatten first")
    with _studio(shown, np.array([0.0, 0.0, 1.0]), size, samples) as scene:
        _render(scene, path)


@contextmanager
def _studio(
    shown: list[bpy.types.Object], direction: np.ndarray, size: tuple[int, int], samples: int
) -> Iterator[bpy.types.Scene]:
    """A scene of its own with only these objects, light, ground and a camera looking against ``direction`` (3,)."""
    scene = bpy.data.scenes.new("FlexMaps picture")
    made: list[bpy.types.ID] = []
    try:
        for obj in shown:
            scene.collection.objects.link(obj)
        points = _corners(shown)
        _settings(scene, size, samples)
        made += _light(scene, points)
        made += _camera(scene, points, direction)
        yield scene
    finally:
        world = scene.world
        bpy.data.scenes.remove(scene)
        for item in made:
            bpy.data.batch_remove([item])
        if world is not None:
            bpy.data.worlds.remove(world)


def _corners(shown: Iterable[bpy.types.Object]) -> np.ndarray:
    """(N, 3): points that enclose the objects tightly enough to frame them: the vertices of meshes, boxes of others."""
    found = []
    for obj in shown:
        matrix = np.array(obj.matrix_world)
        if obj.type == "MESH":
            points = equilibrium.shown_positions(obj.data).astype(float)
        else:
            points = np.array(obj.bound_box, dtype=float)
        found.append(points @ matrix[:3, :3].T + matrix[:3, 3])
    return np.concatenate(found)


def _settings(scene: bpy.types.Scene, size: tuple[int, int], samples: int) -> None:
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = 100
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGB"
    render.image_settings.compression = 60
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = True
    cycles.denoising_prefilter = "NONE"
    if hasattr(cycles, "denoising_quality"):
        cycles.denoising_quality = "FAST"
    cycles.max_bounces = 3
    cycles.use_auto_tile, cycles.tile_size = True, 256  # a third of the memory of one large tile
    cycles.seed = 0
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"


def _light(scene: bpy.types.Scene, points: np.ndarray) -> list[bpy.types.ID]:
    """A bright sky, one large soft lamp from the upper left, and a white ground under the lowest point."""
    low, high = points.min(axis=0), points.max(axis=0)
    radius = float(np.linalg.norm(high - low)) / 2
    middle = (low + high) / 2
    world = bpy.data.worlds.new("FlexMaps picture")
    world.use_nodes = True
    sky = world.node_tree.nodes["Background"]
    sky.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    sky.inputs["Strength"].default_value = 0.70
    scene.world = world

    lamp = bpy.data.lights.new("FlexMaps lamp", "SUN")
    lamp.energy = 1.55
    lamp.angle = 0.6
    sun = bpy.data.objects.new("FlexMaps lamp", lamp)
    sun.rotation_euler = (0.55, -0.42, 0.0)
    scene.collection.objects.link(sun)

    reach = 60 * radius
    ground = beside.quads(
        "FlexMaps ground",
        np.array([[-reach, -reach, 0], [reach, -reach, 0], [reach, reach, 0], [-reach, reach, 0]], dtype=float),
        np.array([[0, 1, 2, 3]]),
    )
    paper = bpy.data.materials.new("FlexMaps ground")
    paper.use_nodes = True
    paper.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.88, 0.88, 0.88, 1.0)
    paper.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 1.0
    ground.materials.append(paper)
    floor = bpy.data.objects.new("FlexMaps ground", ground)
    floor.location = (middle[0], middle[1], low[2] - 0.002 * radius)
    scene.collection.objects.link(floor)
    return [sun, lamp, floor, ground, paper]


def _camera(scene: bpy.types.Scene, points: np.ndarray, direction: np.ndarray) -> list[bpy.types.ID]:
    """A camera that sees all points with a little room; straight from above without perspective."""
    from mathutils import Vector

    data = bpy.data.cameras.new("FlexMaps camera")
    camera = bpy.data.objects.new("FlexMaps camera", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    low, high = points.min(axis=0), points.max(axis=0)
    radius = float(np.linalg.norm(high - low)) / 2
    data.clip_start, data.clip_end = 0.01 * radius, 200 * radius
    camera.rotation_euler = Vector(direction).to_track_quat("Z", "Y").to_euler()
    width, height = scene.render.resolution_x, scene.render.resolution_y
    middle = (low + high) / 2
    if abs(direction[2]) > 0.999 * np.linalg.norm(direction):
        data.type = "ORTHO"  # its scale is the extent along the picture's longer side
        across = MARGIN * np.ptp(points, axis=0)[:2] / np.array([width, height])
        data.ortho_scale = float(across.max()) * max(width, height)
        camera.location = (middle[0], middle[1], high[2] + 5 * radius)
        return [camera, data]
    data.lens = 70.0
    graph = scene.view_layers[0].depsgraph
    graph.update()
    thinned = points[:: max(1, len(points) // 20000)]
    camera.location, _ = camera.camera_fit_coords(graph, (middle + MARGIN * (thinned - middle)).ravel().tolist())
    return [camera, data]


def _lines(obj: bpy.types.Object, scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The edges of the model as thin round lines, its seams and borders as thicker, darker ones."""
    data = obj.data
    pairs = np.empty(2 * len(data.edges), np.int32)
    cut, corners = np.empty(len(data.edges), bool), np.empty(len(data.loops), np.int32)
    data.edges.foreach_get("vertices", pairs)
    data.edges.foreach_get("use_seam", cut)
    data.loops.foreach_get("edge_index", corners)
    border = np.bincount(corners, minlength=len(data.edges)) == 1
    matrix = np.array(obj.matrix_world)
    world = equilibrium.shown_positions(data).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    pairs = pairs.reshape(-1, 2)
    edge = float(np.median(np.linalg.norm(world[pairs[:, 0]] - world[pairs[:, 1]], axis=1)))
    bold = max(0.05 * edge, 0.0022 * float(np.linalg.norm(np.ptp(world, axis=0))))
    made = []
    for name, chosen, radius, grey in (
        ("quad", ~(cut | border), 0.014 * edge, 0.32),
        ("seam", cut | border, bold, 0.1),
    ):
        curve = beside.lines(f"FlexMaps {name} lines", [world[p] for p in _chains(pairs[chosen])], radius)
        colour = colours.linear(np.array([grey, grey, 1.25 * grey]))
        curve.materials.append(beside.material(f"FlexMaps {name} line", colour))
        made.append(bpy.data.objects.new(curve.name, curve))
        scene.collection.objects.link(made[-1])
    return made


def _legend(scene: bpy.types.Scene, legend: overlay.Legend) -> list[bpy.types.Object]:
    """A colour bar with its numbers in the picture's upper left corner, close before the camera; lit by nothing."""
    camera = scene.camera
    near = 2.0 * camera.data.clip_start
    percent = near * camera.data.sensor_width / camera.data.lens / 100  # of the picture's width
    left, top = -47.0, 50.0 * scene.render.resolution_y / scene.render.resolution_x - 4.0
    made = []

    def place(data: bpy.types.ID, x: float, y: float) -> None:
        item = bpy.data.objects.new("FlexMaps legend", data)
        item.parent, item.location, item.scale = camera, (x * percent, y * percent, -near), (percent,) * 3
        item.visible_shadow = item.visible_diffuse = item.visible_glossy = False
        scene.collection.objects.link(item)
        made.append(item)

    for text, x, y, align in (
        (legend.title, left, top, "LEFT"),
        (legend.low, left, top - 4.6, "LEFT"),
        (legend.high, left + 20.0, top - 4.6, "RIGHT"),
    ):
        letters = bpy.data.curves.new("FlexMaps legend", "FONT")
        letters.body, letters.size, letters.align_x = text, 1.9, align
        letters.materials.append(beside.glowing("FlexMaps ink", colours.linear(colours.SEAM)))
        place(letters, x, y)
    if legend.scale is not None:
        steps = np.linspace(0.0, 1.0, 41)
        low, high = np.c_[20.0 * steps, 0 * steps, 0 * steps], np.c_[20.0 * steps, 0 * steps + 1.6, 0 * steps]
        index = np.arange(40)
        bar = beside.quads(
            "FlexMaps legend",
            np.concatenate([low, high]),
            np.stack([index, index + 1, index + 42, index + 41], axis=1),
        )
        beside.paint(bar, np.repeat(colours.on_scale(steps[:-1] + 0.0125, 0.0, 1.0, legend.scale), 4, axis=0))
        bar.materials.append(beside.glowing("FlexMaps scale", None))
        place(bar, left, top - 2.4)
    return made


def _chains(pairs: np.ndarray) -> list[list[int]]:
    """Edges (n, 2) put together into chains of vertices that end where more or less than two edges meet."""
    at: dict[int, list[int]] = {}
    for k, (a, b) in enumerate(pairs.tolist()):
        at.setdefault(a, []).append(k)
        at.setdefault(b, []).append(k)
    used = [False] * len(pairs)
    chains = []

    def walk(start: int, k: int) -> None:
        chain = [start]
        while not used[k]:
            used[k] = True
            a, b = pairs[k].tolist()
            chain.append(b if chain[-1] == a else a)
            onward = [e for e in at[chain[-1]] if not used[e]]
            if len(at[chain[-1]]) != 2 or not onward:
                break
            k = onward[0]
        chains.append(chain)

    for vertex, edges in at.items():
        if len(edges) != 2:
            for k in edges:
                if not used[k]:
                    walk(vertex, k)
    for k in range(len(pairs)):
        if not used[k]:
            walk(int(pairs[k, 0]), k)
    return chains


def _render(scene: bpy.types.Scene, path: str | Path) -> None:
    scene.render.filepath = str(Path(path).absolute())
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:
        raise FlexMapsError(f"The picture {path} could not be made: {error}") from error
