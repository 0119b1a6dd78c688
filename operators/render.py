"""A picture of the target, the assembled piece and its panels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..bridge.store import notes
from ..bridge.store.i18n import translate
from ..bridge.store.settings import unsaved
from ..engine.errors import FlexMapsError
from ..engine.params import RenderParams
from .stage import StageOperator


class Render(StageOperator, bpy.types.Operator):
    """Take a picture of the target, the assembled piece and its flat panels, with light and materials of its own; your scene is left alone"""

    bl_idname = "flexmaps.render"
    bl_label = "Render"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return notes.missing(obj.data, "design")

    def invoke(self, context: bpy.types.Context, event: Any) -> set[str]:
        return self.execute(context)  # Blender renders on its main thread

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..bridge.store import settings
        from ..bridge.view import picture
        from ..engine import files

        try:
            params = settings.read(context.object.flexmaps.render, RenderParams)
            path = file_of(params.file, params.film)
            if params.film:
                path.parent.mkdir(parents=True, exist_ok=True)
                count = picture.film(context.object, path, params)
                self.report({"INFO"}, translate("{} frames in {}", count, path.parent))
                return {"FINISHED"}
            with files.replacing(path) as new:
                picture.together(context.object, new, params)
        except FlexMapsError as error:
            return self._refused(context, error)
        shown = bpy.data.images.load(str(path), check_existing=True)
        shown.reload()
        self.report({"INFO"}, translate("{}, {} x {} pixels, in {}", path.name, *shown.size, path.parent))
        return {"FINISHED"}


def file_of(text: str, film: bool = False) -> Path:
    """The PNG file, or the film, that a setting names. Raises ``FlexMapsError`` where it names none."""
    if unsaved(text):
        raise FlexMapsError("Save the .blend file first, or choose a file that does not begin with //")
    if not text.strip():
        raise FlexMapsError("Choose a file for the picture")
    path = Path(bpy.path.abspath(text))
    return (
        path if path.suffix.lower() in ({".png", ".mp4"} if film else {".png"}) else path.with_name(f"{path.name}.png")
    )


CLASSES = (Render,)
