"""Pieces of plywood on which the arm model is compared with full solids: see ``validation_cases``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from ..engine.materials import MATERIALS, Material
from ..engine.spirals.design import SpiralDesign
from .validation_cases import Case, Held, Loading, cantilever, clamped, dome, ring, saddle, sheet, shells

FIVE_PLIES = MATERIALS["birch"]


def three_plies() -> Material:
    """Birch plywood of three plies: 16 times as stiff along the grain as across it (Handbook of Finnish Plywood, 4 mm)."""
    known = FIVE_PLIES.orthotropy
    assert known is not None
    return replace(FIVE_PLIES, orthotropy=replace(known, along=16.5e9, across=1.03e9))


def laid(make: Callable[[], SpiralDesign], angle: float) -> Callable[[], SpiralDesign]:
    """The same design with the grain at an angle in degrees to the x axis of every panel."""

    def turned() -> SpiralDesign:
        design = make()
        return replace(design, params=replace(design.params, grain=math.radians(angle)))

    return turned


def grained() -> list[Case]:
    """Pieces of plywood: a patch pulled in many ways, sheets of three plies, a dome on its feet, a ring and a saddle that spring up.

    They are strained up to four times as far as plywood bears.
    """
    home = Held(0)
    patch = (
        Loading("corner", (home,), ((8, (0.0, 0.0, 0.3)),)),
        Loading("wring", clamped(3, 3), ((2, (0.0, 0.0, 0.8)), (8, (0.0, 0.0, -0.8)))),
        Loading("mixed", (home,), ((8, (0.6, -0.3, 0.3)), (2, (0.0, 0.3, -0.15)))),
    )
    pushed = tuple(one for case in shells() if case.name == "dome" for one in case.loadings)
    bent = (cantilever("bent", 4, 4, 0.0, 0.0, 0.2), cantilever("aside", 4, 4, 0.0, 0.6, 0.0))
    return [
        Case("grain-patch", laid(lambda: sheet(3, 3, 1.5, 180.0), 30.0), patch, material=FIVE_PLIES),
        Case("grain-across", laid(lambda: sheet(4, 4, 1.2, 250.0), 90.0), bent, material=three_plies()),
        Case("grain-dome", dome, pushed, material=FIVE_PLIES),
        Case("grain-ring", laid(lambda: ring(8, 3, 1.5, 250.0), 20.0), (Loading("free"),), material=three_plies()),
        Case("grain-saddle", saddle, (Loading("free"),), material=three_plies()),
    ]
