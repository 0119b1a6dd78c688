"""The zip that the tests of this tier install."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def platform(build_zip: ModuleType) -> str:
    name: str | None = build_zip.own_platform()
    if name is None:
        pytest.skip(f"the extension is not built for {sys.platform}")
    return name


@pytest.fixture(scope="session")
def zip_file(build_zip: ModuleType, platform: str) -> Path:
    """The zip for this platform and this Python; Blender's own validator has accepted it, or this raises."""
    return build_zip.build(platform, build_zip.own_line())


@pytest.fixture(scope="session")
def debian_zip(real_blender: ModuleType, build_zip: ModuleType) -> Path:
    """The zip for the real Blender that tests drive."""
    return build_zip.build("linux-x64", "debian-13-blender")


@pytest.fixture
def alone(fresh_blender: ModuleType, tmp_path: Path) -> dict[str, str]:
    """The environment of a fresh Blender whose Python sees nothing of this one but Blender itself; start it with ``-S``."""
    made: dict[str, str] = fresh_blender.environment(tmp_path)
    return made
