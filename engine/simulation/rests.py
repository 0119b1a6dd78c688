"""Messages about the stability of a simulated piece: it may be about to snap, or have another stable shape."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..arrays import Int
from ..figures import format_figure
from ..materials import OVERSTRAIN_SHARE
from ..mechanics.equilibrium import Equilibrium
from ..surface.checking.finding import Finding, with_count
from ..surface.mesh import QuadMesh

# A function without arguments. It returns the softest motion of the hubs (n, 6), and the stiffness of this motion: the
# second derivative of the energy along it, as a share of the same derivative by the convex part of the Hessian alone
Softest = Callable[[], tuple[np.ndarray, float]]
# A function of an equilibrium. It returns every spiral's largest strain (F,) as a share of the strain limit, or None
# for the rod model
Strain = Callable[[Equilibrium], np.ndarray | None]
# A piece is about to snap if the stiffness of its softest motion, as a share (see ``Softest``), is below this; larger
# values warn earlier
SNAP_STIFFNESS = 0.02
# A message names the spirals that move by at least this share of the largest motion; larger values name fewer spirals;
# by eye
MIN_MOTION_SHARE = 0.5
# Another stable shape is reported as about as near to the target as the simulated shape if its RMS distance is at most
# this multiple of the simulated shape's. Larger: more shapes are reported as such; by eye
MAX_DISTANCE_RATIO = 1.25
# codes of the messages about another stable shape: if it is farther from the target or its arms may break; if it is as
# near to the target
OTHER_REST_CODES = ("other-rest", "rest-as-near")
# Another stable shape is said to have less energy if the difference is at least this share of the elastic energy;
# rounding errors are far smaller
MIN_ENERGY_DROP = 1e-3


def rest_findings(
    equilibrium: Equilibrium,
    others: Sequence[Equilibrium],
    rest_from_target: Equilibrium | None,
    softest: Softest,
    strain: Strain,
    target: QuadMesh,
    size: float,
) -> list[Finding]:
    """Return the messages about stability; none if the equilibrium did not converge.

    Parameters
    ----------
    equilibrium : the simulated equilibrium
    others : other equilibria of the piece
    rest_from_target : member of ``others`` that a search from the target's pose reaches, or None
    softest : returns the softest motion of the simulated equilibrium
    strain : returns the strains of an equilibrium
    target : mesh that the piece should match
    size : length of which percentages in messages are shares, metres
    """
    findings: list[Finding] = []
    if not equilibrium.converged:
        return findings
    moving, share = snapping_spirals(equilibrium, softest)
    if len(moving):
        text = (
            f"The piece is about to snap into another shape: {100.0 * share:.1f} % of its stiffness is left against the motion of "
            f"{with_count(len(moving), 'spiral', 'spirals')}. Hold it there with supports, or press Optimise again."
        )
        findings.append(Finding("about-to-snap", "warning", text, tuple(moving.tolist())))
    other = reported_rest(equilibrium, others, rest_from_target)
    if other is not None:
        strains = [0.0 if found is None else float(found.max()) for found in map(strain, (equilibrium, other))]
        lower = _is_lower(other, equilibrium)
        findings.append(_other_rest(equilibrium, other, *strains, lower=lower, target=target, size=size))
    return findings


def reported_rest(
    equilibrium: Equilibrium, others: Sequence[Equilibrium], rest_from_target: Equilibrium | None
) -> Equilibrium | None:
    """Return the equilibrium that the message about another stable shape describes, or None.

    It is the one of least energy among ``others`` if this is less than the energy of the simulated equilibrium, else
    ``rest_from_target``.

    Parameters
    ----------
    equilibrium : the simulated equilibrium
    others : other equilibria of the piece
    rest_from_target : member of ``others`` that a search from the target's pose reaches, or None
    """
    return lower_rest(equilibrium, others) or rest_from_target


def _other_rest(
    equilibrium: Equilibrium,
    other: Equilibrium,
    strain: float,
    other_strain: float,
    *,
    lower: bool,
    target: QuadMesh,
    size: float,
) -> Finding:
    """Return the message about another stable shape, with one of the ``OTHER_REST_CODES``.

    Parameters
    ----------
    equilibrium, other : the simulated and the other stable shape
    strain, other_strain : largest strain in the simulated and in the other shape, as a share of the limit
    lower : the other shape has less energy
    target : mesh that the piece should match
    size : length of which percentages in the message are shares, metres
    """
    here, there = (
        float(np.sqrt(((one.pose.centres - target.centroids) ** 2).sum(axis=1).mean())) for one in (equilibrium, other)
    )
    where = f"another shape, {format_figure(100.0 * there / size)} % of its size from the target"
    if lower:
        text = f"The piece can also rest in {where}, with less energy than in the shape shown. "
        cure = "Press Optimise again to improve it from there, or hold it with supports."
    else:
        text = f"Put together in the target's shape, the piece can come to rest in {where}, with more energy than in the shape shown. "
        cure = "Push it over from there, or hold it with supports."
    far = np.linalg.norm(other.pose.centres - equilibrium.pose.centres, axis=1)
    moved = tuple(np.flatnonzero(far > MIN_MOTION_SHARE * far.max()).tolist())
    if other_strain > max(OVERSTRAIN_SHARE, strain):
        text += (
            f"There its arms would be strained to {100.0 * other_strain:.0f} % of their limit "
            f"({100.0 * OVERSTRAIN_SHARE:.0f} % is allowed). "
        )
    elif there <= MAX_DISTANCE_RATIO * here:
        return Finding("rest-as-near", "warning", text + "That shape is about as near to the target.", moved)
    return Finding("other-rest", "warning", text + cure, moved)


def snapping_spirals(equilibrium: Equilibrium, softest: Softest) -> tuple[Int[np.ndarray, " some"], float]:
    """Return the spirals that would move most if the piece snapped; none if it is not about to snap.

    Parameters
    ----------
    equilibrium : the simulated equilibrium
    softest : returns the softest motion; called only if ``equilibrium.spare`` is below ``SNAP_STIFFNESS``

    Returns
    -------
    (k,) : indices of the spirals
    float : stiffness of the softest motion, as a share (see ``Softest``); if no spirals are returned, a lower bound
    """
    none = np.zeros(0, dtype=int)
    if equilibrium.spare >= SNAP_STIFFNESS:
        return none, equilibrium.spare
    mode, share = softest()
    turned = np.linalg.norm(mode[:, 3:], axis=1)
    return (np.flatnonzero(turned > MIN_MOTION_SHARE * turned.max()) if share < SNAP_STIFFNESS else none), share


def lower_rest(equilibrium: Equilibrium, others: Sequence[Equilibrium]) -> Equilibrium | None:
    """Return the equilibrium of least energy among ``others`` if its energy is less than ``equilibrium.energy``."""
    best = min(others, key=lambda one: one.energy, default=None)
    return best if best is not None and _is_lower(best, equilibrium) else None


def _is_lower(other: Equilibrium, equilibrium: Equilibrium) -> bool:
    """Return whether the energy of ``other`` is less than that of ``equilibrium`` by more than ``MIN_ENERGY_DROP``."""
    return bool(other.energy < equilibrium.energy - MIN_ENERGY_DROP * equilibrium.per_joint.sum())
