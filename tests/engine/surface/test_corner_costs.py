"""Rings of edges round vertices, and the cost of the corners that cuts make there."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.surface import corner_costs
from flexmaps.engine.surface.corner_costs import EdgeRing, corner_cost, edge_rings
from flexmaps.engine.surface.mesh import QuadMesh


def grid(columns: int = 3, rows: int = 3) -> QuadMesh:
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0), indexing="ij")
    corner = np.arange(x.size).reshape(x.shape)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    return QuadMesh(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), quads)


def test_rings_go_round_counter_clockwise_and_end_at_the_border() -> None:
    mesh = grid()
    for vertex, ring in enumerate(edge_rings(mesh)):
        around = np.flatnonzero((mesh.edges == vertex).any(axis=1))
        assert sorted(ring.edges) == around.tolist()
        on_border = bool(mesh.border[around].any())
        assert ring.is_closed != on_border and len(ring.angles) == len(ring.edges) - on_border
        other = [mesh.edges[e][mesh.edges[e] != vertex][0] for e in ring.edges]
        way = mesh.vertices[other] - mesh.vertices[vertex]
        turn = np.diff(np.arctan2(way[:, 1], way[:, 0])) % (2.0 * np.pi)
        np.testing.assert_allclose(turn, ring.angles[: len(turn)])
        if on_border:
            assert mesh.border[[ring.edges[0], ring.edges[-1]]].all()
        else:
            assert sum(ring.angles) == pytest.approx(2.0 * np.pi)


def ring(*degrees: float, closed: bool = True) -> EdgeRing:
    count = len(degrees) + (not closed)
    return EdgeRing(tuple(range(count)), tuple(np.radians(degrees).tolist()), closed)


@pytest.mark.parametrize(
    ("cut", "cost"),
    [
        ((), 0.0),
        ((2,), corner_costs.DEAD_END_COST),
        ((0, 2), 0.0),  # straight on
        ((1, 3), 0.0),
        ((0, 1), corner_costs.CONVEX_COST + corner_costs.REFLEX_COST),
        ((3, 0), corner_costs.CONVEX_COST + corner_costs.REFLEX_COST),
        ((0, 1, 2), 2.0 * corner_costs.CONVEX_COST),
        ((0, 1, 2, 3), 4.0 * corner_costs.CONVEX_COST),
    ],
)
def test_corners_of_right_angles(cut: tuple[int, ...], cost: float) -> None:
    assert corner_cost(ring(90.0, 90.0, 90.0, 90.0), cut) == pytest.approx(cost)


@pytest.mark.parametrize(
    ("degrees", "cost"),
    [
        ((221.0, 139.0), 0.0),
        ((223.0, 137.0), corner_costs.REFLEX_COST + corner_costs.CONVEX_COST),
        ((309.0, 51.0), corner_costs.REFLEX_COST + corner_costs.CONVEX_COST),
        ((311.0, 49.0), corner_costs.REFLEX_COST + corner_costs.ACUTE_COST),
    ],
)
def test_limits_between_acute_convex_straight_and_reflex(degrees: tuple[float, float], cost: float) -> None:
    assert corner_cost(ring(*degrees), (0, 1)) == pytest.approx(cost)
    first, second = degrees
    assert corner_cost(ring(0.5 * first, 0.5 * first, second), (0, 2)) == pytest.approx(cost)


def test_at_the_border_the_outside_is_no_corner() -> None:
    """Two quads at a straight border: whole they make no corner, divided two convex ones."""
    border = ring(90.0, 90.0, closed=False)
    assert corner_cost(border, (0, 2)) == 0.0
    assert corner_cost(border, (0, 1, 2)) == pytest.approx(2.0 * corner_costs.CONVEX_COST)


def test_a_cut_ends_at_no_cost_where_other_than_four_quads_meet() -> None:
    for count in (3, 5):
        assert corner_cost(ring(*[360.0 / count] * count), (0,)) == 0.0


def test_every_pattern_of_cuts_has_its_own_cost() -> None:
    """Costs are kept by pattern; those of one must not be taken for another's."""
    one = ring(40.0, 70.0, 100.0, 70.0, 80.0)
    for bits in range(32):
        cut = tuple(k for k in range(5) if bits >> k & 1)
        fresh = ring(40.0, 70.0, 100.0, 70.0, 80.0)
        assert corner_cost(one, cut) == corner_cost(fresh, cut) == corner_cost(one, cut)
    assert len(one.cost_cache) == 32
