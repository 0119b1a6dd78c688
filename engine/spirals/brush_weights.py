"""Weights of quads under a brush, from 0 to 1: how far a dab moves each spiral towards the brush's goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int


@dataclass(frozen=True, eq=False)
class PaintSurface:
    """The visible surface that a brush paints on.

    centres : (F, 3) quad centres, metres
    normals : (F, 3) unit normals of the quads
    side_distance : (F,) mean distance from a quad's centre to the middles of its sides, metres
    """

    centres: Float[np.ndarray, "quads 3"]
    normals: Float[np.ndarray, "quads 3"]
    side_distance: Float[np.ndarray, " quads"]

    @classmethod
    def from_mesh(cls, vertices: Float[np.ndarray, "vertices 3"], quads: Int[np.ndarray, "quads 4"]) -> PaintSurface:
        """Make the surface from the vertices and quads of a mesh.

        Parameters
        ----------
        vertices : metres
        quads : vertex indices
        """
        corners = vertices[quads]
        centres = corners.mean(axis=1)
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        sides = 0.5 * (corners + np.roll(corners, -1, axis=1)) - centres[:, None]
        return cls(centres, normals, np.linalg.norm(sides, axis=2).mean(axis=1))

    def dab_weights(self, place: np.ndarray, facing: np.ndarray, radius: float) -> Float[np.ndarray, " quads"]:
        """Return the weight of a dab on every quad, from 0 to 1.

        The weight falls off smoothly to 0 at the radius (3 s^2 - 2 s^3, Blender's *Smooth* falloff). The distance of a
        quad from the dab is reduced by the quad's ``side_distance``, so that a small brush paints the whole quad under
        it. Quads that face away from the dab, such as the far side of a thin wall, have weight 0.

        Parameters
        ----------
        place : (3,) centre of the dab, metres
        facing : (3,) unit normal of the surface at the centre of the dab
        radius : radius of the brush, metres
        """
        away = np.maximum(np.linalg.norm(self.centres - place, axis=1) - self.side_distance, 0.0)
        share = np.clip(1.0 - away / max(radius, 1e-12), 0.0, 1.0)
        return np.where(self.normals @ facing > 0.0, share**2 * (3.0 - 2.0 * share), 0.0)


def combine_weights(weights: list[Float[np.ndarray, " quads"]]) -> Float[np.ndarray, " quads"]:
    """Combine the weights of consecutive dabs into one weight per quad; exact if the dabs share their goal spirals."""
    left = np.ones_like(weights[0])
    for weight in weights:
        left *= 1.0 - weight
    return 1.0 - left
