"""Building blocks of the sections: labelled rows, figures, popovers, and words in the user's language."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..bridge.store.i18n import CONTEXT
from ..bridge.store.i18n import interface as tr
from ..bridge.view.widths import lines, room

NAMES = 0.4  # share of a row for the label before its value, as in Blender
A_ROW = 3  # toggles or cards in a row; more would cut their words
LOW = 0.85  # height of a figure, in rows; by eye
Layout = Any  # bpy.types.UILayout, which tests stand in for

# -- rows with settings ------------------------------------------------------------------------------------------------


def line(layout: Layout, name: str) -> Layout:
    """Add a row beside a label, aligned with the settings above and below."""
    split = layout.split(factor=NAMES, align=True)
    split.use_property_split = False
    left = split.row()
    left.alignment = "RIGHT"
    left.label(text=name, translate=False)
    return split.row(align=True)


def value(layout: Layout, owner: Any, name: str, label: str, **options: Any) -> Layout:
    """Add one setting beside its short label, and return the row, for related buttons."""
    row = line(layout, label)
    row.prop(owner, name, text="", **options)
    return row


def pair(layout: Layout, label: str, owner: Any, *names: str) -> None:
    """Add several numbers in one row."""
    row = line(layout, label)
    for name in names:
        row.prop(owner, name, text="")


def choice(layout: Layout, label: str, owner: Any, name: str) -> Layout:
    """Add a choice whose values stand side by side, and return the row."""
    row = line(layout, label)
    row.prop(owner, name, expand=True)
    return row


def button(layout: Layout, idname: str, text: str, icon: str = "NONE", **options: Any) -> Any:
    """Add an operator under words that are already translated."""
    return layout.operator(idname, text=text, icon=icon, translate=False, **options)


def rare(row: Layout, name: str) -> None:
    """Add to the end of a row the popover of its rare settings."""
    row.popover(f"FLEXMAPS_PT_{name}", text="", icon="OPTIONS")


# -- popovers and menus ------------------------------------------------------------------------------------------------


class _Popover:
    bl_space_type, bl_region_type = "VIEW_3D", "HEADER"
    bl_ui_units_x = 15
    bl_translation_context = CONTEXT


def popover(name: str, label: str, draw: Callable[[Layout, Any], None]) -> type:
    """Return the class of a popover; ``draw`` gets its layout and the object's settings."""

    def drawn(self: Any, context: bpy.types.Context) -> None:
        self.layout.label(text=tr(label), translate=False)
        draw(self.layout.column(align=True), context.object.flexmaps)

    idname = f"FLEXMAPS_PT_{name}"
    members = {"bl_idname": idname, "bl_label": label, "draw": drawn, "__module__": __name__}
    return type(idname, (_Popover, bpy.types.Panel), members)


def settings_of(layout: Layout, owner: Any, *names: str) -> None:
    """Add the named settings of a group, or all, with full names and units, in the group's order."""
    for name, prop in owner.bl_rna.properties.items():
        ours = prop.type != "POINTER" and not prop.is_hidden and name != "name"
        if name in names or (ours and not names):
            layout.prop(owner, name)


def settings_popover(name: str, label: str, section: str, *names: str) -> type:
    """Return the class of a popover with settings of a section, see ``settings_of``."""
    return popover(name, label, lambda layout, wanted: settings_of(layout, getattr(wanted, section), *names))


def menu(name: str, label: str, draw: Callable[[Layout, bpy.types.Context], None]) -> type:
    """Return the class of a menu."""

    def drawn(self: Any, context: bpy.types.Context) -> None:
        self.layout.operator_context = "INVOKE_DEFAULT"  # else stages would run at once and block the window
        draw(self.layout, context)

    idname = f"FLEXMAPS_MT_{name}"
    members = {"bl_idname": idname, "bl_label": label, "draw": drawn, "__module__": __name__}
    return type(idname, (bpy.types.Menu,), members)


# -- figures -----------------------------------------------------------------------------------------------------------


def figures(layout: Layout, *rows: tuple[str, str] | tuple[str, str, bool]) -> None:
    """Draw a section's box of results: label, value, and whether the value is past its limit, which shows red."""
    box = layout.box().column(align=True)
    for label, text, *alert in rows:
        row = box.row()
        row.scale_y, row.alert = LOW, bool(alert and alert[0])
        row.label(text=label, translate=False)
        right = row.row()
        right.alignment, right.alert = "RIGHT", row.alert
        right.label(text=text, translate=False)


def sentence(layout: Layout, context: bpy.types.Context, text: str, most: int = 99, units: int = 0) -> None:
    """Draw a sentence over as many lines as the sidebar's width needs, or a popover's width of ``units``."""
    column = layout.column(align=True)
    for line in lines(text, room(context) if not units else 20 * units - 20, most):
        row = column.row()
        row.scale_y = LOW
        row.label(text=line, translate=False)


# -- formatting --------------------------------------------------------------------------------------------------------


def decimals(block: dict[str, Any], key: str, digits: int, unit: str = "") -> str:
    number = block.get(key)
    return "-" if number is None else f"{number:.{digits}f}{unit}"


def percent(block: dict[str, Any], key: str) -> str:
    share = block.get(key)
    return "-" if share is None else f"{100 * share:.1f} %"


def duration(minutes: float) -> str:
    return f"{max(minutes, 1):.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"
