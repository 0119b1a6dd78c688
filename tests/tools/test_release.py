"""``dev.py release``: what it refuses, what it changes, and that a release that fails changes nothing."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import ModuleType

import pytest

MANIFEST = 'schema_version = "1.0.0"\n\nid = "flexmaps"\nversion = "0.2.0"\nblender_version_min = "4.2.0"\n'
CHANGELOG = "# Changelog\n\n## [Unreleased]\n\n### Added\n- A rim.\n\n## [0.2.0] - 2026-01-01\n\n- The first.\n"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A small checkout with a released version 0.2.0."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    (folder / "blender_manifest.toml").write_text(MANIFEST)
    (folder / "CHANGELOG.md").write_text(CHANGELOG)
    (folder / ".gitignore").write_text("dist/\n")
    git(folder, "init", "-q")
    commit(folder)
    git(folder, "tag", "v0.2.0")
    return folder


def git(folder: Path, *words: str) -> None:
    subprocess.run(["git", "-c", "user.name=T", "-c", "user.email=t@example.org", *words], cwd=folder, check=True)


def commit(folder: Path) -> None:
    git(folder, "add", "-A")
    git(folder, "commit", "-qm", "state")


def state(folder: Path) -> dict[str, bytes]:
    """Every file but git's own."""
    paths = [path for path in folder.rglob("*") if ".git" not in path.relative_to(folder).parts and path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def make(folder: Path) -> None:
    """What stands for the zips; the new version is in the checkout while they are built."""
    manifest = (folder.parents[2] / "blender_manifest.toml").read_text()
    (folder / "made.zip").write_text(manifest)


def test_the_version_the_changelog_and_the_files(release: ModuleType, checkout: Path) -> None:
    release.release(checkout, "0.3.0", make)
    made = state(checkout)
    assert made["blender_manifest.toml"].decode() == MANIFEST.replace("0.2.0", "0.3.0")
    text = made["CHANGELOG.md"].decode()
    assert text.index("[Unreleased]") < text.index("## [0.3.0] - ") < text.index("- A rim.") < text.index("## [0.2.0]")
    assert made["dist/0.3.0/made.zip"].decode() == made["blender_manifest.toml"].decode()
    digest, name = made["dist/0.3.0/SHA256SUMS"].decode().split()
    assert (len(digest), name) == (64, "made.zip")
    with pytest.raises(release.ReleaseRefused, match="not committed"):  # until this one is committed
        release.release(checkout, "0.3.1", make)


def test_a_dry_run_and_a_failure_leave_everything_as_it_was(release: ModuleType, checkout: Path) -> None:
    before = state(checkout)
    release.release(checkout, "0.3.0", make, dry=True)
    assert state(checkout) == before

    def fails(folder: Path) -> None:
        make(folder)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        release.release(checkout, "0.3.0", fails)
    assert state(checkout) == before


@pytest.mark.parametrize(
    ("version", "reason"),
    [("0.1.9", "older"), ("0.2.0", "tag"), ("0.3", "three numbers"), ("0.03.0", "three numbers"), ("v1.0.0", "three")],
)
def test_versions_that_cannot_be(release: ModuleType, checkout: Path, version: str, reason: str) -> None:
    with pytest.raises(release.ReleaseRefused, match=reason):
        release.release(checkout, version, make)


def test_what_stands_in_the_way(release: ModuleType, checkout: Path) -> None:
    (checkout / "CHANGELOG.md").write_text(CHANGELOG.replace("### Added\n- A rim.\n\n", ""))
    with pytest.raises(release.ReleaseRefused, match="not committed"):
        release.release(checkout, "0.3.0", make)
    commit(checkout)
    with pytest.raises(release.ReleaseRefused, match=r"says nothing of 0\.3\.0"):
        release.release(checkout, "0.3.0", make)
    (checkout / "CHANGELOG.md").write_text(CHANGELOG.replace("[0.2.0]", "[0.3.0]"))
    commit(checkout)
    with pytest.raises(release.ReleaseRefused, match="both"):
        release.release(checkout, "0.3.0", make)
