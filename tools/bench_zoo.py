"""Benchmark of the whole main job on a zoo of surfaces, each in a separate process.

Records are kept in out/zoo and reused while surface, settings and program are unchanged. The page out/zoo/index.html shows pictures of
all surfaces, those with faults first.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import flexmaps
import numpy as np
import zoo
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import Settings
from harness import (
    MESHES,
    ONE_THREAD,
    ROOT,
    Bench,
    Cases,
    Options,
    Row,
    Rows,
    checksum,
    from_folder,
    matches,
    row,
    run_python,
)
from zoo import pictures, summary, trial

OUT = ROOT / "out" / "zoo"
REMESHED = 1200  # quads that are asked for where a file holds triangles
REFUSED = {"moebius_desk": "size-ratio"}  # of the meshes beside the checkout
Record = dict[str, Any]
records: dict[str, Record] = {}  # of all surfaces of this run


@dataclass(frozen=True)
class Task:
    """One surface to run; remesh : into so many quads; key : of all that its record depends on."""

    name: str
    surface: zoo.Surface
    remesh: int | None
    key: str
    size: int

    @property
    def path(self) -> Path:
        return OUT / "records" / f"{self.name.replace('/', '--')}.json"

    def earlier(self) -> Record | None:
        """Return the record of an earlier run if nothing has changed since."""
        record: Record = json.loads(self.path.read_text()) if self.path.is_file() else {}
        return record if record.get("key") == self.key else None


def tasks(pattern: str, plain: bool) -> list[Task]:
    """Return the surfaces of the zoo and the meshes beside the checkout that fit, the small ones first."""
    surfaces = dict(zoo.SURFACES)
    for folder in (MESHES, MESHES / "foreign"):
        for stem, read in from_folder(folder).items():
            surfaces[f"{folder.name}/{stem}"] = zoo.Surface(read, refused=REFUSED.get(stem), remesh=REMESHED)
    found = [_task(name, one, plain) for name, one in surfaces.items() if matches(name, pattern.split(","))]
    return sorted(found, key=lambda task: task.size)


def _task(name: str, surface: zoo.Surface, plain: bool) -> Task:
    program = checksum("engine", "data", "bridge/hosts", "tools/zoo/trial.py")
    made = hashlib.sha256(f"{surface.supports} {surface.remesh} {plain} {program}".encode())
    size, remesh = 0, None
    try:
        polygons = surface.polygons()
        remesh = surface.remesh if (polygons.sizes != 4).any() else None  # what holds anything but quads
        size = remesh or len(polygons.sizes)
        for part in (polygons.vertices, polygons.corners, polygons.sizes):
            made.update(np.ascontiguousarray(part).tobytes())
    except FlexMapsError as error:
        made.update(str(error).encode())
    return Task(name, surface, remesh, made.hexdigest()[:16], size)


def cases(options: Options) -> Cases:
    """Start all surfaces, some at a time; a case waits for its record."""
    if options.one:
        return {options.one: run_one}
    (OUT / "records").mkdir(parents=True, exist_ok=True)
    pool, asked = ThreadPoolExecutor(options.jobs), tasks(options.only, options.plain)
    return {task.name: partial(wait, pool, task.name, pool.submit(record_of, task, options)) for task in asked}


def wait(pool: ThreadPoolExecutor, name: str, future: Future[Record], _: Options) -> Rows:
    """Return the row of a surface as soon as its record is there; nothing else is started where the bench is stopped."""
    try:
        record = records[name] = future.result()
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    wrong, shown = said(record), figures(record)
    shown |= {"": wrong} if wrong else {}
    yield row(name, "processor seconds", "", round(summary.busy_seconds(record)), not wrong, shown)


def record_of(task: Task, options: Options) -> Record:
    """Run a surface in a process of its own unless its record is there; after a crash or timeout it names the stage."""
    earlier = None if options.fresh else task.earlier()
    if earlier is not None:
        return earlier
    part, late, log = task.path.with_suffix(".part"), False, ""
    for path in (task.path, part):
        path.unlink(missing_ok=True)
    words = ("tools/dev.py", "bench", "zoo", "--one", task.name, *["--plain"] * options.plain)
    try:
        done = run_python(*words, env=ONE_THREAD, timeout=options.limit)
        why, log = f"ended with status {done.returncode}", done.stdout + done.stderr
    except subprocess.TimeoutExpired:
        why, late = f"given up after {options.limit:g} s", True
    record = task.earlier()
    if record is None:
        reached = json.loads(part.read_text()) if part.is_file() else {"stage": "check", "wall": {}, "busy": {}}
        record = {"key": task.key, "quads": task.size, "crashed": why, "ended_in": reached.pop("stage"), **reached}
        if late:
            trial.write(task.path, record)  # what crashed is tried again the next time
        else:
            record["traceback"] = log[-4000:] or why
    part.unlink(missing_ok=True)
    return record


def run_one(options: Options) -> Rows:
    """Run one surface in this process and write its record."""
    (task,) = (task for task in tasks(options.one, options.plain) if task.name == options.one)
    surface = task.surface
    if task.remesh is not None:
        flexmaps.register()
    how: dict[str, Any] = {"supports": surface.supports, "remesh": task.remesh, "optimised": not options.plain}
    record, result = trial.run(surface.polygons, **how, part=task.path.with_suffix(".part"))
    if result is not None:
        picture = pictures.strip(result, Settings().layout.distortion_limit)
        task.path.with_suffix(".png").write_bytes(picture)
    trial.write(task.path, {"key": task.key, "to_be_refused": surface.refused, **record})
    return []


def figures(record: Record) -> dict[str, Any]:
    """Return the figures of a surface that are shown."""
    names = {"quads": "quads", "patches": "panels", "e_max": "E", "rmse_mm": "RMSE mm", "rms_percent": "RMS %"}
    names |= {"strain": "strain", "memory_mb": "MB"}
    found = {name: record[key] for key, name in names.items() if record.get(key) is not None}
    return {name: float(f"{value:.3g}") if isinstance(value, float) else value for name, value in found.items()}


def said(record: Record) -> str:
    """Describe the failure of a surface in one line; empty if there is none, or if it was to be refused."""
    wrong = [name for name, is_wrong in summary.FAULTS.items() if is_wrong(record)]
    texts = [record.get("crashed", ""), record.get("traceback", "").strip(), record.get("refused", "")]
    reasons = [text.splitlines()[-1][:120] for text in (*texts, *record.get("left_out", ())) if text]
    return "; ".join([*wrong, f"in {record['ended_in']}", *reasons]) if wrong else ""


def sum_up(_: list[Row], options: Options) -> Rows:
    """Return the rows of the whole zoo, and write them and the pictures of all surfaces as one page."""
    if options.one:
        return []
    rows, cards = summary.rows(records), []
    for name, record in records.items():
        picture = OUT / "records" / f"{name.replace('/', '--')}.png"
        shown = picture.read_bytes() if picture.is_file() and "patches" in record else None
        words = ", ".join(f"{value} {key}" for key, value in figures(record).items())
        cards.append((name, words, said(record), shown))
    page = pictures.page(rows, cards, time.strftime("%Y-%m-%d %H:%M"))
    OUT.joinpath("index.html").write_text(page, encoding="utf-8")
    print(f"pictures: {OUT / 'index.html'}")
    return rows


main = Bench(
    "zoo", cases, summary=sum_up, jobs=(os.cpu_count() or 1, "surfaces at a time"),
    limit=(900.0, "seconds after which a surface is given up"), fresh=(False, "run again what is known"),
    plain=(False, "leave the optimiser out: ten times faster"), one=("", "run this surface alone in this process"),
)  # fmt: skip
