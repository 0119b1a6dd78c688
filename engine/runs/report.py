"""Build ``report.json``, the machine-readable description of a run: its input, its outputs and their quality.

Values are in SI units unless a key says otherwise, such as ``edge_mm``. Stages that have not run are absent. ``SCHEMA``
changes only when a key changes its meaning or is removed; new keys may be added at any time.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from .. import MARK
from ..components import components
from ..fabrication.checks import warn_of_ignored_grain
from ..fabrication.estimates import estimates_report
from ..fabrication.sheets_report import sheets_report
from ..params import Settings, values_in_shown_units
from ..patches.flattening.flattening_report import layout_report
from ..progress import SILENT, Progress
from ..spirals.design_report import design_report
from ..surface.mesh import QuadMesh
from .outputs import SheetPlan
from .result import Result
from .stages import BLOCKS, OF_EXTRAS

SCHEMA = 1  # version of the report's keys


def build_report(
    result: Result,
    *,
    source: str,
    files: Iterable[Path] = (),
    settings: Settings | None = None,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Build the report of a run, as a dictionary of plain JSON types.

    Parameters
    ----------
    result : outputs of the stages
    source : name of the input file
    files : files that were written for the sheets
    settings : settings of the run, to list in the report; None to leave them out
    progress : called with the fraction done; may cancel
    """
    within = progress.at(0.0, "collecting the figures")
    report: dict[str, Any] = {
        "schema": SCHEMA,
        "program": MARK,
        "input": _input_block(result.mesh, source),
        "checks": [finding.as_dict() for finding in (*result.findings, *result.undone.values())],
    }
    undone = [*result.undone]
    if result.simulation is not None and not result.simulation.equilibrium.converged:
        undone.append("simulate")  # the simulation found no equilibrium
    if undone:
        report["undone"] = undone
    report |= report_blocks(result, BLOCKS, within)
    if "sheets" in report:
        report["sheets"] = {"files": [path.name for path in files], **report["sheets"]}
    if result.supports is not None:
        report["input"]["supports"] = len(result.supports)
    if settings is not None:
        report["settings"] = values_in_shown_units(settings)
    report["seconds"] = {stage: round(seconds, 3) for stage, seconds in result.seconds.items()}
    peak = peak_memory()
    if peak is not None:
        report["memory_mb"] = round(peak / 1e6, 1)
    report["machine"] = (
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    )
    return report


def report_blocks(
    result: Result, wanted: Collection[str] = BLOCKS, progress: Progress = SILENT
) -> dict[str, dict[str, Any]]:
    """Return the blocks of report.json for the stages that have run; a .blend file stores them as notes.

    Parameters
    ----------
    result : outputs of the stages
    wanted : names of blocks, from ``stages.BLOCKS``
    progress : called with the fraction done; may cancel
    """
    told = {}
    for name in BLOCKS:
        member, tell = _BLOCKS[name]
        if name in wanted and getattr(result, member) is not None:
            progress(0.0)
            told[name] = tell(result, progress)
    return told


def _sheets_block(result: Result, progress: Progress) -> dict[str, Any]:
    sheets = result.need(SheetPlan).sheets
    block, figures = sheets_report(sheets), result.estimates
    if figures is None:
        return block
    warnings = [*block["warnings"], *warn_of_ignored_grain(figures.material, sheets.params)]
    return block | {"warnings": warnings} | estimates_report(figures)


def _member_report(member: str) -> tuple[str, Callable[[Any, Progress], dict[str, Any]]]:
    """Return an entry of ``_BLOCKS`` for a member of the result that has a ``report`` method."""
    return member, lambda result, progress: getattr(result, member).report()


# for each block of ``stages.BLOCKS``: the member of the result that it needs, and the function that builds it
_BLOCKS: dict[str, tuple[str, Callable[[Any, Progress], dict[str, Any]]]] = {
    "layout": ("flat", lambda result, progress: layout_report(result.flat)),
    "spirals": ("design", lambda result, progress: design_report(result.design, progress)),
    "optimise": _member_report("optimisation"),
    "equilibrium": ("simulation", lambda result, progress: result.simulation.report(progress)),
    "reach": _member_report("limits"),
    "sheets": ("sheets", _sheets_block),
    "assembly": _member_report("assembly"),
}
_BLOCKS |= {block: _member_report(stage.makes[0]) for stage in OF_EXTRAS for block in stage.blocks}


def _input_block(mesh: QuadMesh, source: str) -> dict[str, Any]:
    is_open = bool(mesh.border.any())
    used = len(np.unique(mesh.quads))
    euler = used - len(mesh.edges) + len(mesh.quads)
    genus = (2 * mesh.body_count - euler - _border_loops(mesh)) // 2
    return {
        "file": source,
        "quads": len(mesh.quads),
        "edge_mm": round(mesh.median_edge * 1e3, 4),
        "size_mm": [round(float(x) * 1e3, 3) for x in np.ptp(mesh.vertices, axis=0)],
        "open": is_open,
        "genus": int(genus),
        "bodies": mesh.body_count,
    }


def _border_loops(mesh: QuadMesh) -> int:
    """Count the closed border curves; on a manifold every border vertex has exactly two border edges."""
    a, b = mesh.edges[mesh.border].T
    if not len(a):
        return 0
    return len(np.unique(components(len(mesh.vertices), a, b)[a]))


def peak_memory() -> float | None:
    """Return the peak memory of this process in bytes; None where the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak if platform.system() == "Darwin" else peak * 1024)
