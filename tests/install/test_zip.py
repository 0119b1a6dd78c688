"""The zip as a user gets it: what is in it, and whether it works in a Blender that has nothing else."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# what Blender itself brings: the module, its numpy, and what its own scripts import
BLENDERS_OWN = (
    "bpy",
    "numpy",
    "numpy.libs",
    "requests",
    "certifi",
    "charset_normalizer",
    "idna",
    "urllib3",
    "zstandard",
)
BLENDERS_OWN += ("attr", "attrs", "cattr", "cattrs", "Cython")

SCRIPT = """
import json, sys
from pathlib import Path
import bpy

zip_file, out = sys.argv[-2:]
bpy.ops.extensions.package_install_files(filepath=zip_file, repo="user_default", enable_on_install=True)
import bl_ext.user_default.flexmaps as flexmaps
heavy = {"cvxopt", "scipy", "shapely", "igl", "ezdxf", "xatlas", "spyrrow"}
early = sorted(heavy & set(sys.modules))

from bl_ext.user_default.flexmaps.bridge import scene
from bl_ext.user_default.flexmaps.engine import shapes
obj = scene.add_model(bpy.context.scene, shapes.make("dome"), "dome")
done = {}
for stage in ("check", "regularise", "trace", "merge", "spirals", "simulate"):
    done[stage] = sorted(getattr(bpy.ops.flexmaps, stage)())
obj.flexmaps.export.folder = out
done["export"] = sorted(bpy.ops.flexmaps.export())
places = {name: sys.modules[name].__file__ for name in heavy if name in sys.modules}
print("RESULT " + json.dumps({"early": early, "done": done, "places": places, "package": flexmaps.__file__}))
sys.stdout.flush()
import os
os._exit(0)
"""


@pytest.fixture(scope="session")
def platform() -> str:
    name = {"linux": "linux-x64", "win32": "windows-x64", "darwin": "macos-arm64"}.get(sys.platform)
    if name is None:
        pytest.skip(f"the extension is not built for {sys.platform}")
    return name


@pytest.fixture(scope="session")
def zip_file(build_zip, platform: str) -> Path:
    """The zip for this platform; Blender's own validator has accepted it, or this raises."""
    return build_zip.build(platform)


def test_listing(zip_file: Path, build_zip) -> None:
    names = zipfile.ZipFile(zip_file).namelist()
    tops = {name.split("/")[0] for name in names}
    shipped = {"__init__.py", "blender_manifest.toml", "LICENSE", "README.md"}
    assert shipped <= tops
    assert tops <= shipped | {"bridge", "data", "engine", "operators", "panels", "wheels"}
    assert not any("__pycache__" in name for name in names)


def test_wheels(zip_file: Path) -> None:
    wheels = [Path(name).name for name in zipfile.ZipFile(zip_file).namelist() if name.endswith(".whl")]
    packages = {wheel.split("-")[0] for wheel in wheels}
    assert "numpy" not in packages
    assert {"cvxopt", "scipy", "shapely", "libigl", "ezdxf", "xatlas", "spyrrow", "typing_extensions"} <= packages
    for package in packages:
        tags = [wheel.split("-")[2] for wheel in wheels if wheel.startswith(package + "-")]
        both = {"cp311", "cp313"} <= set(tags) or {"cp311", "cp312"} <= set(tags)  # cp312: a stable ABI, fits 3.13
        assert both or all(tag.startswith(("py3", "py2")) for tag in tags), tags


def test_the_version_is_said_alike_everywhere() -> None:
    import tomllib

    from flexmaps.engine import VERSION

    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert manifest["version"] == project["project"]["version"] == VERSION


def test_main_job_from_the_installed_extension(zip_file: Path, tmp_path: Path) -> None:
    """In a fresh Blender whose Python sees nothing of this environment but Blender itself."""
    site = tmp_path / "site"
    site.mkdir()
    here = Path(importlib.import_module("numpy").__file__).resolve().parent.parent
    for name in BLENDERS_OWN:
        if (here / name).exists():
            (site / name).symlink_to(here / name)
    (tmp_path / "script.py").write_text(SCRIPT)
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    environment |= {"BLENDER_USER_RESOURCES": str(tmp_path / "user"), "PYTHONPATH": str(site)}
    command = [sys.executable, "-S", str(tmp_path / "script.py"), str(zip_file), str(tmp_path / "out")]
    run = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=280)
    lines = [line for line in run.stdout.splitlines() if line.startswith("RESULT ")]
    assert lines, run.stdout[-3000:] + run.stderr[-3000:]
    result = json.loads(lines[0].removeprefix("RESULT "))
    assert result["early"] == [], "enabling the extension must not import heavy packages"
    assert set(map(tuple, result["done"].values())) == {("FINISHED",)}
    user = str(tmp_path / "user")
    assert result["package"].startswith(user)
    assert {"cvxopt", "scipy", "shapely", "igl"} <= set(result["places"])
    assert all(place.startswith(user) for place in result["places"].values()), result["places"]
    written = sorted(path.suffix for path in (tmp_path / "out").iterdir())
    assert ".svg" in written
    assert ".dxf" in written
