"""Benchmark of strain estimates: largest surface strains of arms against solids of whole designs, arm by arm, and their cost.

What the solids say lies in ``database/validation/strain``; ``--solve`` solves those that are missing or whose design is cut otherwise
today, a minute each. Arms count whose strain is above ``LARGE`` of the largest of their piece.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from flexmaps.database import validation_strain
from flexmaps.database.validation_strain import ArmStrains
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.arms.strain_changes import Strains
from flexmaps.engine.mechanics.assembly import assembly_from_design, target_pose
from harness import Bench, Cases, Options, Row, Rows, at_least, at_most, fewest_seconds, for_each, matches, note
from scipy.stats import spearmanr

LARGE = 0.3  # arms count whose strain exceeds this share of their piece's largest strain
KINK_LIMIT = 0.9  # sharpness of a kink (see ``kink_sharpness``) from which a joint counts as kinked
CLOSE, NEAR = 0.15, 0.2  # relative errors within which estimates count as close and near
SOLVED = 40  # required designs
found: list[ArmStrains] = []  # of all pieces measured


def cases(options: Options) -> Cases:
    """Return the designs whose solids are solved; with ``--solve``, solve the others before."""
    designs = [one for one in validation_strain.strain_cases() if matches(one.name, options.only.split(","))]
    if options.solve:
        print("solved:", ", ".join(validation_strain.run(designs)) or "none were missing")
    known = filter(validation_strain.is_done, designs)
    return for_each(measure, {one.name: partial(validation_strain.compare, one) for one in known})


def measure(name: str, states: list[ArmStrains], _: Options) -> Rows:
    found.extend(states)
    solid, estimate = (100.0 * max(float(getattr(one, key).max()) for one in states) for key in ("solid", "estimate"))
    largest, pool = {"largest %": {"solid": f"{solid:.2f}", "estimate": f"{estimate:.2f}"}}, _pool(states)
    return [note(name, "arms within 15 %", round(_share(pool[0] / pool[1]), 1), largest)]


def _pool(states: list[ArmStrains], of_joints: bool = False) -> np.ndarray:
    """Return estimate, solid, kink, rim and share of their piece's largest estimate of the arms that count, or of the
    larger of both arms of joints."""
    parts = []
    for one in states:
        values = np.stack([one.estimate, one.solid, one.kink])
        if of_joints:
            order = np.argsort(one.joint, kind="stable")
            values = np.maximum.reduceat(values[:, order], np.unique(one.joint[order], return_index=True)[1], axis=1)
        values = np.vstack([values, np.full(values.shape[1], one.rim), values[0] / values[0].max()])
        parts.append(values[:, (values[1] > LARGE * values[1].max()) & (values[1] > 0.0)])
    return np.concatenate(parts, axis=1)


def _share(ratio: np.ndarray) -> float:
    return 100.0 * float((np.abs(ratio - 1.0) < CLOSE).mean())


def of_all(states: list[ArmStrains]) -> Rows:
    """Return the rows over all arms and joints, and the worst under-estimates by kind of joint."""
    estimate, solid, arm_kink, _, _ = _pool(states)
    joint_estimate, joint_solid, kink, rim, share_of_largest = _pool(states, of_joints=True)
    third = np.concatenate([(one.estimate / one.solid)[one.solid > one.limit / 3.0] for one in states])
    arms, joints, smooth = estimate / solid, joint_estimate / joint_solid, kink < KINK_LIMIT
    rows = [at_least("all", "rank correlation", 0.95, float(spearmanr(solid, estimate).statistic))]
    for kind, name, ratio, share in (
        ("all", "arms within 15 %", arms, 90.0),
        ("all", "those above a third of the limit", third, 90.0),
        ("joints", "larger of both arms within 15 %", joints, 95.0),
    ):
        if len(ratio):
            rows.append(at_least(kind, name, share, _share(ratio), {"of": len(ratio)}))
    for kind, ratio, asked in (
        ("arms, no kink", arms[arm_kink < KINK_LIMIT], 1.0 - NEAR),
        ("joints, smooth", joints[smooth & (rim == 0.0)], 1.0 - NEAR),
        ("joints, rim", joints[smooth & (rim > 0.0)], 1.0 - NEAR),
        ("joints, kinked", joints[~smooth & (share_of_largest > LARGE)], 1.0 - NEAR),
    ):
        if len(ratio):  # none of a kind where all are of others
            rows.append(at_least(kind, "smallest estimate over solid", asked, float(ratio.min()), {"of": len(ratio)}))
    return rows


def _cost() -> Row:
    """Microseconds of processor an arm with all derivatives."""
    case = next(c for c in validation_strain.strain_cases() if c.name == "box")
    model = ArmModel.from_assembly(assembly_from_design(case.design), case.material)
    changes = model.changes(model.start(target_pose(case.mesh, case.design.flat.corners)))
    count = 2 * len(model.pairs)
    strains, every = Strains.from_changes(model.assembly, changes, case.material), np.tile(np.arange(count), 10)
    whole = fewest_seconds(lambda: strains.slopes(every), 10) / 10.0
    return at_most("cost", "with all derivatives, us an arm", 35.0, 1e6 * whole / count)


def sum_up(rows: list[Row], options: Options) -> Rows:
    solved = [at_least("designs", "solved", SOLVED, len(rows))] if options.only == "*" else []
    return [*(of_all(found) if found else ()), *solved, _cost()]


main = Bench("strain", cases, summary=sum_up, solve=(False, "solve the solids that are missing"))
