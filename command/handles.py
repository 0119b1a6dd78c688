"""Commands ``pull`` and ``wish``: set forces on single spirals, and drag targets for *Optimise*."""

from __future__ import annotations

import argparse
from typing import Any

from .. import api

AT_HELP = "numbers of quads (1,2,3), or 'lowest'"


def add_arguments(pull_parser: argparse.ArgumentParser, wish_parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``pull`` and ``wish`` to their parsers."""
    way: dict[str, Any] = {"required": True, "nargs": 3, "type": float, "metavar": ("X", "Y", "Z")}
    pull_parser.add_argument("--force", **way, help="newtons at each of them, in world axes; beside what pulls already")
    wish_parser.add_argument(
        "--by", **way, help="millimetres beside the target, in world axes; 0 0 0 takes the wish back"
    )
    for parser in (pull_parser, wish_parser):
        parser.add_argument("--at", required=True, metavar="QUADS", help=AT_HELP)
        parser.add_argument("--out", metavar="FILE.blend", help="save the result in this Blender file")


def pull(args: argparse.Namespace, piece: Any) -> Any:
    """Return the piece with the force from the command-line arguments added."""
    return api.pull(piece, args.at, args.force)


def wish(args: argparse.Namespace, piece: Any) -> Any:
    """Return the piece with the drag target from the command-line arguments."""
    return api.wish(piece, args.at, args.by)
