"""What would bring a piece nearer, as numbers that a button can follow: a cut, a larger piece, a thinner sheet, finer quads.

``reach`` says which of them; here stands how much of each. This page imports no numerics, so that a sidebar can be drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import fields
from typing import Any

from ..params import SHOWN, RemeshParams, SpiralParams

CUT, LARGER, THINNER, FINER = "cut", "larger", "thinner", "finer"
REMEDIES = (CUT, LARGER, THINNER, FINER)
Amounts = dict[str, float | None]
Eased = Callable[[float, float], float]  # from times the size and metres of the sheet to the largest strain

# Times larger where no strain says how much: a step of R10, in which sizes are made. A dome of 192 quads that is as soft as it may
# be ends at 1.3 % of its size from the target instead of 3.0 when it is 1.5 times as large; half of that is the first step
MODEST = 1.25
MOST = 2.0  # times larger at one go, a second press goes on from what the first one brought; not measured
ROUNDS = 3  # sizes that are computed: strains fall nearly as sizes grow, so that the second one seldom misses
SHEETS = 6  # thinner ones that are computed, down to a quarter of the thickness
STEP = 0.05  # sizes are rounded up to it
# Times as many quads. With twice as many, five surfaces whose quads flattening distorts came from 2.8, 2.3, 3.0, 1.4 and 1.3 % of
# their size to 1.4, 1.2, 1.3, 0.9 and 1.2 %. Where spirals have room left it is only worth a try: three saddles that were optimised
# went from 0.56, 0.52 and 0.48 to 0.50, 0.64 and 0.73 %
DENSER = 2
# the most rounded series R''10 of ISO 497, in which most sheets are sold, per decade
SERIES = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
MILLIMETRES = SHOWN["m"][0]
# Percent of the size: RMS distance from the target up to which a piece needs no remedy. On one of half a metre it is 5 mm; by eye
WANTED = 1.0


def wanted(choose: Any) -> float:
    """Percent of the size within which a piece shall come to its target; ``choose`` : the settings of the layout."""
    return float(choose.match) if choose.goal == "match" else WANTED


def amounts(
    advised: Collection[str],
    *,
    strain: float | None,
    soft: bool,
    thickness: float,
    quads: int,
    eased: Eased | None = None,
) -> Amounts:
    """How much of every remedy that is advised, by its name, for ``report.json``; without those that cannot be followed.

    strain : the largest, as a share of what the material bears with its margin, where it is known; soft : spirals are as soft as they may be
    thickness : metres; eased : the strain, as above, if the piece were so many times larger and of so thick a sheet, where
    that can be computed
    What comes back: times the size, millimetres of the sheet, number of quads; None for a cut
    """
    if eased is None or strain is None or strain <= 1.0:
        times = larger(strain, soft=soft)
        sheet = thinner(thickness, times)
    else:
        times = larger(strain, soft=soft, eased=lambda factor: eased(factor, thickness))
        sheet = thinner(thickness, times, eased=lambda metres: eased(1.0, metres))
    found: Amounts = {CUT: None, LARGER: times, FINER: finer(quads)}
    found[THINNER] = None if sheet is None else round(sheet * MILLIMETRES, 6)
    return {name: found[name] for name in advised if name == CUT or found[name] is not None}


def larger(strain: float | None, *, soft: bool, eased: Callable[[float], float] | None = None) -> float:
    """How many times larger a piece has to be, as ``amounts``; ``eased`` computes the strain of one so many times as large.

    A sheet of thickness h that is bent to a radius R is strained by h / 2R (Euler and Bernoulli), and a strip of length l whose ends
    turn by an angle against each other by h / 2l times that angle: both fall as the size grows. So it is the excess of the
    strain. Measured on a dome and a saddle 1.5 times as large, strains fell by 1.54 to 2.2 times, as arms can be wound more.
    """
    times, enough = _stepped(max(strain or 0.0, MODEST if soft else 1.0)), None
    for _ in range(ROUNDS if eased is not None else 0):
        assert eased is not None
        share = eased(times)
        if share <= 1.0:
            enough = times
        again = max(_stepped(times * share), MODEST if soft else 1.0)
        if again == times or (enough is not None and again >= enough):
            break
        times = again
    return times if enough is None else enough


def _stepped(times: float) -> float:
    return round(min(MOST, STEP * math.ceil(times / STEP - 1e-6)), 2)


def thinner(thickness: float, times: float, *, eased: Callable[[float], float] | None = None) -> float | None:
    """Metres: the next usual sheet that is thinner by as much as a piece would have to be ``larger``; None where there is none.

    Where ``eased`` computes the strain of a sheet, it is the first of the thinner ones with which that is within its limit.

    By the same formula, which is the least that it takes: strains of twisted arms that are thicker than wide fall more slowly, on
    the dome and the saddle by 1.2 times from 3 to 2 mm.
    """
    least = next(f for f in fields(SpiralParams) if f.name == "thickness").metadata["low"]
    most = thickness / max(times, 1.0) if eased is None else thickness
    usual = [share * 10.0**decade for decade in range(-5, 0) for share in SERIES]
    fitting = sorted(
        (sheet for sheet in usual if least * (1 - 1e-6) <= sheet < 0.999 * thickness and sheet <= most * (1 + 1e-6)),
        reverse=True,
    )
    return next((sheet for sheet in fitting[:SHEETS] if eased is None or eased(sheet) <= 1.0), None)


def finer(quads: int) -> int | None:
    """How many quads, ``DENSER`` times as many as there are; None where that are more than can be asked for."""
    most = next(f for f in fields(RemeshParams) if f.name == "quads").metadata["high"]
    return DENSER * quads if DENSER * quads <= most else None


def of_block(block: Mapping[str, Any]) -> Amounts:
    """What a ``reach`` block advises; one of an earlier version says only in its sentence whether a cut would help."""
    if "remedies" in block:
        return {name: amount for name, amount in block["remedies"].items() if name in REMEDIES}
    return {CUT: None} if "cut" in block["advice"] else {}
