"""Tests of the engine stand where their modules do: ``tests/engine/ROOM/test_MODULE.py`` tests ``engine/ROOM/MODULE.py``."""

from __future__ import annotations

from pathlib import Path

FLOWS = "flows"  # what spans several rooms


def test_every_test_file_is_named_after_a_module_of_its_room(root: Path) -> None:
    """An aspect of a module that has a file of its own is added to the module's name."""
    tests = root / "tests" / "engine"
    lost = []
    for path in tests.rglob("test_*.py"):
        room = path.parent.relative_to(tests)
        modules = {module.stem for module in (root / "engine" / room).glob("*.py")}
        words = path.stem.removeprefix("test_").split("_")
        if room.parts[:1] != (FLOWS,) and not any("_".join(words[:n]) in modules for n in range(1, len(words) + 1)):
            lost.append(path.relative_to(root).as_posix())
    assert not lost, f"rename these after a module of engine/, or move them to tests/engine/{FLOWS}/"
