"""Eyelets: as wide as asked, with as much material round them, and as strong as a pin in a sheet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.panels.labels import free_hub_radii
from flexmaps.engine.fabrication.standing.eyelets import Eyelet, eyelets_report, make_eyelets, warn_of_overload
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.params import CutParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals.design import SpiralDesign

ONE = Eyelet(1, 4, 0, np.array([0.03, 0.01]), 0.002, 0.003, np.array([0.1, 0.2, 0.3]), np.array([3.0, 0.0, 4.0]))


@pytest.fixture
def design(flat_grid: Callable[..., FlatPatches]) -> SpiralDesign:
    flat = flat_grid(4, 1, 0.03, cut=lambda x, _: x == 2)
    width = np.repeat([[0.002], [0.004], [0.004], [0.003]], 4, axis=1)
    return SpiralDesign(flat, SpiralParams(), width, np.full(4, 0.5))


@pytest.fixture
def pose() -> Pose:
    places = np.arange(12.0).reshape(4, 3)
    return Pose(places, np.tile(np.eye(3), (4, 1, 1)))


def test_a_hole_is_a_clockwise_circle() -> None:
    hole = shapely.Polygon(ONE.hole.sample(1e-8))
    assert ONE.hole.area == pytest.approx(-np.pi * 0.001**2)
    assert hole.symmetric_difference(shapely.Point(0.03, 0.01).buffer(0.001, quad_segs=200)).area < 1e-10
    assert ONE.name == "o1" and ONE.force_magnitude == pytest.approx(5.0)


def test_the_larger_of_bearing_and_tearing_out_counts() -> None:
    """A pull of 5 N on a sheet of 4 mm: on a pin of 2 mm, or along two planes of the edge's width each."""
    assert ONE.stress(0.004) == pytest.approx(5.0 / (0.004 * 0.002))
    thin = replace(ONE, edge_width=0.0008)
    assert thin.stress(0.004) == pytest.approx(5.0 / (2.0 * 0.004 * 0.0008))
    unknown = replace(ONE, support_force=None)
    assert unknown.stress(0.004) is None and unknown.force_magnitude is None


def test_eyelets_lie_in_the_hubs_with_their_diameter_of_material_around(design: SpiralDesign, pose: Pose) -> None:
    room = free_hub_radii(design.arms, design.roots)
    supports, diameter = np.array([1, 2]), float(room[1:3].min()) / 1.5
    forces = np.arange(12.0).reshape(4, 3)
    made = make_eyelets(design, pose, supports, diameter, CutParams(), forces)
    bodies = [shapely.Polygon(o.outer.sample(1e-6), [h.sample(1e-6) for h in o.holes]) for o in design.outlines()]
    for n, (one, quad) in enumerate(zip(made, (1, 2), strict=True)):
        assert (one.number, one.quad, one.patch) == (n + 1, quad, design.flat.layout.patch_of[quad])
        np.testing.assert_array_equal(one.centre, design.arms.centre[quad])
        np.testing.assert_array_equal(one.place, pose.centres[quad])
        np.testing.assert_array_equal(one.support_force, forces[quad])
        assert one.edge_width == pytest.approx(room[quad] - 0.5 * diameter) and one.edge_width >= 0.999 * diameter
        around = shapely.Polygon(one.hole.sample(1e-7)).buffer(0.999 * diameter)
        assert bodies[one.patch].buffer(1e-6).contains(around)
    assert make_eyelets(design, pose, supports, diameter, CutParams())[0].support_force is None


def test_hubs_too_small_are_named_with_the_largest_eyelet_that_fits(design: SpiralDesign, pose: Pose) -> None:
    room = free_hub_radii(design.arms, design.roots)
    diameter = 1.01 * float(room[3]) / 1.5
    assert room[0] < room[3] < 0.9 * room[1]
    with pytest.raises(FlexMapsError, match="The hubs of 2 supported spirals are too small") as caught:
        make_eyelets(design, pose, np.array([0, 1, 3]), diameter, CutParams())
    assert caught.value.faces == [0, 3]
    assert f"have room for {1e3 * room[0] / 1.5:.2g} mm" in str(caught.value)


@pytest.mark.parametrize("cut", [CutParams(kerf_holes=0.001), CutParams(mill=0.001)])
def test_a_hole_is_wider_than_the_cutter(design: SpiralDesign, pose: Pose, cut: CutParams) -> None:
    with pytest.raises(FlexMapsError, match="Eyelets of 1 mm are no larger than the cutter's width of 1 mm"):
        make_eyelets(design, pose, np.array([1]), 0.001, cut)
    assert len(make_eyelets(design, pose, np.array([1]), 0.0011, cut)) == 1
    for none in (None, np.empty(0, dtype=int)):
        with pytest.raises(FlexMapsError, match="no supports to hang the piece by"):
            make_eyelets(design, pose, none, 0.0011, cut)


def test_the_report_is_in_millimetres_and_newtons() -> None:
    two = replace(ONE, number=2, quad=7, edge_width=0.0025, place=np.array([0.0123456, -0.2, 0.0]))
    report = eyelets_report((ONE, two))
    assert (report["eyelets"], report["eyelet_mm"], report["edge_mm"], report["faces"]) == (2, 2.0, 2.5, [4, 7])
    assert report["places_mm"] == [[100.0, 200.0, 300.0], [12.35, -200.0, 0.0]]
    assert report["forces_N"] == [[3.0, 0.0, 4.0]] * 2
    assert "forces_N" not in eyelets_report((replace(ONE, support_force=None),))


def test_overload_is_told_of_the_worst_eyelet() -> None:
    material = MATERIALS["pom"]
    share = 5.0 / (0.004 * 0.002) / material.strength
    strong = ONE.support_force
    assert strong is not None
    fine, heavy, worst = (
        replace(ONE, number=n, support_force=f / share * strong) for n, f in ((1, 0.99), (2, 1.01), (3, 2.5))
    )
    assert warn_of_overload((fine, replace(ONE, support_force=None)), 0.004, material) == []
    assert warn_of_overload((), 0.004, material) == []
    (text,) = warn_of_overload((fine, worst, heavy), 0.004, material)
    assert text.startswith(f"2 eyelets bear more than Delrin (POM): o3 {12.5 / share:.3g} N, 250 % of what it can")
    (text,) = warn_of_overload((heavy,), 0.004, material)
    assert text.startswith("1 eyelet bears more than Delrin (POM): o2 ") and "101 %" in text
