"""Script of the second Blender: remesh the meshes that ``second_blender`` sends.

Each request is a line of JSON: the file of the mesh, the file for the answer, the name of the tool and its options. The
script does not import the package, so that it starts quickly.
"""

import json
import os
import sys

import bpy  # isort: skip  # before bmesh and mathutils, which the Python module bpy provides
import bmesh
import numpy as np
from mathutils.bvhtree import BVHTree


def triangles(obj, near):
    """Merge vertices closer than ``near``, remove degenerate edges, and triangulate."""
    bm = bmesh.new()
    bm.from_mesh(obj.data)
    bmesh.ops.remove_doubles(bm, verts=bm.verts, dist=near)
    bmesh.ops.dissolve_degenerate(bm, edges=bm.edges, dist=near)
    # remove vertices between just two quads: both quads could get the same diagonal, an edge of four triangles
    doublets = [v for v in bm.verts if len(v.link_edges) == 2 and [len(f.verts) for f in v.link_faces] == [4, 4]]
    bmesh.ops.dissolve_verts(bm, verts=doublets)
    bmesh.ops.triangulate(bm, faces=bm.faces)
    bmesh.ops.delete(bm, geom=[v for v in bm.verts if not v.link_faces], context="VERTS")
    bm.to_mesh(obj.data)
    bm.free()


def voxels(obj, size):
    obj.data.remesh_voxel_size, obj.data.remesh_voxel_adaptivity = size, 0.0
    return "FINISHED" in bpy.ops.object.voxel_remesh()


def cells(obj, size):
    """Merge coplanar faces, then cut the mesh by planes normal to the x, y and z axes, about ``size`` apart."""
    bm = bmesh.new()
    bm.from_mesh(obj.data)
    bmesh.ops.dissolve_limit(bm, angle_limit=1e-3, verts=[], edges=bm.edges)
    places = np.array([v.co for v in bm.verts])
    low, high = places.min(axis=0), places.max(axis=0)
    for axis in range(3):
        count = round(float((high - low)[axis]) / size)
        for k in range(1, count):
            middle = low + np.eye(3)[axis] * (high - low)[axis] * k / count
            every = [*bm.verts, *bm.edges, *bm.faces]
            # treat vertices near a plane as on it; otherwise slivers would be cut off beside them
            bmesh.ops.bisect_plane(bm, geom=every, dist=0.2 * size, plane_co=middle, plane_no=np.eye(3)[axis])
    bm.to_mesh(obj.data)
    bm.free()


def quads(obj, count, seed, sharp, smooth):
    return "FINISHED" in bpy.ops.object.quadriflow_remesh(
        mode="FACES",
        target_faces=count,
        use_mesh_symmetry=False,
        use_preserve_sharp=sharp,
        use_preserve_boundary=True,
        smooth_normals=smooth,
        seed=seed,
    )


def touching(vertices, corners, body):
    """Return the pairs of bodies whose triangles intersect, (n, 2); ``body`` is the body of every triangle."""
    trees = []
    for k in range(int(body.max()) + 1):
        trees.append(BVHTree.FromPolygons(vertices.tolist(), corners.reshape(-1, 3)[body == k].tolist()))
    low = np.array([vertices[corners.reshape(-1, 3)[body == k]].min(axis=(0, 1)) for k in range(len(trees))])
    high = np.array([vertices[corners.reshape(-1, 3)[body == k]].max(axis=(0, 1)) for k in range(len(trees))])
    pairs = []
    for a in range(len(trees)):
        near = ((low[a] <= high[a + 1 :]) & (high[a] >= low[a + 1 :])).all(axis=1)
        pairs += [(a, int(b)) for b in a + 1 + np.flatnonzero(near) if trees[a].overlap(trees[b])]
    return np.array(pairs, int).reshape(-1, 2)


def as_object(vertices, corners, sizes):
    mesh = bpy.data.meshes.new("mesh")
    mesh.vertices.add(len(vertices))
    mesh.loops.add(len(corners))
    mesh.polygons.add(len(sizes))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(vertices, np.float32).ravel())
    mesh.loops.foreach_set("vertex_index", corners.astype(np.int32))
    mesh.polygons.foreach_set("loop_start", (np.cumsum(sizes) - sizes).astype(np.int32))
    mesh.update(calc_edges=True)
    mesh.validate()
    obj = bpy.data.objects.new("mesh", mesh)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    return obj


def as_arrays(mesh):
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    corners, sizes = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.polygons), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.polygons.foreach_get("loop_total", sizes)
    return {"vertices": vertices.reshape(-1, 3), "corners": corners, "sizes": sizes}


TOOLS: dict = {"triangles": triangles, "voxels": voxels, "cells": cells, "quads": quads}


def run_tool(request, arrays):
    """Run the requested tool and return the arrays of its result; {} if Blender's operator fails."""
    if request["tool"] == "touching":
        return {"pairs": touching(arrays["vertices"], arrays["corners"], arrays["body"])}
    obj = as_object(arrays["vertices"], arrays["corners"], arrays["sizes"])
    mesh = obj.data
    try:
        return as_arrays(mesh) if TOOLS[request["tool"]](obj, **request["options"]) is not False else {}
    except RuntimeError:  # the operator failed
        return {}
    finally:
        bpy.data.objects.remove(obj)
        bpy.data.meshes.remove(mesh)


def main():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for line in sys.stdin:  # ends when the first Blender ends
        request = json.loads(line)
        with np.load(request["given"]) as arrays:
            answers = run_tool(request, arrays)
        unfinished = request["answer"] + ".part.npz"
        np.savez(unfinished, **answers)
        os.replace(unfinished, request["answer"])
    os._exit(0)


main()
