"""Functions called on a real Dask cluster: a worker is killed on the way, nothing is lost, all is as it is without one."""

from __future__ import annotations

import math
import os
import socket
import subprocess
import sys
import time

import pytest
from flexmaps.engine import cluster as module
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.exploring.candidate import ExplorationInput, StartSurface
from flexmaps.engine.extras.exploring.explore import explore
from flexmaps.engine.extras.exploring.space import make_space
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.workers import Workers, as_completed


@pytest.fixture(scope="module")
def processes(tmp_path_factory):
    """A scheduler and two workers; the address first, then the processes."""
    folder = tmp_path_factory.mktemp("cluster")
    made = []

    def start(kind, *words):
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words, "--no-dashboard"]
        made.append(subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    try:
        start("scheduler", "--host", "127.0.0.1", "--port", str(port))
        ends = time.monotonic() + 60
        while time.monotonic() < ends:
            with socket.socket() as tried:
                if tried.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.1)
        for k in range(2):
            start("worker", address, "--no-nanny", "--nthreads", "1", "--name", str(k))
        yield address, made
    finally:
        for process in made:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(processes):
    with module.Cluster(processes[0]) as made:
        yield made


def test_answers_and_errors_come_back_as_themselves(cluster):
    assert [f.result() for _, f in sorted(as_completed(cluster, math.factorial, [1, 5, 9]))] == [1, 120, 362880]
    found = dict(as_completed(cluster, shapes.make, ["dome", "no such shape"]))
    assert len(found[0].result().quads) == len(shapes.make("dome").quads)
    assert isinstance(found[1].exception(), FlexMapsError)
    assert isinstance(dict(as_completed(cluster, eval, ["1 / 0"]))[0].exception(), ZeroDivisionError)
    pids = {f.result() for _, f in as_completed(cluster, eval, ["__import__('os').getpid()"] * 8)}
    assert os.getpid() not in pids


def test_workers_of_another_version_are_refused(processes, monkeypatch):
    monkeypatch.setattr(module, "source_checksum", lambda *_: "another one")
    with pytest.raises(FlexMapsError, match="another version of FlexMaps") as told:
        module.Cluster(processes[0])
    assert "\n" not in str(told.value)


def test_a_folder_without_the_program_is_named(processes, tmp_path):
    with pytest.raises(FlexMapsError, match="cannot be used"):
        module.Cluster(processes[0], tmp_path)


def test_a_cluster_that_is_not_there_is_said(monkeypatch):
    monkeypatch.setattr(module, "CONNECTION_SECONDS", 1)
    with pytest.raises(FlexMapsError, match="No Dask scheduler answers"):
        module.Cluster("tcp://127.0.0.1:9")


def test_dask_that_is_missing_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(FlexMapsError, match="Dask is not installed"):
        module.Cluster("tcp://127.0.0.1:9")


def test_a_killed_worker_costs_nothing(processes):
    """The last of the tests here that use the cluster: a worker less is left."""
    address, made = processes
    settings = ObjectSettings()
    result = job.run_stages(
        job.check_input(PolygonMesh.from_quads(shapes.strip(12)), edge=0.02), settings, ("trace", "merge")
    )
    base = ExplorationInput({0: StartSurface(result.mesh, result.flat.layout.cut)}, settings, effort=0.02)
    asked = make_space({"edge": "15:25", "spiral.thickness": "1:2"}, settings)
    found = []

    def tell(one):
        found.append(one)
        if len(found) == 1:
            made[1].kill()

    with module.Cluster(address) as cluster:
        far = explore(base, asked, 3, cluster, found=tell)
    assert made[1].wait(20) != 0
    with Workers(2) as workers:
        here = explore(base, asked, 3, workers)
    assert far.report() == here.report()
    assert not any(one.fault for one in far.candidates)
