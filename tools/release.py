"""``release`` of tools/dev.py: a new version, from the number in the manifest to the files that are uploaded.

The version and the changelog are written into the checkout only when everything was built and tried; what fails before leaves it as
it was. Nothing is committed, tagged or sent: the last lines say how.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import build_zip
import dev
import fresh_blender
import real_blender

ROOT = Path(__file__).resolve().parent.parent
MANIFEST, CHANGELOG = "blender_manifest.toml", "CHANGELOG.md"
SUMS = "SHA256SUMS"
UNRELEASED = "## [Unreleased]"
_VERSION = re.compile(r'^version = "(.+)"$', re.MULTILINE)


class ReleaseRefused(Exception):
    """Raised with the reason why there can be no release."""


def main(argv: list[str]) -> int:
    """The exit status: 0 when the files are there, 2 when there can be no such release."""
    parser = argparse.ArgumentParser(prog="dev.py release", description=__doc__)
    parser.add_argument("version", help="of three numbers, such as 0.2.0 (https://semver.org)")
    parser.add_argument("--dry-run", action="store_true", help="do it all, and leave nothing behind")
    parser.add_argument("--platform", choices=build_zip.PLATFORMS, action="append", help="default: all of them")
    parser.add_argument(
        "--line", choices=build_zip.LINES, action="append", help=f"default: {' and '.join(build_zip.USUAL)}"
    )
    wanted = parser.parse_args(argv)

    def make(folder: Path) -> None:
        build_all(folder, wanted.platform or list(build_zip.PLATFORMS), wanted.line)

    try:
        release(ROOT, wanted.version, make, dry=wanted.dry_run)
    except ReleaseRefused as reason:
        print(f"release: {reason}", file=sys.stderr)
        return 2
    return 0


def release(root: Path, version: str, make: Callable[[Path], None], *, dry: bool = False) -> None:
    """Write the version, ``make`` the files in a folder, say what is to be uploaded; with ``dry``, put everything back.

    Raises ``Refused`` where the version, the changelog or the checkout does not allow it, and what ``make`` raises.
    """
    texts = prepare_texts(root, version)
    target = root / "dist" / version
    target.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".release-") as place:
        folder = Path(place) / version
        folder.mkdir()
        with write_texts(root, texts, keep=not dry):
            make(folder)
            _told(folder)
            if dry:
                print("A dry run: nothing of this stays. Without --dry-run the files lie in dist/" + version)
                return
            folder.rename(target)
    print(
        f"They lie in dist/{version}. Upload the zips and {SUMS}, and everything in repository/ to the web server, the index last.\n"
        f'The version is in {MANIFEST} and {CHANGELOG} now: git commit -am "Version {version}" && git tag v{version}'
    )


# -- what is looked at before --------------------------------------------------------------------------------------------


def prepare_texts(root: Path, version: str) -> dict[str, str]:
    """The files of the checkout that the release changes, with their new texts. Raises ``Refused``."""
    manifest = (root / MANIFEST).read_text(encoding="utf-8")
    before = _VERSION.search(manifest)
    assert before is not None
    if not re.fullmatch(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)", version):
        raise ReleaseRefused(f"'{version}' is no version; give three numbers, such as {before[1]}")
    if _numbers(version) < _numbers(before[1]):
        raise ReleaseRefused(f"{version} is older than {before[1]}, which {MANIFEST} says; give a newer one")
    if _git(root, "status", "--porcelain"):
        raise ReleaseRefused(
            "there are changes that are not committed; commit them or put them away ('git status' names them)"
        )
    if f"v{version}" in _git(root, "tag", "--list").split():
        raise ReleaseRefused(f"there is a tag v{version} already; give a newer version")
    if (root / "dist" / version).exists():
        raise ReleaseRefused(f"dist/{version} is there already; remove it, if it was never uploaded")
    notes = (root / CHANGELOG).read_text(encoding="utf-8")
    changed = with_release_notes(notes, version, datetime.date.today().isoformat())
    return {MANIFEST: manifest.replace(before[0], f'version = "{version}"', 1), CHANGELOG: changed}


def with_release_notes(text: str, version: str, day: str) -> str:
    """Return the changelog with the unreleased entries under the version. Raises ``Refused`` if there are none."""
    own = re.search(rf"^## \[{re.escape(version)}\].*$", text, re.MULTILINE)
    head, marker, rest = text.partition(f"{UNRELEASED}\n")
    fresh = bool(marker) and re.split(r"^## ", rest, maxsplit=1, flags=re.MULTILINE)[0].strip() != ""
    if own is not None and fresh:
        raise ReleaseRefused(f"{CHANGELOG} has both {UNRELEASED[3:]} and [{version}]; put what is new into one of them")
    if own is None and not fresh:
        raise ReleaseRefused(f"{CHANGELOG} says nothing of {version}; write under {UNRELEASED[3:]} what is new")
    return text if own is not None else f"{head}{marker}\n## [{version}] - {day}\n{rest}"


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])


def _git(root: Path, *words: str) -> str:
    return subprocess.run(["git", *words], cwd=root, check=True, capture_output=True, text=True).stdout.strip()


@contextmanager
def write_texts(root: Path, texts: dict[str, str], *, keep: bool) -> Iterator[None]:
    """Files of the checkout with other texts; as they were, byte for byte, after an error, or unless they are to be kept."""
    before = {name: (root / name).read_bytes() for name in texts}
    done = False
    try:
        for name, text in texts.items():
            (root / name).write_text(text, encoding="utf-8", newline="\n")
        yield
        done = keep
    finally:
        if not done:
            for name, data in before.items():
                (root / name).write_bytes(data)


# -- what is made and tried ----------------------------------------------------------------------------------------------


def build_all(folder: Path, platforms: list[str], lines: list[str] | None) -> None:
    """Build every zip, the repository and the wheel for pip, and test them as far as this machine can. Raises ``Refused``.

    lines : None for those that there are on each platform
    """
    zips = []
    for platform in platforms:
        for line in lines or build_zip.usual_lines(platform):
            print(f"Building for {platform}, {line}", flush=True)
            zips.append(build_zip.build(platform, line, folder))
    build_zip.repository(zips, folder / "repository")
    _package(folder)
    _validated(zips)
    _installed(zips)


def _package(folder: Path) -> None:
    """The wheel for pip, installed into an empty folder, where its command answers."""
    print("Building the package for pip", flush=True)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    wheel = build_zip.package(folder)
    with tempfile.TemporaryDirectory() as empty:
        _run([*pip, "install", "--no-deps", "--target", empty, str(wheel)])
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        command = [sys.executable, "-c", "import flexmaps; flexmaps.console()", "settings", "--json"]
        _run(command, env=environment | {"PYTHONPATH": empty}, cwd=empty)


def _validated(zips: list[Path]) -> None:
    """By a real Blender; the validator of Blender as a module has accepted each as it was built."""
    reason = real_blender.obstacle()
    if reason is not None:
        print(f"Not looked at by a Blender with its window: {reason}")
        return
    with tempfile.TemporaryDirectory() as place:
        for path in zips:
            shutil.copy2(path, place)
        lines = "".join(f"blender --command extension validate {path.name} || exit 1\n" for path in zips)
        done = real_blender.shell(f"blender --version | head -1\n{lines}", Path(place))
    if done.returncode:
        raise ReleaseRefused(f"Blender does not accept a zip: {(done.stdout + done.stderr)[-2000:]}")
    print(f"{len(zips)} zips accepted by {done.stdout.splitlines()[0]}", flush=True)


def _installed(zips: list[Path]) -> None:
    """Each zip of this machine's platform, in a Blender that has nothing else, where its Python is here."""
    own = build_zip.own_platform()
    for path in zips:
        line = next(name for name in build_zip.LINES if f"-{name}-" in path.name)
        version = tuple(int(part) for part in build_zip.LINES[line].python.split("."))
        running = version == sys.version_info[:2]
        python = sys.executable if running else dev.environment_python(version)
        if own is None or not path.stem.endswith(own):
            print(f"{path.name}: not tried, for this machine is of another platform")
        elif not running and not dev.is_ready(version):
            print(f"{path.name}: not tried, for there is no environment of Python {version[0]}.{version[1]}")
        else:
            with tempfile.TemporaryDirectory() as place:
                try:
                    told = fresh_blender.try_zip(path, Path(place), python)
                except RuntimeError as error:
                    raise ReleaseRefused(str(error)) from None
            if f"-{told['version']}-" not in path.name:
                raise ReleaseRefused(f"{path.name} says inside that it is of version {told['version']}")
            print(f"{path.name}: installed and used, {told['spirals']} spirals simulated", flush=True)


def _run(command: list[str], **how: object) -> None:
    done = subprocess.run(command, capture_output=True, text=True, **how)  # type: ignore[call-overload]
    if done.returncode:
        raise ReleaseRefused(f"'{' '.join(command[:4])} ...' failed: {(done.stdout + done.stderr)[-2000:]}")


def _told(folder: Path) -> None:
    """Write the checksums of what people download, and say them with the sizes."""
    files = sorted(path for path in folder.iterdir() if path.is_file())
    sums = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    (folder / SUMS).write_text("".join(f"{told}  {path.name}\n" for path, told in sums.items()), encoding="utf-8")
    for path, told in sums.items():
        print(f"{path.stat().st_size / 1e6:6.1f} MB  {told}  {path.name}")
    if (folder / "repository").is_dir():
        size = sum(path.stat().st_size for path in (folder / "repository").iterdir())
        print(f"{size / 1e6:6.1f} MB  repository/")
