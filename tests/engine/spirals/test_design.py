"""Widths and twists: closed forms of the bounds, distances measured by shapely, the start from curvature."""

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.spirals import design, fabricable
from flexmaps.engine.spirals.clearance import slots
from flexmaps.engine.spirals.curves import spiral
from flexmaps.engine.spirals.design_report import design_report
from shapely import LineString


@pytest.mark.parametrize(("scale", "degrees"), [(0.010, (341, 285, 243, 212, 187)), (0.015, (516, 432, 371, 324, 288))])
def test_twist_limit_in_closed_form(scale, degrees):
    widths = np.array([0.001, 0.00125, 0.0015, 0.00175, 0.002])
    np.testing.assert_allclose(np.degrees(slots.twist_limit(scale, widths, 0.0003)), degrees, atol=0.6)


def test_no_twist_where_arms_fill_the_quad():
    assert slots.twist_limit(0.004, 0.003, 0.0003) == 0.0


@pytest.mark.parametrize("move", [None, lambda p: p @ np.array([[1.0, 0.05], [0.15, 1.1]])], ids=["square", "sheared"])
def test_bound_leaves_exactly_the_smallest_slot(flat_grid, move):
    flat, params = flat_grid(1, 1, 0.01, move=move), SpiralParams()
    width = np.full((1, 4), 0.0015)
    bound = slots.twist_bound(flat, params, width)
    assert 0.0 < bound[0] < 2 * np.pi
    arms = spiral.make_arms(flat, params, width, bound)
    whole = np.broadcast_to(np.linspace(0, 1, 4001), (1, 4, 4001))
    lines = spiral.centre_line(arms.without_blends(bound), whole)[0][0]
    outer = round(4000 * slots.OPEN_SHARE)
    gaps = [LineString(lines[k, : outer + 1]).distance(LineString(lines[k - 1])) - width[0, 0] for k in range(4)]
    assert min(gaps) == pytest.approx(params.slot_min, abs=3e-6)
    # the closed form for regular spirals is a little more generous, for it looks at the tip alone
    if move is None:
        assert bound[0] < slots.twist_limit(0.01, width[0, 0], params.slot_min)
        assert bound[0] > 0.85 * slots.twist_limit(0.01, width[0, 0], params.slot_min)


def test_bound_stops_at_the_largest_twist_asked_for(flat_grid):
    flat = flat_grid(2, 2, 0.03)
    np.testing.assert_array_equal(slots.twist_bound(flat, SpiralParams(twist_max=3.0), np.full((4, 4), 0.001)), 3.0)


def test_what_fits_as_it_is_asked_for_stays(flat_grid):
    flat, params, width = flat_grid(3, 1, 0.01), SpiralParams(), np.full((3, 4), 0.0015)
    bound = slots.twist_bound(flat, params, width)
    asked = bound * [0.3, 0.999, 1.2]
    found = slots.twist_bound(flat, params, width, most=asked)
    np.testing.assert_array_equal(found[:2], asked[:2])
    assert found[2] == pytest.approx(bound[2], abs=2e-3)


def test_curvature_decides_linearly(flat_grid):
    flat, params = flat_grid(4, 3, 0.03), SpiralParams(curvature_top=100.0)
    curvature = np.linspace(0.0, 8.0, 12)
    made = fabricable.design_from_curvature(flat, params, curvature)
    c = curvature / 8.0
    np.testing.assert_allclose(made.width, spiral.same_width(0.002 - c * 0.001))
    np.testing.assert_allclose(made.twist, c * 2 * np.pi)
    np.testing.assert_allclose(made.scale, 0.03)


def test_one_sharp_crease_does_not_stiffen_all_the_rest(flat_grid):
    flat = flat_grid(10, 10, 0.03)
    curvature = np.append(np.full(99, 1.0), 100.0)
    robust = fabricable.design_from_curvature(flat, SpiralParams(), curvature)
    plain = fabricable.design_from_curvature(flat, SpiralParams(curvature_top=100.0), curvature)
    assert robust.width[0, 0] == pytest.approx(0.001)
    assert plain.width[0, 0] == pytest.approx(0.00199)


def test_no_curvature_gives_the_stiffest_spirals(flat_grid):
    made = fabricable.design_from_curvature(flat_grid(2, 2), SpiralParams(), np.zeros(4))
    np.testing.assert_array_equal(made.width, 0.002)
    np.testing.assert_array_equal(made.twist, 0.0)


def test_uniform_design_keeps_what_fits_and_unwinds_what_does_not(flat_grid):
    flat = flat_grid(3, 3, 0.02)
    made = fabricable.uniform_design(flat, SpiralParams(), width=0.0015, twist=5.0)
    np.testing.assert_array_equal(made.width, 0.0015)
    np.testing.assert_array_equal(made.twist, 5.0)
    tight = fabricable.uniform_design(flat_grid(3, 3, 0.01), SpiralParams(), width=0.0015, twist=5.0)
    assert (tight.twist < 4.0).all()
    assert tight.min_slot_and_bridge[0] >= 0.0003 - 1e-9


def test_too_small_quads_are_named(flat_grid):
    def squeezed(p):
        p = p.copy()
        p[p[:, 0] > 0.05, 0] = 0.0408
        return p

    with pytest.raises(FlexMapsError, match="too small or too thin") as caught:
        fabricable.uniform_design(flat_grid(3, 2, move=squeezed), SpiralParams())
    assert caught.value.faces == [4, 5]


def test_report_has_the_spread_of_every_descriptor(flat_grid):
    made = fabricable.design_from_curvature(flat_grid(2, 2), SpiralParams(), np.array([0.0, 1.0, 1.0, 1.0]))
    report = design_report(made)
    assert report["count"] == 4
    assert report["width_mm"] == [1.0, 1.25, 2.0]
    assert report["twist_deg"] == [0.0, 270.0, 360.0]
    assert report["slot_min_mm"] == pytest.approx(0.3)  # at the roots, by the fillets


def test_quads_a_little_too_small_get_thinner_arms_and_a_warning(flat_grid):
    from flexmaps.engine.fabrication.sheets import make_sheets
    from flexmaps.engine.params import SheetParams

    def squeezed(p):
        p = p.copy()
        p[p[:, 0] > 0.05, 0] = 0.0414
        return p

    made = fabricable.uniform_design(flat_grid(3, 2, move=squeezed), SpiralParams())
    assert made.thin_quads.tolist() == [4, 5]
    assert 0.0005 < made.width[4].min() == made.width[4].max() < 0.001
    assert design_report(made)["too_thin"] == 2
    assert any("2 quads have no room for arms 1 mm wide" in w for w in make_sheets(made, SheetParams()).warnings)


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_design_with_a_few_other_spirals_is_drawn_as_one_made_anew(flat_grid, clockwise):
    """Other arms keep their roots and arcs, also where one changed design follows another that was never drawn."""
    flat, params = flat_grid(6, 4, 0.02), SpiralParams(clockwise=clockwise)
    before = fabricable.uniform_design(flat, params, width=0.0012, twist=3.0)
    assert before.outlines()
    twist, width = before.twist.copy(), before.width.copy()
    twist[3], width[20, 1] = 2.0, 0.0014
    once = replace(before, twist=twist).reuse_cache_of(before)
    twice = replace(once, width=width).reuse_cache_of(once)
    pairs = flat.layout.mesh.dual
    assert {*np.flatnonzero(before.changed_arms(once))} == {*pairs[(pairs == 3).any(axis=1)].ravel()}
    for made in (once, twice):
        (found,), (wanted,) = made.outlines(), design.SpiralDesign(flat, params, made.width, made.twist).outlines()
        for one, two in zip((found.outer, *found.holes), (wanted.outer, *wanted.holes), strict=True):
            np.testing.assert_allclose(one.points, two.points, atol=1e-10)
            np.testing.assert_allclose(one.bulge, two.bulge, atol=1e-6)
    assert not np.allclose(twice.roots.left[3], before.roots.left[3])


def test_contacts_are_sought_where_spirals_have_changed(flat_grid):
    flat = flat_grid(4, 1, 0.02)
    before = fabricable.uniform_design(flat, SpiralParams(), width=0.0012, twist=3.0)
    assert before.cache.contact_free == {0}  # proved
    twist = before.twist.copy()
    twist[1] = 14.0  # arms run through each other
    touching = replace(before, twist=twist).reuse_cache_of(before)
    assert not touching.cache.contact_free
    mended = fabricable.resolve_contacts(touching)
    assert mended.twist[1] < 14.0 and mended.cache.contact_free == {0}


def test_the_report_of_spirals_is_in_millimetres_degrees_and_percent(flat_grid):
    """The least, the mean and the largest of every figure; spirals without room are named."""
    params = SpiralParams()
    width = np.array([[0.001, 0.001, 0.001, 0.001], [0.001, 0.001, 0.002, 0.002], [0.002, 0.002, 0.002, 0.002]])
    made = design.SpiralDesign(flat_grid(3, 1), params, width, np.radians([90.0, 180.0, 60.0]), is_painted=True)
    report = design_report(made, with_slot=False)
    assert report["count"] == 3 and report["painted"] is True and "slot_min_mm" not in report
    assert report["width_mm"] == [1.0, 1.5, 2.0] and report["twist_deg"] == [60.0, 110.0, 180.0]
    assert report["unlike_percent"] == [0.0, 22.2222, 66.6667]  # the middle spiral's, of its mean
    assert report["scale_mm"] == [20.0, 20.0, 20.0] and report["too_thin"] == 0 and "no_spiral" not in report
    width = width.copy()
    width[2] = slots.SOLID_WIDTH_SHARE * params.width_min
    solid = design_report(design.SpiralDesign(flat_grid(3, 1), params, width, np.zeros(3)), with_slot=False)
    assert solid["no_spiral"] == [2] and "painted" not in solid
