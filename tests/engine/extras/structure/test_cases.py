"""Load cases: what their lines say, and what they do to the spirals, against areas and lengths that are known."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.structure.actions import Action, UnloadedState, actions_by_name, are_hidden, lasting_action
from flexmaps.engine.extras.structure.cases import Load, LoadCase, LoadCombination, format_line, parse_plan
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.mechanics.loads import parse_supports
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh

EDGE = 0.02


def test_lines_say_kind_value_axis_place_factor_and_whether_it_lasts() -> None:
    found = parse_plan(
        "weight: weight\nsnow: snow 500 on the roof times 1.5; lamp: point 5 -z on 12,13 lasting; lamp: line 1,2,3\n"
        "settle: move 3 -z on lowest; wind: wind 300 x; press: pressure -2e2"
    )
    assert found.cases == (
        LoadCase("weight", (Load("weight", lasting=True),)),
        LoadCase("snow", (Load("snow", (0.0, 0.0, -500.0), "the roof", 1.5),)),
        LoadCase(
            "lamp", (Load("point", (0.0, 0.0, -5.0), "12,13", lasting=True), Load("line", (1.0, 2.0, 3.0)))
        ),
        LoadCase("settle", (Load("move", (0.0, 0.0, -0.003), "lowest"),)),
        LoadCase("wind", (Load("wind", (300.0, 0.0, 0.0)),)),
        LoadCase("press", (Load("pressure", (-200.0,)),)),
    )  # fmt: skip
    assert found.groups == ("the roof", "12,13", "lowest")


def test_combinations_are_sums_with_factors() -> None:
    text = "a = 1.35 weight + 1.5*snow; b = weight - .9 snow; c=1e+1weight"
    found = parse_plan(["weight: weight", "snow: snow 500"], text)
    assert found.combinations == (
        LoadCombination("a", ((1.35, "weight"), (1.5, "snow"))),
        LoadCombination("b", ((1.0, "weight"), (-0.9, "snow"))),
        LoadCombination("c", ((10.0, "weight"),)),
    )


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("", "There is no load case"),
        ("snow 500", "give it as NAME: KIND"),
        ("a: rain 5", "'rain' is not a kind of load; choose one of weight, point"),
        ("a: snow", "give its pressure in N/m2"),
        ("a: snow many", "'many' is not a number"),
        ("a: snow nan", "'nan' is not a number"),
        ("a: point 5", "give the axis"),
        ("a: wind 5 up", "give the axis"),
        ("a: wind 1,2,3", "one number and an axis"),
        ("a: weight 5", "weight takes no value"),
        ("a: pressure 5 x", "has no axis"),
        ("a: point 1,2 -z", "one number and an axis"),
        ("a: weight times x", "'x' is not a number"),
    ],
)
def test_lines_that_cannot_be_read_are_named(line: str, says: str) -> None:
    with pytest.raises(FlexMapsError, match=says):
        parse_plan(line)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("b = 2 snow", "'b' adds 'snow', which is not a load case; the load cases are a"),
        ("b: 2 a", "give it as NAME = "),
        ("b = ", "give it as NAME = "),
        ("b = 2 3 a", "give it as NAME = "),
        ("a = 2 a", "Two cases or combinations are called 'a'"),
    ],
)
def test_combinations_that_mean_nothing_are_named(text: str, says: str) -> None:
    with pytest.raises(FlexMapsError, match=says):
        parse_plan("a: weight", text)


# -- what they do ------------------------------------------------------------------------------------------------------


def ground(mesh: QuadMesh, held: tuple[int, ...] = ()) -> UnloadedState:
    """Quads as they lie in space, each flat by itself, of one gram each."""
    p = mesh.vertices[mesh.quads]
    x = p[:, 1] + p[:, 2] - p[:, 0] - p[:, 3]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    x -= (x * normal).sum(axis=1, keepdims=True) * normal
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frames = np.stack([x, np.cross(normal, x), normal], axis=2)
    flat = np.einsum("fij,fki->fkj", frames, p - p.mean(axis=1)[:, None])[..., :2]
    inner = ~mesh.border
    fixed = np.isin(np.arange(len(p)), held)
    pairs, sides = mesh.edge_quads[inner], mesh.edge_sides[inner]
    pose, mass = Pose(p.mean(axis=1), frames), np.full(len(p), 1e-3)
    return UnloadedState(pose, p, flat, pairs, sides, mass, fixed, lambda text: parse_supports(mesh, text))


def action(text: str, place: UnloadedState) -> Action:
    return actions_by_name(parse_plan(f"a: {text}"), place)["a"]


def grid(columns: int, rows: int) -> QuadMesh:
    x, y = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    corner = np.arange(x.size).reshape(x.shape)
    quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 4)
    return QuadMesh(EDGE * np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1), quads)


def test_weight_and_point_loads_are_what_they_say_in_all() -> None:
    place = ground(grid(4, 3))
    assert action("weight times 2", place).force.sum(axis=0) == pytest.approx([0.0, 0.0, -2.0 * 9.81 * 0.012])
    force = action("point 5 -z on 0,7,8", place).force
    assert force.sum(axis=0) == pytest.approx([0.0, 0.0, -5.0])
    assert sorted(np.flatnonzero(force[:, 2])) == [0, 7, 8]


@pytest.mark.parametrize(
    ("quads", "length"),
    [
        ("4,5,6,7", 4 * EDGE),  # straight, from border to border
        ("5,6", 2 * EDGE),
        ("5", EDGE),
        ("0,1,2,6,10", 5 * EDGE),  # round a corner, whose quad it crosses by two halves
    ],
)
def test_a_line_load_is_as_long_as_its_line(quads: str, length: float) -> None:
    force = action(f"line 30 y on {quads}", ground(grid(4, 3))).force
    assert force.sum(axis=0) == pytest.approx([0.0, 30.0 * length, 0.0])


def test_a_line_that_branches_is_refused() -> None:
    with pytest.raises(FlexMapsError, match="Load case 'a': its quads form no line") as told:
        action("line 30 y on 4,5,6,1", ground(grid(4, 3)))
    assert list(told.value.faces) == [5]


def test_pressures_and_winds_meet_areas_that_are_known() -> None:
    """A closed surface under pressure is pushed nowhere; a convex one stops wind with the area of its shadow."""
    mesh = shapes.make("cubesphere", EDGE)
    place = ground(mesh)
    pressed = action("pressure 100", place)
    assert (pressed.pressure < 0.0).all() and pressed.at(place.pose)[:, :].sum(axis=0) == pytest.approx(
        [0.0] * 3, abs=1e-3 * 100 * place.area.sum()
    )
    radius = float(np.linalg.norm(mesh.vertices, axis=1).mean())
    for kind, axis, along in (("wind 300 x", 0, 1.0), ("wind 300 -y", 1, -1.0), ("snow 300", 2, -1.0)):
        force = action(kind, place).force
        shadow = 0.5 * (place.area * np.abs(place.pose.rotations[:, axis, 2])).sum()
        assert force.sum(axis=0)[axis] == pytest.approx(along * 300.0 * shadow, rel=0.01)
        assert shadow == pytest.approx(np.pi * radius**2, rel=0.05)
        # it leaves the side in the lee alone
        lee = along * mesh.vertices[mesh.quads].mean(axis=1)[:, axis] > 0.1 * radius
        assert not force[lee].any()


def test_what_lies_behind_something_else_is_hidden() -> None:
    low, high = grid(4, 1), grid(2, 1)
    both = np.concatenate([low.vertices, high.vertices + EDGE * np.array([1.0, 0.0, 1.0])])
    mesh = QuadMesh(both, np.concatenate([low.quads, high.quads + len(low.vertices)]))
    corners = mesh.vertices[mesh.quads]
    assert np.flatnonzero(are_hidden(corners, np.array([0.0, 0.0, -1.0]))).tolist() == [1, 2]
    assert np.flatnonzero(are_hidden(corners, np.array([0.0, 0.0, 1.0]))).tolist() == [4, 5]


def test_only_supports_can_be_moved() -> None:
    place = ground(grid(4, 3), held=(0, 3))
    assert action("move 0,0,5 on 3", place).shift.sum(axis=0) == pytest.approx([0.0, 0.0, 0.005])
    assert np.flatnonzero(action("move 5 z", place).shift[:, 2]).tolist() == [0, 3]
    with pytest.raises(FlexMapsError, match="only supports can be moved"):
        action("move 5 z on 3,4", place)
    with pytest.raises(FlexMapsError, match="only supports can be moved"):
        action("move 5 z", ground(grid(4, 3)))


def test_combinations_and_what_lasts_are_sums() -> None:
    place = ground(grid(4, 3))
    wanted = parse_plan("w: weight; p: point 1 x on 2 lasting; p: point 4 y on 2", "c = 2 w - 3 p")
    found = actions_by_name(wanted, place)
    assert found["c"].force == pytest.approx(2.0 * found["w"].force - 3.0 * found["p"].force)
    stays = lasting_action(wanted, place)
    assert stays.force.sum(axis=0) == pytest.approx([1.0, 0.0, -9.81 * 0.012])


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (("w", "weight", 5.0, "x"), "w: weight"),
        (("s", "snow", 500.0, "-z", "the roof", 1.5), "s: snow 500 -z on the roof times 1.5"),
        (("p", "pressure", -2.5, "x", "", 1.0, True), "p: pressure -2.5 lasting"),
        (("m", "move", 3.0, "-y", "1,2"), "m: move 3 -y on 1,2"),
    ],
)
def test_a_load_is_written_as_it_is_read(given: tuple[str, str, float, str], line: str) -> None:
    assert format_line(*given) == line
    assert parse_plan(line).cases[0].loads[0].kind == given[1]


@pytest.mark.parametrize("where", ["a; b", "it times 2", "these lasting"])
def test_groups_that_a_line_cannot_name_are_refused(where: str) -> None:
    with pytest.raises(FlexMapsError, match="rename the group"):
        format_line("a", "snow", 5.0, "-z", where)
