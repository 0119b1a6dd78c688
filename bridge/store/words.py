"""Lines for the user in their language, by Blender's own translations."""

from __future__ import annotations

from typing import Any

import bpy


def told(text: str, *values: Any) -> str:
    """The translation of a line, as the preferences want it for reports, with the values in its places ``{}``."""
    found: str = bpy.app.translations.pgettext_rpt(text)
    return found.format(*values) if values else found


def named(button: str) -> str:
    """What stands on a button, as the preferences want it for the interface."""
    return bpy.app.translations.pgettext_iface(button, "Operator")
