"""From the file to the workshop: the calibration sheet's figures from played measurements, and its formulas against solids.

python3 tools/dev.py bench workshop [--draws N] [--only calibration,fill] [--json FILE]

Played measurements: every reading of a kerf comb's gap, of the sag of a strip and of two spirals has an error of 2 % (normal), three
readings each, on sheets of random thickness, kerf, modulus and Poisson's ratio.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from flexmaps.database import coupons as solids
from flexmaps.engine.calibrating import bending
from flexmaps.engine.calibrating.calibrate import Readings, calibrate
from flexmaps.engine.calibrating.coupons import GRAVITY, Coupons, coupons
from flexmaps.engine.params import Settings, changed
from rows import Row, Table, at_most, row

NOISE, READINGS = 0.02, 3
SHEETS = {
    "POM 2 mm": {},
    "birch 4 mm": {"material.material": "birch", "spiral.thickness": 4},
    "PLA 1 mm": {"material.material": "pla", "spiral.thickness": 1},
}


def main(arguments: list[str]) -> int:
    """Measure, print the table, write the rows; 0 whatever was measured."""
    parser = argparse.ArgumentParser(prog="dev.py bench workshop")
    parser.add_argument("--draws", type=int, default=150, help="calibrations that are played")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    options = parser.parse_args(arguments)
    table = Table(34)
    table.add(*played(options.draws))
    for name, values in SHEETS.items():
        table.add(*against_solids(name, coupons(changed(Settings(), values))))
    table.finish(options.json)
    return 0


def played(draws: int) -> list[Row]:
    """How far modulus and kerf come back from what they were played with."""
    random, youngs, kerfs, sure = np.random.default_rng(0), [], [], []
    warned = 0
    for _ in range(draws):
        h, kerf, assumed = random.uniform(1.0, 5.0), random.uniform(0.08, 0.3) * 1e-3, random.uniform(0.1, 0.25)
        made = coupons(changed(Settings(), {
            "spiral.thickness": h, "cut.kerf_outline": assumed, "cut.kerf_holes": assumed, "material.material": "custom",
            "material.youngs": 5.0, "material.poisson": random.uniform(0.2, 0.42),
        }))  # fmt: skip
        true = 1e9 * float(np.exp(random.uniform(np.log(1.5), np.log(12.0))))
        found = calibrate(made, _noisy(made, true, kerf, random))
        assert found.youngs is not None and found.kerf is not None
        youngs.append(abs(found.youngs.value / true - 1.0))
        sure.append(youngs[-1] <= 2.0 * found.youngs.share)
        kerfs.append(1e3 * abs(found.kerf.value - kerf))
        warned += bool(found.warnings)
    return [
        row("played", "modulus, median error %", "", 100.0 * float(np.median(youngs)), None),
        at_most("played", "modulus, error % of 95 in 100", 3.0, 100.0 * float(np.quantile(youngs, 0.95))),
        row("played", "modulus within twice its told error", "", float(np.mean(sure)), None),
        row("played", "kerf, median error mm", "", float(np.median(kerfs)), None),
        at_most("played", "kerf, error mm of 95 in 100", 0.02, float(np.quantile(kerfs, 0.95))),
        row("played", "calibrations with a warning", "", warned / draws, None),
    ]


def _noisy(made: Coupons, youngs: float, kerf: float, random: np.random.Generator) -> Readings:
    """Readings of pieces of that modulus and kerf, each with its error; the weights are those engraved."""
    outline, arms = made.kerf - kerf, made.kerf_holes - kerf
    sag = bending.strip_sag(made, youngs, made.strip_load, width=made.strip_width + outline)
    stiff = [bending.spiral_stiffness(made, s.scale, s.width + arms, s.twist, youngs) for s in made.spirals]
    sags = [s.load * GRAVITY / k for s, k in zip(made.spirals, stiff, strict=True)]

    def read(value: float) -> float:
        return value * (1.0 + NOISE * float(random.standard_normal()))

    return replace(
        Readings(),
        kerf_gaps=[read((made.cells + 1) * kerf) for _ in range(READINGS)],
        strip_sags=[read(sag) for _ in range(READINGS)],
        spiral_sags=[(read(sags[0]), read(sags[1])) for _ in range(READINGS)],
    )


def against_solids(name: str, made: Coupons) -> list[Row]:
    """Sags by the formulas against solids, as errors of the modulus in percent."""
    found = []
    for times in (1.0, 2.0):
        load = times * made.strip_load
        error = bending.strip_sag(made, made.youngs, load) / solids.strip_sag(made, made.youngs, load) - 1.0
        found.append(at_most(name, f"strip, {times:g} x its weight, %", 1.0, 100.0 * abs(error)))
    for one in made.spirals:
        soft = one.load * GRAVITY / bending.spiral_stiffness(made, one.scale, one.width, one.twist, made.youngs)
        error = soft / solids.spiral_sag(made, one, made.youngs, one.load) - 1.0
        found.append(at_most(name, f"spiral {one.name}, %", 3.0, 100.0 * abs(error)))
    return found
