"""Layouts that a person would draw, changes where the shape says so, and the choice among them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from flexmaps.engine import workers
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.extras.choosing import choice, choice_stage, drawn_cuts, layout_search
from flexmaps.engine.extras.choosing import choose as choosing
from flexmaps.engine.extras.choosing import judge as judging
from flexmaps.engine.extras.choosing.choose import choose
from flexmaps.engine.extras.choosing.judge import CutPlan, FlatLayout, JudgedLayout, LayoutProblem, flatten_cuts
from flexmaps.engine.extras.choosing.layout_changes import merge_across_seams, propose_changes
from flexmaps.engine.extras.choosing.layout_variants import SHIFT_ROWS, make_variants
from flexmaps.engine.params import ChooseParams, Settings
from flexmaps.engine.patches.layout import PatchLayout, component_numbers
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.shortfall import quad_curvatures
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.fabricable import design_from_spirals
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.surface.symmetry import preserved_by, symmetries


def torus(around: int = 16, across: int = 8) -> QuadMesh:
    """A torus of ``around`` times ``across`` quads."""
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    r = 0.1 + 0.04 * np.cos(b)
    points = np.stack([r * np.cos(a), r * np.sin(a), 0.04 * np.sin(b)], axis=2).reshape(-1, 3)

    def at(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return (i % around) * across + j % across

    return QuadMesh(points, np.stack([at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)], axis=2).reshape(-1, 4))


def grid(n: int = 8, m: int = 6, height: float = 0.02) -> QuadMesh:
    """A dome over a rectangle of n times m quads."""
    u, v = np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij")
    z = height * np.sin(np.pi * u / n) * np.sin(np.pi * v / m)
    points = np.stack([0.02 * u, 0.02 * v, z], axis=2).reshape(-1, 3)
    a = (u[:-1, :-1] * (m + 1) + v[:-1, :-1]).ravel()
    return QuadMesh(points, np.stack([a, a + m + 1, a + m + 2, a + 1], axis=1))


# -- lines -------------------------------------------------------------------------------------------------------------


def test_the_lines_of_a_torus_are_its_circles() -> None:
    mesh = torus()
    line_of = drawn_cuts.lines_of_edges(mesh)
    assert sorted(np.bincount(line_of).tolist()) == [8] * 16 + [16] * 8
    found = drawn_cuts.find_families(mesh)
    assert sorted(len(np.unique(family.lines)) for family in found) == [8, 16]
    assert all(family.closed for family in found)


def test_equal_parts_of_a_torus_are_equally_large() -> None:
    mesh = torus()
    long = max(drawn_cuts.find_families(mesh), key=lambda family: len(family.lines))  # the circles the short way round
    for parts in (2, 4, 8):
        cut = np.isin(drawn_cuts.lines_of_edges(mesh), long.equal(parts))
        a, b = mesh.edge_quads[~cut & ~mesh.border].T
        assert np.bincount(component_numbers(len(mesh.quads), a, b)).tolist() == [len(mesh.quads) // parts] * parts


def test_equal_strips_of_a_sheet() -> None:
    mesh = grid(8, 6)
    sizes = set()
    for name, cut in drawn_cuts.equal_part_cuts(mesh, 4, []):
        layout = PatchLayout(mesh, cut)
        sizes.add(tuple(len(quads) for quads in layout.patches))
        assert name.startswith(str(len(layout.patches)))
        assert layout.is_flattenable.all()
    assert {(24, 24), (12, 12, 12, 12), (16, 16, 16)} <= sizes  # halves both ways, quarters of 8, thirds of 6


def test_seams_lie_in_the_mirror_planes() -> None:
    mesh = grid(8, 6)
    cut = dict(drawn_cuts.cuts_in_planes(mesh, symmetries(mesh)))["along all mirror planes"]
    middle = mesh.vertices[mesh.edges[cut]].mean(axis=1)
    off = np.minimum(np.abs(middle[:, 0] - 0.08), np.abs(middle[:, 1] - 0.06))
    assert cut.sum() == 8 + 6 and off.max() < 1e-9
    assert len(drawn_cuts.edges_in_plane(mesh, next(s for s in symmetries(mesh) if np.linalg.det(s.matrix) > 0))) == 0


# -- judging and changing ----------------------------------------------------------------------------------------------


def test_a_lopsided_layout_is_made_symmetric() -> None:
    """With its images it has all its cuts still; mirrored halves cut as much on both sides as there."""
    mesh = grid(8, 6)
    found = symmetries(mesh)
    x = mesh.vertices[mesh.edges][:, :, 0]
    cut = (np.isclose(x, 0.02) | np.isclose(x, 0.12)).all(axis=1)  # two lines, at 1 and 6 quads of 8
    names = set()
    for name, edges in drawn_cuts.symmetric_variants(cut, mesh, found):
        names.add(name)
        assert preserved_by(found, edges)
        assert "images" not in name or (edges >= cut).all()
    assert names == {"as it was, with its images", "one half, mirrored"}
    across = next(s for s in found if s.name == "mirror across x")
    assert np.allclose(np.abs(across.normal), [1.0, 0.0, 0.0]) and across.is_mirror
    assert not any(s.is_mirror for s in found if "turn" in s.name)


@cache
def ball() -> LayoutProblem:
    """A ball of 150 quads, whose one panel a short search leaves at about 1 % of its size."""
    made = job.run(PolygonMesh.from_quads(shapes.make("cubesphere")), Settings(), stop_after="split")
    return LayoutProblem(made.mesh, Settings(), symmetries=tuple(symmetries(made.mesh)))


def test_what_is_no_disk_is_opened_as_symmetrically_as_the_cuts_are() -> None:
    """Rings round a ball: opened anywhere, some lose all of their symmetries; opened evenly, none does."""
    piece = ball()
    mesh, found = piece.mesh, piece.symmetries
    lost = 0
    for name, cut in drawn_cuts.drop_symmetric_images(drawn_cuts.equal_part_cuts(mesh, 5, found), found):
        plain, even = (flatten_cuts(piece, CutPlan(cut, name, way)) for way in (False, True))
        assert plain is not None
        if plain.symmetric > 1:
            assert even is None  # there is no need for another
        else:
            lost += 1
            assert even is not None and even.symmetric > 1 and PatchLayout(mesh, even.cut).is_flattenable.all()
            opened = drawn_cuts.open_symmetrically(cut, mesh, found)  # before crumbs are joined
            assert opened is not None and (opened >= cut).all()
    assert lost
    lopsided = np.zeros(len(mesh.edges), dtype=bool)
    lopsided[:3] = True
    assert drawn_cuts.open_symmetrically(lopsided, mesh, found[:1]) is None


def test_of_what_is_alike_by_symmetry_one_is_looked_at() -> None:
    mesh = torus()
    found = symmetries(mesh)
    cuts = list(drawn_cuts.cuts_in_planes(mesh, found))
    assert len(cuts) == 1 + 8 + 1  # the plane that the torus lies in, those through its axis, all together
    # of those through the axis some hold two vertices' circles of the short way, some lie between: these hold no edges
    assert len(list(drawn_cuts.drop_symmetric_images(cuts, found))) == 3
    assert [name for name, _ in drawn_cuts.drop_symmetric_images(cuts, [])] == [name for name, _ in cuts]


def test_what_cannot_be_laid_flat_is_no_layout() -> None:
    piece = LayoutProblem(torus(), Settings())
    nothing = np.zeros(len(piece.mesh.edges), dtype=bool)
    opened = flatten_cuts(piece, CutPlan(nothing, "no cut at all"))
    assert opened is not None and PatchLayout(piece.mesh, opened.cut).is_flattenable.all()
    assert flatten_cuts(piece, CutPlan(nothing, "too curved"), most=0.1) is None


@pytest.mark.parametrize("corner", [(1, 1), (1, 2), (2, 2)])
def test_panels_below_the_smallest_size_are_joined_to_their_neighbours(corner: tuple[int, int]) -> None:
    """A corner of a few quads is cut off a dome, and its mirror images: both a panel and a neck are too small."""
    mesh = grid(8, 6)
    piece = LayoutProblem(mesh, Settings(), symmetries=tuple(symmetries(mesh)))
    column, row = np.divmod(np.arange(len(mesh.quads)), 6)
    parts = (np.minimum(column, 7 - column) < corner[0]) & (np.minimum(row, 5 - row) < corner[1])
    for kept in (parts, parts & (column < 4) & (row < 3)):
        one, two = mesh.edge_quads.T
        cut = (kept[one] != kept[two]) & ~mesh.border
        assert min(len(quads) for quads in PatchLayout(mesh, cut).patches) < 6
        laid = flatten_cuts(piece, CutPlan(cut, "corners"))
        assert laid is not None
        assert min(len(quads) for quads in laid.flat.layout.patches) >= 6
        assert (laid.flat.layout.isthmus_widths(own=False) >= 2).all()
        assert float(laid.flat.energy.max()) <= piece.settings.layout.distortion_limit
        assert len(preserved_by(piece.symmetries, laid.cut)) >= len(preserved_by(piece.symmetries, cut))


def test_small_panels_stay_where_no_neighbour_can_take_them() -> None:
    """Two bodies, one of them of four quads: nothing is beside it."""
    large, small = grid(6, 6), grid(2, 2)
    mesh = QuadMesh(
        np.concatenate([large.vertices, small.vertices + np.array([1.0, 0.0, 0.0])]),
        np.concatenate([large.quads, small.quads + len(large.vertices)]),
    )
    laid = flatten_cuts(LayoutProblem(mesh, Settings()), CutPlan(np.zeros(len(mesh.edges), dtype=bool), "nothing"))
    assert laid is not None and sorted(len(quads) for quads in laid.flat.layout.patches) == [4, 36]


def judged_of(laid: FlatLayout, blame: np.ndarray) -> JudgedLayout:
    kind = np.zeros(len(blame), dtype=np.int64)
    return JudgedLayout(
        laid,
        *(0.05, 0.1, 0.5, 0, blame, kind, "", 0.1, 1.0, 1),
        (np.zeros((len(blame), 4)), np.zeros(len(blame))),
        laid.flat,
    )


def test_cuts_and_darts_go_where_the_blame_is_and_joins_where_it_is_not() -> None:
    mesh = grid(8, 6, height=0.04)
    piece = LayoutProblem(mesh, Settings())
    middle = np.isclose(mesh.vertices[mesh.edges][:, :, 0], 0.08).all(axis=1) & ~mesh.border
    laid = flatten_cuts(piece, CutPlan(middle, "halves"))
    assert laid is not None
    blame = np.where(mesh.centroids[:, 0] < 0.08, 1.0, 0.0)  # the left half is to blame
    ideas = list(propose_changes(piece, judged_of(laid, blame), fewer=True, more=True))
    added = [idea.cut & ~laid.cut for idea in ideas if (idea.cut & ~laid.cut).any()]
    assert added
    assert all((mesh.vertices[mesh.edges[cut]][..., 0] <= 0.08 + 1e-9).all() for cut in added[:3])
    assert any(idea.origin == "joined" and not idea.cut.any() for idea in ideas)
    assert all(PatchLayout(mesh, idea.cut).is_flattenable.all() for idea in ideas)


def test_changes_keep_the_symmetry_of_a_layout() -> None:
    mesh = grid(8, 6)
    piece = LayoutProblem(mesh, Settings(), symmetries=tuple(symmetries(mesh)))
    cut = dict(drawn_cuts.cuts_in_planes(mesh, piece.symmetries))["along all mirror planes"]
    laid = flatten_cuts(piece, CutPlan(cut, "quarters"))
    assert laid is not None and laid.symmetric == 1 + len(piece.symmetries) == 4
    rng = np.random.default_rng(2)
    for idea in propose_changes(piece, judged_of(laid, rng.random(len(mesh.quads))), fewer=True, more=True):
        assert all((idea.cut[s.edges] == idea.cut).all() for s in piece.symmetries)


def test_a_seam_is_moved_aside_by_whole_rows_to_both_sides() -> None:
    """A straight seam through the middle of 12 by 6 quads lies on the lines beside it afterwards, and nothing else changes."""
    mesh = grid(12, 6)
    x = mesh.vertices[mesh.edges][:, :, 0]
    plan = CutPlan(np.isclose(x, 0.12).all(axis=1) & ~mesh.border, "halves")
    laid = flatten_cuts(LayoutProblem(mesh, Settings()), plan)
    assert laid is not None
    ideas = make_variants(LayoutProblem(mesh, Settings()), judged_of(laid, np.ones(len(mesh.quads))))
    moved = [idea.cut for idea in ideas if idea.origin == "a seam moved"]
    lines_at = {round(float(x[cut].mean()) / 0.02) for cut in moved if np.ptp(x[cut]) < 1e-9 and cut.sum() == 6}
    assert lines_at == {6 + side * rows for side in (-1, 1) for rows in SHIFT_ROWS}
    assert len(moved) == 2 * len(SHIFT_ROWS)


def test_cuts_against_joins_give_no_more_panels_and_take_up_less_curvature_first() -> None:
    mesh = grid(9, 6, height=0.04)
    piece = LayoutProblem(mesh, Settings(), symmetries=tuple(symmetries(mesh)))
    x = mesh.vertices[mesh.edges][:, :, 0]
    thirds = (np.isclose(x, 0.06) | np.isclose(x, 0.12)).all(axis=1) & ~mesh.border
    laid = flatten_cuts(piece, CutPlan(thirds, "thirds"))
    assert laid is not None and laid.panels == 3
    ideas = make_variants(piece, judged_of(laid, np.random.default_rng(2).random(len(mesh.quads))))
    exchanged = [idea for idea in ideas if "joined" in idea.origin]
    assert exchanged and all(len(PatchLayout(mesh, idea.cut).patches) <= 3 for idea in exchanged)
    assert all((idea.cut != laid.cut).any() for idea in ideas)
    assert all((thirds & ~idea.cut).any() and (idea.cut & ~thirds).any() for idea in exchanged)
    # by Gauss and Bonnet, what the panels have to take up is what no cut lets out: the fewer it lets out, the later it comes
    within = [np.bincount(p.patch_of, quad_curvatures(p)) for p in (PatchLayout(mesh, idea.cut) for idea in ideas)]
    assert (np.diff([float((one**2).sum()) for one in within]) >= -1e-6).all()


def strips(*parts: int) -> dict[int, FlatLayout]:
    """A dome of 24 by 4 quads in so many strips across."""
    mesh = grid(24, 4)
    piece = LayoutProblem(mesh, Settings())
    column = np.arange(len(mesh.quads)) // 4
    one, two = mesh.edge_quads.T
    found = {}
    for count in parts:
        strip = column * count // 24
        laid = flatten_cuts(piece, CutPlan((strip[one] != strip[two]) & ~mesh.border, f"{count} strips"))
        assert laid is not None and laid.panels == count
        found[count] = laid
    return found


@pytest.mark.parametrize("most", [2, 5, 7])
def test_panels_are_joined_down_to_a_number_within_the_limits(most: int) -> None:
    laid = strips(8)[8]
    piece = LayoutProblem(laid.flat.layout.mesh, Settings())
    made = merge_across_seams(piece, judged_of(laid, np.ones(len(laid.flat.layout.mesh.quads))), most)
    assert made is not None and 0 < made.panels <= most
    assert (made.cut <= laid.cut).all()  # nothing is cut anew
    assert float(made.flat.energy.max()) <= piece.settings.layout.distortion_limit


def test_each_proposal_has_few_more_panels_than_the_one_before_and_all_look_different() -> None:
    """Strips that come the nearer the more there are; some numbers come twice, and the taken one has most."""
    settings = Settings()
    made = []
    for count, laid in strips(1, 2, 3, 4, 6, 8).items():
        judged = replace(judged_of(laid, np.ones(len(laid.flat.layout.mesh.quads))), rms=0.02 / count)
        made += [choice.make_proposal(judged, settings, settings.material.chosen) for _ in range(2)]
    shown = choice.select_proposals(made, made[-1])
    panels = [one.panels for one in shown]
    assert made[-1] in shown and panels == sorted(set(panels))
    # from two panels on there is always a number within the stride: 2, 3, 4, 6, 8
    assert all(b <= choice.MAX_PANEL_STEP * a for a, b in pairwise(panels) if a > 1)
    assert panels[0] == 1 and panels[-1] == 8


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer layouts than anybody would compare, which is quicker."""
    monkeypatch.setattr(layout_search, "MAX_LAYOUTS", 6)
    monkeypatch.setattr(layout_search, "MIN_LAYOUTS", 6)
    monkeypatch.setattr(choosing, "MAX_PARTS", 3)
    monkeypatch.setattr(choosing, "SECOND_SEARCH_RATIO", 0.0)
    monkeypatch.setattr(judging, "MIN_SHARE", 1.0)  # what is judged here has little patience as it is


# -- choosing ----------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("few")
@pytest.mark.thorough
def test_a_nearer_match_is_found_by_more_cuts_and_the_note_tells() -> None:
    """The given layout ends at 0.1 % or more; three panels of a ball are nearer than any one panel, as geometry has it."""
    piece = ball()
    given = job.run(PolygonMesh.from_quads(piece.mesh), Settings(), stop_after="split").flat
    assert given is not None
    seen: list[str] = []
    small = replace(piece, settings=replace(piece.settings, optimise=replace(piece.settings.optimise, patience=0.3)))
    choice = choose(small, given, ChooseParams(match=0.02), Progress(lambda fraction, text: seen.append(text)))
    rows = [one.report() for one in choice.proposals]
    first = next(row for row in rows if row["origin"] == "as it was")
    taken = rows[choice.taken]
    assert 3 <= len(rows) <= 6 and rows == sorted(rows, key=lambda row: (row["panels"], row["joints"]))
    assert choice.best.proved and taken["rms_percent"] < 0.7 * first["rms_percent"]
    assert any(one.symmetric for one in choice.proposals)
    assert choice.reached == (taken["rms_percent"] <= 0.02)
    assert ("Chosen for" in choice.note) == choice.reached and f"{taken['panels']} panel" in choice.note
    assert any("the best: " in text for text in seen)
    # what it tells is what one gets: its panels with its spirals, simulated by themselves
    design = design_from_spirals(choice.best.flat, small.settings.spiral, *choice.best.judged.spirals)
    found = simulate(design, small.mesh, small.settings.material.chosen, small.settings.simulate)
    assert found.target_distances["rms_percent"] == pytest.approx(taken["rms_percent"], rel=0.05, abs=0.001)


@pytest.mark.usefixtures("few")
@pytest.mark.thorough
def test_no_more_panels_than_asked_and_none_worse_than_given() -> None:
    settings = Settings()
    piece = LayoutProblem(grid(8, 6, height=0.03), replace(settings, optimise=replace(settings.optimise, patience=0.3)))
    middle = np.isclose(piece.mesh.vertices[piece.mesh.edges][:, :, 0], 0.08).all(axis=1)
    given = flatten_cuts(piece, CutPlan(middle, "halves"))
    assert given is not None
    choice = choose(piece, given.flat, ChooseParams(goal="panels", panels=2))
    first = next(one for one in choice.proposals if one.judged.laid.origin == "as it was")
    assert choice.reached and choice.best.panels <= 2 and choice.best.rms <= first.rms


@pytest.mark.usefixtures("few")
def test_a_stop_keeps_the_best_so_far() -> None:
    piece = LayoutProblem(grid(6, 6, height=0.03), Settings())
    given = job.run(PolygonMesh.from_quads(piece.mesh), Settings(), stop_after="split").flat
    assert given is not None

    def tell(fraction: float, text: str) -> None:
        if "the best" in text and fraction > 0.2:
            raise Cancelled(text)

    choice = choose(piece, given, ChooseParams(match=0.001), Progress(tell))
    assert not choice.finished and choice.proposals
    with pytest.raises(Cancelled):
        choose(piece, given, ChooseParams(), Progress(stopped=lambda: True))


def test_what_was_optimised_stays_where_its_layout_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """No other layout is looked at, so that nothing can come nearer than the given one has."""
    monkeypatch.setattr(layout_search, "MAX_LAYOUTS", 1)
    monkeypatch.setattr(layout_search, "MIN_LAYOUTS", 1)
    monkeypatch.setattr(workers, "count_cores", lambda: 1)  # starting processes takes longer than their work
    settings = Settings()
    quick = replace(settings, optimise=replace(settings.optimise, patience=0.1), choose=ChooseParams(match=0.001))
    mesh = PolygonMesh.from_quads(grid(4, 4, height=0.02))
    made = job.run(mesh, quick, stop_after="simulate", optimised=True)
    after = job.run_stages(made, quick, ("choose",))
    assert after.choice is not None and made.simulation is not None
    assert after.choice.best.proved
    assert 100.0 * after.choice.best.rms == pytest.approx(made.simulation.target_distances["rms_percent"], rel=1e-12)
    assert after.flat is made.flat and after.design is made.design and after.optimisation is made.optimisation
    plain = job.run_stages(job.run(mesh, quick, stop_after="simulate"), quick, ("choose",))  # nothing was optimised
    assert plain.design is None and plain.simulation is None and plain.flat is not None


@pytest.mark.usefixtures("few")
@pytest.mark.thorough
def test_another_proposal_can_be_taken_and_what_was_made_goes() -> None:
    settings = Settings()
    quick = replace(settings, optimise=replace(settings.optimise, patience=0.1), choose=ChooseParams(match=0.001))
    made = job.run(PolygonMesh.from_quads(grid(6, 6, height=0.03)), quick, stop_after="simulate", chosen=True)
    assert made.undone == {}
    # the spirals are those with which the layout was chosen: simulated, it comes as near as its proposal says
    assert made.simulation is not None and made.choice is not None and made.design is not None
    found, best = made.simulation.target_distances["rms_percent"], made.choice.best
    assert found == pytest.approx(100.0 * best.rms, rel=0.05, abs=0.002)
    assert made.flat is best.flat and len(made.choice.proposals) > 1
    other = int(made.choice.taken == 0)
    changed = choice_stage.take_proposal(made, other, quick)
    assert changed.flat is made.choice.proposals[other].flat
    assert changed.design is None and changed.choice is not None and changed.choice.taken == other
    with pytest.raises(Exception, match="no proposal 99"):
        choice_stage.take_proposal(made, 99, quick)
