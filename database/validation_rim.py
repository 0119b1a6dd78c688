"""Designs with a rim on which the elastic models are compared with full solids; its holes are left out there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from ..engine.spirals.design import SpiralDesign
from ..engine.spirals.fabricable import make_fabricable
from .validation_cases import PARAMS, Case, Loading, cantilever, cases, dome, saddle, sheet, shells
from .validation_grain import grained

RIM = replace(PARAMS, border="rim", rim_width=0.004, rim_hole=0.0)  # metres: two and a half arms wide, as by default


def rimmed(make: Callable[[], SpiralDesign]) -> Callable[[], SpiralDesign]:
    """The same design with a rim, and with arms at the border that have room to meet it."""

    def made() -> SpiralDesign:
        design = make()
        return make_fabricable(design.flat, RIM, design.width, design.twist)

    return made


def rims() -> list[Case]:
    """A sheet with a rim all round that is clamped at one side and pulled at the other, a dome on its feet, a saddle that springs up."""
    pushed = tuple(one for case in shells() if case.name == "dome" for one in case.loadings)
    return [
        Case("rim-sheet", rimmed(lambda: sheet(4, 4, 1.5, 150.0)), (cantilever("bent", 4, 4, 0.0, 0.0, 2.0),)),
        Case("rim-dome", rimmed(dome), pushed),
        Case("rim-saddle", rimmed(saddle), (Loading("free"),)),
    ]


def every_case() -> list[Case]:
    """All cases: those without a grain, those with one, those with a rim."""
    return cases() + grained() + rims()
