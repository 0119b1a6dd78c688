"""``test`` and ``lint`` of tools/dev.py: ruff, mypy and the tests, tier by tier; what was left out is said at the end."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent

# in the order of what tells most per second; each in a process of its own, so that a crash of Blender costs one tier
TIERS = {
    "engine": "the numerics, without Blender",
    "database": "the offline simulations",
    "blender": "operators and sidebar through Blender as a module",
    "install": "the zip, installed into a fresh Blender",
    "page": "the report's page in a real browser",
    "window": "a real Blender with its window",
}
LONGEST = "blender"
# whose types are checked, with tools/
PACKAGES = ("engine", "bridge", "api", "command", "operators", "panels", "database")


def main(argv: list[str]) -> int:
    """``lint [--fix]``, or ``test [TIER ...] [pytest options]``; the exit status is 0 when nothing failed."""
    command, *rest = argv
    if command == "lint" and "--fix" in rest:
        for fix in (["check", "--fix", "--quiet"], ["format", "--quiet"]):
            subprocess.run([sys.executable, "-m", "ruff", *fix, "."], cwd=ROOT)
    tiers = [name for name in rest if name in TIERS]
    options = [word for word in rest if word not in TIERS]
    failed = None if tiers else _lint()  # who asks for one tier wants its answer soon
    if command == "lint":
        failed = failed or []
        print("lint: " + (f"failed ({', '.join(failed)})" if failed else "clean"))
        return 1 if failed else 0
    wanted = [tier for tier in tiers or TIERS if (ROOT / "tests" / tier).is_dir()]
    with ThreadPoolExecutor(1) as pool, tempfile.TemporaryFile("w+") as log:
        # the longest runs beside those before it, which leave a core idle
        beside = pool.submit(_run, LONGEST, options, log) if LONGEST in wanted[1:] else None
        rows = []
        for tier in wanted:
            if tier == LONGEST and beside is not None:
                rows.append(beside.result())
                log.seek(0)
                print(log.read(), end="", flush=True)
            else:
                rows.append(_run(tier, options))
    return _summary(failed, rows)


def _lint() -> list[str]:
    """Style and types; returns the names of what failed."""
    failed = []
    for name, command in (
        ("ruff check", ["ruff", "check", "."]),
        ("ruff format", ["ruff", "format", "--check", "--quiet", "."]),
    ):
        print(f"== {name}", flush=True)
        if subprocess.run([sys.executable, "-m", *command], cwd=ROOT).returncode:
            failed.append(name)
    print("== mypy", flush=True)
    # the checkout is the package: mypy finds it by the name that it is imported by
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "flexmaps").symlink_to(ROOT, target_is_directory=True)
        packages = [word for name in PACKAGES for word in ("-p", f"flexmaps.{name}")]
        tools = ["--explicit-package-bases", *map(str, sorted((ROOT / "tools").rglob("*.py")))]
        config = ["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
        environment = dict(os.environ, MYPYPATH=os.pathsep.join((folder, str(ROOT / "tools"))))
        for what in (packages, tools):
            if subprocess.run([sys.executable, "-m", "mypy", *config, *what], cwd=folder, env=environment).returncode:
                failed.append("mypy")
    return failed


def _run(
    tier: str, options: list[str], log: IO[str] | None = None
) -> tuple[str, int, dict[str, int], list[str], float]:
    """One tier, its output into a file if there is one: its name, exit status, counts, reasons of skipped tests, seconds."""
    print(f"== {tier}: {TIERS[tier]}", file=log, flush=True)
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "results.xml"
        pytest = [sys.executable, "-m", "pytest", f"tests/{tier}", "-q", f"--junit-xml={results}", *options]
        environment = dict(os.environ, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")
        status = subprocess.run(pytest, cwd=ROOT, env=environment, stdout=log, stderr=log).returncode
        counts, reasons = _counts(results)
    return tier, status, counts, reasons, time.monotonic() - start


def _counts(results: Path) -> tuple[dict[str, int], list[str]]:
    counts, reasons = dict.fromkeys(("passed", "failed", "skipped"), 0), set()
    if not results.is_file():
        return counts, []
    for case in ElementTree.parse(results).iter("testcase"):
        kinds = {child.tag: child for child in case}
        if "failure" in kinds or "error" in kinds:
            counts["failed"] += 1
        elif "skipped" in kinds:
            counts["skipped"] += 1
            # a whole file that was skipped has its reason in the text
            text = re.sub(r"[\"']\)$", "", (kinds["skipped"].text or "").rpartition("Skipped: ")[2])
            message = kinds["skipped"].get("message", "")
            reasons.add(text if message == "collection skipped" else message)
        else:
            counts["passed"] += 1
    return counts, sorted(reasons)


def _summary(failed: list[str] | None, rows: list[tuple[str, int, dict[str, int], list[str], float]]) -> int:
    print("== summary")
    print("lint      " + ("not run" if failed is None else f"failed: {', '.join(failed)}" if failed else "clean"))
    bad = bool(failed)
    for tier, status, counts, reasons, seconds in rows:
        # 5: pytest found no test, as with -k; a crash leaves no results
        broken = status not in (0, 5) and not counts["failed"]
        bad |= status not in (0, 5)
        text = ", ".join(f"{n} {kind}" for kind, n in counts.items() if n or kind == "passed")
        print(f"{tier:9} {text}, {seconds:.0f} s" + (f"; ended with status {status}" if broken else ""))
        for reason in reasons:
            print(f"{'':9} skipped: {reason}")
    totals = {kind: sum(row[2][kind] for row in rows) for kind in ("passed", "failed", "skipped")}
    print(f"{totals['passed']} passed, {totals['failed']} failed, {totals['skipped']} skipped", flush=True)
    return 1 if bad else 0
