"""The main job on the command line: a mesh file in; sheets, a .blend, pictures and ``report.json`` out."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import Field, fields
from pathlib import Path
from typing import Any, get_type_hints

from ..engine import dxf, files, job, meshio, report, shapes, svg
from ..engine.errors import FlexMapsError
from ..engine.mesh import PolygonMesh
from ..engine.params import SHOWN, Settings
from ..engine.progress import Progress
from . import scene

SHAPE = "shape:"


def main(argv: list[str]) -> int:
    """Run the job as the arguments ask. Returns the exit status: 0, 2 for a mistake in the input, 130 when stopped."""
    args = _parser().parse_args(argv)
    console = _Console()
    try:
        _run(args, Progress(console))
    except FlexMapsError as error:
        console.end_line()
        print(f"flexmaps: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        console.end_line()
        print("flexmaps: stopped; earlier files are as they were", file=sys.stderr)
        return 130
    return 0


def _run(args: argparse.Namespace, progress: Progress) -> None:
    out = Path(args.out)
    polygons = _read(args.mesh)
    edge, height = _metres(args.edge), _metres(args.height)
    if edge is None and height is None and args.mesh.startswith(SHAPE):
        edge = shapes.EDGE
    with files.replacing_many() as new:
        new(out / REPORT)  # a folder that cannot be written to says so before the work
        result = job.run(
            polygons, _settings(args), edge=edge, height=height, stop_after=args.stop_after, progress=progress.part(0.0, 0.6)
        )
        described = report.build(result, source=Path(args.mesh).name, program=PROGRAM)
        _write(result, described, out, new, progress.part(0.6, 1.0), pictures=not args.no_pictures)
    for path in _left_over(out, described):
        path.unlink(missing_ok=True)
    _print_summary(described, out)
def _metres(millimetres: float | None) -> float | None:
    return None if millimetres is None else millimetres / 1e3


# -- arguments: one flag for every setting of the engine -----------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="run", description="Turn a mesh into flat, flexible panels: sheets to cut, a .blend, pictures, report.json."
    )
    parser.add_argument(
        "mesh", help=f"an .obj, .ply, .stl, .off or .blend file, or {SHAPE}NAME ({', '.join(shapes.NAMES)})"
    )
    parser.add_argument("--out", required=True, help="folder for everything that is written")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--edge", type=float, metavar="MM", help="scale the mesh to this median quad edge")
    size.add_argument("--height", type=float, metavar="MM", help="scale the mesh to this extent along z")
    parser.add_argument("--stop-after", choices=list(job.STAGES), default=list(job.STAGES)[-1], metavar="STAGE",
                        help=f"last stage to run: {', '.join(job.STAGES)}")  # fmt: skip
    parser.add_argument("--no-pictures", action="store_true", help="skip the rendered pictures")
    for block in fields(Settings):
        group = parser.add_argument_group(f"{block.name} settings")
        for f in fields(block.default_factory):  # type: ignore[arg-type, misc]
            _add_flag(group, f, get_type_hints(block.default_factory)[f.name])
    return parser


def _add_flag(group: argparse._ArgumentGroup, f: Field, kind: type) -> None:
    flag, meta = "--" + f.name.replace("_", "-"), f.metadata
    factor, symbol = SHOWN[meta["unit"]]
    help = f"{meta['help']} (default {f.default * factor:g}{symbol})" if kind in (int, float) else meta["help"]
    if kind is bool:
        group.add_argument(flag, action=argparse.BooleanOptionalAction, default=f.default, help=help)
    elif meta["choices"]:
        group.add_argument(flag, choices=[c[0] for c in meta["choices"]], default=f.default, help=help)
    else:
        metavar = {"mm": "MM", "\N{DEGREE SIGN}": "DEGREES"}.get(symbol, "N")
        group.add_argument(flag, type=kind, metavar=metavar, help=help)


def _settings(args: argparse.Namespace) -> Settings:
    blocks = {}
    for block in fields(Settings):
        kind = block.default_factory
        given = {}
        for f in fields(kind):  # type: ignore[arg-type]
            value = getattr(args, f.name)
            if value is not None:
                given[f.name] = value / SHOWN[f.metadata["unit"]][0] if isinstance(value, float) else value
        blocks[block.name] = kind(**given)  # type: ignore[misc]
    return Settings(**blocks)


# -- what the person at the terminal sees --------------------------------------------------------------------------


class _Console:
    """Progress to standard error: one line that rewrites itself in a terminal, one line a step elsewhere."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._last = ""

    def __call__(self, fraction: float, text: str) -> None:
        if self._live:
            print(f"\r\033[K{fraction:4.0%}  {text}", end="", file=sys.stderr, flush=True)
        elif text and text.split(":")[0] != self._last:
            print(f"{fraction:4.0%}  {text}", file=sys.stderr, flush=True)
        self._last = text.split(":")[0]

    def end_line(self) -> None:
        if self._live and self._last:
            print(file=sys.stderr)


def _print_summary(described: dict[str, Any], out: Path) -> None:
    given = described["input"]
    print(f"\n{given['file']}: {given['quads']} quads, edge {given['edge_mm']:.1f} mm, "
          f"{' x '.join(f'{x:.0f}' for x in given['size_mm'])} mm")  # fmt: skip
    for finding in described["checks"]:
        print(f"  {finding['severity']}: {finding['message']}")
    if "layout" in described:
        layout = described["layout"]
        print(f"  {layout['patches']} patches, worst distortion {layout['energy_max']:.4f}")
    if "spirals" in described:
        spirals = described["spirals"]
        print(f"  {spirals['count']} spirals, narrowest slot {spirals['slot_min_mm']:.2f} mm")
    if "sheets" in described:
        sheets = described["sheets"]
        print(f"  {sheets['sheets']} sheets, {sheets['cut_length_m']:.1f} m of cuts")
    print(f"  {sum(described['seconds'].values()):.1f} s; everything is in {out}")
