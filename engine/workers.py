"""Functions of the engine called for many things at once, in processes beside this one.

Plain ``multiprocessing`` would start Blender again, or not find an extension by the name that Blender gives it; so the
processes are started by hand, see ``worker``.
"""

from __future__ import annotations

import json
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from .errors import Cancelled, FlexMapsError
from .progress import SILENT, Progress

T = TypeVar("T")
U = TypeVar("U")
TRIES = 2  # how often a task is given to a process before it is said that processes end at it
WAIT = 0.05  # seconds between two looks whether the user wants to stop
# numeric libraries must not start a thread a core in every process
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")} | {"VECLIB_MAXIMUM_THREADS": "1"}
SCRIPT = Path(__file__).with_name("worker.py")


def python() -> str | None:
    """The Python of this program; inside Blender that is the one that comes with it, never Blender itself."""
    name = Path(sys.executable or "").name.lower()
    return sys.executable if name.startswith(("python", "pypy")) else None


def cores() -> int:
    """How many processor cores this program may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Lost(FlexMapsError):
    """A process ended by itself while it worked on something."""


class Workers(Executor):
    """Processes that call functions for this one, started when they are first needed; use it in a ``with`` statement.

    count : how many; as many as there are cores by default. Functions, arguments and results can be pickled. Where no process
    can be started, everything is done in this one, and ``note`` says so; else it is "".
    """

    def __init__(self, count: int | None = None):
        self.count = max(1, cores() if count is None else count)
        self.note = ""
        self._idle: queue.LifoQueue[_Process | None] = queue.LifoQueue()
        for _ in range(self.count):
            self._idle.put(None)
        self._all: set[_Process] = set()
        self._lock = threading.Lock()
        self._threads = ThreadPoolExecutor(self.count, "FlexMaps worker")

    def __call__(
        self, function: Callable[[T], U], items: Sequence[T], progress: Progress = SILENT, text: str = ""
    ) -> list[U]:
        """The function of every item, in their order; in this process with one alone, or of one item before there are others.

        What the function raises is raised here, of several the one of the first item; ``Cancelled`` when the user wants to stop,
        which ends the processes at once. Raises ``Lost`` where processes end by themselves.
        """
        if self.count < 2 or len(items) < (1 if self._all else 2):  # ESC is seen while another process works
            return [function(item) for item in progress.each(items, text)]
        found = dict(as_done(self, function, items, progress, text))
        return [found[number].result() for number in range(len(items))]

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have the function called in a process: as ``concurrent.futures.Executor`` does, but without keywords."""
        if kwargs:
            raise TypeError("workers take no keywords; use functools.partial")
        return self._threads.submit(self._called, pickle.dumps(function), pickle.dumps(args))

    def stop(self) -> None:
        """End at once what is under way, which raises ``Cancelled`` then; there are new processes for what comes after."""
        with self._lock:
            for process in self._all:
                process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: after what was asked of them, or, with ``cancel_futures``, at once."""
        if cancel_futures:
            self._threads.shutdown(wait=False, cancel_futures=True)
            self.stop()
        self._threads.shutdown(wait=wait)
        with self._lock:
            for process in self._all:
                process.close()
            self._all.clear()

    def __exit__(self, *failed: Any) -> None:
        self.shutdown(cancel_futures=failed[0] is not None)

    def _called(self, function: bytes, arguments: bytes) -> Any:
        process = self._idle.get()
        try:
            for left in reversed(range(TRIES)):
                if process is not None and not process.running:
                    self._drop(process)
                    process = None
                process = process or self._new()
                if process is None:
                    with self._lock:  # one at a time, as if there were no threads
                        return pickle.loads(function)(*pickle.loads(arguments))
                try:
                    return process.call(function, arguments)
                except Lost:
                    if not left:
                        raise
        finally:
            self._idle.put(process)

    def _new(self) -> _Process | None:
        """Another process; None where there never was one, and none can be started."""
        try:
            process = _Process()
        except (OSError, Lost):
            if self._all:
                raise
            self.note = "No Python can be started beside this program: everything is done in one process"
            return None
        with self._lock:
            self._all.add(process)
        return process

    def _drop(self, process: _Process) -> None:
        with self._lock:
            self._all.discard(process)
        process.close()


def as_done(
    executor: Executor,
    function: Callable[[Any], Any],
    items: Sequence[Any],
    progress: Progress = SILENT,
    text: str = "",
) -> Iterator[tuple[int, Future[Any]]]:
    """(number, future) of every item as soon as it is done, by any executor, such as that of a cluster.

    A future's ``result()`` is the function's value, or raises what it raised, ``Lost`` where its process ended. What is still
    under way is ended when the progress raises ``Cancelled``, or when nobody asks for more.
    """
    numbers = {executor.submit(function, item): number for number, item in enumerate(items)}
    left = set(numbers)
    try:
        while left:
            progress(1.0 - len(left) / len(items), text)
            done, left = wait(left, timeout=WAIT, return_when=FIRST_COMPLETED)
            for future in sorted(done, key=numbers.__getitem__):
                yield numbers[future], future
    finally:
        for future in left:
            future.cancel()
        if isinstance(executor, Workers) and not all(future.done() for future in left):
            executor.stop()


class _Process:
    """A Python beside this one that calls one function at a time. Raises OSError and ``Lost`` where none can be started."""

    def __init__(self) -> None:
        found = python()
        if found is None:
            raise FileNotFoundError("this program is no Python")
        self._stopped = False
        self._known = b""
        self._popen = subprocess.Popen(
            [found, "-I", "-B", str(SCRIPT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **ONE_THREAD},
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),  # no console window on Windows
        )
        path = [place for place in sys.path if place]
        package = __name__.rpartition(".engine.")[0]
        begin = json.dumps({"package": package, "folder": str(SCRIPT.resolve().parents[1]), "path": path})
        self._answer(begin.encode() + b"\n")

    def call(self, function: bytes, arguments: bytes) -> Any:
        """The value of a pickled function of pickled arguments. Raises what that raises, and ``Lost`` where the process ends."""
        given = b"" if function == self._known else function  # a function can hold a whole mesh
        self._known = function
        return self._answer(pickle.dumps((given, arguments)))

    def _answer(self, message: bytes) -> Any:
        stdin, stdout = self._popen.stdin, self._popen.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            stdin.write(message)
            stdin.flush()
            well, value = pickle.load(stdout)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            if self._stopped:
                raise Cancelled from None
            self.kill()
            raise Lost(
                "A process that was to work on this ended by itself: there may be too little memory for so many at once"
            ) from None
        if not well:
            raise value
        return value

    @property
    def running(self) -> bool:
        return self._popen.poll() is None

    def kill(self) -> None:
        """End it at once; what it works on raises ``Cancelled``."""
        self._stopped = True
        self._popen.kill()
        self._popen.wait()

    def close(self) -> None:
        """End it and let go of its pipes; no call may be under way."""
        self.kill()
        for pipe in (self._popen.stdin, self._popen.stdout):
            assert pipe is not None
            with suppress(OSError):
                pipe.close()
