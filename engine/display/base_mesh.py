"""The base plates of a piece as one triangle mesh in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int
from ..fabrication.panels.panel import Panel
from ..fabrication.standing.base import Base
from ..fabrication.writers.panel_solids import extrude_panel
from .solids import DRAWING_TOLERANCE


@dataclass(frozen=True, eq=False)
class BaseMesh:
    """Closed triangle mesh of all plates, with normals outwards; vertices in metres."""

    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]


def make_base_mesh(base: Base) -> BaseMesh:
    """Build all plates of a base, with their upper sides at the height of the ground."""
    vertices, triangles, count = [], [], 0
    for plate in base.plates:
        solid = extrude_panel(
            Panel(0, -1, plate.outline, plate.holes, (), 0.0, kind="base"), base.thickness, DRAWING_TOLERANCE
        )
        vertices.append(solid.vertices + np.array([0.0, 0.0, base.ground_height - base.thickness]))
        triangles.append(solid.triangles + count)
        count += len(solid.vertices)
    return BaseMesh(np.concatenate(vertices), np.concatenate(triangles))
