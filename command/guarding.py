"""Check before a command runs that it would not overwrite the user's files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..engine.fabrication.writers import export
from ..engine.own_files import Guard
from ..engine.runs import report_page
from ..engine.surface.formats.meshio import SHAPE_PREFIX

REPORT_COMMANDS = {"compare", "structure", "report"}  # commands that write a report into their folder


def run_guarded(run: Any, args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    """Run a command, but first raise ``UserFileError`` if it would overwrite the user's files.

    Parameters
    ----------
    run : the command's function
    args : its arguments
    progress : called with a fraction and a text
    """
    read = [args.mesh, *getattr(args, "others", ()), *filter(None, [getattr(args, "scan", None)]), *args.remnants_given]
    guard = Guard([path for path in read if not path.startswith(SHAPE_PREFIX)], args.overwrite)
    if args.command == "export":
        guard.check(export.existing_files(Path(args.out) / "sheet", args.formats), Path(args.out))
    elif args.command in REPORT_COMMANDS and args.out:
        guard.check([*report_page.stale_files(Path(args.out)), Path(args.out) / "report.json"], Path(args.out))
    elif getattr(args, "out", None):
        guard.check([Path(args.out)])
    return run(args, progress)
