"""The order of cuts: every curve once, panels together, and hardly longer than the shortest tour there is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from flexmaps.engine.fabrication.panels.order import CutGroup, order_cuts
from flexmaps.engine.spirals.curves.arcs import Curve


def square(centre: np.ndarray, size: float = 0.001) -> Curve:
    return Curve(centre + size * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), np.zeros(4))


def stroke(a: np.ndarray, b: np.ndarray) -> Curve:
    return Curve(np.stack([a, b]), np.zeros(2), closed=False)


def travel(curves: tuple[Curve, ...]) -> float:
    """Metres from the origin to the first, and between them, without a look at what made the order."""
    here, way = np.zeros(2), 0.0
    for curve in curves:
        way += float(np.linalg.norm(curve.points[0] - here))
        here = curve.points[0] if curve.closed else curve.points[-1]
    return way


def normal(curve: Curve) -> tuple[tuple[float, float], ...]:
    """Its points, wherever it begins and which way it goes."""
    return tuple(sorted(map(tuple, curve.points.tolist())))


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("kind", ["closed", "open", "led"])
def test_near_the_shortest_of_all_tours(seed: int, kind: str) -> None:
    random = np.random.default_rng(seed)
    places = random.uniform(0.0, 0.4, (7, 2))
    made = [square(p) if kind == "closed" else stroke(p, p + random.uniform(-0.05, 0.05, 2)) for p in places]
    ordered, end = order_cuts([CutGroup((c,), i, is_reversible=kind == "open") for i, c in enumerate(made)])
    assert sorted(map(normal, ordered)) == sorted(map(normal, made))
    assert complex(*(ordered[-1].points[0] if kind == "closed" else ordered[-1].points[-1])) == end

    def ways(curve: Curve) -> list[Curve]:
        if kind == "closed":
            return [Curve(np.roll(curve.points, k, axis=0), curve.bulge) for k in range(4)]
        return [curve, curve.reversed()] if kind == "open" else [curve]

    def shortest(order: tuple[int, ...]) -> float:
        """Of the tours in this order, over all ways to begin (dynamic programming)."""
        best = [(0.0, np.zeros(2))]
        for i in order:
            best = [
                (
                    min(way + float(np.linalg.norm(c.points[0] - here)) for way, here in best),
                    c.points[0 if c.closed else -1],
                )
                for c in ways(made[i])
            ]
        return min(way for way, _ in best)

    least = min(shortest(order) for order in itertools.permutations(range(5)))
    if kind == "led":  # what may not be turned round may take a longer way
        return
    five, _ = order_cuts([CutGroup((c,), i, is_reversible=kind == "open") for i, c in enumerate(made[:5])])
    assert least * (1.0 - 1e-9) <= travel(five) <= 1.25 * least


def test_panels_stay_together_and_starts_are_free() -> None:
    random = np.random.default_rng(3)
    cuts = [
        CutGroup((square(p),), int(g)) for g, p in zip(random.integers(0, 9, 120), random.uniform(0.0, 0.4, (120, 2)))
    ]
    ordered, _ = order_cuts(cuts)
    groups = [next(c.group for c in cuts if normal(c.curves[0]) == normal(o)) for o in ordered]
    assert len(ordered) == 120 and len(list(itertools.groupby(groups))) == 9
    as_given = travel(tuple(c.curves[0] for c in sorted(cuts, key=lambda c: c.group)))
    assert travel(ordered) < 0.5 * as_given
    for curve in ordered:  # the same way round
        assert curve.area == pytest.approx(4e-6)


def test_pieces_of_an_outline_stay_in_their_order() -> None:
    corners = np.array([[0.1, 0.1], [0.2, 0.1], [0.2, 0.2], [0.1, 0.2]])
    parts = tuple(stroke(a, b) for a, b in itertools.pairwise(corners))
    ordered, end = order_cuts([CutGroup((square(np.array([0.3, 0.3])),), 0), CutGroup(parts, 1)])
    assert ordered[:3] == parts and end == complex(*ordered[-1].points[0])
    assert order_cuts([]) == ((), 0.0)


def test_a_closed_cut_begins_on_the_way_to_the_next() -> None:
    """The corner nearest to the origin is 40 mm off on the wrong side; another, 50 mm off, lies on the way."""
    large = Curve(np.array([[-0.04, 0.0], [0.05, 0.0], [0.05, 0.09], [-0.04, 0.09]]), np.zeros(4))
    small = square(np.array([0.2, 0.0005]))
    ordered, end = order_cuts([CutGroup((small,), 0), CutGroup((large,), 1)])
    np.testing.assert_array_equal([c.points[0] for c in ordered], [[0.05, 0.0], [0.199, -0.0005]])
    assert end == 0.199 - 0.0005j
    # where it comes last, only the way to it counts
    ordered, end = order_cuts([CutGroup((large,), 0)], 0.06 + 0.2j)
    np.testing.assert_array_equal(ordered[0].points[0], [0.05, 0.09])
    assert end == 0.05 + 0.09j


def test_strokes_are_turned_round_only_where_they_may_be() -> None:
    there, back = (
        stroke(np.array([0.01, 0.0]), np.array([0.1, 0.0])),
        stroke(np.array([0.2, 0.01]), np.array([0.1, 0.01])),
    )
    for may, ends in ((True, (0.2, 0.01)), (False, (0.1, 0.01))):
        ordered, end = order_cuts([CutGroup((c,), k, is_reversible=may) for k, c in enumerate((there, back))])
        assert end == pytest.approx(complex(*ends))
        np.testing.assert_array_equal(ordered[-1].points[-1], ends)
        np.testing.assert_array_equal(ordered[0].points, there.points)
