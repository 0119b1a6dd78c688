"""Stress in the narrowest place of every joint.

In equilibrium every joint carries a force and a moment. Its narrowest place is the neck of its connector, a bar of the
neck's width n and the sheet's thickness t. Under a force F and moments M_in and M_out that bend it in and out of the
sheet's plane, its stress is at most F / (n t) + 6 M_in / (t n^2) + 6 M_out / (n t^2) by beam theory: tension and
bending about both axes are added as in EN 1995-1-1, 6.2.3, with k_m = 1. Torsion is treated as bending out of the
plane, which slightly overestimates its stress in a flat bar. The limit is the material's strength, Young's modulus
times the strain limit. Not covered are failure of glue, and heads or keys that slip out of their sockets perpendicular
to the sheet.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float
from ..spirals.design import SpiralDesign
from .connectors.connect import Connections


def neck_widths(design: SpiralDesign, connections: Connections | None) -> Float[np.ndarray, " edges"]:
    """Return the width (E,) in metres of the narrowest place of every joint: its connector's neck, or else the arm.

    Parameters
    ----------
    design : spirals
    connections : connectors; None without connectors
    """
    mesh = design.flat.layout.mesh
    neck = design.arms.joint_width[mesh.edge_quads[:, 0], mesh.edge_sides[:, 0]]
    for connector in () if connections is None else connections.connectors:
        if connector.kind != "tab":
            size = connector.candidate.size
            # the clearance narrows the neck by half its width on both sides
            neck[mesh.quad_edges[connector.faces[0], connector.sides[0]]] = size.neck - size.clearance
    return neck


def neck_stresses(
    wrench: Float[np.ndarray, "joints 6"], neck: Float[np.ndarray, " joints"], thickness: float
) -> Float[np.ndarray, " joints"]:
    """Return an upper bound of the stress in every neck, Pa.

    Parameters
    ----------
    wrench : (m, 6), force in N and moment in N m along the joint's axes: across the edge, along the edge, normal
    neck : width (m,), metres
    thickness : metres
    """
    force = np.linalg.norm(wrench[:, :3], axis=1)
    inside, outside = np.abs(wrench[:, 5]), np.linalg.norm(wrench[:, 3:5], axis=1)
    return force / (neck * thickness) + 6.0 * inside / (thickness * neck**2) + 6.0 * outside / (neck * thickness**2)
