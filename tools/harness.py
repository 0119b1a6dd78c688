"""The one harness of the benches: a table of cases, what measures a case, and the rows beside their wanted values.

A bench is ``main = Bench(name, cases, measure)``. ``Bench`` makes the options, leaves out the cases that are not asked for or are
known, names those that are refused, prints every row as it comes and writes the file.
"""

from __future__ import annotations

import argparse
import fnmatch
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import Settings, with_values
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh

ROOT = Path(__file__).resolve().parent.parent
MESHES = ROOT.parent / "shared" / "meshes"  # larger meshes beside the checkout
FORMATS = (".obj", ".off", ".ply", ".stl")
EDGE = 0.02  # metres, quads of all surfaces
WIDTH = 48  # of the rows' names
Cases = dict[str, Callable[..., Any]]  # what makes each, by name
Options = argparse.Namespace
Row = dict[str, Any]
Rows = Iterable[Row]
Peer = dict[str, Any] | None
ONE_THREAD = dict(os.environ, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")


# -- cases ---------------------------------------------------------------------------------------------------------------


def surfaces(options: Options) -> Cases:
    """Return the surfaces that the project makes, and the meshes of the folder that the options name."""
    return {f"made:{name}": partial(built_in, name) for name in shapes.NAMES} | from_folder(options.meshes)


def built_in(name: str) -> PolygonMesh:
    """Return one of the surfaces that the project makes, with quads of 20 mm."""
    return PolygonMesh.from_quads(shapes.make(name, EDGE))


def from_zoo(*names: str) -> Cases:
    """Return surfaces of the zoo by name; those that it does not have are left out."""
    import zoo

    return {name: zoo.SURFACES[name].polygons for name in names if name in zoo.SURFACES}


def from_folder(folder: Path | None, pattern: str = "*") -> Cases:
    """Return the meshes of a folder by the stems of their names; none without a folder."""
    paths = sorted(folder.glob(pattern)) if folder is not None else []
    return {path.stem: partial(meshio.read_mesh, path) for path in paths if path.suffix.lower() in FORMATS}


def for_each(measure: Callable[..., Iterable[Row]], cases: Mapping[str, Callable[..., Any]]) -> Cases:
    """Return cases that give the rows of what those cases make: ``measure(name, case(), options)``."""
    return {
        name: lambda options, name=name, case=case: measure(name, case(), options)  # type: ignore[misc]
        for name, case in cases.items()
    }


def matches(name: str, patterns: list[str]) -> bool:
    """Return whether the name of a case fits one of the patterns; "cube 3", of several of a surface, fits "cube" too."""
    return any(fnmatch.fnmatch(one, pattern) for one in (name, name.rpartition(" ")[0]) for pattern in patterns)


def from_blender(add: Callable[[], Any]) -> PolygonMesh:
    """Return the object that is added to an empty file of Blender, with its modifiers applied."""
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add()
    mesh = bpy.context.object.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points = np.array([vertex.co for vertex in mesh.vertices])
    corners = np.array([loop.vertex_index for loop in mesh.loops])
    return PolygonMesh(points, corners, np.array([polygon.loop_total for polygon in mesh.polygons]))


# -- measuring -----------------------------------------------------------------------------------------------------------


def run_job(polygons: PolygonMesh, stop_after: str = job.STAGE_NAMES[-1], /, **options: Any) -> Any:
    """Run the main job on a surface with quads of 20 mm.

    ``values`` of the options are settings; the result's optional values have no types here, for a bench knows how far it went.
    """
    settings = with_values(Settings(), options.pop("values", {}))
    return job.run(polygons, settings, edge=EDGE, stop_after=stop_after, **options)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Give a folder that is gone afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def processor_seconds() -> float:
    """Return the processor seconds of this process and of its finished child processes."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def measure_time(action: Callable[[], Any], clock: Callable[[], float] = time.process_time) -> tuple[float, Any]:
    """Return the seconds that an action takes, of the processor unless another clock is given, and its result."""
    began = clock()
    result = action()
    return clock() - began, result


def fewest_seconds(action: Callable[[], Any], repeats: int = 1) -> float:
    """Return the fewest processor seconds that an action takes in several runs."""
    return min(measure_time(action)[0] for _ in range(repeats))


def run_python(*words: object, python: str = sys.executable, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run Python with these words in a process of its own, in the checkout, and return what it printed."""
    command = [python, *map(str, words)]
    usual: dict[str, Any] = {"capture_output": True, "text": True, "cwd": ROOT}
    return subprocess.run(command, **usual | options)


@cache
def checksum(*places: str) -> str:
    """Return a checksum of Python's version and of all files below places of the checkout, on which stored answers depend."""
    made = hashlib.sha256(sys.version.encode())
    for path in sorted(path for place in places for path in (ROOT / place, *(ROOT / place).rglob("*"))):
        if path.is_file() and path.suffix != ".pyc":
            made.update(path.read_bytes())
    return made.hexdigest()[:16]


class StoredResults(dict[str, Any]):
    """Answers by key in a JSON file, with which an interrupted bench goes on; without a path they are not stored."""

    def __init__(self, path: Path | None):
        super().__init__(json.loads(path.read_text()) if path is not None and path.is_file() else {})
        self._path = path

    def answer(self, key: str, make: Callable[[], Any]) -> Any:
        """Return the answer to a key; a new one is made and stored, the whole file or nothing."""
        if key not in self:
            self[key] = make()
            if self._path is not None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                fresh = self._path.with_suffix(".new")
                fresh.write_text(json.dumps(self, indent=1) + "\n")
                fresh.replace(self._path)
        return self[key]


# -- rows ---------------------------------------------------------------------------------------------------------------


def row(mesh: str, name: str, asked: str, measured: Any, ok: bool | None, peer: Peer = None) -> Row:
    """Make one row; ``ok`` is None without a required value."""
    return {"mesh": mesh, "row": name, "asked": asked, "measured": measured, "peer": peer or {}, "ok": ok}


def note(mesh: str, name: str, measured: Any, peer: Peer = None) -> Row:
    """A row without a required value."""
    return row(mesh, name, "", measured, None, peer)


def at_most(mesh: str, name: str, limit: float | None, measured: float, peer: Peer = None) -> Row:
    """A row whose figure may not exceed ``limit``; NaN never passes."""
    measured = float(f"{measured:.4g}") if isinstance(measured, float) else int(measured)
    if limit is None:
        return note(mesh, name, measured, peer)
    return row(mesh, name, f"<= {limit:g}", measured, bool(measured <= limit * (1 + 1e-9)), peer)


def at_least(mesh: str, name: str, limit: float, measured: float, peer: Peer = None) -> Row:
    """A row whose figure must reach ``limit``."""
    return row(mesh, name, f">= {limit:g}", float(f"{measured:.4g}"), bool(measured >= limit), peer)


def judge_record(
    mesh: str, wanted: Mapping[str, str], figures: Mapping[str, Any], peers: Mapping[str, Peer] = {}
) -> list[Row]:
    """Make a row of every figure beside what is wanted of it, such as "<= 5" or ">= 1"; one of which nothing is wanted is a note."""
    rows = []
    for name, figure in figures.items():
        sign, _, limit = wanted.get(name, "").partition(" ")
        make = at_least if sign == ">=" else at_most
        rows.append(make(mesh, name, float(limit) if sign else None, figure, peers.get(name)))  # type: ignore[arg-type]
    return rows


class Table:
    """Collects rows and prints each as it comes.

    path : of the file with the rows as JSON
    rows : those that are known already; others : those that stay in the file where this run has none of their mesh
    """

    def __init__(self, path: Path | None = None, rows: Iterable[Row] = (), others: Iterable[Row] = ()):
        self.rows, self._others, self._path = list(rows), list(others), path
        print(f"{'mesh':<18}{'row':<{WIDTH}}{'asked':>12}{'measured':>14}  ok   peers")

    def add(self, *rows: Row) -> None:
        """Print rows and collect them."""
        for one in rows:
            self._print(one)
            self.rows.append(one)

    def _print(self, one: Row) -> None:
        mark = {True: "yes", False: "NO", None: ""}[one["ok"]]
        peer = "; ".join(
            f"{name} " + (" ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else str(value))
            for name, value in one["peer"].items()
        )
        measured = f"{one['measured']:.5g}" if isinstance(one["measured"], float) else str(one["measured"])
        line = f"{one['mesh'] + ' ':<18}{one['row']:<{WIDTH}}{one['asked']:>12}{measured:>14}  {mark:<4} {peer}"
        print(line.rstrip(), flush=True)

    def write(self) -> None:
        """Write the rows as JSON, if there is a file."""
        if self._path is not None:
            fresh = {one["mesh"] for one in self.rows}
            rows = [one for one in self._others if one["mesh"] not in fresh] + self.rows
            self._path.write_text(json.dumps(rows, indent=1) + "\n")

    def finish(self) -> None:
        """Write the rows, and say what was missed."""
        self.write()
        missed = [r for r in self.rows if r["ok"] is False]
        print(f"{len(self.rows)} rows, {len(missed)} missed" + "".join(f"\n  {r['mesh']}: {r['row']}" for r in missed))


# -- the bench -----------------------------------------------------------------------------------------------------------


class Bench:
    """A bench; calling it with the arguments of the command line runs it.

    Parameters
    ----------
    name : of the bench
    cases : by name, or what makes them of the options
    measure : returns the rows of a case from its name, what the case makes, and the options; without it, the cases return rows from the options
    summary : returns the rows over all cases from those before and the options
    quick : patterns of the cases that are run without ``--thorough``; empty for a bench without that option
    patterns : default of ``--only``, which chooses cases, or None for a bench without it; between : what stands between them
    meshes : whether there is ``--meshes``, a folder that is by default the one beside the checkout; or as an option
    resume : whether cases that have rows in the file of ``--json`` are left out
    must : name of the rows of which a missed one, or a refused case, is an error; otherwise the exit status is 0 whatever the figures
    options : default and help of every further option; a default of False makes a flag, a type an option without a default
    """

    def __init__(
        self,
        name: str,
        cases: Mapping[str, Callable[..., Any]] | Callable[[Options], Mapping[str, Callable[..., Any]]],
        measure: Callable[..., Iterable[Row]] | None = None,
        *,
        summary: Callable[[list[Row], Options], Iterable[Row]] | None = None,
        quick: tuple[str, ...] = (),
        patterns: str | None = "*",
        between: str = ",",
        meshes: bool | tuple[Any, str] = False,
        resume: bool = False,
        must: str = "",
        **options: tuple[Any, str],
    ):
        self._cases, self._measure, self._summary = cases, measure, summary
        self._quick, self._between, self._resume, self._must = quick, between, resume, must
        self._has_patterns = patterns is not None
        self._parser = parser = argparse.ArgumentParser(prog=f"dev.py bench {name}")
        if patterns is not None:
            parser.add_argument("--only", default=patterns, help=f"patterns of names, with {between} between them")
        if quick:
            parser.add_argument("--thorough", action="store_true", help=f"all cases, not only {', '.join(quick)}")
            parser.set_defaults(only="")
        if isinstance(meshes, tuple):
            options["meshes"] = meshes
        elif meshes:
            parser.add_argument("--meshes", type=Path, default=MESHES if MESHES.is_dir() else None, help="their folder")
        for word, (default, text) in options.items():
            flag = f"--{word.replace('_', '-')}"
            if default is False:
                parser.add_argument(flag, action="store_true", help=text)
            elif isinstance(default, type):
                parser.add_argument(flag, type=default, help=text)
            else:
                parser.add_argument(flag, type=type(default), default=default, help=text)
        parser.add_argument("--json", type=Path, help=f"write the rows here too{', and go on from them' * resume}")

    def __call__(self, arguments: list[str]) -> int:
        """Measure the cases that are asked for and have no rows yet, print the table and write the rows; return the exit status."""
        options = self._parser.parse_args(arguments)
        if self._quick and not options.only:
            options.only = "*" if options.thorough else self._between.join(self._quick)
        patterns = options.only.split(self._between) if self._has_patterns else ["*"]
        there = options.json is not None and options.json.is_file()
        earlier = [one for one in json.loads(options.json.read_text()) if one["mesh"] != "all"] if there else []
        kept = {"rows": earlier} if self._resume else {"others": earlier if patterns != ["*"] else []}
        table = Table(options.json, **kept)
        known = {one["mesh"] for one in table.rows}
        cases = self._cases(options) if callable(self._cases) else self._cases
        for name, case in (cases if self._measure is None else for_each(self._measure, cases)).items():
            if name not in known and matches(name, patterns):
                try:
                    for one in case(options):
                        table.add(one)
                except FlexMapsError as error:
                    table.add(note(name, "refused", str(error)[:80]))
                table.write()
        if self._summary is not None:
            table.add(*self._summary(table.rows, options))
        table.finish()
        return int(any(one["row"] in (self._must, "refused") and not one["ok"] for one in table.rows if self._must))
