"""Panels that are cut further where that saves sheets: of squares that lie one on a sheet, for which everything is known."""

import dataclasses

import numpy as np
import pytest
import shapely
from flexmaps.engine.fabrication.nesting import fewer
from flexmaps.engine.fabrication.nesting.packing import pack
from flexmaps.engine.params import Settings, SheetParams, SpiralParams
from flexmaps.engine.progress import Cancelled, Progress
from flexmaps.engine.spirals.rim import Rim


def settings(joints):
    """Sheets of 600 x 400 mm, packed the quick way, each worth so many joints."""
    return Settings(sheet=SheetParams(nesting="FAST", cut_joints=joints))


@pytest.fixture
def squares(flat_grid):
    """Three squares of 360 mm side by side: each needs a sheet, but half of one fits beside another: two sheets then."""
    return flat_grid(24, 8, 0.045, cut=lambda x, _: x in (8, 16))


def test_one_cut_saves_a_sheet(squares):
    made = fewer.fewer_sheets(squares, settings(30))
    layout, mesh = made.layout, squares.layout.mesh
    assert len(layout.patches) == 4
    assert fewer.joints(layout) == 3 * 8  # straight through a square
    shapes = fewer.outlines(made, SpiralParams(border="stubs"))
    assert sum(shapely.Polygon(s).area for s in shapes) == pytest.approx(3 * 0.36**2)
    assert len(pack(shapes, (0.6, 0.4), 0.005, 0.003).sizes) == 2
    assert "1 more cut, with 8 joints" in layout.notes["split"]
    # the grid has two mirrors, and they are kept: the square in the middle was halved
    middle = mesh.vertices[mesh.edges[layout.cut]].mean(axis=1)
    for turn in ((-1, 1, 1), (1, -1, 1)):
        image = np.where(np.array(turn) < 0, mesh.vertices.max(axis=0) - middle, middle)
        assert set(map(tuple, image.round(4).tolist())) == set(map(tuple, middle.round(4).tolist()))


def test_a_sheet_is_worth_no_more_joints_than_is_said(squares):
    # three squares are 1.62 sheets and lay on 2.62: at most one is saved, for 8 joints
    assert fewer.fewer_sheets(squares, settings(7)) is squares
    assert fewer.fewer_sheets(squares, settings(0)) is squares


def test_many_layouts_are_nested_for_a_short_time_and_the_best_for_a_long_one(squares, monkeypatch):
    """With sheets told by hand: of twenty layouts the first five get all seconds, the next seven share twice as many, and the best two of these
    get all of them too."""
    made = [dataclasses.replace(squares) for _ in range(20)]
    needs = {id(one): 2.9 - 0.1 * (k % 7) for k, one in enumerate(made)} | {id(squares): 3.0}
    asked, told = [], []
    monkeypatch.setattr(fewer._Cutting, "all", lambda self: made)
    monkeypatch.setattr(fewer, "outlines", lambda flat, spiral: asked.append(flat) or [])
    monkeypatch.setattr(fewer, "nest", lambda shapes, sheet, progress: told.append(sheet.nesting_seconds))
    monkeypatch.setattr(fewer, "sheets_needed", lambda packing, shapes, sheet: needs[id(asked[-1])])
    found = fewer.fewer_sheets(squares, Settings(sheet=SheetParams(cut_joints=30, nesting_seconds=60.0)))
    assert told == pytest.approx([60.0] + [120.0 / 7] * 7 + [60.0] * 7)
    assert [made.index(one) for one in asked[-7:]] == [0, 1, 2, 3, 4, 6, 5] and found is made[6]
    needs[id(squares)] = 2.0
    assert fewer.fewer_sheets(squares, Settings(sheet=SheetParams(cut_joints=30))) is squares


def test_hulls_tell_how_many_sheets_are_needed(squares):
    # by hand: a sheet bears 0.82 of 590 x 390 mm, and so one square of 360 mm; of the third it takes what that is of it
    bears = 0.82 * 0.59 * 0.39
    whole = 0.36**2
    assert fewer.by_hulls([whole] * 3, SheetParams()) == pytest.approx(2.0 + whole / bears)
    # halves go in pairs beside nothing else, quarters fill up the room beside a square
    assert fewer.by_hulls([0.5 * whole] * 2, SheetParams()) == pytest.approx(whole / bears)
    assert fewer.by_hulls([whole, 0.25 * whole], SheetParams()) == pytest.approx(1.25 * whole / bears)


def test_the_border_is_where_the_panels_will_end(flat_grid):
    """Of ten by four squares of 20 mm: without the outer arms a fifth of a square less on each side, with a rim as far as that goes."""
    grid = flat_grid(10, 4, 0.02)
    rim = Rim.from_flat(grid, SpiralParams(border="rim"))
    for border, more in (("stubs", 0.0), ("left_out", -0.004), ("rim", rim.depth + rim.width)):
        (found,) = fewer.outlines(grid, SpiralParams(border=border))
        np.testing.assert_allclose(np.ptp(found, axis=0), [0.2 + 2.0 * more, 0.08 + 2.0 * more], atol=1e-9)


def test_it_can_be_stopped(squares):
    with pytest.raises(Cancelled):
        fewer.fewer_sheets(squares, settings(100), Progress(lambda *_: None, lambda: True))
