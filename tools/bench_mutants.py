"""Mutation testing: change one random place in the engine's sources at a time, and see whether the nearest quick tests fail.

Tests of the module's own name run first, then those of its folder and those that import the module, until one fails: the mutant is caught.
A mutant whose answer is in FILE does not run again while its line of source is unchanged. The bench works on a copy of the checkout.
"""

from __future__ import annotations

import ast
import copy
import random
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import accumulate
from pathlib import Path

from harness import ONE_THREAD, ROOT, Bench, Cases, Options, Row, Rows, StoredResults, at_least, note, run_python

WANTED = 0.85  # share of the mutants that must be caught
LONGEST = 600  # seconds for the tests of one mutant; one that never ends is caught too
COPY = tempfile.TemporaryDirectory()  # of the checkout, until the bench ends
PAIRS = {ast.Lt: ast.GtE, ast.Gt: ast.LtE, ast.Eq: ast.NotEq, ast.Add: ast.Sub, ast.Mult: ast.Div, ast.And: ast.Or}
SWAPPED: dict[type, type] = PAIRS | {after: before for before, after in PAIRS.items()}  # type: ignore[assignment]
NAMES = {"min": "max", "any": "all", "minimum": "maximum", "argmin": "argmax", "sum": "mean", "floor": "ceil"}
NAMES |= {after: before for before, after in NAMES.items()}


def variants(node: ast.AST) -> Iterator[ast.AST]:
    """Return what an expression may become: another operator, number, function, without a factor or a keyword argument."""
    new = copy.deepcopy(node)
    if isinstance(new, ast.Compare) and type(new.ops[0]) in SWAPPED:
        new.ops[0] = SWAPPED[type(new.ops[0])]()
        yield new
    elif isinstance(new, ast.BoolOp | ast.BinOp) and type(new.op) in SWAPPED:
        new.op = SWAPPED[type(new.op)]()
        yield new
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Add):
            yield node.left
    elif isinstance(new, ast.UnaryOp) and isinstance(new.op, ast.Not | ast.USub):
        yield new.operand
    elif isinstance(new, ast.Constant) and isinstance(new.value, bool | int | float):
        yield ast.Constant(not new.value if isinstance(new.value, bool) else 2 * new.value or 1)
    elif isinstance(new, ast.IfExp):
        yield new.body
    elif isinstance(node, ast.Call) and isinstance(new, ast.Call):
        field = "id" if isinstance(new.func, ast.Name) else "attr"
        other = NAMES.get(getattr(new.func, field, ""))
        if other is not None:
            setattr(new.func, field, other)
            yield new
        if new.keywords:
            yield ast.Call(node.func, node.args, node.keywords[:-1])


def places(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions below a node; annotations, defaults, assertions and the texts of errors are left out."""
    for child in ast.iter_child_nodes(node):
        if child is not getattr(node, "annotation", None):
            if isinstance(child, ast.expr):
                yield child
            if not isinstance(child, ast.arguments | ast.Raise | ast.JoinedStr | ast.Assert):
                yield from places(child)


def mutants(path: Path) -> Iterator[tuple[str, str]]:
    """Yield (label, whole changed source) for every change of a function of a file."""
    source = path.read_bytes()
    starts = [0, *accumulate(map(len, source.splitlines(keepends=True)))]
    whole = ast.parse(source).body
    scopes = whole + [child for node in whole if isinstance(node, ast.ClassDef) for child in node.body]
    for statement in [line for scope in scopes if isinstance(scope, ast.FunctionDef) for line in scope.body]:
        for place in places(statement):
            begin = starts[place.lineno - 1] + place.col_offset
            end = starts[(place.end_lineno or 0) - 1] + (place.end_col_offset or 0)
            before = " ".join(source[begin:end].decode().split())
            for text in map(ast.unparse, variants(place)):
                label = f"{path.relative_to(ROOT).as_posix()}:{place.lineno}: {before} -> {text}"
                yield label, (source[:begin] + f"({text})".encode() + source[end:]).decode()


def nearest(path: Path) -> list[list[str]]:
    """Return the test files of the module's own name, then the others of its room and those that import it."""
    tests, room, name = ROOT / "tests" / "engine", path.parent.relative_to(ROOT / "engine"), path.stem
    own = [*tests.rglob(f"test_{name}.py"), *(tests / room).glob(f"test_{name}_*.py")]
    parent = ".".join(("flexmaps.engine", *room.parts)).replace(".", r"\.")
    imported = re.compile(rf"^from {parent}(\.{name} import| import .*\b{name}\b)", re.MULTILINE)
    others = [test for test in sorted(tests.rglob("test_*.py")) if test not in own]
    near = [test for test in others if test.parent == tests / room or imported.search(test.read_text(encoding="utf-8"))]
    return [[str(test.relative_to(ROOT)) for test in files] for files in (own, near) if files]


def cases(options: Options) -> Cases:
    """Return as many mutants as are asked for, drawn at random; a copy of the checkout is changed for each."""
    sources = sorted((ROOT / "engine").glob(options.only))
    found = {label: (path, text) for path in sources for label, text in mutants(path)}
    labels = sorted(label for label in found if label.startswith(options.at))
    chosen = random.Random(options.seed).sample(labels, min(options.count, len(labels)))
    copied, known = Path(COPY.name) / "checkout", StoredResults(options.file)
    shutil.copytree(ROOT, copied, ignore=shutil.ignore_patterns(".*", "out", "dist", "build", "__pycache__"))
    return {label: partial(known.answer, label, partial(judge, copied, *found[label])) for label in chosen}


def measure(label: str, answer: str, _: Options) -> Rows:
    return [note("engine", label, answer)]


def judge(copied: Path, path: Path, text: str) -> str:
    """Return whether tests catch a changed source, or that it lives."""
    target, environment = copied / path.relative_to(ROOT), ONE_THREAD | {"PYTHONDONTWRITEBYTECODE": "1"}
    before = target.read_bytes()
    target.write_text(text, encoding="utf-8")
    try:
        for files in nearest(path):
            words = ("-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *files)
            if run_python(*words, cwd=copied, env=environment, timeout=LONGEST).returncode:
                return "caught"
    except subprocess.TimeoutExpired:
        return "never ends"
    finally:
        target.write_bytes(before)
    return "lives"


def sum_up(rows: list[Row], _: Options) -> Rows:
    """Return how many there are of each answer, and the share that is caught."""
    answers = [one["measured"] for one in rows]
    counts = {answer: answers.count(answer) for answer in sorted(set(answers))}
    return [at_least("all", "share caught", WANTED, 1.0 - counts.get("lives", 0) / max(len(answers), 1), counts)]


main = Bench(
    "mutants", cases, measure, patterns=None, summary=sum_up, count=(200, "mutants"), seed=(0, "another number takes others"),
    at=("", "only changes whose label begins so"), file=(ROOT / "out" / "mutants.json", "the answers, old and new"),
    only=("**/*.py", "files below engine/"),
)  # fmt: skip
