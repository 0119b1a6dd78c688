"""Pack shapes into a strip of fixed height, as short as possible, with spyrrow; made for a process of ``engine.workers``.

spyrrow cannot be stopped from within, but its process can be killed. Only the standard library is imported, so that the
process starts quickly.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import Any, NamedTuple

GRACE = 0.3  # seconds that spyrrow may exceed its limit before its best strip so far is taken
WAIT = 0.02  # seconds between looks for a shorter strip


class StripTask(NamedTuple):
    """Input of ``pack_strip``, lengths in one unit.

    items : key of every shape, its points counter-clockwise, and the degrees by which it may be turned
    height : of the strip
    seconds : time limit
    seed : of the search
    enough : length that is short enough to stop at
    """

    items: list[tuple[int, list[tuple[float, float]], list[float]]]
    height: float
    seconds: int
    seed: int
    enough: float = 0.0


class PackedStrip(NamedTuple):
    """A packed strip: its length, and by key of a shape its angle in degrees and then its shift."""

    length: float
    places: dict[int, tuple[float, tuple[float, float]]]


def pack_strip(task: StripTask) -> PackedStrip | None:
    """Return the shortest strip that spyrrow finds; None without one."""
    import spyrrow

    items = [spyrrow.Item(str(key), points, 1, turns) for key, points, turns in task.items]
    strip = spyrrow.StripPackingInstance("", task.height, items)
    config = spyrrow.StripPackingConfig(total_computation_time=task.seconds, num_workers=1, seed=task.seed)
    reports, done = spyrrow.ProgressQueue(), threading.Event()
    threading.Thread(target=_solve, args=(strip, config, reports, done), daemon=True).start()
    feasible = (spyrrow.ReportType.ExplFeas, spyrrow.ReportType.CmprFeas, spyrrow.ReportType.Final)
    best: Any = None
    end, ended = time.monotonic() + task.seconds + GRACE, False
    while not ended and (best is None or best.width > task.enough):
        ended = done.wait(WAIT) or time.monotonic() > end
        for kind, found in reports.drain():
            if kind in feasible and (best is None or found.width < best.width):
                best = found
    if best is None:
        return None
    return PackedStrip(best.width, {int(p.id): (p.rotation, p.translation) for p in best.placed_items})


def _solve(strip: Any, config: Any, reports: Any, done: threading.Event) -> None:
    """Search in a thread."""
    with suppress(BaseException):  # a panic in the Rust code raises a BaseException; there is no solution then
        strip.solve(config, reports)
    done.set()
