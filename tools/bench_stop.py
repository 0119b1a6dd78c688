"""Benchmark of cancelling: the longest processor time between two checks for a cancel in every stage, on 2401 spirals.

python3 tools/dev.py bench stop [--only trace,merge,...] [--json FILE]

A stage can only stop where it reports progress, so the longest time between two reports is the longest wait after pressing ESC.
Beside it are the text shown meanwhile and the line of code that reported next.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from harness import Bench
from rows import Row, at_most

ROOT = Path(__file__).resolve().parent.parent
WANTED = 0.5  # seconds of the processor
STAGES = ("regularise", "trace", "merge", "flatten", "spirals", "simulate", "optimise", "preview", "export", "report")


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    bench = Bench("stop", arguments, 44, only="*")
    for one in stages([name for name in STAGES if bench.asked(name)]):
        bench.table.add(one)
    return bench.finish(keep=bench.options.only != "*")


def stages(wanted: list[str]) -> Iterator[Row]:
    """A row a stage, run in their order on one object."""
    import bpy
    from responsiveness import saddle

    obj = saddle()
    obj.flexmaps.export.folder = str(ROOT / "out" / "bench-stop")
    name = f"{len(obj.data.polygons)} quads"
    for stage in STAGES[: 1 + max(STAGES.index(word) for word in wanted)]:
        started = time.process_time()
        with listening() as gaps:
            getattr(bpy.ops.flexmaps, stage)()
        whole = time.process_time() - started
        if stage in wanted:
            seconds, text, place = max(gaps, key=lambda gap: gap[0])
            others = sum(gap[0] > WANTED for gap in gaps)
            peer = {"while": text or "-", "until": place, "such gaps": others, "in all": f"{whole:.1f} s"}
            yield at_most(name, f"{stage}: s of the processor to a stop", WANTED, seconds, peer)


@contextmanager
def listening() -> Iterator[list[tuple[float, str, str]]]:
    """Record (seconds, text before, line of code after) for every interval between two checks for a cancel."""
    from flexmaps.bridge.hosts import background
    from flexmaps.engine.progress import Progress

    gaps: list[tuple[float, str, str]] = []
    text = ""
    last = time.process_time()

    def note(place: str) -> None:
        nonlocal last
        now = time.process_time()
        gaps.append((now - last, text, place))
        last = now

    def look() -> bool:
        note(_place(sys._getframe(1)))
        return False

    def report(fraction: float, words: str) -> None:
        nonlocal text
        text = words

    def run_here(title: str, work: Any) -> Any:
        nonlocal last
        last = time.process_time()
        try:
            return work(Progress(report, look))
        finally:
            note("its end")

    kept, background.run_here = background.run_here, run_here
    try:
        yield gaps
    finally:
        background.run_here = kept


def _place(frame: FrameType | None) -> str:
    """Return the line of code that called the progress."""
    while frame is not None and frame.f_code.co_filename.endswith(("progress.py", "bench_stop.py")):
        frame = frame.f_back
    return "?" if frame is None else f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
