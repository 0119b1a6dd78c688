"""The same chunks on a real Dask cluster: a worker is killed on the way, nothing is lost, every byte is the same."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time

from flexmaps.database import build, chunks


def start(arguments: list[str], folder) -> subprocess.Popen:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:], "--no-dashboard"],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def test_killed_worker_costs_nothing(tmp_path, root):
    tasks = [t for t in chunks.tasks({"strain": 6, "newton": 3}) if t.subject.twist == 0][:4]
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    processes = [start(["scheduler", "--host", "127.0.0.1", "--port", str(port)], tmp_path)]
    try:
        time.sleep(3)
        for k in range(2):
            (tmp_path / f"worker{k}").mkdir()
            processes.append(
                start(["worker", address, "--no-nanny", "--nthreads", "1", "--name", str(k)], tmp_path / f"worker{k}")
            )
        seen: list[str] = []

        def say(text: str) -> None:
            seen.append(text)
            if len(seen) == 1:
                processes[1].kill()

        watchdog = threading.Timer(120, lambda: [p.kill() for p in processes])
        watchdog.start()
        build.run_dask(tmp_path / "cluster", tasks, address, str(root), say)
        watchdog.cancel()
        assert processes[1].wait(10) != 0
    finally:
        for p in processes:
            p.kill()
            p.wait()
    assert len(seen) == len(tasks)
    build.work(tmp_path / "alone", tasks)
    for task in tasks:
        assert (tmp_path / "cluster" / task.name).read_bytes() == (tmp_path / "alone" / task.name).read_bytes()
