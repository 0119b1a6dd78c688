"""A point of a search in a problem with other weights, which keeps all that was computed for it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from .inverse import DesignPoint, InverseProblem

Point = TypeVar("Point", bound="DesignPoint")
# Cached attributes of a point that depend on the weights of the objective, or refer to the point itself
WEIGHT_DEPENDENT = frozenset(("terms", "costs", "value", "gradient", "barrier", "_narrow"))


def with_problem(point: Point, problem: InverseProblem) -> Point:
    """Return a point in another problem, with all cached values that are equal there.

    Parameters
    ----------
    point : of any problem
    problem : the point's problem with other weights, multipliers, or another required stability
    """
    found = replace(point, problem=problem)
    changed = WEIGHT_DEPENDENT if problem.firmness is point.problem.firmness else WEIGHT_DEPENDENT | {"_modes"}
    kept = point.__dict__.keys() - found.__dict__.keys() - changed
    found.__dict__.update({name: point.__dict__[name] for name in kept})
    return found
