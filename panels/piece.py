"""The section *Piece*: settings to decide before any stage runs (material, size of quads, border, supports)."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store import derived_properties, dimensions
from ..engine.figures import format_length
from ..engine.params import MaterialParams
from .rows import (
    add_settings,
    choice_row,
    labelled_row,
    options_button,
    popover,
    setting_row,
    settings_popover,
    settings_row,
    tr,
)

FORCE_SETTINGS = "force_x", "force_y", "force_z"
RIM_SETTINGS = "rim_width", "rim_hole", "rim_spacing"


def draw(body: Any, context: bpy.types.Context) -> None:
    obj = context.object
    settings = obj.flexmaps
    column = body.column(align=True)
    options_button(setting_row(column, settings.material, "material", tr("Material")), "material")
    setting_row(column, settings.spiral, "thickness", tr("Thickness"))
    settings_row(column, tr("Sheet"), settings.sheet, "sheet_width", "sheet_height")
    choice_row(column, tr("Lasts"), settings.material, "lasts")

    column = body.column(align=True)
    row = setting_row(column, settings.remesh, "quads", tr("Quads"))
    row.operator("flexmaps.quad_remesh", text="", icon="FILE_REFRESH")
    options_button(row, "quads")
    row = labelled_row(column, "")
    row.active = False
    edge = dimensions.estimate_quad_edge(obj, context.scene)
    row.label(text=tr("spirals of {}", format_length(edge)) if edge else "", translate=False)
    setting_row(column, settings.layout, "symmetric", tr("Symmetry"))

    row = choice_row(body, tr("Border"), obj, "flexmaps_border")
    row.enabled = derived_properties.has_border(obj.data)
    options_button(row, "border")

    column = body.column(align=True)
    choice_row(column, tr("Rests"), obj, "flexmaps_rests")
    held = column.column(align=True)
    held.enabled = obj.flexmaps_rests != "FREE"
    row = labelled_row(held, tr("Held at"))
    row.operator("flexmaps.hold_selection", text=tr("Selection"), translate=False)
    options_button(row, "rests")
    hangs = obj.flexmaps_rests == "HANGS"
    row = setting_row(held, settings.base, "eyelet" if hangs else "base", tr("Eyelets") if hangs else tr("Base"))
    options_button(row, "base")
    setting_row(held, settings.simulate, "gravity", tr("Own weight"))


def heading_text(context: bpy.types.Context) -> str:
    """Return the text beside the folded section's heading: the choices of border, support and duration of loads."""
    obj = context.object
    border = [(obj, "flexmaps_border")] if derived_properties.has_border(obj.data) else []
    chosen = *border, (obj, "flexmaps_rests"), (obj.flexmaps.material, "lasts")
    names = [owner.bl_rna.properties[name].enum_items[getattr(owner, name)].name for owner, name in chosen]
    return ", ".join(map(tr, names))


def _draw_material(layout: Any, settings: Any) -> None:
    """Draw the properties of the material; they can be edited only if the material is "custom"."""
    layout.enabled = settings.material.material == "custom"
    add_settings(layout, settings.material, *MATERIAL_SETTINGS)


MATERIAL_SETTINGS = tuple(name for name in MaterialParams.__dataclass_fields__ if name not in ("material", "lasts"))


def _draw_quads(layout: Any, settings: Any) -> None:
    for name in ("smooth", "crumbs"):
        layout.prop(settings.remesh, name)
    layout.prop(settings.regularise, "boundary")
    layout.operator("flexmaps.regularise", icon="MOD_SMOOTH")


def _draw_border(layout: Any, settings: Any) -> None:
    layout.enabled = settings.spiral.border == "rim"
    add_settings(layout, settings.spiral, *RIM_SETTINGS)


def _draw_supports(layout: Any, settings: Any) -> None:
    obj, loads = settings.id_data, settings.loads
    layout.prop_search(loads, "supports", obj, "vertex_groups")
    layout.prop(settings.simulate, "clamped")
    layout.separator()
    layout.prop_search(loads, "pulled", obj, "vertex_groups")
    for name in FORCE_SETTINGS:
        layout.prop(loads, name)


CLASSES = (
    popover("material", "Custom material", _draw_material),
    popover("quads", "Quads", _draw_quads),
    popover("border", "Rim", _draw_border),
    popover("rests", "Supports and forces", _draw_supports),
    settings_popover("base", "Base", "base", "base_height", "foot_width", "base_edge", "eyelet"),
)
