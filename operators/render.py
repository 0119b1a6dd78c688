"""Render a picture or film of target, assembled piece and panels; with a window, in a second Blender process."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import stored_report
from ..bridge.store.i18n import translate
from ..bridge.store.paths import list_pictures, resolve_picture
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from .file_writer import FileWriter
from .stage import StageOperator, Work

if TYPE_CHECKING:
    from ..bridge.store.surface import ObjectSurface


class Render(FileWriter, StageOperator["list[Path]"], bpy.types.Operator):
    """Take a picture of the target, the assembled piece and its flat panels, with light and materials of its own; your scene is left alone"""

    bl_idname = "flexmaps.render"
    bl_label = "Render"

    _temporary_folder: Any = None  # temporary folder for the second process
    _path = Path()  # file of the picture or film
    _guard: Any = None  # an ``engine.own_files.Guard`` against overwriting the user's files

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return stored_report.missing_result(obj.data, "design")

    def prepare(self, surface: ObjectSurface, settings: ObjectSettings) -> Work[list[Path]]:
        """Build the scene, which is fast, and return the work that renders it in a second Blender process.

        Rendering in this process would block the window for minutes.
        """
        from ..bridge.hosts import second_render
        from ..bridge.store.objects import find_by_uid
        from ..bridge.view import picture

        obj, params = find_by_uid(surface.uid), settings.render
        self._path = resolve_picture(params.file, params.film)
        self._guard = self.guard(settings, list_pictures(self._path))
        self._temporary_folder = tempfile.TemporaryDirectory(prefix="flexmaps-")
        pack, made = Path(self._temporary_folder.name) / "scene.blend", Path(self._temporary_folder.name) / "made"
        frames = 0
        try:
            if params.film:
                frames = picture.render_film(obj, made / self._path.name, params, pack)
            else:
                picture.render_together(obj, made / self._path.name, params, pack)
        except FlexMapsError:
            self._temporary_folder.cleanup()
            raise
        return lambda progress: second_render.render(pack, made, frames, progress)

    def _write(self, context: bpy.types.Context, result: list[Path]) -> Iterator[None]:
        from ..engine import files

        for one in result:
            with files.write_atomically(self._path.with_name(one.name), self._guard) as new:
                shutil.copyfile(one, new)
        if self._path in [self._path.with_name(one.name) for one in result] and self._path.suffix == ".png":
            self._report_picture(self._path)
        else:
            self.report(
                {"INFO"},
                translate("{} file in {}" if len(result) == 1 else "{} files in {}", len(result), self._path.parent),
            )
        yield

    def _clear(self, context: bpy.types.Context) -> None:
        super()._clear(context)
        if self._temporary_folder is not None:
            self._temporary_folder.cleanup()
            self._temporary_folder = None

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..bridge.store import settings
        from ..bridge.view import picture
        from ..engine import files

        try:
            used = settings.read(context.object.flexmaps, ObjectSettings)
            params, path = used.render, resolve_picture(used.render.file, used.render.film)
            guard = self.guard(used, list_pictures(path))
            if params.film:
                path.parent.mkdir(parents=True, exist_ok=True)
                count = picture.render_film(context.object, path, params)
                self.report({"INFO"}, translate("{} frames in {}", count, path.parent))
                return {"FINISHED"}
            with files.write_atomically(path, guard) as new:
                picture.render_together(context.object, new, params)
        except FlexMapsError as error:
            return self._report_error(context, error)
        self._report_picture(path)
        return {"FINISHED"}

    def _report_picture(self, path: Path) -> None:
        shown = bpy.data.images.load(str(path), check_existing=True)
        shown.reload()
        self.report({"INFO"}, translate("{}, {} x {} pixels, in {}", path.name, *shown.size, path.parent))


CLASSES = (Render,)
