"""Write the HTML report, and the page to share (one HTML file), for a piece of the API or an object in Blender."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...engine import files
from ...engine.display.drawing import Drawing
from ...engine.errors import FlexMapsError
from ...engine.own_files import Guard
from ...engine.params import ObjectSettings
from ...engine.progress import SILENT, Progress
from ...engine.runs import page_data, report, report_page, share_page, stages
from ...engine.runs.page_data import ViewContent
from ...engine.runs.piece import Piece
from ...engine.runs.result import Result
from ..view import report as object_report

if TYPE_CHECKING:
    import bpy


@dataclass(frozen=True, eq=False)
class PageContent:
    """Content of an HTML page.

    report : the report
    plots : plots by name
    view_content : content of the 3D view; None without spirals
    settings : settings of the piece
    failure : why there are no spirals, if known
    """

    report: dict[str, Any]
    plots: dict[str, Drawing]
    view_content: ViewContent | None
    settings: ObjectSettings
    failure: FlexMapsError | None = None

    def view_json(self, progress: Progress = SILENT) -> str | None:
        """Return the 3D view's data as JSON; None without spirals, or if the settings ask for no 3D view."""
        if self.view_content is None or not self.settings.page.viewer:
            return None
        return page_data.to_json(self.view_content, self.settings, report_page.title_of(self.report), progress)


def build_report(piece: Piece | bpy.types.Object) -> dict[str, Any]:
    """Return the report of a piece or an object."""
    if isinstance(piece, Piece):
        return report.build_report(piece.result, source=piece.name, settings=piece.settings)
    return _content_of(piece).report


def write(piece: Piece | bpy.types.Object, out: Path, guard: Guard, progress: Progress = SILENT) -> dict[str, Any]:
    """Write the HTML report with its plots, and report.json, into a folder; return the report.

    Parameters
    ----------
    piece : a piece or an object
    out : the folder
    guard : protects the user's files from being replaced
    progress : called with a fraction and a text
    """
    guard.check([*report_page.stale_files(out), out / "report.json"], out)
    content = _content_of(piece)
    view = content.view_json(progress.part(0.0, 0.9))
    with files.write_all_atomically(report_page.stale_files(out), out, guard) as new:
        report_page.write_page(content.report, content.plots, out, new, progress=progress.part(0.9, 1.0), piece=view)
        new(out / "report.json").write_text(json.dumps(content.report, indent=2) + "\n", encoding="utf-8")
    return content.report


def write_share_page(piece: Piece | bpy.types.Object, path: Path, guard: Guard, progress: Progress = SILENT) -> Path:
    """Write the page to share (one HTML file with the 3D view) of a piece or an object, and return its path.

    Parameters
    ----------
    piece : a piece or an object
    path : the .html file
    guard : protects the user's files from being replaced
    progress : called with a fraction and a text

    Raises
    ------
    FlexMapsError : there are no spirals
    """
    return write_share_content(_content_of(piece), path, guard, progress)


def write_share_content(content: PageContent, path: Path, guard: Guard, progress: Progress = SILENT) -> Path:
    """Write the page to share from its content, and return its path; touches no Blender data.

    Parameters
    ----------
    content : content of the page, such as from ``content_of_object``
    path : the .html file
    guard : protects the user's files from being replaced
    progress : called with a fraction and a text

    Raises
    ------
    FlexMapsError : there are no spirals
    """
    if content.view_content is None:
        raise content.failure or FlexMapsError(stages.MISSING["design"])
    title = report_page.title_of(content.report)
    view = page_data.to_json(content.view_content, content.settings, title, progress.part(0.0, 0.95))
    text = share_page.render_share_page(view, title, content.report, content.plots)
    with files.write_atomically(path, guard) as new:
        new.write_text(text, encoding="utf-8")
    return path


def _content_of(piece: Piece | bpy.types.Object) -> PageContent:
    if isinstance(piece, Piece):
        figures = build_report(piece)
        drawn = report_page.draw_plots(piece.result, figures, piece.settings.layout.distortion_limit)
        return PageContent(figures, drawn, ViewContent.from_result(piece.result), piece.settings)
    read = object_report.read_input(piece)
    return content_of_object(read.snapshot.to_result(), read)


def content_of_object(
    result: Result, report_input: object_report.ReportInput, progress: Progress = SILENT
) -> PageContent:
    """Build a page's content from the input of the object's report; touches no Blender data.

    Parameters
    ----------
    result : the object's result
    report_input : input of the object's report
    progress : called with a fraction and a text
    """
    figures, drawn = object_report.build_from_input(result, report_input, progress)
    return PageContent(
        figures,
        drawn,
        object_report.view_content(result, report_input),
        report_input.snapshot.settings,
        result.lost.get("design"),
    )
