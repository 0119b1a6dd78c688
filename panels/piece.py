"""The section *Piece*: settings to decide before any stage runs (material, size of quads, border, supports)."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store import derived_properties
from ..engine.params import MaterialParams
from .rows import choice, line, pair, popover, rare, settings_of, settings_popover, tr, value

AXES = "force_x", "force_y", "force_z"
RIM = "rim_width", "rim_hole", "rim_spacing"


def draw(body: Any, context: bpy.types.Context) -> None:
    obj = context.object
    wanted = obj.flexmaps
    column = body.column(align=True)
    rare(value(column, wanted.material, "material", tr("Material")), "material")
    value(column, wanted.spiral, "thickness", tr("Thickness"))
    pair(column, tr("Sheet"), wanted.sheet, "sheet_width", "sheet_height")
    choice(column, tr("Lasts"), wanted.material, "lasts")

    column = body.column(align=True)
    row = value(column, wanted.remesh, "quads", tr("Quads"))
    row.operator("flexmaps.quad_remesh", text="", icon="FILE_REFRESH")
    rare(row, "quads")
    row = line(column, "")
    row.active = False
    edge = 1e3 * derived_properties.estimate_quad_edge(obj, context.scene)
    row.label(text=tr("spirals of {} mm", f"{edge:.3g}" if edge < 100 else f"{edge:.0f}"), translate=False)
    value(column, wanted.layout, "symmetric", tr("Symmetry"))

    row = choice(body, tr("Border"), obj, "flexmaps_border")
    row.enabled = derived_properties.has_border(obj.data)
    rare(row, "border")

    column = body.column(align=True)
    choice(column, tr("Rests"), obj, "flexmaps_rests")
    held = column.column(align=True)
    held.enabled = obj.flexmaps_rests != "FREE"
    row = line(held, tr("Held at"))
    row.operator("flexmaps.hold_selection", text=tr("Selection"), translate=False)
    rare(row, "rests")
    hangs = obj.flexmaps_rests == "HANGS"
    row = value(held, wanted.base, "eyelet" if hangs else "base", tr("Eyelets") if hangs else tr("Base"))
    rare(row, "base")
    value(held, wanted.simulate, "gravity", tr("Own weight"))


def key(context: bpy.types.Context) -> str:
    """Return the text beside the folded section's heading: the choices of border, support and duration of loads."""
    obj = context.object
    border = [(obj, "flexmaps_border")] if derived_properties.has_border(obj.data) else []
    chosen = *border, (obj, "flexmaps_rests"), (obj.flexmaps.material, "lasts")
    names = [owner.bl_rna.properties[name].enum_items[getattr(owner, name)].name for owner, name in chosen]
    return ", ".join(map(tr, names))


def _material(layout: Any, wanted: Any) -> None:
    """Draw the properties of the material; they can be edited only if the material is "custom"."""
    layout.enabled = wanted.material.material == "custom"
    settings_of(layout, wanted.material, *CUSTOM)


CUSTOM = tuple(name for name in MaterialParams.__dataclass_fields__ if name not in ("material", "lasts"))


def _quads(layout: Any, wanted: Any) -> None:
    for name in ("smooth", "crumbs"):
        layout.prop(wanted.remesh, name)
    layout.prop(wanted.regularise, "boundary")
    layout.operator("flexmaps.regularise", icon="MOD_SMOOTH")


def _border(layout: Any, wanted: Any) -> None:
    layout.enabled = wanted.spiral.border == "rim"
    settings_of(layout, wanted.spiral, *RIM)


def _rests(layout: Any, wanted: Any) -> None:
    obj, loads = wanted.id_data, wanted.loads
    layout.prop_search(loads, "supports", obj, "vertex_groups")
    layout.prop(wanted.simulate, "clamped")
    layout.separator()
    layout.prop_search(loads, "pulled", obj, "vertex_groups")
    for name in AXES:
        layout.prop(loads, name)


CLASSES = (
    popover("material", "Custom material", _material),
    popover("quads", "Quads", _quads),
    popover("border", "Rim", _border),
    popover("rests", "Supports and forces", _rests),
    settings_popover("base", "Base", "base", "base_height", "foot_width", "base_edge", "eyelet"),
)
