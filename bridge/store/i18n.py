"""Translate texts into the user's language with Blender's translation system."""

from __future__ import annotations

import bpy

# translation context of FlexMaps: keeps Blender's own translation of a word, in another sense, from being used
CONTEXT = "FlexMaps"


def translate(text: str, *values: object) -> str:
    """Translate a message into the language that Blender uses for reports, and insert the values at ``{}``.

    Parameters
    ----------
    text : English text
    values : values for its places ``{}``
    """
    translated: str = bpy.app.translations.pgettext_rpt(text)
    return translated.format(*values) if values else translated


def button_name(label: str) -> str:
    """Translate the label of an operator's button into the language of the interface."""
    return bpy.app.translations.pgettext_iface(label, "Operator")


def format_range(low: str, high: str, unit: str = "") -> str:
    """Return a range such as "2 to 3 mm", or a single number where both ends are equal.

    Parameters
    ----------
    low, high : formatted numbers
    unit : text appended unchanged, such as " mm"
    """
    return f"{high if low == high else interface('{} to {}', low, high)}{unit}"


def interface(text: str, *values: object) -> str:
    """Translate a label of the sidebar into the language of the interface, and insert the values at ``{}``.

    Parameters
    ----------
    text : English text
    values : values for its places ``{}``
    """
    translated: str = bpy.app.translations.pgettext_iface(text, CONTEXT)
    return translated.format(*values) if values else translated


def panels(count: int) -> str:
    """Return, for example, "1 panel" or "4 panels"."""
    return interface("{} panel" if count == 1 else "{} panels", count)


def sheets(count: int) -> str:
    """Return, for example, "1 sheet" or "4 sheets"."""
    return interface("{} sheet" if count == 1 else "{} sheets", count)


def quads(count: int) -> str:
    """Return, for example, "1 quad" or "4 quads"."""
    return interface("{} quad" if count == 1 else "{} quads", count)
