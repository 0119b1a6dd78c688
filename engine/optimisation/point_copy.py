"""Copy a design point for other weights of the objective, with all cached values that the weights do not affect."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

Point = TypeVar("Point")
# Cached attributes of a point that depend on the weights of the objective, or refer to the point itself
WEIGHT_DEPENDENT = frozenset(("terms", "costs", "value", "gradient", "stability_barrier", "goals", "_slot_penalty"))

# Cached attributes that depend only on the point's model, equilibrium and required stability, and on the material
STATE_DEPENDENT = ("_state", "_joint_derivatives", "strains", "_soft_modes")


def with_problem(point: Point, problem: Any, **changes: Any) -> Point:
    """Return a point in another problem, with all cached values that stay valid there.

    Parameters
    ----------
    point : a ``DesignPoint``
    problem : the point's problem with other weights, multipliers, or another required stability
    changes : other fields of the point that change with the weights
    """
    source: Any = point
    copy: Point = replace(source, problem=problem, **changes)
    now, before = problem.stability, source.problem.stability
    equal = now is before or (now is not None and before is not None and now.same_modes(before))
    changed = WEIGHT_DEPENDENT if equal else WEIGHT_DEPENDENT | {"_soft_modes"}
    kept = source.__dict__.keys() - copy.__dict__.keys() - changed
    copy.__dict__.update({name: source.__dict__[name] for name in kept})
    return copy


def copy_state(source: Any, point: Any) -> None:
    """Copy cached values to a new point from a point with the same model, equilibrium and required stability.

    Parameters
    ----------
    source : a ``DesignPoint``, with cached values
    point : the new ``DesignPoint``, which gets them
    """
    point.__dict__.update({name: source.__dict__[name] for name in STATE_DEPENDENT if name in source.__dict__})


def with_position_share(point: Point, position_share: float) -> Point:
    """Return a point whose mismatch weighs curvature against position by ``position_share``.

    Parameters
    ----------
    point : a ``DesignPoint``
    position_share : see ``objective.Target``
    """
    source: Any = point
    if source.problem.target.position_share == position_share:
        return point
    problem = replace(source.problem, target=replace(source.problem.target, position_share=position_share))
    return with_problem(point, problem, mismatch=problem.target.compare(source.equilibrium.pose.centres))
