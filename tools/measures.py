"""``measures`` of tools/dev.py: code metrics: upward imports, lengths of files and functions, constants without a comment, names.

``tests/tools/test_measures.py`` requires that it finds none.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent

# the folders of the package, each importing only from itself and from those before it
ROOMS = (
    "engine",
    "engine/extras",  # the registry; the folders below it come after the road
    "engine/params",
    "engine/surface",
    "engine/surface/checking",
    "engine/surface/formats",
    "engine/surface/quadrangulation",
    "engine/surface/remeshing",
    "engine/patches",
    "engine/patches/flattening",
    "engine/patches/tracing",
    "engine/patches/splitting",
    "engine/patches/merging",
    "engine/spirals/curves",
    "engine/spirals/clearance",
    "engine/spirals",
    "engine/mechanics",
    "engine/mechanics/arms",
    "engine/mechanics/clearance",
    "engine/mechanics/rods",
    "engine/simulation",
    "engine/optimisation",
    "engine/optimisation/goals",
    "engine/fabrication/panels",
    "engine/fabrication/connectors",
    "engine/fabrication/nesting",
    "engine/fabrication/standing",
    "engine/fabrication",
    "engine/fabrication/writers",
    "engine/display",
    "engine/runs",
    "engine/extras/choosing",
    "engine/extras/scanning",
    "engine/extras/structure",
    "engine/extras/film",
    "engine/extras/assembly_sheet",
    "engine/extras/calibrating",
    "engine/extras/exploring",
    "engine/extras/live",
    "engine/extras/together",
    "bridge",
    "bridge/store",
    "bridge/view",
    "bridge/hosts",
    "api",
    "command",
    "operators",
    "panels",
    "",  # __init__.py, which Blender registers
)
DATABASE = "database"  # makes data/ offline, from the engine alone
BESIDE = ("tools", "tests", "examples", "presets")  # not in the package; long files and functions count there too
FILE, FUNCTION = 400, 60  # most lines
UNDESCRIBED = 0  # largest number of functions that ``undescribed`` may find


class Place(NamedTuple):
    """Place and description of a finding."""

    path: str
    line: int
    what: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.what}"


def sources(*folders: str) -> list[Path]:
    """The Python files below folders of the checkout, sorted."""
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def package() -> list[Path]:
    """The Python files that Blender gets."""
    tops = {room.split("/")[0] for room in ROOMS} - {""}
    return [ROOT / "__init__.py", *sources(*sorted(tops))]


@cache
def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def dotted(path: Path) -> tuple[str, ...]:
    """A file as the parts of its module's name below the package; a package's own file is the package."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


def room_of(path: Path) -> str:
    """The folder of the package that a file is in."""
    return path.parent.relative_to(ROOT).as_posix().removeprefix(".")


@cache
def statements(path: Path) -> tuple[ast.Import | ast.ImportFrom | ast.FunctionDef | ast.AsyncFunctionDef, ...]:
    """All imports and functions of a file, at any depth: no expression holds one."""
    found, left = [], list[ast.AST]([parse(path)])
    while left:
        for node in ast.iter_child_nodes(left.pop()):
            if isinstance(node, ast.Import | ast.ImportFrom | ast.FunctionDef | ast.AsyncFunctionDef):
                found.append(node)
            if not isinstance(node, ast.expr):
                left.append(node)
    return tuple(sorted(found, key=lambda node: node.lineno))


def imports(path: Path) -> Iterator[tuple[int, int, str]]:
    """(line, level, dotted name) of everything that a file imports, also inside functions and for types."""
    for node in statements(path):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, 0, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield node.lineno, node.level, f"{node.module or ''}.{alias.name}".strip(".")


def within(path: Path, known: dict[tuple[str, ...], Path]) -> Iterator[tuple[int, Path]]:
    """(line, file) of what a file imports of the package: the modules, and the packages where no module is named."""
    own = path.relative_to(ROOT).with_suffix("").parts
    for line, level, name in imports(path):
        if level:
            full = (*own[:-level], *filter(None, name.split(".")))
        elif name.split(".")[0] == "flexmaps":
            full = tuple(name.split(".")[1:])
        else:
            continue
        while full and full not in known:
            full = full[:-1]
        yield line, known[full]


def upward() -> list[Place]:
    """Return imports that go upward: from a folder that comes later in ``ROOMS``."""
    files = [*package(), *sources(DATABASE)]
    known = {dotted(path): path for path in files}
    order = {name: k for k, name in enumerate((*ROOMS, DATABASE))}
    found = [
        Place(str(p.relative_to(ROOT)), 1, "a folder that is not in the list") for p in files if _room(p) not in order
    ]
    for path in files:
        for line, other in within(path, known):
            if other == ROOT / "__init__.py" or order.get(_room(other), 0) > order.get(_room(path), 0):
                found.append(Place(str(path.relative_to(ROOT)), line, f"imports upward: {other.relative_to(ROOT)}"))
            elif _room(path) == DATABASE and not _room(other).startswith(("engine", DATABASE)):
                found.append(
                    Place(str(path.relative_to(ROOT)), line, f"the engine alone, not {other.relative_to(ROOT)}")
                )
    return found


def _room(path: Path) -> str:
    return DATABASE if path.is_relative_to(ROOT / DATABASE) else room_of(path)


def circles() -> list[Place]:
    """Modules that import each other, directly or through others, and those above one that does."""
    files = [*package(), *sources(DATABASE)]
    known = {dotted(path): path for path in files}
    # a package's own file holds its docstring or registers what is below it: as a step on the way it says nothing
    left = {path: {other for _, other in within(path, known) if other.name != "__init__.py"} - {path} for path in files}
    while ready := [path for path, needs in left.items() if not needs & left.keys()]:
        for path in ready:
            del left[path]
    return [Place(str(path.relative_to(ROOT)), 1, "in a circle of imports, or above one") for path in left]


def long_files() -> list[Place]:
    found = []
    for path in [*package(), *sources(DATABASE, *BESIDE)]:
        name, lines = path.relative_to(ROOT).as_posix(), _lines(path)
        if lines > FILE:
            found.append(Place(name, lines, f"{lines} lines"))
    return found


def long_functions() -> list[Place]:
    found = []
    for path in [*package(), *sources(DATABASE, *BESIDE)]:
        for node in statements(path):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > FUNCTION:
                    found.append(Place(path.relative_to(ROOT).as_posix(), node.lineno, f"{node.name}: {lines} lines"))
    return found


def bare_numbers() -> list[Place]:
    """Numbers given a name at a module's top without a comment on the same lines or on the one above."""
    found = []
    for path in [*package(), *sources(DATABASE, "tools")]:
        text = path.read_text(encoding="utf-8").splitlines()
        for node in parse(path).body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None or not _numeric(node.value):
                continue
            own = text[node.lineno - 1 : node.end_lineno]
            above = text[node.lineno - 2].lstrip() if node.lineno > 1 else ""
            if not above.startswith("#") and not any("#" in line for line in own):
                found.append(Place(path.relative_to(ROOT).as_posix(), node.lineno, own[0].strip()))
    return found


def undescribed() -> list[Place]:
    """Return public functions that other folders import, with two or more parameters and no section *Parameters*.

    Methods count where another folder imports their class; those without a docstring have that of the method they override.
    """
    files = package()
    known = {dotted(path): path for path in files}
    foreign = {
        (other, name) for path in files for other, name in _names_used(path, known) if room_of(other) != room_of(path)
    }
    found = []
    for path in files:
        for node in parse(path).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and (path, node.name) in foreign:
                own = 0 if isinstance(node, ast.FunctionDef) else 1  # self or cls
                for function in [node] if isinstance(node, ast.FunctionDef) else node.body:
                    if isinstance(function, ast.FunctionDef) and _lacks_parameters(function, own):
                        name = function.name if function is node else f"{node.name}.{function.name}"
                        found.append(Place(path.relative_to(ROOT).as_posix(), function.lineno, name))
    return found


def _names_used(path: Path, known: dict[tuple[str, ...], Path]) -> Iterator[tuple[Path, str]]:
    """Yield (file, name) of what a file uses of other modules of the package, imported by name or with its module."""
    own = path.relative_to(ROOT).with_suffix("").parts
    modules = {}
    for node in statements(path):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = (*own[: -node.level], *filter(None, (node.module or "").split(".")))
            for alias in node.names:
                if (*base, alias.name) in known:
                    modules[alias.asname or alias.name] = known[*base, alias.name]
                elif base in known:
                    yield known[base], alias.name
    for use in ast.walk(parse(path)):
        if isinstance(use, ast.Attribute) and isinstance(use.value, ast.Name) and use.value.id in modules:
            yield modules[use.value.id], use.attr


def _lacks_parameters(function: ast.FunctionDef, own: int) -> bool:
    """Return whether a public function has two or more parameters, apart from its ``own`` first ones, and does not describe them."""
    given = function.args
    static = any(isinstance(d, ast.Name) and d.id == "staticmethod" for d in function.decorator_list)
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    text = ast.get_docstring(function)
    if function.name.startswith("_") or len(every) - (0 if static else own) < 2 or (own and text is None):
        return False
    return text is None or "Parameters\n---" not in text


def names_twice() -> list[Place]:
    """Return classes of one name in the package, modules of ``engine`` with the name of another module or folder, functions ``of``.

    Folders may share a name: clearances of flat and of bent arms are in folders of their rooms.
    """
    places: dict[str, list[Place]] = {}
    modules = [path for path in sources("engine") if path.name != "__init__.py"]
    folders = {path.parent.name for path in sources("engine") if path.name == "__init__.py"}
    for path in modules:
        places.setdefault(path.stem, []).append(Place(path.relative_to(ROOT).as_posix(), 1, f"module {path.stem}"))
    found = [place for name, some in places.items() if len(some) > 1 or name in folders for place in some]
    classes: dict[str, list[Place]] = {}
    for path in package():
        file = path.relative_to(ROOT).as_posix()
        found += [
            Place(file, node.lineno, "function of")
            for node in statements(path)
            if isinstance(node, ast.FunctionDef) and node.name == "of"
        ]
        for node in ast.walk(parse(path)):
            if isinstance(node, ast.ClassDef):
                classes.setdefault(node.name, []).append(Place(file, node.lineno, f"class {node.name}"))
    return found + [place for some in classes.values() if len(some) > 1 for place in some]


REFERENCE = re.compile(r"``([A-Za-z_][\w.]*)``")  # names that a docstring refers to
# names of code that a page refers to: of constants, and of what a module or class holds, but of no file
PAGE_REFERENCE = re.compile(r"`((?:[A-Za-z_]\w*\.)?[A-Z][A-Z_]+|[A-Z]\w+\.[a-z]\w+)`")
WORD = re.compile(r"[A-Za-z_]\w*")


def dangling() -> list[Place]:
    """Return names in backquotes in docstrings and pages, a part of which is neither a name in the code nor in a string there."""
    files = [*package(), *sources(DATABASE)]
    texts = [(path, node, text) for path in files for node, text in _docstrings(path)]
    known = set(sys.stdlib_module_names) | {part for path in [*files, *sources(*BESIDE)] for part in dotted(path)}
    for path in [*files, *sources(*BESIDE)]:
        own = {id(node) for node, _ in _docstrings(path)}
        for node in ast.walk(parse(path)):
            if id(node) not in own:
                known.update(_words(node))
    references = [(path, node.lineno, name) for path, node, text in texts for name in REFERENCE.findall(text)]
    for page in sorted([*ROOT.glob("CONTRIBUTING.md"), *(ROOT / "docs").glob("*.md")]):
        if page.name == "guide.md":  # for users: names in files, not in the code
            continue
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
            references += [(page, number, name) for name in PAGE_REFERENCE.findall(line)]
    return [
        Place(path.relative_to(ROOT).as_posix(), number, f"no {name}")
        for path, number, name in references
        if not set(WORD.findall(name)) <= known
    ]


def _docstrings(path: Path) -> Iterator[tuple[ast.Constant, str]]:
    """Yield the docstrings of a file with their nodes."""
    for node in ast.walk(parse(path)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and node.body:
            first = node.body[0]
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                yield first.value, first.value.value


def _words(node: ast.AST) -> Iterator[str]:
    """Yield the names that a node of the syntax tree holds itself, and the words of a text."""
    for _, value in ast.iter_fields(node):
        if isinstance(value, str):
            yield from WORD.findall(value)
        elif isinstance(value, list):
            yield from (one for one in value if isinstance(one, str))


def _numeric(value: ast.AST) -> bool:
    """Return whether an expression contains a number, apart from list indices."""
    if isinstance(value, ast.Subscript):
        return _numeric(value.value)
    if isinstance(value, ast.Constant):
        return type(value.value) in (int, float)
    return any(map(_numeric, ast.iter_child_nodes(value)))


def _lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


FAULTS = {
    "imports upward": upward,
    "circles of imports": circles,
    f"files over {FILE} lines": long_files,
    f"functions over {FUNCTION} lines": long_functions,
    "numbers without a comment": bare_numbers,
    "names that stand twice": names_twice,
    "references to no name": dangling,
}


def main(argv: list[str]) -> int:
    """Print the measures, and where they are not kept; the exit status is 0 when all are."""
    parser = argparse.ArgumentParser(prog="measures", description="Whether the house is in order.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    args = parser.parse_args(argv)
    figures: dict[str, int] = {}
    for name, measure in FAULTS.items():
        places = measure()
        figures[name] = len(places)
        print(f"{name:28} {len(places)}")
        print("".join(f"    {place}\n" for place in places), end="")
    lacking = undescribed()
    figures["functions without parameters"] = len(lacking)
    print(f"{'functions without parameters':28} {len(lacking)} of {UNDESCRIBED} at most")
    print("".join(f"    {place}\n" for place in lacking if len(lacking) > UNDESCRIBED), end="")
    figures["files of the package"], figures["lines of the package"] = len(package()), sum(map(_lines, package()))
    for name in ("files of the package", "lines of the package"):
        print(f"{name:28} {figures[name]}")
    if args.json:
        args.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 1 if len(lacking) > UNDESCRIBED or any(figures[name] for name in FAULTS) else 0
