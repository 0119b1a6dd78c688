"""Input of a live piece: all data on which its shape depends, as arrays and settings that processes can exchange."""

from __future__ import annotations

import hashlib
import pickle
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...arrays import Bool, Float, Int
from ...materials import Material
from ...params import LayoutParams, SimulateParams, SpiralParams


@dataclass(frozen=True, eq=False)
class LiveInput:
    """Input of a live piece.

    vertices, corners, sizes : the target mesh as in ``PolygonMesh``, metres
    seams : whether each edge should be cut, in the order of the edges in ``QuadMesh``
    cut : whether each edge was cut when the stored flat patches were made
    flat : corners of the stored flat quads, in the frame of their patch, metres
    energy : distortion of every quad when they were made; where it differs now, vertices have moved since
    width, twist : widths of the arms, metres, and twists of the spirals, radians
    spiral, layout, material, simulate : settings and material
    supports : indices of quads that are held at their places in the target, or None
    force : forces on the quads, newtons, or None
    """

    vertices: Float[np.ndarray, "vertices 3"]
    corners: Int[np.ndarray, " corners"]
    sizes: Int[np.ndarray, " quads"]
    seams: Bool[np.ndarray, " edges"]
    cut: Bool[np.ndarray, " edges"]
    flat: Float[np.ndarray, "quads 4 2"]
    energy: Float[np.ndarray, " quads"]
    width: Float[np.ndarray, "quads 4"]
    twist: Float[np.ndarray, " quads"]
    spiral: SpiralParams
    layout: LayoutParams
    material: Material
    simulate: SimulateParams
    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None

    def changes(self, since: LiveInput | None) -> dict[str, Any]:
        """Return the fields that differ from an earlier input, by name; all fields if ``since`` is None."""
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        return own if since is None else {k: v for k, v in own.items() if not equal_inputs(v, getattr(since, k))}

    @property
    def mark(self) -> bytes:
        """Hash of all fields, which identifies the input."""
        digest = hashlib.blake2b(digest_size=16)
        for one in fields(self):
            value = getattr(self, one.name)
            digest.update(value.tobytes() if isinstance(value, np.ndarray) else pickle.dumps(value))
            digest.update(one.name.encode())
        return digest.digest()


def equal_inputs(one: Any, two: Any) -> bool:
    """Return whether two values are equal; arrays are compared by shape and elements."""
    if isinstance(one, np.ndarray) and isinstance(two, np.ndarray):
        return one.shape == two.shape and bool((one == two).all())
    if isinstance(one, np.ndarray) or isinstance(two, np.ndarray):
        return False
    return bool(one == two)
