"""What a piece bears under its load cases, from a surface to the report."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.structure.analysis import YEAR, StructuralAnalysis, analyse
from flexmaps.engine.extras.structure.cases import parse_plan
from flexmaps.engine.extras.structure.structure_params import StructureParams
from flexmaps.engine.fabrication import joints
from flexmaps.engine.fabrication.connectors.connect import connect
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.params import (
    ConnectorParams,
    LayoutParams,
    MaterialParams,
    ObjectSettings,
    SimulateParams,
    SpiralParams,
    with_values,
)
from flexmaps.engine.patches.flattening.flatten import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.runs import job, report, report_page
from flexmaps.engine.simulation.simulate import Simulation, simulate
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

HOW, WANTED, SIDE = SimulateParams(tolerance=1e-10), StructureParams(), 0.02
FEET = np.array([0, 8, 9, 17])


def arch(material: str = "pom", supports: np.ndarray | None = FEET, clamped: bool = True) -> Simulation:
    """Two rows of nine spirals bent to an arc; a seam across its middle column's left side."""
    x, y = np.meshgrid(np.arange(10.0), np.arange(3.0))
    corner = np.arange(x.size).reshape(x.shape)
    quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 4)
    angle, radius = (x.ravel() / 9.0 - 0.5) * 1.86, 9.0 / 1.86
    mesh = QuadMesh(SIDE * np.stack([radius * np.sin(angle), y.ravel(), radius * np.cos(angle)], axis=1), quads)
    across = (x.ravel() == 4.0)[mesh.edges].all(axis=1)
    design = uniform_design(flatten(PatchLayout(mesh, across), LayoutParams()), SpiralParams(), twist=2.6)
    return simulate(design, mesh, MATERIALS[material], replace(HOW, clamped=clamped), supports=supports)


@pytest.fixture(scope="module")
def standing() -> Simulation:
    return arch()


def examined(simulation: Simulation, cases: str, combinations: str = "", **options: object) -> StructuralAnalysis:
    return analyse(simulation, parse_plan(cases, combinations), WANTED, HOW, **options)  # type: ignore[arg-type]


def test_a_case_moves_the_piece_to_where_a_simulation_with_its_forces_finds_it(standing: Simulation) -> None:
    """Loads that go up step by step end where the one search with all forces at once ends."""
    (one, _) = examined(standing, "a: point 1 -z on 4,13; a: weight").outcomes
    force = np.zeros((18, 3))
    force[[4, 13], 2] = -0.5
    pom = MATERIALS["pom"]
    again = simulate(standing.design, standing.target, pom, replace(HOW, gravity=True), supports=FEET, force=force)
    assert one.pose is not None
    assert np.abs(one.pose.centres - again.equilibrium.pose.centres).max() < 1e-7
    strain = again.strain
    assert strain is not None and one.borne.arms == pytest.approx(strain, rel=1e-5)
    moved = np.linalg.norm(again.equilibrium.pose.centres - standing.equilibrium.pose.centres, axis=1)
    # the two loaded quads are images of each other, so that either may be named
    assert moved[one.report(np.zeros(26, bool))["deflection_quad"]] == pytest.approx(moved.max(), rel=1e-6)


def test_deflections_are_told_from_the_shape_without_loads(standing: Simulation) -> None:
    """A piece that was simulated under its weight has its weight as any other case."""
    heavy = simulate(standing.design, standing.target, MATERIALS["pom"], replace(HOW, gravity=True), supports=FEET)
    first, second = (examined(one, "w: weight").outcomes[0] for one in (standing, heavy))
    assert first.deflection.max() > 1e-5
    assert second.deflection == pytest.approx(first.deflection, abs=1e-8)


def test_twice_a_load_in_a_combination_halves_how_far_it_may_rise(standing: Simulation) -> None:
    found = examined(standing, "a: point 1 -z on 4,13", "double = 2 a; none = a - a").outcomes
    one, double, nothing = found
    assert one.critical is not None and double.critical == pytest.approx(0.5 * one.critical, rel=1e-3)
    assert one.linear is not None and double.linear == pytest.approx(0.5 * one.linear, rel=1e-4)
    assert nothing.critical is None and nothing.linear is None and nothing.deflection.max() < 1e-9


def test_after_a_year_it_is_as_if_made_of_a_softer_material(standing: Simulation) -> None:
    """With the modulus that is left, and the same loads that stay."""
    known = MATERIALS["pom"].lasting
    assert known is not None
    year = examined(standing, "a: point .8 -z on 4,13 lasting; b: point 9 z on 4").outcomes[-1]
    assert year.name == year.kind == YEAR
    softer = replace(MATERIALS["pom"], youngs=known.share * MATERIALS["pom"].youngs)
    force = np.zeros((18, 3))
    force[[4, 13], 2] = -0.4
    again = simulate(standing.design, standing.target, softer, HOW, supports=FEET, force=force)
    assert year.pose is not None
    assert np.abs(year.pose.centres - again.equilibrium.pose.centres).max() < 1e-7
    assert again.strain is not None and year.borne.arms is not None
    assert year.borne.arms * known.strain == pytest.approx(again.strain * softer.strain_limit, rel=1e-5)
    # the joints carry what the loads ask for, not what they did on the first day
    wrench = again.model.wrenches(again.model.start(again.equilibrium.pose))  # type: ignore[attr-defined]
    assert year.borne.forces == pytest.approx(np.linalg.norm(wrench[:, :3], axis=1), rel=1e-4, abs=1e-6)


def test_a_support_that_moves_is_there_after_a_year_too(standing: Simulation) -> None:
    case, year = examined(standing, "settle: move 2 -z on 8,17 lasting").outcomes
    for one in (case, year):
        assert one.shift[[8, 17]] == pytest.approx(np.tile([0.0, 0.0, -0.002], (2, 1)), abs=1e-9)
        assert one.shift[[0, 9]] == pytest.approx(0.0, abs=1e-12)
    # without forces all stiffnesses go down alike, and the shape stays
    assert year.shift == pytest.approx(case.shift, abs=1e-7)


def test_joints_bear_what_beam_theory_says() -> None:
    """A bar of 2 x 3 mm under a pull of 6 N, and under moments in and out of the sheet of 6 N mm."""
    wrench = np.zeros((4, 6))
    wrench[0, 0], wrench[1, 5], wrench[2, 4], wrench[3, 3] = 6.0, 6e-3, 6e-3, -6e-3
    found = joints.Necks(np.full(4, 2e-3), np.zeros(4), np.zeros(4)).stresses(wrench, 3e-3)
    # F / A; M / (t n^2 / 6); M / (n t^2 / 6)
    assert found == pytest.approx([1e6, 3e6, 2e6, 2e6])


def test_connectors_are_checked_where_panels_meet(standing: Simulation) -> None:
    made = connect(standing.design, ConnectorParams())
    found = examined(standing, "a: point 1 -z on 4,13", connections=made)
    mesh = standing.design.flat.layout.mesh
    assert found.seams.sum() == 2 and mesh.edge_quads[~mesh.border][found.seams].tolist() == [[3, 4], [12, 13]]
    row = found.report()["outcomes"][0]
    borne = found.outcomes[0].borne
    assert borne.joints is not None and row["joints"] == pytest.approx(borne.joints[found.seams].max(), rel=1e-5)
    weak = replace(standing, material=replace(MATERIALS["pom"], strain_limit=1e-3))
    told = examined(weak, "a: point 1 -z on 4,13", connections=made).findings
    assert {one.code for one in told} >= {"overstrained", "joints-overloaded"}
    assert set(next(one for one in told if one.code == "joints-overloaded").faces) <= {3, 4, 12, 13}


# -- what is wrong -------------------------------------------------------------------------------------------------------


def test_a_load_that_snaps_the_piece_is_told_with_how_much_it_bears(standing: Simulation) -> None:
    found = examined(standing, "a: point 90 -z on 4,13")
    one, told = found.outcomes[0], found.findings[0]
    assert one.pose is None and one.critical is not None and one.critical < 1.0
    assert told.code == "snaps" and f"'a' the piece snaps at {one.critical:.2f} of the load" in told.message
    assert "deflection_max_mm" not in one.report(found.seams)


@pytest.mark.parametrize(
    ("cases", "says"),
    [
        ("a: point 1 z on 18", "Load case 'a': '18' names no quad; give numbers from 0 to 17"),
        ("a: point 1 z on the roof", "Load case 'a': 'the roof' names no quad"),
        ("a: move 1 z on 4", "Load case 'a': only supports can be moved"),
    ],
)
def test_loads_that_cannot_act_are_named(standing: Simulation, cases: str, says: str) -> None:
    with pytest.raises(FlexMapsError, match=says):
        examined(standing, cases)


def test_a_load_on_a_piece_that_nothing_holds_is_refused_unless_it_balances() -> None:
    loose = arch(supports=None)
    with pytest.raises(
        FlexMapsError, match="Load case 'w': Weight or forces carry away a piece of 18 spirals that nothing holds"
    ):
        examined(loose, "w: weight")
    found = examined(loose, "pull: point 1 y on 9,17; pull: point -1 y on 0,8").outcomes[0]
    assert found.pose is not None and found.deflection.max() > 1e-5


def test_groups_stand_for_quads(standing: Simulation) -> None:
    named = examined(standing, "a: point 1 -z on the top", groups={"the top": np.array([4, 13])})
    assert named.outcomes[0].deflection == pytest.approx(
        examined(standing, "a: point 1 -z on 4,13").outcomes[0].deflection
    )


# -- time ----------------------------------------------------------------------------------------------------------------


def test_what_a_year_leaves_is_within_what_a_day_does() -> None:
    for one in MATERIALS.values():
        if one.lasting is not None:
            assert 0.2 < one.lasting.share < 1.0 and 0.0 < one.lasting.strain <= one.strain_limit, one.name
            assert len(one.lasting.source) > 40
    custom = MaterialParams(material="custom", lasting_share=0.5, lasting_strain=0.004).sheet
    assert custom.lasting is not None and (custom.lasting.share, custom.lasting.strain) == (0.5, 0.004)
    assert MaterialParams(material="custom").chosen.lasting is None


def test_one_limit_is_used_the_one_that_was_asked_for(standing: Simulation) -> None:
    pom, lasting = MATERIALS["pom"], MATERIALS["pom"].lasting
    days, years = (MaterialParams(lasts=lasts).chosen for lasts in ("days", "years"))
    assert days.strain_limit == pom.strain_limit and days.lasting is None
    assert lasting is not None and years.strain_limit == lasting.strain and years.lasting == lasting
    assert MaterialParams(material="vero", lasts="years").chosen == MATERIALS["vero"], (
        "what is not known is not made up"
    )
    grain = MaterialParams(material="mdf", lasts="years").chosen
    assert grain.strength == pytest.approx(0.65 * MATERIALS["mdf"].strength)
    assert standing.strain is not None
    most = float(standing.strain.max()) * pom.strain_limit
    between = replace(pom, strain_limit=1.5 * most, lasting=replace(lasting, strain=0.8 * most))
    said = {years: replace(standing, material=between.lasts(years)).findings for years in (False, True)}
    assert "strained" not in [one.code for one in said[False]], "nothing warns of the other limit"
    (found,) = [one for one in said[True] if one.code == "strained"]
    assert "for years" in found.message
    assert set(found.faces) == set(np.flatnonzero(standing.strain > 0.8 * standing.strain.max() * 1.0005).tolist())


# -- from a surface to the report ----------------------------------------------------------------------------------------


def test_the_stage_runs_when_asked_for_and_the_report_tells() -> None:
    mesh = PolygonMesh.from_quads(shapes.make("dome"))
    given = {"structure.cases": "snow: snow 200; w: weight", "structure.combinations": "both = 1.5 snow + 1.35 w"}
    given["material.lasts"] = "years"
    settings = with_values(ObjectSettings(), given)
    result = job.run(mesh, settings, edge=SIDE, stop_after="structure", supports="lowest")
    assert result.structure is not None and "structure" not in job.stages("sheets")
    described = report.build_report(result, source="dome", settings=settings)
    block = described["structure"]
    assert [one["name"] for one in block["outcomes"]] == ["snow", "w", "both", YEAR]
    snow, both = block["outcomes"][0], block["outcomes"][2]
    assert snow["curve"][0] == [0.0, 0.0] and snow["deflection_max_mm"] > 0.1
    assert both["critical"] < snow["critical"] / 1.5
    drawn = report_page.draw_plots(result, described, 0.035)
    assert {"loads", "utilisation"} <= drawn.keys()
    page = report_page.render_page(described, {"loads": "<svg></svg>"})
    assert "What it bears" in page and "Linear buckling at" in page


def test_loads_are_read_before_the_work() -> None:
    mesh = PolygonMesh.from_quads(shapes.make("strip"))
    settings = with_values(ObjectSettings(), {"structure.cases": "w: weight", "structure.combinations": "a = 2 snow"})
    with pytest.raises(FlexMapsError, match="adds 'snow', which is not a load case"):
        job.run(mesh, settings, stop_after="structure")


def test_the_curve_follows_the_hub_that_moves_most_through_its_deflection(standing: Simulation) -> None:
    one = examined(standing, "a: point 1 -z on 4,13").outcomes[0]
    factors, along = one.curve.T
    assert factors[0] == 0.0 == pytest.approx(along[0], abs=1e-12) and (np.diff(factors[:3]) > 0.0).all()
    # the path goes on beyond the loads of the case, where the deflection is measured
    (at,) = np.flatnonzero(np.isclose(factors, one.share))
    assert along[at] == pytest.approx(float(one.deflection.max()), rel=1e-6)
