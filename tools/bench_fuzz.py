"""Fuzzing with damaged input: ``bench fuzz readers|meshes|settings|stored [--count N] [--first N] [--whole K] [--one N]``.

Every case is generated from its number, so ``--one N`` repeats it. A case may raise only ``FlexMapsError``, and must end within
``SECONDS`` of processor time.
"""

from __future__ import annotations

import collections
import importlib
import traceback
from functools import partial

from harness import Bench, Options, Rows, at_most, measure_time

SECONDS = 5.0  # largest processor time of a case
# default number of cases of each kind
COUNTS = {"readers": 20_000, "meshes": 1000, "settings": 20_000, "stored": 600}
FAULTS = "faults and slow cases"  # name of the rows


def measure(what: str, options: Options) -> Rows:
    """Play the cases of a kind, and name the first case of every fault and every slow case."""
    fuzzer = importlib.import_module(f"fuzz_{what}")
    if options.one >= 0:
        print(fuzzer.described(options.one))
        print(fuzzer.play(options.one, True))
        return
    outcomes, faults = collections.Counter[str](), collections.Counter[str]()
    for number in range(options.first, options.first + (options.count or COUNTS[what])):
        whole = bool(options.whole) and number % options.whole == 0
        seconds, text = measure_time(partial(_outcome, fuzzer, number, whole))
        text = text if seconds <= SECONDS else f"fault: {seconds:.1f} s"
        outcomes[text.partition(":")[0]] += 1
        if text.startswith("fault: "):
            faults[text] += 1
            if faults[text] == 1:
                print(f"  --one {number}: {text}", flush=True)
    yield at_most(what, FAULTS, 0, sum(faults.values()), {"kinds": len(faults), **outcomes})


def _outcome(fuzzer: object, number: int, whole: bool) -> str:
    """Return what came of a case; every exception is a fault, named by the last line of the program."""
    try:
        return str(fuzzer.play(number, whole))  # type: ignore[attr-defined]
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        where = next((f for f in reversed(frames) if "site-packages" not in f.filename), frames[-1])
        place = f"{where.filename.rpartition('/')[2]}:{where.lineno}"
        return f"fault: {type(error).__name__} in {place}: {str(error)[:120]}"


bench = Bench(
    "fuzz", {what: partial(measure, what) for what in COUNTS}, patterns="readers", must=FAULTS,
    count=(0, "how many cases"), first=(0, "number of the first"), one=(-1, "play this one again, with its traceback"),
    whole=(0, "of meshes that pass, make every so many-th, down to the sheets"),
)  # fmt: skip


def main(arguments: list[str]) -> int:
    """Fuzz the kind that the first argument names."""
    named = arguments[:1] if arguments and arguments[0] in COUNTS else []
    return bench([*(["--only", *named] if named else []), *arguments[len(named) :]])
