"""The extension beside another one that comes with older and newer wheels of the same packages, in a real Blender."""

from __future__ import annotations

import re
import shutil
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

pytestmark = pytest.mark.timeout(900)  # Blender starts many times, maybe on a busy machine
INIT = """
from importlib import metadata

def register():
    import {module}
    print("OTHER", "{module}", metadata.version("{name}"), flush=True)

def unregister():
    pass
"""
MANIFEST = """schema_version = "1.0.0"
id = "{id}"
version = "1.0.0"
name = "Other"
tagline = "Comes with wheels of the same packages"
maintainer = "Nobody"
type = "add-on"
blender_version_min = "4.2.0"
license = ["SPDX:GPL-3.0-or-later"]
wheels = [{wheels}]
"""
LINES = """
say() {{ "$@" > $name.out 2> $name.err; echo $? > $name.status; }}
install() {{ name=$1; say blender --command extension install-file -r user_default -e $1.zip; }}
(cd other && blender --command extension build --output-filepath ../other.zip) > other.log 2>&1
(cd broken && blender --command extension build --output-filepath ../broken.zip) > broken.log 2>&1
install other; install flexmaps
name=both; say blender --command flexmaps run shape:strip --set sheet.nesting=FAST --no-pictures --out sheets
cat > script.py <<'END'
from importlib import metadata
import typing_extensions
from bl_ext.user_default.flexmaps.engine import packages
print("FOUND", *(f"{{name}}={{metadata.version(name)}}" for name in ("shapely", "typing_extensions", "jinja2")))
print("STRANGERS", sorted(packages.replaced_packages()))
END
name=script; say blender -b --python script.py
install broken
name=broken; say blender --command flexmaps export shape:strip --out sheets
"""


def wheel(folder: Path, name: str, version: str, files: dict[str, bytes]) -> Path:
    """A wheel for any Python."""
    target, info = folder / "wheels" / f"{name}-{version}-py3-none-any.whl", f"{name}-{version}.dist-info"
    target.parent.mkdir(parents=True, exist_ok=True)
    files = files | {
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n".encode(),
        f"{info}/WHEEL": b"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    with zipfile.ZipFile(target, "w") as made:
        for path, data in files.items():
            made.writestr(path, data)
        made.writestr(f"{info}/RECORD", "".join(f"{path},,\n" for path in [*files, f"{info}/RECORD"]))
    return target


def extension(folder: Path, module: str, wheels: list[Path]) -> None:
    listed = ", ".join(f'"./wheels/{path.name}"' for path in wheels)
    (folder / "blender_manifest.toml").write_text(MANIFEST.format(id=folder.name, wheels=listed))
    (folder / "__init__.py").write_text(INIT.format(module=module, name=module))


def test_beside_older_newer_and_broken_wheels(real_blender: ModuleType, debian_zip: Path, tmp_path: Path) -> None:
    shutil.copy2(debian_zip, tmp_path / "flexmaps.zip")
    with zipfile.ZipFile(debian_zip) as ours:
        (jinja,) = (name for name in ours.namelist() if "/jinja2-" in name)
        with zipfile.ZipFile(ours.open(jinja)) as content:
            sources = {name: content.read(name) for name in content.namelist() if name.startswith("jinja2/")}
    other, broken = tmp_path / "other", tmp_path / "broken"
    extension(other, "typing_extensions", [
        wheel(other, "typing_extensions", "4.1.0", {"typing_extensions.py": b"OLD = True\n"}),
        wheel(other, "shapely", "1.8.0", {"shapely/__init__.py": b"OLD = True\n"}),
        wheel(other, "jinja2", "3.9.0", sources),  # newer, and it works
    ])  # fmt: skip
    extension(broken, "shapely", [wheel(broken, "shapely", "99.0.0", {"shapely/__init__.py": b"NEW = True\n"})])
    done = real_blender.shell(LINES.format(), tmp_path, timeout=800)

    def said(name: str, kind: str) -> str:
        path = tmp_path / f"{name}.{kind}"
        assert path.is_file(), done.stdout + done.stderr
        return path.read_text()

    names = ("other", "flexmaps", "both", "script")
    assert [said(name, "status").strip() for name in names] == ["0"] * 4, "".join(said(name, "err") for name in names)
    assert (tmp_path / "sheets" / "sheet-01.dxf").is_file() and (tmp_path / "sheets" / "report.html").is_file()
    ours_versions = dict(
        re.findall(r"/(shapely|typing_extensions)-([\d.]+)-", "\n".join(zipfile.ZipFile(debian_zip).namelist()))
    )
    found = dict(word.split("=") for word in re.findall(r"FOUND (.*)", said("script", "out"))[0].split())
    assert found == {**ours_versions, "jinja2": "3.9.0"}, "the newest of each"
    assert "STRANGERS ['jinja2']" in said("script", "out")
    assert f"OTHER typing_extensions {ours_versions['typing_extensions']}" in said("script", "out"), "it works too"

    assert said("broken", "status").strip() == "2", said("broken", "err")
    (line,) = (text for text in said("broken", "err").splitlines() if text.startswith("flexmaps:"))
    assert "shapely 99.0.0 instead of " in line and "disable that extension" in line
    assert "Traceback" not in said("broken", "err")
