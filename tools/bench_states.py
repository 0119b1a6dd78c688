"""Comparison of the figures that every stage reports with a new simulation of the stored piece.

python3 tools/dev.py bench states [--only PATTERNS] [--patience P] [--json FILE]
"""

from __future__ import annotations

from typing import Any

from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from harness import Bench
from rows import Table, at_most, note
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
    bench = Bench("states", arguments, 40, only="*", between=";", patience=(0.3, "of the searches"))
    for name, make in MADE.items():
        for way, how in WAYS.items():
            if bench.asked(f"{name}, {way}"):
                _compare(bench.table, name, way, Case(f"{name}, {way}", make(), **how), bench.options.patience)
    return bench.finish()


def _compare(table: Table, name: str, way: str, case: Case, patience: float) -> None:
    try:
        piece = case.spirals(patience)
    except FlexMapsError as error:
        table.add(note(name, way, str(error)[:60]))
        return
    for stage, compare in STAGES.items():
        try:
            for one in compare(*piece):
                figures = {"rms_mm": round(1e3 * one.fresh.rms, 3), "softest": round(one.softest, 3)}
                table.add(at_most(name, f"{way}: {one.stage}", one.tolerance, one.apart, {"fresh": figures}))
        except FlexMapsError as error:
            table.add(note(name, f"{way}: {stage}", str(error)[:60]))
