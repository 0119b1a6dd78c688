"""The main job on the command line: a mesh file in; sheets, a .blend, pictures and ``report.json`` out."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import Field, fields, replace
from pathlib import Path
from typing import Any, get_type_hints

from ..engine import assembly_sheet, export, files, job, meshio, report, shapes
from ..engine.errors import FlexMapsError
from ..engine.mesh import PolygonMesh
from ..engine.params import SHOWN, RemeshParams, Settings
from ..engine.progress import Progress

SHAPE = "shape:"
SHEET, GUIDE, MODEL, REPORT, PICTURES = (
    "sheet",
    "assembly.pdf",
    "model.blend",
    "report.json",
    ("layout.png", "panels.png", "shape.png"),
)


def main(argv: list[str]) -> int:
    """Run the job as the arguments ask. Returns the exit status: 0, 2 for a mistake in the input, 130 when stopped."""
    args = _parser().parse_args(argv)
    console = _Console()
    try:
        described = _run(args, Progress(console))
    except FlexMapsError as error:
        console.end_line()
        print(f"flexmaps: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        console.end_line()
        print("flexmaps: stopped; earlier files are as they were", file=sys.stderr)
        return 130
    console.end_line()
    _print_summary(described, Path(args.out))
    return 0


def _run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    out, settings = Path(args.out), _settings(args)
    polygons = _read(args.mesh, args.up)
    edge, height = _metres(args.edge), _metres(args.height)
    if edge is None and height is None and args.mesh.startswith(SHAPE):
        edge = RemeshParams.edge
    with files.replacing_many(_stale(out)) as new:
        new(out / REPORT)  # a folder that cannot be written to says so before the work, not after
        result = job.run(
            polygons,
            settings,
            edge=edge,
            height=height,
            stop_after=args.stop_after,
            optimised=args.optimise,
            progress=progress.part(0.0, 0.6),
        )
        with _quiet_blender():
            written = _write(
                result,
                settings,
                _title(args.mesh),
                out,
                new,
                progress.part(0.6, 1.0),
                args.pictures,
                tuple(args.formats),
            )
        described = report.build(result, source=_title(args.mesh), files=written)
        new(out / REPORT).write_text(json.dumps(described, indent=2) + "\n", encoding="utf-8")
    return described


def _write(
    result: job.Result,
    settings: Settings,
    name: str,
    out: Path,
    new: export.NewFile,
    progress: Progress,
    pictures: bool,
    formats: tuple[str, ...],
) -> list[Path]:
    """Write all but the report; returns the files of the sheets."""
    from . import picture, scene

    written = []
    if result.sheets is not None:
        progress(0.0, "writing the sheets")
        written = export.write(result.sheets, out / SHEET, formats, new)
        if result.design is not None and result.estimates is not None:
            progress(0.1, "drawing the assembly sheet")
            title = Path(name).stem
            written.append(
                assembly_sheet.write(
                    result.design, result.sheets, result.estimates, out / GUIDE, title, new, result.assembly
                )
            )
    progress(0.2, "building the Blender file")
    model = scene.show(result, name, settings)
    scene.save(new(out / MODEL))
    if pictures:
        made = (True, result.flat is not None, result.simulation is not None)
        drawn = (picture.layout, picture.panels, picture.shape)
        for share, wanted, draw, file in zip((0.4, 0.6, 0.8), made, drawn, PICTURES, strict=True):
            if wanted:
                progress(share, f"rendering {file}")
                draw(model, new(out / file))
    progress(1.0, "done")
    return written


def _stale(out: Path) -> list[Path]:
    """What an earlier run left in the folder: it goes when the new files come, and only what its report names."""
    try:
        earlier = json.loads((out / REPORT).read_text(encoding="utf-8"))
        sheets = [out / Path(name).name for name in earlier.get("sheets", {}).get("files", [])]
    except (OSError, ValueError, AttributeError, TypeError):
        return []
    return [*sheets, *(out / name for name in PICTURES)]


def _read(name: str, up: str | None) -> PolygonMesh:
    if name.startswith(SHAPE):
        return PolygonMesh.of(shapes.make(name.removeprefix(SHAPE)))
    if name.lower().endswith(".blend"):
        from . import scene

        return scene.read_blend(name)
    return _upright(meshio.read(name), up or ("y" if name.lower().endswith(".obj") else "z"))


def _upright(polygons: PolygonMesh, up: str) -> PolygonMesh:
    """The mesh turned about x and z so that its axis ``up`` is z."""
    axes = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}[up]
    return replace(polygons, vertices=polygons.vertices[:, axes])


def _title(name: str) -> str:
    return name.removeprefix(SHAPE) if name.startswith(SHAPE) else Path(name).name


def _metres(millimetres: float | None) -> float | None:
    return None if millimetres is None else millimetres / 1e3


# -- arguments: one flag for every setting of the engine -----------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="run",
        description="Turn a mesh into flat, flexible panels: sheets to cut, a .blend, pictures, report.json.",
    )
    parser.add_argument(
        "mesh", help=f"an .obj, .ply, .stl, .off or .blend file, or {SHAPE}NAME ({', '.join(shapes.NAMES)})"
    )
    parser.add_argument("--out", required=True, help="folder for everything that is written")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--edge", type=float, metavar="MM", help="scale the mesh to this median quad edge")
    size.add_argument("--height", type=float, metavar="MM", help="scale the mesh to this extent along z")
    parser.add_argument(
        "--up", choices="xyz", help="axis of the file that points up (default: y for .obj, else z, as in Blender)"
    )
    parser.add_argument("--stop-after", choices=list(job.STAGES), default=list(job.STAGES)[-1], metavar="STAGE",
                        help=f"last stage to run: {', '.join(job.STAGES)}")  # fmt: skip
    parser.add_argument(
        "--optimise", action="store_true", help="make the spirals match the surface better; takes longer"
    )
    parser.add_argument("--formats", nargs="+", choices=export.FORMATS, default=list(export.FLAT), metavar="NAME",
                        help=f"kinds of files: {', '.join(export.FORMATS)} (default: {' '.join(export.FLAT)})")  # fmt: skip
    parser.add_argument("--pictures", action=argparse.BooleanOptionalAction, default=True, help="render the pictures")
    taken: set[str] = set()
    for block in fields(Settings):
        group = parser.add_argument_group(f"{block.name} settings")
        for f in fields(block.default_factory):  # type: ignore[arg-type, misc]
            # where two blocks have a setting of the same name, the later one's flag begins with its block
            name = f"{block.name}_{f.name}" if f.name in taken else f.name
            taken.add(name)
            _add_flag(group, name, f"{block.name}.{f.name}", f, get_type_hints(block.default_factory)[f.name])
    return parser


def _add_flag(group: argparse._ArgumentGroup, name: str, dest: str, f: Field, kind: type) -> None:
    flag, meta = "--" + name.replace("_", "-"), f.metadata
    factor, symbol = SHOWN[meta["unit"]]
    default: Any = f.default
    help = f"{meta['help']} (default {default * factor:g}{symbol})" if kind in (int, float) else meta["help"]
    if kind is bool:
        group.add_argument(flag, dest=dest, action=argparse.BooleanOptionalAction, default=f.default, help=help)
    elif meta["choices"]:
        group.add_argument(flag, dest=dest, choices=[c[0] for c in meta["choices"]], default=f.default, help=help)
    else:
        metavar = {"mm": "MM", "\N{DEGREE SIGN}": "DEGREES", "GPa": "GPA"}.get(symbol, "N")
        group.add_argument(flag, dest=dest, type=kind, metavar=metavar, help=help)


def _settings(args: argparse.Namespace) -> Settings:
    blocks = {}
    for block in fields(Settings):
        kind: Any = block.default_factory
        given = {}
        for f in fields(kind):
            value = getattr(args, f"{block.name}.{f.name}")
            if value is not None:
                given[f.name] = value / SHOWN[f.metadata["unit"]][0] if isinstance(value, float) else value
        blocks[block.name] = kind(**given)
    return Settings(**blocks)


# -- what the person at the terminal sees --------------------------------------------------------------------------


@contextmanager
def _quiet_blender() -> Iterator[None]:
    """Blender writes a line for every step of a render straight to the process's standard output: not for people."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


class _Console:
    """Progress to standard error: a line that rewrites itself in a terminal, elsewhere a line every other second."""

    EVERY = 2.0  # seconds between lines that stay

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._last = 0.0

    def __call__(self, fraction: float, text: str) -> None:
        if self._live:
            print(f"\r\033[K{fraction:4.0%}  {text}", end="", file=sys.stderr, flush=True)
        elif time.monotonic() - self._last > self.EVERY or fraction >= 1.0:
            print(f"{fraction:4.0%}  {text}", file=sys.stderr, flush=True)
            self._last = time.monotonic()

    def end_line(self) -> None:
        if self._live:
            print(file=sys.stderr)


def _print_summary(described: dict[str, Any], out: Path) -> None:
    given = described["input"]
    print(f"{given['file']}: {given['quads']} quads, edge {given['edge_mm']:.1f} mm, "
          f"{' x '.join(f'{x:.0f}' for x in given['size_mm'])} mm")  # fmt: skip
    for finding in described["checks"]:
        print(f"  {finding['severity']}: {finding['message']}")
    if "layout" in described:
        layout = described["layout"]
        print(f"  {layout['patches']} patches, worst distortion {layout['energy_max']:.4f}")
    if "spirals" in described:
        spirals = described["spirals"]
        print(f"  {spirals['count']} spirals, narrowest slot {spirals['slot_min_mm']:.2f} mm")
    if "optimise" in described:
        better = described["optimise"]
        print(f"  optimised in {better['iterations']} steps: RMSE {better['laplacian_rmse_mm_before']:.3g} "
              f"to {better['laplacian_rmse_mm']:.3g} mm")  # fmt: skip
    if "equilibrium" in described:
        from . import equilibrium

        text, warning = equilibrium.sentences(described["equilibrium"])
        print(f"  {'warning: ' if warning else ''}{text}")
    if "sheets" in described:
        sheets = described["sheets"]
        print(f"  {sheets['sheets']} sheets, {sheets['cut_length_m']:.1f} m of cuts")
        for warning in sheets["warnings"]:
            print(f"  warning: {warning}")
    print(f"  {sum(described['seconds'].values()):.1f} s; everything is in {out}")
