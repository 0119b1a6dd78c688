"""Extraction of all messages to users, for translators: ``python3 tools/dev.py python tools/messages.py``.

Finds them in the code, writes the template ``panels/locale/flexmaps.pot``, and brings every language beside it up to date: new
messages come in without a translation, those that are gone are kept at the end of the file as obsolete.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import polib

ROOT = Path(__file__).resolve().parent.parent
LOCALE = ROOT / "panels" / "locale"
BUTTON = "Operator"  # Blender's context of what stands on buttons; what stands elsewhere has none
# calls in panels -> the context of the texts that they show
SHOWING = {"tr": "", "counted": "", "popover": "", "settings_popover": "", "menu": "", "operator": BUTTON}
# the same in every language, or names of things
SAME = {"", "FlexMaps", "SVG", "DXF", "PDF", "R2010", "R12", "3MF", "STL", "MDF", "VeroWhite", "RMSE", "Gauss-Newton",
        "L-BFGS-B", "Delrin (POM)", "Delrin", "Delrin acetal", "mm", "E", "Esq"}  # fmt: skip
Found = Iterator[tuple[str, str, str]]  # context, text, what it is


def main() -> int:
    """Write the template and bring the languages up to date; says what is left to translate."""
    template = build_template()
    template.save(str(LOCALE / "flexmaps.pot"))
    for file in sorted(LOCALE.glob("*.po")):
        language = polib.pofile(str(file), wrapwidth=WRAP)
        language.merge(template)
        language.save(str(file))
        print(f"{file.name}: {language.percent_translated()} %, {len(language.untranslated_entries())} to translate")
    return 0


WORDS = re.compile(r"[A-Z]+[a-z ]")  # start of a text; names in the code differ
WRAP = 100  # characters in a line of the files


def build_template() -> polib.POFile:
    """The template: every message once in every context, with a line on what it is."""
    template = polib.POFile(wrapwidth=WRAP)
    template.metadata = {
        "Project-Id-Version": "FlexMaps",
        "MIME-Version": "1.0",
        "Content-Type": "text/plain; charset=utf-8",
        "Content-Transfer-Encoding": "8bit",
    }
    remarks: dict[tuple[str, str], list[str]] = {}
    for context, text, what in [*_of_operators(), *_of_panels(), *_of_settings(), *_of_lines()]:
        if text.strip() not in SAME and any(letter.isalpha() for letter in text):
            remarks.setdefault((context, text), []).append(what)
    for (context, text), whats in remarks.items():
        entry = polib.POEntry(msgid=text, msgctxt=context or None, comment=", ".join(dict.fromkeys(whats)))
        if "{" in text:
            entry.flags.append("python-brace-format")
        template.append(entry)
    return template


def _of_operators() -> Found:
    """Names of buttons, their explanations, and what a stop leaves."""
    from flexmaps import operators

    for cls in operators.CLASSES:
        label = getattr(cls, "bl_label", cls.__name__)
        if hasattr(cls, "bl_label"):  # no group of properties, which has no button
            yield BUTTON, label, "button"
            yield "", (cls.__doc__ or "").strip(), f"explanation of {label}"
        for prop in inspect.get_annotations(cls, eval_str=True).values():
            options = getattr(prop, "keywords", {})
            for text in (options.get("name", ""), options.get("description", "")):
                yield "", text, f"option of {label}"
            for _, name, explanation, *_ in options.get("items", ()):
                yield "", name, f"option of {label}"
                yield "", explanation, f"option of {label}"
        if hasattr(cls, "on_stop"):
            yield "", cls.on_stop, "after a stop"


def _of_settings() -> Found:
    """Names and explanations of settings and their choices; the explanations of materials name sources, which stay."""
    from flexmaps.engine.params import ObjectSettings, every_setting

    for name, f in every_setting(ObjectSettings):
        yield "", f.metadata["label"], f"setting {name}"
        yield "", f.metadata["help"], f"explanation of {name}"
        for key, label, explanation in f.metadata["choices"]:
            yield "", label, f"choice of {name}"
            yield (
                "",
                explanation if f.name != "material" or key == "custom" else "",
                f"explanation of a choice of {name}",
            )


def _of_panels() -> Found:
    """Headings, and the texts in the sources of the sidebar."""
    for file in sorted((ROOT / "panels").glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and _name(node.func) in SHOWING:
                context = SHOWING[_name(node.func)]
                named = _name(node.func) in {"popover", "settings_popover", "menu"}
                given = node.args[1:2] if named else node.args  # an idname is before the words
                texts = [
                    *(() if context else given),
                    *(k.value for k in node.keywords if k.arg in {"text", "label"}),
                ]
                for text in (t for arg in texts for t in _texts(arg)):
                    if not text.lower().startswith(("flexmaps_", "flexmaps.")):
                        yield context, text, "sidebar"
            elif isinstance(node, ast.Tuple):
                for text in (ast.literal_eval(part) for part in node.elts if _is_text(part)):
                    if WORDS.match(text) and text != BUTTON:
                        yield "", text, "sidebar"
            elif isinstance(node, ast.Assign) and _is_text(node.value):
                name, text = _name(node.targets[0]), ast.literal_eval(node.value)
                if name == "bl_label":
                    yield "", text, "heading"
                elif name.isupper() and " " in text:
                    yield "", text, "sidebar"


def _of_lines() -> Found:
    """Lines that stages report, and why a button is grey."""
    from flexmaps.bridge.store import cures, derived_properties, finding_words, guidance
    from flexmaps.bridge.view import tab
    from flexmaps.engine import versions
    from flexmaps.engine.optimisation import optimise, wishes
    from flexmaps.engine.runs import stages

    for _, text in versions.RESULT_CHANGES:
        yield "", text, "what changed since an earlier version"
    for text in (
        *(words for _, words in cures.REPAIRS.values()),
        *cures.SINGULAR.values(),
        *(words for words, _ in finding_words.LABELS.values()),
        *(words for _, one, more in finding_words.WARNING_LABELS.values() for words in (one, more)),
        *guidance.CHANGED_PARTS.values(),
        guidance.CHANGED_SETTING,
        *guidance.RERUN_REASONS.values(),
    ):
        yield "", text, "what there is to look at, and its cure"
    for _, *texts in (*tab.CHECK_ITEMS, *tab.WORKSHOP_ITEMS, *derived_properties.SUPPORT_KINDS):
        yield from (("", text, "choice in the sidebar") for text in texts)
    for text in finding_words.FAILURE_LABELS.values():
        yield "", text, "what there is to look at, and its cure"
    for text in stages.MISSING.values():
        yield "", text, "why a button is grey"
    for text in optimise.ENDS.values():
        yield "", text, "how an optimisation ended"
    yield "", wishes.UNSTRAINED_MESSAGE, "how an optimisation ended"
    for file in sorted(p for folder in ("operators", "bridge") for p in (ROOT / folder).rglob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        calls = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and _name(node.func) in {"translate", "interface"}
        ]
        named = {_name(node.args[0]) for node in calls}
        for text in (t for node in calls for t in _texts(node.args[0])):
            yield "", text, "report"
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and _name(node.targets[0]) in named - {""}:
                for text in _texts(node.value):
                    yield "", text, "report"
            if isinstance(node, ast.FunctionDef) and node.name in {
                "obstacle",
                "problem",
                "usage_problem",
                "reason_unavailable",
            }:
                returned = (line.value for line in ast.walk(node) if isinstance(line, ast.Return) and line.value)
                for text in (t for value in returned for t in _texts(value)):
                    yield "", text, "why a button is grey"


def _texts(value: ast.expr) -> Iterator[str]:
    """Yield the texts that an expression other than a call may have."""
    if isinstance(value, ast.Constant) and isinstance(value.value, str):
        yield value.value
    elif isinstance(value, ast.IfExp):
        yield from _texts(value.body)
        yield from _texts(value.orelse)


def _is_text(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


if __name__ == "__main__":
    sys.path.append(str(ROOT / "tools"))
    import dev

    dev.load_package()
    sys.exit(main())
