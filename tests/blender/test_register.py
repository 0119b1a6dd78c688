"""Enabling and disabling the extension."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import bpy
import flexmaps
from flexmaps import engine

SCRIPT = """
import importlib.util, sys
import bpy
spec = importlib.util.spec_from_file_location("flexmaps", {path!r}, submodule_search_locations=[{folder!r}])
package = importlib.util.module_from_spec(spec)
sys.modules["flexmaps"] = package
spec.loader.exec_module(package)
package.register()
heavy = {{"scipy", "shapely", "igl", "ezdxf", "xatlas"}} & set(sys.modules)
assert not heavy, heavy
assert hasattr(bpy.types.Object, "flexmaps")
package.unregister()
assert not hasattr(bpy.types.Object, "flexmaps")
assert not hasattr(bpy.types.WindowManager, "flexmaps_overlay")
left = [n for n in dir(bpy.types) if n.startswith("FLEXMAPS_")]
assert not left, left
handlers = [h for name in dir(bpy.app.handlers) for h in (getattr(bpy.app.handlers, name),) if isinstance(h, list)]
assert not [f for found in handlers for f in found if getattr(f, "__module__", "").startswith("flexmaps")]
package.register()  # and no unregistering: a script's end is clean all the same
print("clean")
"""


def test_twice_and_nothing_left(root: Path) -> None:
    script = SCRIPT.format(path=str(root / "__init__.py"), folder=str(root))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert "clean" in done.stdout, done.stdout + done.stderr
    assert "Traceback" not in done.stderr + done.stdout, done.stderr
    assert done.returncode == 0, done.stderr[-500:]


def test_again_in_this_session() -> None:
    flexmaps.unregister()
    flexmaps.register()
    assert hasattr(bpy.ops.flexmaps.merge, "poll")


def test_every_operator_has_a_tooltip() -> None:
    types = [getattr(bpy.ops.flexmaps, name).get_rna_type() for name in dir(bpy.ops.flexmaps)]
    assert len(types) > 20
    assert not [one.identifier for one in types if not one.description]


def test_manifest_has_the_same_version(root: Path) -> None:
    manifest = tomllib.loads((root / "blender_manifest.toml").read_text())
    assert manifest["version"] == engine.VERSION
    assert "wheels" not in manifest  # the build writes them
    patterns = manifest["build"]["paths_exclude_pattern"]
    assert {"/tests/", "/tools/", "/docs/", "/database/", ".*"} <= set(patterns)
