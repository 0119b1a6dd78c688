"""Feet and the plates and frames that they stand in, and eyelets to hang by: read back from files, and against the simulated pose, by ezdxf, trimesh and shapely."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.standing import corners
from flexmaps.engine.fabrication.standing.frame import CORNER_RADIUS, _corner_radii, shortest_closed_path
from flexmaps.engine.fabrication.writers import parts
from flexmaps.engine.params import Settings, with_values
from flexmaps.engine.runs import job, report
from flexmaps.engine.runs.outputs import SimulatedShape
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

QUICK = {"sheet.nesting": "FAST", "base.base": "feet"}
HANGING = {"base.base": "eyelets", "sheet.nesting": "FAST", "simulate.clamped": False, "simulate.gravity": True}


def _arch(columns=5, rows=8, sweep=np.pi, lean=0.0, edge=0.02):
    """Half a tube that stands on both of its long borders; ``lean`` radians tip it over."""
    radius = rows * edge / sweep
    a = np.linspace(-0.5 * sweep, 0.5 * sweep, rows + 1)
    x, a = np.meshgrid(edge * np.arange(columns + 1.0), a, indexing="ij")
    points = np.stack([x, radius * np.sin(a), radius * np.cos(a)], axis=-1).reshape(-1, 3)
    turn = np.array([[np.cos(lean), 0.0, np.sin(lean)], [0.0, 1.0, 0.0], [-np.sin(lean), 0.0, np.cos(lean)]])
    corner = np.arange(len(points)).reshape(columns + 1, rows + 1)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    return PolygonMesh.from_quads(QuadMesh(points @ turn.T, quads))


def _made(polygons, more=(), **options):
    settings = with_values(Settings(), QUICK | dict(more))
    return job.run(polygons, settings, **({"supports": "lowest"} | options))


@pytest.fixture(scope="module")
def bench():
    import sys
    from pathlib import Path

    sys.path.append(str(Path(__file__).resolve().parents[4] / "tools"))
    return __import__("bench_standing")


@pytest.mark.parametrize(
    ("sweep", "border"),
    [
        (4.0, "left_out"),
        *(pytest.param(sweep, "stubs", marks=pytest.mark.thorough) for sweep in (2.0, 3.1, 4.0)),
        *(pytest.param(sweep, "left_out", marks=pytest.mark.thorough) for sweep in (2.0, 3.1)),
    ],
)
def test_feet_as_they_are_cut_stand_in_their_slots_as_simulated(bench, sweep, border):
    made = _made(_arch(sweep=sweep), {"spiral.border": border})
    assert made.sheets.base.report["feet"] == 10
    assert len(made.sheets.base.plates) == 2  # one under each foot of the arch
    fit = bench.read_back(made)
    assert len(fit) == 3
    assert max(fit.values()) < 0.01  # mm
    clearance = 1e3 * made.sheets.connections.clearance
    assert clearance > 0.0
    # and the judge sees a foot that stands elsewhere
    base = made.sheets.base
    pose = made.simulation.equilibrium.pose.moved(np.tile([3e-4, 0.0, 0.0, 0.0, 0.0, 0.0], (len(made.mesh.quads), 1)))
    moved = replace(made.simulation, equilibrium=replace(made.simulation.equilibrium, pose=pose))
    astray = bench.read_back(replace(made, outputs=made.outputs | {"simulation": SimulatedShape(moved)}))
    assert max(astray["tongue outside of slot (mm)"], astray["slot too wide (mm)"]) > 0.15
    assert base.report["lean_deg"][0] <= base.report["lean_deg"][1]


def test_supported_spirals_are_straight_and_stay_so_when_the_rest_is_improved():
    settings = with_values(
        Settings(), QUICK | {"optimise.iterations": 3, "optimise.codesign": False, "optimise.restart": False}
    )
    polygons = _arch(rows=6)
    made = job.run(polygons, settings, supports="lowest", optimised=True)
    held = made.supports
    assert (made.design.twist[held] < 0.002).all()
    assert (made.design.twist > 0.1).any()
    assert made.sheets.base.report["feet"] == len(held)
    before = job.run(polygons, with_values(settings, {"base.base": "none"}), supports="lowest", stop_after="spirals")
    assert (before.design.twist[held] > 0.002).any()


def test_panels_with_feet_are_whole_and_so_are_parts_and_plates(tmp_path):
    made = _made(_arch(), {"base.base": "plate"})
    sheets = made.sheets
    plates = [p for p in sheets.panels if p.kind == "base"]
    assert len(plates) == 1
    (plate,) = plates
    whole = shapely.Polygon(plate.outline.sample(1e-6), [h.sample(1e-6) for h in plate.holes])
    assert whole.is_valid
    assert plate.area == pytest.approx(whole.area, rel=1e-4)
    slots = shapely.union_all([shapely.Polygon(h.points) for h in plate.holes])
    assert slots.hausdorff_distance(whole.exterior) > 0
    assert slots.distance(whole.exterior) == pytest.approx(0.012, abs=1e-6)  # the edge that was asked for
    assert (
        shapely.Polygon(whole.exterior).symmetric_difference(slots.convex_hull.buffer(0.012, quad_segs=200)).area < 1e-7
    )
    for panel in sheets.panels:
        shape = shapely.Polygon(panel.outline.sample(1e-6), [h.sample(1e-6) for h in panel.holes])
        assert shape.is_valid
        assert all(shape.contains(shapely.LineString(stroke.points)) for stroke in panel.labels)
    written = parts.write_parts_list(
        sheets, [made.design], Settings().material.chosen, tmp_path / "parts.csv"
    ).read_text()
    assert "base 1,base,1,0,0" in written
    assert report.report_blocks(made, ("sheets",))["sheets"]["base"]["plates"] == 1
    # what is simulated anew stands elsewhere: sheets with a base are made anew, others are not
    assert made.without("simulation").sheets is None
    assert _made(_arch(), {"base.base": "none"}).without("simulation").sheets is not None


def test_a_base_larger_than_the_sheet_is_several():
    made = _made(_arch(columns=12), {"base.base": "plate", "sheet.sheet_width": 200.0, "sheet.sheet_height": 200.0})
    plates = [p for p in made.sheets.panels if p.kind == "base"]
    assert len(plates) > 1
    assert sum(len(p.holes) for p in plates) == made.sheets.base.report["feet"]
    shapes_ = [shapely.Polygon(p.outline.sample(1e-5)) for p in plates]
    assert all(not a.intersects(b) for k, a in enumerate(shapes_) for b in shapes_[:k])


@pytest.mark.parametrize(
    ("polygons", "more", "options", "words"),
    [
        (_arch(), {}, {"supports": None}, "no supports to hold; choose supports"),
        (_arch(), {"base.foot_width": 60.0}, {}, "no room for a foot|too near"),
        (_arch(), {"base.foot_width": 17.5, "base.base_height": 20.0, "spiral.thickness": 10.0}, {}, "slots of the base are less than|too near"),
        (_arch(), {"simulate.clamped": False}, {}, "clamps the feet"),
        (_arch(sweep=0.9), {}, {}, "too flat"),
        (_arch(), {}, {"supports": [11]}, "away from the open border"),
        (_arch(), {}, {"supports": [0, 1]}, "does not lie below"),
    ],
)  # fmt: skip
def test_what_cannot_stand_gets_one_clear_error(polygons, more, options, words):
    with pytest.raises(FlexMapsError, match=words):
        _made(polygons, more, **options)


def test_a_wound_support_asks_for_spirals_anew():
    settings = with_values(Settings(), QUICK | {"base.base": "none"})
    made = job.run(_arch(rows=6), settings, supports="lowest")
    with pytest.raises(FlexMapsError, match="press Spirals again"):
        job.run_stages(made, with_values(settings, {"base.base": "feet"}), ("sheets",))


def test_rounded_corners_touch_their_sides():
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
    curve = corners.round_corners(square, 0.5)
    shape = shapely.Polygon(curve.sample(1e-6))
    assert shape.symmetric_difference(shapely.Polygon(square).buffer(-0.5).buffer(0.5, quad_segs=400)).area < 1e-4
    notch = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 4.0], [2.0, 2.0], [0.0, 2.0]])
    inner = shapely.Polygon(corners.round_corners(notch, np.array([0, 0, 0, 0, 0.5, 0])).sample(1e-6))
    assert inner.area == pytest.approx(12.0 + (1 - np.pi / 4) * 0.25, abs=1e-5)


def test_the_planks_of_a_frame_lock_into_a_ring_under_the_feet(bench):
    settings = with_values(Settings(), {"base.base": "frame", "sheet.nesting": "FAST"})
    made = job.run(_arch(), settings, supports="lowest")
    fit, ring = bench.read_back(made), bench.read_frame(made)
    assert made.sheets.base.report["feet"] == 10
    assert max(fit.values()) < 0.01  # mm
    assert made.sheets.base.report["planks"] >= 2
    assert ring["rings that the planks close"] == 1
    assert ring["planks overlap (mm2)"] == ring["planks that a pull takes out"] == 0
    assert ring["joint off its clearance (mm)"] < 0.001
    # there is the edge that was asked for round every slot, but where rounded corners cut it
    for plate in made.sheets.base.plates:
        slots = shapely.MultiPolygon([shapely.Polygon(corners) for corners in plate.slots])
        assert shapely.Polygon(plate.outline.sample(1e-6)).covers(slots.buffer(0.002))


def test_an_arch_hangs_by_holes_in_its_hubs_that_bear_its_weight(bench):
    made = job.run(_arch(rows=6), with_values(Settings(), HANGING), supports=[2, 3, 14, 15, 26, 27])
    fit = bench.read_eyelets(made)
    assert len(made.sheets.base.eyelets) == 6
    assert fit["eyelet off its point (mm)"] < 0.001  # from where the simulation holds the hubs
    assert fit["eyelet's diameter off (mm)"] < 0.001
    assert fit["material round it (diameters)"] > 1.0
    assert fit["forces off the cut panels' weight (share)"] < 0.02
    material, weight = (
        made.simulation.material,
        made.design.area.sum() * 0.002 * 9.81 * made.simulation.material.density,
    )
    told = np.array(made.sheets.base.report["forces_N"])
    assert told.sum(axis=0) == pytest.approx([0.0, 0.0, weight], abs=1e-3 * weight)
    assert not made.sheets.warnings
    one = made.sheets.base.eyelets[0]
    assert one.stress(0.002) == pytest.approx(np.linalg.norm(told[0]) / 0.002 / 0.0008, rel=1e-3)
    assert one.stress(0.002) < material.strength


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"simulate.clamped": True}, "hinge the supports"),
        ({"base.eyelet": 4.0}, "too small for eyelets of 4 mm"),
        (
            {"cut.kerf_holes": 0.9, "spiral.fillet": 0.5, "spiral.slot_min": 1.0},
            "no larger than the cutter",
        ),
    ],
)
def test_what_cannot_hang_gets_one_clear_error(more, words):
    with pytest.raises(FlexMapsError, match=words):
        job.run(_arch(columns=3, rows=4), with_values(Settings(), HANGING | more), supports=[1, 2, 9, 10])


def test_a_piece_that_would_swing_about_its_eyelets_says_so():
    with pytest.raises(FlexMapsError, match=r"no base \(Not simulated: Weight or forces swing .* hinges in a line"):
        job.run(_arch(columns=3, rows=4), with_values(Settings(), HANGING), supports=[1, 5])


@pytest.mark.parametrize(
    ("polygons", "supports", "more", "words"),
    [
        (_arch(), [11], {}, "away from the open border"),
        (_arch(), [0, 1], {}, "does not lie below"),
        (_arch(sweep=0.3), [0, 7, 8, 15], {}, "too flat"),
        (_arch(), None, {}, "no supports to hold; choose supports"),
        (_arch(), None, {"base.base": "eyelets", "simulate.clamped": False}, "such as the highest"),
        (_arch(), "lowest", {"simulate.clamped": False}, "clamps the feet"),
        (_arch(), "lowest", {"spiral.border": "rim"}, "a rim joins these arms"),
    ],
)
def test_what_cannot_stand_is_refused_before_anything_is_made(polygons, supports, more, words, monkeypatch):
    def never(*_):
        raise AssertionError("a stage ran")

    monkeypatch.setattr(job, "function_of", lambda stage: never)
    settings = with_values(Settings(), {"base.base": "feet"} | more)
    with pytest.raises(FlexMapsError, match=words):
        job.run(polygons, settings, supports=supports, optimised=True)


def test_the_way_round_points_is_the_shortest_of_a_circle_and_never_crosses_itself():
    rng = np.random.default_rng(1)
    angle = np.arange(12) * np.pi / 6
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    mixed = rng.permutation(12)
    steps_ = np.diff(mixed[shortest_closed_path(circle[mixed])]) % 12
    assert set(steps_.tolist()) == {1}  # counter-clockwise
    for _ in range(20):
        points = rng.normal(size=(9, 2))
        ring = shapely.LinearRing(points[shortest_closed_path(points)])
        assert ring.is_simple
        assert ring.is_ccw


def test_rounded_corners_fit_their_sides():
    square = np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.3], [0.0, 0.3]])
    radius = _corner_radii(square, np.array([True, False, False, False]), 0.05)
    assert radius[0] <= CORNER_RADIUS and radius[1:] == pytest.approx(0.45 * 0.02)
    # two arcs share a side: together they are no longer than it
    assert (radius + np.roll(radius, -1) <= np.linalg.norm(np.roll(square, -1, axis=0) - square, axis=1)).all()
