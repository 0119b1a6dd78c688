"""Small pieces that the sub-panels are put together from."""

from __future__ import annotations

import textwrap
from dataclasses import MISSING, fields
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

# pixels at an interface scale of 1: what frames and an icon take of a line, a letter of Blender's font in the mean, and the
# sidebar's width where no window tells it; read off pictures of the sidebar
MARGIN, LETTER, UNKNOWN = 60, 6.5, 240
LEAST = 12  # letters of a line at least, however narrow the sidebar is; by eye
BOX = 20  # pixels of a box to tick; likewise
# letters that a value of each type takes, with what frames it; by eye
VALUE = {"BOOLEAN": 3, "INT": 6, "FLOAT": 8, "ENUM": 12, "STRING": 10}


def settings_rows(layout: bpy.types.UILayout, properties: Any, cls: type, names: tuple[str, ...] = ()) -> None:
    """Settings of a dataclass, in its order: those named, or all."""
    for f in fields(cls):
        if f.default is not MISSING and (not names or f.name in names):
            setting_row(layout, properties, f.name)


def setting_row(layout: bpy.types.UILayout, properties: Any, name: str) -> None:
    """One setting: its name in its field, or above it where the sidebar is too narrow for the whole name and a value."""
    prop = properties.bl_rna.properties[name]
    label = iface_(prop.name)
    if len(label) + VALUE[prop.type] <= _letters(bpy.context, MARGIN):
        layout.prop(properties, name)
    elif prop.type == "BOOLEAN":
        row = layout.row()
        row.prop(properties, name, text="")
        wrapped(row.column(), bpy.context, label, beside=BOX)
    else:
        column = layout.column(align=True)
        wrapped(column, bpy.context, label)
        column.prop(properties, name, text="")


def fold(layout: bpy.types.UILayout, idname: str, label: str) -> bpy.types.UILayout | None:
    """A column under a heading that opens and closes, closed at first; ``None`` while it is closed."""
    header, body = layout.panel(idname, default_closed=True)
    header.label(text=label)
    return None if body is None else body.column(align=True)


def more(layout: bpy.types.UILayout, idname: str, properties: Any, cls: type, but: tuple[str, ...] = ()) -> None:
    """A fold with the settings of a dataclass that are not named in ``but``."""
    body = fold(layout, idname, "More settings")
    if body is not None:
        settings_rows(body, properties, cls, tuple(f.name for f in fields(cls) if f.name not in but))


def heading(layout: bpy.types.UILayout, label: str) -> None:
    """A line that parts what follows from what stands above."""
    layout.separator()
    layout.label(text=label)


def numbers(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A box for ``number``."""
    return layout.box().column(align=True)


def number(box: bpy.types.UILayout, label: str, value: str, alert: bool = False) -> None:
    """What it is, and how much, in one line or, where the sidebar is too narrow, two; red where it is past its limit."""
    narrow = len(iface_(label)) + len(value) > _letters(bpy.context, MARGIN)
    row = (box.column(align=True) if narrow else box).row()
    row.alert = alert
    row.label(text=label)
    right = (box.row() if narrow else row).row()
    right.alert = alert
    right.alignment = "RIGHT"
    right.label(text=value, translate=False)


def choice_row(layout: bpy.types.UILayout, owner: Any, name: str, kinds: tuple[tuple[str, str], ...]) -> None:
    """Buttons that switch the overlay; the one that is on is pressed in. Two a row where more would not be readable."""
    narrow = max(len(iface_(label)) for _, label in kinds) * len(kinds) > _letters(bpy.context, MARGIN)
    column = layout.column(align=True)
    for k, (kind, label) in enumerate(kinds):
        if k == 0 or (narrow and k % 2 == 0):
            row = column.row(align=True)
            row.label(text="", icon="OVERLAY" if k == 0 else "BLANK1")
        row.operator("flexmaps.overlay", text=label, depress=getattr(owner, name) == kind).kind = kind


def wrapped(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE", beside: int = 0
) -> None:
    """A sentence over as many lines as the sidebar's width needs; ``beside``: pixels taken by what stands to its right."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    for k, line in enumerate(textwrap.wrap(iface_(text), max(LEAST, _letters(context, MARGIN + beside)))):
        column.label(text=line, icon=icon if k == 0 else "BLANK1", translate=False)


def _letters(context: bpy.types.Context, taken: int) -> int:
    """About how many letters the sidebar has room for in a line of which so many pixels are ``taken``."""
    region = context.region
    unit = context.preferences.system.ui_scale or 1.0  # 0 without a window
    width = region.width if region is not None else UNKNOWN
    return int((width / unit - taken) / LETTER)


# -- how values are written ----------------------------------------------------------------------------------------------


def decimals(block: dict[str, Any], key: str, digits: int, unit: str = "") -> str:
    value = block.get(key)
    return "-" if value is None else f"{value:.{digits}f}{unit}"


def percent(block: dict[str, Any], key: str) -> str:
    value = block.get(key)
    return "-" if value is None else f"{100 * value:.1f} %"


def span(block: dict[str, Any], key: str, unit: str) -> str:
    """The smallest and the largest of [smallest, mean, largest]."""
    values = block.get(key)
    return "-" if not values else f"{values[0]:.3g} \N{EN DASH} {values[-1]:.3g}{unit}"


def duration(minutes: float) -> str:
    return f"{max(minutes, 1):.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"
