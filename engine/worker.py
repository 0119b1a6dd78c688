"""A program of its own, run by ``workers``: calls functions of the engine for another process.

The first message says where modules are found and what the package is called there, for an extension in Blender has a name
that only Blender knows. Then (function, argument) come in, one after the other, and (whether it went well, result or error)
go out. Messages are pickled, with their length before them. The program ends when its input does.
"""

import importlib.machinery
import os
import pickle
import struct
import sys
import types


def main() -> None:
    """Do one task after the other until there are no more."""
    source = sys.stdin.buffer
    sink = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints is no message
    paths, package, folder = receive(source)
    sys.path[:] = paths
    parts = package.split(".")
    for k in range(1, len(parts) + 1):  # empty packages, so that nothing of Blender is imported
        name = ".".join(parts[:k])
        module = types.ModuleType(name)
        module.__path__ = [folder] if k == len(parts) else []
        module.__spec__ = importlib.machinery.ModuleSpec(name, None, is_package=True)
        sys.modules[name] = module
    while True:
        try:
            message = receive(source)
        except EOFError:
            return
        try:
            function, item = pickle.loads(message)
            answer = pickle.dumps((True, function(item)))
        except Exception as error:
            answer = pickle.dumps((False, error))
        send(sink, answer)


def send(sink, message):  # type: ignore[no-untyped-def]  # any pipe, any object
    """Write a message to a pipe."""
    data = pickle.dumps(message)
    sink.write(struct.pack("<Q", len(data)) + data)
    sink.flush()


def receive(source):  # type: ignore[no-untyped-def]
    """Read a message from a pipe; raises EOFError at its end."""
    head = source.read(8)
    if len(head) < 8:
        raise EOFError
    size = struct.unpack("<Q", head)[0]
    data = source.read(size)
    if len(data) < size:
        raise EOFError
    return pickle.loads(data)


if __name__ == "__main__":
    main()
