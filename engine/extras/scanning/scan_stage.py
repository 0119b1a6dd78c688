"""Stage that compares the piece with a scan: its run function, output and plot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ... import colours
from ...display import plots
from ...display.drawing import Drawing
from ...display.plots import Colouring
from ...display.run_plots import MapValues
from ...errors import FlexMapsError
from ...params import Settings
from ...progress import Progress
from ...runs.outputs import StageOutput, provenance
from ...runs.result import Result
from ...simulation import simulate
from . import compare
from .compare import Comparison
from .scan_reader import Scan

PLOTS = ("scan",)


@dataclass(frozen=True, eq=False)
class ScanComparison(StageOutput):
    """Output of the stage: comparison of the scan with the simulated shape, or with the target if there is none."""

    name = "scan"
    scan: Comparison

    def map_values(self) -> dict[str, np.ndarray]:
        """Return the values per quad to plot: distance of the scan, mm, negative where it does not cover the spiral."""
        return {"scan": self.scan.shown_mm}


def run(result: Result, settings: Settings, progress: Progress) -> Result:
    """Compare the user's scan with the simulated shape, or with the target if there is none.

    Parameters
    ----------
    result : results of the piece so far; ``user.scanned`` is the scan
    settings : settings of all stages
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : there is no scan, or it does not lie on the shape
    """
    scanned, rest, mesh = result.user.scanned, result.user.rest, result.mesh
    if not isinstance(scanned, Scan):
        raise FlexMapsError("There is no scan to compare with; give its file to 'compare'")
    shape = None
    if result.simulation is not None:
        shape = result.simulation.vertices
    elif rest is not None and result.design is not None:
        shape = simulate.move_vertices(result.design, rest, mesh)
    found = compare.compare_scan(
        mesh if shape is None else mesh.with_vertices(shape), scanned, shape is not None, progress
    )
    made = provenance("compare", settings, result.inputs("mesh", "simulation"))
    return result.with_outputs(ScanComparison(found, **made))


def drawings(shown: MapValues, described: Mapping[str, Any]) -> dict[str, Drawing]:
    """Return the map of the scan's distance, grey where the scan does not cover the piece; empty without a scan.

    Parameters
    ----------
    shown : values per quad
    described : the whole report
    """
    mm = shown.more.get("scan")
    if mm is None or not (mm >= 0).any():
        return {}
    block = described.get("scan", {})
    high = max(float(mm.max()), colours.LEAST_DISTANCE)
    title = "Distance of the scan" + (f", RMS {block['rms_mm']:.3g} mm" if "rms_mm" in block else "")
    far = Colouring.from_values(title, np.maximum(mm, 0.0), "mm", colours.ERROR_SCALE, 0.0, high)
    far = replace(far, fills=np.where((mm < 0)[:, None], colours.MISSING_GREY, far.fills))
    shape, mesh = shown.mesh.vertices if shown.shape is None else shown.shape, shown.mesh
    return {"scan": plots.draw_shape_map(shape, mesh.quads, np.zeros((len(mesh.quads), 4), bool), far)}


def notes(described: Mapping[str, Any]) -> list[tuple[bool, str]]:
    """Return the notes for the top of the report as (is a warning, text)."""
    scan = described["scan"]
    return [(False, f"Scan {scan['file']}: {text}") for text in scan["remarks"]]
