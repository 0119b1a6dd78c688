"""The runner of the tests: every file of a tier runs once, and what was left out is named and counted."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def checks() -> ModuleType:
    sys.path.append(str(ROOT / "tools"))
    import checks

    return checks


def test_every_part_of_every_tier_runs_once(checks: ModuleType) -> None:
    whole = Counter(piece for line in checks._pieces(list(checks.TIERS), ["--thorough"]) for piece in line)
    assert set(whole.values()) == {1}
    for tier in checks.TIERS:
        parts = sorted(piece for piece in whole if piece[0] == tier)
        assert parts == [(tier, k, len(parts)) for k in range(len(parts))] and parts
    # who chooses tests gets one process a tier; what builds the zip never runs beside each other
    assert checks._pieces(["window", "engine", "install"], ["-k", "name"]) == [
        [("window", 0, 1), ("install", 0, 1)],
        [("engine", 0, 1)],
    ]


@pytest.mark.parametrize("thorough", [False, True])
def test_what_takes_long_is_left_out_and_counted(
    checks: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    thorough: bool,
) -> None:
    """On a small checkout with two files of one tier, one test of which fails."""
    text = "import pytest\n\n@pytest.mark.thorough\ndef test_long(): pass\n\ndef test_short(): assert {}\n"
    for name, good in (("a", True), ("b", False)):
        path = tmp_path / "tests" / "engine" / f"test_{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.format(good))
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\nmarkers = ['thorough']\n")
    own = (ROOT / "tests" / "conftest.py").read_text(encoding="utf-8")
    hooks = own[own.index("def pytest_addoption") : own.index("@pytest.hookimpl")]
    (tmp_path / "tests" / "conftest.py").write_text(f"import pytest\n\n{hooks}")
    monkeypatch.setattr(checks, "ROOT", tmp_path)
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    assert checks.main(["test", "engine", *(["--thorough"] if thorough else [])]) == 1
    lines = capfd.readouterr().out.splitlines()
    assert list(tmp_path.rglob("test_a.*.pyc"))  # what is compiled once is kept, whatever the caller's environment says
    assert [line for line in lines if line.startswith("== engine")] and "lint      not run" in lines
    last = lines[lines.index("== summary") :]
    if thorough:
        assert "3 passed, 1 failed, 0 skipped" in last[-1] and not any("skipped 2" in line for line in last)
    else:
        assert "1 passed, 1 failed, 2 skipped" in last[-1]
        assert any("skipped 2: thorough tests" in line and "--thorough" in line for line in last)
