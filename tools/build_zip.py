"""``build`` of tools/dev.py: the extension's zips, one per platform and Python, each with the wheels that it needs."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from platform import machine
from typing import NamedTuple

import binaries
import lock
import third_party

ROOT = Path(__file__).resolve().parent.parent
WHEELS, BUILD, DIST = ROOT / "wheels", ROOT / "build", ROOT / "dist"
TEMPLATE = ROOT / "tools" / "repository.html"  # of the page of a repository

# the tags that pip needs to hear, the preferred first; pip takes each literally. On macOS the oldest system comes first,
# for a wheel made for an older one runs on all
PLATFORMS = {
    "linux-x64": [f"manylinux_2_{n}_x86_64" for n in (28, 27, 24, 17)] + ["manylinux2014_x86_64"],
    "windows-x64": ["win_amd64"],
    "macos-arm64": [f"macosx_{n}_0_arm64" for n in (11, 12, 13, 14, 15)] + ["macosx_10_9_universal2"],
    "macos-x64": [f"macosx_10_{n}_x86_64" for n in (9, 12, 14, 15)]
    + [f"macosx_{n}_0_x86_64" for n in (11, 12, 13, 14, 15)],
}
PURE = ("ezdxf", "fonttools")  # their compiled wheels are four times as large and no faster at what they do here


class BlenderLine(NamedTuple):
    """Blenders that share a Python: from ``first`` on, and older than ``before``, where that is known."""

    python: str
    first: str
    before: str | None


# in the words that stand in a zip's name
LINES = {
    "blender-4.2-to-5.0": BlenderLine("3.11", "4.2.0", "5.1.0"),
    "blender-5.1-or-newer": BlenderLine("3.13", "5.1.0", None),
    "debian-13-blender": BlenderLine(
        "3.13", "4.2.0", "5.1.0"
    ),  # Debian's own Blender, 4.3, runs on the system's Python
}
USUAL = ("blender-4.2-to-5.0", "blender-5.1-or-newer")
# Blender 4.5 is the last for Macs of Intel (developer.blender.org, release notes of 5.0)
ENDED = {"macos-x64": USUAL[:1]}


def main(argv: list[str]) -> int:
    """Build the zips that are asked for; the exit status is 0 when Blender's own validator accepts all of them."""
    parser = argparse.ArgumentParser(prog="build", description="Make the extension's zips in dist/.")
    own = own_platform()
    parser.add_argument(
        "--platform", choices=[*PLATFORMS, "all"], default=own or "all", help=f"default: {own or 'all'}"
    )
    parser.add_argument("--line", choices=LINES, action="append", help=f"default: {' and '.join(USUAL)}")
    parser.add_argument(
        "--repository",
        type=Path,
        metavar="DIR",
        help="also make a folder for a web server, from which Blender installs",
    )
    parser.add_argument("--pip", action="store_true", help="also make the package for pip")
    wanted = parser.parse_args(argv)
    built = []
    for platform in PLATFORMS if wanted.platform == "all" else [wanted.platform]:
        for line in wanted.line or usual_lines(platform):
            built.append(build(platform, line))
            print(f"{built[-1].relative_to(ROOT)}  {built[-1].stat().st_size / 1e6:.1f} MB", flush=True)
    if wanted.pip:
        print(package(DIST).relative_to(ROOT))
    if wanted.repository is not None:
        repository(built, wanted.repository)
        print(f"{wanted.repository}: put it onto any web server; index.html there is the page to drag from")
    return 0


def own_platform() -> str | None:
    """This machine's name among ``PLATFORMS``; ``None`` where no zip is made for its system."""
    mac = "macos-arm64" if machine() == "arm64" else "macos-x64"
    return {"linux": "linux-x64", "win32": "windows-x64", "darwin": mac}.get(sys.platform)


def usual_lines(platform: str) -> tuple[str, ...]:
    """The lines for which there is a Blender on a platform."""
    return ENDED.get(platform, USUAL)


def own_line() -> str:
    """Name of the line whose Blenders have the Python that runs now."""
    here = "{}.{}".format(*sys.version_info[:2])
    return next(name for name in USUAL if LINES[name].python == here)


def build(platform: str, line: str, folder: Path = DIST) -> Path:
    """Make and validate one zip in a folder; returns its path. Raises ``CalledProcessError`` with the reason printed, and ``ValueError`` where
    something would ship whose licence nobody looked up, or that is for another system."""
    wheels = download_wheels(platform, LINES[line].python)
    stage = BUILD / f"{line}-{platform}"
    shutil.rmtree(stage, ignore_errors=True)
    try:
        return _staged(platform, line, wheels, stage, folder)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _staged(platform: str, line: str, wheels: list[Path], stage: Path, folder: Path) -> Path:
    """Put together in ``stage`` what ships, and make the zip of it."""
    for name in _sources():
        target = stage / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target)
    (stage / "wheels").mkdir()
    shipped = [third_party.lighter(wheel, stage / "wheels") for wheel in wheels]
    faults = [*third_party.faults(shipped), *(fault for wheel in shipped for fault in binaries.faults(wheel))]
    if faults:
        raise ValueError("\n".join(faults))
    (stage / "THIRD_PARTY.md").write_text(third_party.page(shipped), encoding="utf-8")
    text = manifest(platform, line, [wheel.name for wheel in shipped])
    (stage / "blender_manifest.toml").write_text(text, encoding="utf-8")
    folder.mkdir(parents=True, exist_ok=True)
    version = re.search(r'^version = "(.+)"', text, re.MULTILINE).group(1)  # type: ignore[union-attr]
    target = folder / f"flexmaps-{version}-{line}-{platform}.zip"
    blender_ext("build", "--source-dir", str(stage), "--output-filepath", str(target))
    blender_ext("validate", str(target))
    return target


def package(folder: Path) -> Path:
    """The wheel for pip in a folder; returns its path. Raises ``CalledProcessError`` with the reason printed."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q", "wheel"]
    with tempfile.TemporaryDirectory() as place:  # where no other wheel lies
        subprocess.run([*pip, "--no-deps", "--no-build-isolation", "-w", place, str(ROOT)], check=True)
        (made,) = Path(place).glob("*.whl")
        folder.mkdir(parents=True, exist_ok=True)
        return Path(shutil.copy2(made, folder))


def repository(zips: list[Path], folder: Path) -> None:
    """A folder for any web server that Blender installs and updates from: zips, index.json, and a page to drag them from.

    Zips of other versions stay there; the index names those of the newest version alone, as Blender takes the first that fits.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as alone:  # the tool lists all zips of a folder
        for path in zips:
            shutil.copy2(path, folder)
            link_or_copy(str(path.resolve()), str(Path(alone, path.name)))
        blender_ext("server-generate", "--repo-dir", alone, "--html", "--html-template", str(TEMPLATE))
        for name in ("index.html", "index.json"):  # after the zips: what they name is there
            part = folder / f"{name}.part"
            shutil.copy2(Path(alone) / name, part)
            part.replace(folder / name)


def link_or_copy(source: str, target: str) -> None:
    """A second name for a large file, where the disk can give one, instead of a copy."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def manifest(platform: str, line: str, wheels: list[str]) -> str:
    """Text of the manifest of one zip: the checkout's, with the Blenders, the platform and the wheels that it is for."""
    text = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    _, first, before = LINES[line]
    bounds = f'blender_version_min = "{first}"\n' + (f'blender_version_max = "{before}"\n' if before else "")
    text, count = re.subn(r"^blender_version_min = .*\n", bounds, text, flags=re.MULTILINE)
    assert count == 1
    listed = "".join(f'  "./wheels/{wheel}",\n' for wheel in wheels)
    head, marker, rest = text.partition("[permissions]")
    return f'{head}platforms = ["{platform}"]\nwheels = [\n{listed}]\n\n{marker}{rest}'


def download_wheels(platform: str, python: str) -> list[Path]:
    """Download the pinned wheels for a platform and Python into wheels/ unless they are there; returns their paths, sorted."""
    pins = re.findall(r"^([\w.-]+==[\w.]+)", (ROOT / "requirements" / "runtime.txt").read_text(), re.MULTILINE)
    folder = WHEELS / platform / python
    if not _complete(folder, pins):
        print(f"Fetching wheels for {platform}, Python {python}", flush=True)
        shutil.rmtree(folder, ignore_errors=True)  # no wheel of an earlier pin stays
        folder.mkdir(parents=True)
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input", "download", "-q", "--no-deps"]
        pip += ["--only-binary=:all:", "--python-version", python, "-d", str(folder)]
        tags = [word for tag in PLATFORMS[platform] for word in ("--platform", tag)]
        pure = [pin for pin in pins if pin.startswith(PURE)]
        anywhere = ["--implementation", "py", "--abi", "none", "--platform", "any"]
        _download([*pip, *anywhere], pure)
        _download([*pip, "--implementation", "cp", *tags], [pin for pin in pins if pin not in pure])
    found = sorted(folder.glob("*.whl"))
    assert not any(path.name.startswith("numpy-") for path in found), "Blender brings its own numpy"
    return found


def _download(pip: list[str], pins: list[str]) -> None:
    """Have pip fetch the files of some pins, which have to be those that requirements/locked.txt knows by their checksums."""
    known = lock.hashes(lock.LOCKED.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as place:
        wanted = Path(place) / "wanted.txt"
        wanted.write_text(
            "".join(f"{pin} {' '.join(known[lock.normalise_pin(pin)])}\n" for pin in pins), encoding="utf-8"
        )
        subprocess.run([*pip, "--require-hashes", "-r", str(wanted)], check=True)


def _complete(folder: Path, pins: list[str]) -> bool:
    there = {"==".join(path.name.split("-")[:2]).lower() for path in folder.glob("*.whl")}
    return there == {pin.replace("-", "_").lower() for pin in pins}


def _sources() -> list[str]:
    """The files of the checkout that git knows or would add; what ships of them is up to the manifest."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def blender_ext(*arguments: str) -> None:
    """Blender's own tool for extensions, from the embedded Blender."""
    import bpy

    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    done = subprocess.run([sys.executable, str(tool), *arguments], capture_output=True, text=True)
    if done.returncode:
        print(done.stdout + done.stderr, file=sys.stderr)
        done.check_returncode()
