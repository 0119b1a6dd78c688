"""``test`` and ``lint`` of tools/dev.py: ruff, mypy and the tests by tiers; skipped tests are listed at the end."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from heapq import nlargest
from itertools import chain
from pathlib import Path
from threading import Lock
from typing import IO, TypeVar
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent

# in the order of what tells most per second; each in processes of its own, so that a crash of Blender costs one of them
TIERS = {
    "engine": "the numerics, without Blender",
    "tools": "what checks, builds and releases",
    "database": "the offline simulations",
    "blender": "operators and sidebar through Blender as a module",
    "install": "the zip, installed into a fresh Blender",
    "page": "the report's page in a real browser",
    "files": "sheets in the programs that read them, where these are installed",
    "window": "a real Blender with its window",
}
# the longest work first, so that all lanes end together: a tier, and in how many parts its files are dealt out. What
# builds the zip shares a folder and so a line; it waits for windows most of the time, and so begins first
QUEUE = (
    (("window", 1), ("install", 1)),
    (("blender", 2),),
    (("engine", 2),),
    (("page", 1), ("files", 1)),
    (("database", 1), ("tools", 1)),
)
# side by side: one more than cores, for the line of the windows leaves a core idle; the tests of Blender take up to 1 GB each
LANES = min((os.cpu_count() or 1) + 1, 4)
KINDS = ("passed", "failed", "skipped")
SLOWEST = 5  # tests of a tier that are named in the end
NO_TESTS = 5  # pytest's exit status where it found no test, as with -k
THOROUGH = "--thorough"  # option of tests/conftest.py: run slow tests too
# whose types are checked, with tools/
PACKAGES = ("engine", "bridge", "api", "command", "operators", "panels", "database")

Piece = tuple[str, int, int]  # a tier, which part of it, of how many
Found = TypeVar("Found")


@dataclass
class Row:
    """Result of a tier or of a part of it."""

    status: int = 0
    counts: Counter[str] = field(default_factory=Counter)  # passed, failed, skipped
    reasons: Counter[str] = field(default_factory=Counter)  # why tests were skipped, and how many
    seconds: float = 0.0
    each: list[tuple[float, str]] = field(default_factory=list)  # seconds and names of all tests
    failed: list[str] = field(default_factory=list)  # their names
    broken: list[int] = field(default_factory=list)  # exit statuses of processes that ended without telling what failed

    def add(self, other: Row) -> None:
        self.status = self.status or other.status
        self.counts += other.counts
        self.reasons += other.reasons
        self.seconds += other.seconds
        self.each += other.each
        self.failed += other.failed
        self.broken += other.broken


def main(argv: list[str]) -> int:
    """``lint [--fix]``, or ``test [TIER ...] [--thorough] [pytest options]``; the exit status is 0 when nothing failed."""
    command, *rest = argv
    if command == "lint" and "--fix" in rest:
        for fix in (["check", "--fix", "--quiet"], ["format", "--quiet"]):
            subprocess.run([sys.executable, "-m", "ruff", *fix, "."], cwd=ROOT)
    tiers = [name for name in rest if name in TIERS]
    options = [word for word in rest if word not in TIERS]
    if command == "lint":
        failed = _lint()
        print("lint: " + (f"failed ({', '.join(failed)})" if failed else "clean"))
        return 1 if failed else 0
    start = time.monotonic()
    with ThreadPoolExecutor(LANES) as pool:
        # who asks for one tier wants its answer soon
        linted = None if tiers else pool.submit(_logged, _lint)
        rows = _tiers(pool, [tier for tier in tiers or TIERS if (ROOT / "tests" / tier).is_dir()], options)
    return _summary(None if linted is None else linted.result(), rows, time.monotonic() - start)


def _pieces(wanted: list[str], options: list[str]) -> list[list[Piece]]:
    """Return the lists of work to run in parallel, the longest first; the items of one list run in sequence."""
    chosen = any(word != THOROUGH for word in options)  # then few tests run, which are not worth several processes
    lines = [[(tier, 1 if chosen else parts) for tier, parts in line if tier in wanted] for line in QUEUE]
    return [[(tier, k, of) for tier, of in line] for line in lines if line for k in range(max(of for _, of in line))]


def _tiers(pool: Executor, wanted: list[str], options: list[str]) -> dict[str, Row]:
    """Run tiers; what each part of one says is printed when it ends, or at once where it is the only one."""
    pieces = _pieces(wanted, options)
    alone = [len(line) for line in pieces] == [1]

    def work(line: list[Piece]) -> list[tuple[str, Row]]:
        parts = [(tier, partial(_run, tier, part, of, options)) for tier, part, of in line]
        return [(tier, part(None) if alone else _logged(part)) for tier, part in parts]

    rows = {tier: Row() for tier in wanted}
    for tier, row in chain.from_iterable(pool.map(work, pieces)):
        rows[tier].add(row)
    return rows


_PRINTING = Lock()


def _logged(work: Callable[[IO[str]], Found]) -> Found:
    """Run work that writes its output to a file, and print the whole output when it ends."""
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as log:
        found = work(log)
        log.seek(0)
        with _PRINTING:
            print(log.read(), end="", flush=True)
    return found


def _lint(log: IO[str] | None = None) -> list[str]:
    """Check style and types; return the names of failed checks. The output goes into a file if one is given."""
    failed = []
    for name, command in (
        ("ruff check", ["ruff", "check", "."]),
        ("ruff format", ["ruff", "format", "--check", "--quiet", "."]),
    ):
        print(f"== {name}", file=log, flush=True)
        if subprocess.run([sys.executable, "-m", *command], cwd=ROOT, stdout=log, stderr=log).returncode:
            failed.append(name)
    print("== mypy", file=log, flush=True)
    # the checkout is the package: mypy finds it by the name that it is imported by
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "flexmaps").symlink_to(ROOT, target_is_directory=True)
        packages = [word for name in PACKAGES for word in ("-p", f"flexmaps.{name}")]
        tools = ["--explicit-package-bases", *map(str, sorted((ROOT / "tools").rglob("*.py")))]
        config = ["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
        environment = dict(os.environ, MYPYPATH=os.pathsep.join((folder, str(ROOT / "tools"))))
        for what in (packages, tools):
            command = [sys.executable, "-m", "mypy", *config, *what]
            if subprocess.run(command, cwd=folder, env=environment, stdout=log, stderr=log).returncode:
                failed.append("mypy")
    return failed


def _run(tier: str, part: int, of: int, options: list[str], log: IO[str] | None) -> Row:
    """Run every ``of``-th file of a tier from the ``part``-th on, with its output in a file if one is given."""
    which = "" if of == 1 else f", part {part + 1} of {of}"
    print(f"== {tier}: {TIERS[tier]}{which}", file=log, flush=True)
    if log is not None:
        print(f"({tier}{which} begins)", flush=True)
    files = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tests" / tier).rglob("test_*.py"))
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "results.xml"
        where = [f"tests/{tier}"] if of == 1 else files[part::of]
        pytest = [sys.executable, "-m", "pytest", *where, "-q", f"--junit-xml={results}", *options]
        environment = dict(os.environ, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")
        # some containers set it; then each of the many processes that tests start compiles all modules again
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        status = subprocess.run(pytest, cwd=ROOT, env=environment, stdout=log, stderr=log).returncode
        row = _counted(results)
    row.status, row.seconds = 0 if status == NO_TESTS else status, time.monotonic() - start
    if row.status and not row.counts["failed"]:
        row.broken.append(status)
    return row


def _counted(results: Path) -> Row:
    """Read a file of pytest's results; empty if a crash left none."""
    row = Row()
    for case in ElementTree.parse(results).iter("testcase") if results.is_file() else ():
        kinds = {child.tag: child for child in case}
        name = case.get("name", "")
        row.each.append((float(case.get("time", 0.0)), name))
        if "failure" in kinds or "error" in kinds:
            row.counts["failed"] += 1
            row.failed.append(f"{case.get('classname', '')}.{name}")
        elif "skipped" in kinds:
            row.counts["skipped"] += 1
            # a whole file that was skipped has its reason in the text
            text = re.sub(r"[\"\']\)$", "", (kinds["skipped"].text or "").rpartition("Skipped: ")[2])
            message = kinds["skipped"].get("message", "")
            row.reasons[text if message == "collection skipped" else message] += 1
        else:
            row.counts["passed"] += 1
    return row


def _summary(failed: list[str] | None, rows: dict[str, Row], seconds: float) -> int:
    print("== summary")
    print("lint      " + ("not run" if failed is None else f"failed: {', '.join(failed)}" if failed else "clean"))
    whole = Row()
    for tier, row in rows.items():
        whole.add(row)
        text = ", ".join(f"{row.counts[kind]} {kind}" for kind in KINDS if row.counts[kind] or kind == "passed")
        ends = "".join(f"; ended with status {status}" for status in row.broken)
        print(f"{tier:9} {text}, {row.seconds:.0f} s{ends}")
        slowest = [f"{name} {took:.0f} s" for took, name in nlargest(SLOWEST, row.each)]
        if slowest:
            print(f"{'':9} slowest: {', '.join(slowest)}")
        for name in row.failed:
            print(f"{'':9} failed: {name}")
        for reason, count in sorted(row.reasons.items()):
            print(f"{'':9} skipped {count}: {reason}")
    print(f"{', '.join(f'{whole.counts[kind]} {kind}' for kind in KINDS)}, {seconds:.0f} s in all", flush=True)
    return 1 if failed or whole.status else 0
