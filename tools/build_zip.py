"""``build`` of tools/dev.py: the extension's zip, one a platform, with the wheels that it needs inside."""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WHEELS, BUILD, DIST = ROOT / "wheels", ROOT / "build", ROOT / "dist"
PYTHONS = ("3.11", "3.13")  # Blender 4.2 to 5.0, and 5.1 onwards: it unpacks the wheels that fit

# the tags that pip needs to hear, newest first; pip takes each literally
PLATFORMS = {
    "linux-x64": [f"manylinux_2_{n}_x86_64" for n in (28, 27, 24, 17)] + ["manylinux2014_x86_64"],
    "windows-x64": ["win_amd64"],
    "macos-arm64": [f"macosx_{n}_0_arm64" for n in (15, 14, 13, 12, 11)] + ["macosx_10_9_universal2"],
}


def main(argv: list[str]) -> int:
    """Build the zips that are asked for; the exit status is 0 when Blender's own validator accepts all of them."""
    parser = argparse.ArgumentParser(prog="build", description="Make the extension's zip in dist/.")
    parser.add_argument("--platform", choices=[*PLATFORMS, "all"], default="all")
    wanted = parser.parse_args(argv).platform
    for platform in PLATFORMS if wanted == "all" else [wanted]:
        path = build(platform)
        print(f"{path.relative_to(ROOT)}  {path.stat().st_size / 1e6:.1f} MB", flush=True)
    return 0


def build(platform: str) -> Path:
    """Make and validate one zip; returns its path. Raises ``CalledProcessError`` with the reason printed."""
    wheels = fetch(platform)
    stage = BUILD / platform
    shutil.rmtree(stage, ignore_errors=True)
    for name in _sources():
        target = stage / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target)
    (stage / "wheels").mkdir()
    for wheel in wheels:
        shutil.copy2(wheel, stage / "wheels")
    manifest = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    listed = "".join(f'  "./wheels/{wheel.name}",\n' for wheel in wheels)
    head, marker, rest = manifest.partition("[permissions]")
    added = f'platforms = ["{platform}"]\nwheels = [\n{listed}]\n\n'
    (stage / "blender_manifest.toml").write_text(head + added + marker + rest, encoding="utf-8")
    DIST.mkdir(exist_ok=True)
    target = DIST / f"flexmaps-{_version(manifest)}-{platform}.zip"
    _blender_ext("build", "--source-dir", str(stage), "--output-filepath", str(target))
    _blender_ext("validate", str(target))
    shutil.rmtree(stage)
    return target


def fetch(platform: str) -> list[Path]:
    """Download the pinned wheels for a platform into wheels/ unless they are there; returns their paths, sorted."""
    pins = re.findall(r"^([\w.-]+==[\w.]+)", (ROOT / "requirements" / "runtime.txt").read_text(), re.MULTILINE)
    tags = [word for tag in PLATFORMS[platform] for word in ("--platform", tag)]
    found: set[Path] = set()
    for python in PYTHONS:
        folder = WHEELS / platform / python
        if not _complete(folder, pins):
            print(f"Fetching wheels for {platform}, Python {python}", flush=True)
            folder.mkdir(parents=True, exist_ok=True)
            pip = [
                sys.executable,
                "-m",
                "pip",
                "--disable-pip-version-check",
                "--no-input",
                "download",
                "-q",
                "--no-deps",
            ]
            only = ["--only-binary=:all:", "--implementation", "cp", "--python-version", python]
            subprocess.run([*pip, *only, *tags, "-d", str(folder), *pins], check=True)
        found |= set(folder.glob("*.whl"))
    by_name = {path.name: path for path in sorted(found)}  # pure wheels come once
    assert not any(name.startswith("numpy-") for name in by_name), "Blender brings its own numpy"
    return [by_name[name] for name in sorted(by_name)]


def _complete(folder: Path, pins: list[str]) -> bool:
    there = {"==".join(path.name.split("-")[:2]).lower() for path in folder.glob("*.whl")}
    return there == {pin.replace("-", "_").lower() for pin in pins}


def _sources() -> list[str]:
    """The files of the checkout that git knows or would add; what ships of them is up to the manifest."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def _version(manifest: str) -> str:
    return re.search(r'^version = "(.+)"', manifest, re.MULTILINE).group(1)  # type: ignore[union-attr]


def _blender_ext(*arguments: str) -> None:
    """Blender's own tool for extensions, from the embedded Blender."""
    import bpy

    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    done = subprocess.run([sys.executable, str(tool), *arguments], capture_output=True, text=True)
    if done.returncode:
        print(done.stdout + done.stderr, file=sys.stderr)
        done.check_returncode()
