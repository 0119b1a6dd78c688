"""Test whether a piece is so near its target that its search may end."""

from __future__ import annotations

from ..materials import OVERSTRAIN_SHARE, STRAIN_MARGIN
from ..params import OptimiseParams
from .inverse import DesignPoint

# RMS distance from the target, in percent of its size, at which a search ends. Usual tolerances of sheets and cuts
# change it by as much. Larger: shorter searches, farther from the target (docs/tuning.md)
NEAR_PERCENT = 0.1
# Largest sum of the objective's terms for slots, strains and stability at the end of a search, as a share of the
# mismatch at ``NEAR_PERCENT``. Larger: ends with more strain or narrower slots
OTHER_TERMS = 0.1


def is_near(point: DesignPoint, params: OptimiseParams) -> bool:
    """Return whether a point is so near its target that a search with these settings ends there.

    A patience above 1 divides the required distance. Always False with a patience or a ``stop`` of 0, and with wishes.
    """
    target = point.problem.target
    if not params.stop or not params.patience or target.wishes is not None or is_overstrained(point):
        return False
    limit = 0.01 * NEAR_PERCENT / max(params.patience, 1.0) * target.size / target.unit_length
    return (
        point.relative_distance <= limit and sum(term.value for term in point.terms[1:]) <= OTHER_TERMS * 0.5 * limit**2
    )


def is_overstrained(point: DesignPoint) -> bool:
    """Return whether the largest strain exceeds the limit by so much that the user is warned."""
    strain_limit, strains = point.problem.strain_limit, point.strains
    if strain_limit is None or strains is None:
        return False
    return float(strains.values.max()) > STRAIN_MARGIN * OVERSTRAIN_SHARE * strain_limit.limit
