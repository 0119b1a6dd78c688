"""Make Blender meshes from arrays, with colours and attributes for display."""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.arrays import Float, Int
from ..store import attributes


def make_quad_mesh(
    name: str, points: Float[np.ndarray, "vertices 3"], corners: Int[np.ndarray, "quads 4"]
) -> bpy.types.Mesh:
    """Make a mesh of quads, flat-shaded."""
    return make_polygon_mesh(name, points, corners.ravel(), np.full(len(corners), 4))


def make_polygon_mesh(
    name: str,
    points: Float[np.ndarray, "vertices 3"],
    corners: Int[np.ndarray, " corners"],
    sizes: Int[np.ndarray, " faces"],
) -> bpy.types.Mesh:
    """Make a mesh of polygons, flat-shaded.

    Positions and corners are written as attributes, which copies whole arrays; writing them through vertices and loops
    would copy them one by one.

    Parameters
    ----------
    name : name of the mesh
    points : (V, 3)
    corners : vertex of every face corner, face after face
    sizes : number of corners of every face
    """
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(points))
    mesh.attributes["position"].data.foreach_set("vector", np.ascontiguousarray(points, dtype=np.float32).ravel())
    mesh.loops.add(len(corners))
    mesh.attributes[".corner_vert"].data.foreach_set("value", np.ascontiguousarray(corners, dtype=np.int32))
    mesh.polygons.add(len(sizes))
    mesh.polygons.foreach_set("loop_start", (np.cumsum(sizes) - sizes).astype(np.int32))
    mesh.attributes.new("sharp_face", "BOOLEAN", "FACE").data.foreach_set("value", np.ones(len(sizes), bool))
    mesh.update(calc_edges=True)
    return mesh


def set_corner_colours(mesh: bpy.types.Mesh, rgb: Float[np.ndarray, "corners 3"]) -> None:
    """Set the linear colour of every face corner, in the colour attribute that FlexMaps' materials show."""
    attribute = mesh.attributes.get("flexmaps_colour")
    if attribute is None:
        attribute = mesh.attributes.new("flexmaps_colour", "FLOAT_COLOR", "CORNER")
    rgba = np.ones((len(rgb), 4), np.float32)
    rgba[:, :3] = rgb
    attribute.data.foreach_set("color", rgba.ravel())
    mesh.attributes.active_color_name = "flexmaps_colour"


def put_attribute(mesh: bpy.types.Mesh, name: str, domain: str, values: np.ndarray) -> None:
    """Add an attribute to a mesh, or overwrite it.

    Parameters
    ----------
    mesh : the mesh
    name : name, including the prefix "flexmaps_"
    domain : Blender's domain, such as "POINT"
    values : (N,) floats, integers or booleans; (N, 2) for a UV map, (N, 3) for vectors, (N, 4) for colours
    """
    kind = {"f": "FLOAT", "i": "INT", "b": "BOOLEAN"}[values.dtype.kind]
    if values.ndim == 2:
        kind = {2: "FLOAT2", 3: "FLOAT_VECTOR", 4: "FLOAT_COLOR"}[values.shape[1]]
    prop, _, dtype, _ = attributes.KINDS[kind]
    if kind == "FLOAT2":
        mesh.uv_layers.new(name=name, do_init=False)
    elif name not in mesh.attributes:
        mesh.attributes.new(name, kind, domain)
    mesh.attributes[name].data.foreach_set(prop, np.ascontiguousarray(values, dtype=dtype).ravel())


def shade_arms(mesh: bpy.types.Mesh, section: Int[np.ndarray, " vertices"]) -> None:
    """Shade arms smoothly along their length, with sharp edges between their four sides.

    ``section`` numbers the cross-section of every vertex: edges within a cross-section are smooth, all others sharp.
    """
    pairs = np.empty(2 * len(mesh.edges), np.int32)
    mesh.attributes[".edge_verts"].data.foreach_get("value", pairs)
    ends = section[pairs.reshape(-1, 2)]
    put_attribute(mesh, "sharp_edge", "EDGE", ends[:, 0] != ends[:, 1])
    mesh.shade_smooth()
