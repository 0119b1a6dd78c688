"""Compare the results of all stages with those of another revision, which a file holds.

python3 tools/dev.py bench same --write FILE      # with the one revision
python3 tools/dev.py bench same --against FILE    # with the other
    [--only NAME ...]

Simulation, search and sheets start from the spirals in the file, so that a difference in an early stage does not hide the
later ones. The objects in Blender that hold the pieces are read again between the stages. Texts, dates and times are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import flexmaps
import numpy as np
from flexmaps import api

EQUAL = 1e-9  # largest difference, as a share of the size of the compared values
FOREIGN = Path(__file__).resolve().parent.parent.parent / "shared" / "meshes" / "foreign"
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


def main(arguments: list[str]) -> int:
    """Write or compare; return 1 if a value differs or is missing."""
    parser = argparse.ArgumentParser(prog="dev.py bench same")
    parser.add_argument("--only", nargs="+", choices=PIECES, help="these pieces alone")
    way = parser.add_mutually_exclusive_group(required=True)
    way.add_argument("--write", type=Path, metavar="FILE", help="write the results to an .npz file")
    way.add_argument("--against", type=Path, metavar="FILE", help="compare with the results in the file")
    options = parser.parse_args(arguments)
    flexmaps.register()
    before = {} if options.against is None else dict(np.load(options.against))
    now: dict[str, np.ndarray] = {}
    failed = False
    for name in options.only or PIECES:
        if not name.startswith("shape:") and not (FOREIGN / name).is_file():
            continue
        found = {f"{name} {key}": value for key, value in _results(name, before)}
        now |= found
        if before:
            there = {key for key in before if key.startswith(f"{name} ")}
            different = sorted(key for key in there | set(found) if not _equal(before.get(key), found.get(key)))
            failed |= bool(different)
            print(f"{name}: {len(found) - len(different)} of {len(there)} equal", *different, sep="\n  ", flush=True)
    if options.write is not None:
        np.savez_compressed(options.write, **now)
    return int(failed)


def _results(name: str, before: dict[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    options, settings = PIECES[name]
    source = name if name.startswith("shape:") else FOREIGN / name
    piece = api.spirals(api.load(source, settings=COMMON | settings, **options))
    yield from _flat("made", piece)
    obj = api.show(piece)
    for attribute in GIVEN:
        values = obj.data.attributes[attribute].data
        own = np.empty(len(values), np.float32)
        values.foreach_get("value", own)
        given = before.get(f"{name} given/{attribute}", own)
        values.foreach_set("value", given)
        yield f"given/{attribute}", given
    stored = api.load(obj, supports=options.get("supports"))
    yield from _flat("read", stored)
    yield from _shape("simulated", api.sheets(api.simulate(stored)))
    better = api.optimise(stored)
    yield from _flat("optimised", better)
    examined = api.structure(better) if "structure.cases" in settings else better
    yield from _shape("optimised", api.sheets(examined))


def _flat(stage: str, piece: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the cuts, the flat points and the spirals."""
    design = piece.result.design
    yield f"{stage}/cut", design.flat.layout.cut
    yield f"{stage}/points", design.flat.points
    yield f"{stage}/width", design.width
    yield f"{stage}/twist", design.twist


def _shape(stage: str, piece: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the simulated shape, the panels as they lie on the sheets, and all figures of the report."""
    yield f"{stage}/vertices", piece.result.simulation.vertices
    sheets = piece.result.sheets
    for number in range(sheets.count):
        for k, panel in enumerate(sheets.on_sheet(number)):
            for kind, curves in (("outline", (panel.outline,)), ("holes", panel.holes), ("labels", panel.labels)):
                points = [curve.points for curve in curves]
                yield f"{stage}/sheet {number} panel {k} {kind}", np.concatenate([np.empty((0, 2)), *points])
    for key, value in _figures(api.report(piece)):
        yield f"{stage}/report{key}", value


def _figures(value: Any, key: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Yield the numbers of a report with their keys, texts left out."""
    if isinstance(value, dict | list):
        for name, inner in value.items() if isinstance(value, dict) else enumerate(value):
            if name not in LEFT_OUT:
                yield from _figures(inner, f"{key}/{name}")
    elif isinstance(value, int | float):
        yield key, np.array(float(value))


def _equal(before: np.ndarray | None, now: np.ndarray | None) -> bool:
    if before is None or now is None or before.shape != now.shape:
        return False
    size = np.abs(before).max(initial=0.0)
    return bool((np.abs(now.astype(float) - before) <= EQUAL * size).all())
