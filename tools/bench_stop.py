"""Benchmark of cancelling: the longest processor time between two checks for a cancel in every stage, on 2401 spirals.

A stage can only stop where it reports progress. Beside the time are the text shown meanwhile and the line of code that reported next.
"""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import bpy
from flexmaps.bridge.hosts import background
from flexmaps.engine.progress import Progress
from harness import ROOT, Bench, Options, Rows, at_most
from responsiveness import saddle

WANTED = 0.5  # seconds of the processor
STAGES = ("regularise", "trace", "merge", "flatten", "spirals", "simulate", "optimise", "preview", "export", "report")
run: list[str] = []  # stages that the object has run


class Gaps(list[tuple[float, str, str]]):
    """(seconds, text before, line of code after) for every interval between two checks for a cancel."""

    text, last = "", 0.0

    def run_here(self, title: str, work: Any) -> Any:
        """Run the work of an operator, as ``background.run_blocking`` does."""
        self.last = time.process_time()
        try:
            return work(Progress(self._report, self._look))
        finally:
            self._note("its end")

    def _report(self, fraction: float, words: str) -> None:
        self.text = words

    def _look(self) -> bool:
        frame = sys._getframe(1)
        while frame.f_back is not None and frame.f_code.co_filename.endswith("progress.py"):
            frame = frame.f_back
        self._note(f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}")
        return False

    def _note(self, place: str) -> None:
        now = time.process_time()
        self.append((now - self.last, self.text, place))
        self.last = now


def measure(stage: str, options: Options) -> Rows:
    """Run a stage on the one object, after those before it that were not asked for."""
    if not run:
        saddle().flexmaps.export.folder = str(ROOT / "out" / "bench-stop")
    for one in STAGES[len(run) : STAGES.index(stage) + 1]:
        run.append(one)
        gaps, kept = Gaps(), background.run_blocking
        background.run_blocking = gaps.run_here
        try:
            getattr(bpy.ops.flexmaps, one)()
        finally:
            background.run_blocking = kept
    seconds, text, place = max(gaps, key=lambda gap: gap[0])
    others = sum(gap[0] > WANTED for gap in gaps)
    peer = {"while": text or "-", "until": place, "such gaps": others, "in all": f"{sum(gap[0] for gap in gaps):.1f} s"}
    name = f"{len(bpy.context.object.data.polygons)} quads"
    yield at_most(name, f"{stage}: s of the processor to a stop", WANTED, seconds, peer)


main = Bench("stop", {stage: partial(measure, stage) for stage in STAGES})
