"""Loads the checkout once, as the package ``flexmaps``, and offers what several tests share."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# one thread around small dense work: faster here, and the same result on every machine
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


def _load_checkout() -> None:
    """Load the package through tools/dev.py, the one place that knows how."""
    spec = importlib.util.spec_from_file_location("flexmaps_dev", ROOT / "tools" / "dev.py")
    assert spec is not None
    assert spec.loader is not None
    dev = importlib.util.module_from_spec(spec)
    sys.modules["flexmaps_dev"] = dev
    spec.loader.exec_module(dev)
    dev.load_package()


# `python -m pytest` puts the working folder there; with it, every module could be imported a second time by another name
sys.path[:] = [p for p in sys.path if Path(p or ".").resolve() != ROOT]
_load_checkout()


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's root folder."""
    return ROOT


@pytest.fixture(scope="session")
def shared_meshes() -> Path:
    """The folder of the larger test meshes beside the checkout; skips where it is not there."""
    folder = ROOT.parent / "shared" / "meshes"
    if not folder.is_dir():
        pytest.skip(f"no larger meshes: {folder} is not there")
    return folder


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Blender as a module complains for pages when the process ends, and can wait for ever: leave without its clean-up."""
    if "bpy" in sys.modules:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(int(config.stash.get(_STATUS, 0)))


_STATUS = pytest.StashKey[int]()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.stash[_STATUS] = int(exitstatus)
