"""Wishes: target places of single spirals beside the target's shape, set by dragging ("bring this edge here")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..surface.mesh import QuadMesh

# Elastic energy, joules a spiral, below which a piece counts as unstrained: on 12 surfaces flat pieces of one panel had 1e-28, others 1e-3
MIN_ENERGY = 1e-12
UNSTRAINED_MESSAGE = (
    "Other spirals cannot bring the piece to where you dragged it: nothing bends it, so it rests as it is cut. "
    "Hold or pull it somewhere, or cut it into more panels."
)


@dataclass(frozen=True, eq=False)
class Wishes:
    """Wished places of some spirals; quads : spirals, each once, ascending; places : metres, wished centres of their hubs."""

    quads: Int[np.ndarray, " k"]
    places: Float[np.ndarray, "k 3"]

    @classmethod
    def from_offsets(cls, mesh: QuadMesh, offsets: Float[np.ndarray, "quads 3"]) -> Wishes | None:
        """Return wishes given as offsets; None if there are none.

        Parameters
        ----------
        mesh : the target
        offsets : from the quads' centroids, metres; 0 for no wish
        """
        quads = np.flatnonzero(offsets.any(axis=1))
        return cls(quads, mesh.centroids[quads] + offsets[quads]) if len(quads) else None

    def offsets(self, mesh: QuadMesh) -> Float[np.ndarray, "quads 3"]:
        """Return the wishes as offsets from the quads' centroids, metres; 0 without a wish."""
        found = np.zeros((len(mesh.quads), 3))
        found[self.quads] = self.places - mesh.centroids[self.quads]
        return found

    def unreachable(self, energy: float, count: int) -> str:
        """Return why other spirals cannot bring the piece nearer to the wishes, as a sentence; "" if they can.

        Parameters
        ----------
        energy : of the equilibrium, joules
        count : number of spirals
        """
        return UNSTRAINED_MESSAGE if energy < MIN_ENERGY * count else ""

    def check(self, count: int) -> None:
        """Raise FlexMapsError if a wish names a spiral beyond ``count``, or a place is not finite."""
        if len(self.quads) and not (self.quads.min() >= 0 and self.quads.max() < count):
            raise FlexMapsError(f"A wish names spiral {int(self.quads.max())}, but there are only {count}")
        if not np.isfinite(self.places).all():
            raise FlexMapsError("The places of wishes must be three finite numbers each")
