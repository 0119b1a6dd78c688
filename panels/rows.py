"""Small pieces that the sub-panels are put together from."""

from __future__ import annotations

import textwrap
from dataclasses import MISSING, fields
from typing import Any

import bpy


def settings_rows(layout: bpy.types.UILayout, properties: Any, cls: type, names: tuple[str, ...] = ()) -> None:
    """Settings of a dataclass, in its order: those named, or all."""
    for f in fields(cls):
        if f.default is not MISSING and (not names or f.name in names):
            layout.prop(properties, f.name)


def more(layout: bpy.types.UILayout, idname: str, properties: Any, cls: type, but: tuple[str, ...] = ()) -> None:
    """A fold, closed at first, with the settings of a dataclass that are not named in ``but``."""
    header, body = layout.panel(idname, default_closed=True)
    header.label(text="More settings")
    if body is not None:
        names = tuple(f.name for f in fields(cls) if f.name not in but)
        settings_rows(body.column(align=True), properties, cls, names)


def numbers(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A box for ``number``."""
    return layout.box().column(align=True)


def number(box: bpy.types.UILayout, label: str, value: str, alert: bool = False) -> None:
    """One line: what it is, and how much; red where it is past its limit."""
    row = box.row()
    row.alert = alert
    row.label(text=label)
    right = row.row()
    right.alignment = "RIGHT"
    right.label(text=value)


def choice_row(layout: bpy.types.UILayout, owner: Any, name: str, kinds: tuple[tuple[str, str], ...]) -> None:
    """Buttons that switch the overlay; the one that is on is pressed in."""
    row = layout.row(align=True)
    row.label(text="Show", icon="OVERLAY")
    for kind, label in kinds:
        row.operator("flexmaps.overlay", text=label, depress=getattr(owner, name) == kind).kind = kind


def wrapped(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE") -> None:
    """A sentence over as many lines as the sidebar's width needs."""
    region = context.region
    unit = context.preferences.system.ui_scale or 1.0  # 0 without a window
    width = region.width if region is not None else 240
    column = layout.column(align=True)
    column.scale_y = 0.8
    for k, line in enumerate(textwrap.wrap(text, max(16, int((width / unit - 60) / 6.5)))):
        column.label(text=line, icon=icon if k == 0 else "BLANK1")
