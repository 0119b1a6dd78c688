"""The background job, one at a time: a worker thread runs engine code; the main thread polls it and updates Blender.

The worker thread never touches Blender's data. ``Job`` is the thread with its progress and a way to cancel it.
``run_blocking`` runs the work without a thread, for scripts and for Blender without a window.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from ...engine import packages
from ...engine.errors import Cancelled, FlexMapsError
from ...engine.progress import Progress
from ...engine.remaining import RemainingTime, format_seconds

Work = Callable[[Progress], Any]

# polling interval of threads and processes, seconds; smaller reacts sooner and takes more of the window's time
POLL_INTERVAL = 0.02
# switch interval of Python's global interpreter lock while a job runs, seconds (Python's default: 5 ms); smaller keeps
# the window more responsive and slows the worker down
SWITCH_INTERVAL = 0.0003

_running: list[Job] = []


def current_job() -> Job | None:
    """Return the running job, or None; panels read it to draw the progress line."""
    return _running[0] if _running else None


def latest_result() -> Any:
    """Return the running job's latest intermediate result, such as a shape that is still moving; None without one."""
    return _running[0].intermediate if _running else None


class Job:
    """Engine work in a thread: call ``start``, poll ``finished``, then read ``result`` or ``error``."""

    def __init__(self, title: str, work: Work, on_stop: str = "nothing is changed then"):
        self.title = title
        self.on_stop = on_stop  # words for the sidebar: the effect of stopping the job
        self.fraction = 0.0
        self.text = ""
        self.displayed: tuple[float, str] | None = None  # fraction and text that the status bar shows
        self.intermediate: Any = None  # the latest intermediate result, such as a shape that is still moving
        self.result: Any = None
        self.error: BaseException | None = None
        self._work = work
        self._began, self._remaining = time.monotonic(), RemainingTime()
        self._stop = threading.Event()
        self._interval = sys.getswitchinterval()
        self._thread = threading.Thread(target=self._run, name=f"FlexMaps {title}", daemon=True)

    def start(self) -> None:
        """Start the thread as the running job; raise ``RuntimeError`` if another job is running."""
        if _running:
            raise RuntimeError(f"{_running[0].title} is still running")
        _running.append(self)
        self._interval = sys.getswitchinterval()
        sys.setswitchinterval(min(SWITCH_INTERVAL, self._interval))
        self._began = time.monotonic()
        self._thread.start()

    @property
    def is_finished(self) -> bool:
        return not self._thread.is_alive()

    @property
    def is_stopping(self) -> bool:
        return self._stop.is_set()

    def stop(self) -> None:
        """Ask the work to end at its next progress report."""
        self._stop.set()

    def end(self) -> None:
        """Stop the work if it is still running, wait for the thread, and allow the next job to start."""
        self.stop()
        if self._thread.ident is not None:
            self._thread.join()
            sys.setswitchinterval(self._interval)
        if self in _running:
            _running.remove(self)

    def _run(self) -> None:
        try:
            self.result = self._work(Progress(self._report, self._stop.is_set, shown=self._show))
        except BaseException as error:  # handed to the main thread, which reports it
            self.error = _explain(error)

    @property
    def time_left(self) -> str:
        """Return the remaining time in words; "" while it is unknown."""
        seconds = self._remaining.seconds(time.monotonic() - self._began)
        return "" if seconds is None or self.is_stopping else format_seconds(seconds)

    def _report(self, fraction: float, text: str) -> None:
        self.fraction, self.text = fraction, text
        self._remaining.report(time.monotonic() - self._began, fraction)

    def _show(self, value: object) -> None:
        self.intermediate = value


class ConsoleProgress:
    """Progress callback that prints to the console: a line for every new step, then at most one line a second.

    The step's name is the text before the first colon; the rest is a detail of the step.
    """

    def __init__(self, title: str):
        self._title = title
        self._steps: set[str] = set()
        self._time = 0.0
        self._began, self._remaining = time.monotonic(), RemainingTime()

    def __call__(self, fraction: float, text: str) -> None:
        now = time.monotonic()
        self._remaining.report(now - self._began, fraction)
        step = text.partition(":")[0]
        if step in self._steps and now - self._time < 1.0:
            return
        self._steps.add(step)
        self._time = now
        seconds = self._remaining.seconds(now - self._began)
        left = "" if seconds is None else f", about {format_seconds(seconds)} left"
        print(f"{self._title} {100 * fraction:3.0f} % {text}".rstrip() + left, file=sys.stdout, flush=True)


def run_blocking(title: str, work: Work) -> Any:
    """Run the work on the calling thread and return its result; Ctrl-C raises ``Cancelled``.

    Parameters
    ----------
    title : name of the work, for the console
    work : function that takes a ``Progress``
    """
    try:
        return work(Progress(ConsoleProgress(title)))
    except KeyboardInterrupt:
        raise Cancelled(title) from None
    except Exception as error:
        explained = _explain(error)
        if explained is error:
            raise
        raise explained from error


def _explain(error: BaseException) -> BaseException:
    """Return an error that names the extension whose packages caused this error; other errors unchanged."""
    if isinstance(error, FlexMapsError | Cancelled):
        return error
    return packages.blame_extension(error) or error


def stop_current(*_: object) -> None:
    """Stop the running job and wait until it ends; called before a file is loaded or the extension is disabled."""
    for running in list(_running):
        running.end()
