"""The zip that the tests of this tier install."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

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


@pytest.fixture
def alone(tmp_path: Path) -> dict[str, str]:
    """The environment of a fresh Blender whose Python sees nothing of this one but Blender itself; start it with ``-S``."""
    site = tmp_path / "site"
    site.mkdir()
    here = Path(str(importlib.import_module("numpy").__file__)).resolve().parent.parent
    for name in BLENDERS_OWN:
        if (here / name).exists():
            (site / name).symlink_to(here / name)
    found = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return found | {"BLENDER_USER_RESOURCES": str(tmp_path / "user"), "PYTHONPATH": str(site)}
