"""The commands ``pull`` and ``wish``: forces on single spirals, and drag targets for *Optimise*."""

from __future__ import annotations

import argparse
from typing import Any

from .. import api

AT = "numbers of quads (1,2,3), or 'lowest'"


def add(pulled: argparse.ArgumentParser, wished: argparse.ArgumentParser) -> None:
    """Add the arguments of ``pull`` and ``wish`` to those that all commands have."""
    way: dict[str, Any] = {"required": True, "nargs": 3, "type": float, "metavar": ("X", "Y", "Z")}
    pulled.add_argument("--force", **way, help="newtons at each of them, in world axes; beside what pulls already")
    wished.add_argument("--by", **way, help="millimetres beside the target, in world axes; 0 0 0 takes the wish back")
    for made in (pulled, wished):
        made.add_argument("--at", required=True, metavar="QUADS", help=AT)
        made.add_argument("--out", metavar="FILE.blend", help="save the result in this Blender file")


def pull(args: argparse.Namespace, piece: Any) -> Any:
    """Add the force to the piece."""
    return api.pull(piece, args.at, args.force)


def wish(args: argparse.Namespace, piece: Any) -> Any:
    """Set the drag target of the piece."""
    return api.wish(piece, args.at, args.by)
