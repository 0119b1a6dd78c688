"""Arguments that all commands on a mesh share, and their conversion to arguments of ``api.load``."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from ..engine.errors import FlexMapsError
from ..engine.fabrication.nesting.remnants import SEPARATOR
from ..engine.params import RemeshParams, goal_values
from ..engine.surface import shapes
from ..engine.surface.formats.meshio import SHAPE_PREFIX
from .guarding import run_guarded

RESUMABLE = {"choose", "optimise", "explore"}  # commands that return an unfinished result after Ctrl-C


def parse_number(text: str) -> float:
    """Parse a finite number in ASCII digits; else raise ``ValueError``, which argparse reports."""
    value = float(text)
    if not text.isascii() or "_" in text or not math.isfinite(value):
        raise ValueError
    return value


def add_mesh_command(commands: Any, name: str, run: Any, print_result: Any, help: str) -> argparse.ArgumentParser:
    """Add a command that reads a mesh, with the arguments that all such commands share.

    Parameters
    ----------
    commands : argparse's object of subparsers
    name : name of the command
    run : function of arguments and progress that returns a report
    print_result : function that prints the report
    help : one line of help
    """
    parser = commands.add_parser(name, help=help, description=help[0].upper() + help[1:] + ".")
    parser.set_defaults(run=partial(run_guarded, run), print_result=print_result, is_resumable=name in RESUMABLE)
    parser.add_argument(
        "mesh", help=f"an .obj, .ply, .stl, .off or .blend file, or {SHAPE_PREFIX}NAME ({', '.join(shapes.NAMES)})"
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--edge", type=parse_number, metavar="MM", help="scale the mesh to this median quad edge")
    size.add_argument("--height", type=parse_number, metavar="MM", help="scale the mesh to this extent along z")
    parser.add_argument(
        "--up", choices="xyz", help="axis of the file that points up (default: y for .obj, else z, as in Blender)"
    )
    parser.add_argument("--remesh", type=parse_number, metavar="QUADS",
                      help="first make about so many quads of any mesh, as the sidebar's Quad remesh does")  # fmt: skip
    parser.add_argument("--supports", metavar="QUADS",
                      help="what holds it: 'lowest', numbers of quads from 0 on (1,2,3), or a vertex group of the .blend")  # fmt: skip
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", dest="settings",
                      help="another value for a setting, in mm or degrees; 'flexmaps settings' lists them")  # fmt: skip
    parser.add_argument("--remnant", action="append", default=[], metavar="FILE", dest="remnants_given",
                      help="a DXF or SVG drawing of an odd piece of sheet to fill first; may be given several times")  # fmt: skip
    parser.add_argument("--overwrite", action="store_true",
                      help="also replace files that FlexMaps did not write, or that were changed since")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the report as JSON instead of a summary")
    return parser


def parse_assignments(texts: Sequence[str]) -> dict[str, str]:
    """Parse texts "section.name=value" of ``--set`` into a dict."""
    values = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise FlexMapsError(f"--set {text}: give it as section.name=value")
        values[name.strip()] = value.strip()
    return values


def parse_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Return the settings from flags and ``--set`` as "section.name" -> value, for ``api.load``."""
    values = {name: value for name, value in vars(args).items() if "." in name and value is not None}
    values |= parse_assignments(args.settings)
    if args.remnants_given:
        values["sheet.remnants"] = SEPARATOR.join(args.remnants_given)
    wished = {name: values.get(f"choose.{name}") for name in ("goal", "panels", "match")}
    return values | goal_values(**wished)


def load_arguments(args: argparse.Namespace) -> dict[str, Any]:
    edge = args.edge
    if edge is None and args.height is None and args.mesh.startswith(SHAPE_PREFIX):
        edge = 1e3 * RemeshParams.edge
    return {
        "edge": edge,
        "height": args.height,
        "up": args.up,
        "quads": args.remesh,
        "settings": parse_settings(args),
        "supports": args.supports,
    }
