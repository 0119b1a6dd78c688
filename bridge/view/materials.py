"""Blender materials, each made once per file: sheets for renders, single colours, and a colour attribute."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Float, Int

UV = "flexmaps_flat"  # UV map in millimetres, so that a grain has its true size and runs the same way in all panels

FEW = 64  # single-colour materials on an object at most: more than a person tells apart; not measured


@dataclass(frozen=True)
class SheetAppearance:
    """Appearance of a sheet: colour (sRGB), roughness, and further surface effects.

    grain : darker sRGB colour of the grain, or None
    glass : share of light that passes through
    lines : distance of printed strands in millimetres, 0 without strands
    """

    label: str
    colour: tuple[float, float, float]
    roughness: float
    coat: float = 0.0
    sheen: float = 0.0
    glass: float = 0.0
    grain: tuple[float, float, float] | None = None
    lines: float = 0.0


# material's key in the settings -> appearance; by eye
LOOKS: dict[str, SheetAppearance] = {
    "pom": SheetAppearance("Delrin", (0.95, 0.95, 0.93), 0.35),
    "vero": SheetAppearance("VeroWhite", (0.90, 0.89, 0.85), 0.5),
    "acrylic": SheetAppearance("acrylic", (0.86, 0.15, 0.11), 0.32, coat=0.15, glass=0.25),
    "pla": SheetAppearance("PLA", (0.16, 0.47, 0.60), 0.42, lines=0.4),
    "petg": SheetAppearance("PETG", (0.20, 0.52, 0.42), 0.22, coat=0.3, lines=0.4),
    "birch": SheetAppearance("birch plywood", (0.91, 0.82, 0.67), 0.6, grain=(0.80, 0.67, 0.49)),
    "mdf": SheetAppearance("MDF", (0.62, 0.47, 0.32), 0.8, sheen=0.2),
    "custom": SheetAppearance("plain", (0.80, 0.80, 0.78), 0.5),
}


def of_material(key: str) -> bpy.types.Material:
    """Return the material of a sheet, by its key in the settings."""
    look = LOOKS[key]
    name = f"FlexMaps {look.label}"
    if name in bpy.data.materials:
        return bpy.data.materials[name]
    made, shader = _new(name)
    rgba = _rgba(look.colour)
    made.diffuse_color, made.roughness = rgba, look.roughness
    inputs = {
        "Base Color": rgba,
        "Roughness": look.roughness,
        "Coat Weight": look.coat,
        "Coat Roughness": 0.4,
        "Sheen Weight": look.sheen,
        "Transmission Weight": look.glass,
        "IOR": 1.49,
    }
    for socket, value in inputs.items():
        shader.inputs[socket].default_value = value
    if look.grain is not None:
        _grain(made.node_tree, shader, look)
    if look.lines:
        _strands(made.node_tree, shader, look.lines)
    return made


def material(name: str, rgb: Float[np.ndarray, " 3"] | None) -> bpy.types.Material:
    """Return a matt material of one colour (linear), or with None of the colour attribute; made once per file."""
    if name in bpy.data.materials:
        return bpy.data.materials[name]
    made, shader = _new(name)
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


def _new(name: str) -> tuple[bpy.types.Material, bpy.types.Node]:
    """Make a material; return it with its shader."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    return made, made.node_tree.nodes["Principled BSDF"]


def glowing(name: str, rgb: Float[np.ndarray, " 3"] | None) -> bpy.types.Material:
    """Return a material like ``material`` that emits its colour, whatever the light."""
    known = name in bpy.data.materials
    made = material(name, rgb)
    if not known:
        shader, nodes, links = made.node_tree.nodes["Principled BSDF"], made.node_tree.nodes, made.node_tree.links
        light = nodes.new("ShaderNodeEmission")
        for link in shader.inputs["Base Color"].links:
            links.new(link.from_socket, light.inputs["Color"])
        light.inputs["Color"].default_value = shader.inputs["Base Color"].default_value
        links.new(light.outputs["Emission"], nodes["Material Output"].inputs["Surface"])
        nodes.remove(shader)
    return made


def wear(
    data: bpy.types.Mesh | bpy.types.Curve,
    rgb: Float[np.ndarray, "colours 3"],
    of: Int[np.ndarray, " faces"] | None = None,
) -> None:
    """Assign materials to faces or lines by their linear colours, so that the colours also show in solid view.

    With more than ``FEW`` colours, as on maps, one material shows the mesh's colour attribute; lines have no attribute and
    get fewer shades.

    Parameters
    ----------
    data : a mesh, or a curve of lines
    rgb : the colours
    of : index into ``rgb`` for every face or line; default one colour each
    """
    distinct, which = np.unique(np.round(rgb, 5), axis=0, return_inverse=True)
    lines = isinstance(data, bpy.types.Curve)
    shades = FEW
    while lines and len(distinct) > FEW:
        shades //= 2
        distinct, which = np.unique(np.round(rgb * shades) / shades, axis=0, return_inverse=True)
    if len(distinct) > FEW:
        data.materials.append(material("FlexMaps panel", None))
        return
    for name, colour in zip(colours.hexadecimal(distinct), distinct, strict=True):
        data.materials.append(material(f"FlexMaps {name}", colour))
    index = (which.ravel() if of is None else which.ravel()[of]).astype(np.int32)
    if lines:
        data.splines.foreach_set("material_index", index)
    else:  # an attribute is many times as fast
        data.attributes.new("material_index", "INT", "FACE").data.foreach_set("value", index)


def _rgba(srgb: tuple[float, float, float]) -> tuple[float, ...]:
    return (*map(float, colours.linear(np.array(srgb))), 1.0)


def _node(tree: bpy.types.NodeTree, kind: str, place: tuple[float, float], **inputs: Any) -> bpy.types.Node:
    node = tree.nodes.new(kind)
    node.location = place
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return node


def _millimetres(
    tree: bpy.types.NodeTree, scale: tuple[float, float, float], place: tuple[float, float]
) -> bpy.types.Node:
    """Add nodes for the flat panel's coordinates, scaled."""
    source = _node(tree, "ShaderNodeUVMap", (place[0] - 400, place[1]))
    source.uv_map = UV
    mapping = _node(tree, "ShaderNodeMapping", (place[0] - 200, place[1]), Scale=scale)
    tree.links.new(source.outputs["UV"], mapping.inputs["Vector"])
    return mapping.outputs["Vector"]


def _grain(tree: bpy.types.NodeTree, shader: bpy.types.Node, look: SheetAppearance) -> None:
    """Add nodes for long fibres along x, in uneven bands."""
    assert look.grain is not None
    fibres = _node(tree, "ShaderNodeTexNoise", (-700, 200), Scale=1.0, Detail=6.0, Roughness=0.65, Distortion=0.3)
    tree.links.new(_millimetres(tree, (0.02, 0.55, 1.0), (-900, 200)), fibres.inputs["Vector"])
    ramp = _node(tree, "ShaderNodeValToRGB", (-450, 200))
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = _rgba(look.grain), _rgba(look.colour)
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.25, 0.65
    tree.links.new(fibres.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])


def _strands(tree: bpy.types.NodeTree, shader: bpy.types.Node, apart: float) -> None:
    """Add nodes for fine ridges, like a printer's strands."""
    wave = _node(tree, "ShaderNodeTexWave", (-700, -200), Scale=1.0, Distortion=0.0)
    wave.bands_direction = "DIAGONAL"
    tree.links.new(_millimetres(tree, (0.5 / apart,) * 3, (-900, -200)), wave.inputs["Vector"])
    bump = _node(tree, "ShaderNodeBump", (-350, -200), Strength=0.25, Distance=0.0001)
    tree.links.new(wave.outputs["Fac"], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
