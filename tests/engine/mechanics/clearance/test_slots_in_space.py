"""Slots between bent arms: against polygons where they are flat, against clouds of points where they are bent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from flexmaps.engine.materials import find_material
from flexmaps.engine.mechanics.arms.bent import BentArms, bend_arms
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.mechanics.clearance.slots_in_space import (
    DEEPEST,
    SpaceSlots,
    _near_stations,
    _section_distance,
    _Sections,
    slots_in_space,
)
from flexmaps.engine.params import LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals import design, fabricable
from flexmaps.engine.spirals.curves.spiral import LEFT, RIGHT, centre_line, edge_points
from flexmaps.engine.surface import shapes
from scipy.spatial import cKDTree

PARAMS = SpiralParams(thickness=0.0015, width_min=0.0008, width_max=0.002, twist_max=8.0)
NARROW = 0.0006  # metres: slots that are compared closely


def flat_pose(made: design.SpiralDesign) -> Pose:
    count = len(made.width)
    return Pose(np.c_[made.arms.centre, np.zeros(count)], np.broadcast_to(np.eye(3), (count, 3, 3)).copy())


def inner_end(made: design.SpiralDesign, arms: BentArms, found: SpaceSlots, slot: int, which: int) -> float:
    """t up to which an arm of a slot was looked at."""
    arm = found.arms[slot, which]
    outer = slot < 4 * len(made.width) and which == 0
    if not outer:
        return float(arms.hub[arm])
    quad, k = divmod(slot, 4)
    ends = made.roots.right if arm != slot else made.roots.left
    return DEEPEST * float(ends[quad, k])


def edges(made: design.SpiralDesign, arm: int, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre line and left and right edge of an arm at t, flat, from the hub's centre."""
    one = made.arms.one_by_one(np.array([arm // 4]), np.array([arm % 4]))
    line = centre_line(one, t[None, None])[0][0, 0]
    left, right = (edge_points(one, t[None, None], side)[0][0, 0] for side in (LEFT, RIGHT))
    return tuple(points - one.centre[0] for points in (line, left, right))  # type: ignore[return-value]


def cloud(made: design.SpiralDesign, arms: BentArms, arm: int, end: float) -> np.ndarray:
    """Points of both narrow sides of an arm in space."""
    t = np.linspace(0.0, end, 500)
    line, *both = (np.c_[points, np.zeros(len(t))] for points in edges(made, arm, t))
    place, turn = arms.at(np.full(len(t), arm), t, line)
    rise = 0.5 * made.params.thickness * np.linspace(-1.0, 1.0, 17)
    sides = [place + ((side - line)[:, None] @ np.swapaxes(turn, 1, 2))[:, 0] for side in both]
    return np.concatenate([side + z * turn[..., 2] for side in sides for z in rise])


@pytest.fixture(
    scope="module", params=[False, pytest.param(True, marks=pytest.mark.thorough)], ids=["left", "clockwise"]
)
def dome(request):
    """A dome of wound spirals in several patches, simulated."""
    mesh = shapes.make("dome")
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(clockwise=request.param), twist=4.5)
    return simulate(made, mesh, find_material("pom"), SimulateParams())


@pytest.mark.parametrize("clockwise", [False, True])
def test_flat_slots_are_those_between_polygons(flat_grid, clockwise):
    rng = np.random.default_rng(4)
    flat = flat_grid(3, 3, 0.02, move=lambda p: p + rng.uniform(-0.002, 0.002, p.shape))
    width, twist = np.repeat(rng.uniform(0.0008, 0.0016, 9), 4).reshape(9, 4), rng.uniform(6.0, 8.0, 9)
    made = fabricable.make_fabricable(flat, replace(PARAMS, clockwise=clockwise), width, twist)
    arms = bend_arms(made, flat_pose(made))
    found = slots_in_space(made, arms)
    own = 4 * len(width)
    assert len(found.width) > own and not len(found.closed)
    assert (found.width[:own] < NARROW).sum() > 8
    for slot in range(len(found.width)):
        shape = []
        for which in (0, 1):
            arm = found.arms[slot, which]
            t = np.linspace(0.0, inner_end(made, arms, found, slot, which), 300)
            _, left, right = edges(made, arm, t)
            shape.append(shapely.Polygon(np.concatenate([left, right[::-1]]) + made.arms.centre[arm // 4]))
        wanted = shape[0].distance(shape[1])
        # between the places that are looked at a slot may be a little narrower
        assert found.width[slot] == pytest.approx(wanted, abs=5e-5 if wanted < NARROW else 2e-4)


def test_bent_slots_are_those_between_clouds_of_points(dome):
    made = dome.design
    arms = bend_arms(made, dome.equilibrium.pose, material=dome.material)
    found, own = dome.slots(), 4 * len(made.width)
    order = np.argsort(found.width)
    order = order[found.width[order] > 5e-5]  # points tell no depth
    for slot in (*order[order < own][:60:6], *order[order >= own][:20:4]):
        points = [cloud(made, arms, found.arms[slot, k], inner_end(made, arms, found, slot, k)) for k in (0, 1)]
        wanted = cKDTree(points[0]).query(points[1])[0].min()
        assert found.width[slot] == pytest.approx(wanted, abs=5e-5)


@pytest.mark.parametrize(
    ("aside", "above", "wanted"),
    [(2.5, 0.0, 0.5), (1.2, 0.0, -0.8), (1.2, 2.0, 0.5), (1.2, 0.9, -0.6), (2.3, 1.9, 0.5)],
    ids=["beside", "through", "upon", "through above", "corner to corner"],
)
def test_parallel_bars_are_as_far_apart_as_their_sections(flat_grid, aside, above, wanted):
    """Two straight arms, 2 mm wide and 1.5 mm thick, one carried so many millimetres beside and above the other."""
    made = design.SpiralDesign(flat_grid(2, 1), PARAMS, np.full((2, 4), 0.002), np.zeros(2))
    arms = bend_arms(made, flat_pose(made))
    place = arms.place.copy()
    place[6] += np.array([1e-3 * aside - 0.02, 0.0, 1e-3 * above])
    found = slots_in_space(made, replace(arms, place=place))
    (slot,) = np.flatnonzero((np.sort(found.arms, axis=1) == [2, 6]).all(axis=1))
    assert 1e3 * found.width[slot] == pytest.approx(wanted, abs=1e-9)


def test_a_squeezed_shape_names_the_spirals_whose_slots_close(dome):
    pose = dome.equilibrium.pose
    squeezed = replace(dome.equilibrium, pose=Pose(0.9 * pose.centres, pose.rotations))
    found = replace(dome, equilibrium=squeezed)
    slots = found.slots()
    (told,) = [one for one in found.findings if one.code == "slots-close"]
    assert told.faces == tuple(np.flatnonzero(slots.narrowest_per_quad < 0.0).tolist())
    assert f"{len(slots.closed)} slots" in told.message and "brush Twist" in told.message
    block = found.report()
    assert block["slots_closed"] == len(slots.closed) > 0 and block["slot_min_mm"] == 1e3 * slots.width.min() < 0.0
    assert len(dome.slots().closed) < 0.2 * len(slots.closed)
    assert replace(dome, equilibrium=replace(squeezed, converged=False)).slots() is None


def test_slots_measured_again_in_a_part_are_those_of_the_whole(dome):
    whole, mesh = dome.slots(), dome.target
    quads = mesh.centroids[:, 0] > np.median(mesh.centroids[:, 0])
    others = SpaceSlots(whole.arms, whole.width + 1.0)  # wrong by a metre
    found = replace(dome).slots_near(quads, others)
    known = dict(zip(map(tuple, whole.arms.tolist()), whole.width, strict=True))
    assert {*map(tuple, found.arms.tolist())} == known.keys()
    inside = quads[found.arms // 4].all(axis=1)
    assert 0.3 < inside.mean() < 0.7
    wanted = np.array([known[pair] for pair in map(tuple, found.arms.tolist())]) + ~inside
    assert found.width == pytest.approx(wanted, abs=1e-9)
    assert replace(dome, equilibrium=replace(dome.equilibrium, converged=False)).slots_near(quads, others) is None


def test_arms_of_different_bodies_are_no_slot(flat_grid):
    made = design.SpiralDesign(flat_grid(2, 1), PARAMS, np.full((2, 4), 0.002), np.zeros(2))
    arms = bend_arms(made, flat_pose(made))
    place = arms.place.copy()
    place[6] += np.array([0.0012 - 0.02, 0.0, 0.0])  # one arm through the other
    through = replace(arms, place=place)
    assert (slots_in_space(made, through).arms // 4 == [0, 1]).all(axis=1).any()
    made.flat.layout.mesh.__dict__["body_of"] = np.array([0, 1])
    assert not (slots_in_space(made, through).arms // 4 == [0, 1]).all(axis=1).any()


def test_stations_within_the_longer_reach_of_their_arms_are_pairs() -> None:
    """Beside the pairs found one by one, with reaches that differ by a hundred times; small arms are not joined over a large one's reach."""
    rng = np.random.default_rng(7)
    place = rng.normal(size=(40, 1, 3)) + 0.02 * rng.normal(size=(40, 6, 3))
    reach = np.geomspace(0.01, 1.0, 40)
    point, size = place.reshape(-1, 3), np.repeat(reach, 6)
    apart = np.linalg.norm(point[:, None] - point, axis=2)
    one, two = np.nonzero(np.triu(apart <= np.maximum.outer(size, size), 1))
    found = {tuple(pair) for pair in _near_stations(place, reach).tolist()}
    assert {*zip(one.tolist(), two.tolist(), strict=True)} <= found
    assert all(apart[a, b] <= 2.0 * max(size[a], size[b]) for a, b in found)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 0.7, -0.5, 1.2])
@pytest.mark.parametrize("gap", [0.0004, -0.0002])
def test_the_distance_of_sections_is_that_of_their_rectangles(tilt: float, gap: float) -> None:
    """A thin section beside the wide face of an upright one, turned about their common direction: a corner lies before that face."""
    height, half = 0.004, np.array([0.0006, 0.001])

    def section(width: float, turn: float, across: float) -> _Sections:
        c, s = np.cos(turn), np.sin(turn)
        rows = ([0.0, across, 0.0], [1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c])
        numbers = (np.array([[x]]) for x in (width, 0.0, 1.0))
        return _Sections(*(np.array([[row]]) for row in rows), *numbers)

    def rectangle(width: float, turn: float, across: float) -> shapely.Polygon:
        turned = (
            np.exp(1j * turn) * (width * np.array([1, -1, -1, 1]) + 1j * height * np.array([1, 1, -1, -1])) + across
        )
        return shapely.Polygon(np.c_[turned.real, turned.imag])

    # by how much the turned section reaches to the side
    reach = half[1] * np.cos(tilt) + height * abs(np.sin(tilt))
    away = half[0] + reach + gap
    first, second = section(half[0], 0.0, away), section(half[1], tilt, 0.0)
    one, two = rectangle(half[0], 0.0, away), rectangle(half[1], tilt, 0.0)
    expected = one.distance(two) if gap > 0.0 else gap
    for a, b in ((first, second), (second, first)):
        assert _section_distance(a, b, height)[0, 0] == pytest.approx(expected, abs=1e-9)
    assert one.intersects(two) == (gap < 0.0)
