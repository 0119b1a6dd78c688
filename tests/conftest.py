"""Loads the checkout once, as the package ``flexmaps``, and offers what several tests share."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent

# one thread around small dense work: faster here, and the same result on every machine
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


def load_tool(name: str, folder: str = "tools") -> ModuleType:
    """A module of tools/ or tests/, which are no packages."""
    spec = importlib.util.spec_from_file_location(f"flexmaps_{name}", ROOT / folder / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[f"flexmaps_{name}"] = module
    spec.loader.exec_module(module)
    return module


# `python -m pytest` puts the working folder there; with it, every module could be imported a second time by another name
sys.path[:] = [p for p in sys.path if Path(p or ".").resolve() != ROOT]
load_tool("dev").load_package()  # the one place that knows how
load_tool("shapes", "tests")
load_tool("taylor", "tests")
load_tool("chains", "tests")
load_tool("triangles", "tests")
load_tool("connector_gaps")


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's root folder."""
    return ROOT


@pytest.fixture(scope="session")
def build_zip() -> ModuleType:
    """The tool that builds the extension's zip."""
    sys.path.append(str(ROOT / "tools"))  # for what it imports
    return load_tool("build_zip")


@pytest.fixture(scope="session")
def fresh_blender() -> ModuleType:
    """The tool that starts a Blender which has nothing else."""
    return load_tool("fresh_blender")


@pytest.fixture(scope="session")
def release(build_zip: ModuleType) -> ModuleType:
    """The tool that makes a release; its imports are those of the tool for zips."""
    return load_tool("release")


@pytest.fixture(scope="session")
def messages() -> ModuleType:
    """The tool that finds what translators need."""
    return load_tool("messages")


@pytest.fixture(scope="session")
def measures() -> ModuleType:
    """The tool that counts whether the house is in order."""
    return load_tool("measures")


@pytest.fixture(scope="session")
def random_calls() -> ModuleType:
    """The tool that presses buttons at random."""
    return load_tool("random_calls")


@pytest.fixture(scope="session")
def fuzz_stored() -> ModuleType:
    """The tool that damages what .blend files hold."""
    sys.path.append(str(ROOT / "tools"))
    return load_tool("fuzz_stored")


@pytest.fixture(scope="session")
def fuzz_readers() -> ModuleType:
    """The tool that damages mesh files."""
    return load_tool("fuzz_readers")


@pytest.fixture(scope="session")
def fuzz_meshes() -> ModuleType:
    """The tool that spoils small quad meshes."""
    return load_tool("fuzz_meshes")


@pytest.fixture(scope="session")
def zoo() -> ModuleType:
    """The surfaces that the project makes itself; with ``trial``, which runs the whole job on one, and ``summary``."""
    sys.path.append(str(ROOT / "tools"))  # as for the benches; at the end, where its names hide no others
    for part in ("trial", "summary"):
        importlib.import_module(f"zoo.{part}")
    return sys.modules["zoo"]


@pytest.fixture(scope="session")
def real_blender() -> ModuleType:
    """The tool that runs a real Blender; skips where there can be none, and says why."""
    module = load_tool("real_blender")
    reason = module.obstacle()
    if reason is not None:
        pytest.skip(reason)
    return module


@pytest.fixture(scope="session")
def browser() -> ModuleType:
    """The tool that drives a real browser; skips where there can be none, and says why."""
    module = load_tool("browser")
    reason = module.obstacle()
    if reason is not None:
        pytest.skip(reason)
    return module


_predicting: list[bool] = []


@pytest.fixture(scope="session")
def merge_without_prediction() -> Iterator[None]:
    """Let Merge keep the layout that its limits lead to, unless a test uses ``predicted_match``.

    Predicting the match takes most of the time that a small piece needs from its mesh to its simulation.
    """
    module = importlib.import_module("flexmaps.engine.extras.choosing.refine_merged")
    original = module.refine_merged

    def kept(piece: Any, begun: Any, flat: Any, *more: Any) -> Any:
        return original(piece, begun, flat, *more) if _predicting else flat

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "refine_merged", kept)
        yield


@pytest.fixture
def predicted_match() -> Iterator[None]:
    """Let Merge predict the match, as it does for users."""
    _predicting.append(True)
    yield
    _predicting.pop()


@pytest.fixture(scope="session")
def quick_nesting() -> Iterator[None]:
    """Lay panels on sheets the quick way, unless a test gives the tight nesting its seconds.

    By default the search takes up to three seconds of every core for each set of sheets.
    """
    from dataclasses import replace

    usual = importlib.import_module("flexmaps.engine.params").SheetParams().nesting_seconds
    callers = [
        importlib.import_module(f"flexmaps.engine.{name}") for name in ("fabrication.sheets", "extras.together.batch")
    ]
    original = callers[0].nest

    def quick(shapes: Any, params: Any, *more: Any) -> Any:
        return original(shapes, replace(params, nesting="FAST") if params.nesting_seconds == usual else params, *more)

    with pytest.MonkeyPatch.context() as patch:
        for module in callers:
            patch.setattr(module, "nest", quick)
        yield


@pytest.fixture(scope="session")
def shared_meshes() -> Path:
    """The folder of the larger test meshes beside the checkout; skips where it is not there."""
    folder = ROOT.parent / "shared" / "meshes"
    if not folder.is_dir():
        pytest.skip(f"no larger meshes: {folder} is not there")
    return folder


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--thorough", action="store_true", help="also the tests marked so, which take long")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what takes long unless it is asked for; as skipped tests, so that every summary names and counts them."""
    if not config.getoption("--thorough"):
        for item in items:
            if item.get_closest_marker("thorough"):
                item.add_marker(
                    pytest.mark.skip("thorough tests, which take long: dev.py test --thorough runs them too")
                )


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
