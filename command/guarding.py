"""Refusing, before any work, to write over files of the user's."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..engine.fabrication.writers import export
from ..engine.own_files import Guard
from ..engine.runs import report_page
from ..engine.surface.files.meshio import SHAPE

PAGES = {"compare", "structure", "report"}  # commands whose folder gets the report's page


def guarded(run: Any, args: argparse.Namespace, tell: Any) -> dict[str, Any]:
    """Do what a command asks for, unless it would replace files of the user's: said before the work, not after."""
    read = [args.mesh, *getattr(args, "others", ()), *filter(None, [getattr(args, "scan", None)]), *args.remnants_given]
    guard = Guard([path for path in read if not path.startswith(SHAPE)], args.overwrite)
    if args.command == "export":
        guard.check(export.present(Path(args.out) / "sheet", args.formats), Path(args.out))
    elif args.command in PAGES and args.out:
        guard.check([*report_page.stale(Path(args.out)), Path(args.out) / "report.json"], Path(args.out))
    elif getattr(args, "out", None):
        guard.check([Path(args.out)])
    return run(args, tell)
