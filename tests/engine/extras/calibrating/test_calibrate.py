"""The calibration sheet and what its measurements say, against published curves, closed forms and other programs' readers."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.calibrating import bending, calibration_pieces, sheet_files
from flexmaps.engine.extras.calibrating.calibrate import (
    Calibration,
    MeasuredValue,
    Readings,
    _weighted_mean,
    calibrate,
    parse_numbers,
    preset_script,
)
from flexmaps.engine.extras.calibrating.coupons import CALIBRATION_FILE, GRAVITY, Coupons, read_coupons
from flexmaps.engine.extras.calibrating.sizes import choose_coupons
from flexmaps.engine.params import ConnectorParams, Settings, with_values
from flexmaps.engine.spirals.curves.spiral import centre_line

LASER = {"cut.kerf_outline": 0.15, "cut.kerf_holes": 0.15}
MILL = {
    "cut.mill": 2,
    "cut.kerf_outline": 2,
    "cut.kerf_holes": 2,
    "spiral.thickness": 3,
    "sheet.spacing": 5,
    "spiral.slot_min": 2.2,
}
KINDS_OF_SHEETS = {
    "plain": {},
    "laser": LASER,
    "mill": MILL,
    "thin": {**LASER, "spiral.thickness": 1},
    "plywood": {**LASER, "spiral.thickness": 4, "material.material": "birch", "spiral.width_max": 4},
}
TRUE, KERF = 3.4e9, 1.7e-4  # Pa and metres of the machine that is played here


def made(**values: float | str) -> Coupons:
    return choose_coupons(with_values(Settings(), {**LASER, **values}))


@pytest.fixture
def laser() -> Coupons:
    return made()


def perfect(c: Coupons, readings: int = 3, youngs: float = TRUE) -> Readings:
    """What somebody would read off pieces of that modulus and kerf, without any error."""
    wider, arms = c.kerf - KERF, c.kerf_holes - KERF
    stiff = [bending.spiral_stiffness(c, s.scale, s.width + arms, s.twist, youngs) for s in c.spirals]
    a, b = (s.load * GRAVITY / k for s, k in zip(c.spirals, stiff, strict=True))
    sag = bending.strip_sag(c, youngs, c.strip_load, width=c.strip_width + wider)
    return Readings(
        [(c.cells + 1) * KERF] * readings, 5e-5, "dovetail", (), [sag] * readings, None, None, [(a, b)] * readings
    )


# -- formulas ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("pull", "share"), [(1.0, 0.30172), (2.0, 0.49346), (5.0, 0.71379), (10.0, 0.81061)])
def test_a_strip_bends_as_bisshopp_and_drucker_have_it(pull: float, share: float) -> None:
    """Their curve of 1945, in the digits that later tables give (Mattiasson 1981)."""
    assert bending._elastica(pull, 0.0) == pytest.approx(share, abs=1e-4)


def test_its_own_weight_and_small_loads_are_those_of_beams() -> None:
    assert bending._elastica(1e-3, 0.0) == pytest.approx(1e-3 / 3.0, rel=1e-5)
    assert bending._elastica(0.0, 1e-3) == pytest.approx(1e-3 / 8.0, rel=1e-5)
    assert 0.8 < bending._elastica(200.0, 20.0) < 1.0


def test_a_straight_spiral_is_four_beams(laser: Coupons) -> None:
    """Arms without twist, slender ones: clamped beams whose ends do not turn, 12 E I / L^3 each, from the hub on."""
    scale, width = 0.1, 0.002
    found = bending.spiral_stiffness(laser, scale, width, 1e-6, TRUE)
    inertia = width * laser.thickness**3 / 12.0
    assert found == pytest.approx(4 * 12.0 * TRUE * inertia / (0.5 * scale - 0.5 * width) ** 3, rel=0.05)
    assert found == pytest.approx(2.0 * bending.spiral_stiffness(laser, scale, width, 1e-6, 0.5 * TRUE), rel=1e-9)


# -- what comes out ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS_OF_SHEETS)
def test_perfect_readings_give_what_they_were_made_from(name: str) -> None:
    c = made(**KINDS_OF_SHEETS[name])
    found = calibrate(c, perfect(c) if name != "mill" else replace(perfect(c), kerf_gaps=(), clearance=None))
    if name == "mill":  # the kerf that it was drawn for counts, other widths than the played ones
        assert found.kerf is None and found.youngs is not None
        return
    assert found.youngs is not None and found.kerf is not None and found.clearance is not None
    assert found.youngs.value == pytest.approx(TRUE, rel=1e-5)
    assert found.kerf.value == pytest.approx(KERF, rel=1e-9)
    assert found.clearance.value == pytest.approx(5e-5 + KERF - c.kerf, abs=1e-9)
    assert not found.warnings and found.believed.startswith("both")


def test_readings_with_errors_of_two_percent(laser: Coupons) -> None:
    """Modulus within 3 % and kerf within 0.02 mm, at 95 % of the draws."""
    random, exact = np.random.default_rng(3), perfect(laser)
    youngs, kerfs = [], []
    for _ in range(40):

        def noisy(values: list) -> list:
            return [np.asarray(v) * (1.0 + 0.02 * random.standard_normal(np.shape(v))) for v in values]

        found = calibrate(laser, replace(
            exact, kerf_gaps=noisy(exact.kerf_gaps), strip_sags=noisy(exact.strip_sags), spiral_sags=noisy(exact.spiral_sags)
        ))  # fmt: skip
        youngs.append(abs(found.youngs.value / TRUE - 1.0))
        kerfs.append(abs(found.kerf.value - KERF))
        assert found.youngs.error / TRUE < 0.02
    assert np.quantile(youngs, 0.95) < 0.03 and np.quantile(kerfs, 0.95) < 2e-5


def test_the_surer_of_two_values_counts_more() -> None:
    """Weights are 1 / error^2: of 1 +- 1 and 2 +- 2, 1 and 1/4, so that the mean is 6/5 and its variance 4/5."""
    found = _weighted_mean([MeasuredValue(1.0, 1.0), MeasuredValue(2.0, 2.0)])
    assert found == MeasuredValue(pytest.approx(1.2), pytest.approx(math.sqrt(0.8)))


def test_the_spread_of_readings_is_told(laser: Coupons) -> None:
    exact = perfect(laser)
    rough = replace(exact, kerf_gaps=[g * f for g, f in zip(exact.kerf_gaps, (0.9, 1.0, 1.1), strict=True)])
    found = calibrate(laser, rough)
    assert found.kerf == MeasuredValue(pytest.approx(KERF), pytest.approx(0.1 * KERF / math.sqrt(3.0)))


def test_contradicting_stiffness_is_said_and_spirals_are_believed(laser: Coupons) -> None:
    exact = perfect(laser)
    found = calibrate(laser, replace(exact, strip_sags=[0.7 * s for s in exact.strip_sags]))
    assert len(found.warnings) == 1 and "contradict" in found.warnings[0]
    assert found.youngs == found.spirals and found.believed.startswith("the spirals")
    other = calibrate(laser, replace(exact, strip_sags=(), spiral_sags=[(a, 0.7 * b) for a, b in exact.spiral_sags]))
    assert "Spirals A and B contradict" in other.warnings[0]


def test_a_clearance_that_cannot_be_is_refused_and_one_below_the_error_is_said(laser: Coupons) -> None:
    lines = laser.cells + 1
    with pytest.raises(FlexMapsError, match="cannot fit"):
        calibrate(laser, Readings(kerf_gaps=[lines * 8e-5], clearance=5e-5))
    found = calibrate(laser, Readings(kerf_gaps=[lines * laser.kerf], clearance=0.0))
    assert found.warnings and "below the kerf's error" in found.warnings[0]


@pytest.mark.parametrize(
    ("readings", "says"),
    [
        (Readings(), "Nothing was measured"),
        (Readings(kerf_gaps=[-1.0]), "above 0"),
        (Readings(kerf_gaps=[math.nan]), "above 0"),
        (Readings(kerf_gaps=[0.2]), "leaves nothing"),
        (Readings(kerf_gaps=[0.09]), "nothing of the spirals"),
        (Readings(clearance=4e-5), "No rung is engraved 0.04"),
        (Readings(kind="nail"), "no connector"),
        (Readings(thickness=[0.02]), "drawn for a sheet of 2 mm"),
        (Readings(strip_sags=[0.09]), "too steeply"),
        (Readings(strip_sags=[1e-9]), "millimetres"),
        (Readings(spiral_sags=[(1e-9, 1e-9)]), "millimetres"),
        (Readings(strip_mass=5.0), "grams"),
    ],
)
def test_what_is_no_measurement_is_refused(laser: Coupons, readings: Readings, says: str) -> None:
    with pytest.raises(FlexMapsError, match=says):
        calibrate(laser, readings)


def test_readings_in_millimetres_and_grams() -> None:
    shown = Readings.from_measurements(
        kerf_comb=1.9, clearance=0.05, spiral_sag=(0.7, 0.8), spiral_weight=(100, 200), strip_sag=[11.0, 11.2]
    )
    assert shown.kerf_gaps == [pytest.approx(1.9e-3)] and shown.clearance == pytest.approx(5e-5)
    assert shown.spiral_sags == [(pytest.approx(7e-4), pytest.approx(8e-4))]
    assert shown.spiral_loads == (pytest.approx(0.1), pytest.approx(0.2)) and len(shown.strip_sags) == 2
    assert parse_numbers("1.02, 1.04;3") == [1.02, 1.04, 3.0] and parse_numbers(" ") == []
    for wrong in (
        {"spiral_sag": (1.0,)},
        {"clearance": [1, 2]},
        {"kerf_comb": "1"},
        {"spiral_weight": (1.0, 2.0, 3.0)},
    ):
        with pytest.raises(FlexMapsError):
            Readings.from_measurements(**wrong)  # type: ignore[arg-type]
    with pytest.raises(FlexMapsError, match="not a list of numbers"):
        parse_numbers("1.0 mm")


def test_settings_are_those_of_a_material_and_a_machine(laser: Coupons) -> None:
    found = calibrate(laser, perfect(laser))
    settings = with_values(Settings(), {**found.settings, "spiral.slot_min": 0.4})
    assert settings.material.chosen.youngs == pytest.approx(TRUE, rel=1e-3)
    assert settings.material.chosen.density == 1420.0
    assert settings.cut.kerf_outline == pytest.approx(KERF, rel=1e-3) == settings.cut.kerf_holes
    assert settings.connect.clearance == pytest.approx(5e-5 + KERF - laser.kerf, abs=1e-7)
    text = preset_script(found.settings, "mine\nimport os")
    lines = [line for line in text.splitlines() if line.startswith("settings.")]
    assert len(lines) == len(found.settings) and "import os" in text.splitlines()[0]
    only = calibrate(laser, Readings(kerf_gaps=[0.0017])).settings
    assert set(only) == {"cut.kerf_outline", "cut.kerf_holes"}
    assert json.loads(json.dumps(found.report()))["youngs_gpa"]["value"] == pytest.approx(3.4, rel=1e-3)
    assert isinstance(found, Calibration)


# -- the sheet ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS_OF_SHEETS)
def test_its_pieces_are_sound_and_apart(name: str) -> None:
    """By shapely: valid outlines, holes inside, nothing overlaps even on the way of the cutter, all inside the sheet."""
    drawn = sheet_files.make_calibration_sheet(with_values(Settings(), KINDS_OF_SHEETS[name]))
    width, height = drawn.packing.sizes[0]
    paths = []
    for piece in drawn.pieces:
        cut = piece.cut(drawn.coupons.kerf, drawn.coupons.kerf_holes)
        assert all(c.area > 0.0 for c in piece.outlines) and all(c.area < 0.0 for c in piece.holes)
        outer = [shapely.Polygon(c.sample(1e-6)) for c in cut.outlines]
        holes = [shapely.Polygon(c.sample(1e-6)) for c in (*cut.holes, *[c for c in cut.shared if c.closed])]
        assert all(p.is_valid for p in (*outer, *holes))
        assert all(any(p.contains(h) for p in outer) for h in holes)
        # no letter in a hole or beyond its piece
        own = shapely.unary_union([shapely.Polygon(c.sample(1e-6)) for c in piece.outlines])
        letters = shapely.MultiLineString([c.points for c in piece.engraved])
        assert own.buffer(1e-9).contains(letters) and not any(h.intersects(letters) for h in holes)
        paths += outer
    assert shapely.unary_union(paths).area == pytest.approx(sum(p.area for p in paths), rel=1e-9)
    assert shapely.box(0, 0, width, height).contains(shapely.unary_union(paths))


@pytest.mark.parametrize("name", KINDS_OF_SHEETS)
def test_its_pieces_keep_the_distance_of_the_sheet_and_two_kerfs(name: str) -> None:
    settings = with_values(Settings(), KINDS_OF_SHEETS[name])
    drawn = sheet_files.make_calibration_sheet(settings)
    pieces = [shapely.union_all([shapely.Polygon(c.sample(1e-6)) for c in p.outlines]) for p in drawn.pieces]
    nearest = min(one.distance(other) for k, one in enumerate(pieces) for other in pieces[:k])
    assert nearest > max(settings.sheet.spacing, 2.0 * drawn.coupons.kerf, 2.0 * drawn.coupons.mill) - 1e-6


@pytest.mark.parametrize("name", KINDS_OF_SHEETS)
def test_the_frame_of_a_spiral_is_at_least_five_sheets_wide(name: str) -> None:
    c = made(**KINDS_OF_SHEETS[name])
    for one in c.spirals:
        piece = calibration_pieces.draw_spiral(c, one)
        holes = shapely.union_all([shapely.Polygon(hole.sample(1e-6)) for hole in piece.holes])
        edge = shapely.LinearRing(piece.outlines[0].sample(1e-6))
        assert edge.distance(holes) > max(calibration_pieces.RIM_WIDTH, 5.0 * c.thickness)


@pytest.mark.parametrize("name", KINDS_OF_SHEETS)
def test_the_arms_of_a_spiral_are_as_wide_as_their_stiffness_assumes(name: str) -> None:
    """Around the centre lines of arms that point to the middles of the frame's sides, as far as the fillets at the hub."""
    c = made(**KINDS_OF_SHEETS[name])
    for one in c.spirals:
        piece = calibration_pieces.draw_spiral(c, one)
        (left, _), (right, high) = piece.box
        centre = np.array([0.5 * (left + right), high - 0.5 * (right - left)])
        t = np.broadcast_to(np.linspace(0.02, 0.5, 40), (1, 4, 40))
        places = centre_line(calibration_pieces._make_arms(one), t)[0].reshape(-1, 2) + centre
        holes = shapely.union_all([shapely.Polygon(hole.sample(1e-7)) for hole in piece.holes])
        distances = shapely.distance(holes, shapely.points(places))
        assert distances == pytest.approx(0.5 * one.width, abs=0.01 * one.width)


def test_the_comb_counts_its_kerfs(laser: Coupons) -> None:
    """What is left of the window when every line has taken one kerf, by shapely: n squares, and a gap of n + 1 kerfs."""
    piece = calibration_pieces.draw_comb(laser, "")
    lines = [shapely.LinearRing(c.points) if c.closed else shapely.LineString(c.points) for c in piece.shared]
    taken = shapely.unary_union([line.buffer(0.5 * KERF, cap_style="square", join_style="mitre") for line in lines])
    window = shapely.Polygon(shapely.get_parts(taken)[0].exterior)
    squares = [p for p in shapely.get_parts(window - taken) if p.area > 1e-9]
    assert len(squares) == laser.cells
    width = window.bounds[2] - window.bounds[0] - sum(p.bounds[2] - p.bounds[0] for p in squares)
    assert width == pytest.approx((laser.cells + 1) * KERF, rel=1e-6)


@pytest.mark.parametrize("kind", ["dovetail", pytest.param("key", marks=pytest.mark.thorough)])
def test_rungs_leave_their_clearance(laser: Coupons, kind: str) -> None:
    """The counterpart laid into its recess stays the engraved clearance away from it everywhere, by shapely."""
    piece = calibration_pieces.draw_ladder(laser, ConnectorParams(), kind)
    rail = shapely.Polygon(piece.outlines[0].sample(1e-7))
    others = [shapely.Polygon(c.sample(1e-7)) for c in piece.outlines[1:]]
    parts = others[::2] if kind == "key" else others  # the loose key goes first into the rail
    assert len(parts) == len(laser.clearances)
    for part, clearance in zip(parts, laser.clearances, strict=True):

        def apart(shift: float, part: shapely.Polygon = part) -> float:
            return -shapely.affinity.translate(part, 0.0, shift).distance(rail)

        # as it sits: where it is farthest from the rail all round
        into = rail.bounds[3] - part.bounds[1]
        near = min(np.linspace(0.0, 0.006, 301), key=lambda s: apart(into - s))
        found = min(apart(into - s) for s in near + np.linspace(-2e-5, 2e-5, 41) if s >= 0.0)
        assert -found == pytest.approx(clearance, abs=2e-6)


def test_plain_ends_have_play_on_both_sides(laser: Coupons) -> None:
    piece = calibration_pieces.draw_ladder(laser, ConnectorParams(), "tab")
    rail, *tongues = (shapely.Polygon(c.sample(1e-7)) for c in piece.outlines)
    across = shapely.LineString([(-1.0, rail.bounds[3] - 6e-4), (1.0, rail.bounds[3] - 6e-4)])
    walls = [part.bounds for part in shapely.get_parts(rail.intersection(across))]
    slots = [after[0] - before[2] for before, after in pairwise(walls)]
    low = [shapely.LineString([(-1.0, t.bounds[1] + 6e-4), (1.0, t.bounds[1] + 6e-4)]) for t in tongues]
    wide = [t.intersection(line).length for t, line in zip(tongues, low, strict=True)]
    assert np.subtract(slots, wide) == pytest.approx([2.0 * c for c in laser.clearances], abs=1e-9)


def test_files_are_read_by_others(tmp_path: Path) -> None:
    import ezdxf
    import svgelements

    drawn = sheet_files.make_calibration_sheet(with_values(Settings(), LASER))
    paths = sheet_files.write_calibration_sheet(drawn, tmp_path, tuple(sheet_files.WRITERS))
    assert {p.name for p in paths} == {p.name for p in tmp_path.iterdir()}
    width, height = drawn.packing.sizes[0] * 1e3
    svg = svgelements.SVG.parse(tmp_path / "calibration.svg")
    assert svg.viewbox.width == pytest.approx(width, abs=1e-3) and svg.viewbox.height == pytest.approx(height, abs=1e-3)
    document = ezdxf.readfile(tmp_path / "calibration.dxf")
    layers = [e.dxf.layer for e in document.modelspace()]
    runs = drawn.cuts_on_sheet(0)
    assert layers.count("CUT_OUTER") == len(runs.outer_cuts) and layers.count("CUT_INNER") == len(runs.inner_cuts)
    assert len(list(svg.elements(lambda e: isinstance(e, svgelements.Path)))) == len(layers)
    again = read_coupons(tmp_path)
    assert again == drawn.coupons == read_coupons(tmp_path / CALIBRATION_FILE)


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"flexmaps": "calibration"}', "null", "nan"])
def test_damaged_sizes_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / CALIBRATION_FILE).write_text(text, encoding="utf-8")
    with pytest.raises(FlexMapsError, match="damaged"):
        read_coupons(tmp_path)
    with pytest.raises(FlexMapsError, match="make a calibration sheet first"):
        read_coupons(tmp_path / "nowhere")


def test_numbers_that_are_none_in_the_file_are_refused(tmp_path: Path, laser: Coupons) -> None:
    for name, value in (("thickness", -1.0), ("youngs", math.inf), ("strip_length", 0.0), ("density", math.nan)):
        (tmp_path / CALIBRATION_FILE).write_text(replace(laser, **{name: value}).text(), encoding="utf-8")
        with pytest.raises(FlexMapsError, match="damaged"):
            read_coupons(tmp_path)


def test_unknown_formats_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FlexMapsError, match="no format 'stl'"):
        sheet_files.write_calibration_sheet(sheet_files.make_calibration_sheet(Settings()), tmp_path / "out", ("stl",))
    assert not (tmp_path / "out").exists()
