"""Run functions of the engine in parallel worker processes.

``multiprocessing`` would start Blender again, or not find an extension under the name that Blender gives it. So the
processes run the script ``worker``.
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
TRIES = 2  # attempts at a task whose process dies, before ``WorkerDied`` is raised
WAIT = 0.05  # seconds between checks whether the user cancels; larger: reacts later
# environment of the processes: numerical libraries would otherwise start one thread per core in each
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")} | {"VECLIB_MAXIMUM_THREADS": "1"}
SCRIPT = Path(__file__).with_name("worker.py")


def python_path() -> str | None:
    """Return the path of the Python executable (inside Blender, the bundled one); None if there is none."""
    name = Path(sys.executable or "").name.lower()
    return sys.executable if name.startswith(("python", "pypy")) else None


def count_cores() -> int:
    """Return the number of processor cores that this program may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class WorkerDied(FlexMapsError):
    """A worker process died during a task."""


class Workers(Executor):
    """Executor on worker processes, which start when first needed; use it in a ``with`` statement.

    Functions, arguments and results must be picklable. If no process can be started, all calls run in this process, and
    ``note`` is a message about that; else ``note`` is "".

    Parameters
    ----------
    count : number of processes; None for the number of cores
    """

    def __init__(self, count: int | None = None):
        self.count = max(1, count_cores() if count is None else count)
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
        """Apply a function to every item; return the values in order.

        The calls run in this process if ``count`` is 1, or for a single item if no worker process has started yet.

        Parameters
        ----------
        function : takes one item
        items : arguments of the calls
        progress : called with the fraction done; a cancel kills the processes
        text : text of the progress reports

        Raises
        ------
        Cancelled : the user cancels
        WorkerDied : a process died
        Exception : the exception that the function raised for the first failing item
        """
        # once processes have started, a single item goes to a process too, so that the user can cancel with ESC
        if self.count < 2 or len(items) < (1 if self._all else 2):
            return [function(item) for item in progress.each(items, text)]
        futures = dict(as_completed(self, function, items, progress, text))
        return [futures[number].result() for number in range(len(items))]

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call a function in a process, as ``concurrent.futures.Executor`` does, but without keyword arguments.

        Parameters
        ----------
        function, args : picklable
        kwargs : must be empty
        """
        if kwargs:
            raise TypeError("workers take no keywords; use functools.partial")
        return self._threads.submit(self._called, pickle.dumps(function), pickle.dumps(args))

    def stop(self) -> None:
        """Kill all processes; running tasks raise ``Cancelled``, and later tasks start new processes."""
        with self._lock:
            for process in self._all:
                process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after all submitted tasks, or at once.

        Parameters
        ----------
        wait : whether to return only when all tasks have ended
        cancel_futures : whether to end the processes at once and drop tasks that have not started
        """
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
                    with self._lock:  # run in this process, one task at a time
                        return pickle.loads(function)(*pickle.loads(arguments))
                try:
                    return process.call(function, arguments)
                except WorkerDied:
                    if not left:
                        raise
        finally:
            self._idle.put(process)

    def _new(self) -> _Process | None:
        """Start another process; return None if not even the first process can be started."""
        try:
            process = _Process()
        except (OSError, WorkerDied):
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


def as_completed(
    executor: Executor,
    function: Callable[[Any], Any],
    items: Sequence[Any],
    progress: Progress = SILENT,
    text: str = "",
) -> Iterator[tuple[int, Future[Any]]]:
    """Call a function for all items in parallel; yield index and future of each item as soon as it is finished.

    A future's ``result()`` returns the function's value or raises its exception, or ``WorkerDied`` if the process died.
    Unfinished items are cancelled when the progress raises ``Cancelled``, or when the caller stops iterating.

    Parameters
    ----------
    executor : ``Workers``, a ``Cluster``, or another executor
    function : takes one item
    items : arguments of the calls
    progress : called with the fraction done; may cancel
    text : text of the progress reports
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
    """A worker process that runs one call at a time. Raises OSError or ``WorkerDied`` if it cannot be started."""

    def __init__(self) -> None:
        executable = python_path()
        if executable is None:
            raise FileNotFoundError("this program has no Python executable")
        self._stopped = False
        self._previous = b""
        self._popen = subprocess.Popen(
            [executable, "-I", "-B", str(SCRIPT)],
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
        """Call a pickled function with pickled arguments; return its value or raise its exception.

        Raise ``WorkerDied`` if the process dies.
        """
        sent = b"" if function == self._previous else function  # send a function only once: it can hold a whole mesh
        self._previous = function
        return self._answer(pickle.dumps((sent, arguments)))

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
            raise WorkerDied(
                "A process that was to work on this ended by itself: there may be too little memory for so many at once"
            ) from None
        if not well:
            raise value
        return value

    @property
    def running(self) -> bool:
        return self._popen.poll() is None

    def kill(self) -> None:
        """Kill the process; its running call raises ``Cancelled``."""
        self._stopped = True
        self._popen.kill()
        self._popen.wait()

    def close(self) -> None:
        """Kill the process and close its pipes; no call may be running."""
        self.kill()
        for pipe in (self._popen.stdin, self._popen.stdout):
            assert pipe is not None
            with suppress(OSError):
                pipe.close()
