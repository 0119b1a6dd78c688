"""Functions of the engine called for many things at once, in processes beside this one.

Plain ``multiprocessing`` would start Blender again, or not find an extension by the name that Blender gives it; so the
processes are started by hand, see ``worker``.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from .errors import FlexMapsError
from .progress import Progress
from .worker import receive, send

T = TypeVar("T")
U = TypeVar("U")
TRIES = 2  # how often a task is given to a process before it is said that processes end at it
WAIT = 0.05  # seconds between two looks whether the user wants to stop
# numeric libraries must not start a thread a core in every process
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def python() -> str | None:
    """The Python of this program; inside Blender that is the one that comes with it, never Blender itself."""
    name = Path(sys.executable or "").name.lower()
    return sys.executable if name.startswith(("python", "pypy")) else None


def cores() -> int:
    """How many processor cores this program may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Workers:
    """Processes that call functions for this one, started when they are first needed; use it in a ``with`` statement.

    count : how many; as many as there are cores by default. With one, or where no process can be started, everything is done
    in this process.
    """

    def __init__(self, count: int | None = None):
        self.count = cores() if count is None else count
        self._idle: list[_Process] = []

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._idle:
            process.stop()
        self._idle.clear()

    def __call__(self, function: Callable[[T], U], items: Sequence[T], progress: Progress, text: str = "") -> list[U]:
        """The function of every item, in their order; function and items can be pickled.

        What the function raises is raised here, of several the one of the first item; ``Cancelled`` when the user wants to stop,
        which ends the processes at once. Raises ``FlexMapsError`` where processes end by themselves.
        """
        count = min(self.count, len(items))
        if count < 2 or python() is None:
            return [function(item) for item in progress.each(items, text)]
        tasks: queue.SimpleQueue[tuple[int, bytes] | None] = queue.SimpleQueue()
        answers: queue.SimpleQueue[tuple[int, bool, Any]] = queue.SimpleQueue()
        for number, item in enumerate(items):
            tasks.put((number, pickle.dumps((function, item))))
        for _ in range(count):
            tasks.put(None)
        used = [self._idle.pop() if self._idle else _Process() for _ in range(count)]
        threads = [threading.Thread(target=process.serve, args=(tasks, answers), daemon=True) for process in used]
        for thread in threads:
            thread.start()
        try:
            found = _collected(len(items), answers, progress, text)
        except BaseException:
            for process in used:
                process.stop(for_good=True)
            raise
        for thread in threads:
            thread.join()
        self._idle += used
        return found


def _collected(
    count: int, answers: queue.SimpleQueue[tuple[int, bool, Any]], progress: Progress, text: str
) -> list[Any]:
    """All answers in their order, as they come; raises what the first of them raised."""
    found: dict[int, tuple[bool, Any]] = {}
    while len(found) < count:
        progress(len(found) / count, text)
        with suppress(queue.Empty):
            number, well, value = answers.get(timeout=WAIT)
            found[number] = well, value
    for number in range(count):
        well, value = found[number]
        if not well:
            raise value
    return [found[number][1] for number in range(count)]


class _Process:
    """One process, started when it is first needed and again when it has ended."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._over = False

    def serve(
        self,
        tasks: queue.SimpleQueue[tuple[int, bytes] | None],
        answers: queue.SimpleQueue[tuple[int, bool, Any]],
    ) -> None:
        """Do tasks until there is none left; runs in a thread of its own."""
        while not self._over and (task := tasks.get()) is not None:
            number, message = task
            answers.put((number, *self._answer(message)))

    def _answer(self, message: bytes) -> tuple[bool, Any]:
        for _ in range(TRIES):
            try:
                pipes = self._started()
                send(pipes.stdin, message)
                well, value = pickle.loads(receive(pipes.stdout))
                return well, value
            except (OSError, EOFError, ValueError):
                self.stop()
                if self._over:
                    break
        return False, FlexMapsError(
            "A process that was to work on this ended by itself, twice: there may be too little memory for so many at once"
        )

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            package = __name__.rpartition(".engine.")[0]
            self._process = subprocess.Popen(
                [str(python()), "-I", str(Path(__file__).with_name("worker.py"))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **ONE_THREAD},
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
            send(self._process.stdin, (sys.path, package, str(Path(__file__).resolve().parents[1])))
        return self._process

    def stop(self, *, for_good: bool = False) -> None:
        """End the process at once; ``for_good``, no other is started."""
        self._over |= for_good
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                with suppress(OSError):
                    pipe.close()  # type: ignore[union-attr]
