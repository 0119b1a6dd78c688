"""The zip as a user gets it: what is in it, and whether it works in a Blender that has nothing else."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]

SCRIPT = """
import json, sys
from pathlib import Path
import bpy

zip_file, out = sys.argv[-2:]
bpy.ops.extensions.package_install_files(filepath=zip_file, repo="user_default", enable_on_install=True)
import bl_ext.user_default.flexmaps as flexmaps
heavy = {"cvxopt", "scipy", "shapely", "igl", "ezdxf", "xatlas", "spyrrow"}
early = sorted(heavy & set(sys.modules))

from bl_ext.user_default.flexmaps.bridge.view import scene
from bl_ext.user_default.flexmaps.engine.surface import shapes
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


def test_listing(zip_file: Path) -> None:
    names = zipfile.ZipFile(zip_file).namelist()
    tops = {name.split("/")[0] for name in names}
    shipped = {"__init__.py", "blender_manifest.toml", "LICENSE", "README.md", "THIRD_PARTY.md"}
    assert shipped <= tops
    assert tops <= shipped | {"api", "bridge", "command", "data", "engine", "operators", "panels", "presets", "wheels"}
    assert not any("__pycache__" in name for name in names)
    assert "panels/locale/de.po" in names


def test_wheels(zip_file: Path) -> None:
    wheels = [Path(name).name for name in zipfile.ZipFile(zip_file).namelist() if name.endswith(".whl")]
    packages = [wheel.split("-")[0] for wheel in wheels]
    assert len(set(packages)) == len(packages)
    assert "numpy" not in packages
    assert {"cvxopt", "ezdxf", "jinja2", "libigl", "polib", "scipy", "shapely", "spyrrow", "xatlas"} <= set(packages)
    ours, running = [wheel for wheel in wheels if "none-any" not in wheel], sys.version_info[1]
    for wheel in ours:
        python, abi = wheel.split("-")[2:4]
        oldest = int(python.removeprefix("cp3"))
        assert oldest <= running if abi == "abi3" else oldest == running, wheel
    assert zip_file.stat().st_size <= 75e6, "what a user has to download"


def test_every_wheel_and_library_has_a_licence_that_fits(build_zip: ModuleType, zip_file: Path, tmp_path: Path) -> None:
    """The page of licences names every wheel; libigl has its core alone; what nobody listed is named."""
    third_party = build_zip.third_party
    with zipfile.ZipFile(zip_file) as content:
        names = [name for name in content.namelist() if name.endswith(".whl")]
        content.extractall(tmp_path, names)
        page = content.read("THIRD_PARTY.md").decode()
    wheels = [tmp_path / name for name in names]
    assert third_party.faults(wheels) == [] and "three.js" in page
    assert all(f"| {wheel.name.split('-')[0]} | " in page for wheel in wheels)
    (igl,) = (wheel for wheel in wheels if wheel.name.startswith("libigl"))
    with zipfile.ZipFile(igl) as content:
        files = content.namelist()
        assert not any(word in name for name in files for word in ("triangle", "tetgen", "cgal", "embree"))
        record = next(name for name in files if name.endswith("/RECORD"))
        rows = [row.split(",") for row in content.read(record).decode().splitlines()]
        assert [row[0] for row in rows] == files
        for name, digest, size in rows[:-1]:
            data = content.read(name)
            wanted = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            assert (digest, int(size)) == (f"sha256={wanted}", len(data))
    planted = tmp_path / "shapely-9-py3-none-any.whl"
    with zipfile.ZipFile(planted, "w") as content:
        content.writestr("shapely-9.dist-info/licenses/LICENSE", "all rights reserved")
        content.writestr("shapely.libs/libstranger.so", "")
        content.writestr("shapely/tool.exe", "")
    unknown = tmp_path / "stranger-1-py3-none-any.whl"
    zipfile.ZipFile(unknown, "w").close()
    assert len(third_party.faults([planted, unknown])) == 5
    blenders_own = tmp_path / "numpy-2.4.0-cp313-cp313-win_amd64.whl"
    zipfile.ZipFile(blenders_own, "w").close()
    assert any("Blender brings numpy" in one for one in third_party.faults([blenders_own]))
    # what is compiled into a wheel is named with its source too
    assert "| MPL-2.0 | spyrrow | sparrow 0.1.0 (<https://github.com/JeroenGar/sparrow/tree/" in page
    assert "libfftw3" not in page or "<https://www.fftw.org>" in page


@pytest.mark.thorough
@pytest.mark.timeout(1200)  # what is not here yet is fetched
def test_the_wheels_of_every_zip(build_zip: ModuleType, tmp_path: Path) -> None:
    """Licences, files and systems of all that ships, for every platform and line; ``build`` refuses a zip with a fault."""
    runtime = (ROOT / "requirements" / "runtime.txt").read_text(encoding="utf-8")
    pins = re.findall(r"^[\w.-]+==", runtime, re.MULTILINE)
    for platform in build_zip.PLATFORMS:
        for line in build_zip.usual_lines(platform):
            folder = tmp_path / f"{platform}-{line}"
            folder.mkdir()
            wheels = build_zip.download_wheels(platform, build_zip.LINES[line].python)
            shipped = [build_zip.third_party.lighter(wheel, folder) for wheel in wheels]
            assert len(shipped) == len(pins), "those that runtime.txt names"
            assert build_zip.third_party.faults(shipped) == []
            assert [fault for wheel in shipped for fault in build_zip.binaries.faults(wheel)] == []


def test_one_repository_can_offer_all_zips(build_zip: ModuleType, tmp_path: Path) -> None:
    """Blender's own tool makes the repository's list; it refuses zips of which two fit the same Blender."""
    for platform in build_zip.PLATFORMS:
        for line in build_zip.usual_lines(platform):
            with zipfile.ZipFile(tmp_path / f"{line}-{platform}.zip", "w") as file:
                file.writestr("__init__.py", "")
                file.writestr(
                    "blender_manifest.toml", build_zip.manifest(platform, line, []).replace("wheels = [\n]", "")
                )
    build_zip.blender_ext("server-generate", "--repo-dir", str(tmp_path))
    listed = json.loads((tmp_path / "index.json").read_text())["data"]
    for version, fitting in (("4.2.0", 1), ("4.5.9", 1), ("5.0.3", 1), ("5.1.0", 1), ("6.0.0", 1), ("4.1.1", 0)):
        for platform in build_zip.PLATFORMS:
            fits = [entry for entry in listed if entry["platforms"] == [platform] and _serves(entry, version)]
            ended = platform == "macos-x64" and version >= "5.1"
            assert len(fits) == (0 if ended else fitting), (version, platform)


def _serves(entry: dict[str, str], version: str) -> bool:
    """As Blender decides: the upper bound itself is outside."""
    return entry["blender_version_min"] <= version < entry.get("blender_version_max", "9")


def test_the_version_is_said_alike_everywhere() -> None:
    import tomllib

    from flexmaps.engine import VERSION

    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    pattern = project["tool"]["hatch"]["version"]["pattern"]
    (packaged,) = re.findall(pattern, (ROOT / project["tool"]["hatch"]["version"]["path"]).read_text(), re.MULTILINE)
    assert "version" not in project["project"] and manifest["version"] == packaged == VERSION


def test_main_job_from_the_installed_extension(zip_file: Path, tmp_path: Path, alone: dict[str, str]) -> None:
    """In a fresh Blender whose Python sees nothing of this environment but Blender itself."""
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, "-S", str(tmp_path / "script.py"), str(zip_file), str(tmp_path / "out")]
    run = subprocess.run(command, env=alone, cwd=tmp_path, capture_output=True, text=True, timeout=280)
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
