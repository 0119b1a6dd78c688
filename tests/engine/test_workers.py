"""Functions called in processes: answers in order, errors, processes that end, and a stop."""

from __future__ import annotations

import math
import operator
import os
import subprocess
import sys
import textwrap
import time
from functools import partial

import pytest
from flexmaps.engine import workers as module
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.surface import shapes
from flexmaps.engine.workers import WorkerDied, Workers, as_completed

needs_python = pytest.mark.skipif(module.python_path() is None, reason="this program is no Python")


def test_answers_come_in_the_order_of_the_items() -> None:
    with Workers(3) as together:
        assert together(math.factorial, list(range(12)), SILENT) == [math.factorial(n) for n in range(12)]
        # the engine's own functions are found there under the name that they have here
        names = ["dome", "strip"]
        meshes = together(shapes.make, names, SILENT)
        assert [len(mesh.quads) for mesh in meshes] == [len(shapes.make(name).quads) for name in names]


@needs_python
def test_work_is_done_in_other_processes_of_one_thread() -> None:
    with Workers(2) as together:
        ids = together(eval, ["__import__('os').getpid()"] * 6, SILENT)
        assert os.getpid() not in ids
        assert 1 <= len(set(ids)) <= 2
        assert together(os.getenv, ["OMP_NUM_THREADS"] * 2, SILENT) == ["1", "1"]


def test_what_a_function_raises_is_raised_here_that_of_the_first_item() -> None:
    with Workers(2) as together:
        with pytest.raises(FlexMapsError, match=r"no built-in shape|no shape"):
            together(shapes.make, ["dome", "no such shape"], SILENT)
        with pytest.raises(ZeroDivisionError):
            together(eval, ["1", "1 / 0", "int('x')"], SILENT)
        assert together(math.sqrt, [4.0, 9.0], SILENT) == [2.0, 3.0]  # the processes are still there


@needs_python
def test_a_process_that_ends_is_started_again_and_in_the_end_named() -> None:
    with Workers(2) as together:
        with pytest.raises(FlexMapsError, match="ended by itself"):
            together(os._exit, [1, 1], SILENT)
        assert together(math.sqrt, [4.0, 9.0], SILENT) == [2.0, 3.0]


@needs_python
def test_a_stop_ends_what_is_being_done() -> None:
    begun = time.monotonic()

    def stopped() -> bool:
        return time.monotonic() > begun + 0.5

    with Workers(2) as together, pytest.raises(Cancelled):
        together(time.sleep, [300.0, 300.0], Progress(stopped=stopped))
    assert (
        time.monotonic() - begun < 100.0
    )  # of 300 seconds of sleep; the test's own limit, however busy the machine is


def test_one_alone_works_here() -> None:
    with Workers(1) as together:
        assert together(partial(pow, 2), [3, 4], SILENT) == [8, 16]
        assert together(eval, ["__import__('os').getpid()"] * 2, SILENT) == [os.getpid()] * 2
    with Workers(4) as together:
        assert together(math.sqrt, [], SILENT) == []


@pytest.fixture(scope="module")
def workers():
    with Workers(2) as made:
        yield made


def alive(pid: int) -> bool:
    """Whether a process is there that has not ended."""
    try:
        with open(f"/proc/{pid}/stat") as told:
            return told.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def gone(pid: int) -> bool:
    """Whether a process ends within a while."""
    ends = time.monotonic() + 20
    while alive(pid) and time.monotonic() < ends:
        time.sleep(0.05)
    return not alive(pid)


def test_a_process_that_breaks_off_loses_only_its_item(workers):
    calls = [partial(pow, 2, 5), partial(os._exit, 3), *(partial(pow, 2, k) for k in range(6))]
    found = dict(as_completed(workers, operator.call, calls))
    assert isinstance(found[1].exception(), WorkerDied)
    assert [found[k].result() for k in (0, *range(2, 8))] == [32, *(2**k for k in range(6))]


def test_a_stop_ends_what_is_under_way(workers):
    pids = set(workers(operator.methodcaller("__call__"), [os.getpid] * 8))
    asked = iter([False] * 4 + [True] * 100)
    started = time.monotonic()
    with pytest.raises(Cancelled):
        workers(time.sleep, [600.0] * 4, Progress(stopped=lambda: next(asked)))
    assert time.monotonic() - started < 300  # it did not wait for what was under way
    assert all(map(gone, pids))
    assert workers(abs, [-1, 2]) == [1, 2]  # and goes on afterwards


def test_nothing_is_left_behind_one_that_is_killed(root):
    program = textwrap.dedent(f"""
        import sys, time, os
        sys.path.append({str(root / "tools")!r})
        import dev
        dev.load_package()
        from flexmaps.engine.workers import Workers
        workers = Workers(2)
        print(workers.submit(os.getpid).result(), flush=True)
        for _ in range(2):
            workers.submit(time.sleep, 600)
        print("asked", flush=True)
        time.sleep(600)
    """)
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    parent.stdout.readline()
    assert alive(pid)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert gone(pid)


def test_without_a_python_everything_runs_here(monkeypatch):
    monkeypatch.setattr(module, "python_path", lambda: None)
    with Workers(4) as made:
        assert made(operator.methodcaller("__call__"), [os.getpid] * 3) == [os.getpid()] * 3
        assert "one process" in made.note


def test_a_package_of_another_name_is_found(root, tmp_path):
    """As Blender has it: bl_ext.somewhere.flexmaps, with parents that are no files."""
    program = textwrap.dedent(f"""
        import importlib, sys
        sys.path.append({str(root / "engine")!r})
        import worker
        worker.import_package("bl_ext.here.flexmaps", {str(root)!r})
        workers = importlib.import_module("bl_ext.here.flexmaps.engine.workers")
        params = importlib.import_module("bl_ext.here.flexmaps.engine.params")
        sys.path.remove({str(root / "engine")!r})
        with workers.Workers(2) as made:
            found, _ = made(params.LayoutParams, [0.02, 0.03])
        print(type(found).__module__, found.distortion_limit, made.note)
    """)
    told = subprocess.run(
        [sys.executable, "-P", "-c", program], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert told.stdout.split() == ["bl_ext.here.flexmaps.engine.params.surface_params", "0.02"], told.stderr
