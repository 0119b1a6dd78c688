"""Read the input of the live simulation from an object in any mode, within a few milliseconds."""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.errors import FlexMapsError
from ...engine.extras.live.live_input import LiveInput
from ...engine.params import LayoutParams, LoadParams, MaterialParams, SimulateParams, SpiralParams
from ...engine.runs.stages import MISSING
from . import attributes, mesh, settings, supports
from .objects import modifier_problem


def read(obj: bpy.types.Object, scene: bpy.types.Scene) -> LiveInput:
    """Return everything that the simulated shape of a piece depends on.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene

    Raises
    ------
    FlexMapsError where the object has no valid spirals, modifiers change its faces, or a vertex group of the supports
    or forces is missing or empty.
    """
    problem = modifier_problem(obj)
    if problem:
        raise FlexMapsError(problem)
    surface, own = mesh.read_in_any_mode(obj, scene), obj.flexmaps
    values, polygons = surface.values, surface.polygons
    if (polygons.sizes != 4).any():
        raise FlexMapsError("Some faces are not quads; press Quad remesh")
    for names, missing in ((mesh.FLAT_NAMES, "flat"), (mesh.DESIGN_NAMES, "design")):
        if len(surface.invalid_faces) and missing == "design":
            raise mesh.uncuttable_error(surface.invalid_faces)
        if any(name not in values for name in names):
            raise FlexMapsError(MISSING[missing])
    held, force = supports.read_loads(obj, surface, settings.read(own.loads, LoadParams))
    return LiveInput(
        polygons.vertices,
        polygons.corners,
        polygons.sizes,
        surface.seams[surface.edge_of],
        values["seam"][surface.edge_of] >= 0,
        1e-3 * values["flat"][surface.loops].reshape(-1, 4, 2).astype(float),
        values["energy"].astype(float),
        1e-3 * attributes.corners_by_face(values["width"][surface.loops]),
        np.radians(values["twist"].astype(float)),
        settings.read(own.spiral, SpiralParams),
        settings.read(own.layout, LayoutParams),
        settings.read(own.material, MaterialParams).chosen,
        settings.read(own.simulate, SimulateParams),
        held,
        force,
    )
