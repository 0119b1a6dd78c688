"""Benchmark of strain estimates: largest surface strains of arms against solids of whole designs, arm by arm, and their cost.

python3 tools/dev.py bench strain [--only PATTERNS] [--solve] [--json FILE]

What the solids say lies in ``database/validation/strain``; ``--solve`` solves those that are missing or whose design is cut otherwise
today, a minute each. Arms count whose strain is above ``LARGE`` of the largest of their piece.
"""

from __future__ import annotations

import numpy as np
from flexmaps.database import validation_strain
from flexmaps.database.validation_strain import ArmStrains
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.arms.strain_changes import KINK_LIMIT, KINK_STRAIN_FACTOR, Strains
from flexmaps.engine.mechanics.assembly import assembly_from_design, target_pose
from harness import Bench, seconds
from rows import Row, at_least, at_most, note, row
from scipy.stats import spearmanr

LARGE = 0.3  # arms count whose strain exceeds this share of their piece's largest strain
CLOSE, NEAR = 0.15, 0.2  # relative errors within which estimates count as close and near


def main(arguments: list[str]) -> int:
    """Measure and print the table; return 0 whatever the figures."""
    bench = Bench("strain", arguments, 40, only="*", solve=(False, "solve the solids that are missing"))
    cases = [one for one in validation_strain.strain_cases() if bench.asked(one.name)]
    if bench.options.solve:
        print("solved:", ", ".join(validation_strain.run(cases)) or "none were missing")
    known, found = [case for case in cases if validation_strain.is_done(case)], []
    for case in known:
        states = validation_strain.compare(case)
        found += states
        bench.table.add(*_of_piece(case.name, states))
    if any(_large(one).any() for one in found):
        bench.table.add(*_of_all(found), *_of_joints(found))
    designs = row("designs", "solved", ">= 40", len(known), len(known) >= 40)
    return bench.finish(designs if bench.options.only == "*" else note("designs", "solved", len(known)), *_cost())


def _ratios(found: list[ArmStrains]) -> np.ndarray:
    """Estimate over solid of all arms that count."""
    return np.concatenate([(one.estimate / one.solid)[_large(one)] for one in found])


def _large(one: ArmStrains) -> np.ndarray:
    return (one.solid > LARGE * one.solid.max()) & (one.solid > 0.0)


def _share(ratio: np.ndarray) -> float:
    return 100.0 * float((np.abs(ratio - 1.0) < CLOSE).mean())


def _of_piece(name: str, states: list[ArmStrains]) -> list[Row]:
    ratio = _ratios(states)
    solid, guess = (max(float(getattr(one, which).max()) for one in states) for which in ("solid", "estimate"))
    spread = {f"{k} %": f"{np.percentile(ratio, k):.2f}" for k in (5, 50, 95) if len(ratio)}
    whole = {"largest %": {"solid": f"{100 * solid:.2f}", "estimate": f"{100 * guess:.2f}"}}
    return [note(name, "arms within 15 %", round(_share(ratio), 1), {f"{len(ratio)} arms": spread, **whole})]


def _of_all(found: list[ArmStrains]) -> list[Row]:
    ratio = _ratios(found)
    third = np.concatenate([(one.estimate / one.solid)[one.solid > one.limit / 3.0] for one in found])
    smooth = ratio[np.concatenate([one.kink[_large(one)] < KINK_LIMIT for one in found])]
    fillets = np.concatenate([(one.fillet / one.solid)[_large(one)] for one in found])
    rank = spearmanr(*(np.concatenate([getattr(one, n)[_large(one)] for one in found]) for n in ("solid", "estimate")))
    upper = {"95 %": f"{np.quantile(fillets, 0.95):.2f}"}
    rows = [
        at_least("all", "arms within 15 %", 90.0, _share(ratio), {"arms": str(len(ratio))}),
        note("all", "arms estimated under 0.8, %", round(100.0 * float((ratio < 1.0 - NEAR).mean()), 2)),
        at_least("all", "rank correlation", 0.95, float(rank.statistic)),
        note("all", "fillets over surface, median", round(float(np.median(fillets)), 2), upper),
    ]
    if len(third):
        peer = {"arms": str(len(third))}
        rows.insert(1, at_least("all", "those above a third of the limit", 90.0, _share(third), peer))
    if len(smooth):  # none where all arms asked for are kinked
        rows.insert(-3, at_least("all", "smallest estimate over solid, no kink", 0.8, float(smooth.min())))
    return rows


def _joints(one: ArmStrains) -> tuple[np.ndarray, np.ndarray]:
    """Estimate over solid of the joints that count, the larger of both arms each, and how sharp their kinks are."""
    count = int(one.joint.max()) + 1
    solid, guess, kink = np.zeros(count), np.zeros(count), np.zeros(count)
    for of_joints, of_arms in ((solid, one.solid), (guess, one.estimate), (kink, one.kink)):
        np.maximum.at(of_joints, one.joint, of_arms)
    large = solid > LARGE * one.solid.max()
    return guess[large] / solid[large], kink[large]


def _of_joints(found: list[ArmStrains]) -> list[Row]:
    """The larger of both arms of every joint, and the worst under-estimates by kind of joint."""
    ratio = np.concatenate([_joints(one)[0] for one in found])
    kink = np.concatenate([_joints(one)[1] for one in found])
    rim = np.concatenate([np.full(len(_joints(one)[0]), one.rim) for one in found])
    rows = [at_least("joints", "larger of both arms within 15 %", 95.0, _share(ratio), {"joints": str(len(ratio))})]
    for name, chosen, asked in (
        ("joints, smooth", (kink < KINK_LIMIT) & ~rim, 1.0 - NEAR),
        ("joints, rim", (kink < KINK_LIMIT) & rim, 1.0 - NEAR),
        ("joints, kinked", kink >= KINK_LIMIT, 1.0 / KINK_STRAIN_FACTOR),
    ):
        if chosen.any():
            close = {f"{chosen.sum()} joints": f"{_share(ratio[chosen]):.0f} %"}
            rows.append(at_least(name, "smallest estimate over solid", asked, float(ratio[chosen].min()), close))
    return rows


def _cost() -> list[Row]:
    """Microseconds of processor an arm, values alone and with all derivatives."""
    case = next(c for c in validation_strain.strain_cases() if c.name == "box")
    model = ArmModel.from_assembly(assembly_from_design(case.design), case.material)
    changes = model.changes(model.start(target_pose(case.mesh, case.design.flat.corners)))
    count = 2 * len(model.pairs)
    strains, every = Strains.from_changes(model.assembly, changes, case.material), np.tile(np.arange(count), 10)
    plain = seconds(lambda: Strains.from_changes(model.assembly, changes, case.material), 20)
    whole = seconds(lambda: strains.slopes(every), 10) / 10.0
    return [
        note("cost", "values, us an arm", round(1e6 * plain / count, 1)),
        at_most("cost", "with all derivatives, us an arm", 35.0, 1e6 * whole / count),
    ]
