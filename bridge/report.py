"""The report page and the plots of a piece: from a job's result, or from what an object in Blender holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engine.errors import FlexMapsError
from ..engine.fabrication.export import NewFile
from ..engine.params import Settings
from ..engine.runs import drawing, job, report, report_page, report_plots
from ..engine.runs.drawing import Drawing
from ..engine.runs.report_plots import Measured
from . import arrange, overlay

if TYPE_CHECKING:
    import bpy

PAGE, PLOTS = "report.html", "plots"


def drawings(result: job.Result, described: dict[str, Any], settings: Settings) -> dict[str, Drawing]:
    """The plots of a job, by name."""
    centres = None if result.flat is None else arrange.side_by_side(result.flat)
    measured = Measured.of(result, centres)
    return report_plots.drawings(measured, described, overlay.LIMITS, settings.layout.distortion_limit)


def write(
    described: dict[str, Any],
    drawn: dict[str, Drawing],
    out: Path,
    new: NewFile,
    pictures: Sequence[tuple[str, Path]] = (),
) -> list[Path]:
    """Write the page, and every plot as an SVG file of its own beside it; returns the files, the page first.

    pictures : what they show, and PNG files
    """
    made = datetime.now().strftime("%Y-%m-%d %H:%M")
    text = report_page.page(described, drawn, [(says, file.read_bytes()) for says, file in pictures], made)
    new(out / PAGE).write_text(text, encoding="utf-8")
    written = [out / PAGE]
    for name, plot in drawn.items():
        written.append(out / PLOTS / f"{name}.svg")
        new(written[-1]).write_text(drawing.svg(plot), encoding="utf-8")
    return written


def stale(out: Path) -> list[Path]:
    """The files that ``write`` may have written before."""
    return [out / PAGE, *(out / PLOTS / f"{name}.svg" for name in report_plots.NAMES)]


def of_object(obj: bpy.types.Object) -> tuple[dict[str, Any], dict[str, Drawing]]:
    """The report and the plots of what an object holds; what its mesh has left behind is left out.

    Raises ``FlexMapsError`` where the check finds errors, or where nothing was laid out yet.
    """
    import bpy

    from ..engine.surface.check import as_quad_mesh
    from . import attributes, equilibrium, mesh, notes, stored

    found = stored.read(obj)
    if found.broken is not None:
        raise found.broken
    if found.result is None:
        as_quad_mesh(found.source)
        raise FlexMapsError(f"'{obj.name}' cannot be read as quads; press Check")
    if found.result.flat is None:
        raise FlexMapsError("There is nothing to report yet; press Merge or Flatten first")
    described = report.build(found.result, source=obj.name, settings=found.settings)
    centres = arrange.side_by_side(found.result.flat)
    measured = Measured.of(found.result, centres)
    scene = bpy.context.scene
    blocks = dict(notes.read(obj.data))
    if equilibrium.out_of_date(obj, scene):
        blocks = {name: block for name, block in blocks.items() if name not in ("equilibrium", "reach", "optimise")}
    if "equilibrium" in blocks:
        values = {name: attributes.get(obj.data, attributes.PREFIX + name) for name in ("distance", "strain", "reach")}
        surface = mesh.read_surface(obj, scene)
        with equilibrium.shown_at(obj, 1.0):
            shape = equilibrium.shown_positions(obj.data).astype(float)
        world = shape @ surface.to_metres[:3, :3].T + surface.to_metres[:3, 3]
        used = np.unique(surface.polygons.corners)
        measured = replace(
            measured, shape=world[used], distance=values["distance"], strain=values["strain"], kind=values["reach"]
        )
    described |= {name: block for name, block in blocks.items() if name != "checks"}
    described["checks"] = blocks.get("checks", described["checks"])
    limit = found.settings.layout.distortion_limit
    return described, report_plots.drawings(measured, described, overlay.LIMITS, limit)
