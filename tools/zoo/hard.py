"""Surfaces on which the optimiser easily stalls: double walls, lattices, folds, roofs on free borders."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh

from . import irregular as ir
from . import pieces
from . import smooth as sm


def double_wall(
    sectors: int, rows: int, height: float, gap: float, flare: float = 0.0, fillet: float = 0.0
) -> QuadMesh:
    """A vessel of two walls that meet in its lip; the inner one has a bottom, the outer one ends in a free border.

    rows : quads along the outer wall, and along the inner one without a fillet; gap : between the walls over the outer radius; flare : how much wider it is at its lip
    fillet : radius between the inner wall and the bottom over the outer radius; 0 for a sharp fold
    """
    inner, each = 1.0 - gap, height / rows
    bottom = sm.steps(0.0, inner - fillet, max(2, round((inner - fillet) / each)))[:-1]
    corner = np.linspace(0.0, 0.5 * np.pi, 1 + round(0.5 * np.pi * fillet / each))[:-1]
    up = sm.steps(gap + fillet, height, round((height - gap - fillet) / each) if fillet else rows)
    lip = np.linspace(0.0, np.pi, 1 + max(3, round(0.5 * np.pi * gap / each)))[1:-1]
    radius = np.concatenate([
        bottom, inner - fillet * (1.0 - np.sin(corner)), np.full(len(up), inner),
        inner + 0.5 * gap * (1.0 - np.cos(lip)), np.ones(rows + 1),
    ])  # fmt: skip
    z = np.concatenate([
        np.full(len(bottom), gap), gap + fillet * (1.0 - np.cos(corner)), up,
        height + 0.5 * gap * np.sin(lip), sm.steps(height, 0.0, rows),
    ])  # fmt: skip
    wide = radius * (1.0 + flare * z / height)

    def place(k: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, ...]:
        k = k.astype(int)
        return wide[k] * np.cos(a), wide[k] * np.sin(a), z[k]

    return pieces.polar(place, np.arange(len(radius)), sectors)


def lattice(side: int, period: int, rise: float, across: float = 1.0) -> QuadMesh:
    """A shell of bars: a vault, or a dome with ``across`` 1, without the inner quads of every ``period`` both ways."""
    u = sm.steps(-1, 1, side)
    shell = pieces.sheet(lambda x, y: (x, y, rise * (1.0 - x**2 - across * (y**2 - 1.0))), u, u)
    i, j = np.divmod(np.arange(side * side), side)
    return pieces.without_quads(shell, (i % period != 0) & (j % period != 0))


def fluted(folds: int, each: int, rows: int, depth: float, height: float, twist: float = 0.0) -> QuadMesh:
    """A tube of sharp folds along it, a star in plan; each flank is ``each`` quads wide; ``twist`` in radians."""
    sectors = 2 * folds * each

    def place(z: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, ...]:
        share = np.abs((folds * a / np.pi) % 2.0 - 1.0)
        turned = a + twist * z / height
        return (1.0 - depth * share) * np.cos(turned), (1.0 - depth * share) * np.sin(turned), z

    return pieces.sheet(place, sm.steps(0, height, rows), sm.turn(sectors), (False, True))


def roof(side: int, rows: int, rise: float, wave: float, waves: int = 1) -> QuadMesh:
    """A hall's roof: an arch one way, with a free border that swings up and down the other way."""
    return pieces.sheet(
        lambda x, y: (x, 1.4 * y, rise * (1.0 - x**2) * (1.0 + wave * np.cos(waves * np.pi * y))),
        sm.steps(-1, 1, side),
        sm.steps(-1, 1, rows),
    )


# by name; 60 to 430 quads each, so that a search takes seconds; the mug has 1,365
SURFACES: dict[str, Callable[[], QuadMesh]] = {
    "mug": partial(double_wall, 42, 14, 2.0, 0.3, fillet=0.3),
    "mug-folded": partial(double_wall, 20, 8, 2.0, 0.2),
    "bowl": partial(double_wall, 20, 5, 0.9, 0.3, 0.3),
    "beaker": partial(double_wall, 16, 10, 2.6, 0.25, 0.25),
    "lattice-dome": partial(lattice, 21, 4, 0.4),
    "lattice-vault": partial(lattice, 21, 4, 0.7, 0.0),
    "lattice-saddle": partial(lattice, 21, 5, 0.4, -1.0),
    "pen-holder": partial(fluted, 6, 3, 12, 0.3, 2.2),
    "pen-holder-twisted": partial(fluted, 5, 3, 12, 0.3, 2.2, 0.6),
    "hall": partial(roof, 16, 20, 0.5, 0.3),
    "hall-waves": partial(roof, 14, 22, 0.6, 0.25, 2),
    "saddle8": partial(sm.saddle, 8, 8, 0.4),
    "saddle10": partial(sm.saddle, 10, 10, 0.4),
    "saddle14": partial(sm.saddle, 14, 14, 0.4),
    "gable": partial(ir.folded, 14, 14, 1, 0.7),
    "tents": partial(ir.tents, 14, 0.6),
    "dome": partial(shapes.dome, 8),
    "hypar": partial(sm.hypar, 12, 0.6),
    "form-found": partial(sm.soap_frame, 16, 0.5, 2),
    "perforated": partial(ir.perforated, 14, 5, 0.3),
    "oculus": partial(ir.oculus, 10, 25),
    "tower": partial(sm.hyperboloid, 24, 12, 0.6),
    "ball": partial(shapes.cubesphere, 5),
}
