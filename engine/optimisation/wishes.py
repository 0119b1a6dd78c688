"""Drag targets ("wishes"): positions that the user wants for single spirals, in addition to the target's shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..surface.mesh import QuadMesh

# Elastic energy, joules per spiral, below which a piece counts as unstrained. Flat pieces have 1e-28, bent ones 1e-3
# (docs/tuning.md)
MIN_ENERGY = 1e-12
UNSTRAINED_MESSAGE = (
    "Other spirals cannot bring the piece to where you dragged it: nothing bends it, so it rests as it is cut. "
    "Hold or pull it somewhere, or cut it into more panels."
)


@dataclass(frozen=True, eq=False)
class Wishes:
    """Target positions that the user sets for some spirals.

    quads : numbers of these spirals, ascending, without repetition; places : metres, wanted centres of their hubs
    """

    quads: Int[np.ndarray, " k"]
    places: Float[np.ndarray, "k 3"]

    @classmethod
    def from_offsets(cls, mesh: QuadMesh, offsets: Float[np.ndarray, "quads 3"]) -> Wishes | None:
        """Convert offsets of quads to wishes; return None if all offsets are 0.

        Parameters
        ----------
        mesh : the target
        offsets : metres, from every quad's centroid to the wanted position; 0 for a quad without a wish
        """
        quads = np.flatnonzero(offsets.any(axis=1))
        return cls(quads, mesh.centroids[quads] + offsets[quads]) if len(quads) else None

    def offsets(self, mesh: QuadMesh) -> Float[np.ndarray, "quads 3"]:
        """Return the offsets from all quads' centroids to the wanted positions, metres; 0 for a quad without a wish."""
        found = np.zeros((len(mesh.quads), 3))
        found[self.quads] = self.places - mesh.centroids[self.quads]
        return found

    def unreachable(self, energy: float, count: int) -> str:
        """Return a sentence on why no change of the spirals can bring the piece nearer to the wishes; "" if one can.

        Parameters
        ----------
        energy : elastic energy of the whole piece at equilibrium, joules
        count : number of spirals
        """
        return UNSTRAINED_MESSAGE if energy < MIN_ENERGY * count else ""

    def check(self, count: int) -> None:
        """Raise FlexMapsError if a wish names a spiral beyond ``count``, or a place is not finite."""
        if len(self.quads) and not (self.quads.min() >= 0 and self.quads.max() < count):
            raise FlexMapsError(f"A wish names spiral {int(self.quads.max())}, but there are only {count}")
        if not np.isfinite(self.places).all():
            raise FlexMapsError("The places of wishes must be three finite numbers each")
