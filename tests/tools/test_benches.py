"""What ``dev.py bench`` offers can be called."""

from __future__ import annotations

import ast
from pathlib import Path


def test_every_bench_that_is_offered_has_a_main(root: Path) -> None:
    for path in (root / "tools").glob("bench_*.py"):
        functions = [
            node.name for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.FunctionDef)
        ]
        assert "main" in functions, path.name
