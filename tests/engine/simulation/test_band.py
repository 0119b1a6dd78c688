"""What real sheets do to a piece: each end against a simulation of a design that differs so much, and what does not matter."""

import dataclasses

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.params import Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.band import ToleranceBand, ToleranceEffect
from flexmaps.engine.simulation.real_sheets import tolerance_band
from flexmaps.engine.simulation.simulate import Simulation, simulate
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

FINE = SimulateParams(tolerance=1e-9)


@pytest.fixture(scope="module")
def dome() -> Simulation:
    found = job.run(PolygonMesh.from_quads(shapes.make("dome", 0.04)), Settings(), edge=0.02, stop_after="spirals")
    assert found.design is not None
    return simulate(found.design, found.mesh, MATERIALS["vero"], FINE)


def test_each_end_is_what_a_simulation_of_such_a_sheet_finds(dome: Simulation) -> None:
    band = {one.name: one for one in tolerance_band(dome, FINE).tolerances}
    assert set(band) == {"thickness", "width", "stiffness"}
    design = dome.design
    thicker = dataclasses.replace(
        design, params=dataclasses.replace(design.params, thickness=1.05 * design.params.thickness)
    )
    wider = dataclasses.replace(design, width=design.width + 5e-5)
    for name, other in (("thickness", thicker), ("width", wider)):
        rms = 1e-3 * simulate(other, dome.target, dome.material, FINE).target_distances["rms_mm"]
        change = rms - 1e-3 * dome.target_distances["rms_mm"]
        assert band[name].rms_high - 1e-3 * dome.target_distances["rms_mm"] == pytest.approx(change, rel=0.05)


def test_a_sheet_that_is_stiffer_in_every_way_rests_alike(dome: Simulation) -> None:
    """Without loads only the ratio of stiffnesses counts: bending alone moves the piece, and all together do not."""
    assert isinstance(dome.model, ArmModel)
    bending = dome.model.with_bending(1.03)
    strains = dome.model.start(dome.equilibrium.pose).motion.vector
    inside = np.where([True, True, False, False, False, True], strains, 0.0)
    plane, whole = (0.5 * np.einsum("mi,mij,mj->m", e, dome.model.at_joint, e) for e in (inside, strains))
    plane_too, whole_too = (0.5 * np.einsum("mi,mij,mj->m", e, bending.at_joint, e) for e in (inside, strains))
    np.testing.assert_allclose(plane_too, plane)
    assert (whole_too > whole).any()
    alike = simulate(
        dome.design, dome.target, dataclasses.replace(dome.material, youngs=2.0 * dome.material.youngs), FINE
    )
    assert alike.target_distances["rms_mm"] == pytest.approx(dome.target_distances["rms_mm"], rel=1e-5)


def test_the_sentence_goes_from_best_to_worst() -> None:
    band = ToleranceBand((ToleranceEffect("thickness", 1.6e-3, 7e-4, "with a sheet 5 % thicker or thinner"),))
    assert band.text == "RMS with other sheets: 0.7 to 1.6 mm with a sheet 5 % thicker or thinner."
    assert band.report()["thickness"] == pytest.approx([1.6, 0.7])
    assert "no equilibrium" in ToleranceBand((ToleranceEffect("width", None, 1e-3, "with arms"),)).text
