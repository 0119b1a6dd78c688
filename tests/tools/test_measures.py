"""The house is in order: what ``tools/measures.py`` counts is nothing, and it would notice if it were not."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

FAULTS = (
    "imports upward",
    "circles of imports",
    "files over 400 lines",
    "functions over 60 lines",
    "numbers without a comment",
    "names that stand twice",
    "references to no name",
)


@pytest.fixture(scope="module", autouse=True)
def forget_syntax_trees(measures: ModuleType) -> Iterator[None]:
    """Drop the parsed files in the end: Python's last collections of garbage would look at millions of nodes."""
    yield
    measures.parse.cache_clear()


@pytest.mark.parametrize("name", FAULTS)
def test_the_house_is_in_order(name: str, measures: ModuleType) -> None:
    assert not [str(place) for place in measures.FAULTS[name]()]


def test_all_are_held(measures: ModuleType) -> None:
    assert tuple(measures.FAULTS) == FAULTS


def test_no_more_functions_than_before_leave_their_parameters_undescribed(measures: ModuleType) -> None:
    assert len(measures.undescribed()) <= measures.UNDESCRIBED


@pytest.fixture
def house(tmp_path: Path, measures: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small house in order, for which the tool takes it."""
    monkeypatch.setattr(measures, "ROOT", tmp_path)
    for name, text in {
        "__init__.py": "",
        "api/__init__.py": "from ..engine import files\n",
        "engine/__init__.py": "",
        "engine/files.py": "LARGEST = 3  # so many\n",
        "engine/surface/__init__.py": "",
        "engine/surface/mesh.py": "from .. import files\n# so many\nSMALLEST = 0.5\nFIRST = [name for name in 'ab'][0]\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_house_in_order(house: Path, measures: ModuleType) -> None:
    assert {name: measure() for name, measure in measures.FAULTS.items()} == {key: [] for key in FAULTS}


@pytest.mark.parametrize(
    ("name", "file", "text", "places"),
    [
        ("imports upward", "engine/materials.py", "from .surface import mesh\n", ["engine/materials.py:1"]),
        ("imports upward", "engine/surface/check.py", "def f():\n    from ...api import load\n", ["engine/surface/check.py:2"]),
        ("imports upward", "engine/attic/lost.py", "", ["engine/attic/lost.py:1"]),
        ("circles of imports", "engine/files.py", "from .surface.mesh import x\n", ["engine/files.py:1", "engine/surface/mesh.py:1"]),
        ("files over 400 lines", "tools/long.py", "\n" * 401, ["tools/long.py:401"]),
        ("functions over 60 lines", "tests/long.py", "def f():\n" + "    f()\n" * 60, ["tests/long.py:1"]),
        ("numbers without a comment", "engine/numbers.py", "A = 1\n\nB, C = (2, 3.5)\n", ["engine/numbers.py:1", "engine/numbers.py:3"]),
        ("names that stand twice", "engine/surface/files.py", "", ["engine/files.py:1", "engine/surface/files.py:1"]),
        ("names that stand twice", "engine/check/surface.py", "", ["engine/check/surface.py:1"]),
        ("names that stand twice", "api/pieces.py", "class A: ...\n\nclass A: ...\n", ["api/pieces.py:1", "api/pieces.py:3"]),
        ("names that stand twice", "api/pieces.py", "def f():\n    def of(): ...\n", ["api/pieces.py:2"]),
        ("references to no name", "engine/lost.py", "\"\"\"See ``files.LARGEST`` and ``files.gone``.\"\"\"\n", ["engine/lost.py:1"]),
        ("references to no name", "docs/tuning.md", "`LARGEST`, `files.py`\n\n`files.GONE`, `Lost.f`\n", ["docs/tuning.md:3", "docs/tuning.md:3"]),
        ("references to no name", "CONTRIBUTING.md", "`GONE`, as in GONE\n", ["CONTRIBUTING.md:1"]),
    ],
)  # fmt: skip
def test_what_is_out_of_order_is_named(
    name: str, file: str, text: str, places: list[str], house: Path, measures: ModuleType
) -> None:
    (house / file).parent.mkdir(parents=True, exist_ok=True)
    (house / file).write_text(text)
    found = [f"{place.path}:{place.line}" for place in measures.FAULTS[name]()]
    assert set(places) <= set(found)
    assert len(found) <= len(places) + 1  # what stands on a circle is named with it


DESCRIBED = '"""Do it.\n\n    Parameters\n    ----------\n    a, b : numbers\n    """'


@pytest.mark.parametrize(
    ("text", "users", "found"),
    [
        ('def f(a, b):\n    """Do it."""\n', "from .surface.mesh import f\n", ["f"]),
        ('def f(a, *, b):\n    """Do it."""\n', "from .surface import mesh\nmesh.f(1, b=2)\n", ["f"]),
        ('class C:\n    def f(self, a, b):\n        """Do it."""\n', "from .surface.mesh import C\n", ["C.f"]),
        ('def f(a, b):\n    """Do it."""\n', "from .surface import mesh\n", []),
        ('def f(a):\n    """Do it."""\n', "from .surface.mesh import f\n", []),
        ('class C:\n    def f(self, a):\n        """Do it."""\n', "from .surface.mesh import C\n", []),
        (f"def f(a, b):\n    {DESCRIBED}\n", "from .surface.mesh import f\n", []),
    ],
)
def test_functions_of_other_folders_describe_their_parameters(
    text: str, users: str, found: list[str], house: Path, measures: ModuleType
) -> None:
    (house / "engine" / "surface" / "mesh.py").write_text(text)
    (house / "engine" / "materials.py").write_text(users)
    assert [place.what for place in measures.undescribed()] == found


def test_the_glossary_names_classes_that_there_are(root: Path, measures: ModuleType) -> None:
    rows = [line.split("|")[1:-1] for line in (root / "docs" / "glossary.md").read_text("utf-8").splitlines()[8:]]
    assert all(len(row) == 4 for row in rows)
    words = [row[0].strip().lower() for row in rows]
    assert words == sorted(set(words))
    named = {name for row in rows for name in re.findall(r"`(?:[\w/]+[.:] ?)*([A-Z]\w*[a-z]\w*)`", row[3])}
    classes = {
        node.name
        for path in measures.package()
        for node in ast.walk(measures.parse(path))
        if isinstance(node, ast.ClassDef)
    }
    assert named - classes == set()
