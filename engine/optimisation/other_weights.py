"""A point of a search in a problem with other weights, which keeps all that was computed for it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

Point = TypeVar("Point")
# Cached attributes of a point that depend on the weights of the objective, or refer to the point itself
WEIGHT_DEPENDENT = frozenset(("terms", "costs", "value", "gradient", "barrier", "_narrow"))


def with_problem(point: Point, problem: Any) -> Point:
    """Return a point in another problem, with all cached values that are equal there.

    Parameters
    ----------
    point : a ``DesignPoint``
    problem : the point's problem with other weights, multipliers, or another required stability
    """
    given: Any = point
    found: Point = replace(given, problem=problem)
    changed = WEIGHT_DEPENDENT if problem.firmness is given.problem.firmness else WEIGHT_DEPENDENT | {"_modes"}
    kept = given.__dict__.keys() - found.__dict__.keys() - changed
    found.__dict__.update({name: given.__dict__[name] for name in kept})
    return found
