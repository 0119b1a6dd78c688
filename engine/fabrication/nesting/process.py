"""spyrrow in a process of its own: it cannot be stopped from within, and a user who presses ESC does not want to wait."""

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
class Strip:
    """A packed strip: its length in metres and, of every panel on it, turn (radians) and shift (2,) metres."""

    width: float
    places: dict[int, tuple[float, np.ndarray]]


class Worker:
    """spyrrow in a process of its own, for it cannot be stopped: a process can."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[str] | None = None
        self.lines: queue.Queue[str] = queue.Queue()

    def solutions(self, task: dict[str, Any], seconds: float) -> Iterator[Strip | None]:
        """Every better strip as it is found, and ``None`` now and then; ends with the task or after ``seconds``."""
        begin = time.monotonic()
        try:
            self._start()
            process = self.process
            assert process is not None and process.stdin is not None
            process.stdin.write(json.dumps(task) + "\n")
            process.stdin.flush()
        except (OSError, ValueError):  # no process may be started here, or it has gone
            self.stop()
            return
        while time.monotonic() - begin < seconds:
            try:
                line = self.lines.get(timeout=0.05)
            except queue.Empty:
                yield None
                continue
            if not line.endswith("\n"):  # it has ended by itself, perhaps within a line
                self.stop()
                return
            if not line.strip():
                return
            width, places = json.loads(line)
            yield Strip(
                width * 1e-3, {int(i): (float(np.radians(turn)), 1e-3 * np.array(move)) for i, turn, move in places}
            )
        self.stop()

    def _start(self) -> None:
        if self.process is not None:
            return
        found = importlib.util.find_spec("spyrrow")
        where = [str(Path(p).parent) for p in (found.submodule_search_locations or ()) if found] if found else []
        self.lines = queue.Queue()
        self.process = subprocess.Popen(
            [str(python()), "-I", str(Path(__file__).with_name("worker.py"))],
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
        """End the process at once; the next task starts another."""
        process, self.process = self.process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                with suppress(OSError):
                    pipe.close()  # type: ignore[union-attr]


def _read(pipe: IO[str], lines: queue.Queue[str]) -> None:
    """Hand the lines of a pipe on; an empty text at its end."""
    with suppress(OSError, ValueError):
        for line in pipe:
            lines.put(line)
    lines.put("")
