"""Make quads from any mesh: a second Blender remeshes it, ``engine.surface.remeshing.requad`` checks and repairs it."""

from __future__ import annotations

import re
from dataclasses import replace

import bpy
import numpy as np

from ...engine.errors import FlexMapsError
from ...engine.params import ObjectSettings
from ...engine.progress import SILENT, Progress
from ...engine.surface.mesh import PolygonMesh
from ...engine.surface.remeshing import requad
from ..store import remesh_source
from ..store.mesh import read_evaluated
from ..store.objects import scale_problem
from ..store.vertex_positions import to_metres
from ..view import meshes
from .second_blender import SecondBlender


def read_polygons(obj: bpy.types.Object, context: bpy.types.Context) -> PolygonMesh:
    """Return the polygons to remesh in metres: the object as it is seen, without its simulated shape.

    If the object holds unchanged quads of an earlier remesh, return the polygons that the quads were made from, moved
    to the quads' place.

    Parameters
    ----------
    obj : the object
    context : Blender's context

    Raises
    ------
    FlexMapsError : there are no polygons, or a scale factor is 0
    """
    source = remesh_source.read_source(obj, context.scene)
    for one in {obj, source}:
        if (problem := scale_problem(one, context.scene)) is not None:
            raise FlexMapsError(problem)
    polygons = read_evaluated(source, context.scene)
    if source == obj:
        return polygons
    there = remesh_source.source_to_quads(source, obj, context.scene)
    return replace(polygons, vertices=polygons.vertices @ there[:3, :3].T + there[:3, 3])


def make_quads(
    polygons: PolygonMesh, count: int, settings: ObjectSettings, progress: Progress = SILENT
) -> requad.RemeshResult:
    """Make about ``count`` quads in the shape of a polygon mesh; callable from any thread.

    Parameters
    ----------
    polygons : the mesh, metres
    count : wanted number of quads
    settings : settings of the object; those of the remesh and the layout are used
    progress : called with a fraction and a text

    Raises
    ------
    FlexMapsError : the remeshing tools return no usable quads
    """
    with SecondBlender(settings.remesh.smooth) as tool:
        return requad.requad(polygons, count, tool, progress, settings.remesh.crumbs, settings.layout.symmetric)


def as_object(quads: PolygonMesh, obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Object:
    """Make an object of quads with the transform and the collections of another object.

    Parameters
    ----------
    quads : the quads, metres and world axes
    obj, scene : object whose transform and collections are used, and its scene
    """
    frame = to_metres(obj, scene)
    corners = quads.corners.reshape(-1, 4)
    # a mirroring transform flips the normals: reverse the order of the corners, but keep the first
    if np.linalg.det(frame[:3, :3]) < 0:
        corners = corners[:, [0, 3, 2, 1]]
    local = (quads.vertices - frame[:3, 3]) @ np.linalg.inv(frame[:3, :3]).T
    name = re.sub(r" quads(\.\d+)?$", "", obj.name)  # quads may be remeshed again
    mesh = meshes.make_polygon_mesh(f"{name} quads", local, corners.ravel(), quads.sizes)
    made = bpy.data.objects.new(mesh.name, mesh)
    made.matrix_world = obj.matrix_world.copy()
    for collection in obj.users_collection or (scene.collection,):
        collection.objects.link(made)
    return made
