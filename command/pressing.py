"""``flexmaps next``: *Next* pressed on the objects of a .blend file, as often as there is something to press."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ..api import pressing
from ..engine.errors import FlexMapsError


def add(commands: Any) -> None:
    """The command and its arguments."""
    said = "press Next on an object of a .blend file until its files are written, and save it"
    made = commands.add_parser("next", help=said, description=said[0].upper() + said[1:] + ".")
    made.epilog = "Exit status: 0 the files are written, nothing against it; 3 they are, with things to look at; 2 only a person can go on."
    made.add_argument("mesh", metavar="FILE.blend", help="the file, which is saved after every object")
    made.add_argument("--object", metavar="NAME", help="the object, instead of the active one")
    made.add_argument("--all", action="store_true", help="every mesh that is seen, one after the other")
    made.add_argument(
        "--cure", choices=("first",), help="before files are written, press the first cure of what speaks against it"
    )
    made.add_argument("--json", action="store_true", help="print one JSON object a press")
    made.set_defaults(keeps=False, run=_run, tell=lambda described, args: None)


def _run(args: argparse.Namespace, console: Any) -> dict[str, Any]:
    """Press, print, save; ``undone`` where something speaks against cutting."""
    import bpy

    from ..bridge.view import scene

    active = scene.open_blend(Path(args.mesh))
    objects = [active]
    if args.object:
        objects = [obj for obj in bpy.data.objects if obj.name == args.object and obj.type == "MESH"]
        if not objects:
            raise FlexMapsError(f"{args.mesh} holds no mesh object '{args.object}'; look at the names in the outliner")
    elif args.all:
        seen = bpy.context.view_layer.objects
        objects = [
            o
            for o in seen
            if o.type == "MESH" and len(o.data.polygons) and o.visible_get() and "flexmaps_kind" not in o
        ]
    as_json, args.json = args.json, False
    ended = [_pressed(obj, args.cure is not None, as_json) for obj in objects]
    stuck = [told for told in ended if told["figures"]["sheets"] is None]
    if stuck:
        reasons = [finding["text"] for finding in stuck[0]["findings"]] or [stuck[0]["status"]["text"]]
        raise FlexMapsError(f"'{stuck[0]['object']}': {reasons[0]}")
    return {"undone": [told["object"] for told in ended if told["status"]["sign"] != "tick"]}


def _pressed(obj: Any, cured: bool, as_json: bool) -> dict[str, Any]:
    """Press *Next* on one object until nothing is left; what it ends with comes back."""
    import bpy

    bpy.context.view_layer.objects.active = obj
    told = pressing.told(obj)
    for told in pressing.presses(obj, cures=int(cured)):
        line = json.dumps(told) if as_json else f"{told['pressed']}: {told['error'] or told['status']['text']}"
        print(line, flush=True)
        bpy.ops.wm.save_mainfile()
    return told
