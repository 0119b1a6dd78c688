"""The check of shapes in annotations (``tests/shapes.py``) itself: it lets right arrays through and names wrong ones."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from jaxtyping import Float, Int

shapes: Any = sys.modules["flexmaps_shapes"]


def areas(points: Float[np.ndarray, "points 2"], triangles: Int[np.ndarray, "faces 3"]) -> Float[np.ndarray, " faces"]:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def halves(values: Float[np.ndarray, " n"] | None) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    return (np.zeros(0), np.zeros(0)) if values is None else (0.5 * values, values[1:])


@dataclass(frozen=True)
class Cloud:
    points: Float[np.ndarray, "points 3"]
    weights: Float[np.ndarray, " points"]


POINTS, TRIANGLES = np.zeros((4, 2)), np.array([[0, 1, 2]])


def test_right_shapes_pass() -> None:
    checked = shapes._checked(areas, globals())
    assert checked is not areas
    assert checked(POINTS, TRIANGLES).shape == (1,)
    assert checked(triangles=TRIANGLES.astype(np.int32), points=POINTS.astype(np.float32)).shape == (1,)


@pytest.mark.parametrize(
    ("points", "triangles"),
    [
        (np.zeros((4, 3)), TRIANGLES),
        (POINTS.astype(int), TRIANGLES),
        (POINTS, TRIANGLES[0]),
        (POINTS.tolist(), TRIANGLES),
    ],
    ids=["columns", "kind", "axes", "no array"],
)
def test_wrong_arguments_are_named(points: Any, triangles: Any) -> None:
    with pytest.raises(TypeError, match=r"areas: (points|triangles) should be"):
        shapes._checked(areas, globals())(points, triangles)


def test_sizes_agree_within_a_call() -> None:
    checked = shapes._checked(halves, globals())
    assert len(checked(None)) == 2
    with pytest.raises(TypeError, match="what it returns"):  # of n - 1 values
        checked(np.ones(3))


def test_what_fitted_once_lets_nothing_else_through() -> None:
    """What is known to fit is not looked at again; other arguments and other results of the same arguments are."""
    found = [np.zeros(4), np.zeros(4), np.zeros(3)]

    def next_of(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return found.pop(0)

    checked = shapes._checked(next_of, globals())
    for _ in range(2):
        assert len(checked(np.ones(4))) == 4
    with pytest.raises(TypeError, match="what it returns"):
        checked(np.ones(4))
    with pytest.raises(TypeError, match="next_of: values should be"):
        checked(np.ones(4, dtype=int))


def test_members_of_dataclasses() -> None:
    class Own(Cloud):
        pass

    shapes._watch_class(Cloud, globals())
    Own(np.zeros((2, 3)), np.zeros(2))
    with pytest.raises(TypeError, match=r"Cloud\.weights should be"):
        Cloud(np.zeros((2, 3)), np.zeros(3))


def test_the_engine_is_checked() -> None:
    from flexmaps.engine.surface.mesh import QuadMesh

    with pytest.raises(TypeError):
        QuadMesh(np.zeros((4, 2)), np.arange(4)[None])
