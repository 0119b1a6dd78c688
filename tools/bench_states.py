"""Comparison of the figures that every stage reports with a new simulation of the stored piece.

python3 tools/dev.py bench states [--only PATTERNS] [--patience P] [--json FILE]
"""

from __future__ import annotations

import argparse
import fnmatch
from pathlib import Path
from typing import Any

from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from rows import Table, at_most, row
from state_cases import STAGES, Case

# shapes, with the functions that make them
MADE = {
    "saddle": lambda: shapes.saddle(10),
    "dome": lambda: shapes.dome(6),
    "vault": lambda: shapes.vault(8),
    "demo": lambda: shapes.demo(8),
    "strip": lambda: shapes.strip(12, 3),
}
# how they are held, and what acts on them
WAYS: dict[str, dict[str, Any]] = {
    "free": {},
    "clamped": {"supports": "lowest"},
    "hinged": {"supports": "lowest", "clamped": False},
    "clamped, weight": {"supports": "lowest", "gravity": True},
    "clamped, pushed": {"supports": "lowest", "force": True},
    "rim": {"rim": True},
    "clamped, rim, wish": {"supports": "lowest", "rim": True, "wish": True},
}


def main(arguments: list[str]) -> int:
    """Compare and print the table; return 0 whatever the figures."""
    parser = argparse.ArgumentParser(prog="dev.py bench states")
    parser.add_argument("--only", default="*", help="patterns of 'shape, way', with semicolons")
    parser.add_argument("--patience", type=float, default=0.3, help="of the searches")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    options = parser.parse_args(arguments)
    table = Table(40)
    for name, make in MADE.items():
        for way, options_of_way in WAYS.items():
            case = Case(f"{name}, {way}", make(), **options_of_way)
            if any(fnmatch.fnmatch(case.name, one) for one in options.only.split(";")):
                _compared(table, name, way, case, options.patience)
    table.finish(options.json)
    return 0


def _compared(table: Table, name: str, way: str, case: Case, patience: float) -> None:
    try:
        piece = case.spirals(patience)
    except FlexMapsError as error:
        table.add(row(name, way, "", str(error)[:60], None))
        return
    for stage, compare in STAGES.items():
        try:
            for one in compare(*piece):
                figures = {"rms_mm": round(1e3 * one.fresh.rms, 3), "softest": round(one.softest, 3)}
                table.add(at_most(name, f"{way}: {one.stage}", one.tolerance, one.apart, {"fresh": figures}))
        except FlexMapsError as error:
            table.add(row(name, f"{way}: {stage}", "", str(error)[:60], None))
