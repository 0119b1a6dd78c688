"""The engine stands alone: it knows no Blender, and no module of the package exists twice."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[3]
ENGINE = sorted((ROOT / "engine").rglob("*.py"))
BLENDER_ONLY = {"bpy", "bmesh", "mathutils", "gpu", "bl_ui"}


@pytest.mark.parametrize("path", ENGINE, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_engine_module_imports_no_blender(path: Path, measures: ModuleType) -> None:
    for line, level, name in measures.imports(path):
        first = name.split(".")[0]
        assert level > 0 or first not in BLENDER_ONLY, f"{path.name}:{line} imports {name}"
        assert level > 0 or first != "flexmaps", f"{path.name}:{line} imports {name}: installed it has another name"


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
