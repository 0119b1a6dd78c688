"""The engine stands alone: it knows no Blender, and no module of the package exists twice."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ENGINE = sorted((ROOT / "engine").rglob("*.py"))
BLENDER_ONLY = {"bpy", "bmesh", "mathutils", "gpu", "bl_ui"}
FLOORS = (
    "surface",
    "patches",
    "spirals",
    "mechanics",
    "simulation",
    "optimisation",
    "fabrication",
    "display",
    "assembling",
    "runs",
)
UPPER_LAYERS = {"bridge", "operators", "panels", "database", "tools", "tests"}


def _imports(path: Path) -> list[tuple[int, str]]:
    """(relative level, dotted name) of every import statement of a file, also those inside functions."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(0, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [(node.level, f"{node.module or ''}.{alias.name}".strip(".")) for alias in node.names]
    return found


@pytest.mark.parametrize("path", ENGINE, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_engine_module_imports_no_blender_and_nothing_above_it(path: Path) -> None:
    for level, name in _imports(path):
        first = name.split(".")[0]
        assert level > 0 or first not in BLENDER_ONLY, f"{path.name} imports {name}"
        assert level > 0 or first != "flexmaps", f"{path.name} imports {name} absolutely: installed it has another name"
        depth = len(path.relative_to(ROOT / "engine").parts)
        assert level <= depth or first not in UPPER_LAYERS, f"{path.name} imports upward: {name}"


@pytest.mark.parametrize("path", ENGINE, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_engine_folder_imports_only_from_lower_ones(path: Path) -> None:
    own = path.relative_to(ROOT).with_suffix("").parts
    allowed = FLOORS[: FLOORS.index(own[1]) + 1] if own[1] in FLOORS else ()
    for level, name in _imports(path):
        first = (*own[:-level], *name.split("."))[1] if level else ""
        assert first not in FLOORS or first in allowed, f"{path.relative_to(ROOT)} imports upward: {name}"


def test_no_two_modules_import_each_other() -> None:
    """Over the engine and the bridge, imports inside functions and for types included."""
    files = {p.relative_to(ROOT).with_suffix("").parts: p for p in [*ENGINE, *(ROOT / "bridge").rglob("*.py")]}
    known: dict[tuple[str, ...], set[tuple[str, ...]]] = {}
    for own, path in files.items():
        seen = known.setdefault(own, set())
        for level, name in _imports(path):
            if level:
                full = (*own[:-level], *name.split("."))
                seen.update(full[:n] for n in range(1, len(full) + 1) if full[:n] in files)
    left = {own: set(found) for own, found in known.items()}
    while ready := [own for own, found in left.items() if not found & left.keys()]:
        for own in ready:
            del left[own]
    assert not left, "in circles, or above one: " + ", ".join("/".join(own) for own in sorted(left))


def test_importing_the_whole_engine_loads_no_blender() -> None:
    names = [".".join(p.relative_to(ROOT).with_suffix("").parts) for p in ENGINE if p.name != "__init__.py"]
    code = f"""
import importlib, sys
sys.path.insert(0, {str(ROOT / "tools")!r})
import dev
dev.load_package()
for name in {names!r}:
    importlib.import_module("flexmaps." + name)
bad = {{m.split(".")[0] for m in sys.modules}} & {BLENDER_ONLY!r}
assert not bad, bad
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True, cwd=ROOT.parent)
    assert done.returncode == 0, done.stderr[-2000:]


def test_no_module_of_the_package_is_loaded_twice() -> None:
    """Every class would exist twice, and isinstance would fail in ways hard to see."""
    from flexmaps.engine.surface.mesh import QuadMesh

    assert QuadMesh.__module__ == "flexmaps.engine.surface.mesh"
    copies: dict[str, list[str]] = {}
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and Path(file).is_relative_to(ROOT) and Path(file).relative_to(ROOT).parts[0] not in ("tests", "tools"):
            if not Path(file).relative_to(ROOT).parts[0].startswith((".venv", "build", "out")):
                copies.setdefault(file, []).append(name)
    twice = {file: names for file, names in copies.items() if len(names) > 1}
    assert not twice
    assert str(ROOT) not in sys.path
