"""Flat patches: every patch of a layout mapped to the plane, with what that costs in distortion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .layout import PatchLayout


@dataclass(frozen=True, eq=False)
class FlatPatches:
    """The flat rest shape of every patch.

    layout : the mesh and its cuts
    points : (P, 2) metres, the flat vertices, indexed by ``layout.flat_corners``; every patch in a frame of its own,
        its area centroid at the origin, counter-clockwise seen from outside, its longest extent along x
    energy : (F,) E of every quad: mean over its 4 corner triangles, weighted by area, of (s1-1)^2 + (s2-1)^2, with s1, s2
        the singular values of the map from the surface to the plane
    square : (F,) the same measure against a perfect square of the same area: how regular a quad is
    """

    layout: PatchLayout
    points: np.ndarray
    energy: np.ndarray
    square: np.ndarray

    @property
    def corners(self) -> np.ndarray:
        """(F, 4, 2) metres: the flat corners of every quad in its patch's frame."""
        return self.points[self.layout.flat_corners]
