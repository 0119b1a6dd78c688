"""What the joints of a piece bear: the stress in the narrowest place of every connector.

At rest every joint carries a force and a moment of the equilibrium. Its narrowest place is the neck of its connector, a bar of
the neck's width n and the sheet's thickness t: of a force F and the moments M in and out of the sheet's plane it feels at most
the stress F / n t + 6 M_in / t n^2 + 6 M_out / n t^2 by beam theory, the shares of tension and of both bendings added up as in EN 1995-1-1,
6.2.3, with k_m = 1. Torsion counts as bending out of the plane: in a bar as flat as a sheet it strains the material a
little less. It bears the material's strength, Young's modulus times the strain limit. What glue bears, and how a head or
a key slips out of its socket across the sheet, is not told.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float
from ..fabrication.connectors.connect import Connections
from ..spirals.design import SpiralDesign


def necks(design: SpiralDesign, made: Connections | None) -> Float[np.ndarray, " edges"]:
    """(E,) metres, width of the narrowest place of every joint: its connector's neck, else the arm."""
    mesh = design.flat.layout.mesh
    neck = design.arms.joint_width[mesh.edge_quads[:, 0], mesh.edge_sides[:, 0]]
    for connector in () if made is None else made.connectors:
        if connector.kind != "tab":
            size = connector.made.size
            # the gap is taken from both sides of the curve between head and socket
            neck[mesh.quad_edges[connector.faces[0], connector.sides[0]]] = size.neck - size.clearance
    return neck


def stresses(
    wrench: Float[np.ndarray, "joints 6"], neck: Float[np.ndarray, " joints"], thickness: float
) -> Float[np.ndarray, " joints"]:
    """(m,) Pa in necks (m,) m wide, of wrenches (m, 6) N and N m in the joints' axes: across, along the edge, normal."""
    force = np.linalg.norm(wrench[:, :3], axis=1)
    inside, outside = np.abs(wrench[:, 5]), np.linalg.norm(wrench[:, 3:5], axis=1)
    return force / (neck * thickness) + 6.0 * inside / (thickness * neck**2) + 6.0 * outside / (neck * thickness**2)
