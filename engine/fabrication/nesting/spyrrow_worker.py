"""Run spyrrow as a separate program for ``nesting`` and report every better strip, so that it can be stopped at once.

Reads one task per line as JSON, writes one solution per line, its width and the place of every item, then an empty
line.
"""

import json
import sys
import threading


def main() -> None:
    """Solve tasks until the input ends."""
    sys.path[:0] = json.loads(sys.stdin.readline())
    import spyrrow

    feasible = (spyrrow.ReportType.ExplFeas, spyrrow.ReportType.CmprFeas, spyrrow.ReportType.Final)
    for line in sys.stdin:
        task = json.loads(line)
        items = [spyrrow.Item(name, [tuple(p) for p in shape], 1, turns) for name, shape, turns in task["items"]]
        strip = spyrrow.StripPackingInstance("", task["high"], items)
        config = spyrrow.StripPackingConfig(
            total_computation_time=task["seconds"],
            num_workers=1,
            seed=task["seed"],
        )
        queue, done = spyrrow.ProgressQueue(), threading.Event()
        threading.Thread(target=solve, args=(strip, config, queue, done), daemon=True).start()
        best, ended = float("inf"), False
        while not ended:
            ended = done.wait(0.02)
            for kind, solution in queue.drain():
                if kind in feasible and solution.width < best:
                    best = solution.width
                    print(
                        json.dumps([best, [[p.id, p.rotation, p.translation] for p in solution.placed_items]]),
                        flush=True,
                    )
        print(flush=True)


def solve(strip, config, queue, done):  # type: ignore[no-untyped-def]  # spyrrow's
    """Search in a thread."""
    try:
        strip.solve(config, queue)
    except BaseException:  # a panic in the Rust code raises a BaseException; there is no solution then
        pass
    finally:
        done.set()


if __name__ == "__main__":
    main()
