"""Modifiers of an object: which of them change its surface, and which are ignored when the surface is read.

A panel is as thick as the sheet, so *Solidify* would only double the surface. *Edge Split* and *Triangulate* at the
end of the stack change shading and exports, not the shape. Fast enough for every redraw.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import sqrt

import bpy

from ...engine.params import RemeshParams
from . import stored_report
from .i18n import translate

NAME = "flexmaps_left_out"  # name of a text on the mesh: sentence about the ignored modifiers

# modifier types that do not change the surface
HARMLESS = {
    "COLLISION",
    "DATA_TRANSFER",
    "NORMAL_EDIT",
    "PARTICLE_SYSTEM",
    "SURFACE",
    "UV_PROJECT",
    "UV_WARP",
    "VERTEX_WEIGHT_EDIT",
    "VERTEX_WEIGHT_MIX",
    "VERTEX_WEIGHT_PROXIMITY",
    "WEIGHTED_NORMAL",
}
# geometry nodes that pass the surface on unchanged
PASSIVE_NODES = {
    "GeometryNodeSetMaterial",
    "GeometryNodeSetMaterialIndex",
    "GeometryNodeSetShadeSmooth",
    "GeometryNodeStoreNamedAttribute",
    "NodeGroupInput",
    "NodeReroute",
}
SPLITTING = {"EDGE_SPLIT", "TRIANGULATE"}  # modifier types that split faces or edges without moving them
# largest extent of a flat surface across its plane after *Solidify*, in thicknesses; above 1 for float32 rounding
MAX_FLAT_EXTENT = 1.001


def list_changing(obj: bpy.types.Object) -> list[bpy.types.Modifier]:
    """Return the modifiers that change the mesh, including the ignored ones (``list_ignored``)."""
    return [m for m in obj.modifiers if m.show_viewport and m.type not in HARMLESS and not _is_shading_only(m)]


def list_ignored(obj: bpy.types.Object) -> list[bpy.types.Modifier]:
    """Return the modifiers that are ignored when the surface of an object is read."""
    found: list[bpy.types.Modifier] = []
    last = True  # whether no later modifier in the stack changes the surface
    voxels = False  # whether a later modifier is a Remesh, which needs a closed body
    for modifier in reversed(list_changing(obj)):
        thickens = modifier.type == "SOLIDIFY" and not voxels and not _makes_body(obj, modifier)
        if thickens or (last and modifier.type in SPLITTING):
            found.insert(0, modifier)
            continue
        last, voxels = False, voxels or modifier.type == "REMESH"
    return found


def describe_ignored(obj: bpy.types.Object) -> str:
    """Return sentences about the ignored modifiers and why they are ignored; "" if there are none."""
    return ". ".join(map(_describe, list_ignored(obj)))


def _describe(modifier: bpy.types.Modifier) -> str:
    if modifier.type == "SOLIDIFY":
        return translate("The modifier '{}' is left out: panels have the thickness of the sheet", modifier.name)
    return translate(
        "The modifier '{}' is left out: it splits faces or edges, but does not change the shape", modifier.name
    )


def write_note(mesh: bpy.types.Mesh, text: str) -> None:
    """Store on the mesh the sentence about ignored modifiers.

    Parameters
    ----------
    mesh : Blender's mesh of the surface
    text : the sentence; "" keeps the stored one
    """
    if text:
        stored_report.put_text(mesh, NAME, {"text": text})


def read_note(mesh: bpy.types.Mesh) -> str:
    """Return the stored sentence about ignored modifiers; "" if there is none."""
    return str(stored_report.get_text(mesh, NAME).get("text", ""))


@contextmanager
def surface_only(obj: bpy.types.Object) -> Iterator[tuple[str, ...]]:
    """Context manager: hide the modifiers of ``list_ignored`` from Blender; yield a sentence about each."""
    found = list_ignored(obj)
    try:
        for one in found:
            one.show_viewport = False
        yield tuple(map(_describe, found))
    finally:
        for one in found:
            one.show_viewport = True


def _is_shading_only(modifier: bpy.types.Modifier) -> bool:
    """Return whether the modifier's geometry nodes leave the shape unchanged, as those of *Smooth by Angle* do."""
    tree = modifier.node_group if modifier.type == "NODES" else None
    return tree is not None and _is_passive(tree)


def _is_passive(tree: bpy.types.NodeTree) -> bool:
    for node in tree.nodes:
        if node.bl_idname == "NodeGroupOutput" and not (node.inputs and node.inputs[0].is_linked):
            return False
        if node.bl_idname == "GeometryNodeGroup":
            if node.node_tree is None or not _is_passive(node.node_tree):
                return False
        elif node.bl_idname not in PASSIVE_NODES and any(socket.type == "GEOMETRY" for socket in node.outputs):
            return False
    return True


def _makes_body(obj: bpy.types.Object, modifier: bpy.types.Modifier) -> bool:
    """Return whether *Solidify* turns a flat surface, such as a text, into a body thicker than a quad's edge."""
    extents = sorted(b - a for a, b in zip(obj.bound_box[0], obj.bound_box[6], strict=True))
    thickness = abs(modifier.thickness)
    if extents[0] > MAX_FLAT_EXTENT * thickness:
        return False  # the surface before *Solidify* is not flat
    wanted = obj.flexmaps.remesh.quads if hasattr(obj, "flexmaps") else RemeshParams().quads
    return bool(thickness > sqrt(2.0 * extents[1] * extents[2] / wanted))
