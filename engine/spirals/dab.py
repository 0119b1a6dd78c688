"""Where a brush touches a surface: a weight for every quad round a place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int


@dataclass(frozen=True, eq=False)
class Ground:
    """A surface as it is seen, to be painted on; metres.

    centres, normals : (F, 3) of the quads, normals of length 1; reach : (F,) from a quad's middle to its sides, in the mean
    """

    centres: Float[np.ndarray, "quads 3"]
    normals: Float[np.ndarray, "quads 3"]
    reach: Float[np.ndarray, " quads"]

    @classmethod
    def of(cls, vertices: Float[np.ndarray, "vertices 3"], quads: Int[np.ndarray, "quads 4"]) -> Ground:
        corners = vertices[quads]
        centres = corners.mean(axis=1)
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        sides = 0.5 * (corners + np.roll(corners, -1, axis=1)) - centres[:, None]
        return cls(centres, normals, np.linalg.norm(sides, axis=2).mean(axis=1))

    def weight(self, place: np.ndarray, facing: np.ndarray, radius: float) -> Float[np.ndarray, " quads"]:
        """(F,) from 0 to 1 of a dab at a place (3,) of a surface that faces (3,) there; radius in metres.

        Falls off smoothly to 0 at the radius (3 s^2 - 2 s^3, Blender's own *Smooth*), from a quad's sides on, so that the quad
        under a small brush is painted wholly. What faces the other way, such as the far side of a thin wall, is not.
        """
        away = np.maximum(np.linalg.norm(self.centres - place, axis=1) - self.reach, 0.0)
        share = np.clip(1.0 - away / max(radius, 1e-12), 0.0, 1.0)
        return np.where(self.normals @ facing > 0.0, share**2 * (3.0 - 2.0 * share), 0.0)


def together(weights: list[Float[np.ndarray, " quads"]]) -> Float[np.ndarray, " quads"]:
    """The weight of dabs one after the other, as long as what they lead to is the same."""
    left = np.ones_like(weights[0])
    for weight in weights:
        left *= 1.0 - weight
    return 1.0 - left
