"""Command ``next``: press *Next* on objects of a .blend file until nothing is left to press."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from ..api import pressing
from ..engine.errors import FlexMapsError


def add_command(commands: Any) -> None:
    """Add the command ``next`` and its arguments to the parser."""
    words = "press Next on an object of a .blend file until its files are written, and save it"
    parser = commands.add_parser("next", help=words, description=words[0].upper() + words[1:] + ".")
    parser.epilog = "Exit status: 0 the files are written, nothing against it; 3 they are, with things to look at; 2 only a person can go on."
    parser.add_argument("mesh", metavar="FILE.blend", help="the file, which is saved after every object")
    parser.add_argument("--object", metavar="NAME", help="the object, instead of the active one")
    parser.add_argument("--all", action="store_true", help="every mesh that is seen, one after the other")
    words = "before files are written, press this cure where it is offered, as --json names it; 'first' is the first of what speaks against it"
    parser.add_argument("--cure", action="append", default=[], metavar="NAME", help=words)
    parser.add_argument("--json", action="store_true", help="print one JSON object a press")
    parser.set_defaults(is_resumable=False, run=_run, print_result=_print_presses)


def _run(args: argparse.Namespace, console: Any) -> dict[str, Any]:
    """Press *Next* and save the file.

    In the returned dict, ``undone`` lists objects whose status line has no tick, ``stuck`` the reasons why objects got
    no files.
    """
    import bpy

    from ..bridge.store.objects import CONVERTIBLE
    from ..bridge.view import scene

    active = scene.open_blend(Path(args.mesh))
    objects = [active]
    if args.object:
        named = bpy.context.scene.objects.get(args.object)
        if named is not None and named.type in CONVERTIBLE:
            named = scene.convert_to_mesh(named, bpy.context)
        if named is None or named.type != "MESH":
            raise FlexMapsError(
                f"{args.mesh} holds no object '{args.object}' with faces; look at the names in the outliner"
            )
        objects = [named]
    elif args.all:
        seen = bpy.context.view_layer.objects
        objects = [
            o
            for o in seen
            if o.type == "MESH" and len(o.data.polygons) and o.visible_get() and "flexmaps_kind" not in o
        ]
    # ``_print_presses`` prints the JSON lines at the end, because Blender's own output is suppressed until then
    args.lines, args.json = args.json, False
    presses = [report for obj in objects for report in _press_until_done(obj, args.cure)]
    ended = {report["object"]: report for report in presses}
    last = [report for report in presses if report["last"]]
    stuck = [report for report in last if report["figures"]["sheets"] is None]
    reasons = [(report["findings"] or [{"text": report["status"]["text"]}])[0]["text"] for report in stuck]
    stopped = [f"'{report['object']}': {why}" for report, why in zip(stuck, reasons, strict=True)]
    undone = [name for name, report in ended.items() if report["last"] and report["status"]["sign"] != "tick"]
    return {"presses": presses, "stuck": stopped, "undone": undone}


def _press_until_done(obj: Any, cures: list[str]) -> list[dict[str, Any]]:
    """Press *Next* on an object until nothing is left, save the file, and return all presses; the last is marked."""
    import bpy

    bpy.context.view_layer.objects.active = obj
    named = [name for name in cures if name != "first"]
    reports = list(pressing.presses(obj, cures=len(cures) - len(named), named=named))
    reports = reports or [{"pressed": "", "call": "", "error": "", "seconds": 0.0} | pressing.describe_object(obj)]
    bpy.ops.wm.save_mainfile()
    return [report | {"last": report is reports[-1]} for report in reports]


def _print_presses(described: dict[str, Any], args: argparse.Namespace) -> None:
    for report in described["presses"]:
        if args.lines:
            print(json.dumps(report))
        else:
            print(f"{report['pressed']}: {report['error'] or report['status']['text']}")
    for text in described["stuck"]:
        print(f"flexmaps: {text}", file=sys.stderr)
