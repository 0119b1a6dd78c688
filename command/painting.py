"""Command ``paint``: change spirals with a brush, on all quads or where an object's vertex weights or colours say."""

from __future__ import annotations

import argparse
from typing import Any

from .. import api
from ..engine.spirals.painting import BRUSHES

WHERE_HELP = "a vertex group, colour or attribute of the .blend, numbers of quads (1,2,3), or 'lowest'"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``paint`` to its parser."""
    parser.add_argument(
        "--brush", choices=tuple(BRUSHES), help="what is painted; 'stiffness' sets it to what --where says"
    )
    parser.add_argument("--where", metavar="NAME", help=f"{WHERE_HELP} (default: everywhere)")
    parser.add_argument("--strength", type=float, default=1.0, metavar="SHARE",
                      help="share of the way to what the brush leads to (default: 1)")  # fmt: skip
    parser.add_argument("--inverted", action="store_true", help="the other way round")
    parser.add_argument("--along", metavar="x|y|z", help="the direction of the brush 'along'")
    parser.add_argument("--protect", metavar="NAME", help=f"spirals that 'optimise' leaves as they are: {WHERE_HELP}; 'none' for none")  # fmt: skip
    parser.add_argument("--out", metavar="FILE.blend", help="save the result in this Blender file")


def paint(args: argparse.Namespace, piece: Any, progress: Any) -> Any:
    """Return the piece painted and protected as in the arguments."""
    if args.brush:
        options = {"strength": args.strength, "inverted": args.inverted, "direction": args.along}
        piece = api.paint(piece, args.brush, 1.0 if args.where is None else args.where, **options, progress=progress)
    return protect(args, piece)


def protect(args: argparse.Namespace, piece: Any) -> Any:
    """Return the piece with the spirals of ``--protect`` protected; unchanged without this argument."""
    return piece if args.protect is None else api.protect(piece, None if args.protect == "none" else args.protect)
