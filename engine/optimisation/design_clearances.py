"""Clearances between the arms of designs, as functions of the design variables of a search."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Bool, Float
from ..mechanics.assembly import Assembly
from ..spirals.clearance.clearance_model import ClearanceModel
from . import clearance_restoration
from .clearance_restoration import ClearanceProblem, narrowest_per_pair
from .design_space import DesignSpace
from .polytope import LinearClearances
from .work import CLEARANCES_COST, Work

# Clearance (glossary) below which an open gap between arms is kept open while closed gaps are opened. Larger: slower
NEAR_GAP = 1e-3


@dataclass(frozen=True, eq=False)
class DesignClearances:
    """Clearances of the designs in ``space``.

    assembly : of any of these designs; work : counts the work for all of these designs
    clearance_model : computes the clearances; None does not check that designs can be cut
    """

    assembly: Assembly
    space: DesignSpace
    work: Work = field(default_factory=Work, kw_only=True)
    clearance_model: ClearanceModel | None = field(default=None, kw_only=True)

    @property
    def n_spiral_x(self) -> int:
        """Number of design variables of the spirals; those of the flat vertices follow if these may move."""
        return self.space.coordinates_per_spiral * self.assembly.size

    def linear_clearances(self, x: np.ndarray) -> LinearClearances:
        """Return the linearised clearances at design variables x."""
        if self.clearance_model is None:
            return LinearClearances.empty(len(x))
        terms = narrowest_per_pair(self.clearance_model.clearances(*self.space.width_and_twist(x), narrowest_only=True))
        return LinearClearances.from_clearances(terms.value, terms.by_design @ self.space.jacobian(x))

    def restore_clearances(self, x: np.ndarray, feasible: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Return the design variables of a design near x that can be cut; the design at ``feasible`` can be cut."""
        if self.clearance_model is None:
            return x
        self.work.add(CLEARANCES_COST, self.assembly.size)
        problem = ClearanceProblem(
            self._narrow_gaps,
            self._spirals_with_closed_gaps,
            self._repeat_per_coordinate,
            self.assembly.size,
            self.n_spiral_x,
        )
        return clearance_restoration.restore_clearances(x, feasible, problem)

    def _clearances_at(self, x: np.ndarray) -> ClearanceModel:
        """Return the clearance model of the flat shapes at design variables x: here the same for all x."""
        assert self.clearance_model is not None
        return self.clearance_model

    def _narrow_gaps(self, x: np.ndarray, quads: np.ndarray | None) -> LinearClearances:
        """Return the clearances below ``NEAR_GAP``, linearised in the spirals' design variables.

        quads : mask of the quads whose gaps count; None for all
        """
        terms = narrowest_per_pair(
            self._clearances_at(x).clearances(
                *self.space.width_and_twist(x), below=NEAR_GAP, quads=quads, narrowest_only=True
            )
        )
        return LinearClearances.from_clearances(
            terms.value, terms.by_design @ self.space.jacobian(x[: self.n_spiral_x])
        )

    def _spirals_with_closed_gaps(self, x: np.ndarray, quads: np.ndarray | None) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the free spirals with an arm in a closed gap; quads : as in ``_narrow_gaps``."""
        return (
            self._clearances_at(x).quads_with_closed_gaps(*self.space.width_and_twist(x), quads)
            & self.space.free_spirals
        )

    def _repeat_per_coordinate(self, share: Float[np.ndarray, " quads"]) -> Float[np.ndarray, " coordinates"]:
        """Repeat every spiral's value for each of its design variables."""
        return np.repeat(share, self.space.coordinates_per_spiral)
