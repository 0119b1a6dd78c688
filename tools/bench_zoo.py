"""Benchmark of the whole main job on a zoo of surfaces, each in a separate process.

python3 tools/dev.py bench zoo [--only PATTERN,...] [--jobs N] [--limit SECONDS] [--fresh] [--meshes DIR] [--remesh N] [--json FILE]

Records are kept in out/zoo and reused while surface, settings and program are unchanged. The page out/zoo/index.html shows pictures of
all surfaces, those with faults first.
"""

from __future__ import annotations

import argparse
import fnmatch
import hashlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zoo
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import Settings
from flexmaps.engine.surface.formats import meshio
from rows import Row, Table, row
from zoo import summary, trial

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "zoo"
SHARED = ROOT.parent / "shared" / "meshes"
REMESHED = 1200  # quads that are asked for where a file holds triangles
REFUSED = {"moebius_desk": "size-ratio"}  # of the meshes beside the checkout
KINDS = (".obj", ".off", ".ply", ".stl")


@dataclass(frozen=True)
class Task:
    """One surface to run: its name, what makes it, and the key of all that its record depends on."""

    name: str
    surface: zoo.Surface
    key: str
    size: int

    @property
    def path(self) -> Path:
        return OUT / "records" / f"{self.name.replace('/', '--')}.json"

    def earlier(self) -> dict[str, Any] | None:
        """Return the record of an earlier run if nothing has changed since."""
        try:
            record: dict[str, Any] = json.loads(self.path.read_text())
        except (OSError, ValueError):
            return None
        return record if record.get("key") == self.key else None


def main(arguments: list[str]) -> int:
    """Run what has not been run, print a line a surface and the summary; return 0 whatever the figures."""
    options = _options(arguments)
    if options.one:
        return _one(options)
    started = time.monotonic()
    tasks = [task for task in _tasks(options) if task.size <= options.most]
    if importlib.util.find_spec("bpy") is None:
        without = [task.name for task in tasks if task.surface.remesh is not None]
        tasks = [task for task in tasks if task.surface.remesh is None]
        print("left out, for there is no Blender here to remesh them: " + ", ".join(without))
    (OUT / "records").mkdir(parents=True, exist_ok=True)
    records: dict[str, dict[str, Any]] = {}
    if not options.fresh:
        for task in tasks:
            found = task.earlier()
            if found is not None:
                records[task.name] = found
                print(line(task.name, found), flush=True)
    left = sorted((t for t in tasks if t.name not in records), key=lambda t: t.size)
    for task, record in Processes(options).run(left):
        records[task.name] = record
        print(line(task.name, record), flush=True)
    print(f"{len(records)} surfaces, {len(left)} of them run now, {time.monotonic() - started:.0f} s\n")
    table = Table(48)
    table.rows += [_row(task.name, records[task.name]) for task in tasks]
    table.add(*summary.rows(records))
    table.finish(options.json)
    _page(tasks, records, table.rows[len(tasks) :])
    return 0


def _options(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="dev.py bench zoo")
    parser.add_argument("--only", default="*", metavar="PATTERN,...", help="only these surfaces, as genus*,cube")
    parser.add_argument("--most", type=int, default=10**9, metavar="QUADS", help="leave larger surfaces out")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="surfaces at a time")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds after which a surface is given up")
    parser.add_argument("--fresh", action="store_true", help="run again what is known")
    parser.add_argument("--meshes", type=Path, action="append", default=[], help="a folder of meshes, besides the zoo")
    parser.add_argument("--remesh", type=int, help=f"quads for files of triangles; {REMESHED} if not given")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    parser.add_argument("--plain", action="store_true", help="leave the optimiser out: ten times faster")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--key", help=argparse.SUPPRESS)
    return parser.parse_args(arguments)


def _row(name: str, record: dict[str, Any]) -> Row:
    """The row of one surface: all that is known of it; wrong where there is something to say."""
    return row(name, "surface", "", record, not said(record))


def _page(tasks: list[Task], records: dict[str, dict[str, Any]], whole: list[Row]) -> None:
    """Write the pictures of all surfaces and the summary as one page."""
    from zoo import pictures

    cards = []
    for task in tasks:
        record, picture = records[task.name], task.path.with_suffix(".png")
        shown = picture.read_bytes() if picture.is_file() and "patches" in record else None
        cards.append((task.name, figures(record), said(record), shown))
    OUT.joinpath("index.html").write_text(
        pictures.page(whole, cards, time.strftime("%Y-%m-%d %H:%M")), encoding="utf-8"
    )
    print(f"pictures: {OUT / 'index.html'}")


# -- which surfaces ----------------------------------------------------------------------------------------------------


def _surfaces(options: argparse.Namespace) -> dict[str, zoo.Surface]:
    """The zoo, the meshes beside the checkout, and those of the folders that were named; by name."""
    wanted = options.only.split(",")

    def asked(name: str) -> bool:
        return name == options.one or (not options.one and any(fnmatch.fnmatch(name, pattern) for pattern in wanted))

    found = {name: surface for name, surface in zoo.SURFACES.items() if asked(name)}
    for folder in (SHARED, SHARED / "foreign", *options.meshes):
        files = sorted(p for p in folder.iterdir() if p.suffix.lower() in KINDS) if folder.is_dir() else []
        named = {f"{folder.name}/{path.stem}": path for path in files}
        found |= {name: _of_file(path, options.remesh or REMESHED) for name, path in named.items() if asked(name)}
    return found


def _of_file(path: Path, count: int) -> zoo.Surface:
    """A mesh of a file; where it holds anything but quads, it is to be remeshed."""
    try:
        quads = bool((meshio.read(path).sizes == 4).all())
    except FlexMapsError:
        quads = True  # the trial tells what the reader says
    return zoo.Surface(lambda: meshio.read(path), refused=REFUSED.get(path.stem), remesh=None if quads else count)


def _tasks(options: argparse.Namespace) -> list[Task]:
    program = _program()
    tasks = []
    for name, surface in _surfaces(options).items():
        given = f"{surface.supports} {surface.remesh} {options.plain} {program}"
        made = hashlib.sha256(given.encode())
        size = 0
        try:
            polygons = surface.polygons()
            for part in (polygons.vertices, polygons.corners, polygons.sizes):
                made.update(np.ascontiguousarray(part).tobytes())
            size = surface.remesh or len(polygons.sizes)
        except FlexMapsError as error:
            made.update(str(error).encode())
        tasks.append(Task(name, surface, made.hexdigest()[:16], size))
    return tasks


def _program() -> str:
    """Return a hash of everything that the results depend on besides the surface."""
    made = hashlib.sha256()
    folders = [ROOT / "engine", ROOT / "data"]
    parts = [path for folder in folders for path in sorted(folder.rglob("*")) if path.suffix != ".pyc"]
    for path in [*parts, *sorted((ROOT / "bridge" / "hosts").glob("*remesh*.py")), Path(trial.__file__)]:
        if path.is_file():
            made.update(path.read_bytes())
    return made.hexdigest()


# -- running -----------------------------------------------------------------------------------------------------------


def _one(options: argparse.Namespace) -> int:
    """Run one surface in its own process and write its record."""
    import flexmaps

    task = Task(options.one, _surfaces(options)[options.one], options.key, 0)
    if task.surface.remesh is not None:
        flexmaps.register()
    try:
        polygons = task.surface.polygons()
    except FlexMapsError as error:
        trial.write(task.path, {"key": task.key, "refused": str(error), "ended_in": "read"})
        return 0
    record, result = trial.run(
        polygons,
        supports=task.surface.supports,
        remesh=task.surface.remesh,
        optimised=not options.plain,
        part=task.path.with_suffix(".part"),
    )
    if result is not None:
        from zoo import pictures

        task.path.with_suffix(".png").write_bytes(pictures.strip(result, Settings().layout.distortion_limit))
    trial.write(task.path, {"key": task.key, "to_be_refused": task.surface.refused, **record})
    return 0


class Processes:
    """Runs surfaces, each in a process of its own, and ends those that run where the bench is stopped."""

    def __init__(self, options: argparse.Namespace):
        self._options = options
        self._running: set[subprocess.Popen[bytes]] = set()

    def run(self, tasks: list[Task]) -> Iterator[tuple[Task, dict[str, Any]]]:
        """Yield every task with its record as it finishes."""
        pool = ThreadPoolExecutor(self._options.jobs)
        try:
            waiting = {pool.submit(self._one, task): task for task in tasks}
            for done in as_completed(waiting):
                yield waiting[done], done.result()
        finally:  # nothing is left to end unless somebody stopped it
            pool.shutdown(wait=False, cancel_futures=True)
            for process in list(self._running):
                os.killpg(process.pid, signal.SIGKILL)

    def _one(self, task: Task) -> dict[str, Any]:
        """Return the record of a surface; after a crash or timeout it names the stage."""
        part, log = task.path.with_suffix(".part"), task.path.with_suffix(".log")
        for path in (task.path, part):
            path.unlink(missing_ok=True)
        late = False
        with log.open("w") as stream:
            process = subprocess.Popen(
                self._command(task),
                env=dict(os.environ, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1"),
                stdout=stream,
                stderr=stream,
                start_new_session=True,
            )
            self._running.add(process)
            try:
                process.wait(self._options.limit)
            except subprocess.TimeoutExpired:
                late = True
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            self._running.discard(process)
        record = task.earlier()
        if record is None:
            reached = json.loads(part.read_text()) if part.is_file() else {"stage": "check", "wall": {}, "busy": {}}
            why = f"given up after {self._options.limit:g} s" if late else f"ended with status {process.returncode}"
            record = {"key": task.key, "quads": task.size, "crashed": why, "ended_in": reached.pop("stage"), **reached}
            if late:
                trial.write(task.path, record)  # what crashed is tried again the next time
            else:
                record["traceback"] = log.read_text()[-4000:] or why
        for path in (part, log):
            path.unlink(missing_ok=True)
        return record

    def _command(self, task: Task) -> list[str]:
        options = self._options
        made = [sys.executable, str(ROOT / "tools" / "dev.py"), "bench", "zoo", "--one", task.name, "--key", task.key]
        made += ["--plain"] if options.plain else []
        made += [word for folder in options.meshes for word in ("--meshes", str(folder))]
        return made + (["--remesh", str(options.remesh)] if options.remesh else [])


# -- what is printed ---------------------------------------------------------------------------------------------------


def line(name: str, record: dict[str, Any]) -> str:
    """Format one row of the table."""
    return f"{name:<30}{figures(record)}, {record.get('memory_mb', 0):.0f} MB  {said(record)}"


def figures(record: dict[str, Any]) -> str:
    """The figures of a surface in a few words."""
    if "patches" not in record:
        return f"{record.get('quads', 0)} quads"
    words = [
        f"{record['quads']} quads in {record['patches']} panels of {record['smallest']} or more",
        f"E {record['e_max']:.3f}",
        f"RMSE {_figure(record.get('rmse_mm_before'), 3)} > {_figure(record.get('rmse_mm'), 3)} mm",
        f"RMS {_figure(record.get('rms_percent'), 2)} %",
        f"strain {_figure(record.get('strain'), 2)}",
        f"{sum(record['busy'].values()):.0f} s",
    ]
    return ", ".join(words)


def said(record: dict[str, Any]) -> str:
    """Describe the failure of a surface in one line; empty if there is none, or if it was to be refused."""
    words = []
    wanted = record.get("to_be_refused")
    if wanted and wanted in record.get("findings", []) and summary.refused(record):
        return ""
    if "crashed" in record:
        words.append(f"{record['crashed']} in {record['ended_in']}")
    if "traceback" in record:
        words.append(f"traceback in {record['ended_in']}: {record['traceback'].strip().splitlines()[-1][:120]}")
    if wanted:
        words.append(f"not refused as {wanted}")
    if "refused" in record:
        words.append(f"refused in {record['ended_in']}: {record['refused'][:120]}")
    words += [text[:120] for text in record.get("left_out", [])]
    if record.get("alone", 0) > record.get("alone_own_e", 0):
        words.append(f"{record['alone']} patches of one quad")
    if record.get("uncuttable"):
        words.append(f"{record['uncuttable']} panels cannot be cut")
    if record.get("worse"):
        words.append("worse than it began")
    if record.get("farther"):
        words.append(f"farther than it began (RMS {record['rms_percent_before']:.2f} %)")
    if summary.unsaid(record):
        words.append("stays flat without a word")
    if record.get("not_finite"):
        words.append("not finite: " + ", ".join(record["not_finite"]))
    return "; ".join(words)


def _figure(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
