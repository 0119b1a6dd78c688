"""Requirements on the zoo as a whole, beside measured values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from harness import Row, at_least, at_most, row

Record = Mapping[str, Any]
Records = Mapping[str, Record]

BEFORE = ("", "read", "check")  # what is refused there is no surface that can be made
LAYOUT = ("trace", "merge", "split")
# most seconds of processor of a stage, or of several together, on surfaces of at most so many quads
SECONDS = {
    "layout": (LAYOUT, 4000, 20.0),
    "spirals": (("spirals",), 4000, 10.0),
    "sheets": (("sheets",), 4000, 10.0),
    "optimise": (("optimise",), 1500, 20.0),
    "optimise, large": (("optimise",), 6100, 60.0),
}
# what was asked of surfaces that went wrong once, and of a large one: patches, seconds, percent, megabytes
NAMED: dict[str, dict[str, float]] = {
    "sphere2": {"patches": 40, "layout": 20.0},
    "cmc1": {"patches": 12},
    "polycastle": {"patches": 25},
    "eight-smoothed-quads": {"patches": 12},
    "octtoruscc2": {"rms_percent": 3.0, "optimise": 20.0},
    "bunny": {"memory_mb": 1500.0},
}
FLAT = 0.02  # share of the strain that the material bears: arms of a piece that did not spring up show less
SMALLEST = 150  # quads: below, what a stage costs whatever the size hides how it grows
SPREAD = 8.0  # the largest must have so many times the quads of the smallest, or an exponent says nothing
GROWTH = 1.2  # n log n between 500 and 6,000 quads


def rows(records: Records) -> list[Row]:
    """The rows of the whole zoo, of the surfaces that figures are asked of by name, and of how the cost grows."""
    whole = {name: r for name, r in records.items() if not is_refused(r)}
    made = {name: r for name, r in whole.items() if r.get("sheets", 0)}
    sizes = np.concatenate([r["sizes"] for r in made.values()]) if made else np.zeros(1)
    known, count = sum(not is_unsolved(r) for r in made.values()), max(len(whole), 1)
    faults = []
    for fault, is_wrong in FAULTS.items():
        found = sorted(name for name, r in records.items() if is_wrong(r))
        faults.append(row("zoo", fault, "0", f"{len(found)}" + (f": {', '.join(found)}" if found else ""), not found))
    return [
        row("zoo", "surfaces", "", f"{len(records)}, {len(records) - len(whole)} refused", None),
        *faults,
        at_least("zoo", "with sheets, %", 100.0, 100.0 * len(made) / count),
        at_least("zoo", "optimised and simulated, %", 98.0, 100.0 * known / count),
        at_least("zoo", "median quads a patch", 40.0, float(np.median(sizes))),
        at_least("zoo", "median over surfaces of that", 40.0, _median(made, "median")),
        *_by_name(records),
        *_times(whole),
        *_growth(made),
    ]


def is_refused(record: Record) -> bool:
    """Return whether a surface failed the checks."""
    return "refused" in record and record["ended_in"] in BEFORE


def is_unsolved(record: Record) -> bool:
    """Return whether it was not simulated, or not optimised although requested."""
    return "rmse_mm" not in record or ("optimise" in record["busy"] and "rmse_mm_before" not in record)


def is_unreported(record: Record) -> bool:
    """Return whether the piece of a curved surface stays flat, its arms hardly strained, without a finding that says so."""
    flat = record.get("rms_percent", 0.0) > 1.0 and (record.get("strain") or 0.0) < FLAT
    return flat and not {"stays-flat", "far-from-target"} & set(record["findings"])


def has_sheets(record: Record) -> bool:
    """Return whether it passed the checks and lies on sheets."""
    return not is_refused(record) and bool(record.get("sheets", 0))


# what no surface shall be, by the names of rows
FAULTS: dict[str, Callable[[Record], object]] = {
    "wrongly refused or wrongly taken": lambda r: is_refused(r) != bool(r.get("to_be_refused")),
    "without sheets": lambda r: not is_refused(r) and not r.get("sheets", 0),
    "not optimised or not simulated": lambda r: has_sheets(r) and is_unsolved(r),
    "tracebacks": lambda r: "traceback" in r,
    "given up or crashed": lambda r: "crashed" in r,
    "worse than they began": lambda r: r.get("worse"),
    "stay flat without a word": lambda r: has_sheets(r) and is_unreported(r),
    "patches of one quad for no reason of its own": lambda r: r.get("alone", 0) > r.get("alone_own_e", 0),
    "panels that cannot be cut": lambda r: r.get("uncuttable", 0),
    "figures that are not finite": lambda r: r.get("not_finite"),
}


def busy_seconds(record: Record, stages: tuple[str, ...] | None = None) -> float:
    """Seconds of processor of some stages, or of all."""
    each = record.get("busy", {})
    return float(sum(each.get(stage, 0.0) for stage in (each if stages is None else stages)))


def _median(records: Records, key: str) -> float:
    return float(np.median([r[key] for r in records.values()])) if records else 0.0


def _by_name(records: Records) -> list[Row]:
    """The figures that are asked of single meshes, those that are there."""
    found = []
    for name, asked in NAMED.items():
        record = next((r for n, r in records.items() if n.endswith(f"/{name}")), None)
        if record is None:
            continue
        for key, limit in asked.items():
            if key in SECONDS:
                found.append(at_most(name, f"{key}, seconds", limit, busy_seconds(record, SECONDS[key][0])))
            else:
                found.append(at_most(name, key, limit, record.get(key, float("nan"))))
    return found


def _times(records: Records) -> list[Row]:
    """The slowest of every stage among those of a size for which a time is asked, and the longest silence."""
    found = []
    for name, (stages, most, limit) in SECONDS.items():
        times = {n: busy_seconds(r, stages) for n, r in records.items() if r.get("quads", 0) <= most}
        if times:
            slowest = max(times, key=lambda n: times[n])
            late = sum(t > limit for t in times.values())
            one = at_most("zoo", f"{name}, seconds, slowest", limit, times[slowest])
            found.append(one | {"peer": {"slowest": slowest, "beyond": late}})
    quiet = {(n, s): t for n, r in records.items() for s, t in r.get("silence", {}).items()}
    if quiet:
        name, stage = max(quiet, key=lambda k: quiet[k])
        late = sum(t > 0.5 for t in quiet.values())
        one = at_most("zoo", "longest without progress, seconds", 0.5, quiet[name, stage])
        found.append(one | {"peer": {"longest": f"{name} in {stage}", "beyond": late}})
    return found


def _growth(records: Records) -> list[Row]:
    """Estimate how the cost of every stage grows with the quads: the exponent, by Siegel's repeated medians, which are robust to outliers."""
    from scipy.stats import siegelslopes

    found = []
    for stage in ("check", "regularise", "trace", "merge", "split", "spirals", "optimise", "simulate", "sheets"):
        pairs = [(r["quads"], busy_seconds(r, (stage,))) for r in records.values() if r["quads"] >= SMALLEST]
        pairs = [(n, t) for n, t in pairs if t > 0.01]
        if len(pairs) >= 8 and max(pairs)[0] >= SPREAD * min(pairs)[0]:
            slope = siegelslopes(*np.log(np.array(pairs, dtype=float)).T[::-1])[0]
            found.append(at_most("zoo", f"cost of {stage} by quads, exponent", GROWTH, float(slope)))
    return found
