"""Pack shapes into a strip of fixed height, as short as possible, with spyrrow, in a process of ``engine.workers``.

A search of spyrrow cannot be cancelled, but its process can be killed. Only the standard library is imported at the
top, so that the process starts quickly.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import Any, NamedTuple

# seconds by which spyrrow may exceed its time limit before its best strip so far is taken; larger delays the result
GRACE = 0.3
WAIT = 0.02  # seconds between polls for a shorter strip; larger notices the end later, smaller costs more computation


class StripTask(NamedTuple):
    """Input of ``pack_strip``; all lengths in the same unit.

    items : key of every shape, its points counter-clockwise, and the allowed rotations in degrees
    height : height of the strip
    seconds : time limit
    seed : seed of the random search
    target_length : the search stops early once the strip is no longer than this
    """

    items: list[tuple[int, list[tuple[float, float]], list[float]]]
    height: float
    seconds: int
    seed: int
    target_length: float = 0.0


class PackedStrip(NamedTuple):
    """A packed strip: its length, and for every shape's key its rotation (degrees) and the shift after that."""

    length: float
    places: dict[int, tuple[float, tuple[float, float]]]


def pack_strip(task: StripTask) -> PackedStrip | None:
    """Return the shortest strip that spyrrow finds within the time limit; None if it finds none."""
    import spyrrow

    items = [spyrrow.Item(str(key), points, 1, turns) for key, points, turns in task.items]
    strip = spyrrow.StripPackingInstance("", task.height, items)
    config = spyrrow.StripPackingConfig(total_computation_time=task.seconds, num_workers=1, seed=task.seed)
    reports, done = spyrrow.ProgressQueue(), threading.Event()
    threading.Thread(target=_run_search, args=(strip, config, reports, done), daemon=True).start()
    feasible = (spyrrow.ReportType.ExplFeas, spyrrow.ReportType.CmprFeas, spyrrow.ReportType.Final)
    best: Any = None
    end, ended = time.monotonic() + task.seconds + GRACE, False
    while not ended and (best is None or best.width > task.target_length):
        ended = done.wait(WAIT) or time.monotonic() > end
        for kind, found in reports.drain():
            if kind in feasible and (best is None or found.width < best.width):
                best = found
    if best is None:
        return None
    return PackedStrip(best.width, {int(p.id): (p.rotation, p.translation) for p in best.placed_items})


def _run_search(strip: Any, config: Any, reports: Any, done: threading.Event) -> None:
    """Run the search and set ``done`` at its end; target of a thread."""
    with suppress(BaseException):  # a panic in the Rust code raises a BaseException; there is no solution then
        strip.solve(config, reports)
    done.set()
