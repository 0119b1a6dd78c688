"""Benchmark of explorations: minutes on this machine's cores, and speed-up on a Dask cluster.

python3 tools/dev.py bench explore [--candidates 200] [--cores 2] [--cluster] [--json FILE]

It tries 200 candidates in four variables on a surface of 432 quads. With ``--cluster``, ``--cores`` workers on this machine try a
part of them, and one worker alone the same part; the speed-up should be near the number of workers. The required minutes hold
for an idle machine; on a busy one, compare the processor seconds.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from flexmaps import api
from harness import Bench, processor
from rows import Row, at_least, at_most, note, row

SHAPE = "demo"  # built-in surface with about 400 quads
VARY = {"edge": "12:24", "spiral.thickness": "1:3", "spiral.width_max": "1.2:2.4"}
VARY["material.material"] = "pom,birch,acrylic"
MINUTES = 15.0  # required for 200 candidates on two cores
SHARE = 0.8  # required speed-up as a share of the number of workers
PART = 24  # candidates for the comparison with one worker: the initial samples and two full batches


def main(arguments: list[str]) -> int:
    """Explore, print the table and write the rows; return 0 whatever the figures."""
    candidates, cores = (200, "candidates to try"), (2, "workers on this machine")
    cluster = (False, "compare a cluster of them with one worker")
    bench = Bench("explore", arguments, 34, candidates=candidates, cores=cores, cluster=cluster)
    options = bench.options
    piece = api.layout(api.load(f"shape:{SHAPE}", edge=16))
    began = processor()
    seconds, made = explore_piece(piece, options.candidates, cores=options.cores)
    each = (processor() - began) / max(len(made.candidates), 1)
    name, faults = f"{SHAPE} {len(piece.mesh.quads)}", sum(bool(one.fault) for one in made.candidates)
    asked = MINUTES if (options.candidates, options.cores) == (200, 2) else None
    bench.table.add(
        note(name, "candidates", len(made.candidates)),
        note(name, "candidates that could not be made", faults),
        at_most(name, f"minutes on {options.cores} cores", asked, seconds / 60.0),
        at_most(name, "processor seconds a candidate", 60.0 * MINUTES * 2 / 200, round(each, 2)),
    )
    return bench.finish(*(on_cluster(piece, options.cores, name) if options.cluster else ()))


def explore_piece(piece: Any, count: int, **where: Any) -> tuple[float, Any]:
    """Explore; return the seconds and the result."""
    begun = time.perf_counter()
    made = api.explore(piece, VARY, candidates=count, **where)
    return time.perf_counter() - begun, made


def on_cluster(piece: Any, workers: int, name: str) -> Iterator[Row]:
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
        yield note(name, f"seconds on a cluster of {count}", round(took, 1))
    yield row(name, "the same candidates", "", found[0] == found[1], found[0] == found[1])
    yield at_least(name, f"speed of {workers} workers over one", SHARE * workers, seconds[0] / seconds[1])
