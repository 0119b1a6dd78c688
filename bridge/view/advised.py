"""A piece that was made again with what was advised: what came of it, and writing it into its object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ...engine.runs.result import Result
from ...engine.surface.mesh import QuadMesh
from ..store import advice, equilibrium, mesh, notes
from ..store.surface import Surface
from .flat_panels import PanelDrawing

LIKE = 1e-3  # share of an edge by which vertices may be rounded in Blender's single precision; not measured


@dataclass(frozen=True, eq=False)
class Made:
    """The piece as it was and as it is with what was advised, the panels to draw, and what the stages tell of it."""

    before: Result
    after: Result
    panels: PanelDrawing
    blocks: dict[str, Any]


def write(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    surface: Surface,
    made: Made,
    change: tuple[str, float, float],
    figures: dict[str, Any],
) -> tuple[str, bool]:
    """Write the piece into an object that has its shape, with its notes.

    Parameters
    ----------
    obj, scene : where it is written
    surface : the object's, as it is now
    made : the piece
    change : the remedy, and what it changed, before and after
    figures : the block of the shape that the advice was made from

    Returns
    -------
    What to tell the user, and whether that is good news.
    """
    blocks, kept = dict(made.blocks), notes.read(obj.data).get("layout", {})
    if made.after.flat is made.before.flat:
        del blocks["layout"]
    else:
        mesh.write_flat(obj, surface, made.panels.design.flat, made.panels.centres)
        blocks["layout"] |= {key: kept[key] for key in (notes.TRACED,) if key in kept}
    if made.after.design is made.before.design:
        del blocks["spirals"]
    else:
        mesh.write_design(obj, surface, made.panels.design)
    simulation = made.after.simulation
    assert simulation is not None
    equilibrium.write(obj, scene, surface, simulation, made.after.limits)
    brought = advice.compared(*change, figures, blocks["equilibrium"])
    blocks["reach"] |= {advice.BROUGHT: brought}
    notes.write_all(obj.data, blocks)
    text, warning = equilibrium.sentences(blocks["equilibrium"])
    return ". ".join([advice.said(brought), *([text] if warning else [])]), advice.helped(brought) and not warning


def alike(surface: Surface, mesh: QuadMesh) -> bool:
    """Whether an object has the corners of the engine's quads, one by one and where they are."""
    corners = surface.polygons.corners
    if len(corners) != mesh.quads.size:
        return False
    away = surface.polygons.vertices[corners] - mesh.vertices[mesh.quads.ravel()]
    return float(np.abs(away).max()) <= LIKE * mesh.median_edge
