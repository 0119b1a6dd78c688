"""Comparison of the figures that every stage reports with a new simulation of the stored piece."""

from __future__ import annotations

from functools import partial
from typing import Any

from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from harness import Bench, Options, Rows, at_most, note
from state_cases import STAGES, Case

MADE = {
    "saddle": shapes.saddle(10),
    "dome": shapes.dome(6),
    "vault": shapes.vault(8),
    "demo": shapes.demo(8),
    "strip": shapes.strip(12, 3),
}  # quads along their sides
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


def compare(name: str, case: Case, options: Options) -> Rows:
    """Compare what each stage reports of a piece."""
    shape, _, way = name.partition(", ")
    piece = case.spirals(options.patience)
    for stage, of_stage in STAGES.items():
        try:
            for one in of_stage(*piece):
                figures = {"rms_mm": round(1e3 * one.fresh.rms, 3), "softest": round(one.softest, 3)}
                yield at_most(shape, f"{way}: {one.stage}", one.tolerance, one.apart, {"fresh": figures})
        except FlexMapsError as error:
            yield note(shape, f"{way}: {stage}", str(error)[:60])


CASES = {
    f"{shape}, {way}": partial(Case, f"{shape}, {way}", mesh, **how)
    for shape, mesh in MADE.items()
    for way, how in WAYS.items()
}
main = Bench("states", CASES, compare, between=";", patience=(0.3, "of the searches"))  # a share
