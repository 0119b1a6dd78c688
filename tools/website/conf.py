"""What Sphinx asks for the site; ``tools/website.py`` lays the pages out and calls it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT / "tools"))
import dev  # noqa: E402

dev.load_package()

project, author, copyright = (
    "FlexMaps for Blender",
    "FlexMaps contributors",
    "2026 FlexMaps contributors, GPL-3.0-or-later",
)
version = re.search(
    r'^version = "(.+)"', (ROOT / "blender_manifest.toml").read_text(encoding="utf-8"), re.MULTILINE
).group(1)  # type: ignore[union-attr]
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton"]
root_doc = "documentation"  # the front page is no page of Sphinx's
html_theme, html_title = "furo", "FlexMaps"
html_additional_pages = {"index": "front.html"}
templates_path = [str(HERE / "templates")]
html_static_path, html_css_files = [str(HERE / "static")], ["site.css"]
html_favicon = str(HERE / "static" / "mark.svg")
html_show_sphinx = html_show_sourcelink = html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#b4501e", "color-brand-content": "#a5440f", "color-brand-visited": "#a5440f",
                            "font-stack": "system-ui, -apple-system, 'Segoe UI', 'Noto Sans', sans-serif"},
    "dark_css_variables": {"color-brand-primary": "#ffa26b", "color-brand-content": "#ffa26b", "color-brand-visited": "#ffa26b"},
}  # fmt: skip
highlight_language = "none"
pygments_style, pygments_dark_style = "friendly", "monokai"
copybutton_exclude = ".linenos, .gp"
myst_heading_anchors = 3  # levels of headings that links may lead to: the guide has so many
myst_enable_extensions = ["colon_fence"]
autodoc_member_order, autodoc_class_signature = "bysource", "separated"
autodoc_preserve_defaults = True
add_module_names = False
python_maximum_signature_line_length = 80  # characters; a longer one has a line for each argument
html_context = {"install": "quickstart.html#install"}  # website.py gives another address where there is a repository

# "edge, height : millimetres, ..." as our docstrings have it; a name or several, then a blank, a colon and a blank
WORDS = re.compile(r"(?:^|(?<=; ))([a-z_]\w*(?:(?:, | and )[a-z_]\w*)*) : ")


def setup(app: object) -> None:
    app.connect("autodoc-process-docstring", listed)  # type: ignore[attr-defined]


def listed(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """The lines of a docstring that explain arguments or members, as a list; what is indented, as code."""
    made: list[str] = []
    inside = code = False
    for line in lines:
        if line.startswith("    ") and made and not made[-1].strip() and not inside and not code:
            made += [".. code-block:: python", ""]
            code = True
        code = code and (not line.strip() or line.startswith("    "))
        if WORDS.match(line):
            made += ([] if inside else [""]) + _items(line)
            inside = True
        elif inside and line.strip():
            made.append("  " + line.strip())
        else:
            made.append(line)
            inside = False
    lines[:] = [*made, ""]


def _items(line: str) -> list[str]:
    starts = [*WORDS.finditer(line)]
    ends = [found.start() for found in starts[1:]] + [len(line)]
    return [
        f"- **{found.group(1)}**: {line[found.end() : end].strip().removesuffix(';')}"
        for found, end in zip(starts, ends, strict=True)
    ]
