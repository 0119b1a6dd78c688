"""Run functions of the engine on a Dask cluster, with the interface of ``workers``."""

from __future__ import annotations

import hashlib
import os
import pickle
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from pathlib import Path
from typing import Any

from . import MANIFEST
from .errors import FlexMapsError
from .workers import WorkerDied

ROOT = Path(__file__).resolve().parents[1]
# Seconds to wait for answers of scheduler and workers, as in the folder ``database``; smaller: slow networks fail
CONNECTION_SECONDS = 20
# Number of times that a task is repeated on another worker after its worker was lost, as in the folder ``database``;
# larger: survives more failures, ends later if every worker fails
RETRIES = 3


def source_checksum(root: str | Path = ROOT) -> str:
    """Return a checksum of the engine: manifest, sources and data, independent of line endings."""
    digest = hashlib.sha256()
    manifest = Path(root, MANIFEST.name)
    for path in sorted([manifest, *Path(root, "engine").rglob("*.py"), *Path(root, "data").rglob("*.npz")]):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()


def _remote(root: str, package: str, wanted: str, function: bytes, arguments: bytes) -> bytes:
    """Call a function on a worker of the cluster; return what ``worker.run_pickled`` returns.

    The first call on a worker imports the program there, under the package name that it has in this process.

    Parameters
    ----------
    root : folder of the program on the worker
    package : full name of the program's package
    wanted : checksum of the program, which the worker's must equal, see ``source_checksum``
    function, arguments : pickled
    """
    import importlib.util
    import pickle
    import sys
    from pathlib import Path

    name = f"{package} in {root}"
    if name not in sys.modules:
        place = Path(root, "engine", "worker.py")
        if not place.exists():
            return pickle.dumps((False, RuntimeError(f"there is no FlexMaps in {root}")))
        spec = importlib.util.spec_from_file_location("flexmaps_worker", place)
        assert spec is not None
        assert spec.loader is not None
        worker = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(worker)
        if package not in sys.modules:
            worker.import_package(package, root)
        worker.version = importlib.import_module(f"{package}.engine.cluster").source_checksum()  # type: ignore[attr-defined]
        sys.modules[name] = worker
    worker = sys.modules[name]
    if worker.version != wanted:
        return pickle.dumps(
            (False, RuntimeError("it has another version of FlexMaps, or was started before it changed"))
        )
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return worker.run_pickled(pickle.loads(function), arguments)


# functions of __main__ are pickled by value, so that workers need not import this package to unpickle it
_remote.__module__ = "__main__"


class Cluster(Executor):
    """Executor on the workers of a Dask cluster; use it in a ``with`` statement.

    A task whose worker is lost is repeated on another worker; after ``RETRIES`` repetitions its future raises
    ``WorkerDied``.

    Parameters
    ----------
    address : address of the Dask scheduler
    root : folder of this program on the workers

    Raises
    ------
    FlexMapsError : Dask is not installed, nothing answers, or a worker has another version of the program
    """

    def __init__(self, address: str, root: str | Path = ROOT):
        try:
            from distributed import Client
        except ImportError:
            raise FlexMapsError(
                "Dask is not installed; install dask and distributed beside this Python, or name no scheduler"
            ) from None
        try:
            self._client = Client(address, timeout=f"{CONNECTION_SECONDS}s")
        except (OSError, ValueError) as error:
            raise FlexMapsError(f"No Dask scheduler answers at {address}: {' '.join(str(error).split())}") from None
        self._remote = partial(_remote, os.fspath(root), __name__.rpartition(".engine.")[0], source_checksum())
        self._pickled: tuple[Any, bytes] = (None, b"")
        self._executor = self._client.get_executor(retries=RETRIES, pure=False)
        try:
            self._client.wait_for_workers(1, timeout=CONNECTION_SECONDS)
            answers = self._client.run(self._remote, pickle.dumps(os.getpid), pickle.dumps(()))
        except TimeoutError:
            self.shutdown()
            raise FlexMapsError(
                f"The Dask cluster at {address} has no workers; start some with: dask worker {address}"
            ) from None
        except Exception as error:
            self.shutdown()
            raise FlexMapsError(f"The workers at {address} cannot be used: {' '.join(str(error).split())}") from None
        for worker, reply in answers.items():
            well, value = pickle.loads(reply)
            if not well:
                self.shutdown()
                raise FlexMapsError(
                    f"The worker {worker} cannot be used: {value}; install this version there, and start it again"
                )

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call a function on one of the workers; return a future of its result.

        Parameters
        ----------
        function, args : picklable
        kwargs : must be empty
        """
        if kwargs:
            raise TypeError("workers take no keywords; use functools.partial")
        if self._pickled[0] is not function:  # pickle a function only once: it can hold a whole mesh
            self._pickled = function, pickle.dumps(function)
        wanted: Future[Any] = Future()
        wanted.set_running_or_notify_cancel()
        task = self._executor.submit(self._remote, self._pickled[1], pickle.dumps(args))
        task.add_done_callback(partial(_settle, wanted))
        return wanted

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnect from the cluster, which keeps running; unfinished tasks are dropped.

        Parameters
        ----------
        wait, cancel_futures : parameters of ``Executor.shutdown``; without effect here
        """
        self._client.close()

    def __exit__(self, *failed: Any) -> None:
        self.shutdown()


def _settle(wanted: Future[Any], task: Future[bytes]) -> None:
    """Set a future's result or exception from a finished task of the cluster."""
    if task.cancelled():
        wanted.set_exception(WorkerDied("The cluster cancelled a task; start this again"))
        return
    error = task.exception()
    if error is not None:
        wanted.set_exception(
            WorkerDied(f"Workers of the cluster ended again and again while they worked on this: {error}")
        )
        return
    well, value = pickle.loads(task.result())
    (wanted.set_result if well else wanted.set_exception)(value)
