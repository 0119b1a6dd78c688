"""Studio for pictures: a temporary scene with soft light, a ground and a camera fitted to its content.

The user's scene does not change. With a window, EEVEE renders on the graphics card; without, Cycles renders on the CPU.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Float
from ...engine.errors import FlexMapsError
from ..store.columns import column
from . import collection, meshes, scene_file

MARGIN = 1.06  # size of the picture divided by the size of its content; larger leaves a wider margin
# factor on the number of samples without a denoiser; noise falls with its square root, rendering time grows with it
NO_DENOISER_FACTOR = 4
LENS = 85.0  # focal length, millimetres (a portrait lens); longer has less perspective
GROUNDS = {"WHITE": (0.93, 0.93, 0.93), "GREY": (0.66, 0.67, 0.69)}  # name of a ground -> its sRGB


@contextmanager
def studio(
    size: tuple[int, int], samples: int, ground: str = "WHITE", engine: str = "AUTO", pack: Path | None = None
) -> Iterator[Studio]:
    """Open a studio for one picture or film; everything in it is removed afterwards.

    Parameters
    ----------
    size : width and height in pixels
    samples : samples per pixel
    ground : a key of ``GROUNDS``
    engine : "AUTO", "CYCLES" or "EEVEE"
    pack : .blend file to which the scene is written instead of rendering it, for a second Blender to render
    """
    scene = bpy.data.scenes.new("FlexMaps picture")
    made = Studio(scene, ground, pack)
    try:
        _set_up_render(scene, size, samples, "CYCLES" if pack is not None else engine)
        yield made
    finally:
        made.clear()


class Studio:
    """Temporary scene for pictures.

    Add objects with ``add_data`` and ``add_object``, call ``set_up``, then ``render_picture`` or ``render_film``.
    """

    def __init__(self, scene: bpy.types.Scene, ground: str, pack: Path | None = None):
        self.scene = scene
        self._pack = pack
        self._ground = ground
        self._temporary: list[bpy.types.ID] = []
        self._framed_objects: list[bpy.types.Object] = []
        self._user_objects: list[bpy.types.Object] = []

    def add_data(self, data: bpy.types.ID, framed: bool = True) -> bpy.types.Object:
        """Add a temporary object with this data (metres); it is removed with the studio.

        Parameters
        ----------
        data : mesh or curve made for the picture
        framed : whether the camera is fitted to it
        """
        made = bpy.data.objects.new(data.name, data)
        self.add_temporary(made, data)
        if framed:
            self._framed_objects.append(made)
        return made

    def add_object(self, obj: bpy.types.Object) -> None:
        """Add an object of the user's file, with its own position and animation."""
        self.scene.collection.objects.link(obj)
        self._user_objects.append(obj)

    def add_temporary(self, *items: bpy.types.ID) -> None:
        """Add data-blocks that are removed with the studio; the camera is not fitted to them."""
        self._temporary += items
        for item in items:
            if isinstance(item, bpy.types.Object):
                self.scene.collection.objects.link(item)

    def points(self) -> Float[np.ndarray, "points 3"]:
        """Return points to which the camera is fitted: vertices and bounding boxes of the content."""
        boxes = map(collection.bounding_corners, self._user_objects)
        return np.concatenate([*(points_of(o) for o in self._framed_objects), *boxes])

    def points_in(self, frames: Iterable[int]) -> Float[np.ndarray, "points 3"]:
        """Return every fifth vertex of the user's meshes in these frames, in world axes."""
        visible, graph = [], self.scene.view_layers[0].depsgraph
        for frame in frames:
            self.scene.frame_set(frame)
            for obj in self._user_objects:
                if obj.type == "MESH":
                    there = obj.evaluated_get(graph)
                    points, matrix = vertices_of(there.data)[::5], np.array(there.matrix_world)
                    visible.append(points @ matrix[:3, :3].T + matrix[:3, 3])
        return np.concatenate(visible)

    def set_up(
        self,
        direction: Float[np.ndarray, " 3"] | tuple[float, ...],
        points: Float[np.ndarray, "points 3"] | None = None,
        tight: bool = False,
    ) -> None:
        """Add light, ground and a camera.

        Parameters
        ----------
        direction : direction from the content to the camera
        points : points to which the camera is fitted; default the whole content
        tight : whether to fit the picture's height to the points
        """
        shown = self.points() if points is None else points
        self._add_light(shown)
        self._add_camera(shown, np.asarray(direction, dtype=float), tight)

    def render_picture(self, path: str | Path) -> None:
        """Render a picture to a PNG file; raise ``FlexMapsError`` if it cannot be written."""
        self.scene.render.filepath = _escape_braces(Path(path).absolute())
        try:
            self._render(write_still=True)
        except RuntimeError as error:
            raise FlexMapsError(f"The picture {path} could not be made: {error}") from error

    def render_film(self, path: str | Path, frames: tuple[int, int], rate: tuple[int, float]) -> None:
        """Render frames to an .mp4 film, or to numbered PNG files.

        Parameters
        ----------
        path : the film if it ends in .mp4, else the path whose name the PNG files' names begin with
        frames : first and last frame
        rate : frames per second as a fraction: numerator and denominator

        Raises
        ------
        FlexMapsError : the files cannot be written
        """
        path, render = Path(path).absolute(), self.scene.render
        self.scene.frame_start, self.scene.frame_end = frames
        render.fps, render.fps_base = rate
        render.filepath = _escape_braces(path.with_suffix("")) + "-"
        if path.suffix.lower() == ".mp4":
            _set_film_output(render)
            render.filepath, render.use_file_extension = _escape_braces(path), False
        try:
            self._render(animation=True)
        except RuntimeError as error:
            raise FlexMapsError(f"The film {path} could not be made: {error}") from error

    def _render(self, **options: bool) -> None:
        if self._pack is None:
            bpy.ops.render.render(scene=self.scene.name, **options)
        else:
            scene_file.write_scene(self._pack, self.scene)

    def clear(self) -> None:
        world = self.scene.world
        bpy.data.scenes.remove(self.scene)
        for item in self._temporary:
            bpy.data.batch_remove([item])
        if world is not None:
            bpy.data.worlds.remove(world)

    # -- light ---------------------------------------------------------------------------------------------------------

    def _add_light(self, points: Float[np.ndarray, "points 3"]) -> None:
        """Add a bright sky, a soft lamp from the upper left, a weak back lamp, and a ground below the lowest point."""
        low, high = points.min(axis=0), points.max(axis=0)
        radius = float(np.linalg.norm(high - low)) / 2
        middle = (low + high) / 2
        self.scene.world = _make_sky()
        for name, strength, angle, turn in (
            ("FlexMaps lamp", 2.2, 0.45, (0.62, -0.48, 0.0)),
            ("FlexMaps back lamp", 0.4, 1.0, (-0.9, 0.55, 0.0)),
        ):
            lamp = bpy.data.lights.new(name, "SUN")
            lamp.energy, lamp.angle = strength, angle
            sun = bpy.data.objects.new(name, lamp)
            sun.rotation_euler = turn
            self.add_temporary(sun, lamp)
        reach = 60 * radius
        square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
        ground = meshes.make_quad_mesh("FlexMaps ground", reach * square, np.array([[0, 1, 2, 3]]))
        paper = bpy.data.materials.new("FlexMaps ground")
        paper.use_nodes = True
        shader = paper.node_tree.nodes["Principled BSDF"]
        shader.inputs["Base Color"].default_value = (
            *colours.srgb_to_linear(np.array(GROUNDS[self._ground])).tolist(),
            1.0,
        )
        shader.inputs["Roughness"].default_value = 1.0
        shader.inputs["Specular IOR Level"].default_value = 0.1
        ground.materials.append(paper)
        floor = bpy.data.objects.new("FlexMaps ground", ground)
        floor.location = (middle[0], middle[1], low[2] - 0.001 * radius)
        self.add_temporary(floor, ground, paper)

    # -- camera --------------------------------------------------------------------------------------------------------

    def _add_camera(
        self, points: Float[np.ndarray, "points 3"], direction: Float[np.ndarray, " 3"], tight: bool
    ) -> None:
        """Add a camera that sees all points with a margin; a view straight from above is orthographic."""
        from mathutils import Vector

        data = bpy.data.cameras.new("FlexMaps camera")
        camera = bpy.data.objects.new("FlexMaps camera", data)
        self.add_temporary(camera, data)
        scene = self.scene
        scene.camera = camera
        low, high = points.min(axis=0), points.max(axis=0)
        radius = float(np.linalg.norm(high - low)) / 2
        data.clip_start, data.clip_end = 0.01 * radius, 200 * radius
        camera.rotation_euler = Vector(direction).to_track_quat("Z", "Y").to_euler()
        width = scene.render.resolution_x
        if abs(direction[2]) > 0.999 * np.linalg.norm(direction):
            extent = MARGIN * np.ptp(points, axis=0)[:2]
            if tight:
                scene.render.resolution_y = _height_in_pixels(width, extent[1] / extent[0])
            height = scene.render.resolution_y
            data.type = "ORTHO"  # its scale is the extent along the picture's longer side
            data.ortho_scale = float((extent / np.array([width, height])).max()) * max(width, height)
            middle = (low + high) / 2
            camera.location = (middle[0], middle[1], high[2] + 5 * radius)
            camera.rotation_euler = (0.0, 0.0, 0.0)
            return
        data.lens, data.sensor_fit = LENS, "HORIZONTAL"
        axes = np.array(camera.rotation_euler.to_matrix())
        seen, half = points @ axes, 0.5 * data.sensor_width / data.lens
        if tight:
            scene.render.resolution_y = _height_in_pixels(width, _least_tangent(seen, half) / half)
        camera.location = axes @ _fit_camera(seen, half, half * scene.render.resolution_y / width)

    def clear_corner(self, x: float, y: float) -> None:
        """Shift the content to the right, out of the picture's upper left corner, but not beyond the right margin.

        Parameters
        ----------
        x, y : lower right end of this corner, relative to the picture's centre (right and up are positive), in widths
            of the picture
        """
        camera = self.scene.camera
        there = (self.points() - np.array(camera.location)) @ np.array(camera.rotation_euler.to_matrix())
        across, up = (camera.data.lens / camera.data.sensor_width * there[:, :2] / -there[:, 2:]).T
        overlap = x - across[up > y].min(initial=np.inf)
        camera.data.shift_x = -float(max(min(overlap, 0.5 / MARGIN - across.max()), 0.0))


def _escape_braces(path: Path) -> str:
    """Return the path as Blender's renderer needs it: since 4.5, braces mark templates unless they are doubled."""
    text = str(path)
    return text.replace("{", "{{").replace("}", "}}") if bpy.app.version >= (4, 5) else text


def _fit_camera(points: Float[np.ndarray, "points 3"], across: float, up: float) -> Float[np.ndarray, " 3"]:
    """Return the nearest position from which a camera sees all points.

    Parameters
    ----------
    points : points in the camera's axes; it looks along -z
    across, up : tangents of half the horizontal and half the vertical angle of view
    """
    x, y, z = points.T
    ends = []
    for side, half in ((x, across / MARGIN), (y, up / MARGIN)):
        one, two = float((side + half * z).max()), float((-side + half * z).max())
        ends.append((0.5 * (one - two), 0.5 * (one + two) / half))
    return np.array([ends[0][0], ends[1][0], max(ends[0][1], ends[1][1])])


def _least_tangent(points: Float[np.ndarray, "points 3"], across: float) -> float:
    """Return the smallest vertical angle of view that does not move the camera farther away.

    ``across`` and the result are tangents of half the horizontal and half the vertical angle of view.
    """
    far = _fit_camera(points, across, 1e3)[2]
    low, high = 1e-3 * across, 1e3 * across
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if _fit_camera(points, across, middle)[2] <= far * (1 + 1e-9) else (middle, high)
    return high


def _height_in_pixels(width: int, aspect: float) -> int:
    return int(np.clip(np.ceil(width * aspect), 0.15 * width, 2.0 * width))


def points_of(obj: bpy.types.Object) -> Float[np.ndarray, "points 3"]:
    """Return a mesh object's vertices, or another object's bounding-box corners, shifted by the object's location."""
    points = vertices_of(obj.data) if obj.type == "MESH" else np.array(obj.bound_box, dtype=float)
    return points + np.array(obj.location)


def vertices_of(mesh: bpy.types.Mesh) -> Float[np.ndarray, "vertices 3"]:
    """Return the vertices (V, 3) of a mesh in its own frame."""
    return column(mesh.vertices, "co").astype(float)


def _set_up_render(scene: bpy.types.Scene, size: tuple[int, int], samples: int, engine: str) -> None:
    render = scene.render
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = 100
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGB"
    render.image_settings.compression = 60
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    if engine == "EEVEE" or (engine == "AUTO" and not bpy.app.background):
        _use_eevee(scene, samples)
        return
    render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    denoise = _has_denoiser()
    cycles.samples = samples if denoise else NO_DENOISER_FACTOR * samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = denoise
    cycles.denoising_prefilter = "FAST"
    if hasattr(cycles, "denoising_quality"):
        cycles.denoising_quality = "BALANCED"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.transmission_bounces = 4, 2, 4
    cycles.sample_clamp_indirect = 3.0  # smaller avoids single bright pixels and darkens indirect light
    cycles.blur_glossy = 1.0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.use_auto_tile, cycles.tile_size = True, 512  # tiles take less memory than the whole picture at once
    cycles.seed = 0


def _set_film_output(render: bpy.types.RenderSettings) -> None:
    """Set the output to an MP4 film in H.264, which needs an even width and height, in pixels.

    Raise ``FlexMapsError`` if this Blender cannot write films.
    """
    try:
        if hasattr(render.image_settings, "media_type"):  # Blender 5.0 and later
            render.image_settings.media_type = "VIDEO"
        render.image_settings.file_format = "FFMPEG"
        render.ffmpeg.format, render.ffmpeg.codec = "MPEG4", "H264"
        render.ffmpeg.constant_rate_factor = "HIGH"
    except TypeError as error:
        raise FlexMapsError("This Blender writes no films; give a file that ends in .png") from error
    render.resolution_x += render.resolution_x % 2
    render.resolution_y += render.resolution_y % 2


def _has_denoiser() -> bool:
    """Return whether this Blender has a denoiser; some Linux distributions' builds lack it, and a render would fail."""
    import _cycles

    return bool(_cycles.with_openimagedenoise)


def _use_eevee(scene: bpy.types.Scene, samples: int) -> None:
    """Select EEVEE, whose name differs between Blender's versions, and set its quality."""
    known = {item.identifier for item in bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items_static_ui}
    scene.render.engine = "BLENDER_EEVEE_NEXT" if "BLENDER_EEVEE_NEXT" in known else "BLENDER_EEVEE"
    eevee: bpy.types.SceneEEVEE = scene.eevee
    eevee.taa_render_samples = max(samples, 32)
    eevee.use_shadows = True
    eevee.use_raytracing = True


def _make_sky() -> bpy.types.World:
    """Make a sky that is white above and darker towards the horizon, so that glossy surfaces show reflections."""
    world = bpy.data.worlds.new("FlexMaps picture")
    world.use_nodes = True
    tree = world.node_tree
    sky = tree.nodes["Background"]
    sky.inputs["Strength"].default_value = 0.5
    world.cycles.sampling_method = "NONE"  # no importance sampling, which such an even sky does not need
    where = tree.nodes.new("ShaderNodeTexCoord")
    parts = tree.nodes.new("ShaderNodeSeparateXYZ")
    ramp = tree.nodes.new("ShaderNodeMapRange")
    for name, value in (("From Min", -0.2), ("From Max", 0.9), ("To Min", 0.55), ("To Max", 1.1)):
        ramp.inputs[name].default_value = value
    tree.links.new(where.outputs["Generated"], parts.inputs["Vector"])
    tree.links.new(parts.outputs["Z"], ramp.inputs["Value"])
    tree.links.new(ramp.outputs["Result"], sky.inputs["Color"])
    return world
