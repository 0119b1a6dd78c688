"""Blender materials, each made once per file: sheet materials for renders, plain colours, and a colour attribute."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Float, Int

# UV map of the flat panels in millimetres, so that a wood grain has its true size and one direction in all panels
UV_MAP = "flexmaps_flat"

# largest number of plain-colour materials on an object, more than a person can tell apart; larger clutters the file,
# smaller makes solid view lose colours; not measured
MAX_MATERIALS = 64


@dataclass(frozen=True)
class SheetAppearance:
    """Appearance of a sheet material in renders.

    label : part of the name of Blender's material
    colour : sRGB
    roughness, coat, sheen : inputs of Blender's Principled BSDF, 0 to 1
    transmission : fraction of light that passes through
    grain : sRGB of the darker grain; None without grain
    strand_spacing : distance of 3D-printed strands, millimetres; 0 without strands
    """

    label: str
    colour: tuple[float, float, float]
    roughness: float
    coat: float = 0.0
    sheen: float = 0.0
    transmission: float = 0.0
    grain: tuple[float, float, float] | None = None
    strand_spacing: float = 0.0


# key of the material in the settings -> appearance; chosen by eye
APPEARANCES: dict[str, SheetAppearance] = {
    "pom": SheetAppearance("Delrin", (0.95, 0.95, 0.93), 0.35),
    "vero": SheetAppearance("VeroWhite", (0.90, 0.89, 0.85), 0.5),
    "acrylic": SheetAppearance("acrylic", (0.86, 0.15, 0.11), 0.32, coat=0.15, transmission=0.25),
    "pla": SheetAppearance("PLA", (0.16, 0.47, 0.60), 0.42, strand_spacing=0.4),
    "petg": SheetAppearance("PETG", (0.20, 0.52, 0.42), 0.22, coat=0.3, strand_spacing=0.4),
    "birch": SheetAppearance("birch plywood", (0.91, 0.82, 0.67), 0.6, grain=(0.80, 0.67, 0.49)),
    "mdf": SheetAppearance("MDF", (0.62, 0.47, 0.32), 0.8, sheen=0.2),
    "custom": SheetAppearance("plain", (0.80, 0.80, 0.78), 0.5),
}


def sheet_material(key: str) -> bpy.types.Material:
    """Return the Blender material of a sheet; ``key`` is the material's key in the settings, such as "birch"."""
    look = APPEARANCES[key]
    name = f"FlexMaps {look.label}"
    if name in bpy.data.materials:
        return bpy.data.materials[name]
    made, shader = _new_material(name)
    rgba = _to_rgba(look.colour)
    made.diffuse_color, made.roughness = rgba, look.roughness
    inputs = {
        "Base Color": rgba,
        "Roughness": look.roughness,
        "Coat Weight": look.coat,
        "Coat Roughness": 0.4,
        "Sheen Weight": look.sheen,
        "Transmission Weight": look.transmission,
        "IOR": 1.49,
    }
    for socket, value in inputs.items():
        shader.inputs[socket].default_value = value
    if look.grain is not None:
        _add_grain(made.node_tree, shader, look)
    if look.strand_spacing:
        _add_strands(made.node_tree, shader, look.strand_spacing)
    return made


def plain_material(name: str, rgb: Float[np.ndarray, " 3"] | None) -> bpy.types.Material:
    """Return the matt material of this name; make it if the file lacks it.

    Parameters
    ----------
    name : name of the material
    rgb : linear colour; None to show the mesh's colour attribute
    """
    if name in bpy.data.materials:
        return bpy.data.materials[name]
    made, shader = _new_material(name)
    shader.inputs["Roughness"].default_value = 0.55
    if rgb is None:
        source = made.node_tree.nodes.new("ShaderNodeAttribute")
        source.attribute_name = "flexmaps_colour"
        source.location = (-300, 200)
        made.node_tree.links.new(source.outputs["Color"], shader.inputs["Base Color"])
    else:
        colour = (*map(float, rgb), 1.0)
        shader.inputs["Base Color"].default_value = colour
        made.diffuse_color = colour
    return made


def _new_material(name: str) -> tuple[bpy.types.Material, bpy.types.Node]:
    """Make a material with nodes; return it with its Principled BSDF."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    return made, made.node_tree.nodes["Principled BSDF"]


def emissive_material(name: str, rgb: Float[np.ndarray, " 3"] | None) -> bpy.types.Material:
    """Return a material like ``plain_material`` that emits its colour, so that lighting does not change it."""
    known = name in bpy.data.materials
    made = plain_material(name, rgb)
    if not known:
        shader, nodes, links = made.node_tree.nodes["Principled BSDF"], made.node_tree.nodes, made.node_tree.links
        light = nodes.new("ShaderNodeEmission")
        for link in shader.inputs["Base Color"].links:
            links.new(link.from_socket, light.inputs["Color"])
        light.inputs["Color"].default_value = shader.inputs["Base Color"].default_value
        links.new(light.outputs["Emission"], nodes["Material Output"].inputs["Surface"])
        nodes.remove(shader)
    return made


def assign_colours(
    data: bpy.types.Mesh | bpy.types.Curve,
    rgb: Float[np.ndarray, "colours 3"],
    colour_index: Int[np.ndarray, " faces"] | None = None,
) -> None:
    """Assign a material of its colour to every face or line, so that the colours also show in solid view.

    With more than ``MAX_MATERIALS`` colours, a mesh gets one material that shows its colour attribute. A curve cannot
    have this attribute, so its colours are rounded to fewer shades.

    Parameters
    ----------
    data : a mesh, or a curve of lines
    rgb : linear colours
    colour_index : index into ``rgb`` for every face or line; by default, face or line k has colour k
    """
    distinct, which = np.unique(np.round(rgb, 5), axis=0, return_inverse=True)
    lines = isinstance(data, bpy.types.Curve)
    shades = MAX_MATERIALS
    while lines and len(distinct) > MAX_MATERIALS:
        shades //= 2
        distinct, which = np.unique(np.round(rgb * shades) / shades, axis=0, return_inverse=True)
    if len(distinct) > MAX_MATERIALS:
        data.materials.append(plain_material("FlexMaps panel", None))
        return
    for name, colour in zip(colours.to_hexadecimal(distinct), distinct, strict=True):
        data.materials.append(plain_material(f"FlexMaps {name}", colour))
    index = (which.ravel() if colour_index is None else which.ravel()[colour_index]).astype(np.int32)
    if lines:
        data.splines.foreach_set("material_index", index)
    else:  # writing the attribute is many times as fast as setting ``material_index`` of the polygons
        data.attributes.new("material_index", "INT", "FACE").data.foreach_set("value", index)


def _to_rgba(srgb: tuple[float, float, float]) -> tuple[float, ...]:
    return (*map(float, colours.srgb_to_linear(np.array(srgb))), 1.0)


def _add_node(tree: bpy.types.NodeTree, kind: str, position: tuple[float, float], **inputs: Any) -> bpy.types.Node:
    node = tree.nodes.new(kind)
    node.location = position
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return node


def _add_coordinates(
    tree: bpy.types.NodeTree, scale: tuple[float, float, float], position: tuple[float, float]
) -> bpy.types.Node:
    """Add shader nodes for the coordinates in the flat panel, in millimetres times ``scale``; return their output."""
    source = _add_node(tree, "ShaderNodeUVMap", (position[0] - 400, position[1]))
    source.uv_map = UV_MAP
    mapping = _add_node(tree, "ShaderNodeMapping", (position[0] - 200, position[1]), Scale=scale)
    tree.links.new(source.outputs["UV"], mapping.inputs["Vector"])
    return mapping.outputs["Vector"]


def _add_grain(tree: bpy.types.NodeTree, shader: bpy.types.Node, look: SheetAppearance) -> None:
    """Add shader nodes of a wood grain: long fibres along x, in uneven bands."""
    assert look.grain is not None
    fibres = _add_node(tree, "ShaderNodeTexNoise", (-700, 200), Scale=1.0, Detail=6.0, Roughness=0.65, Distortion=0.3)
    tree.links.new(_add_coordinates(tree, (0.02, 0.55, 1.0), (-900, 200)), fibres.inputs["Vector"])
    ramp = _add_node(tree, "ShaderNodeValToRGB", (-450, 200))
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = _to_rgba(look.grain), _to_rgba(look.colour)
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.25, 0.65
    tree.links.new(fibres.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])


def _add_strands(tree: bpy.types.NodeTree, shader: bpy.types.Node, spacing: float) -> None:
    """Add shader nodes of fine ridges, like strands of a 3D printer, ``spacing`` millimetres apart."""
    wave = _add_node(tree, "ShaderNodeTexWave", (-700, -200), Scale=1.0, Distortion=0.0)
    wave.bands_direction = "DIAGONAL"
    tree.links.new(_add_coordinates(tree, (0.5 / spacing,) * 3, (-900, -200)), wave.inputs["Vector"])
    bump = _add_node(tree, "ShaderNodeBump", (-350, -200), Strength=0.25, Distance=0.0001)
    tree.links.new(wave.outputs["Fac"], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
