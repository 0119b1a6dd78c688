"""Places where somebody wants single spirals to come to, beside the target's shape: "bring this edge here"."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..surface.mesh import QuadMesh


@dataclass(frozen=True, eq=False)
class Wishes:
    """quads : spirals, each once, ascending; places : metres, where their hubs shall come to"""

    quads: Int[np.ndarray, " k"]
    places: Float[np.ndarray, "k 3"]

    @classmethod
    def of(cls, mesh: QuadMesh, offsets: Float[np.ndarray, "quads 3"]) -> Wishes | None:
        """From metres beside the middles of a mesh's quads, where 0 is no wish; None without any."""
        quads = np.flatnonzero(offsets.any(axis=1))
        return cls(quads, mesh.centroids[quads] + offsets[quads]) if len(quads) else None

    def offsets(self, mesh: QuadMesh) -> Float[np.ndarray, "quads 3"]:
        """The way back."""
        found = np.zeros((len(mesh.quads), 3))
        found[self.quads] = self.places - mesh.centroids[self.quads]
        return found

    def check(self, count: int) -> None:
        """Raise FlexMapsError where there are no such spirals or places."""
        if len(self.quads) and not (self.quads.min() >= 0 and self.quads.max() < count):
            raise FlexMapsError(f"A wish names spiral {int(self.quads.max())}, but there are only {count}")
        if not np.isfinite(self.places).all():
            raise FlexMapsError("The places of wishes must be three finite numbers each")
