"""Files of the other Blender, of another version and another Python."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import pytest
from flexmaps.bridge.store import states
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh

EDGE = 0.02

ROOT = Path(__file__).resolve().parents[2]


def small(n: int = 4) -> QuadMesh:
    """A dome of 3 n^2 quads of 20 mm."""
    made = shapes.dome(n)
    return QuadMesh(made.vertices * (EDGE / made.median_edge), made.quads)


@pytest.fixture
def piece(add: Any) -> Any:
    return add(small())


def _other_python() -> str:
    """A Python with the other Blender: named by FLEXMAPS_OTHER_PYTHON, or in the other environment of this checkout."""
    version = "3.13" if sys.version_info[:2] == (3, 11) else "3.11"
    inside = ("Scripts", "python.exe") if os.name == "nt" else ("bin", "python")
    return os.environ.get("FLEXMAPS_OTHER_PYTHON") or str(ROOT.joinpath(f".venv-{version}", *inside))


@pytest.fixture(scope="module")
def other() -> str:
    """Skips where there is no other Blender, and says so."""
    python = _other_python()
    if not Path(python).is_file():
        pytest.skip(f"no other Blender: {python} is not there")
    seen = subprocess.run([python, "-c", "import bpy; print(bpy.app.version[:2])"], capture_output=True, text=True)
    if seen.returncode or str(bpy.app.version[:2]) in seen.stdout:
        pytest.skip(f"no other Blender: {python} has this one, or none")
    return python


OTHER = """
import importlib.util, json, os, sys
path, root, task = sys.argv[1:4]
spec = importlib.util.spec_from_file_location("dev", os.path.join(root, "tools", "dev.py"))
dev = importlib.util.module_from_spec(spec)
spec.loader.exec_module(dev)
dev.load_package().register()
import bpy
from flexmaps.bridge.store import stored_report, states
if task == "make":
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    exec(sys.stdin.read())
    for button in ("flatten", "spirals", "simulate"):
        getattr(bpy.ops.flexmaps, button)()
    bpy.ops.wm.save_as_mainfile(filepath=path)
else:
    bpy.ops.wm.open_mainfile(filepath=path)
    obj = bpy.context.view_layer.objects.active = bpy.data.objects["piece"]
    bpy.context.view_layer.update()
widths = [round(d.value, 4) for d in obj.data.attributes["flexmaps_width"].data]
found = {
    "states": {stage: state.kind for stage, state in states.read_states(obj, bpy.context.scene).items()},
    "blocks": sorted(stored_report.read(obj.data)),
    "seams": [e.index for e in obj.data.edges if e.use_seam],
    "widths": widths,
    "keys": [k.name for k in obj.data.shape_keys.key_blocks],
    "thickness": round(obj.flexmaps.spiral.thickness, 4),
}
if task == "open":
    found["pressed"] = [sorted(getattr(bpy.ops.flexmaps, b)()) for b in ("spirals", "simulate")]
print("FOUND", json.dumps(found))
sys.stdout.flush()
os._exit(0)
"""

MAKE = """
mesh = bpy.data.meshes.new("piece")
mesh.from_pydata({vertices}, [], {faces})
obj = bpy.data.objects.new("piece", mesh)
bpy.context.scene.collection.objects.link(obj)
bpy.context.view_layer.objects.active = obj
obj.select_set(True)
bpy.context.view_layer.update()
obj.flexmaps.spiral.thickness = 2.5
"""


def ask(python: str, path: Path, task: str) -> dict[str, Any]:
    plain = small(3)
    given = MAKE.format(vertices=plain.vertices.tolist(), faces=plain.quads.tolist())
    command = [python, "-c", OTHER, str(path), str(ROOT), task]
    done = subprocess.run(command, input=given, capture_output=True, text=True, timeout=200)
    assert "Traceback" not in done.stdout + done.stderr, (done.stdout + done.stderr)[-3000:]
    line = next(line for line in done.stdout.splitlines() if line.startswith("FOUND"))
    found: dict[str, Any] = json.loads(line.removeprefix("FOUND"))
    return found


@pytest.mark.parametrize("direction", ["saved there, opened here", "saved here, opened there"])
def test_files_of_the_other_blender(other: str, tmp_path: Path, direction: str) -> None:
    """Results, settings and states come along, and the work goes on."""
    path = tmp_path / "piece.blend"
    there = direction.startswith("saved there")
    maker, opener = (other, sys.executable) if there else (sys.executable, other)
    made = ask(maker, path, "make")
    assert made["states"]["equilibrium"] == states.DONE
    found = ask(opener, path, "open")
    assert found.pop("pressed") == [["FINISHED"]] * 2
    assert found == made
