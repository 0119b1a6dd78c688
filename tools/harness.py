"""Common part of the benches: options, named cases, rows that are known already, and the table with its end."""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh
from rows import Row, Table, note

MESHES = Path(__file__).resolve().parent.parent.parent / "shared" / "meshes"  # larger meshes beside the checkout
FORMATS = (".obj", ".off", ".ply", ".stl")
EDGE = 0.02  # metres, quads of the surfaces that the project makes
Case = TypeVar("Case")
Surfaces = dict[str, Callable[[], PolygonMesh]]  # what makes each, by name


def surfaces(folder: Path | None) -> Surfaces:
    """Return the surfaces that the project makes, and the meshes of a folder."""
    return {f"made:{name}": partial(built_in, name) for name in shapes.NAMES} | from_folder(folder)


def built_in(name: str) -> PolygonMesh:
    """Return one of the surfaces that the project makes, with quads of 20 mm."""
    return PolygonMesh.from_quads(shapes.make(name, EDGE))


def from_zoo(*names: str) -> Surfaces:
    """Return surfaces of the zoo by name; those that it does not have are left out."""
    import zoo

    return {name: zoo.SURFACES[name].polygons for name in names if name in zoo.SURFACES}


def from_folder(folder: Path | None, pattern: str = "*") -> Surfaces:
    """Return the meshes of a folder by the stems of their names; none without a folder."""
    paths = sorted(folder.glob(pattern)) if folder is not None else []
    return {path.stem: partial(meshio.read, path) for path in paths if path.suffix.lower() in FORMATS}


def processor() -> float:
    """Return the processor seconds of this process and of its finished child processes."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def seconds(action: Callable[[], Any], repeats: int = 1) -> float:
    """Return the fewest processor seconds that an action takes in several runs."""

    def once() -> float:
        began = time.process_time()
        action()
        return time.process_time() - began

    return min(once() for _ in range(repeats))


class Bench:
    """Options and table of one run of a bench.

    Parameters
    ----------
    name : of the bench
    arguments : of the command line
    width : of the rows' names
    only : default patterns of the cases, or None for a bench without ``--only``; between : what stands between them
    meshes : whether there is ``--meshes``, a folder that is by default the one beside the checkout; or as an option
    resume : whether rows in the file of ``--json`` are kept, and their cases left out
    options : default and help of every further option; a default of False makes a flag, a type an option without a default
    """

    def __init__(
        self,
        name: str,
        arguments: list[str],
        width: int = 24,
        *,
        only: str | None = None,
        between: str = ",",
        meshes: bool | tuple[Any, str] = False,
        resume: bool = False,
        **options: tuple[Any, str],
    ):
        parser = argparse.ArgumentParser(prog=f"dev.py bench {name}")
        if only is not None:
            parser.add_argument("--only", default=only, help=f"patterns of names, with {between} between them")
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
        self.options = parser.parse_args(arguments)
        self.table, self._between = Table(width), between
        file = self.options.json
        if resume and file is not None and file.is_file():
            self.table.rows = [one for one in json.loads(file.read_text()) if one["mesh"] != "all"]
        self._known = {one["mesh"] for one in self.table.rows}

    def asked(self, name: str) -> bool:
        """Return whether a name fits one of the patterns."""
        return any(fnmatch.fnmatch(name, pattern) for pattern in self.options.only.split(self._between))

    def cases(self, named: Iterable[tuple[str, Case]]) -> Iterator[tuple[str, Case]]:
        """Yield the cases that are asked for and have no rows yet."""
        yield from ((name, case) for name, case in self.fresh(named) if self.asked(name))

    def fresh(self, named: Iterable[tuple[str, Case]]) -> Iterator[tuple[str, Case]]:
        """Yield the cases that have no rows yet."""
        yield from ((name, case) for name, case in named if name not in self._known)

    def each(self, rows: Callable[..., Iterable[Row]], surfaces: Surfaces, *arguments: Any) -> None:
        """Add ``rows(name, polygons, *arguments)`` for every surface that is asked for and has no rows yet."""
        for name, make in self.cases(surfaces.items()):
            self.measure(lambda name, make: rows(name, make(), *arguments), name, make)

    def measure(self, rows: Callable[..., Iterable[Row]], name: str, *arguments: Any) -> None:
        """Add the rows of a case, or one that says why it is refused, and write them."""
        try:
            for one in rows(name, *arguments):
                self.table.add(one)
        except FlexMapsError as error:
            self.table.add(note(name, "refused", str(error)[:80]))
        if self.options.json is not None:
            self.options.json.write_text(json.dumps(self.table.rows, indent=1) + "\n")

    def run(self, parts: Mapping[str, Callable[[argparse.Namespace], Iterable[Row]]]) -> int:
        """Add the rows of the parts that are asked for, each as it comes; return the exit status."""
        for _, part in self.cases(parts.items()):
            for one in part(self.options):
                self.table.add(one)
        return self.finish(keep=self.options.only != "*")

    def finish(self, *summary: Row, keep: bool = False) -> int:
        """Add the rows over all cases, write all, and say what was missed; return the exit status."""
        self.table.add(*summary)
        self.table.finish(self.options.json, keep)
        return 0
