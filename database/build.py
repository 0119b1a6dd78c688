"""Running the chunks: by processes of this machine, or on a Dask cluster. Every chunk is one file; what exists is done."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from ..engine.errors import FlexMapsError
from ..engine.progress import SILENT, Progress
from . import chunks, packs
from .chunks import Task
from .sampling import Subject

ROOT = Path(__file__).resolve().parent.parent
ENTRY = ROOT / "tools" / "dev.py"


def pending(folder: Path, wanted: list[Task], pack: Path | None = None) -> list[Task]:
    """The tasks whose file is missing or broken, and that are not in the packed file either.

    Files of another version have other names.
    """
    packed = {name for series in packs.known(pack) for name in series.names} if pack else set()
    return [t for t in wanted if t.name not in packed and not chunks.is_done(folder, t)]


def work(folder: Path, todo: list[Task], keep: Path | None = None, progress: Progress = SILENT) -> None:
    """Compute chunks one after another in this process."""
    folder.mkdir(parents=True, exist_ok=True)
    for done, task in enumerate(todo):
        progress(done / max(len(todo), 1), f"chunk {done + 1} of {len(todo)}")
        if not chunks.is_done(folder, task):
            chunks.write(folder / task.name, chunks.compute(task, keep))
    progress(1.0, "all chunks are there")


def run_processes(
    folder: Path, todo: list[Task], processes: int, options: list[str], say: Callable[[str], None]
) -> None:
    """Compute chunks by ``processes`` workers of this machine, each beginning with a stripe of them; one BLAS thread each.

    A worker is this program's own ``database work``; it may be killed at any time. Raises FlexMapsError if one fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, **{f"{n}_NUM_THREADS": "1" for n in ("OPENBLAS", "OMP", "MKL")}}
    command = [sys.executable, str(ENTRY), "database", "work", "--dir", str(folder), *options]
    workers = [subprocess.Popen([*command, "--stripe", f"{k}/{processes}"], env=environment) for k in range(processes)]
    start, total, last = time.time(), len(todo), 0.0
    try:
        while any(w.poll() is None for w in workers):
            time.sleep(0.5)
            if time.time() - last > 10.0:
                last = time.time()
                done = sum((folder / t.name).is_file() for t in todo)
                say(f"{done} of {total} chunks{_left(done, total, last - start)}")
    finally:
        for w in workers:
            if w.poll() is None:
                w.terminate()
        for w in workers:
            w.wait()
    failed = [w.returncode for w in workers if w.returncode]
    if failed:
        raise FlexMapsError(
            f"{len(failed)} of {processes} workers stopped with an error; run the same command to go on"
        )


def _left(done: int, total: int, seconds: float) -> str:
    if not done:
        return ""
    left = seconds / done * (total - done)
    return f", about {left / 3600:.1f} h left" if left > 5400 else f", about {left / 60:.0f} min left"


def remote_chunk(root: str, text: str) -> bytes:
    """One chunk on a Dask worker, whose checkout lies at ``root``; sent to it by value, so it needs only Python.

    ``text`` is the task as JSON. Returns the bytes of the chunk's file.
    """
    import importlib.util
    import json
    import os
    import sys

    for name in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{name}_NUM_THREADS", "1")
    if "flexmaps" not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            "flexmaps", os.path.join(root, "__init__.py"), submodule_search_locations=[root]
        )
        assert spec is not None and spec.loader is not None
        package = importlib.util.module_from_spec(spec)
        sys.modules["flexmaps"] = package
        spec.loader.exec_module(package)
    from flexmaps.database import build, chunks  # type: ignore[import-not-found]
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return chunks.compute(build.task_from(json.loads(text)))


# a function of the main module travels by value, so that workers need not be able to import this package by name
remote_chunk.__module__ = "__main__"


def task_from(fields: dict) -> Task:
    """The task that ``dataclasses.asdict`` took apart."""
    return Task(**{**fields, "subject": Subject(**fields["subject"])})


def run_dask(folder: Path, todo: list[Task], address: str, root: str, say: Callable[[str], None]) -> None:
    """Compute chunks on the Dask cluster at ``address``; lost workers' chunks run again elsewhere.

    Raises FlexMapsError where Dask is not installed or the scheduler does not answer.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise FlexMapsError(
            "Dask is not installed; install what requirements/dev.txt names, or leave --scheduler away"
        ) from None
    folder.mkdir(parents=True, exist_ok=True)
    try:
        client = Client(address, timeout="20s")
    except (OSError, ValueError) as error:
        raise FlexMapsError(f"No Dask scheduler answers at {address}: {error}") from None
    start, done = time.time(), 0
    with client:
        futures = {}
        for task in todo:
            text = json.dumps(asdict(task))
            futures[client.submit(remote_chunk, root, text, key=f"flexmaps-{task.name}", retries=3, pure=False)] = task
        for future, data in as_completed(futures, with_results=True):
            chunks.write(folder / futures[future].name, data)
            future.release()
            done += 1
            say(f"{done} of {len(todo)} chunks{_left(done, len(todo), time.time() - start)}")
