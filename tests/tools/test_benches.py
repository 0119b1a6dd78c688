"""What ``dev.py bench`` offers can be called."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import numpy as np
import pytest


def test_every_bench_that_is_offered_has_a_main(root: Path) -> None:
    for path in (root / "tools").glob("bench_*.py"):
        names = set()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef):
                names.add(node.name)
            elif isinstance(node, ast.Assign):
                names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        assert "main" in names, path.name


@pytest.mark.parametrize("sharpness", [0.0, 2.0])
def test_strains_of_arms_that_are_all_kinked_or_all_smooth(root: Path, sharpness: float) -> None:
    """One kind alone is judged, and the names of the rows fit the table."""
    from flexmaps.database.validation_strain import ArmStrains

    sys.path.append(str(root / "tools"))
    bench = __import__("bench_strain")
    arms, solid = np.arange(8), np.linspace(0.01, 0.02, 8)
    kink = np.full(8, sharpness * bench.KINK_LIMIT)
    one = ArmStrains("piece", arms, arms % 4, arms // 2, solid, 1.2 * solid, 0.9 * solid, kink, 0.03, rim=False)
    rows = [*bench.measure("piece", [one], None), *bench.of_all([one])]
    kinds = {row["mesh"] for row in rows if row["mesh"].startswith("joints, ")}
    assert kinds == {"joints, kinked" if sharpness else "joints, smooth"}
    assert all(len(row["mesh"]) < 18 and len(row["row"]) < 40 for row in rows)
