"""Benchmark of the extension inside Blender: every installed Blender, time until users see something, random operator calls.

python3 tools/dev.py bench blender [--calls 1000] [--seconds 1500] [--json FILE] [--only survey,progress,panels,preview,frames,next,random]

An interrupted run of random calls is resumed if the sources are unchanged (out/random_calls.json).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from harness import Bench
from responsiveness import frames, next_button, panels, preview, progress, ready
from rows import Row, at_most, note, row

ROOT = Path(__file__).resolve().parent.parent
TOOLS = ROOT / "tools"
SESSION, BATCH = 20, 5  # calls per file, files per process: a crash of Blender costs one process


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    calls, seconds = (1000, "random operator calls"), (1500.0, "longest time for the random calls")
    return Bench("blender", arguments, 44, only="*", calls=calls, seconds=seconds).run(PARTS)


# -- every Blender ---------------------------------------------------------------------------------------------------------


def survey(_: argparse.Namespace) -> Iterator[Row]:
    """Try every operator and panel in this Blender, in that of the other Python, and in a real Blender if there is one."""
    yield from _rows_of_survey(_run_survey(sys.executable))
    other = _other_python()
    if other is None:
        yield note("other Blender", "survey", "no other environment")
    else:
        yield from _rows_of_survey(_run_survey(other))
    yield from _real_blender()


def _run_survey(python: str) -> dict[str, Any]:
    """Run the survey three times and return the last answer: the first run compiles bytecode, the second warms the disk cache."""
    for _ in range(3):
        done = subprocess.run(
            [python, str(TOOLS / "blender_survey.py")], capture_output=True, text=True, timeout=300, cwd=ROOT
        )
    return _answer(done.stdout + done.stderr)


def _answer(console: str) -> dict[str, Any]:
    lines = [line for line in console.splitlines() if line.startswith("SURVEY")]
    if not lines:
        return {"blender": "?", "errors": [console[-300:]]}
    found: dict[str, Any] = json.loads(lines[-1].removeprefix("SURVEY"))
    found["complaints"] = len(re.findall(r"Traceback|Warning:.*(?:register|FLEXMAPS)", console))
    return found


def _rows_of_survey(found: dict[str, Any]) -> Iterator[Row]:
    name = f"Blender {found['blender'].split()[0]}"
    for error in found["errors"]:
        print(error, file=sys.stderr)
    yield at_most(name, "errors of operators and panels", 0, len(found["errors"]))
    if "operators" not in found:
        return
    yield note(name, "operators, panels", f"{found['operators']}, {found['panels']}")
    yield at_most(name, "operators without a tooltip", 0, len(found["undescribed"]))
    peer = {"of the processor": found["enable_cpu_s"], "modules": found["modules"]}
    peer["heavy ones"] = " ".join(found["heavy"]) or "none"
    yield at_most(name, "enable, s", 0.3, found["enable_s"], peer)
    yield at_most(name, "heavy modules imported but numpy", 0, len(set(found["heavy"]) - {"numpy"}))
    yield at_most(name, "classes left after disabling", 0, len(found["left"]))


def _other_python() -> str | None:
    named = os.environ.get("FLEXMAPS_OTHER_PYTHON")
    version = "3.13" if sys.version_info[:2] == (3, 11) else "3.11"
    inside = ("Scripts", "python.exe") if os.name == "nt" else ("bin", "python")
    path = Path(named) if named else ROOT.joinpath(f".venv-{version}", *inside)
    return str(path) if path.is_file() else None


def _real_blender() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        reason = ready(work)
        if reason is not None:
            yield note("real Blender", "survey", reason[:60])
            return
        import real_blender

        for _ in range(3):  # the first run installs, the second compiles bytecode
            done = real_blender.run(TOOLS / "blender_survey.py", work, window=False, timeout=240)
    yield from _rows_of_survey(_answer(done.stdout + done.stderr))


# -- random calls ----------------------------------------------------------------------------------------------------------------


def random(options: argparse.Namespace) -> Iterator[Row]:
    """Make random operator calls in separate processes, resuming an interrupted run."""
    kept = ROOT / "out" / "random_calls.json"
    kept.parent.mkdir(exist_ok=True)
    sources = _sources()
    done: dict[str, Any] = json.loads(kept.read_text()) if kept.is_file() else {}
    if done.get("sources") != sources:
        done = {"sources": sources, "batches": {}}
    batches, ends = done["batches"], time.monotonic() + options.seconds
    for batch in range(-(-options.calls // (SESSION * BATCH))):
        if str(batch) not in batches and time.monotonic() < ends:
            batches[str(batch)] = _batch(batch)
            kept.write_text(json.dumps(done))
    outcomes: Counter = Counter()
    for one in batches.values():
        outcomes.update(one["outcomes"])
    faults = [fault for one in batches.values() for fault in one["faults"]]
    print(*faults, sep="\n", file=sys.stderr)
    calls = sum(outcomes.values())
    name, crashed = "random meshes", sum(one["crashed"] for one in batches.values())
    yield row(name, "random calls", f">= {options.calls}", calls, calls >= options.calls, {"": dict(outcomes)})
    yield at_most(name, "crashes of Blender", 0, crashed)
    yield at_most(name, "tracebacks, meshes not valid, panels", 0, len(faults))


BATCH_SCRIPT = """
import json, os, random, sys, tempfile
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import dev
dev.load_package().register()
import random_calls
log = random_calls.Log()
with tempfile.TemporaryDirectory() as folder:
    for seed in range(int(sys.argv[2]), int(sys.argv[3])):
        print("SEED", seed, flush=True)
        random_calls.session(random.Random(seed), int(sys.argv[4]), Path(folder), log)
outcomes = {}
for (_, outcome), count in log.outcomes.items():
    outcomes[outcome] = outcomes.get(outcome, 0) + count
print("BATCH", json.dumps({"outcomes": outcomes, "faults": log.faults, "crashed": 0}), flush=True)
os._exit(0)
"""


def _batch(batch: int) -> dict[str, Any]:
    seeds = batch * BATCH, (batch + 1) * BATCH
    command = [sys.executable, "-c", BATCH_SCRIPT, str(TOOLS), *map(str, seeds), str(SESSION)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=900)
        console, status = done.stdout + done.stderr, str(done.returncode)
    except subprocess.TimeoutExpired as expired:
        console, status = str(expired.stdout), "no answer in 900 s"
    lines = [line for line in console.splitlines() if line.startswith("BATCH")]
    if lines:
        found: dict[str, Any] = json.loads(lines[-1].removeprefix("BATCH"))
        return found
    return {"outcomes": {}, "faults": [f"ended with {status}: {console[-1500:]}"], "crashed": 1}


def _sources() -> str:
    """Return a checksum of the sources on which the calls depend."""
    found = hashlib.sha256(sys.version.encode())
    for folder in ("engine", "bridge", "operators", "panels", "tools/random_calls.py"):
        path = ROOT / folder
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            found.update(file.read_bytes())
    return found.hexdigest()[:16]


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "survey": survey,
    "progress": progress,
    "panels": panels,
    "preview": preview,
    "frames": frames,
    "next": next_button,
    "random": random,
}
