"""Translations: a language has every message of the program and no other, and values keep their places in it.

Blender as a module is built without languages, so nothing is looked up here; the files are held against the code.
"""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import polib
import pytest
from flexmaps import operators
from flexmaps.bridge.store import catalogue
from flexmaps.bridge.store.i18n import translate
from flexmaps.engine.params import SHOWN, ObjectSettings
from flexmaps.panels import translations

LANGUAGES = sorted(translations.FOLDER.glob("*.po"))
HOW = "; run: python3 tools/dev.py python tools/messages.py"


def keys(file: polib.POFile) -> set[tuple[str, str]]:
    return {(entry.msgctxt or "", entry.msgid) for entry in file if not entry.obsolete}


@pytest.fixture(params=LANGUAGES, ids=lambda file: file.stem)
def language(request: Any) -> Path:
    return request.param


def test_the_template_has_all_messages(messages: ModuleType) -> None:
    made, stored = messages.build_template(), polib.pofile(str(translations.FOLDER / "flexmaps.pot"))
    assert keys(stored) == keys(made), f"missing or stale in the template{HOW}"
    found = {text for _, text in keys(made)}
    assert {cls.bl_label for cls in operators.CLASSES if hasattr(cls, "bl_label")} <= found
    # one of each place that messages come from: a setting, its explanation, the sidebar, a report, a grey button
    assert {
        "Smallest width",
        "Width of the thinnest arm: thinner arms bend into tighter curves and break more easily",
        "Distortion, largest",
        "Scaled to {}, spirals of {}",
        "Select a mesh object",
    } <= found


def test_a_language_has_the_templates_messages(language: Path, messages: ModuleType) -> None:
    file = polib.pofile(str(language))
    assert keys(file) == keys(messages.build_template()), f"missing or stale in {language.name}{HOW}"
    assert not file.fuzzy_entries() and not file.untranslated_entries()


def test_values_keep_their_places(language: Path) -> None:
    for entry in polib.pofile(str(language)):
        assert re.findall(r"{[^}]*}", entry.msgid) == re.findall(r"{[^}]*}", entry.msgstr), entry.msgid
        assert entry.msgstr.strip()


def test_what_is_not_sure_stays_english(tmp_path: Path) -> None:
    file = polib.POFile()
    for text, flags, context, obsolete in (
        ("sure", [], None, False), ("unsure", ["fuzzy"], None, False), ("gone", [], None, True), ("pressed", [], "Operator", False),
        ("sure", [], "Operator", False),
    ):  # fmt: skip
        words = f"{text} {context or ''}".strip()
        file.append(polib.POEntry(msgid=text, msgstr=words, msgctxt=context, flags=flags, obsolete=obsolete))
    file.append(polib.POEntry(msgid="empty", msgstr=""))
    file.save(str(tmp_path / "xx.po"))
    assert catalogue.read_translations(tmp_path / "xx.po") == {
        ("*", "sure"): "sure",
        ("Operator", "sure"): "sure Operator",
        ("*", "pressed"): "pressed Operator",
        ("Operator", "pressed"): "pressed Operator",
        ("FlexMaps", "sure"): "sure",
        ("FlexMaps", "pressed"): "pressed Operator",
    }


def test_said_in_the_users_language(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blender as a module knows no languages: its dictionary is played here."""
    german = {text: words for (_, text), words in catalogue.read_translations(translations.FOLDER / "de.po").items()}
    played = SimpleNamespace(
        app=SimpleNamespace(translations=SimpleNamespace(pgettext_rpt=lambda text: german.get(text, text)))
    )
    assert translate("{} frames in {}", 3, "{x}") == "3 frames in {x}"
    monkeypatch.setattr("flexmaps.bridge.store.i18n.bpy", played)
    assert translate("{} frames in {}", 3, "{x}") == "3 Bilder in {x}"
    assert translate("Select a mesh object") == "Ein Netzobjekt auswählen"
    assert translate("'{x}' has a name of its own") == "'{x}' has a name of its own"


def test_units_stay_with_their_names(language: Path) -> None:
    found = catalogue.read_translations(language)
    for block in fields(ObjectSettings):
        for f in fields(block.default_factory):  # type: ignore[arg-type]
            unit = SHOWN[f.metadata["unit"]][1]
            if unit:
                assert found["*", f"{f.metadata['label']} ({unit})"].endswith(f"({unit})")
