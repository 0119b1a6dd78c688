"""Commands of the extras (scan, structure, explore, calibrate); without commands of extras that are not installed."""

from __future__ import annotations

import argparse
from typing import Any

from .. import api
from ..engine.errors import FlexMapsError
from ..engine.extras import registry
from ..engine.progress import Progress
from . import summary
from .sources import add_mesh_command, load_arguments


def add_commands(commands: Any) -> None:
    """Add the commands to the parser."""
    if registry.has("scanning"):
        _add_compare_arguments(
            add_mesh_command(
                commands, "compare", _compare, summary.print_report, "lay a scan of the built piece over its shape"
            )
        )
    if registry.has("structure"):
        _add_case_arguments(
            add_mesh_command(
                commands, "structure", _structure, summary.print_report, "what it bears: load cases, and when it snaps"
            )
        )
    if registry.has("exploring"):
        says = "try many sizes, materials or settings at once"
        _add_explore_arguments(add_mesh_command(commands, "explore", _explore, summary.print_exploration, says))
    if registry.has("calibrating"):
        from . import calibration

        calibration.add_commands(commands)


def _add_compare_arguments(parser: argparse.ArgumentParser) -> None:
    from ..engine.extras.scanning.scan_reader import UNITS

    parser.add_argument("scan", help="an .ply, .obj, .stl or .off file of points or of a mesh")
    parser.add_argument("--out", metavar="FOLDER", help="folder for report.html, report.json and the plots")
    parser.add_argument("--unit", choices=UNITS, help="of the scan (default: metres or millimetres, by its size)")
    parser.add_argument(
        "--near", action="store_true", help="the scan is turned by 30 degrees at most; quicker and surer"
    )
    parser.add_argument("--simulate", action="store_true", help="simulate first; without, a shape that the .blend holds, or the target")  # fmt: skip


def _add_case_arguments(parser: argparse.ArgumentParser) -> None:
    from ..engine.extras.structure.cases import KINDS

    parser.add_argument("--out", metavar="FOLDER", help="folder for report.html, report.json and the plots")
    parser.add_argument("--case", action="append", default=[], metavar="NAME: KIND VALUE AXIS on QUADS", dest="cases",
                      help=f"a load, such as 'snow: snow 500'; kinds: {', '.join(KINDS)}; N, N/m, N/m2, mm")  # fmt: skip
    parser.add_argument("--combine", action="append", default=[], metavar="NAME = 1.35 A + 1.5 B", dest="combinations",
                      help="a sum of cases with factors")  # fmt: skip


def _add_explore_arguments(parser: argparse.ArgumentParser) -> None:
    from ..engine.extras.exploring.space import DEFAULT_GOALS, DEFAULT_OBJECTIVES, MEASURES

    parser.add_argument("--out", required=True, metavar="FOLDER",
                      help="folder for table, plot and pictures; one that was stopped goes on there")  # fmt: skip
    parser.add_argument("--vary", action="append", default=[], metavar="NAME=LOW:HIGH", required=True,
                      help="a setting, edge, height or quads, with its bounds, or with what is tried: NAME=A,B,C")  # fmt: skip
    parser.add_argument("--goal", action="append", metavar="MEASURE<=NUMBER", dest="goals",
                      help=f"what a candidate shall hold (default: {' '.join(DEFAULT_GOALS)}); of {', '.join(MEASURES)}")  # fmt: skip
    parser.add_argument("--minimise", nargs=2, default=DEFAULT_OBJECTIVES, metavar="MEASURE",
                      help=f"what is to be small (default: {' '.join(DEFAULT_OBJECTIVES)})")  # fmt: skip
    parser.add_argument("--candidates", type=int, default=64, metavar="NUMBER", help="how many are tried (default: 64)")
    parser.add_argument("--cores", type=int, metavar="NUMBER", help="processes beside this one (default: one a core)")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="work on the Dask cluster there, such as tcp://name:8786"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="NUMBER", help="another number tries others")


def _compare(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    piece, reporter = api.load(args.mesh, **load_arguments(args)), Progress(progress)
    if args.simulate:
        piece = api.simulate(piece, progress=reporter.part(0.0, 0.6))
    compared = api.compare(
        piece, args.scan, unit=args.unit or "", anywhere=not args.near, progress=reporter.part(0.6, 1.0)
    )
    return api.report(compared, args.out, overwrite=args.overwrite)


def _structure(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    piece = api.load(args.mesh, **load_arguments(args))
    made = api.structure(piece, *args.cases, combinations=args.combinations, progress=progress)
    return api.report(made, args.out, overwrite=args.overwrite)


def _explore(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    pairs = [text.partition("=") for text in args.vary]
    wrong = [text for text, (_, equals, _) in zip(args.vary, pairs, strict=True) if not equals]
    if wrong:
        raise FlexMapsError(f"--vary {wrong[0]}: give it as NAME=LOW:HIGH or NAME=A,B,C")
    vary = {name.strip(): values.strip() for name, _, values in pairs}
    made = api.explore(
        api.load(args.mesh, **load_arguments(args)), vary, args.out, candidates=args.candidates, goals=args.goals,
        minimised=args.minimise, scheduler=args.scheduler, cores=args.cores, seed=args.seed, overwrite=args.overwrite, progress=progress,
    )  # fmt: skip
    return made.report()
