"""Benchmark of critical loads and deflections of load paths against solids.

The solids have cubic elements of every spiral as it is cut; they take some minutes. Middles are pushed past their limit points.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from harness import Bench, Options, Rows, at_most, measure_time
from structure_cases import Pushed, arch, by_solid, dome, turned_pair

# spirals a side, height, width and twist of a dome of arms hardly longer than wide, where the model itself is some percent too stiff
SHORT = (6, 0.12, 2.0, 60.0)
FALLS = (0.15, 0.4, 0.7, 0.9, 1.0, 1.15)  # of the fall at which a piece snaps, at which its solid is solved
TURNS = (0.02, 0.2, 0.4)  # radians between two hubs; the quads of that dome lie at 0.24 to each other
AXES = {"twisted": (1.0, 0.0, 0.0), "bent": (0.0, 1.0, 0.0), "bent in the sheet": (0.0, 0.0, 1.0)}  # of the turns
BELOW = 0.8  # of the limit load, up to which deflections are compared: nearer to it they grow without bound


def solids(make: partial[Pushed], _: Options) -> Rows:
    """Limit load and deflections against the solid of the whole design."""
    piece = make()
    path = piece.path(100.0)
    assert path.critical is not None
    falls = piece.fall(path.last.pose) * np.array(FALLS)
    spent, forces = measure_time(lambda: by_solid(piece, falls))
    top = int(np.nanargmax(forces))
    near = slice(max(top - 1, 0), max(top - 1, 0) + 3)
    a, b, c = np.polyfit(falls[near] / falls[top], forces[near], 2)
    limit = c - b * b / (4.0 * a) if top + 1 < len(forces) else forces[top]
    loads = {"model": f"{path.critical:.4g} N", "solid": f"{limit:.4g} N", "seconds": f"{spent:.0f}"}
    usual = [(fall, force) for fall, force in zip(falls, forces, strict=True) if force < BELOW * limit]
    marked = piece.path(path.critical, tuple(force for _, force in usual)).marks
    off = [abs(piece.fall(marked[force].pose) / fall - 1.0) for fall, force in usual]
    deflections = {f"{force:.3g} N": f"{1e3 * fall:.3f} mm" for fall, force in usual}
    return [
        at_most(piece.name, "limit load off the solid's", 0.05, abs(path.critical / limit - 1.0), loads),
        at_most(piece.name, "deflection off the solid's", 0.02, max(off), deflections),
    ]


def finite_turn(name: str, _: Options) -> Rows:
    """Check that the error of a joint of short arms against its solid does not grow with the rotation; else its second order is wrong."""
    off = turned_pair(SHORT[2], SHORT[3], AXES[name], TURNS)
    peer = {f"{angle:g} rad": f"{100.0 * one:+.2f} %" for angle, one in zip(TURNS, off, strict=True)}
    return [at_most(f"pair {name}", "its energy's error, largest less smallest", 0.005, float(np.ptp(off)), peer)]


PIECES = {"arch": partial(arch), "dome": partial(dome), "short": partial(dome, *SHORT)}
CASES = {name: partial(solids, make) for name, make in PIECES.items()} | {
    name: partial(finite_turn, name) for name in AXES
}
main = Bench("structure", CASES)
