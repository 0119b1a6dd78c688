"""Benchmark of load paths and critical loads, against solids, and their seconds.

python3 tools/dev.py bench structure [--plain] [--json FILE]

The solids are those of ``database/design_solid``, cubic elements of every spiral as it is cut; they take some minutes. ``--plain`` leaves
them out. Both are pushed by the fall of their middle, so that they go past their limit points.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from equilibrium_cases import EDGE
from equilibrium_cases import dome as dome_of
from flexmaps.engine.extras.structure.actions import Action
from flexmaps.engine.extras.structure.buckling import linear_buckling
from flexmaps.engine.extras.structure.load_path import Path as LoadPath
from flexmaps.engine.extras.structure.load_path import PathFollower, follow
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.equilibrium import solve
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.params import SimulateParams
from harness import Bench
from rows import Table, at_most, note
from structure_cases import Pushed, arch, by_solid, dome, turned_pair

# spirals a side, height, width and twist of a dome of arms hardly longer than wide, where the model itself is some percent too stiff
SHORT = (6, 0.12, 2.0, 60.0)
FALLS = (0.15, 0.4, 0.7, 0.9, 1.0, 1.15)  # of the fall at which a piece snaps, at which its solid is solved
TURNS = (0.02, 0.2, 0.4)  # radians between two hubs; the quads of that dome lie at 0.24 to each other
BELOW = 0.8  # of the limit load, up to which deflections are compared: nearer to it they grow without bound
SIZES = (150, 600, 1000)  # approximate numbers of spirals


def main(arguments: list[str]) -> int:
    """Measure everything, print the table, write the rows; return 0 whatever the figures."""
    bench = Bench("structure", arguments, 52, plain=(False, "leave the solids out"))
    table = bench.table
    if not bench.options.plain:
        for piece in (arch(), dome(), dome(*SHORT)):
            solids(table, piece, piece.path(100.0))
        finite_turns(table)
    pressures(table)
    seconds(table)
    return bench.finish()


def _follower(model: ArmModel, loads: Loads, action: Action, pose: object) -> PathFollower:
    held = loads.held_increments(model.pairs, pose.centres)  # type: ignore[attr-defined]
    return PathFollower(model, NewtonSystem(model.pairs, held), action, 1e-9)


def solids(table: Table, piece: Pushed, path: LoadPath) -> None:
    """Limit load and deflections against the solid of the whole design."""
    assert path.critical is not None
    falls = piece.fall(path.last.pose) * np.array(FALLS)
    begun = time.process_time()
    forces = by_solid(piece, falls)
    spent = time.process_time() - begun
    top = int(np.nanargmax(forces))
    near = slice(max(top - 1, 0), max(top - 1, 0) + 3)
    a, b, c = np.polyfit(falls[near] / falls[top], forces[near], 2)
    limit = c - b * b / (4.0 * a) if top + 1 < len(forces) else forces[top]
    peer = {"model": f"{path.critical:.4g} N", "solid": f"{limit:.4g} N", "seconds": f"{spent:.0f}"}
    table.add(at_most(piece.name, "limit load off the solid's", 0.05, abs(path.critical / limit - 1.0), peer))
    usual = [(fall, force) for fall, force in zip(falls, forces, strict=True) if force < BELOW * limit]
    marked = piece.path(path.critical, tuple(force for _, force in usual)).marks
    off = [abs(piece.fall(marked[force].pose) / fall - 1.0) for fall, force in usual]
    peer = {f"{force:.3g} N": f"{1e3 * fall:.3f} mm" for fall, force in usual}
    table.add(at_most(piece.name, "deflection off the solid's", 0.02, max(off), peer))


def finite_turns(table: Table) -> None:
    """Check that the error of a joint of short arms against its solid does not grow with the rotation; else its second order is wrong."""
    for name, axis in (("twisted", (1.0, 0.0, 0.0)), ("bent", (0.0, 1.0, 0.0)), ("bent in the sheet", (0.0, 0.0, 1.0))):
        off = turned_pair(SHORT[2], SHORT[3], axis, TURNS)
        peer = {f"{angle:g} rad": f"{100.0 * one:+.2f} %" for angle, one in zip(TURNS, off, strict=True)}
        table.add(at_most(f"pair {name}", "its energy's error, largest less smallest", 0.005, float(np.ptp(off)), peer))


def pressures(table: Table) -> None:
    """Measure the effect of pressures that turn with the hubs, and of their exact tangent."""
    piece = dome()
    count = len(piece.rest.pose.centres)
    follows = Action(np.zeros((count, 3)), np.full(count, -1.0), np.zeros((count, 3)))
    stays = Action(follows.at(piece.rest.pose), np.zeros(count), np.zeros((count, 3)))
    rows = {}
    for name, action in (("follows", follows), ("keeps its direction", stays)):
        one = replace(piece.follower, action=action)
        begun = time.process_time()
        path = follow(one, piece.rest.pose, marks=(), most=200.0)
        rows[name] = f"{path.critical or np.inf:.4g} N a spiral, {time.process_time() - begun:.2g} s"
    table.add(note(piece.name, "pressure at which it gives way", "", rows))


def seconds(table: Table) -> None:
    """Measure the processor seconds of load paths of domes under pressure up to collapse, and of linear buckling."""
    for size in SIZES:
        found = dome_of(size)
        low = found.pose.centres[:, 2] < np.quantile(found.pose.centres[:, 2], 0.1)
        loads = Loads.for_spirals(len(low), supports=np.flatnonzero(low))
        rest = solve(found.arm, found.pose, loads, SimulateParams())
        action = Action.none(len(low))
        action.force[:, 2] = -0.2 * EDGE**2 * 1e3
        one = _follower(found.arm, loads, action, rest.pose)
        begun = time.process_time()
        path = follow(one, rest.pose, most=10.0)
        spent = time.process_time() - begun
        linear_buckling(one, path.points[0])
        quick = time.process_time() - begun - spent
        peer: dict[str, Any] = {"points": len(path.points), "gives way at": f"{path.critical or np.inf:.3g}"}
        peer["linear buckling"] = f"{quick:.2g} s"
        table.add(note(f"dome of {len(low)}", "seconds of a load path", float(f"{spent:.3g}"), peer))
