"""Lines for the user in their language, by Blender's own translations."""

from __future__ import annotations

from typing import Any

import bpy

# of our own translations: where Blender has the same word for something else, it does not answer first
CONTEXT = "FlexMaps"


def translate(text: str, *values: Any) -> str:
    """The translation of a line, as the preferences want it for reports, with the values in its places ``{}``."""
    translated: str = bpy.app.translations.pgettext_rpt(text)
    return translated.format(*values) if values else translated


def button_name(label: str) -> str:
    """What stands on a button, as the preferences want it for the interface."""
    return bpy.app.translations.pgettext_iface(label, "Operator")


def span(low: str, high: str, unit: str = "") -> str:
    """For example "2 to 3 mm"; one figure where both read alike."""
    return f"{high if low == high else interface('{} to {}', low, high)}{unit}"


def interface(text: str, *values: Any) -> str:
    """The translation of words in the sidebar, as the preferences want it for the interface, with the values in its places."""
    translated: str = bpy.app.translations.pgettext_iface(text, CONTEXT)
    return translated.format(*values) if values else translated


def panels(count: int) -> str:
    """For example "1 panel" or "4 panels"."""
    return interface("{} panel" if count == 1 else "{} panels", count)


def sheets(count: int) -> str:
    """For example "1 sheet" or "4 sheets"."""
    return interface("{} sheet" if count == 1 else "{} sheets", count)


def quads(count: int) -> str:
    """For example "1 quad" or "4 quads"."""
    return interface("{} quad" if count == 1 else "{} quads", count)
