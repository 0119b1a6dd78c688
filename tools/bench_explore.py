"""Benchmark of explorations: minutes on this machine's cores, and speed-up on a Dask cluster.

With ``--cluster``, ``--cores`` workers on this machine try a part of the candidates, and one worker alone the same part. The required
minutes hold for an idle machine; on a busy one, compare the processor seconds.
"""

from __future__ import annotations

import time
from typing import Any

from flexmaps import api
from harness import Bench, Options, Rows, at_least, at_most, measure_time, note, processor_seconds, row

SHAPE = "demo"  # built-in surface with about 400 quads
VARY = {"edge": "12:24", "spiral.thickness": "1:3", "spiral.width_max": "1.2:2.4"}
VARY["material.material"] = "pom,birch,acrylic"
CANDIDATES, CORES, MINUTES = 200, 2, 15.0  # required: so many on these cores in these minutes
SHARE = 0.8  # required speed-up as a share of the number of workers
PART = 24  # candidates for the comparison with one worker: the initial samples and two full batches


def explore(options: Options) -> Rows:
    """Explore, on a cluster too if asked."""
    piece = api.layout(api.load(f"shape:{SHAPE}", edge=16))
    name, began, count = f"{SHAPE} {len(piece.mesh.quads)}", processor_seconds(), options.candidates
    seconds, made = explore_piece(piece, count, cores=options.cores)
    each = (processor_seconds() - began) / max(len(made.candidates), 1)
    asked = MINUTES if (count, options.cores) == (CANDIDATES, CORES) else None
    faults = {"could not be made": sum(bool(one.fault) for one in made.candidates)}
    yield note(name, "candidates", len(made.candidates), faults)
    yield at_most(name, f"minutes on {options.cores} cores", asked, seconds / 60.0)
    yield at_most(name, "processor seconds a candidate", 60.0 * MINUTES * CORES / CANDIDATES, each)
    if options.cluster:
        yield from on_cluster(piece, options.cores, name)


def explore_piece(piece: Any, count: int, **where: Any) -> tuple[float, Any]:
    """Explore; return the seconds of the clock and the result."""
    return measure_time(lambda: api.explore(piece, VARY, candidates=count, **where), time.perf_counter)


def on_cluster(piece: Any, workers: int, name: str) -> Rows:
    """Explore with one worker and with several; return the seconds and the speed-up."""
    from distributed import LocalCluster

    seconds, found = [], []
    for count in (1, workers):
        with LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as cluster:
            address = cluster.scheduler_address
            # load the program on all workers before measuring
            explore_piece(piece, 2 * count, scheduler=address)
            took, made = explore_piece(piece, PART, scheduler=address)
        seconds.append(took)
        found.append(made.report())
    peer = {"seconds": " ".join(f"{one:.1f}" for one in seconds)}
    yield row(name, "the same candidates", "", found[0] == found[1], found[0] == found[1])
    yield at_least(name, f"speed of {workers} workers over one", SHARE * workers, seconds[0] / seconds[1], peer)


main = Bench(
    "explore", {"explore": explore}, patterns=None,
    candidates=(CANDIDATES, "candidates to try"), cores=(CORES, "workers on this machine"),
    cluster=(False, "compare a cluster of them with one worker"),
)  # fmt: skip
