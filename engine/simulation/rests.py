"""What there is to say about the stability of a piece at rest: whether it is about to snap, and whether it may rest lower."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..arrays import Int
from ..mechanics.equilibrium import Equilibrium
from ..surface.checking.finding import Finding, counted
from ..surface.mesh import QuadMesh

Softest = Callable[[], tuple[np.ndarray, float]]  # the hubs' softest motion (n, 6), and its share of stiffness
SNAPPING = 0.02  # share of its stiffness that the softest motion has left, below which a piece is about to snap
MOVING = 0.5  # of the largest turn in that motion, from which on spirals are named; by eye
AS_NEAR = 1.25  # times the shown distance from the target, up to which another rest matches as well; by eye: .72 and .79 % look alike
RESTS = ("other-rest", "rest-as-near")  # codes of what is said of another rest: a fault, or information
LOWER = 1e-3  # share of the elastic energy by which another rest has to be lower to be named: rounding is far below


def rest_findings(
    found: Equilibrium,
    others: Sequence[Equilibrium],
    assembled: Equilibrium | None,
    softest: Softest,
    target: QuadMesh,
    size: float,
) -> list[Finding]:
    """Return the findings of a piece at rest.

    others : other shapes in which it can rest; assembled : the one of them that the target's pose leads to, if any
    size : metres, what percentages refer to
    """
    told: list[Finding] = []
    if not found.converged:
        return told
    moving, share = snapping(found, softest)
    if len(moving):
        text = (
            f"The piece is about to snap into another shape: {100.0 * share:.1f} % of its stiffness is left against the motion of "
            f"{counted(len(moving), 'spiral', 'spirals')}. Hold it there with supports, or press Optimise again."
        )
        told.append(Finding("about-to-snap", "warning", text, tuple(moving.tolist())))
    other = lower_rest(found, others) or assembled
    if other is not None:
        told.append(_other_rest(found, other, lower=_is_lower(other, found), target=target, size=size))
    return told


def _other_rest(found: Equilibrium, other: Equilibrium, *, lower: bool, target: QuadMesh, size: float) -> Finding:
    """Return what there is to say about another rest; one that is about as near to the target has a code of its own."""
    here, there = (
        float(np.sqrt(((one.pose.centres - target.centroids) ** 2).sum(axis=1).mean())) for one in (found, other)
    )
    where = f"another shape, {100.0 * there / size:.2g} % of its size from the target"
    if lower:
        text = f"The piece can also rest in {where}, with less energy than in the one that is shown. "
        cure = "Press Optimise again to improve it from there, or hold it with supports."
    else:
        text = f"Put together in the target's shape, the piece can come to rest in {where}, with more energy than in the one that is shown. "
        cure = "Push it over from there, or hold it with supports."
    far = np.linalg.norm(other.pose.centres - found.pose.centres, axis=1)
    moved = tuple(np.flatnonzero(far > MOVING * far.max()).tolist())
    if there <= AS_NEAR * here:
        return Finding("rest-as-near", "warning", text + "There it is about as near to the target.", moved)
    return Finding("other-rest", "warning", text + cure, moved)


def snapping(found: Equilibrium, softest: Softest) -> tuple[Int[np.ndarray, " some"], float]:
    """Return the spirals that move most where a piece is about to snap, and its softest motion's share of stiffness; none elsewhere."""
    none = np.zeros(0, dtype=int)
    if found.spare >= SNAPPING:
        return none, found.spare
    mode, share = softest()
    turned = np.linalg.norm(mode[:, 3:], axis=1)
    return (np.flatnonzero(turned > MOVING * turned.max()) if share < SNAPPING else none), share


def lower_rest(found: Equilibrium, others: Sequence[Equilibrium]) -> Equilibrium | None:
    """Return the known rest of least energy if that is lower than the simulated one."""
    best = min(others, key=lambda one: one.energy, default=None)
    return best if best is not None and _is_lower(best, found) else None


def _is_lower(other: Equilibrium, found: Equilibrium) -> bool:
    return bool(other.energy < found.energy - LOWER * found.per_joint.sum())
