"""The pages of the site, laid out for Sphinx: those of the repository with their links turned to the site, and those made from the program.

Used by ``tools/website.py``.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
# the repository's pages by what they are called on the site
PAGES = {
    "docs/quickstart.md": "quickstart.md",
    "docs/tutorial.md": "tutorial.md",
    "docs/guide.md": "guide.md",
    "docs/gallery.md": "gallery.md",
    "docs/background.md": "background.md",
    "docs/glossary.md": "glossary.md",
    "docs/extend.md": "extend.md",
    "docs/microstructures.md": "microstructures.md",
    "docs/translating.md": "translating.md",
    "docs/development.md": "development.md",
    "docs/clearance.md": "clearance.md",
    "docs/tuning.md": "tuning.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "database/report/README.md": "database-report.md",
    "tools/website/documentation.md": "documentation.md",
    **{f"examples/{path.name}": f"examples/{path.stem}.md" for path in EXAMPLES},
}
LINK = re.compile(r"(\]\()([^)\s#:]+)(#[^)\s]*)?\)")  # of Markdown, to a file of the repository
PICTURES = {".png", ".jpg", ".webp", ".svg"}
COLUMNS = 92  # of the command line's help; as wide as a page shows

FUNCTIONS = {
    "From and to Blender, files and arrays": ("load", "check", "remesh", "change", "show", "save"),
    "Stages": ("regularise", "layout", "choose", "take", "spirals", "simulate", "optimise", "sheets"),
    "What it bears, and how it was built": ("structure", "compare"),
    "Spirals and forces by hand": ("paint", "protect", "pull", "wish"),
    "Many candidates": ("explore", "use"),
    "Files": ("export", "report", "share", "calibration_sheet", "calibrated", "run"),
}
TYPES = {
    "What the functions give": ("api.Piece", "engine.runs.result.Result", "api.Finding", "api.Calibration", "engine.extras.exploring.explore.Exploration"),
    "Meshes": ("api.QuadMesh", "api.PolygonMesh"),
    "Inside a result": (
        "engine.patches.layout.PatchLayout", "engine.patches.flattening.flatten.FlatPatches", "engine.spirals.design.SpiralDesign",
        "engine.simulation.simulate.Simulation", "engine.optimisation.optimise.Optimisation", "engine.extras.structure.analysis.StructuralAnalysis",
        "engine.extras.scanning.compare.Comparison", "engine.fabrication.sheets.CutSheets",
    ),
    "Errors": ("api.FlexMapsError", "api.Cancelled"),
}  # fmt: skip


class NotOnTheSite(ValueError):
    """A page links to a file that the site does not have."""


def lay_out(folder: Path) -> None:
    """Fill a folder with everything that Sphinx is to read."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for source, target in PAGES.items():
        path = folder / target
        path.parent.mkdir(exist_ok=True)
        text = example(ROOT / source) if source.startswith("examples/") else (ROOT / source).read_text(encoding="utf-8")
        path.write_text(convert_page(text, source, folder), encoding="utf-8")
    for name, text in (
        ("api.md", functions()),
        ("commands.md", commands()),
        ("settings.md", settings()),
        ("examples.md", examples()),
        ("licences.md", licences()),
    ):
        (folder / name).write_text(text, encoding="utf-8")


def convert_page(text: str, source: str, folder: Path) -> str:
    """A page of the repository with its links leading to the site's pages, and its pictures beside them.

    Raises ``NotOnTheSite`` for a link to anything else of the repository.
    """
    here = PurePosixPath(PAGES[source])

    def turn(found: re.Match[str]) -> str:
        name = os.path.normpath(os.path.join(os.path.dirname(source), found.group(2)))
        if PurePosixPath(name).suffix in PICTURES and (ROOT / name).is_file():
            target = os.path.join("pictures", os.path.relpath(name, "docs").replace("../", ""))
            (folder / target).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / target)
        elif name in PAGES:
            target = PAGES[name]
        elif source == "tools/website/documentation.md":
            return found.group(0)  # written for the site
        else:
            raise NotOnTheSite(
                f"{source} links to {found.group(2)}, which is no page of the site; see PAGES in tools/site_pages.py"
            )
        return "](" + os.path.relpath(target, here.parent) + (found.group(3) or "") + ")"

    return LINK.sub(turn, text)


# -- made from the program ---------------------------------------------------------------------------------------------


def example(path: Path) -> str:
    """A page of one script: what it shows, and the script."""
    code = path.read_text(encoding="utf-8")
    said = re.match(r'"""(.*?)"""', code, re.DOTALL)
    assert said is not None
    return f"# {_title(path)}\n\n{said.group(1).strip()}\n\n```python\n{code.rstrip()}\n```\n"


def _title(path: Path) -> str:
    number, _, words = path.stem.partition("_")
    return f"{int(number)}. {words.replace('_', ' ').capitalize()}"


def examples() -> str:
    listed = "\n".join(f"examples/{path.stem}" for path in EXAMPLES)
    return (
        "# Examples\n\nShort scripts, one idea each; the tests run them all. From a checkout: `python3 tools/dev.py python examples/NAME.py`.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"
    )


def functions() -> str:
    """The reference of ``api``, from its docstrings, and of what its functions give."""
    from flexmaps import api

    told = {name for names in FUNCTIONS.values() for name in names}
    there = {name for name in api.__all__ if name[0].islower()}
    assert told == there, f"FUNCTIONS in tools/site_pages.py: {sorted(told ^ there)}"
    lines = ["# API", "", "```{eval-rst}", ".. automodule:: flexmaps.api", "   :no-members:", "```", ""]
    for title, names in FUNCTIONS.items():
        lines += [f"## {title}", "", "```{eval-rst}"]
        lines += [f".. autofunction:: flexmaps.api.{name}" for name in names] + ["```", ""]
    for title, names in TYPES.items():
        lines += [f"## {title}", ""]
        if title == "Meshes":
            lines += ["Arrays inside are in metres and radians; their shapes stand beside them.", ""]
        lines += ["```{eval-rst}"]
        for name in names:
            lines += [f".. autoclass:: flexmaps.{name}", "   :members:", "   :exclude-members: __init__", ""]
        lines += ["```", ""]
    return "\n".join(lines)


def commands() -> str:
    """The command line's help, command by command."""
    from flexmaps.command import arguments

    made = arguments.make_parser()
    lines = [
        "# Commands", "", "As Blender's own command, `blender --command flexmaps ...`, or `flexmaps ...` where it was installed by pip.",
        "What they have in common stands in the [guide](guide.md#command-line); what every setting means, under [settings](settings.md).", "",
    ]  # fmt: skip
    for name, one in subparsers(made):
        lines += [f"## {name}", "", "```text", one.format_help().rstrip(), "```", ""]
    return "\n".join(lines)


def subparsers(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The commands of a parser and theirs."""
    os.environ["COLUMNS"] = str(COLUMNS)  # where argparse looks
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from action.choices.items()


def settings() -> str:
    """A table of all settings, section by section."""
    from flexmaps.command import arguments

    rows = arguments._list_settings()["settings"]
    lines = [
        "# Settings", "", "By the names that the command line (`--set section.name=value`) and Python know them by, in the units of the sidebar.",
        "The sidebar shows the same settings by their labels.", "",
    ]  # fmt: skip
    section = ""
    for name, row in rows.items():
        if name.split(".")[0] != section:
            section = name.split(".")[0]
            lines += ["", f"## {section}", "", "| name | default | bounds | what it is |", "|---|---|---|---|"]
        low, high = row["bounds"]
        bounds = ", ".join(f"`{c}`" for c in row["choices"]) or (
            "" if low is None and high is None else f"{_said(low)} to {_said(high)}"
        )
        value = str(row["default"]) or "-"
        lines.append(f"| `{name.split('.')[1]}` | {value} {row['unit']} | {bounds} | {_cell(row['help'])} |")
    return "\n".join(lines) + "\n"


def _said(bound: float | None) -> str:
    return "any" if bound is None else f"{bound:g}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")


def licences() -> str:
    """List the packages of others in the zips; each zip's own THIRD_PARTY.md also says where each licence's text lies."""
    import third_party

    pins = re.findall(r"^([\w.-]+)==([\w.]+)", (ROOT / "requirements" / "runtime.txt").read_text(), re.MULTILINE)
    lines = [
        "# Licences", "", "FlexMaps is free software under GPL-3.0-or-later. Its zips carry these Python packages, each with the text of its licence;",
        "`THIRD_PARTY.md` in every zip says where.", "", "| package | version | licence | source |", "|---|---|---|---|",
    ]  # fmt: skip
    libraries = []
    for name, version in sorted(pins, key=lambda pin: pin[0].lower()):
        package = third_party.PACKAGES[name.lower().replace("-", "_")]
        lines.append(f"| {name} | {version} | {package.licence} | <{package.source}> |")
        libraries += [
            f"| {begin} | {name} | {library.licence} | <{library.source}> |"
            for begin, library in package.libraries.items()
        ]
    lines += [
        "",
        "Compiled libraries inside them, on one system or another:",
        "",
        "| library | in | licence | source |",
        "|---|---|---|---|",
        *libraries,
        "",
    ]
    lines += [
        "The report's page holds a part of three.js (MIT, <https://github.com/mrdoob/three.js>). This site was made with Sphinx (BSD-2-Clause),",
        "MyST-Parser (MIT) and Furo (MIT).",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"
