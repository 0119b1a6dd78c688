"""All that the shape of a piece depends on, as plain arrays and settings that travel between processes."""

from __future__ import annotations

import hashlib
import pickle
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..arrays import Bool, Float, Int
from ..materials import Material
from ..params import LayoutParams, SimulateParams, SpiralParams


@dataclass(frozen=True, eq=False)
class Given:
    """What a live piece is made of.

    vertices : metres; corners, sizes : as in ``PolygonMesh``
    seams : where the surface is to be cut, in the engine's order of edges
    cut : where it was cut when its flat patches were made; flat : metres, the corners of these patches, each in its patch's frame
    energy : distortion of every quad as it was then, which tells where the surface was moved since
    width, twist : metres and radians, of the spirals
    supports : quads that are held where they lie in the target; force : newtons on the quads; None without
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

    def changes(self, since: Given | None) -> dict[str, Any]:
        """The members that differ from those of an earlier one, by name; all of them where there is none."""
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        return own if since is None else {k: v for k, v in own.items() if not same(v, getattr(since, k))}

    @property
    def mark(self) -> bytes:
        """Tells it from any other."""
        found = hashlib.blake2b(digest_size=16)
        for one in fields(self):
            value = getattr(self, one.name)
            found.update(value.tobytes() if isinstance(value, np.ndarray) else pickle.dumps(value))
            found.update(one.name.encode())
        return found.digest()


def same(one: Any, two: Any) -> bool:
    """Whether two members are alike."""
    if isinstance(one, np.ndarray) and isinstance(two, np.ndarray):
        return one.shape == two.shape and bool((one == two).all())
    if isinstance(one, np.ndarray) or isinstance(two, np.ndarray):
        return False
    return bool(one == two)
