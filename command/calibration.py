"""Commands for the calibration sheet: ``calibrate`` draws it, ``calibrated`` evaluates the measurements."""

from __future__ import annotations

import argparse
from typing import Any

from .. import api
from ..engine.extras.calibrating.coupons import KINDS
from ..engine.extras.calibrating.sheet_files import DEFAULT_FORMATS, WRITERS
from .sources import parse_assignments


def add_commands(commands: Any) -> None:
    """Add both commands to the parser."""
    help = "draw a small sheet to measure kerf, clearances and stiffness with"
    parser = commands.add_parser("calibrate", help=help, description=f"{help.capitalize()}.")
    parser.add_argument("--out", required=True, metavar="FOLDER", help="folder for the files")
    parser.add_argument("--formats", nargs="+", choices=tuple(WRITERS), default=list(DEFAULT_FORMATS), metavar="NAME",
                      help=f"kinds of files: {', '.join(WRITERS)} (default: {' '.join(DEFAULT_FORMATS)})")  # fmt: skip
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", dest="settings",
                      help="what is known so far: spiral.thickness, material.material, cut.kerf_outline, ...")  # fmt: skip
    parser.add_argument("--overwrite", action="store_true",
                      help="also replace files that FlexMaps did not write, or that were changed since")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the paths as JSON")
    parser.set_defaults(is_resumable=False, run=_run_calibrate, print_result=_print_files)
    help = "kerf, clearance and stiffness from what was measured on a calibration sheet"
    read = commands.add_parser(
        "calibrated", help=help, description=f"{help.capitalize()}. Lengths in mm, weights in g."
    )
    read.add_argument("sheet", help="calibration.json, or the folder that it lies in")
    for name, metavar, says in (
        ("kerf-comb", "MM", "gap in the comb with the squares pushed to one side; several readings are better"),
        ("thickness", "MM", "of the sheet, at several places"),
        ("strip-sag", "MM", "how much lower the strip's end comes as the weight is hung on"),
    ):
        read.add_argument(f"--{name}", nargs="+", type=float, default=[], metavar=metavar, help=says)
    read.add_argument("--clearance", type=float, metavar="MM", help="value of the rung that fits best")
    read.add_argument("--kind", choices=KINDS, default=KINDS[0], help="connector of that rung (default: %(default)s)")
    read.add_argument("--strip-weight", type=float, metavar="G", help="what hung on the strip (default: as engraved)")
    read.add_argument("--strip-mass", type=float, metavar="G", help="of the whole strip, for the density")
    read.add_argument("--spiral-sag", nargs=2, type=float, action="append", default=[], metavar=("A", "B"),
                      help="how far the hubs of spirals A and B sink under their weights, mm; may be repeated")  # fmt: skip
    read.add_argument(
        "--spiral-weight", nargs=2, type=float, metavar=("A", "B"), help="those weights (default: as engraved)"
    )
    read.add_argument("--name", help="keep the result among Blender's presets of FlexMaps under this name")
    read.add_argument("--json", action="store_true", help="print the result as JSON")
    read.set_defaults(is_resumable=False, run=_run_calibrated, print_result=_print_calibration)


def _run_calibrate(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    wanted = parse_assignments(args.settings)
    written = api.calibration_sheet(args.out, wanted, formats=args.formats, overwrite=args.overwrite, progress=progress)
    return {"files": [path.name for path in written]}


def _print_files(described: dict[str, Any], args: argparse.Namespace) -> None:
    print(
        f"{', '.join(described['files'])} in {args.out}; cut, measure, then: flexmaps calibrated {args.out} --kerf-comb ..."
    )


def _run_calibrated(args: argparse.Namespace, progress: Any) -> dict[str, Any]:
    names = (
        "kerf_comb",
        "clearance",
        "kind",
        "thickness",
        "strip_sag",
        "strip_weight",
        "strip_mass",
        "spiral_sag",
        "spiral_weight",
    )
    return api.calibrated(args.sheet, name=args.name, **{name: getattr(args, name) for name in names}).report()


def _print_calibration(described: dict[str, Any], args: argparse.Namespace) -> None:
    """Print each calibrated value with its error on a line, then warnings and the settings to pass on."""
    rows = (("kerf_mm", "kerf", "mm"), ("clearance_mm", "clearance", "mm"), ("thickness_mm", "thickness", "mm"),
            ("youngs_strip_gpa", "strip says", "GPa"), ("youngs_spirals_gpa", "spirals say", "GPa"),
            ("youngs_gpa", "Young's modulus", "GPa"))  # fmt: skip
    for key, label, unit in rows:
        one = described[key]
        if one is not None:
            print(f"  {label:16} {one['value']:g} {unit} +- {one['error']:.2g}")
    if described["density"] is not None:
        print(f"  {'density':16} {described['density']:g} kg/m3")
    if described["believed"]:
        print(f"  believed: {described['believed']}")
    for warning in described["warnings"]:
        print(f"  warning: {warning}")
    print("  " + " ".join(f"--set {name}={value}" for name, value in described["settings"].items()))
    if args.name:
        print(f"  kept as preset '{args.name}'")
