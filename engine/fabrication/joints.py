"""Stress in the narrowest place of every joint.

In equilibrium every joint carries a force and a moment. Its narrowest place is the neck of its connector, a bar of the
neck's width n and the sheet's thickness t. Under a force F and moments M_in and M_out that bend it in and out of the
sheet's plane, its stress is at most F / (n t) + 6 M_in / (t n^2) + 6 M_out / (n t^2) by beam theory: tension and
bending about both axes are added as in EN 1995-1-1, 6.2.3, with k_m = 1. Torsion is treated as bending out of the
plane, which slightly overestimates its stress in a flat bar. A neck beside the middle of its joint also bears the
moment of the force about its own centre, which is added without regard to its sign. The limit is the material's
strength, Young's modulus times the strain limit. Not covered are failure of glue, and heads or keys that slip out of
their sockets perpendicular to the sheet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float
from ..spirals.design import SpiralDesign
from .connectors.connect import Connections


@dataclass(frozen=True, eq=False)
class Necks:
    """The narrowest place of every joint: its connector's neck, or else the arm.

    width : metres
    shift : distance from the joint to the neck's centre along the arms, metres
    offset : distance from the arms' centre line to the neck's centre line, metres
    """

    width: Float[np.ndarray, " joints"]
    shift: Float[np.ndarray, " joints"]
    offset: Float[np.ndarray, " joints"]

    def subset(self, mask: Bool[np.ndarray, " joints"]) -> Necks:
        """Return the necks of the joints in a mask."""
        return Necks(self.width[mask], self.shift[mask], self.offset[mask])

    def stresses(self, wrench: Float[np.ndarray, "joints 6"], thickness: float) -> Float[np.ndarray, " joints"]:
        """Return an upper bound of the stress in every neck, Pa.

        Parameters
        ----------
        wrench : (m, 6), force in N and moment in N m along the joint's axes: across the edge, along the edge, normal
        thickness : thickness of the sheet, metres
        """
        width, pull = self.width, np.abs(wrench[:, :3])
        inside = np.abs(wrench[:, 5]) + pull[:, 0] * self.offset + pull[:, 1] * self.shift
        outside = np.linalg.norm(wrench[:, 3:5], axis=1) + pull[:, 2] * np.hypot(self.shift, self.offset)
        tension = np.linalg.norm(wrench[:, :3], axis=1) / (width * thickness)
        return tension + 6.0 * inside / (thickness * width**2) + 6.0 * outside / (width * thickness**2)


def list_necks(design: SpiralDesign, connections: Connections | None) -> Necks:
    """Return the necks of all E edges of a design's mesh.

    Parameters
    ----------
    design : spirals
    connections : connectors; None without connectors
    """
    mesh = design.flat.layout.mesh
    width = design.arms.joint_width[mesh.edge_quads[:, 0], mesh.edge_sides[:, 0]]
    shift, offset = np.zeros((2, len(width)))
    for connector in () if connections is None else connections.connectors:
        if connector.kind != "tab":
            edge, made = mesh.quad_edges[connector.faces[0], connector.sides[0]], connector.candidate
            # each side of the neck lies inwards of its nominal place by half of the clearance
            width[edge] = made.size.neck - made.size.clearance
            shift[edge], offset[edge] = abs(made.shift), abs(made.lateral_offset)
    return Necks(width, shift, offset)
