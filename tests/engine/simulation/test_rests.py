"""Other shapes in which a piece may rest, and pieces that are about to snap."""

import dataclasses

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.mechanics.equilibrium import Equilibrium
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.params import Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.simulation import rests
from flexmaps.engine.simulation.other_rests import find_other_rests
from flexmaps.engine.simulation.simulate import Simulation, simulate
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def saddle() -> Simulation:
    found = job.run(PolygonMesh.from_quads(shapes.make("saddle", 0.05)), Settings(), edge=0.02, stop_after="spirals")
    assert found.design is not None
    held = np.flatnonzero(found.mesh.centroids[:, 2] < found.mesh.centroids[:, 2].min() + 0.005)
    return simulate(
        found.design, found.mesh, MATERIALS["vero"], SimulateParams(restarts=2, clamped=False), supports=held
    )


def test_a_piece_that_rests_higher_than_it_must_has_another_rest(saddle: Simulation) -> None:
    assert saddle.others  # sought from bent starts
    other = saddle.others[0]
    assert other.energy > saddle.equilibrium.energy and rests.lower_rest(saddle.equilibrium, saddle.others) is None
    higher = dataclasses.replace(saddle, equilibrium=other, others=[])
    found = find_other_rests(higher, SimulateParams(clamped=False))
    assert found.others[0].energy == pytest.approx(saddle.equilibrium.energy, rel=1e-4)
    told = [one for one in found.findings if one.code in rests.OTHER_REST_CODES]
    assert len(told) == 1 and told[0].faces and "less energy" in told[0].message


def test_a_knot_is_named_where_neighbours_are_twisted_further_than_in_the_target(saddle: Simulation) -> None:
    assert not saddle.is_locked
    one, two = saddle.model.pairs[len(saddle.model.pairs) // 2]
    centres, turns = saddle.equilibrium.pose.centres, saddle.equilibrium.pose.rotations.copy()
    across = (centres[two] - centres[one]) / np.linalg.norm(centres[two] - centres[one])
    turns[two] = Rotation.from_rotvec(np.radians(75.0) * across).as_matrix() @ turns[two]
    turned = dataclasses.replace(saddle.equilibrium, pose=Pose(centres, turns))
    knotted = dataclasses.replace(saddle, equilibrium=turned)
    told = [finding for finding in knotted.findings if finding.code == "knotted"]
    assert knotted.is_locked and len(told) == 1 and two in told[0].faces
    assert "degrees from that in the target" in told[0].message
    lost = dataclasses.replace(saddle, equilibrium=dataclasses.replace(turned, converged=False))
    assert not any(finding.code == "knotted" for finding in lost.findings)


def test_a_higher_rest_is_named_where_the_target_leads_to_it(saddle: Simulation) -> None:
    again = find_other_rests(saddle, SimulateParams(clamped=False))
    assert again.rest_from_target is None  # the target's pose leads to the simulated rest
    assert all(one.code not in rests.OTHER_REST_CODES for one in again.findings)
    higher = dataclasses.replace(saddle, rest_from_target=saddle.others[0])
    told = [one for one in higher.findings if one.code in rests.OTHER_REST_CODES]
    assert len(told) == 1 and "more energy" in told[0].message and told[0].faces
    far = np.linalg.norm(saddle.others[0].pose.centres - saddle.target.centroids, axis=1)
    share = float(told[0].message.split(" % of its size")[0].rsplit(" ", 1)[1])
    assert share == pytest.approx(100.0 * np.sqrt((far**2).mean()) / saddle.diagonal, rel=0.05)
    other = higher.report()["other_rest"]
    assert other["rms_percent"] == pytest.approx(share, rel=0.05) and "other_rest" not in again.report()
    assert other["strain_share_max"] == dataclasses.replace(saddle, equilibrium=saddle.others[0]).strain.max()
    rests_of = {"others": [saddle.equilibrium], "rest_from_target": saddle.equilibrium}
    lower = dataclasses.replace(saddle, equilibrium=saddle.others[0], **rests_of)
    assert ["less energy" in one.message for one in lower.findings if one.code in rests.OTHER_REST_CODES] == [True]


def test_another_rest_is_a_fault_only_where_it_lies_farther_from_the_target(saddle: Simulation) -> None:
    here, there = saddle.equilibrium, saddle.others[0]
    apart = [_away(saddle, one) for one in (here, there)]
    assert max(apart) > 1.3 * min(apart)
    codes = []
    for shown, other in ((here, there), (there, here)):
        found = dataclasses.replace(saddle, equilibrium=shown, others=[other], rest_from_target=other)
        codes += [one.code for one in found.findings if one.code in rests.OTHER_REST_CODES]
    assert codes == (["other-rest", "rest-as-near"] if apart[1] > apart[0] else ["rest-as-near", "other-rest"])


@pytest.mark.parametrize(
    "here, there, code", [(0.5, 0.9, "rest-as-near"), (0.5, 1.3, "other-rest"), (1.4, 1.3, "rest-as-near")]
)
def test_another_rest_as_near_is_a_fault_where_arms_would_break_there_only(
    saddle: Simulation, here: float, there: float, code: str
) -> None:
    near, far = sorted((saddle.equilibrium, saddle.others[0]), key=lambda one: _away(saddle, one))
    told = rests._other_rest(far, near, here, there, lower=True, target=saddle.target, size=saddle.diagonal)
    assert told.code == code
    assert ("strained to 130 %" in told.message) == (code == "other-rest")


def test_strains_of_another_rest_are_those_in_its_shape(saddle: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []
    monkeypatch.setattr(rests, "_other_rest", lambda _, __, *strains, **___: seen.extend(strains))
    other = saddle.others[0]
    assert dataclasses.replace(saddle, others=[other], rest_from_target=other).findings
    worst = [dataclasses.replace(saddle, equilibrium=one).strain for one in (saddle.equilibrium, other)]
    assert seen == [one.max() for one in worst if one is not None] and seen[0] != seen[1]


def _away(piece: Simulation, one: Equilibrium) -> float:
    """Root of the mean square distance from the target, metres."""
    return float(np.sqrt(((one.pose.centres - piece.target.centroids) ** 2).sum(axis=1).mean()))


def test_a_piece_is_about_to_snap_when_its_softest_eigenvalue_is_small(
    saddle: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs, pose = saddle.model.pairs, saddle.equilibrium.pose
    system, here = (
        NewtonSystem(pairs, saddle.loads.held_increments(pairs, pose.centres)),
        saddle.model.expand(saddle.model.start(pose)),
    )
    both = [system.pattern.matrix(system.values(of)).toarray() for of in (here.hessian, here.convex)]
    softest = float(eigh(*both, eigvals_only=True, subset_by_index=(0, 0))[0])
    assert not [one for one in saddle.findings if one.code == "about-to-snap"]
    monkeypatch.setattr(rests, "SNAP_STIFFNESS", 0.95 * softest)
    assert not len(rests.snapping_spirals(saddle.equilibrium, saddle.softest)[0])
    monkeypatch.setattr(rests, "SNAP_STIFFNESS", 1.05 * softest)
    moving, share = rests.snapping_spirals(saddle.equilibrium, saddle.softest)
    assert len(moving) and share == pytest.approx(softest, rel=1e-4)
    assert (
        "about-to-snap"
        in [
            one.code
            for one in rests.rest_findings(
                saddle.equilibrium, [], None, saddle.softest, lambda _: None, saddle.target, saddle.diagonal
            )
        ]
        and not saddle.loads.fixed[moving].any()
    )
