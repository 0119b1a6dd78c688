"""Places where somebody wants single spirals to come to, beside the target's shape: "bring this edge here"."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..surface.mesh import QuadMesh

# joules a spiral below which nothing strains a piece: pieces of one panel that lie flat had 1e-28, all others 1e-3, on 12 surfaces
SLACK = 1e-12
UNSTRAINED = (
    "Spirals alone cannot bring it where it is wished: nothing bends the piece, so that it rests as it is cut, whatever its spirals are. "
    "Hold or pull it somewhere, or cut it into more panels."
)


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

    def unreachable(self, energy: float, count: int) -> str:
        """Why spirals cannot bring a piece of so many, with this elastic energy (joules) at rest, nearer, as a sentence; "" where they can."""
        return UNSTRAINED if energy < SLACK * count else ""

    def check(self, count: int) -> None:
        """Raise FlexMapsError where there are no such spirals or places."""
        if len(self.quads) and not (self.quads.min() >= 0 and self.quads.max() < count):
            raise FlexMapsError(f"A wish names spiral {int(self.quads.max())}, but there are only {count}")
        if not np.isfinite(self.places).all():
            raise FlexMapsError("The places of wishes must be three finite numbers each")
