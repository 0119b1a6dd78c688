"""Small sheets of every kind for the benches: connectors, holding tabs, kerf, a remnant, bases, eyelets, copies, several objects."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import ezdxf
import ezdxf.units
import numpy as np
from flexmaps.engine.extras.together.nest_together import nest_together
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.params import ObjectSettings, Settings, with_values
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.surface.mesh import PolygonMesh

EDGE = 0.02  # metres
SUPPORTS = [2, 3, 14, 15, 26, 27]  # quads of the arch that hang


def arch(columns: int = 5, rows: int = 6) -> PolygonMesh:
    """Half a tube that stands on both of its long borders."""
    radius = rows * EDGE / np.pi
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows + 1)
    x, angle = np.meshgrid(EDGE * np.arange(columns + 1.0), angle, indexing="ij")
    points = np.stack([x, radius * np.sin(angle), radius * np.cos(angle)], axis=-1).reshape(-1, 3)
    corner = np.arange(len(points)).reshape(columns + 1, rows + 1)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    return PolygonMesh(points, quads.ravel(), np.full(len(quads), 4))


# millimetres: sheets so small that there are several
SMALL = {"sheet.nesting": "FAST", "sheet.sheet_width": 90.0, "sheet.sheet_height": 70.0}


@cache
def _spirals() -> Result:
    """The arch with the usual spirals, for all kinds that differ in their sheets alone."""
    return job.run(arch(), with_values(Settings(), SMALL), stop_after="spirals")


def _run(values: dict[str, Any], **options: Any) -> CutSheets:
    settings = with_values(Settings(), SMALL | values)
    usual = options == {"stop_after": "sheets"} and not any(name.startswith("spiral.") for name in values)
    made = (job.run_stages(_spirals(), settings, ("sheets",)) if usual else job.run(arch(), settings, **options)).sheets
    assert made is not None
    return made


def _remnant(folder: Path) -> CutSheets:
    document = ezdxf.new("R2010", units=ezdxf.units.MM)
    document.modelspace().add_lwpolyline([(0, 0), (140, 0), (140, 60), (70, 130), (0, 130)], close=True)
    document.modelspace().add_circle((20, 20), 8)
    document.saveas(folder / "remnant.dxf")
    return _run({"sheet.remnants": str(folder / "remnant.dxf")}, stop_after="sheets")


def _together(folder: Path) -> CutSheets:
    settings = with_values(ObjectSettings(), SMALL)
    pieces = [job.run(arch(*size), settings, stop_after="spirals") for size in ((5, 6), (4, 5))]
    return nest_together(["one", "two"], pieces, [with_values(settings, {"export.copies": n}) for n in (2, 1)]).sheets


# millimetres
KINDS: dict[str, Callable[[Path], CutSheets]] = {
    "dovetails": lambda _: _run({}, stop_after="sheets"),
    "keys": lambda _: _run({"connect.connector": "key"}, stop_after="sheets"),
    "ends for glue": lambda _: _run({"connect.connector": "tab"}, stop_after="sheets"),
    "holding tabs": lambda _: _run({"cut.tabs": 6, "cut.tab_width": 1.5}, stop_after="sheets"),
    "lead-ins": lambda _: _run({"cut.lead_in": 1.0}, stop_after="sheets"),
    "kerf": lambda _: _run({"cut.kerf_outline": 0.15, "cut.kerf_holes": 0.1}, stop_after="sheets"),
    "nozzle": lambda _: _run({"cut.nozzle": 0.8}, stop_after="sheets"),
    "rim": lambda _: _run({"spiral.border": "rim"}, stop_after="sheets"),
    "remnant": _remnant,
    "feet": lambda _: _run({"base.base": "feet", "sheet.sheet_width": 300.0}, supports="lowest"),
    "frame": lambda _: _run({"base.base": "frame", "sheet.sheet_width": 300.0}, supports="lowest"),
    "eyelets": lambda _: _run(
        {"base.base": "eyelets", "simulate.clamped": False, "simulate.gravity": True, "sheet.sheet_width": 300.0},
        supports=SUPPORTS,
    ),
    "copies, two objects": _together,
}
