"""Benchmark of load paths and critical loads, against closed forms, an independent computation, and solids.

python3 tools/dev.py bench structure [--plain] [--json FILE]

The solids are those of ``database/design_solid``, cubic elements of every spiral as it is cut; they take some minutes. ``--plain`` leaves
them out. Both are pushed by the fall of their middle, so that they go past their limit points.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from equilibrium_cases import EDGE, MATERIAL, straight_row
from equilibrium_cases import dome as dome_of
from flexmaps.engine.extras.structure.actions import Action
from flexmaps.engine.extras.structure.buckling import linear_buckling
from flexmaps.engine.extras.structure.load_path import Path as LoadPath
from flexmaps.engine.extras.structure.load_path import PathFollower, follow
from flexmaps.engine.mechanics.arms.compliances import arm_compliances
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.equilibrium import solve
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.params import SimulateParams
from harness import Bench
from rows import Table, at_most, row
from structure_cases import Pushed, arch, by_solid, dome, turned_pair

HUBS = 31  # of the column
THIN = 0.001  # metres, of its sheet
# spirals a side, height, width and twist of a dome of arms hardly longer than wide, where the model itself is some percent too stiff
SHORT = (6, 0.12, 2.0, 60.0)
FALLS = (0.15, 0.4, 0.7, 0.9, 1.0, 1.15)  # of the fall at which a piece snaps, at which its solid is solved
TURNS = (0.02, 0.2, 0.4)  # radians between two hubs; the quads of that dome lie at 0.24 to each other
BELOW = 0.8  # of the limit load, up to which deflections are compared: nearer to it they grow without bound
SIZES = (150, 600, 1000)  # approximate numbers of spirals


def main(arguments: list[str]) -> int:
    """Measure everything, print the table, write the rows; return 0 whatever the figures."""
    bench = Bench("structure", arguments, 52, plain=(False, "leave the solids out"))
    table, plain = bench.table, bench.options.plain
    column(table)
    small_loads(table)
    derivatives(table)
    for piece in (arch(), dome(), dome(*SHORT)):
        path = piece.path(100.0)
        itself(table, piece, path)
        if not plain:
            solids(table, piece, path)
    if not plain:
        finite_turns(table)
    pressures(table)
    seconds(table)
    return bench.finish()


def column(table: Table) -> None:
    """A straight strip of straight arms, clamped at one end and pushed at the other: Euler with the shear of Engesser (1889).

    EI is the model's own: a joint's compliance in bending about the axis in the sheet, spread over one spiral. The sheet is thin, for in
    its plane the arms give way sideways as they are pushed: a column that is bent from the start never branches.
    """
    found = straight_row(HUBS)
    thin = replace(found.assembly, thickness=THIN)
    compliance, length = arm_compliances(thin, MATERIAL).values[0].sum(axis=0), EDGE * (HUBS - 1)
    euler = np.pi**2 * EDGE / compliance[4, 4] / (4.0 * length**2)
    wanted = euler / (1.0 + euler * compliance[2, 2] / EDGE)
    action = Action.none(HUBS)
    action.force[-1, 0] = -wanted
    one = _follower(
        ArmModel.from_assembly(thin, MATERIAL), Loads.for_spirals(HUBS, supports=np.array([0])), action, found.pose
    )
    path = follow(one, found.pose, marks=(), most=2.0)
    quick = linear_buckling(one, path.points[0])
    assert path.critical is not None and quick is not None
    table.add(at_most(f"column of {HUBS}", "critical load off Euler and Engesser", 0.01, abs(path.critical - 1.0)))
    table.add(at_most(f"column of {HUBS}", "linear buckling off Euler and Engesser", 0.01, abs(quick - 1.0)))


def _follower(model: ArmModel, loads: Loads, action: Action, pose: object) -> PathFollower:
    held = loads.held(model.pairs, pose.centres)  # type: ignore[attr-defined]
    return PathFollower(model, NewtonSystem(model.pairs, held), action, 1e-9)


def small_loads(table: Table) -> None:
    """The tip of a cantilever moves in proportion to small point loads."""
    found = straight_row(HUBS)
    action = Action.none(HUBS)
    action.force[-1, 2] = 1e-6
    one = _follower(found.arm, Loads.for_spirals(HUBS, supports=np.array([0])), action, found.pose)
    path = follow(one, found.pose, marks=(1.0, 2.0, 5.0), most=5.0)
    tips = np.array([path.marks[k].pose.centres[-1, 2] / k for k in (1.0, 2.0, 5.0)])
    table.add(
        at_most(f"row of {HUBS}", "tip over load, between 1 and 5 times a small one", 1e-3, np.ptp(tips) / tips[0])
    )


def derivatives(table: Table) -> None:
    """Compare the derivatives of a pressure's forces by the hubs' turns, and of the residual by moving supports, with central differences."""
    piece = arch()
    pose = piece.rest.pose
    count = len(pose.centres)
    rng = np.random.default_rng(0)
    action = Action(np.zeros((count, 3)), rng.normal(size=count), np.zeros((count, 3)))
    action.shift[piece.loads.fixed[:, 0]] = [0.001, -0.002, 0.003]
    one, model = replace(piece.follower, action=action), piece.model
    way, step = rng.normal(size=(count, 6)) * ~one.system.held, 1e-4

    def difference(found: object) -> np.ndarray:
        near, far = (found(k * step) - found(-k * step) for k in (1, 2))  # type: ignore[operator]
        return (8.0 * near - far) / (12.0 * step)

    forces = difference(lambda s: -2.0 * action.at(pose.moved(s * way)))
    told = one.system.full(one.follows(pose, 2.0) @ one.system.reduced(way))[:, :3]
    free = ~one.system.held[:, 0]
    error = np.abs(told - forces)[free].max() / np.abs(forces[free]).max()
    table.add(at_most("arch 2 x 9", "pressure's tangent against differences", 1e-6, float(error)))

    def residual(factor: float) -> np.ndarray:
        moved = model.start(pose.moved(np.hstack([factor * action.shift, np.zeros((count, 3))])))
        return one.residual(model.expand(moved), moved.pose, factor)

    pull = one.pull(model.expand(model.start(pose)), pose)
    error = np.abs(pull + difference(residual)).max() / np.abs(pull).max()
    table.add(at_most("arch 2 x 9", "moved supports' pull against differences", 1e-6, float(error)))


def itself(table: Table, piece: Pushed, path: LoadPath) -> None:
    """The limit of the path against the most that the middle bears while its height, not its force, is held."""
    assert path.critical is not None
    fall = piece.fall(path.last.pose)
    pose, most = piece.rest.pose, 0.0
    for share in np.linspace(0.05, 1.1, 120):
        pose = piece.at_fall(pose, float(share) * fall)
        gradient = piece.model.expand(piece.model.start(pose)).gradient
        most = max(most, -float(gradient[piece.middle, 2].sum()))
    quick = linear_buckling(piece.follower, path.points[0])
    peer = {"limit": f"{path.critical:.4g} N", "linear buckling": "-" if quick is None else f"{quick:.4g} N"}
    table.add(
        at_most(piece.name, "limit load off that with the fall held", 1e-3, abs(path.critical / most - 1.0), peer)
    )


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
    table.add(row(piece.name, "pressure at which it gives way", "", "", None, rows))


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
        peer = {
            "points": len(path.points),
            "gives way at": f"{path.critical or np.inf:.3g}",
            "linear buckling": f"{quick:.2g} s",
        }
        table.add(row(f"dome of {len(low)}", "seconds of a load path", "", float(f"{spent:.3g}"), None, peer))
