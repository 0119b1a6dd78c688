"""What an object in Blender holds of a job, as the engine's result; ``scene.put`` is the way back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.runs import job
from ..engine.surface.mesh import PolygonMesh
from . import mesh, objects, settings, supports
from .surface import Surface


@dataclass(frozen=True, eq=False)
class Stored:
    """Of an object: its surface, its settings, and how far the stages have come.

    uid : Blender's id of the object; None where what is seen is not its own mesh, but what modifiers made of it
    result : None where the check finds errors; broken : why nothing can be built on the stages, if it cannot
    seams : (E,) bool, the edges, in the engine's numbers, where the object has seams
    """

    source: PolygonMesh
    settings: ObjectSettings
    uid: int | None = None
    result: job.Result | None = None
    seams: np.ndarray | None = None
    broken: FlexMapsError | None = None


def read(obj: bpy.types.Object) -> Stored:
    """What an object holds; raises ``FlexMapsError`` where it is no mesh that FlexMaps can work on."""
    scene = bpy.context.scene
    used = settings.read(obj.flexmaps, ObjectSettings) if hasattr(obj, "flexmaps") else ObjectSettings()
    problem = objects.unusable(obj)
    if problem:
        raise FlexMapsError(problem)
    if objects.changed_by_modifiers(obj):
        return Stored(mesh.read_evaluated(obj, scene, bpy.context.evaluated_depsgraph_get()), used)
    surface = mesh.read_surface(obj, scene)
    found = of_surface(surface, used)
    if found.result is None:
        return found
    held, force = supports.supported(obj, surface, used.loads), supports.force(obj, surface, used.loads)
    return replace(found, result=replace(found.result, supports=held, force=force))


def of_surface(surface: Surface, used: ObjectSettings) -> Stored:
    """The same from a surface that was read, without supports and forces; touches no Blender data, so any thread can."""
    try:
        result = job.begin(surface.polygons)
    except FlexMapsError:
        return Stored(surface.polygons, used, surface.uid)
    seams = mesh.layout_of(surface, result.mesh).cut
    try:
        flat = mesh.current_flat(surface, result.mesh) if surface.values.keys() >= set(mesh.FLAT_NAMES) else None
    except FlexMapsError as error:
        return Stored(surface.polygons, used, surface.uid, result, seams, error)
    design = None if flat is None else mesh.design_of(surface, flat, used.spiral)
    return Stored(surface.polygons, used, surface.uid, replace(result, flat=flat, design=design), seams)
