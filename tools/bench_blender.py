"""Benchmark of the extension inside Blender: time until users see something, random operator calls.

An interrupted run of random calls is resumed if the sources are unchanged (out/random_calls.json).
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

from harness import ROOT, Bench, Options, Rows, StoredResults, at_least, at_most, checksum, run_python
from responsiveness import frames, next_button, panels, preview

SESSION, BATCH = 20, 5  # calls per file, files per process: a crash of Blender costs one process
LONGEST = 900  # seconds of a batch


def random(options: Options) -> Rows:
    """Make random operator calls in separate processes, resuming an interrupted run."""
    sources = checksum("engine", "bridge", "operators", "panels", "tools/random_calls.py")
    known, ends = StoredResults(ROOT / "out" / "random_calls.json"), time.monotonic() + options.seconds
    batches = []
    for batch in range(-(-options.calls // (SESSION * BATCH))):
        key = f"{sources} {batch}"
        if key in known or time.monotonic() < ends:
            batches.append(known.answer(key, partial(_batch, batch)))
    outcomes = Counter[str]()
    for outcome, count in (pair for one in batches for pair in one["outcomes"]):
        outcomes[outcome] += count
    faults = [fault for one in batches for fault in one["faults"]]
    print(*faults, sep="\n", file=sys.stderr)
    name = "random meshes"
    yield at_least(name, "random calls", options.calls, sum(outcomes.values()), {"": dict(outcomes)})
    yield at_most(name, "crashes of Blender", 0, sum(one["crashed"] for one in batches))
    yield at_most(name, "tracebacks, meshes not valid, panels", 0, len(faults))


BATCH_SCRIPT = """
import json, os, pathlib, random, sys, tempfile
sys.path.insert(0, sys.argv[1])
import dev
dev.load_package().register()
import random_calls
log = random_calls.Log()
with tempfile.TemporaryDirectory() as folder:
    for seed in range(int(sys.argv[2]), int(sys.argv[3])):
        print("SEED", seed, flush=True)
        random_calls.session(random.Random(seed), int(sys.argv[4]), pathlib.Path(folder), log)
outcomes = [(outcome, count) for (_, outcome), count in log.outcomes.items()]
print("BATCH", json.dumps({"outcomes": outcomes, "faults": log.faults, "crashed": 0}), flush=True)
os._exit(0)
"""


def _batch(batch: int) -> dict[str, Any]:
    """Return the outcomes and faults of some sessions in a process of their own."""
    words = ("-c", BATCH_SCRIPT, ROOT / "tools", batch * BATCH, (batch + 1) * BATCH, SESSION)
    try:
        done: Any = run_python(*words, timeout=LONGEST)
        status = str(done.returncode)
    except subprocess.TimeoutExpired as expired:
        done, status = expired, f"no answer in {LONGEST} s"
    console = f"{done.stdout}{done.stderr}"
    lines = [line for line in console.splitlines() if line.startswith("BATCH")]
    if lines:
        return dict(json.loads(lines[-1].removeprefix("BATCH")))
    return {"outcomes": [], "faults": [f"ended with {status}: {console[-1500:]}"], "crashed": 1}


PARTS: dict[str, Callable[[Options], Rows]] = {
    "panels": panels,
    "preview": preview,
    "frames": frames,
    "next": next_button,
    "random": random,
}
main = Bench(
    "blender", PARTS,
    calls=(1000, "random operator calls"), seconds=(1500.0, "longest time for the random calls"),
)  # fmt: skip
