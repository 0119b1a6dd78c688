"""Entry point of ``blender --command flexmaps ...``, which runs the stages on the command line.

``api``, which does the work, is imported only when a command runs, so that registering the command takes no time.
"""

from __future__ import annotations

import json
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from ..engine.remaining import RemainingTime, format_seconds

NAME = "flexmaps"
UNDONE_STATUS = 3  # exit status: files are written, but the report lists something as undone
_registered: list[Any] = []


def register() -> None:
    import bpy

    _registered.append(bpy.utils.register_cli_command(NAME, main))


def unregister() -> None:
    import bpy

    while _registered:
        bpy.utils.unregister_cli_command(_registered.pop())


def main(argv: list[str]) -> int:
    """Run one command, with progress on standard error and results on standard output.

    Returns
    -------
    The exit status: 0 success; 1 fault of the program; 2 wrong input, reported in one line on standard error; 3 files
    are written, but the piece could not be optimised or no equilibrium was found (``undone`` in the report); 130
    stopped.
    """
    for stream in (sys.stdout, sys.stderr):  # old consoles cannot print every character
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    from ..bridge.hosts.job_folder import suppress_output
    from ..engine import packages
    from ..engine.errors import Cancelled, FlexMapsError
    from . import arguments

    try:
        args = arguments.make_parser().parse_args(argv)
    except SystemExit as end:
        return int(end.code or 0)
    console = Console()
    try:
        with interruptible(console if args.is_resumable else None), suppress_output(), _show_version_warnings(console):
            described = args.run(args, console)
        status = _status(args.command, described)
    except FlexMapsError as error:
        console.end_line()
        print(f"flexmaps: {error}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, Cancelled):
        console.end_line()
        print("flexmaps: stopped; earlier files are as they were", file=sys.stderr)
        return 130
    except Exception as error:
        console.end_line()
        foreign = packages.blame_extension(error)
        if foreign is not None:
            print(f"flexmaps: {foreign}", file=sys.stderr)
            return 2
        traceback.print_exc()
        print("flexmaps: this is a fault of the program, not of yours; please report the lines above", file=sys.stderr)
        return 1
    console.end_line()
    if args.json:
        print(json.dumps(described, indent=2))
    else:
        args.print_result(described, args)
    sys.stdout.flush()
    return status


def _status(command: str, described: dict[str, Any]) -> int:
    """Return the exit status for a command's result."""
    if command == "check" and any(f["severity"] == "error" for f in described["checks"]):
        return 2
    if described.get("stuck"):
        return 2
    return UNDONE_STATUS if described.get("undone") else 0


@contextmanager
def _show_version_warnings(console: Console) -> Iterator[None]:
    """Context manager: print ``OtherVersion`` warnings as plain lines on standard error."""
    from ..engine.versions import OtherVersion

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
        if not issubclass(category, OtherVersion):
            before(message, category, *place)
            return
        console.end_line()
        print(f"flexmaps: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        before = warnings.showwarning
        warnings.simplefilter("always", OtherVersion)
        warnings.showwarning = show  # type: ignore[assignment]  # its further arguments pass through ``place``
        yield


@contextmanager
def interruptible(console: Console | None) -> Iterator[None]:
    """Context manager: let Ctrl-C interrupt Python; Blender itself would ignore the first press and quit at the second.

    Parameters
    ----------
    console : for commands that can return an unfinished result: the first Ctrl-C makes the console raise ``Cancelled``
        at its next report, the second interrupts at once; None interrupts at once
    """

    def pressed(number: int, frame: FrameType | None) -> None:
        if console is None or console.is_stopping:
            signal.default_int_handler(number, frame)
        else:
            console.is_stopping = True

    try:
        before = signal.signal(signal.SIGINT, pressed)
    except ValueError:  # not the main thread: signals cannot be handled here
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)


class Console:
    """Progress on standard error: in a terminal a line that is rewritten, elsewhere a new line every two seconds."""

    INTERVAL = 2.0  # seconds between two lines outside a terminal; smaller prints more

    def __init__(self) -> None:
        self.is_stopping = False
        self._live = sys.stderr.isatty()
        self._last = 0.0
        self._began, self._remaining = time.monotonic(), RemainingTime()

    def __call__(self, fraction: float, text: str) -> None:
        if self.is_stopping:
            from ..engine.errors import Cancelled

            self.is_stopping = False  # raise only once: the result so far must still be evaluated and written
            raise Cancelled("Stopped")
        now = time.monotonic()
        self._remaining.report(now - self._began, fraction)
        seconds = self._remaining.seconds(now - self._began)
        line = f"{fraction:4.0%}  {text}" + ("" if seconds is None else f", about {format_seconds(seconds)} left")
        if self._live:
            print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)
        elif now - self._last > self.INTERVAL or fraction >= 1.0:
            print(line, file=sys.stderr, flush=True)
            self._last = now

    def end_line(self) -> None:
        if self._live:
            print(file=sys.stderr)
