"""Benchmark of sheets with a grain: the arm model against orthotropic solids, and its speed.

python3 tools/dev.py bench grain [--spirals N] [--json FILE]

Single spirals have random sizes, widths, twists, grain directions and plywoods: five plies, three plies, and interpolations with other
shear moduli. ``database validate --only grain`` compares whole pieces.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from flexmaps.database import linear, table, validation
from flexmaps.database.elastic import orthotropic
from flexmaps.database.geometry import Spiral
from flexmaps.database.statics import Model
from flexmaps.database.validation_grain import FIVE_PLIES, three_plies
from flexmaps.engine.materials import Orthotropy
from flexmaps.engine.mechanics.arms.grain import GrainBeams
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.arms.stiffness import table_tip_compliance
from flexmaps.engine.mechanics.assembly import assembly_from_design
from flexmaps.engine.spirals.clearance.table_range import table_twist_limit
from harness import Bench, seconds
from rows import Row, at_most, note

# required, percent: median and largest error of single spirals' energies
MEDIAN, MOST = 3.0, 8.0
STOUT = 8.0  # size over width of a spiral; below it, arms are hardly longer than their hubs
WRENCHES = 300  # random wrenches per spiral, with moments like those of forces at half an arm's length
POISSON = 0.3  # Poisson's ratio of the table of isotropic compliances


def main(arguments: list[str]) -> int:
    """Run all parts; return 0 whatever the figures."""
    from threadpoolctl import threadpool_limits

    bench = Bench("grain", arguments, 52, spirals=(90, "random spirals whose solids are made; 0.5 s each"))
    with threadpool_limits(1):
        for part in (speed(), spirals(bench.options.spirals)):
            bench.table.add(*part)
    return bench.finish()


def plywoods(number: int, rng: np.random.Generator) -> Orthotropy:
    """Return one of three kinds of plywood in turn, with random shear moduli from those of birch plywood to 0.9 GPa."""
    five, three = FIVE_PLIES.orthotropy, three_plies().orthotropy
    assert five is not None and three is not None
    flat, steep = rng.uniform(0.4e9, 0.9e9, 2)
    if number % 3 < 2:
        return replace((five, three)[number % 3], shear_along=flat, shear_across=steep)
    ratio = math.exp(rng.uniform(0.0, math.log(16.0)))
    return Orthotropy(10e9, 10e9 / ratio, rng.uniform(0.02, 0.1), rng.uniform(0.6e9, 0.9e9), flat, steep)


def spirals(count: int) -> list[Row]:
    """Compare energies of single spirals under random wrenches at a tip with those of solids."""
    rng, errors, ratios = np.random.default_rng(2026), [], []
    for number in range(count):
        ratio, flat = (math.exp(rng.uniform(*np.log(span))) for span in ((6.0, 35.0), (0.4, 2.8)))
        twist = rng.uniform(0.0, 0.95) * float(table_twist_limit(ratio))
        angle, known = rng.uniform(-0.5, 0.5) * math.pi, plywoods(number, rng)
        true = solid(Spiral(ratio, 1.0 / flat, twist), known, angle)
        given = (np.array([v]) for v in (ratio, 1.0, twist))
        beam = GrainBeams(known, np.array([angle]), known.along, POISSON)
        model = table_tip_compliance(*given, thickness=1.0 / flat, youngs=1.0, poisson=POISSON, beam=beam).values[0]
        wrenches = rng.normal(size=(WRENCHES, 6)) * np.repeat([1.0, 0.25 * ratio], 3)
        stored = [np.einsum("wi,ij,wj->w", wrenches, one, wrenches) for one in (model, true)]
        errors.append(100.0 * (stored[0] / stored[1] - 1.0))
        ratios.append(ratio)
    found, stout, out = np.array(errors), np.array(ratios) < STOUT, []
    for name, chosen, limits in (
        (f"s/w {STOUT:g} to 35", ~stout, (MEDIAN, MOST)),
        (f"s/w 6 to {STOUT:g}", stout, (None, None)),
    ):
        size = np.abs(found[chosen])
        if size.size:
            out.append(at_most("spirals", f"{name}: energies, median %", limits[0], float(np.median(size))))
            out.append(at_most("spirals", f"{name}: energies, 95 %, %", limits[1], float(np.percentile(size, 95))))
            out.append(note("spirals", f"{name}: model softer by, median %", float(np.median(found[chosen]))))
    return out


def solid(spiral: Spiral, known: Orthotropy, angle: float) -> np.ndarray:
    """Return the (6, 6) compliance of the solid's tip, times Young's modulus along the grain; angle from radius to grain."""
    # ``linear`` loads the tip on the y axis
    stiffness = orthotropic(known, known.along, angle + 0.5 * math.pi)
    model = Model(spiral, POISSON, table.fineness_of(spiral), stiffness=stiffness)
    return linear.tip_compliance(model, linear.unit_motions(model))


def speed() -> list[Row]:
    """Measure the processor seconds of building a piece's model, with and without a grain."""
    design = next(one for one in validation.named("grain-dome")).design
    known, out = assembly_from_design(design), []
    for name, material in (("with a grain", FIVE_PLIES), ("without", replace(FIVE_PLIES, orthotropy=None))):
        spent = seconds(partial(ArmModel.from_assembly, known, material), 5)
        out.append(note("dome", f"model of {known.size} spirals {name}, ms", 1e3 * spent))
    return out
