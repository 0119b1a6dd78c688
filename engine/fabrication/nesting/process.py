"""Run spyrrow in a process that can be killed: spyrrow cannot be stopped from within, and ESC must take effect at once."""

from __future__ import annotations

import importlib.util
import json
import queue
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...workers import python


@dataclass(frozen=True, eq=False)
class PackedStrip:
    """A packed strip.

    width : its length, metres
    places : angle (radians) and shift (2,), metres, by panel
    """

    width: float
    places: dict[int, tuple[float, np.ndarray]]


class Worker:
    """A process that runs spyrrow and can be killed."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[str] | None = None
        self.lines: queue.Queue[str] = queue.Queue()

    def solutions(self, task: dict[str, Any], seconds: float) -> Iterator[PackedStrip | None]:
        """Yield every better strip, and None repeatedly in between, until the task ends or ``seconds`` have elapsed."""
        begin = time.monotonic()
        try:
            self._start()
            process = self.process
            assert process is not None and process.stdin is not None
            process.stdin.write(json.dumps(task) + "\n")
            process.stdin.flush()
        except (OSError, ValueError):  # processes are not permitted here, or the process has ended
            self.stop()
            return
        while time.monotonic() - begin < seconds:
            try:
                line = self.lines.get(timeout=0.05)
            except queue.Empty:
                yield None
                continue
            if not line.endswith("\n"):  # the process has ended, perhaps in the middle of a line
                self.stop()
                return
            if not line.strip():
                return
            width, places = json.loads(line)
            yield PackedStrip(
                width * 1e-3, {int(i): (float(np.radians(turn)), 1e-3 * np.array(move)) for i, turn, move in places}
            )
        self.stop()

    def _start(self) -> None:
        """Start the process unless it runs."""
        if self.process is not None:
            return
        found = importlib.util.find_spec("spyrrow")
        where = [str(Path(p).parent) for p in (found.submodule_search_locations or ()) if found] if found else []
        self.lines = queue.Queue()
        self.process = subprocess.Popen(
            [str(python()), "-I", str(Path(__file__).with_name("spyrrow_worker.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        threading.Thread(target=_read, args=(self.process.stdout, self.lines), daemon=True).start()
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(where) + "\n")

    def stop(self) -> None:
        """Kill the process; the next task starts another."""
        process, self.process = self.process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                with suppress(OSError):
                    pipe.close()  # type: ignore[union-attr]


def _read(pipe: IO[str], lines: queue.Queue[str]) -> None:
    """Forward the lines of a pipe; an empty string marks its end."""
    with suppress(OSError, ValueError):
        for line in pipe:
            lines.put(line)
    lines.put("")
