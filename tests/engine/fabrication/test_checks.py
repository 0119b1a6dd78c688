"""Checks before cutting: refused with the faces and a remedy exactly where a limit is passed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication import checks
from flexmaps.engine.fabrication.connectors.connect import Connections, Connector, connect
from flexmaps.engine.fabrication.panels.kerf import cut_paths
from flexmaps.engine.fabrication.panels.panel import Panel
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.params import ConnectorParams, CutParams, SheetParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.contours import Outline
from flexmaps.engine.spirals.curves.arcs import Curve
from flexmaps.engine.spirals.design import SpiralDesign

PATCHES = (np.array([0, 1]), np.array([2, 3]))


def _panel(outline: Outline, patch: int = 0) -> Panel:
    return Panel(patch + 1, patch, outline.outer, outline.holes, (), outline.outer.area)


def _rectangle(width: float, height: float, turn: float = 0.0, patch: int = 0) -> Panel:
    points = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    return _panel(Outline(Curve(points, np.zeros(4)).transform(turn, np.zeros(2)), ()), patch)


@pytest.fixture
def design(flat_grid: Callable[..., FlatPatches]) -> SpiralDesign:
    """Four spirals of two widths on two panels; the slots between the arms of the wide ones are narrower."""
    flat = flat_grid(4, 1, cut=lambda x, _: x == 2)
    width = np.repeat([[0.001], [0.001], [0.001], [0.003]], 4, axis=1)
    return SpiralDesign(flat, SpiralParams(slot_min=0.0005, fillet=0.0004), width, np.array([1.0, 1.0, 3.0, 1.0]))


def test_a_mill_as_wide_as_the_narrowest_slot_passes(design: SpiralDesign) -> None:
    slot = design.min_slot_and_bridge[0]
    checks.check_mill(design, CutParams(mill=0.0))
    checks.check_mill(design, CutParams(mill=slot))
    with pytest.raises(FlexMapsError, match=f"A mill of {slot * 1020:g} mm") as caught:
        checks.check_mill(design, CutParams(mill=1.02 * slot))
    assert f"down to {slot * 1e3:.2g} mm wide" in str(caught.value)
    assert f"the fillet {slot * 510:g} mm" in str(caught.value)


def test_a_mill_wider_than_the_fillets_fits_nowhere(design: SpiralDesign) -> None:
    with pytest.raises(FlexMapsError, match="4 spirals") as caught:
        checks.check_mill(design, CutParams(mill=0.00081))
    assert caught.value.faces == [0, 1, 2, 3]


def _uncut(outline: Outline, kerf: float) -> float:
    """Area that should be cut away and stays, when a round cutter as wide as the kerf follows its path."""
    path = cut_paths(outline, kerf, kerf)
    left = shapely.Polygon(path.outer.sample(1e-7)).buffer(-0.5 * kerf, quad_segs=32)
    drawn = shapely.Polygon(outline.outer.sample(1e-7))
    return float(left.difference(drawn.buffer(2e-6)).area)


def test_a_kerf_that_leaves_the_roots_of_slots_uncut_is_refused(design: SpiralDesign) -> None:
    """The slots end in fillets of 0.4 mm, so that a kerf of 0.8 mm just cuts them."""
    outlines = design.outlines()
    panels = [_panel(outline, k) for k, outline in enumerate(outlines)]
    slot = design.min_slot_and_bridge[0]
    assert slot == pytest.approx(0.0008)
    for kerf in (CutParams(), CutParams(kerf_outline=slot), CutParams(kerf_holes=slot)):
        checks.check_kerf(design, panels, kerf)
    assert _uncut(outlines[0], slot) < 1e-12 < 1e-8 < _uncut(outlines[0], 1.1 * slot)
    for name in ("kerf_outline", "kerf_holes"):
        with pytest.raises(FlexMapsError, match=r"4 spirals cannot be cut: the kerf of 0\.88 mm is too wide") as caught:
            checks.check_kerf(design, panels, CutParams(**{name: 1.1 * slot}))
        assert caught.value.faces == [0, 1, 2, 3]


def test_cuts_that_would_run_into_each_other_are_refused_where_they_do(design: SpiralDesign) -> None:
    """A notch of 1 mm that widens inwards: a cutter 1.2 mm wide does not pass its mouth."""
    neck = np.array([[0, 0], [40, 0], [40, 20], [35.5, 20], [37, 14], [32, 14], [34.5, 20], [0, 20]]) * 1e-3
    notched = _panel(Outline(Curve(neck, np.zeros(8)), ()), 0)
    wide = replace(
        design, params=replace(design.params, fillet=0.001), width=np.full((4, 4), 0.001), twist=np.full(4, 0.5)
    )
    checks.check_kerf(wide, [notched], CutParams(kerf_outline=0.0009))
    with pytest.raises(FlexMapsError, match=r"1 place cannot be cut: the kerf of 1\.2 mm") as caught:
        checks.check_kerf(wide, [notched], CutParams(kerf_outline=0.0012))
    assert 1 in caught.value.faces and set(caught.value.faces) <= {0, 1}


def test_a_panel_with_an_arc_smaller_than_the_kerf_is_named(design: SpiralDesign) -> None:
    """A round hole of 0.6 mm has no path for a kerf of 0.7 mm."""
    hole = Curve(1e-3 * np.array([[5.0, 5.3], [5.0, 4.7]]), np.array([-1.0, -1.0]))
    plain, pierced = _rectangle(0.02, 0.02), replace(_rectangle(0.02, 0.02, patch=1), holes=(hole,))
    checks.check_kerf(design, [plain, pierced], CutParams(kerf_outline=0.0007, kerf_holes=0.0005))
    with pytest.raises(FlexMapsError, match=r"Panel 2: the kerf of 0\.7 mm is too wide") as caught:
        checks.check_kerf(design, [plain, pierced], CutParams(kerf_holes=0.0007))
    assert caught.value.faces == design.flat.layout.patches[1].tolist()


@pytest.fixture
def joined(flat_grid: Callable[..., FlatPatches]) -> Connections:
    """Seven joints, all of which have a connector of the kind that is asked for."""
    made = fabricable.uniform_design(flat_grid(4, 7, cut=lambda x, _: x == 2), SpiralParams(), width=0.002)
    return connect(made, ConnectorParams(connector="key"))


def _glued(one: Connector) -> Connector:
    return replace(one, candidate=replace(one.candidate, kind="tab"))


def test_joints_without_a_connector_are_counted_and_the_first_are_named(joined: Connections) -> None:
    params = ConnectorParams(connector="key")
    assert len(joined.connectors) == 7 and checks.warn_of_missing_connectors(joined, params) == []
    glued = replace(joined, connectors=(*joined.connectors[:5], *map(_glued, joined.connectors[5:])))
    (text,) = checks.warn_of_missing_connectors(glued, params)
    a, b = joined.connectors[5].faces
    assert text.startswith(f"2 of 7 joints have room for ends to be glued only (A6 between faces {a} and {b}, A7 ")
    assert checks.warn_of_missing_connectors(glued, ConnectorParams(connector="tab")) == []
    for count, end in ((5, "A5 between faces 1 and 2)"), (6, "A5 between faces 1 and 2, ...)")):
        none = replace(joined, connectors=(), plain_joints=tuple((f"A{k + 1}", 1, 2) for k in range(count)))
        (text,) = checks.warn_of_missing_connectors(none, params)
        assert text.startswith(f"{count} of {count} joints have no room for a connector") and end in text
    both = replace(glued, plain_joints=(("B1", 8, 9),))
    assert [text[:6] for text in checks.warn_of_missing_connectors(both, params)] == ["2 of 8", "1 of 8"]


def _sheet(rotation: str = "QUARTER", **more: str) -> SheetParams:
    return SheetParams(sheet_width=0.3, sheet_height=0.2, margin=0.01, rotation=rotation, **more)


@pytest.mark.parametrize("rotation", ["FREE", "QUARTER", "GRAIN"])
def test_panels_up_to_the_sheet_less_both_margins_pass(rotation: str) -> None:
    sheet = _sheet(rotation)
    assert checks.check_panel_sizes([_rectangle(0.28, 0.18)], PATCHES, sheet) == []
    (text,) = checks.check_panel_sizes([_rectangle(0.27, 0.18), _rectangle(0.281, 0.1, patch=1)], PATCHES, sheet)
    assert text.startswith("Panel 2 is 281 x 100 mm and larger than the sheet of 300 x 200 mm less its margins;")
    upright = checks.check_panel_sizes([_rectangle(0.18, 0.28)], PATCHES, sheet)
    assert len(upright) == (rotation == "GRAIN")
    with pytest.raises(FlexMapsError, match=r"Panel 2 is 281 x 100 mm .* cut the panel in two") as caught:
        too_long = [_rectangle(0.1, 0.1), _rectangle(0.281, 0.1, patch=1)]
        checks.check_panel_sizes(too_long, PATCHES, replace(sheet, oversize="error"))
    assert caught.value.faces == [2, 3]


def test_panels_are_measured_as_they_lie_along_the_grain() -> None:
    aslant = [_rectangle(0.27, 0.17, turn=-0.7)]
    assert checks.check_panel_sizes(aslant, PATCHES, _sheet("GRAIN"), turn=0.7) == []
    assert len(checks.check_panel_sizes(aslant, PATCHES, _sheet("GRAIN"))) == 1


def test_a_long_panel_may_lie_across_the_sheet_at_any_angle_if_allowed() -> None:
    """The diagonal of a sheet of 280 x 180 mm is 333 mm long."""
    bar = [_rectangle(0.315, 0.005)]
    assert checks.check_panel_sizes(bar, PATCHES, _sheet("FREE")) == []
    assert len(checks.check_panel_sizes(bar, PATCHES, _sheet("QUARTER"))) == 1


def test_grain_is_a_matter_of_materials_that_have_one() -> None:
    wood = next(one for one in MATERIALS.values() if one.orthotropy is not None)
    (text,) = checks.warn_of_ignored_grain(wood, _sheet("FREE"))
    assert text.startswith(f"{wood.name} is stiffer along its grain")
    assert checks.warn_of_ignored_grain(wood, _sheet("GRAIN")) == []
    assert checks.warn_of_ignored_grain(MATERIALS["pom"], _sheet("FREE")) == []


def test_quads_too_small_for_their_arms_are_told(flat_grid: Callable[..., FlatPatches]) -> None:
    params = SpiralParams(width_min=0.001)
    made = SpiralDesign(flat_grid(3, 1), params, np.full((3, 4), 0.001), np.ones(3))
    assert checks.warn_of_tight_quads(made) == []
    thin = replace(made, width=np.repeat([[0.001], [0.0008], [0.0007]], 4, axis=1))
    (text,) = checks.warn_of_tight_quads(thin)
    assert text.startswith("2 quads have no room for arms 1 mm wide; these are down to 0.7 mm")


@pytest.mark.parametrize(
    ("slot_min", "fillet", "limit"), [(0.0005, 0.0003, 0.0005), (0.0005, 0.0002, 0.0004), (0.0005, 0.0, 0.0005)]
)
def test_slots_are_told_below_what_was_asked_for_them_and_their_roots(
    flat_grid: Callable[..., FlatPatches], slot_min: float, fillet: float, limit: float
) -> None:
    params = SpiralParams(width_min=0.001, slot_min=slot_min, fillet=fillet)
    made = SpiralDesign(flat_grid(2, 1), params, np.full((2, 4), 0.001), np.ones(2))
    made.cache.min_slot_and_bridge = limit * (1.0 - 1e-4), 0.001
    assert checks.warn_of_tight_quads(made) == []
    made.cache.min_slot_and_bridge = 0.9 * limit, 0.001
    (text,) = checks.warn_of_tight_quads(made)
    assert text.startswith(f"The narrowest slot is {900 * limit:.2g} mm wide and not 0.5 mm;")


def test_the_narrowest_arm_of_a_spiral_is_printed_in_one_line_or_two(flat_grid: Callable[..., FlatPatches]) -> None:
    width = np.full((3, 4), 0.002)
    width[1, 2] = 0.0008
    made = SpiralDesign(flat_grid(3, 1), SpiralParams(), width, np.ones(3))
    for nozzle in (0.0, 0.0003, 0.0004):
        assert checks.check_nozzle(made, CutParams(nozzle=nozzle)) == []
    for nozzle in (0.00041, 0.0008):
        (text,) = checks.check_nozzle(made, CutParams(nozzle=nozzle))
        assert text.startswith("The arms of 1 spiral are down to 0.8 mm wide, less than two lines")
    with pytest.raises(FlexMapsError, match=r"1 spiral are down to 0\.8 mm wide, narrower than the nozzle") as caught:
        checks.check_nozzle(made, CutParams(nozzle=0.00081))
    assert caught.value.faces == [1]
