"""Convert a .po file of translations to the table that Blender expects."""

from __future__ import annotations

from pathlib import Path

from ...engine.params import SHOWN, ObjectSettings, every_setting
from .i18n import CONTEXT

CONTEXTS = ("*", "Operator", CONTEXT)  # Blender's default context, its context of operators, and FlexMaps' own


def read_translations(file: Path) -> dict[tuple[str, str], str]:
    """Return (context, English text) -> translation from the entries of a .po file, without fuzzy ones.

    An entry is repeated for every context that has no entry for its text; the name of a setting also with its unit.
    """
    import polib

    entries = [entry for entry in polib.pofile(str(file)) if entry.translated()]
    known = {(entry.msgctxt or CONTEXTS[0], entry.msgid): entry.msgstr for entry in entries}
    for _, f in every_setting(ObjectSettings):
        label, unit = f.metadata["label"], SHOWN[f.metadata["unit"]][1]
        if unit and (CONTEXTS[0], label) in known:
            known[CONTEXTS[0], f"{label} ({unit})"] = f"{known[CONTEXTS[0], label]} ({unit})"
    # entries of the default context come last, so that they win where a text has translations in several contexts
    ordered = sorted(known.items(), key=lambda entry: entry[0][0] == CONTEXTS[0])
    return {(context, text): words for context in CONTEXTS for (_, text), words in ordered} | known
