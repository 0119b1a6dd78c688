"""Write a piece, recomputed with an advised remedy such as a thinner sheet, into its object; report the effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ...engine.runs.outputs import SimulatedShape
from ...engine.runs.result import Result
from ...engine.surface.mesh import QuadMesh
from ..store import advice, equilibrium, mesh, stored_report
from ..store.surface import ObjectSurface
from .flat_panels import PanelDrawing

# tolerance of vertex positions in median edge lengths, for Blender's single precision; larger takes moved meshes for
# unchanged ones, smaller takes rounding for a change
POSITION_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class RemediedPiece:
    """A piece recomputed with a remedy.

    before, after : results without and with the remedy
    panels : panels to draw
    blocks : report blocks to store, by stage
    """

    before: Result
    after: Result
    panels: PanelDrawing
    blocks: dict[str, Any]


def write_remedied_piece(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    surface: ObjectSurface,
    piece: RemediedPiece,
    change: tuple[str, float, float],
    figures: dict[str, Any],
) -> tuple[str, bool]:
    """Write the piece and its report blocks into an object whose mesh has the quads of the piece.

    Parameters
    ----------
    obj, scene : the object and its scene
    surface : the object's present surface
    piece : the recomputed piece
    change : name of the remedy; old and new value of the quantity that it changes, in the unit of the advice
    figures : report block "equilibrium" before the remedy

    Returns
    -------
    A text for the user, and whether the remedy helped without a warning.
    """
    blocks, kept = dict(piece.blocks), stored_report.read(obj.data).get("layout", {})
    if piece.after.flat is piece.before.flat:
        del blocks["layout"]
    else:
        mesh.write_flat(obj, surface, piece.panels.design.flat, piece.panels.centres)
        blocks["layout"] |= {key: kept[key] for key in (stored_report.TRACED,) if key in kept}
    if piece.after.design is piece.before.design:
        del blocks["spirals"]
    else:
        mesh.write_design(obj, surface, piece.panels.design)
    shape = piece.after.need(SimulatedShape)
    equilibrium.write(obj, surface, shape.simulation, shape.limits)
    brought = advice.effect_of(*change, figures, blocks["equilibrium"])
    blocks["reach"] |= {advice.EFFECT: brought}
    stored_report.write_all(obj.data, blocks)
    text, warning = equilibrium.describe_result(blocks["equilibrium"])
    lines = [advice.describe_effect(brought), *([text] if warning else [])]
    return ". ".join(lines), advice.has_helped(brought) and not warning


def has_same_quads(surface: ObjectSurface, mesh: QuadMesh) -> bool:
    """Return whether an object has the quads of an engine mesh: in the same order, with equal corner positions.

    Parameters
    ----------
    surface : the object's surface
    mesh : the engine's mesh
    """
    corners = surface.polygons.corners
    if len(corners) != mesh.quads.size:
        return False
    away = surface.polygons.vertices[corners] - mesh.vertices[mesh.quads.ravel()]
    return float(np.abs(away).max()) <= POSITION_TOLERANCE * mesh.median_edge
