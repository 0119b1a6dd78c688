"""Functions called in processes: answers in order, errors, processes that end, and a stop."""

from __future__ import annotations

import math
import os
import time
from functools import partial

import pytest
from flexmaps.engine import workers as module
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.surface import shapes
from flexmaps.engine.workers import Workers

needs_python = pytest.mark.skipif(module.python() is None, reason="this program is no Python")


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
        with pytest.raises(FlexMapsError, match="no built-in shape|no shape"):
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
    assert time.monotonic() - begun < 100.0  # of 300 seconds of sleep; the test's own limit, however busy the machine is


def test_one_alone_works_here() -> None:
    with Workers(1) as together:
        assert together(partial(pow, 2), [3, 4], SILENT) == [8, 16]
        assert together(eval, ["__import__('os').getpid()"] * 2, SILENT) == [os.getpid()] * 2
    with Workers(4) as together:
        assert together(math.sqrt, [], SILENT) == []
