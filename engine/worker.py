"""What a process of ``workers`` runs: by itself, as a script, until whoever started it wants no more of it.

It takes pickled pairs from its standard input, a function (b"" for the one it had before) and its arguments, and answers each
with a pickled pair: whether it went well, and the value or the exception. It ends at once when its input ends, even within
its work: nothing stays behind a program that was killed.
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


def load(package: str, folder: str) -> None:
    """The package that lies in a folder, under the name that it has in the program that started this one."""
    parents = package.split(".")[:-1]  # those of Blender's extensions hold no code that is needed here
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


def answer(function: Any, arguments: bytes) -> bytes:
    """What a function makes of its arguments, or raises, as it is sent back."""
    try:
        return pickle.dumps((True, function(*pickle.loads(arguments))))
    except Exception as error:
        error.add_note("".join(traceback.format_exception(error)))
        try:
            told = pickle.dumps((False, error))
            pickle.loads(told)  # some exceptions can be written, but not read again
            return told
        except Exception:
            return pickle.dumps((False, RuntimeError("".join(traceback.format_exception(error)))))


def _take(source: BinaryIO, wanted: queue.SimpleQueue[tuple[bytes, bytes]]) -> None:
    try:
        while True:
            wanted.put(pickle.load(source))
    except (EOFError, OSError, pickle.UnpicklingError):
        os._exit(0)


def main() -> None:
    """Begin with a line of JSON that tells name and folder of the package and Python's path; say ``ready``, and serve."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program that started this one
    source = sys.stdin.buffer
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not get between the answers
    begin = json.loads(source.readline())
    sys.path[:] = begin["path"]
    load(begin["package"], begin["folder"])
    wanted: queue.SimpleQueue[tuple[bytes, bytes]] = queue.SimpleQueue()
    threading.Thread(target=_take, args=(source, wanted), daemon=True).start()
    told, function = pickle.dumps((True, "ready")), None
    while True:
        answers.write(told)
        answers.flush()
        given, arguments = wanted.get()
        try:
            function = pickle.loads(given) if given else function
        except Exception as error:
            told, function = pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}"))), None
        else:
            told = answer(function, arguments)


if __name__ == "__main__":
    main()
