"""Print a summary of a command's result in the terminal."""

from __future__ import annotations

import argparse
from typing import Any

from ..engine.figures import format_figure
from ..engine.surface.checking.finding import with_count

MAX_FAULTS = 5  # maximum number of different faults to print, so that the candidates stay in sight; by eye


def print_report(described: dict[str, Any], args: argparse.Namespace) -> None:
    """Print the result of every stage that ran, the computing time and the folder of the files."""
    if "input" in described:
        source = described["input"]
        print(f"{source['file']}: {with_count(source['quads'], 'quad', 'quads')}, edge {source['edge_mm']:.1f} mm, "
              f"{' x '.join(f'{x:.0f}' for x in source['size_mm'])} mm")  # fmt: skip
    for finding in described["checks"]:
        print(f"  {finding['severity']}: {finding['message']}")
    if "layout" in described:
        layout = described["layout"]
        print(f"  {with_count(layout['patches'], 'panel', 'panels')}, worst distortion {layout['energy_max']:.4f}")
        for text in layout.get("remarks", ()):
            print(f"  warning: {text}")
    if "choose" in described:
        choice = described["choose"]
        print(f"  {choice['note']} {with_count(choice['layouts_judged'], 'layout was', 'layouts were')} judged:")
        for number, one in enumerate(choice["proposals"]):
            mark, about = "*" if number == choice["taken"] else " ", "" if one["proved"] else "about "
            print(f"  {mark} {with_count(one['panels'], 'panel', 'panels')}, {with_count(one['joints'], 'joint', 'joints')}, RMS {about}{format_figure(one['rms_percent'])} %, "
                  f"strain {100 * one['strain_share_max']:.0f} % of the limit, {with_count(one['sheets'], 'sheet', 'sheets')}, "
                  f"{one['join_minutes']} min to join: {one['origin']}")  # fmt: skip
    if "spirals" in described:
        spirals = described["spirals"]
        print(f"  {with_count(spirals['count'], 'spiral', 'spirals')}, narrowest slot {spirals['slot_min_mm']:.2f} mm")
    if "optimise" in described:
        better = described["optimise"]
        before, after = (format_figure(better[name]) for name in ("rms_percent_before", "rms_percent"))
        print(f"  optimised in {with_count(better['iterations'], 'step', 'steps')}: distance (RMS) {before} to {after} % of the size. "
              f"{better['end']}")  # fmt: skip
    if "equilibrium" in described:
        from ..bridge.store import equilibrium

        text, warning = equilibrium.describe_result(described["equilibrium"])
        print(f"  {'warning: ' if warning else ''}{text}")
    if "scan" in described:
        from ..bridge.store import scans

        print(f"  {scans.describe_result(described['scan'])}")
    if "structure" in described:
        _structure(described["structure"])
    if "sheets" in described:
        sheets = described["sheets"]
        print(f"  {with_count(sheets['sheets'], 'sheet', 'sheets')}, {sheets['cut_length_m']:.1f} m of cuts")
        if "base" in sheets:
            print(f"  {_format_held(sheets['base'])}")
        for warning in sheets["warnings"]:
            print(f"  warning: {warning}")
    out = getattr(args, "out", None)
    seconds = sum(described.get("seconds", {}).values())
    print(f"  computed in {seconds:.1f} s" + (f", files and pictures aside; everything is in {out}" if out else ""))


def _structure(block: dict[str, Any]) -> None:
    for one in block["outcomes"]:
        critical, to = one["critical"], one["followed_to"]
        gives = f"over {to:.3g}" if critical is None else f"{critical:.3g}"
        parts = [f"{name} at {100 * one[name]:.0f} %" for name in ("arms", "joints") if name in one]
        carried = f", {' and '.join(parts)} of what they bear" if parts else ""
        moves = f"{one['deflection_max_mm']:.3g} mm at most{carried}" if one["reached"] else "it snaps before"
        print(f"  load '{one['name']}': {moves}; gives way at {gives} times the load")
    for finding in block.get("findings", ()):
        print(f"  warning: {finding['message']}")


def print_exploration(described: dict[str, Any], args: argparse.Namespace) -> None:
    """Print the candidates of the Pareto front line by line, then faults and conclusion."""
    rows, faults = described["candidates"], [one["fault"] for one in described["candidates"] if one["fault"]]
    print(
        with_count(len(rows), "candidate", "candidates")
        + ("" if described["finished"] else ", then stopped; call it again to go on")
    )
    for number in described["front"]:
        one, mark = rows[number], "*" if number == described["best"] else " "
        values = ", ".join(f"{name} {value}" for name, value in one["values"].items())
        measured = ", ".join(f"{name} {one['measures'].get(name, '-')}" for name in described["minimised"])
        print(f"  {mark} {number:3d}: {measured}: {values}")
    for fault in list(dict.fromkeys(faults))[:MAX_FAULTS]:
        print(f"  {faults.count(fault)} could not be made: {fault}")
    print(f"{described['note']}\n  everything is in {args.out}")


def print_batch(described: dict[str, Any], args: argparse.Namespace) -> None:
    """Print the pieces nested on common sheets with their numbers of copies, and the files."""
    for piece in described["pieces"]:
        print(f"  {piece['copies']} x {piece['name']}")
    print(f"  {', '.join(described['files'])} in {args.out}")


def print_settings(described: dict[str, Any], args: argparse.Namespace) -> None:
    """Print a line for every setting: name, default, bounds or choices, and help."""
    for name, row in described["settings"].items():
        low, high = row["bounds"]
        span = "|".join(row["choices"]) or ("" if low is None and high is None else f"{low:g} to {high:g}")
        value = f"{row['default']:g}" if isinstance(row["default"], float) else str(row["default"])
        print(f"{name:28} {value + (' ' + row['unit'] if row['unit'] else ''):14} {span:24} {row['help']}")


def _format_held(base: dict[str, Any]) -> str:
    """Return a text about the base or the eyelets that hold the piece."""
    if "eyelets" in base:
        most = max((sum(x * x for x in force) ** 0.5 for force in base.get("forces_N", [])), default=None)
        bears = "" if most is None else f"; they bear up to {most:.3g} N"
        return f"{with_count(base['eyelets'], 'eyelet', 'eyelets')} of {base['eyelet_mm']:g} mm to hang it by{bears}"
    under = (
        f"a frame of {with_count(base['planks'], 'plank', 'planks')}"
        if "planks" in base
        else f"a base of {with_count(base['plates'], 'plate', 'plates')}"
    )
    return f"{under} with slots for {with_count(base['feet'], 'foot', 'feet')}"
