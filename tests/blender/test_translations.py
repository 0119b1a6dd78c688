"""Translations: every name in the sidebar has one, none is left over, and places for values stay.

Blender as a module is built without languages, so nothing is looked up here; the dictionaries are held against the texts.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from flexmaps import operators, panels
from flexmaps.bridge.store import states
from flexmaps.bridge.store.i18n import translate
from flexmaps.engine.params import SHOWN, ObjectSettings
from flexmaps.panels import translations

FOLDER = Path(panels.__file__).parent
SHOWING = {"number", "fold", "iface_", "wrapped", "label", "operator"}  # calls in panels whose texts are seen
# the same in every language, or names of things
SAME = {"FlexMaps", "SVG", "DXF", "PDF", "R2010", "R12", "3MF", "STL", "MDF", "VeroWhite", "RMSE", "Gauss-Newton", "L-BFGS-B",
        "Delrin (POM)", "Delrin", "Material", "Render"}  # fmt: skip


def of_settings() -> set[str]:
    """Names of settings and choices, without what belongs to pictures only."""
    found = set()
    for block in fields(ObjectSettings):
        if block.name not in {"preview", "film", "render"}:
            for f in fields(block.default_factory):  # type: ignore[arg-type]
                found |= {f.metadata["label"], *(choice[1] for choice in f.metadata["choices"])}
    return found


def of_panels() -> set[str]:
    """Texts in the panels' own sources."""
    found = {"FlexMaps presets", *(cls.bl_label for cls in panels.CLASSES)}
    for file in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and _name(node.func) in SHOWING:
                words = [*node.args, *(k.value for k in node.keywords if k.arg in {"text", "label"})]
                found |= {w.value for w in words if isinstance(w, ast.Constant) and isinstance(w.value, str)}
            elif isinstance(node, ast.Tuple) and len(node.elts) == 2:  # of choice_row
                found |= {e.value for e in node.elts[1:] if isinstance(e, ast.Constant) and isinstance(e.value, str)}
    return {text for text in found if text[:1].strip() and not text.startswith("flexmaps")}


def of_tips() -> set[str]:
    """What pops up under the pointer; materials name their sources there, which stay."""
    found = {(cls.__doc__ or "").strip() for cls in operators.CLASSES}
    for block in fields(ObjectSettings):
        for f in fields(block.default_factory):  # type: ignore[arg-type]
            choices = () if f.name == "material" else f.metadata["choices"]
            found |= {f.metadata["help"], *(choice[2] for choice in choices)}
    return found


def of_messages() -> set[str]:
    """Lines that are told in the user's language, and why a button is grey."""
    found = set()
    for file in (*(FOLDER.parent / "operators").glob("*.py"), *(FOLDER.parent / "bridge").glob("*.py")):
        tree = ast.parse(file.read_text())
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and _name(node.func) == "told"]
        found |= {node.args[0].value for node in calls if isinstance(node.args[0], ast.Constant)}
        named = {name.id for node in calls if isinstance(name := node.args[0], ast.Name)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in named:
                found |= set(_texts(node.value))
            if isinstance(node, ast.FunctionDef) and node.name in {"obstacle", "unusable"}:
                for line in ast.walk(node):
                    if isinstance(line, ast.Return) and line.value is not None:
                        found |= set(_texts(line.value))
    return found


def _texts(value: ast.expr) -> Iterator[str]:
    """Texts that an expression may be, if it is no call."""
    if isinstance(value, ast.Constant) and isinstance(value.value, str):
        yield value.value
    elif isinstance(value, ast.IfExp):
        yield from _texts(value.body)
        yield from _texts(value.orelse)


def _name(func: ast.expr) -> str:
    return func.id if isinstance(func, ast.Name) else func.attr if isinstance(func, ast.Attribute) else ""


def everything() -> set[str]:
    found = of_settings() | of_panels() | of_tips() | of_messages() | {cls.bl_label for cls in operators.CLASSES}
    return found | {
        *states.WHY.values(),
        states.SETTING,
        states.EARLIER,
        *(c.on_stop for c in operators.CLASSES if hasattr(c, "on_stop")),
    }


@pytest.fixture(params=translations.LANGUAGES)
def words(request: Any) -> dict[str, str]:
    return translations.LANGUAGES[request.param]


def test_stages_buttons_and_reasons_have_their_words(words: dict[str, str]) -> None:
    seen = [cls for cls in panels.CLASSES if cls.bl_region_type == "UI"]  # Blender names the list after its last preset
    assert not {cls.bl_label for cls in (*seen, *operators.CLASSES)} - set(words) - SAME
    assert not {*states.WHY.values(), states.SETTING, states.EARLIER} - set(words)


def test_nearly_every_name_has_its_word_and_few_words_are_left_over(words: dict[str, str]) -> None:
    """A new or renamed setting may stay English for a while."""
    wanted = of_settings() - SAME
    assert len(wanted & set(words)) >= 0.85 * len(wanted), wanted - set(words)
    left = set(words) - everything()
    assert len(left) <= 0.05 * len(words), left


def test_explanations_and_messages_have_their_words(words: dict[str, str]) -> None:
    assert len(of_messages()) > 30 and len(of_tips()) > 120
    assert not of_messages() - set(words)
    wanted = of_tips()
    assert len(wanted & set(words)) >= 0.9 * len(wanted), wanted - set(words)


def test_told_in_the_users_language(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blender as a module knows no languages: its dictionary is played here."""
    german = translations.LANGUAGES["de_DE"]
    played = SimpleNamespace(
        app=SimpleNamespace(translations=SimpleNamespace(pgettext_rpt=lambda text: german.get(text, text)))
    )
    assert translate("{} frames in {}", 3, "{x}") == "3 frames in {x}"
    monkeypatch.setattr("flexmaps.bridge.store.i18n.bpy", played)
    assert translate("{} frames in {}", 3, "{x}") == "3 Bilder in {x}"
    assert translate("Press Spirals first") == "Erst Spiralen drücken"
    assert translate("'{x}' has a name of its own") == "'{x}' has a name of its own"


def test_values_keep_their_places(words: dict[str, str]) -> None:
    for english, translated in words.items():
        assert re.findall(r"{[^}]*}", english) == re.findall(r"{[^}]*}", translated), english
        assert translated.strip()


def test_units_stay_with_their_names(words: dict[str, str]) -> None:
    made = translations.table(words)
    for block in fields(ObjectSettings):
        for f in fields(block.default_factory):  # type: ignore[arg-type]
            unit = SHOWN[f.metadata["unit"]][1]
            if unit and f.metadata["label"] in words:
                assert made["*", f"{f.metadata['label']} ({unit})"].endswith(f"({unit})")
