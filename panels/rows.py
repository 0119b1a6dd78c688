"""Building blocks of the sidebar's sections: labelled rows, boxes of results, popovers, menus, number formats."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..bridge.store.i18n import CONTEXT
from ..bridge.store.i18n import interface as tr
from ..bridge.view.text_layout import break_lines, line_width

LABEL_SHARE = 0.4  # fraction of a row's width for the label before its value, as in Blender's own panels
PER_ROW = 3  # toggles or cards side by side; more would truncate their labels
TEXT_HEIGHT = 0.85  # height of a line of results or of a sentence, in rows; smaller is denser; chosen by eye
Layout = Any  # bpy.types.UILayout, or a test's stand-in

# -- rows with settings ------------------------------------------------------------------------------------------------


def labelled_row(layout: Layout, name: str) -> Layout:
    """Add a label with a row to its right, aligned with the settings above and below; return the row."""
    split = layout.split(factor=LABEL_SHARE, align=True)
    split.use_property_split = False
    left = split.row()
    left.alignment = "RIGHT"
    left.label(text=name, translate=False)
    return split.row(align=True)


def setting_row(layout: Layout, owner: Any, name: str, label: str, **options: Any) -> Layout:
    """Add a setting with a short label; return its row, for further buttons.

    Parameters
    ----------
    layout : Blender's layout
    owner : property group with the setting
    name : name of the setting
    label : translated label
    options : further arguments of ``UILayout.prop``
    """
    row = labelled_row(layout, label)
    row.prop(owner, name, text="", **options)
    return row


def settings_row(layout: Layout, label: str, owner: Any, *names: str) -> None:
    """Add several settings (``names`` of the group ``owner``) side by side behind a label."""
    row = labelled_row(layout, label)
    for name in names:
        row.prop(owner, name, text="")


def choice_row(layout: Layout, label: str, owner: Any, name: str) -> Layout:
    """Add a setting with a label, and its possible values as buttons side by side; return the row."""
    row = labelled_row(layout, label)
    row.prop(owner, name, expand=True)
    return row


def button(layout: Layout, idname: str, text: str, icon: str = "NONE", **options: Any) -> Any:
    """Add an operator's button with a text that is already translated; return the operator's properties."""
    return layout.operator(idname, text=text, icon=icon, translate=False, **options)


def options_button(row: Layout, name: str) -> None:
    """Add a button to the end of a row, which opens the popover ``name`` with rarely used settings."""
    row.popover(f"FLEXMAPS_PT_{name}", text="", icon="OPTIONS")


# -- popovers and menus ------------------------------------------------------------------------------------------------


class _Popover:
    bl_space_type, bl_region_type = "VIEW_3D", "HEADER"
    bl_ui_units_x = 15
    bl_translation_context = CONTEXT


def popover(name: str, label: str, draw: Callable[[Layout, Any], None]) -> type:
    """Make the panel class of a popover.

    Parameters
    ----------
    name : end of its ``bl_idname``
    label : its heading
    draw : function of the popover's layout and the active object's settings
    """

    def drawn(self: Any, context: bpy.types.Context) -> None:
        self.layout.label(text=tr(label), translate=False)
        draw(self.layout.column(align=True), context.object.flexmaps)

    idname = f"FLEXMAPS_PT_{name}"
    members = {"bl_idname": idname, "bl_label": label, "draw": drawn, "__module__": __name__}
    return type(idname, (_Popover, bpy.types.Panel), members)


def add_settings(layout: Layout, owner: Any, *names: str) -> None:
    """Add settings of a group with their full names and units, in the group's order.

    Parameters
    ----------
    layout : Blender's layout
    owner : the property group
    names : names of the settings; default all visible ones
    """
    for name, prop in owner.bl_rna.properties.items():
        ours = prop.type != "POINTER" and not prop.is_hidden and name != "name"
        if name in names or (ours and not names):
            layout.prop(owner, name)


def settings_popover(name: str, label: str, section: str, *names: str) -> type:
    """Make the panel class of a popover with settings of one section of the object's settings.

    Parameters
    ----------
    name, label : as in ``popover``
    section : the section, such as "export"
    names : names of the settings; default all visible ones
    """
    return popover(name, label, lambda layout, settings: add_settings(layout, getattr(settings, section), *names))


def menu(name: str, label: str, draw: Callable[[Layout, bpy.types.Context], None]) -> type:
    """Make the class of a menu.

    Parameters
    ----------
    name : end of its ``bl_idname``
    label : its heading
    draw : function of the menu's layout and Blender's context
    """

    def drawn(self: Any, context: bpy.types.Context) -> None:
        self.layout.operator_context = "INVOKE_DEFAULT"  # otherwise stages would block the window while they run
        draw(self.layout, context)

    idname = f"FLEXMAPS_MT_{name}"
    members = {"bl_idname": idname, "bl_label": label, "draw": drawn, "__module__": __name__}
    return type(idname, (bpy.types.Menu,), members)


# -- figures -----------------------------------------------------------------------------------------------------------


def results_box(layout: Layout, *rows: tuple[str, str] | tuple[str, str, bool]) -> None:
    """Draw a box of results.

    Parameters
    ----------
    layout : Blender's layout
    rows : label, value, and optionally whether the value is past its limit; such values are drawn red
    """
    box = layout.box().column(align=True)
    for label, text, *alert in rows:
        row = box.row()
        row.scale_y, row.alert = TEXT_HEIGHT, bool(alert and alert[0])
        row.label(text=label, translate=False)
        right = row.row()
        right.alignment, right.alert = "RIGHT", row.alert
        right.label(text=text, translate=False)


def wrapped_text(layout: Layout, context: bpy.types.Context, text: str, max_lines: int = 99, units: int = 0) -> None:
    """Draw a sentence, broken into lines that fit the sidebar or a popover.

    Parameters
    ----------
    layout : Blender's layout
    context : Blender's context
    text : the sentence
    max_lines : largest number of lines; the rest is cut off
    units : width of the popover in Blender's UI units; 0 for the sidebar
    """
    column = layout.column(align=True)
    for line in break_lines(text, line_width(context) if not units else 20 * units - 20, max_lines):
        row = column.row()
        row.scale_y = TEXT_HEIGHT
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
