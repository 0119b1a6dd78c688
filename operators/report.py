"""Report a piece and its quality as an HTML page and as pictures in the image editor."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store.i18n import translate
from ..bridge.store.paths import file_name, resolve_folder
from ..bridge.store.settings import is_relative_to_unsaved
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage
from .file_writer import FolderWriter

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.runs.result import Result

    # name of the piece, kind of plot -> pixels, and the page's folder or None
    Plots = tuple[str, dict[str, np.ndarray], Path | None]


class Report(FolderWriter, ContinuedStage["Plots"], bpy.types.Operator):
    """Draw plots and maps of everything done so far as pictures for the image editor, and write a page with all figures into the export folder"""

    bl_idname = "flexmaps.report"
    bl_label = "Report"

    files: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Page", description="Also write the page and the plots as files, where the export goes", default=True
    )
    browse: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Open", description="Show the page in the web browser", default=False, options={"SKIP_SAVE"}
    )

    # Future of the triangulated letters; ``while_running`` makes them, because Blender then redraws all windows
    _letters: Any = None

    required_output = "flat"
    reads_loads = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[Plots]:
        from ..bridge.hosts import pages
        from ..bridge.view import report as held
        from ..engine.runs import report_page

        content = held.complete_input(obj, snapshot)
        letters = self._letters = Future()
        export_folder, folder = snapshot.settings.export.folder, None
        if self.files and not is_relative_to_unsaved(export_folder):
            folder = resolve_folder(export_folder) / f"{file_name(snapshot.name)}-report"
            guard = self.guard(snapshot.settings, report_page.stale_files(folder), folder)

        def go_on(result: Result, progress: Progress) -> Plots:
            from ..engine import files
            from ..engine.display import raster

            page = pages.content_of_object(result, content, progress.part(0.0, 0.2))
            drawn, view = page.plots, page.view_json(progress.part(0.2, 0.5)) if folder is not None else None
            while not letters.done():  # keep reporting progress, so that a cancel is noticed
                progress(0.5, "Waiting for letters")
                time.sleep(0.02)
            shown, drawing_it = {}, progress.part(0.5, 0.9)
            for k, (kind, drawing) in enumerate(drawn.items()):
                drawing_it(k / len(drawn), f"Drawing: {drawing.title}")
                shown[kind] = raster.render_drawing(drawing, letters.result())
            if folder is not None:
                with files.write_all_atomically(report_page.stale_files(folder), folder, guard) as new:
                    rest = progress.part(0.9, 1.0)
                    report_page.write_page(page.report, drawn, folder, new, progress=rest, piece=view)
            return snapshot.name, shown, folder

        return go_on

    def while_running(self) -> None:
        from ..bridge.view import images

        self._letters.set_result(images.glyphs())

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: Plots) -> str:
        from ..engine.runs import report_page as pages

        _, shown, folder = result
        if folder is None:
            text = "{} pictures for the image editor; save the .blend file to get the page too"
            return translate(text, len(shown))
        page = folder / pages.PAGE
        if self.browse and not bpy.app.background:
            bpy.ops.wm.url_open(url=page.as_uri())
        return translate("{} pictures for the image editor; {}", len(shown), page)

    def after_write(self, context: bpy.types.Context, obj: bpy.types.Object, result: Plots) -> Iterator[None]:
        from ..bridge.view import images

        name, shown, _ = result
        for kind, pixels in shown.items():
            made = images.store_image(f"{name} {kind}", pixels)
            for window in context.window_manager.windows:
                for area in window.screen.areas:
                    if area.type == "IMAGE_EDITOR" and area.spaces.active.image is None:
                        area.spaces.active.image = made
            yield


class Share(FolderWriter, ContinuedStage["tuple[Path, bool]"], bpy.types.Operator):
    """Write one page that holds the piece in 3D, to send to somebody who has only a browser: from flat panels to the shape, and how to join them step by step"""

    bl_idname = "flexmaps.share"
    bl_label = "Share page"

    browse: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Open", description="Show the page in the web browser", default=False, options={"SKIP_SAVE"}
    )

    required_output = "design"

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[tuple[Path, bool]]:
        from ..bridge.hosts import pages
        from ..bridge.view import report as held

        content = held.complete_input(obj, snapshot)
        path = resolve_folder(snapshot.settings.export.folder) / f"{file_name(snapshot.name)}-share.html"
        guard = self.guard(snapshot.settings, [path])

        def go_on(result: Result, progress: Progress) -> tuple[Path, bool]:
            page = pages.content_of_object(result, content, progress.part(0.0, 0.2))
            return pages.write_share_content(page, path, guard, progress.part(0.2, 1.0)), content.pose is not None

        return go_on

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: tuple[Path, bool]
    ) -> str:
        path, simulated = result
        if self.browse and not bpy.app.background:
            bpy.ops.wm.url_open(url=path.as_uri())
        if simulated:
            return translate("The piece in 3D: {}", path)
        self.level = "WARNING"
        return translate("Not simulated yet, so the page shows flat panels and target only: {}", path)


CLASSES = (Report, Share)
