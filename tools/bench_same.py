"""Compare the results of all stages with those of another revision, which a file holds.

Simulation, search and sheets start from the spirals in the file, so that a difference in an early stage does not hide the
later ones. The objects in Blender that hold the pieces are read again between the stages. Texts, dates and times are left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import flexmaps
import numpy as np
from flexmaps import api
from harness import MESHES, Bench, Options, Rows, at_most

FOREIGN = MESHES / "foreign"
DIFFERENT = "values that differ"  # name of the rows
EQUAL = 1e-9  # largest difference, as a share of the size of the compared values
# settings of all pieces: three steps without a time limit, because the time that a search takes varies
COMMON = {"sheet.nesting": "FAST", "optimise.iterations": 3, "optimise.patience": 0.0, "simulate.restarts": 1}
# pieces: how they are loaded, and their own settings; the foreign ones only where they are there
PIECES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "shape:cubesphere": ({}, {"sheet.sheet_width": 150.0, "sheet.sheet_height": 100.0}),
    "shape:dome": ({"supports": "lowest"}, {"base.base": "feet", "simulate.gravity": True}),
    "shape:saddle": ({}, {"spiral.border": "rim", "layout.symmetric": True}),
    "shape:strip": ({}, {"simulate.model": "rod"}),
    "heart.obj": ({"edge": 20.0, "supports": "lowest"}, {"structure.cases": "weight: weight"}),
    "cmc1.obj": ({"edge": 20.0}, {"optimise.codesign": True}),
}
LEFT_OUT = {"seconds", "memory_mb", "checks", "findings", "settings"}  # keys of the report: times and texts
GIVEN = ("flexmaps_width", "flexmaps_twist")  # attributes that hold the spirals
written: dict[str, np.ndarray] = {}  # results of this run


def compare(name: str, options: Options) -> Rows:
    """Write the results of a piece, or compare them."""
    stored = dict(np.load(options.against)) if options.against is not None else {}
    before = {key: value for key, value in stored.items() if key.startswith(f"{name} ")}
    now = {f"{name} {key}": value for key, value in _results(name, before)}
    written.update(now)
    if options.write is not None:
        np.savez_compressed(options.write, **written)  # type: ignore[arg-type]
    different = [key for key in before | now if before and not _equal(before.get(key), now.get(key))]
    yield at_most(name, DIFFERENT, 0, len(different), {"of": len(before or now), "": ", ".join(different)})


def _results(name: str, before: dict[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    if not hasattr(bpy.types.Object, "flexmaps"):
        flexmaps.register()
    options, settings = PIECES[name]
    piece = api.spirals(api.load(name if ":" in name else FOREIGN / name, settings=COMMON | settings, **options))
    yield from _numbers(_flat(piece), "made")
    obj = api.show(piece)
    for attribute in GIVEN:
        values = obj.data.attributes[attribute].data
        own = np.empty(len(values), np.float32)
        values.foreach_get("value", own)
        given = before.get(f"{name} given/{attribute}", own)
        values.foreach_set("value", given)
        yield f"given/{attribute}", given
    stored = api.load(obj, supports=options.get("supports"))
    yield from _numbers(_flat(stored), "read")
    yield from _numbers(_shape(api.sheets(api.simulate(stored))), "simulated")
    better = api.optimise(stored)
    examined = api.structure(better) if "structure.cases" in settings else better
    yield from _numbers(_flat(better) | _shape(api.sheets(examined)), "optimised")


def _flat(piece: Any) -> dict[str, Any]:
    """Return the cuts, the flat points and the spirals."""
    design = piece.result.design
    return {"cut": design.flat.layout.cut, "points": design.flat.points, "width": design.width, "twist": design.twist}


def _shape(piece: Any) -> dict[str, Any]:
    """Return the simulated shape, the panels as they lie on the sheets, and the report."""
    sheets = piece.result.sheets
    panels = [panel for number in range(sheets.count) for panel in sheets.panels_on_sheet(number)]
    curves = [[curve.points for curve in (one.outline, *one.holes, *one.labels)] for one in panels]
    return {"vertices": piece.result.simulation.vertices, "panels": curves, "report": api.report(piece)}


def _numbers(value: Any, key: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the numbers and arrays of nested results with their keys, texts and times left out."""
    if isinstance(value, dict | list):
        for name, inner in value.items() if isinstance(value, dict) else enumerate(value):
            if name not in LEFT_OUT:
                yield from _numbers(inner, f"{key}/{name}")
    elif isinstance(value, np.ndarray | int | float):
        yield key, np.array(value, dtype=float)


def _equal(before: np.ndarray | None, now: np.ndarray | None) -> bool:
    if before is None or now is None or before.shape != now.shape:
        return False
    size = np.abs(before).max(initial=0.0)
    return bool((np.abs(now - before) <= EQUAL * size).all())


there = [name for name in PIECES if ":" in name or (FOREIGN / name).is_file()]
main = Bench(
    "same", {name: partial(compare, name) for name in there}, must=DIFFERENT,
    write=(Path, "write the results to this .npz file"), against=(Path, "compare with the results in this file"),
)  # fmt: skip
