"""Small pieces that the sub-panels are put together from."""

from __future__ import annotations

from dataclasses import MISSING, fields
from functools import lru_cache
from typing import Any

import blf
import bpy
from bpy.app.translations import pgettext_iface as iface_

# pixels at an interface scale of 1, read off pictures of the sidebar: what tabs and edges take of a line, what a box takes more, an
# icon, the space between two words that stand side by side, what a button has beside its words, a box to tick, and the sidebar's
# width where no window tells it
FRAMES, INSET, ICON, GAP, EDGES, TICK, UNKNOWN = 58, 14, 20, 8, 10, 20, 291
LEAST = 78  # pixels of a line of a sentence at least, however narrow the sidebar is: a dozen letters; by eye
# pixels that a value of each type takes, with what frames it; by eye
VALUE = {"BOOLEAN": 20, "INT": 39, "FLOAT": 52, "ENUM": 78, "STRING": 65}


def settings_rows(layout: bpy.types.UILayout, properties: Any, cls: type, names: tuple[str, ...] = ()) -> None:
    """Settings of a dataclass, in its order: those named, or all."""
    for f in fields(cls):
        if f.default is not MISSING and (not names or f.name in names):
            setting_row(layout, properties, f.name)


def setting_row(layout: bpy.types.UILayout, properties: Any, name: str) -> None:
    """One setting: its name in its field, or above it where the sidebar is too narrow for the whole name and a value."""
    prop = properties.bl_rna.properties[name]
    label = iface_(prop.name)
    if _wide(label) + VALUE[prop.type] <= _room(bpy.context):
        layout.prop(properties, name)
    elif prop.type == "BOOLEAN":
        row = layout.row()
        row.prop(properties, name, text="")
        wrapped(row.column(), bpy.context, label, beside=TICK)
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
    narrow = _wide(iface_(label)) + GAP + _wide(value) > _room(bpy.context) - INSET
    row = (box.column(align=True) if narrow else box).row()
    row.alert = alert
    row.label(text=label)
    right = (box.row() if narrow else row).row()
    right.alert = alert
    right.alignment = "RIGHT"
    right.label(text=value, translate=False)


def choice_row(layout: bpy.types.UILayout, owner: Any, name: str, kinds: tuple[tuple[str, str], ...]) -> None:
    """Buttons that switch the overlay; the one that is on is pressed in. Fewer a row where more would not be readable."""
    button = max(_wide(iface_(label)) for _, label in kinds) + EDGES
    a_row = next((k for k in (len(kinds), 2) if k * button <= _room(bpy.context) - ICON), 1)
    column = layout.column(align=True)
    for k, (kind, label) in enumerate(kinds):
        if k % a_row == 0:
            row = column.row(align=True)
            row.label(text="", icon="BLANK1" if k else "OVERLAY")
        row.operator("flexmaps.overlay", text=label, depress=getattr(owner, name) == kind).kind = kind


def wrapped(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE", beside: int = 0
) -> None:
    """A sentence over as many lines as the sidebar's width needs; ``beside``: pixels taken by what stands to its right."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    below, taken = ("NONE", 0) if icon == "NONE" else ("BLANK1", ICON)
    for k, line in enumerate(_lines(iface_(text), max(LEAST, _room(context) - INSET - taken - beside))):
        column.label(text=line, icon=icon if k == 0 else below, translate=False)


def first_that_fits(*texts: str) -> str:
    """The first of some words for a button with an icon that the sidebar shows whole; the last where none is."""
    return next((text for text in texts if _wide(text) <= _room(bpy.context) - ICON - EDGES), texts[-1])


def _room(context: bpy.types.Context) -> float:
    """Pixels, at an interface scale of 1, that the sidebar has for the words of one line."""
    region = context.region
    return (UNKNOWN if region is None else region.width / _unit()) - FRAMES


def _unit() -> float:
    return bpy.context.preferences.system.ui_scale or 1.0  # 0 without a window


def _wide(text: str) -> float:
    """Pixels, at an interface scale of 1, that some words take in Blender's font."""
    unit = _unit()
    return _measured(text, bpy.context.preferences.ui_styles[0].widget.points * unit) / unit


@lru_cache(4096)
def _measured(text: str, size: float) -> float:
    blf.size(0, size)
    return float(blf.dimensions(0, text)[0])


def _lines(text: str, room: float) -> list[str]:
    """A sentence in lines that have room; a longer word, such as a path, goes on in the next line."""
    lines: list[str] = []
    for word in text.split():
        if lines and _wide(f"{lines[-1]} {word}") <= room:
            lines[-1] += f" {word}"
            continue
        while len(word) > 1 and _wide(word) > room:
            most = next((k for k in range(len(word) - 1, 1, -1) if _wide(word[:k]) <= room), 1)
            lines.append(word[:most])
            word = word[most:]
        lines.append(word)
    return lines


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
