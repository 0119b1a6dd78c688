"""Script of the worker processes that ``workers`` starts.

It reads pickled pairs from standard input: a pickled function (b"" for the previous function) and its pickled
arguments. It answers each with a pickled pair: whether the call succeeded, and the value or the exception. It exits at
once when its input ends, even during a call, so that no worker survives a parent that was killed.
"""

from __future__ import annotations

import importlib.util
import json
import os
import pickle
import queue
import signal
import sys
import threading
import traceback
import types
from pathlib import Path
from typing import Any, BinaryIO


def import_package(package: str, folder: str) -> None:
    """Import a package from a folder.

    Parameters
    ----------
    package : full name that the package has in the parent process
    folder : where it is installed
    """
    parents = package.split(".")[:-1]  # make empty parent packages: Blender's "bl_ext" packages hold no code
    for k in range(len(parents)):
        name = ".".join(parents[: k + 1])
        sys.modules[name] = types.ModuleType(name)
        sys.modules[name].__path__ = []
    place = Path(folder) / "__init__.py"
    spec = importlib.util.spec_from_file_location(package, place, submodule_search_locations=[folder])
    assert spec is not None
    assert spec.loader is not None
    sys.modules[package] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[package])


def run_pickled(function: Any, arguments: bytes) -> bytes:
    """Call a function with pickled arguments; return a pickled pair: whether it succeeded, and value or exception.

    Parameters
    ----------
    function : the function, not pickled
    arguments : pickled tuple of its arguments
    """
    try:
        return pickle.dumps((True, function(*pickle.loads(arguments))))
    except Exception as error:
        error.add_note("".join(traceback.format_exception(error)))
        try:
            reply = pickle.dumps((False, error))
            pickle.loads(reply)  # some exceptions can be pickled but not unpickled
            return reply
        except Exception:
            return pickle.dumps((False, RuntimeError("".join(traceback.format_exception(error)))))


def _read_calls(source: BinaryIO, wanted: queue.SimpleQueue[tuple[bytes, bytes]]) -> None:
    try:
        while True:
            wanted.put(pickle.load(source))
    except (EOFError, OSError, pickle.UnpicklingError):
        os._exit(0)


def main() -> None:
    """Serve calls until the input ends.

    The first line of input is JSON with the package's name and folder and Python's path; the answer to it is "ready".
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent process
    source = sys.stdin.buffer
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # redirect print() of libraries to standard error, away from the answers
    begin = json.loads(source.readline())
    sys.path[:] = begin["path"]
    import_package(begin["package"], begin["folder"])
    wanted: queue.SimpleQueue[tuple[bytes, bytes]] = queue.SimpleQueue()
    threading.Thread(target=_read_calls, args=(source, wanted), daemon=True).start()
    reply, function = pickle.dumps((True, "ready")), None
    while True:
        answers.write(reply)
        answers.flush()
        pickled, arguments = wanted.get()
        try:
            function = pickle.loads(pickled) if pickled else function
        except Exception as error:
            reply, function = pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}"))), None
        else:
            reply = run_pickled(function, arguments)


if __name__ == "__main__":
    main()
