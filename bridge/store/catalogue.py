"""Convert a file of translations to the table that Blender takes."""

from __future__ import annotations

from pathlib import Path

from ...engine.params import SHOWN, ObjectSettings, every_setting
from .i18n import CONTEXT

CONTEXTS = ("*", "Operator", CONTEXT)  # Blender's default context, its context of buttons, and our own


def table(file: Path) -> dict[tuple[str, str], str]:
    """Return (context, English text) -> translation for a language, of the entries that are translated and not fuzzy.

    A message also stands for every context in which it has no entry of its own; names of settings also with their units.
    """
    import polib

    entries = [entry for entry in polib.pofile(str(file)) if entry.translated()]
    known = {(entry.msgctxt or CONTEXTS[0], entry.msgid): entry.msgstr for entry in entries}
    for _, f in every_setting(ObjectSettings):
        label, unit = f.metadata["label"], SHOWN[f.metadata["unit"]][1]
        if unit and (CONTEXTS[0], label) in known:
            known[CONTEXTS[0], f"{label} ({unit})"] = f"{known[CONTEXTS[0], label]} ({unit})"
    # where contexts differ, the default context wins for ours too
    ordered = sorted(known.items(), key=lambda entry: entry[0][0] == CONTEXTS[0])
    return {(context, text): words for context in CONTEXTS for (_, text), words in ordered} | known
