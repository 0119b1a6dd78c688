"""Remedies for a piece that misses its target, offered by buttons: cut, larger size, thinner sheet, finer quads.

``match_limits`` decides which remedies apply; this module computes their amounts. It imports no numerics, so that the
sidebar draws fast.
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
# function from a factor on the size and a sheet thickness, metres, to the ratio of the largest strain to its limit
StrainForecast = Callable[[float, float], float]

# Smallest factor on the size for spirals that are as soft as possible, a step of the R10 series of preferred sizes.
# Larger: nearer to the target, larger pieces (docs/tuning.md)
MIN_SOFT_FACTOR = 1.25
MAX_FACTOR = 2.0  # largest factor on the size per press of the button; another press continues from there; by eye
# Largest number of sizes whose strain is computed. Strain is nearly inverse to size, so the second is mostly right
MAX_SIZES = 3
# Largest number of thinner sheets whose strain is computed: down to about a quarter of the thickness. More: slower
MAX_SHEETS = 6
FACTOR_STEP = 0.05  # factors on the size are rounded up to a multiple of it
# Factor on the number of quads. Larger: nearer to the target where quads are distorted, more to make (docs/tuning.md)
QUAD_FACTOR = 2
# Ratio of the softest spirals' strain to its limit above which a larger size is advised. Larger: fewer warnings, more
# pieces too small (docs/tuning.md)
SOFTEST_LIMIT = 1.6
SOFTEST_AIM = 1.2  # ratio of the softest spirals' strain to its limit after the advised scaling; smaller: larger pieces
# Power of the size by which the strain of the softest spirals falls, as larger quads have room for more turns; smaller:
# larger pieces
SOFTEST_POWER = 2.5
# sheet thicknesses on sale in one decade: the series R''10 of ISO 497
SHEET_SERIES = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
MILLIMETRES = SHOWN["m"][0]
# RMS distance from the target, in percent of the size, up to which a piece needs no remedy: 5 mm on half a metre.
# Chosen by eye
WANTED_PERCENT = 1.0


def wanted_percent(choose: Any) -> float:
    """Return the wanted RMS distance from the target, in percent of the size; ``choose`` : settings of the layout."""
    return float(choose.match) if choose.goal == "match" else WANTED_PERCENT


def remedy_amounts(
    advised: Collection[str],
    *,
    strain: float | None,
    soft: bool,
    thickness: float,
    quads: int,
    forecast: StrainForecast | None = None,
) -> Amounts:
    """Return the amount of every advised remedy, by name, for ``report.json``; leave out impossible remedies.

    Parameters
    ----------
    advised : names of remedies
    strain : ratio of the largest strain to the material's limit less a safety margin; None if not known
    soft : whether most of the mismatch lies in spirals that are as soft as possible
    thickness : thickness of the present sheet, metres
    quads : present number of quads
    forecast : function from a factor on the size and a thickness, metres, to ``strain``; None if it cannot be computed

    Returns
    -------
    By name: factor on the size (larger), millimetres (thinner), number of quads (finer), None (cut).
    """
    if forecast is None or strain is None or strain <= 1.0:
        times = size_factor(strain, soft=soft)
        sheet = thinner_sheet(thickness, times)
    else:
        times = size_factor(strain, soft=soft, forecast=lambda factor: forecast(factor, thickness))
        sheet = thinner_sheet(thickness, times, forecast=lambda metres: forecast(1.0, metres))
    found: Amounts = {CUT: None, LARGER: times, FINER: quad_count(quads)}
    found[THINNER] = None if sheet is None else round(sheet * MILLIMETRES, 6)
    return {name: found[name] for name in advised if name == CUT or found[name] is not None}


def size_factor(strain: float | None, *, soft: bool, forecast: Callable[[float], float] | None = None) -> float:
    """Return the factor on the size that brings the strain below its limit, at most ``MAX_FACTOR``.

    A sheet of thickness h bent to a radius R is strained by h / 2R (Euler and Bernoulli); a strip of length l whose
    ends rotate against each other is strained by h / 2l times the angle. Both are inverse to the size, so the factor is
    the ratio of the strain to its limit. Larger pieces have less strain than that, because their arms can be wound more
    (docs/tuning.md).

    Parameters
    ----------
    strain, soft : as in ``remedy_amounts``; if ``soft``, the factor is at least ``MIN_SOFT_FACTOR``
    forecast : function from a factor on the size to the ratio of the strain to its limit; None if not computable
    """
    times, enough = _round_up(max(strain or 0.0, MIN_SOFT_FACTOR if soft else 1.0)), None
    for _ in range(MAX_SIZES if forecast is not None else 0):
        assert forecast is not None
        share = forecast(times)
        if share <= 1.0:
            enough = times
        again = max(_round_up(times * share), MIN_SOFT_FACTOR if soft else 1.0)
        if again == times or (enough is not None and again >= enough):
            break
        times = again
    return times if enough is None else enough


def size_of_softest(strain: float | None) -> float:
    """Return the advised factor on the size of a piece that is not optimised yet, up to ``MAX_FACTOR``; 1 for none.

    strain : ratio of the piece's strain with its softest spirals to the limit; None if not known
    """
    if strain is None or strain <= SOFTEST_LIMIT:
        return 1.0
    return _round_up((strain / SOFTEST_AIM) ** (1.0 / SOFTEST_POWER))


def _round_up(times: float) -> float:
    """Round a factor on the size up to a multiple of ``FACTOR_STEP``, at most ``MAX_FACTOR``."""
    return round(min(MAX_FACTOR, FACTOR_STEP * math.ceil(times / FACTOR_STEP - 1e-6)), 2)


def thinner_sheet(thickness: float, times: float, *, forecast: Callable[[float], float] | None = None) -> float | None:
    """Return the thickest sheet on sale, metres, that brings the strain below its limit; None if there is none.

    Without ``forecast``, strain is taken to be proportional to the thickness (see ``size_factor``). The sheet found may
    then be too thick: strains of twisted arms that are thicker than wide fall more slowly (docs/tuning.md).

    Parameters
    ----------
    thickness : thickness of the present sheet, metres
    times : factor by which the strain has to fall, which is also the one by which the size would have to grow; ignored
        with ``forecast``
    forecast : function from a thickness, metres, to the ratio of the strain to its limit; None if it cannot be computed
    """
    least = next(f for f in fields(SpiralParams) if f.name == "thickness").metadata["low"]
    most = thickness / max(times, 1.0) if forecast is None else thickness
    usual = [share * 10.0**decade for decade in range(-5, 0) for share in SHEET_SERIES]
    fitting = sorted(
        (sheet for sheet in usual if least * (1 - 1e-6) <= sheet < 0.999 * thickness and sheet <= most * (1 + 1e-6)),
        reverse=True,
    )
    return next((sheet for sheet in fitting[:MAX_SHEETS] if forecast is None or forecast(sheet) <= 1.0), None)


def quad_count(quads: int) -> int | None:
    """Return ``QUAD_FACTOR`` times the number of quads; None if that exceeds the largest value of the setting."""
    most = next(f for f in fields(RemeshParams) if f.name == "quads").metadata["high"]
    return QUAD_FACTOR * quads if QUAD_FACTOR * quads <= most else None


def read_block(block: Mapping[str, Any]) -> Amounts:
    """Return the remedies stored in a ``reach`` block of report.json.

    Blocks of earlier versions have none; there the remedy "cut" is read from the sentence of advice.
    """
    if "remedies" in block:
        return {name: amount for name, amount in block["remedies"].items() if name in REMEDIES}
    return {CUT: None} if "cut" in block["advice"] else {}
