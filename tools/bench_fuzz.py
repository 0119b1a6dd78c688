"""Fuzzing with damaged input: ``bench fuzz readers|meshes|settings|stored [--count N] [--first N] [--whole K] [--one N]``.

Every case is generated from its number, so ``--one N`` repeats it. A case may raise only ``FlexMapsError``, and must end within
``SECONDS`` of processor time.
"""

from __future__ import annotations

import argparse
import collections
import importlib
import sys
import time
import traceback

SECONDS = 5.0  # largest processor time of a case
# default number of cases of each kind
COUNTS = {"readers": 20_000, "meshes": 1000, "settings": 20_000, "stored": 600}


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="bench fuzz", description=__doc__)
    parser.add_argument("what", nargs="?", choices=list(COUNTS), default="readers")
    parser.add_argument("--count", type=int, help="how many cases")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument(
        "--whole", type=int, default=0, metavar="K", help="of meshes that pass, make every K-th, down to the sheets"
    )
    parser.add_argument("--one", type=int, metavar="N", help="play one again, with its traceback")
    args = parser.parse_args(arguments)
    fuzzer = importlib.import_module(f"fuzz_{args.what}")
    if args.one is not None:
        print(fuzzer.described(args.one))
        print(fuzzer.play(args.one, True))
        return 0
    count = COUNTS[args.what] if args.count is None else args.count
    outcomes: collections.Counter[str] = collections.Counter()
    faults: dict[str, list[int]] = {}
    slow: list[tuple[float, int]] = []
    began = time.process_time()
    for number in range(args.first, args.first + count):
        start = time.process_time()
        try:
            outcomes[fuzzer.play(number, bool(args.whole) and number % args.whole == 0)] += 1
        except Exception as error:  # every other exception is a fault
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = next(
                (f for f in reversed(traceback.extract_tb(error.__traceback__)) if "site-packages" not in f.filename),
                frame,
            )
            text = f"{type(error).__name__} in {where.filename.rpartition('/')[2]}:{where.lineno}: {str(error)[:120]}"
            faults.setdefault(text, []).append(number)
            if len(faults[text]) == 1:
                print(f"  {number}: {text}", flush=True)
        taken = time.process_time() - start
        if taken > SECONDS:
            slow.append((taken, number))
        if sys.stdout.isatty():
            print(f"\r{number + 1 - args.first}/{count}", end="", flush=True)
    seconds = time.process_time() - began
    print(
        f"{count} cases of {args.what} in {seconds:.0f} s: "
        + ", ".join(f"{n} {kind}" for kind, n in outcomes.most_common())
    )
    print(f"faults: {sum(map(len, faults.values()))}, of {len(faults)} kinds; longer than {SECONDS:g} s: {len(slow)}")
    for text, numbers in faults.items():
        print(f"  {len(numbers)} times {text} (--one {numbers[0]})")
    for taken, number in sorted(slow, reverse=True):
        print(f"  {taken:.1f} s (--one {number})")
    return 1 if faults or slow else 0
