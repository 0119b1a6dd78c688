"""Panels whose vertices follow a design while the user paints it.

Moving vertices is fast; rebuilding the mesh would block the window.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Bool, Float, Int
from ..spirals.caps import stump_starts
from ..spirals.clearance.slots import min_slot_width
from ..spirals.contours import arm_starts
from ..spirals.design import SpiralDesign
from ..spirals.solid_hubs import slot_roots
from . import arrange
from .solids import ArmVertices, PolygonSolid, arm_edges, make_light_solids, rim_vertices


class MovingPanels:
    """Panels of a design without connectors, side by side.

    design : design that the panels show
    centres : (N, 2) positions of the patches' origins, metres
    solid : mesh of the panels, fine enough for any twist that the settings allow, so that its faces rarely change
    """

    design: SpiralDesign
    solid: PolygonSolid

    def __init__(self, design: SpiralDesign):
        self.centres: Float[np.ndarray, "patches 2"] = arrange.arrange_patches(design.flat)
        self._build_mesh(design)

    def _build_mesh(self, design: SpiralDesign) -> None:
        """Build the mesh for a design."""
        self.design = design
        self.solid = make_light_solids(
            design, self.centres, max_twist=max(design.params.twist_max, float(design.twist.max()))
        )

    def follow(self, design: SpiralDesign) -> None:
        """Show another design with the same flat patches and settings; only spirals that changed are redrawn."""
        touched = design.changed_arms(self.design)
        if not touched.any():
            return
        where = self.solid.arm_vertices
        # a foot stays where it is, but its connection with the arm may need another number of points
        if where is None or touched[[foot.arm // 4 for foot in design.feet]].any():
            self._build_mesh(design)
            return
        quads = np.flatnonzero(touched)
        arms = design.arms.subset(quads)
        fillet, absent = design.params.fillet, design.is_absent[quads]
        root = slot_roots(arms, fillet, design.has_solid_hub[quads])
        begin = np.where(
            absent,
            stump_starts(root),
            arm_starts(design.flat.layout, design.arms, min_slot_width(design.params))[quads],
        )
        points = arm_edges(arms, root, begin, where.edges.shape[-1])
        points += self.centres[design.flat.layout.patch_of[quads]][:, None, None, None]
        vertices, strip = self.solid.vertices.copy(), self.solid.rim_mesh
        _move_caps(vertices, where, 4 * quads[:, None] + np.arange(4), points[..., 0, :], absent)
        for side in where.edges:
            own = side[quads]
            vertices[own[own >= 0], :2] = points[own >= 0]
        if strip is not None and touched[strip.rim.quad].any():
            strip = strip.with_necks_of(design)
            moved = rim_vertices(strip, design, self.centres, self.solid.is_one_sided)
            vertices[len(vertices) - len(moved) :] = moved
        self.design, self.solid = design, replace(self.solid, vertices=vertices, rim_mesh=strip)


def _move_caps(
    vertices: Float[np.ndarray, "vertices 3"],
    where: ArmVertices,
    arm: Int[np.ndarray, "some 4"],
    chords: Float[np.ndarray, "some 4 2 2"],
    absent: Bool[np.ndarray, "some 4"],
) -> None:
    """Rotate and scale the half circles at the ends of left-out arms to their new chords, in place.

    vertices : vertices of the panels, metres; the edges of the arms are still at their old positions
    where : indices of the arms' vertices
    arm : numbers 4 quad + side of the arms that changed
    chords : new end points of the left and right edges of these arms, metres
    absent : mask of these arms that are left out, of which only a stump with a half circle exists
    """
    new = np.full((4 * where.edges.shape[1], 2), np.nan, dtype=complex)
    new[arm[absent]] = chords[absent] @ np.array([1.0, 1j])
    some = ~np.isnan(new[where.arm, 0])
    to = new[where.arm[some]]
    for side, points in zip(where.edges, where.end_vertices, strict=True):
        old = vertices[side[..., 0].reshape(-1, 2)[where.arm[some]], :2] @ np.array([1.0, 1j])
        at = points[some]
        share = (vertices[at, :2] @ np.array([1.0, 1j]) - old[:, 0]) / (old[:, 1] - old[:, 0])
        moved = to[:, 0] + share * (to[:, 1] - to[:, 0])
        vertices[at, :2] = np.column_stack([moved.real, moved.imag])
