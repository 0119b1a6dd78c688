"""Translations of the sidebar, its explanations and what stages report, as Blender keeps them: by language, context and English text."""

from __future__ import annotations

from dataclasses import fields

import bpy

from ..engine.params import SHOWN, ObjectSettings
from . import german, german_messages, german_tips

LANGUAGES = {"de_DE": german.WORDS | german_tips.TIPS | german_messages.MESSAGES}
CONTEXTS = ("*", "Operator")  # of labels, and of buttons


def table(words: dict[str, str]) -> dict[tuple[str, str], str]:
    """What Blender wants for a language: the words in both contexts, names of settings with their units."""
    found = dict(words)
    for block in fields(ObjectSettings):
        for f in fields(block.default_factory):  # type: ignore[arg-type]
            label, unit = f.metadata["label"], SHOWN[f.metadata["unit"]][1]
            if unit and label in words:
                found[f"{label} ({unit})"] = f"{words[label]} ({unit})"
    return {(context, text): translated for text, translated in found.items() for context in CONTEXTS}


def register() -> None:
    bpy.app.translations.register(__package__, {name: table(words) for name, words in LANGUAGES.items()})


def unregister() -> None:
    bpy.app.translations.unregister(__package__)
