"""Room for the cutter: derivatives of every kind of gap by every kind of parameter."""

from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np
import pytest
import shapely
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.assembly import assembly_from_design
from flexmaps.engine.optimisation.clearance_restoration import narrowest_per_pair
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.simulation.simulate import build_model
from flexmaps.engine.spirals.clearance import arm_pairs
from flexmaps.engine.spirals.clearance.clearance_model import ClearanceModel
from flexmaps.engine.spirals.clearance.gap_opening import open_gaps
from flexmaps.engine.spirals.curves import spiral
from flexmaps.engine.spirals.curves.spiral import same_width
from flexmaps.engine.spirals.design import SpiralDesign

WIDE = 6.0  # rooms: all that is near in any way


def _moved(flat, change):
    return FlatPatches(flat.layout, flat.points + change.reshape(-1, 2), flat.energy, flat.irregularity)


def _sheared(points, way):
    shaken = np.random.default_rng(4).uniform(-0.0025, 0.0025, points.shape)
    return points + way * points[:, 1:] * [1.0, 0.0] + shaken


@pytest.fixture(params=[False, True], ids=["counterclockwise", "clockwise"])
def case(flat_grid, request):
    """A room, and a design whose arms are near and through each other in all ways: across joints, cuts, and corners."""
    flat = flat_grid(
        4, 3, move=lambda p: _sheared(p, -1.0 if request.param else 1.0), cut=lambda x, y: x == 2 and y < 2
    )
    params = replace(SpiralParams(), clockwise=request.param)
    rng = np.random.default_rng(5)
    return ClearanceModel.from_flat(flat, params), flat, rng.uniform(0.001, 0.002, (12, 4)), rng.uniform(2.0, 5.0, 12)


def _kinds(room, terms):
    """The kind of every term: of its pair of arms, 3 for the inner edge of one, or 4 for how far one is wound."""
    known = {(int(a), int(b)): int(k) for a, b, k in zip(room.pairs.one, room.pairs.two, room.pairs.kind, strict=True)}
    kinds = [3 if a == b else known[a, b] for a, b in terms.arms[:, [0, 2]].tolist()]
    return np.where((terms.arms == terms.arms[:, :1]).all(axis=1), 4, kinds)


def _difference(rooms, step, at, way):
    """Slope of rooms along a way."""
    after, before = (rooms(*(x + s * w for x, w in zip(at, way, strict=True))) for s in (step, -step))
    assert after.arms.tolist() == before.arms.tolist()
    return (after.value - before.value) / (2 * step)


@pytest.mark.parametrize("by", ["widths", "twists", "points"])
def test_derivatives_agree_with_differences(case, by):
    room, flat, width, twist = case
    rng = np.random.default_rng(6)
    terms = room.clearances(width, twist, below=WIDE, with_flat=True)
    # where centre lines cross, their distance has a kink
    apart = terms.value > -3.0
    for _ in range(2):
        w, t, p = rng.normal(size=width.shape), rng.normal(size=12), rng.normal(size=flat.points.size)
        if by == "widths":
            found = _difference(partial(room.clearances, below=WIDE), 1e-7, (width, twist), (w, 0.0))
            exact = terms.by_design[:, :48] @ w.ravel()
        elif by == "twists":
            found = _difference(partial(room.clearances, below=WIDE), 1e-6, (width, twist), (0.0, t))
            exact = terms.by_design[:, 48:] @ t
        else:
            found = _difference(
                lambda x: room.with_flat(_moved(flat, x)).clearances(width, twist, below=WIDE), 1e-8, (0.0,), (p,)
            )
            exact = terms.by_flat @ p
        for kind, name in enumerate(("beside", "across", "round", "sharp", "wound")):
            some = (_kinds(room, terms) == kind) & apart
            assert some.sum() > (0 if kind == arm_pairs.ROUND else 20), name
            np.testing.assert_allclose(found[some], exact[some], atol=1e-6 * np.abs(exact[some]).max(), err_msg=name)


def test_what_is_closed_is_found_from_any_quad_that_has_a_part_in_it(case):
    room, _, width, twist = case
    every = room.quads_with_closed_gaps(width, twist)
    terms = room.clearances(width, twist, below=0.0)
    part = np.unique(terms.arms[terms.value < 0.0] // 4)
    assert np.flatnonzero(every).tolist() == part.tolist()
    for quad in range(12):
        one = room.quads_with_closed_gaps(width, twist, np.arange(12) == quad)
        assert one[quad] == every[quad]
        assert not (one & ~every).any()


@pytest.mark.parametrize("below", [0.0, 1.0, WIDE])
def test_the_narrowest_places_alone_are_those_among_all(case, below):
    room, _, width, _ = case
    rng, apart, seen = np.random.default_rng(8), 0.0, 0
    for most in (1.5, 3.0, 4.0, 5.0, 6.0):
        twist = rng.uniform(0.3 * most, most, 12)
        every, alone = (
            narrowest_per_pair(room.clearances(width, twist, below=below, with_flat=True, narrowest_only=least))
            for least in (False, True)
        )
        assert alone.arms.tolist() == every.arms.tolist()
        assert (room.quads_with_closed_gaps(width, twist).sum() > 0) == bool((every.value < 0.0).any())
        seen, apart = seen + len(every.value), max(apart, np.abs(alone.value - every.value).max(initial=0.0))
    assert seen > 10 and apart < 1e-7


@pytest.mark.parametrize("clockwise", [False, pytest.param(True, marks=pytest.mark.thorough)])
def test_the_narrowest_gaps_agree_with_shapely(flat_grid, clockwise):
    rng = np.random.default_rng(2)
    flat = flat_grid(3, 3, move=lambda p: _sheared(p, -0.6 if clockwise else 0.6))
    width, twist = np.full((9, 4), 0.001), rng.uniform(1.0, 4.0, 9)
    params = replace(SpiralParams(), clockwise=clockwise)
    room, terms = (
        ClearanceModel.from_flat(flat, params),
        ClearanceModel.from_flat(flat, params).clearances(width, twist, below=12.0),
    )
    least: dict[tuple[int, int], float] = {}
    for (
        (one, _, two, _),
        value,
    ) in zip(terms.arms.tolist(), terms.value.tolist(), strict=True):
        least[one, two] = min(value, least.get((one, two), np.inf))
    shape = spiral.make_arms(flat, params, width, twist)
    lines = [
        [
            spiral.centre_line(shape, np.broadcast_to(np.linspace(0, d, 2001), (9, 4, 2001)))[0].reshape(36, -1, 2)
            for d in depths
        ]
        for depths in arm_pairs.DEPTHS.tolist()
    ]
    seen = np.zeros(3, dtype=int)
    for a, b, kind, need in zip(room.pairs.one, room.pairs.two, room.pairs.kind, room.required_gaps, strict=True):
        if (a, b) in least and least[a, b] > -3.0:
            exact = shapely.LineString(lines[kind][0][a]).distance(shapely.LineString(lines[kind][1][b])) - 0.001
            assert least[a, b] * room.gap_unit + need == pytest.approx(exact, abs=1e-7)
            seen[kind] += 1
    assert seen[arm_pairs.SAME_QUAD] > 10 and seen[arm_pairs.ACROSS] > 1
    # nothing else is near
    mates = {tuple(sorted(pair)) for pair in enumerate(room.geometry.mate.tolist())}
    known = {tuple(sorted(pair)) for pair in zip(room.pairs.one.tolist(), room.pairs.two.tolist(), strict=True)}
    outer = [shapely.LineString(line[:1201]) for line in lines[arm_pairs.SAME_QUAD][1]]
    for a, b in combinations(range(36), 2):
        if a // 4 != b // 4 and (a, b) not in mates and outer[a].distance(outer[b]) < 0.0014:
            assert (a, b) in known


@pytest.mark.parametrize("clockwise", [False, True])
def test_spirals_are_unwound_until_the_elastic_model_knows_them(flat_grid, clockwise):
    """Where no gap is in the way, to just where the model ends; spirals that nothing is joined to are left."""
    flat = flat_grid(4, 3, move=lambda p: _sheared(p, -0.6 if clockwise else 0.6))
    params = replace(SpiralParams(), clockwise=clockwise)
    room, width, wound = ClearanceModel.from_flat(flat, params), same_width(np.full(12, 0.002)), np.full(12, 9.0)
    none = np.zeros(len(room.required_gaps), dtype=bool)
    room = replace(
        room,
        pairs=room.pairs.subset(none),
        required_gaps=room.required_gaps[none],
        min_radius_ratio=np.full(48, -np.inf),
    )

    def beyond(twist):
        model = build_model(
            assembly_from_design(SpiralDesign(flat, params, width, twist)), MATERIALS["vero"], "arm", quick=True
        )
        return [part.quantity for part in model.beyond()]

    assert beyond(wound) and room.quads_with_closed_gaps(width, wound).all()
    free = np.ones(12, dtype=bool)
    same, twist = open_gaps(room, np.full(12, 0.001), width, wound, free)
    assert (same == width).all() and not beyond(twist) and beyond(1.01 * twist)
    assert not room.quads_with_closed_gaps(width, twist).any()
    assert (open_gaps(room.without_twist_limits, np.full(12, 0.001), width, wound, free)[1] == wound).all()
