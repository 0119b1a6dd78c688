"""What every stage reports of a piece is what a fresh simulation of the stored piece finds."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from flexmaps.engine.surface import shapes

sys.path.append(str(Path(__file__).resolve().parents[3] / "tools"))
import state_cases

CASES = {
    "clamped": state_cases.Case("clamped", shapes.saddle(5), "lowest"),
    "hinged": state_cases.Case("hinged", shapes.dome(4), "lowest", clamped=False, gravity=True),
    "pushed": state_cases.Case("pushed", shapes.dome(4), "lowest", gravity=True, force=True),
    "rim": state_cases.Case("rim", shapes.saddle(4), rim=True),
    "wished": state_cases.Case("wished", shapes.dome(4), "lowest", rim=True, wish=True),
}
QUICK = {
    ("optimise", "clamped"),
    ("stopped", "hinged"),
    ("choose", "wished"),
    ("live", "rim"),
}


@pytest.mark.parametrize(
    ("stage", "case"),
    [
        pytest.param(stage, case, marks=() if (stage, case) in QUICK else pytest.mark.thorough)
        for stage in state_cases.STAGES
        for case in CASES
    ],
)
def test_a_stage_reports_the_state_of_the_stored_piece(stage: str, case: str) -> None:
    for found in state_cases.STAGES[stage](*CASES[case].spirals(0.1)):
        assert found.apart < found.tolerance, (found.stage, found.reported, found.fresh)
