"""What checks the site: links that lead nowhere, code and names in its pages that the program does not have."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def tools() -> dict[str, ModuleType]:
    sys.path.append(str(ROOT / "tools"))
    import site_code
    import site_links
    import site_pages
    import website

    return {module.__name__: module for module in (site_code, site_links, site_pages, website)}


def test_links(tools: dict[str, ModuleType], tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<h1 id="one">A</h1><a href="#one">.</a><a href="b/c.html#two">.</a><a href="https://example.org/x">.</a>'
        '<img src="there.png"><script src="https://cdn.example.org/y.js"></script><link rel="stylesheet" href="s.css">'
    )
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "c.html").write_text('<p id="two"><a href="../a.html">.</a><a href="../b/">.</a>')
    (tmp_path / "there.png").touch()
    (tmp_path / "s.css").write_text(
        "@font-face { src: url(https://fonts.example.org/f.woff2) } p { background: url('there.png') }"
    )
    found = tools["site_links"].check(tmp_path)
    assert found.broken == ("b/c.html: ../b/",)  # a folder without an index
    assert found.elsewhere == ("https://example.org/x",)
    assert found.loaded == ("https://cdn.example.org/y.js", "https://fonts.example.org/f.woff2")
    (tmp_path / "b" / "index.html").write_text(
        '<a href="c.html#three">.</a><a href="../../beyond.html">.</a><img src="no.png">'
    )
    lost = tools["site_links"].check(tmp_path).broken
    assert lost == ("b/index.html: c.html#three", "b/index.html: ../../beyond.html", "b/index.html: no.png")


PAGE = """# Page

    blender --command flexmaps run a.obj --edge 20 \\
        --out out
    blender --command flexmaps run a.obj --corner 3 --out out
    blender --command flexmaps walk a.obj
    python3 tools/dev.py bench layout
    python3 tools/dev.py bench nothing
    rm -rf out

1. In a list:

       python3 tools/dev.py dance

    An item's second paragraph is no code.

```python
from flexmaps import api
```

    surface -> panels

Then `api.optimise(piece)`, `api.optimize(piece)`, `bpy.ops.flexmaps.merge()`, `bpy.ops.flexmaps.submerge()`, `flexmaps choose --match 1`,
`flexmaps choose --watch 1`.
"""


def test_shell_blocks_and_names(tools: dict[str, ModuleType], tmp_path: Path) -> None:
    code = tools["site_code"]
    assert [(block.line, block.language) for block in code.blocks(PAGE)] == [
        (3, "shell"),
        (13, "shell"),
        (18, "python"),
        (21, ""),
    ]
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    counts, faults = code.summary([page])
    assert counts == {"shell": 2, "python": 1, "": 1}
    for said, fault in zip(
        (
            "--corner",
            "walk",
            "bench nothing",
            "rm is no command",
            "dance",
            "api.optimize",
            "flexmaps.submerge",
            "--watch",
        ),
        faults,
        strict=True,
    ):
        assert said in fault


def test_python_blocks_are_run(tools: dict[str, ModuleType], tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "```python\nx = api.load('surface.obj')\n```\n\n```python\nassert len(x.mesh.quads) == 16\nx.no_such_thing\n```\n"
    )
    ran, faults = tools["site_code"].python_faults(page)
    assert ran == 2
    assert len(faults) == 1
    assert "page.md, line 6" in faults[0]
    assert "no_such_thing" in faults[0]
    assert Path.cwd() != tmp_path


def test_the_pages_that_there_are(tools: dict[str, ModuleType]) -> None:
    """Every page of docs/ is on the site, and their shell lines and names are the program's."""
    assert [
        path.name for path in (ROOT / "docs").glob("*.md") if f"docs/{path.name}" not in tools["site_pages"].PAGES
    ] == []
    counts, faults = tools["site_code"].summary(tools["website"].checked_pages())
    assert faults == []
    assert counts["shell"] > 5
    assert counts["python"] > 3


def test_links_of_pages_are_turned(tools: dict[str, ModuleType], tmp_path: Path) -> None:
    pages = tools["site_pages"]
    text = "[a](../CONTRIBUTING.md#tests) ![b](images/sidebar.png) [c](https://example.org) [d](#here) [e](../examples/04_own_material.py)"
    assert pages.convert_page(text, "docs/guide.md", tmp_path) == (
        "[a](contributing.md#tests) ![b](pictures/images/sidebar.png) [c](https://example.org) [d](#here) [e](examples/04_own_material.md)"
    )
    assert (tmp_path / "pictures" / "images" / "sidebar.png").is_file()
    with pytest.raises(pages.NotOnTheSite):
        pages.convert_page("[x](../engine/newton.py)", "docs/guide.md", tmp_path)
