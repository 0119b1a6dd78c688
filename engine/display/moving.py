"""Plain panels whose points follow a design that is being painted: making their mesh anew holds up a window, moving points does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Bool, Float
from ..spirals.contours import ends, hubs
from ..spirals.design import SpiralDesign
from ..spirals.slots import slot_needed
from ..spirals.spiral import opposite_sides
from . import arrange
from .solids import Solid, arm_edges, light


class MovingPanels:
    """The panels of a design without connectors, beside each other.

    design : what they show; centres : (N, 2) metres, where the patches' origins lie
    solid : for any twist that the settings allow, so that its faces stay those that they are
    """

    design: SpiralDesign
    solid: Solid

    def __init__(self, design: SpiralDesign):
        self.centres: Float[np.ndarray, "patches 2"] = arrange.side_by_side(design.flat)
        self._make(design)

    def _make(self, design: SpiralDesign) -> None:
        self.design = design
        self.solid = light(design, self.centres, wound=max(design.params.twist_max, float(design.twist.max())))

    def follow(self, design: SpiralDesign) -> None:
        """Show another design in the same flat patches with the same settings: of its spirals, only those that are others are drawn anew."""
        changed = design.unlike(self.design)
        if not changed.any():
            return
        places, mesh = self.solid.places, design.flat.layout.mesh
        # arms blend into those that they are joined with
        touched = changed | changed[opposite_sides(mesh)[0]].any(axis=1)
        if places is None or (_ended_otherwise(design) & touched).any():
            self._make(design)
            return
        quads = np.flatnonzero(touched)
        own = design.arms.of(quads)
        begin = ends(design.flat.layout, design.arms, slot_needed(design.params))[quads]
        points = arm_edges(own, hubs(own, design.params.fillet), begin, places.shape[-1])
        points += self.centres[design.flat.layout.patch_of[quads]][:, None, None, None]
        vertices = self.solid.vertices.copy()
        for side in places:
            where = side[quads]
            vertices[where[where >= 0], :2] = points[where >= 0]
        self.design, self.solid = design, replace(self.solid, vertices=vertices)


def _ended_otherwise(design: SpiralDesign) -> Bool[np.ndarray, " quads"]:
    """Quads with arms that end in a cap or at a rim, which are bodies of their own."""
    border = design.flat.layout.mesh.border[design.flat.layout.mesh.quad_edges]
    return (design.absent | (border & (design.params.border == "rim"))).any(axis=1)
